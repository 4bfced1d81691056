//! Where the panel stands: the taught panel is found in a 3D scan, and the gate judges the fit.

use super::Drawing;
use crate::geometry::{ColorPicture, KukaPose};
use crate::locate::{Fit, LocateError, Prepared, View, gate};
use crate::panel::TaughtPanel;
use crate::path::reach::Obstacles;
use crate::recipe;
use crate::record::{Finding, Kind, Limit, Number, name};
use crate::report::{self, reason_pictures};
use crate::verdict::{Judgement, Verdict};
use serde_json::json;

/// A localization with its verdict.
pub struct Located<'a> {
    /// The evidence; `None` where nothing like the panel was found.
    pub fit: Option<Fit>,
    /// The verdict.
    pub judgement: Judgement,
    panel: &'a TaughtPanel,
    view: View<'a>,
    settings: &'a recipe::Locate,
    prepared: Option<Prepared<'a>>,
}

/// Finds the taught panel in a scan and judges what was found. A panel that is not found is a verdict, not an error.
pub fn locate<'a>(panel: &'a TaughtPanel, view: View<'a>, settings: &'a recipe::Locate) -> Located<'a> {
    let prepared = Prepared::new(panel, &view, settings);
    let found = prepared.as_ref().map_err(LocateError::clone).and_then(Prepared::locate);
    let judgement = match &found {
        Ok(fit) => gate::judge(fit, settings),
        Err(error) => gate::refusal(error),
    };
    Located { fit: found.ok(), judgement, panel, view, settings, prepared: prepared.ok() }
}

impl Located<'_> {
    /// What the arm keeps off on its way to a corner: the panel where it was found, and what else the scan shows. There is
    /// none where the localization is rejected, since nothing moves towards such a panel.
    pub fn obstacles(&self) -> Option<Obstacles> {
        let fit = self.fit.as_ref().filter(|_| self.judgement.verdict != Verdict::Reject)?;
        let of_panel = self.panel.points().map(|(_, point)| fit.base_from_panel * point);
        let of_scan = self.view.scan.valid().map(|(_, point)| self.view.base_from_camera * point);
        Some(Obstacles::default().with("panel", of_panel).with("what the scan saw", of_scan))
    }

    /// The taught outline and grids at the place found, over the scan's picture; none where no panel was found.
    pub fn drawn_place(&self, picture: &ColorPicture) -> Option<Drawing> {
        let camera_from_panel = self.view.base_from_camera.inverse() * self.fit.as_ref()?.base_from_panel;
        let view = report::View { picture, camera: self.view.camera, camera_from_panel };
        let caption = "The scan's picture with the taught outline and grids at the place found";
        Some(Drawing::new("located", caption, view.located(self.panel)))
    }

    /// Where each reason of the verdict shows in the scan; none for reasons that no scan shows.
    pub fn drawn_reasons(&self, picture: &ColorPicture) -> Vec<Drawing> {
        let Some(prepared) = self.prepared.as_ref().filter(|_| !self.judgement.reasons.is_empty()) else {
            return Vec::new();
        };
        let fit = self.fit.as_ref();
        let explained = (&prepared.explain(fit), fit);
        let drawn = reason_pictures(self.panel, (picture, &self.view), explained, &self.judgement);
        drawn.into_iter().map(Drawing::from).collect()
    }

    /// The result for the record; the verdict was known `elapsed_ms` after the scan was in memory.
    pub fn finding(&self, elapsed_ms: f64) -> Finding {
        let elapsed = Number::new(name::SCAN_TO_VERDICT, "ms", elapsed_ms);
        let finding = Finding::new(Kind::Locate, 0, self.judgement.clone());
        let Some(fit) = &self.fit else { return finding.with([elapsed]) };
        let pose = json!(KukaPose::from_rigid(&fit.base_from_panel));
        finding.detail("base_from_panel", pose).with(numbers(fit, self.settings)).with([elapsed])
    }
}

fn numbers(fit: &Fit, limits: &recipe::Locate) -> [Number; 22] {
    let uncertainty_mm = fit.camera.map(|camera| camera.uncertainty_mm);
    let noticed_mm = uncertainty_mm.map(gate::noticed_mm);
    // Held to it where a fixture shows it, here or at teaching.
    let is_shown = gate::is_watched(uncertainty_mm) || gate::is_watched(fit.camera_at_teaching_mm);
    let noticed_limit = if is_shown { Limit::AtMost(gate::MAX_CAMERA_NOTICED_MM) } else { Limit::Unlimited };
    let at_most = |name: &str, unit: &str, value: f64, limit: f64| {
        Number::new(name, unit, value).within(Limit::AtMost(limit))
    };
    let at_least =
        |name: &str, value: Option<f64>, limit: f64| Number::new(name, "", value).within(Limit::AtLeast(limit));
    [
        at_most("residual, point to plane, rms", "mm", fit.rms_mm, limits.max_rms_mm()),
        at_most("residual of the outline, rms", "px", fit.outline_rms_px, gate::MAX_OUTLINE_RMS_PX),
        at_least("overlap", Some(fit.overlap()), limits.min_overlap()),
        at_least("outline found", Some(fit.outline_found), gate::min_outline_found(limits)),
        at_most("last step of the fit", "mm", fit.last_step_mm, gate::MAX_LAST_STEP_MM),
        at_most("shift of the panel's centre", "mm", fit.shift_mm, limits.max_shift_mm()),
        at_most("turn in the panel's plane, either way", "°", fit.turn.0.abs(), limits.turn_limit_deg()),
        at_most("tilt of the panel's normal", "°", fit.tilt.0, limits.max_tilt_deg()),
        at_most("taught surface that is seen through", "", fit.seen_through, gate::MAX_SEEN_THROUGH),
        at_most("outline in view that is elsewhere", "", fit.outline_absent, gate::MAX_OUTLINE_ABSENT),
        at_least("panel in view that gave points", Some(fit.measured), gate::MIN_MEASURED),
        Number::new("edge wider than at teaching", "px", fit.blur_px()).within(Limit::AtMost(gate::MAX_BLUR_PX)),
        at_most("panel that is overexposed", "", fit.saturated, gate::MAX_SATURATED),
        at_most("fits from independent starts, apart", "mm", fit.agreement_mm, gate::MAX_DISAGREEMENT_MM),
        at_least(
            "for this placement against the next best, times",
            fit.rival.map(|rival| rival.margin()),
            gate::MIN_MARGIN,
        ),
        at_least(
            "fixture that stands where it stood",
            fit.camera.map(|camera| camera.same),
            gate::MIN_FIXTURE_SAME,
        ),
        Number::new(
            "camera has moved the panel since teaching, by the fixture",
            "mm",
            fit.camera.map(|it| it.moved_mm),
        ),
        Number::new("error of that, 95 %", "mm", uncertainty_mm),
        Number::new("motion less its error", "mm", fit.camera_moved_mm())
            .within(Limit::AtMost(gate::MAX_CAMERA_MOVED_MM)),
        Number::new("a camera is noticed that moves it by", "mm", noticed_mm).within(noticed_limit),
        at_most("error at the worst place, 95 %", "mm", fit.uncertainty_mm, gate::MAX_UNCERTAINTY_MM),
        Number::new("error along the weakest direction, 95 %", "mm", fit.weakest_mm),
    ]
}
