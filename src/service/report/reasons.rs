//! A picture for each reason of a localization's verdict: it marks the place in the scan at which the reason is
//! visible.
//!
//! People with every common type of colour vision can distinguish the colours (Okabe & Ito); the legend of each picture
//! states their meaning. Dots are sample points of the taught panel's surface, lines are its outline.

use super::canvas::{Canvas, InkColor, PenWidth, crop, resize_to_width};
use super::overlay::PanelOverlay;
use panelprep_base::geometry::{ColorPicture, Panel, Pixel, Point, Rigid};
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::TaughtPanel;
use panelprep_vision::locate::explain::{
    ERROR_DISPLAY_SCALE, EvidenceMarks, FixtureMark, MAX_FIXTURE_SHIFT_PX, MIN_SATURATED_LEVEL, OutlineMark,
    SurfaceMark,
};
use panelprep_vision::locate::{self, Fit};

/// Residual at which the colour has its full strength, mm.
const FULL_COLOR_MM: f64 = 0.5;
/// Fraction of the ink in the colour of a dot; the rest is the colour of the picture.
const INK_FRACTION: f64 = 0.75;
/// Half of the side of the cropped square of a close-up, px.
const CLOSE_UP_HALF_SIDE_PX: usize = 24;
/// Width of an enlarged close-up, px.
const CLOSE_UP_WIDTH_PX: usize = 720;
/// Colours of the objects in the search box, from the largest object to the smallest.
const OBJECT_COLORS: [InkColor; 5] =
    [InkColor::ORANGE, InkColor::BLUE, InkColor::GREEN, InkColor::YELLOW, InkColor::VERMILLION];

/// A reason that is shown by dots on the taught surface.
struct DotReason {
    codes: &'static [&'static str],
    caption: &'static str,
    ink: fn(SurfaceMark) -> Option<InkColor>,
    /// The legend: colours with their texts, in which `{full}` is replaced by [`FULL_COLOR_MM`].
    legend: &'static [(InkColor, &'static str)],
}

const DOT_REASONS: [DotReason; 4] = [
    DotReason {
        codes: &["poor_fit", "bent", "not_converged"],
        caption: "Distance of the scan from the taught surface",
        ink: residual_ink,
        legend: &[
            (InkColor::VERMILLION, "scan {full} mm or more in front of it"),
            (InkColor::WHITE, "on the taught surface"),
            (InkColor::BLUE, "scan {full} mm or more behind it"),
        ],
    },
    DotReason {
        codes: &["seen_through"],
        caption: "Where the taught panel is missing",
        ink: |mark| (mark == SurfaceMark::Through).then_some(InkColor::VERMILLION),
        legend: &[
            (InkColor::VERMILLION, "the scan shows an object behind the taught surface"),
            (InkColor::GREEN, "outline found"),
        ],
    },
    DotReason {
        codes: &["points_missing"],
        caption: "Where the scan has no points on the panel",
        ink: |mark| (mark == SurfaceMark::Missing).then_some(InkColor::YELLOW),
        legend: &[(InkColor::YELLOW, "no point"), (InkColor::GREEN, "outline found")],
    },
    DotReason {
        codes: &["low_overlap"],
        caption: "Parts of the taught panel that were not found, and why",
        ink: |mark| match mark {
            SurfaceMark::On(_) | SurfaceMark::Near => None,
            SurfaceMark::Hidden => Some(InkColor::ORANGE),
            SurfaceMark::Through => Some(InkColor::VERMILLION),
            SurfaceMark::Missing => Some(InkColor::YELLOW),
        },
        legend: &[
            (InkColor::ORANGE, "hidden"),
            (InkColor::VERMILLION, "an object behind it is visible"),
            (InkColor::YELLOW, "no point"),
            (InkColor::GREEN, "outline found"),
        ],
    },
];

