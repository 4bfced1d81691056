//! Pictures of a film for its strip, cut to the region: evenly distributed, and at short intervals once the film
//! opens.

use crate::report::{StripPicture, bounds, cut_out, film_strip, strip_times_s};
use panelprep_base::geometry::{Camera, ColorPicture, Mask, Panel, PinholeCamera, Rigid};
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::TaughtPanel;
use panelprep_vision::inspect::{Inspection, PictureResult};

/// Times that differ by less than this are equal, s.
const TIME_TOLERANCE_S: f64 = 1e-3;

/// The selected pictures so far.
#[derive(Debug)]
pub(super) struct KeyframeStrip {
    /// The box around the region in the picture.
    bounds: [(usize, usize); 2],
    /// The film's expected duration, as far as it is known, s.
    lasts_s: f64,
    opened_s: Option<f64>,
    cuts: Vec<(f64, ColorPicture)>,
}

impl KeyframeStrip {
    pub fn new(
        panel: &TaughtPanel,
        (camera, camera_from_panel): (&PinholeCamera, Rigid<Camera, Panel>),
        lasts_s: f64,
    ) -> Self {
        let edges = panel.grids.iter().flat_map(|grid| &grid.edge);
        let pixels = edges.filter_map(|&point| camera.project(camera_from_panel * point));
        let bounds = bounds(pixels, (camera.width_px, camera.height_px));
        KeyframeStrip { bounds, lasts_s, opened_s: None, cuts: Vec::new() }
    }

    /// Stores the picture if the strip may need it.
    pub fn offer_picture(&mut self, picture: &ColorPicture, step: &PictureResult) {
        let Some(since_wet_s) = step.since_wet_s else { return };
        let opens = self.opened_s.is_none() && step.broken_mm2 > 0.0;
        if opens {
            self.opened_s = Some(since_wet_s);
        }
        let end_s = self.lasts_s;
        let wanted = strip_times_s(None, end_s).into_iter().chain(strip_times_s(self.opened_s, end_s));
        let last_s = self.cuts.last().map_or(f64::NEG_INFINITY, |(time_s, _)| *time_s);
        if wanted
            .into_iter()
            .any(|time_s| last_s < time_s - TIME_TOLERANCE_S && time_s - TIME_TOLERANCE_S <= since_wet_s)
        {
            let nothing = Mask::all_outside(picture.width, picture.height);
            self.cuts.push((since_wet_s, cut_out(picture, &nothing, self.bounds).0));
        }
    }

    /// Draws the strip: each picture with the area that had broken by then; `last` is the film's last picture.
    pub fn draw_strip(&self, inspection: &Inspection, last: &ColorPicture) -> Result<ColorPicture, ImagingError> {
        let broke_s = inspection.breaks.iter().map(|found| found.first_seen_s).reduce(f64::min);
        let end_s = inspection.observation.observed_s;
        let pictures: Vec<StripPicture> = strip_times_s(broke_s, end_s)
            .into_iter()
            .map(|time_s| {
                let kept = self.cuts.iter().find(|(kept_s, _)| *kept_s >= time_s - TIME_TOLERANCE_S);
                // After the last stored picture, the strip shows the film's last picture.
                let shown_s = kept.map_or(end_s, |(kept_s, _)| *kept_s);
                let (last, broken) = cut_out(last, &inspection.mask_at(shown_s), self.bounds);
                let picture = kept.map_or(last, |(_, picture)| picture.clone());
                StripPicture { picture, broken, label: format!("{shown_s:.1} s") }
            })
            .collect();
        film_strip(&pictures)
    }
}
