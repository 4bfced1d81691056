//! Draws the panel into the picture of the 3D camera: outline, grids, broken film, paths.
//!
//! All points are projected from the panel's frame with the same camera model, so each drawing shows where the program
//! assumes the object (thesis Eq. 4.6, 4.7, 3.11).

use super::canvas::{Canvas, InkColor, PenWidth, crop};
use panelprep_base::geometry::{Camera, ColorPicture, Mask, Panel, PinholeCamera, Pixel, Point, Rigid};
use panelprep_cell::imaging::{ImagingError, outer_contours};
use panelprep_cell::panel::{Grid, TaughtPanel};

/// A picture of the 3D camera and the panel's pose in it.
#[derive(Debug, Clone, Copy)]
pub struct PanelOverlay<'a> {
    /// The picture.
    pub picture: &'a ColorPicture,
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// The panel's pose.
    pub camera_from_panel: Rigid<Camera, Panel>,
}

/// A colour scale that people with every common type of colour vision can read, after "viridis" of Smith and van der
/// Walt.
const COLOR_SCALE_STOPS: [(f64, InkColor); 5] = [
    (0.0, InkColor([68, 1, 84])),
    (0.25, InkColor([59, 82, 139])),
    (0.5, InkColor([33, 145, 140])),
    (0.75, InkColor([94, 201, 98])),
    (1.0, InkColor([253, 231, 37])),
];

/// Returns the colour for a value between 0 and 1, interpolated between the stops.
fn interpolate_color(share: f64) -> InkColor {
    let at = share.clamp(0.0, 1.0) * (COLOR_SCALE_STOPS.len() - 1) as f64;
    let (low, next) = (at as usize, (at as usize + 1).min(COLOR_SCALE_STOPS.len() - 1));
    COLOR_SCALE_STOPS[low].1.mix_with(COLOR_SCALE_STOPS[next].1, at - low as f64)
}

/// Margin around the panel in a cropped picture, px before any scaling.
const MARGIN_PX: f64 = 40.0;