/// A reason of a verdict with the picture that shows it, or with the error that prevented the picture.
#[derive(Debug)]
pub struct ReasonPicture {
    /// The reason's code.
    pub code: String,
    /// Description of the picture's content.
    pub caption: &'static str,
    /// The picture.
    pub picture: Result<ColorPicture, ImagingError>,
}

/// Draws a picture over the picture of the scan for each reason of a localization's verdict. A reason that is not
/// visible in a scan has no picture.
pub fn reason_pictures(
    panel: &TaughtPanel,
    (picture, seen): (&ColorPicture, &locate::ScanView<'_>),
    (explained, fit): (&EvidenceMarks, Option<&Fit>),
    judgement: &Judgement,
) -> Vec<ReasonPicture> {
    let place = fit.map_or(panel.nominal_pose, |fit| fit.base_from_panel);
    let camera_from_panel = seen.base_from_camera.inverse() * place;
    let view = PanelOverlay { picture, camera: seen.camera, camera_from_panel };
    let drawn = |reason: &Reason| {
        let (picture, caption) = view.draw_reason(panel, (explained, fit), reason)?;
        Some(ReasonPicture { code: reason.code.to_string(), caption, picture })
    };
    judgement.reasons.iter().filter_map(drawn).collect()
}

/// Returns the colour for the result at a point of the outline.
fn outline_ink(mark: OutlineMark) -> InkColor {
    match mark {
        OutlineMark::Found => InkColor::GREEN,
        OutlineMark::Elsewhere => InkColor::VERMILLION,
        OutlineMark::Hidden => InkColor::WHITE,
    }
}

type Drawn = Result<ColorPicture, ImagingError>;

impl PanelOverlay<'_> {
    /// Draws a reason over the picture of the scan. Returns the drawing and its caption; `None` for a reason that is
    /// not visible in a scan.
    fn draw_reason(
        &self,
        panel: &TaughtPanel,
        (explained, fit): (&EvidenceMarks, Option<&Fit>),
        reason: &Reason,
    ) -> Option<(Drawn, &'static str)> {
        if let Some(dots) = DOT_REASONS.iter().find(|dots| dots.codes.contains(&&*reason.code)) {
            return Some((self.draw_dots(panel, explained, dots), dots.caption));
        }
        Some(match &*reason.code {
            "no_panel" => (self.draw_objects(explained), "Objects in the search box"),
            "outline_differs" => {
                let legend = [
                    (InkColor::GREEN, "outline found"),
                    (InkColor::VERMILLION, "not at the taught position"),
                    (InkColor::WHITE, "hidden or out of view"),
                ];
                let picture = self.picture.clone();
                (
                    self.draw_outline(picture, panel, explained, &legend),
                    "Where the panel's edge differs from the taught \
                                                                   one",
                )
            }
            "marks_differ" => {
                let legend = [
                    (InkColor::GREEN, "mark found"),
                    (InkColor::VERMILLION, "not at the taught position"),
                    (InkColor::WHITE, "hidden or out of view"),
                ];
                (self.draw_marks(panel, explained, &legend), "Where the panel's marks differ from the taught marks")
            }
            "overexposed" => {
                let legend = [(InkColor::VERMILLION, "overexposed"), (InkColor::GREEN, "outline found")];
                (
                    self.draw_outline(self.draw_overexposed(), panel, explained, &legend),
                    "Overexposed parts of the picture",
                )
            }
            "blurred" => (self.draw_close_up(explained.widest_step?), "The least sharp part of the panel's edge"),
            "camera_moved" | "camera_unwatched" => {
                (self.draw_fixture(explained), "Taught edges of the fixture, drawn over the new picture")
            }
            "uncertain" | "starts_disagree" => (
                self.draw_least_certain_direction(panel, explained),
                "The direction in which the pose is least certain",
            ),
            "ambiguous" => {
                let (fit, rival) = fit.and_then(|fit| Some((fit, fit.rival?)))?;
                let other = fit.base_from_panel.inverse() * rival.base_from_panel;
                let legend = [(InkColor::ORANGE, "first pose"), (InkColor::BLUE, "other pose")];
                (self.draw_two_poses(panel, other, legend), "Two poses that fit the scan about equally well")
            }
            "shift_limit" | "turn_limit" | "tilt_limit" => {
                let nominal = fit?.base_from_panel.inverse() * panel.nominal_pose;
                let legend = [(InkColor::ORANGE, "present pose"), (InkColor::BLUE, "nominal pose")];
                (self.draw_two_poses(panel, nominal, legend), "The panel's present pose and its nominal pose")
            }
            _ => return None,
        })
    }

    /// Draws dots and the outline over the picture.
    fn draw_dots(&self, panel: &TaughtPanel, explained: &EvidenceMarks, dots: &DotReason) -> Drawn {
        let full = FULL_COLOR_MM.to_string();
        let words: Vec<String> = dots.legend.iter().map(|(_, words)| words.replace("{full}", &full)).collect();
        let legend: Vec<(InkColor, &str)> =
            dots.legend.iter().zip(&words).map(|((ink, _), text)| (*ink, &**text)).collect();
        self.draw_outline(self.draw_reason_dots(explained, dots.ink), panel, explained, &legend)
    }

    /// Returns the picture with dots at the marked points of the taught surface.
    fn draw_reason_dots(
        &self,
        explained: &EvidenceMarks,
        ink: fn(SurfaceMark) -> Option<InkColor>,
    ) -> ColorPicture {
        let mut picture = self.picture.clone();
        for (pixel, mark) in &explained.surface {
            if let Some(ink) = ink(*mark) {
                draw_dot(&mut picture, *pixel, explained.block_px, ink);
            }
        }
        picture
    }

    /// Draws the borders of the panel's marks at their expected positions, and crops the picture to the panel.
    fn draw_marks(
        &self,
        panel: &TaughtPanel,
        explained: &EvidenceMarks,
        legend: &[(InkColor, &str)],
    ) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(self.picture)?;
        for (ends, mark) in &explained.marks {
            canvas.polyline(ends, false, PenWidth { ink: outline_ink(*mark), width_px: self.line_px() + 1 })?;
        }
        self.cropped_with_scale(canvas, panel, legend)
    }

    /// Draws the outline over a picture, with a colour for each result, and crops the picture to the panel.
    fn draw_outline(
        &self,
        picture: ColorPicture,
        panel: &TaughtPanel,
        explained: &EvidenceMarks,
        legend: &[(InkColor, &str)],
    ) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(&picture)?;
        // Successive points with the same mark form one line. A larger distance begins a new line, for example at the
        // outline of a cut-out.
        let apart_px = 12.0 * explained.block_px.max(1) as f64;
        let goes_on =
            |a: &(Pixel, OutlineMark), b: &(Pixel, OutlineMark)| a.1 == b.1 && a.0.distance_px(b.0) < apart_px;
        for run in explained.outline.chunk_by(goes_on) {
            let pixels: Vec<Pixel> = run.iter().map(|(pixel, _)| *pixel).collect();
            canvas.polyline(
                &pixels,
                false,
                PenWidth { ink: outline_ink(run[0].1), width_px: self.line_px() + 1 },
            )?;
        }
        self.cropped_with_scale(canvas, panel, legend)
    }

    fn draw_overexposed(&self) -> ColorPicture {
        let mut picture = self.picture.clone();
        for pixel in &mut picture.rgb {
            if pixel.iter().any(|&level| level >= MIN_SATURATED_LEVEL) {
                *pixel = InkColor::VERMILLION.0;
            }
        }
        picture
    }

    fn draw_close_up(&self, at: Pixel) -> Result<ColorPicture, ImagingError> {
        let first = |n: f64| (n.max(0.0) as usize).saturating_sub(CLOSE_UP_HALF_SIDE_PX);
        let part =
            crop(self.picture, first(at.u), first(at.v), (2 * CLOSE_UP_HALF_SIDE_PX, 2 * CLOSE_UP_HALF_SIDE_PX));
        let meaning = format!("{} x {} pixels, enlarged", part.width, part.height);
        Canvas::from_picture(&resize_to_width(&part, CLOSE_UP_WIDTH_PX)?)?
            .with_legend(&[(InkColor::WHITE, &meaning)])?
            .finish()
    }

    fn draw_fixture(&self, explained: &EvidenceMarks) -> Result<ColorPicture, ImagingError> {
        let mut picture = self.picture.clone();
        // The edges are close together, so rims or crosses would hide their colours.
        let side_px = usize::try_from(4 * self.line_px()).unwrap_or(4) + 1;
        for (pixel, mark) in &explained.fixture {
            let ink = match mark {
                FixtureMark::Unmoved => InkColor::GREEN,
                FixtureMark::Moved => InkColor::VERMILLION,
                FixtureMark::Unseen => InkColor::BLUE,
            };
            draw_dot(&mut picture, *pixel, side_px, ink);
        }
        let moved = format!("moved by more than {MAX_FIXTURE_SHIFT_PX} px, or missing");
        let legend = [
            (InkColor::GREEN, "edge of the fixture that has not moved"),
            (InkColor::VERMILLION, &*moved),
            (InkColor::BLUE, "no fixture seen: hidden, removed, or no 3D point"),
        ];
        Canvas::from_picture(&picture)?.with_legend(&legend)?.finish()
    }

    fn draw_least_certain_direction(
        &self,
        panel: &TaughtPanel,
        explained: &EvidenceMarks,
    ) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(self.picture)?;
        let pen = |ink| PenWidth { ink, width_px: self.line_px() };
        let (found, moved): (Vec<Pixel>, Vec<Pixel>) = explained.weakest.iter().copied().unzip();
        canvas.polyline(&moved, true, pen(InkColor::VERMILLION))?;
        for (from, to) in explained.weakest.iter().step_by((explained.weakest.len() / 40).max(1)) {
            canvas.polyline(&[*from, *to], false, pen(InkColor::VERMILLION))?;
        }
        canvas.polyline(&found, true, pen(InkColor::ORANGE))?;
        let meaning = format!("shifted by the pose error (95 %), drawn {ERROR_DISPLAY_SCALE:.0} times larger");
        self.cropped_with_scale(
            canvas,
            panel,
            &[(InkColor::ORANGE, "found pose"), (InkColor::VERMILLION, &meaning)],
        )
    }

    /// Draws the panel at the located pose and at the competing pose.
    fn draw_two_poses(
        &self,
        panel: &TaughtPanel,
        panel_from_other: Rigid<Panel, Panel>,
        legend: [(InkColor, &str); 2],
    ) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(self.picture)?;
        let other = PanelOverlay { camera_from_panel: self.camera_from_panel * panel_from_other, ..*self };
        let [(here, _), (there, _)] = legend;
        // If both outlines coincide, the wider one is visible on both sides of the narrower one; the lines from the
        // centre show the rotation of each.
        let pens = [
            PenWidth { ink: there, width_px: 4 * self.line_px() },
            PenWidth { ink: here, width_px: self.line_px() },
        ];
        for (view, pen) in [(&other, pens[0]), (self, pens[1])] {
            view.outline(&mut canvas, panel, pen)?;
            view.draw_orientation_line(&mut canvas, panel, pen)?;
        }
        canvas.scale_bar_within(self.px_per_mm(panel.centre()))?;
        let legend = [
            legend[0],
            legend[1],
            (InkColor::WHITE, "from the panel's centre to the first corner (ringed) of the first grid"),
        ];
        canvas.with_legend(&legend)?.finish()
    }

    /// Draws a line from the panel's centre to the first corner of its first grid, and a ring at this corner.
    fn draw_orientation_line(
        &self,
        canvas: &mut Canvas,
        panel: &TaughtPanel,
        pen: PenWidth,
    ) -> Result<(), ImagingError> {
        let first = panel.grids.first().and_then(|grid| grid.edge.first());
        let ends: Vec<Point<Panel>> = first.into_iter().copied().chain([panel.centre()]).collect();
        let (ends, pen) = (self.pixels(&ends), PenWidth { width_px: self.line_px(), ..pen });
        canvas.polyline(&ends, false, pen)?;
        ends.first().map_or(Ok(()), |corner| canvas.cross(*corner, f64::from(pen.width_px) * 8.0, pen))
    }

    fn draw_objects(&self, explained: &EvidenceMarks) -> Result<ColorPicture, ImagingError> {
        let mut picture = self.picture.clone();
        let mut legend = Vec::new();
        for ((area_mm2, places), ink) in explained.objects_in_box.iter().zip(OBJECT_COLORS) {
            for pixel in places {
                draw_dot(&mut picture, *pixel, explained.block_px, ink);
            }
            legend.push((ink, format!("object of {:.0} cm2", area_mm2 / 100.0)));
        }
        if legend.is_empty() {
            legend.push((InkColor::WHITE, "the search box is empty".to_owned()));
        }
        let legend: Vec<(InkColor, &str)> = legend.iter().map(|(ink, text)| (*ink, text.as_str())).collect();
        Canvas::from_picture(&picture)?.with_legend(&legend)?.finish()
    }
}