impl PanelOverlay<'_> {
    pub(super) fn pixels(&self, points: &[Point<Panel>]) -> Vec<Pixel> {
        points.iter().filter_map(|&point| self.camera.project(self.camera_from_panel * point)).collect()
    }

    pub(super) fn px_per_mm(&self, at: Point<Panel>) -> f64 {
        self.camera.px_per_mm_at((self.camera_from_panel * at).mm.z).0
    }

    pub(super) fn line_px(&self) -> i32 {
        (self.picture.height as f64 / 600.0).round().max(1.0) as i32
    }

    /// Draws the outline of the taught panel at the pose of this view.
    pub(super) fn outline(
        &self,
        canvas: &mut Canvas,
        panel: &TaughtPanel,
        pen: PenWidth,
    ) -> Result<(), ImagingError> {
        let step = (panel.outline.len() / 400).max(1);
        let thinned: Vec<Point<Panel>> = panel.outline.iter().copied().step_by(step).collect();
        canvas.polyline(&self.pixels(&thinned), true, pen)
    }

    fn draw_grids(
        &self,
        canvas: &mut Canvas,
        grids: &[Grid],
        failed: &dyn Fn(&Grid) -> bool,
    ) -> Result<(), ImagingError> {
        let thin = PenWidth { ink: InkColor::WHITE, width_px: 1 };
        let thick = PenWidth { ink: InkColor::VERMILLION, width_px: self.line_px() };
        // Failed grids are drawn last, so that no other line covers their edges.
        for (only_failed, pen) in [(false, thin), (true, thick)] {
            for grid in grids.iter().filter(|grid| failed(grid) == only_failed) {
                canvas.polyline(&self.pixels(&grid.edge), true, pen)?;
            }
        }
        // Names are drawn after all edges, each in the first corner of its grid, so that the middle of the grid stays
        // visible.
        let height_px = (self.picture.height as f64 / 80.0).max(8.0);
        for grid in grids {
            if let Some(first) = self.pixels(&grid.edge).first() {
                let corner = Pixel::at(first.u + height_px * 0.5, first.v + height_px * 1.6);
                canvas.label(corner, &grid.id.to_string(), height_px, InkColor::WHITE)?;
            }
        }
        Ok(())
    }

    /// Crops the picture to the panel, and adds a scale bar and a legend.
    pub(super) fn cropped_with_scale(
        &self,
        canvas: Canvas,
        panel: &TaughtPanel,
        legend: &[(InkColor, &str)],
    ) -> Result<ColorPicture, ImagingError> {
        let outline = self.pixels(&panel.outline);
        let margin = MARGIN_PX * self.picture.width as f64 / 1944.0;
        let bounds = |of: fn(&Pixel) -> f64, size: usize| {
            let low = outline.iter().map(of).fold(f64::INFINITY, f64::min) - margin;
            let high = outline.iter().map(of).fold(f64::NEG_INFINITY, f64::max) + margin;
            (low.clamp(0.0, size as f64 - 2.0) as usize, high.clamp(2.0, size as f64) as usize)
        };
        let (left, right) = bounds(|pixel| pixel.u, self.picture.width);
        let (top, bottom) = bounds(|pixel| pixel.v, self.picture.height);
        let size = (right.saturating_sub(left).max(2), bottom.saturating_sub(top).max(2));
        let part = crop(&canvas.finish()?, left, top, size);
        let mut canvas = Canvas::from_picture(&part)?;
        canvas.scale_bar_within(self.px_per_mm(panel.centre()))?;
        canvas.with_legend(legend)?.finish()
    }

    /// Draws the taught data: the panel's pixels, its outline, the grids of the region.
    ///
    /// # Errors
    /// If OpenCV cannot draw on the picture. This also applies to the other drawings.
    pub fn taught(&self, panel: &TaughtPanel, corners: &[Point<Panel>]) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(self.picture)?;
        canvas.tint_mask(&panel.mask, InkColor::BLUE, 0.25)?;
        self.outline(&mut canvas, panel, PenWidth { ink: InkColor::BLUE, width_px: self.line_px() })?;
        self.draw_grids(&mut canvas, &panel.grids, &|_| false)?;
        for pixel in self.pixels(corners) {
            canvas.cross(pixel, 14.0, PenWidth { ink: InkColor::ORANGE, width_px: self.line_px() })?;
        }
        for held in &panel.held_px {
            canvas.polyline(held, true, PenWidth { ink: InkColor::VERMILLION, width_px: self.line_px() })?;
        }
        let mut legend = vec![(InkColor::BLUE, "taught panel"), (InkColor::WHITE, "grids")];
        legend.extend((!corners.is_empty()).then_some((InkColor::ORANGE, "taught corner")));
        legend.extend(
            (!panel.held_px.is_empty()).then_some((InkColor::VERMILLION, "area of a holder or clamp: not used")),
        );
        self.cropped_with_scale(canvas, panel, &legend)
    }

    /// Draws the located panel over the new picture: its taught outline and grids at the located pose.
    ///
    /// # Errors
    /// As [`PanelOverlay::taught`].
    pub fn located(&self, panel: &TaughtPanel) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(self.picture)?;
        self.outline(&mut canvas, panel, PenWidth { ink: InkColor::ORANGE, width_px: self.line_px() })?;
        self.draw_grids(&mut canvas, &panel.grids, &|_| false)?;
        self.cropped_with_scale(
            canvas,
            panel,
            &[(InkColor::ORANGE, "taught outline at the located pose"), (InkColor::WHITE, "grids")],
        )
    }

    /// Draws the broken area, tinted and outlined; the outline of the area that was not visible, if it is known; and
    /// failed grids with a thick edge.
    ///
    /// # Errors
    /// As [`PanelOverlay::taught`].
    pub fn draw_inspection(
        &self,
        panel: &TaughtPanel,
        broken: &Mask,
        not_seen: Option<&Mask>,
        failed: &dyn Fn(&Grid) -> bool,
    ) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(self.picture)?;
        let not_seen = not_seen.filter(|mask| mask.inside.contains(&true));
        for (mask, ink) in
            not_seen.map(|mask| (mask, InkColor::BLUE)).into_iter().chain([(broken, InkColor::YELLOW)])
        {
            canvas.tint_mask(mask, ink, 0.3)?;
            for contour in outer_contours(mask)? {
                canvas.polyline(&contour, true, PenWidth { ink, width_px: 1 })?;
            }
        }
        self.draw_grids(&mut canvas, &panel.grids, failed)?;
        let mut legend = vec![
            (InkColor::YELLOW, "broken film"),
            (InkColor::VERMILLION, "failed grid"),
            (InkColor::WHITE, "grid that did not fail"),
        ];
        legend.extend(not_seen.map(|_| (InkColor::BLUE, "not seen")));
        self.cropped_with_scale(canvas, panel, &legend)
    }

    /// Draws the time at which the film broke at each pixel: early breaks are dark violet, late ones yellow. `time_s`
    /// returns the time for a column and a row.
    ///
    /// # Errors
    /// As [`PanelOverlay::taught`].
    pub fn break_times(
        &self,
        panel: &TaughtPanel,
        time_s: &dyn Fn(usize, usize) -> Option<f64>,
        end_s: f64,
    ) -> Result<ColorPicture, ImagingError> {
        // The picture is made grey and lighter, so that the darkest colour of the scale, the earliest break, is clearly
        // visible on a dark panel.
        let mut picture = self.picture.to_gray().to_color();
        picture.rgb.iter_mut().for_each(|pixel| *pixel = pixel.map(|gray| 120 + gray / 4));
        for (index, pixel) in picture.rgb.iter_mut().enumerate() {
            if let Some(time_s) = time_s(index % self.picture.width, index / self.picture.width) {
                *pixel = interpolate_color(time_s / end_s.max(1e-9)).0;
            }
        }
        let mut canvas = Canvas::from_picture(&picture)?;
        self.draw_grids(&mut canvas, &panel.grids, &|_| false)?;
        let meaning: Vec<String> =
            COLOR_SCALE_STOPS.iter().map(|(share, _)| format!("broke at {:.1} s", share * end_s)).collect();
        let legend: Vec<(InkColor, &str)> =
            COLOR_SCALE_STOPS.iter().zip(&meaning).map(|((_, ink), text)| (*ink, &**text)).collect();
        self.cropped_with_scale(canvas, panel, &legend)
    }

    /// Draws the tool paths over the panel, each with a ring around its first point.
    ///
    /// # Errors
    /// As [`PanelOverlay::taught`].
    pub fn draw_plan(
        &self,
        panel: &TaughtPanel,
        (paths, areas): (&[Vec<Point<Panel>>], &[Vec<Point<Panel>>]),
        planned: &dyn Fn(&Grid) -> bool,
    ) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(self.picture)?;
        self.draw_grids(&mut canvas, &panel.grids, planned)?;
        for area in areas {
            canvas.polyline(
                &self.pixels(area),
                true,
                PenWidth { ink: InkColor::ORANGE, width_px: self.line_px() },
            )?;
        }
        let pen = PenWidth { ink: InkColor::YELLOW, width_px: self.line_px() };
        for path in paths {
            let pixels = self.pixels(path);
            canvas.polyline(&pixels, false, pen)?;
            if let Some(first) = pixels.first() {
                canvas.cross(*first, f64::from(pen.width_px) * 4.0, PenWidth { ink: InkColor::BLUE, ..pen })?;
            }
        }
        let mut legend = vec![
            (InkColor::YELLOW, "path of the tool centre point"),
            (InkColor::BLUE, "first contact"),
            (InkColor::VERMILLION, "grid to abrade"),
            (InkColor::WHITE, "other grid"),
        ];
        if !areas.is_empty() {
            legend[2].1 = "grid that is sanded in part";
            legend.push((InkColor::ORANGE, "area around a water break: sanded"));
        }
        self.cropped_with_scale(canvas, panel, &legend)
    }
}