/// Returns the colour of a residual: blue for a scan behind the surface, white on the surface, vermillion in front of
/// the surface.
fn residual_ink(mark: SurfaceMark) -> Option<InkColor> {
    let SurfaceMark::On(mm) = mark else { return None };
    let share = (mm / FULL_COLOR_MM).clamp(-1.0, 1.0);
    let end = if share > 0.0 { InkColor::VERMILLION } else { InkColor::BLUE };
    Some(InkColor::WHITE.mix_with(end, share.abs()))
}

/// Draws a square of ink around a pixel.
fn draw_dot(picture: &mut ColorPicture, at: Pixel, side_px: usize, ink: InkColor) {
    let first = |n: f64| (n - (side_px as f64 - 1.0) / 2.0).round() as i64;
    let (left, top) = (first(at.u), first(at.v));
    for v in top..top + side_px as i64 {
        for u in left..left + side_px as i64 {
            if u < 0 || v < 0 || u >= picture.width as i64 || v >= picture.height as i64 {
                continue;
            }
            let pixel = &mut picture.rgb[v as usize * picture.width + u as usize];
            *pixel = InkColor(*pixel).mix_with(ink, INK_FRACTION).0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected colour, calculated by hand: a residual of 0.25 mm in front of the surface is halfway from white to
    /// vermillion (213, 94, 0).
    #[test]
    fn residuals_have_their_colours() {
        assert_eq!(residual_ink(SurfaceMark::On(0.25)), Some(InkColor([234, 175, 128])));
        assert_eq!(residual_ink(SurfaceMark::On(-3.0)), Some(InkColor::BLUE));
        assert_eq!([SurfaceMark::Missing, SurfaceMark::Near].map(residual_ink), [None; 2]);
    }

    /// Expected values, calculated by hand: a square of 2 × 2 pixels around (0.4, 1.4) covers columns 0 and 1 and rows
    /// 1 and
    /// 2. A fraction of 0.75 of white over black is 191. A dot outside of the picture draws nothing.
    #[test]
    fn dots_beyond_the_border_are_clipped() {
        let mut picture = ColorPicture::uniform(4, 3, [0; 3]);
        draw_dot(&mut picture, Pixel::at(0.4, 1.4), 2, InkColor::WHITE);
        assert_eq!(picture.rgb.iter().filter(|pixel| pixel[0] == 191).count(), 4);
        draw_dot(&mut picture, Pixel::at(-9.0, 50.0), 2, InkColor::WHITE);
    }
}
