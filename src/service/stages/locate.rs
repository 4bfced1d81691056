//! Localization of the panel: the taught panel is searched for in a 3D scan, and the fit is checked.

use super::ResultDrawing;
use crate::report::{self, reason_pictures};
use panelprep_base::geometry::{ColorPicture, KukaPose};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::files;
use panelprep_cell::panel::{TaughtPanel, TaughtSource};
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{Check, Finding, Kind, name};
use panelprep_toolpath::path::reach::Obstacles;
use panelprep_vision::locate::{Fit, LocateError, PreparedScan, RangeErrors, ScanView, TaughtModel, gate};
use serde_json::json;

/// A localization with its verdict.
pub struct LocateOutcome<'a> {
    /// The fit; `None` if no object like the panel was found.
    pub fit: Option<Fit>,
    /// Every check of the fit; empty if no panel was found.
    pub checks: Vec<Check>,
    /// The verdict.
    pub judgement: Judgement,
    panel: &'a TaughtPanel,
    view: ScanView<'a>,
    prepared: Option<PreparedScan<'a>>,
}

/// Locates the taught panel in a scan and checks the result. A panel that is not found gives a verdict, not an error.
/// The panel's model must have been created for the range errors of this view.
pub fn locate<'a>(
    (panel, model): (&'a TaughtPanel, &'a Result<TaughtModel, LocateError>),
    view: ScanView<'a>,
    recipe: &'a Recipe,
) -> LocateOutcome<'a> {
    // The following steps use only depths and the rays of the lens, so a scan of another lens or in another frame would
    // give a wrong pose without an error.
    if let Err(error) = files::check_lens(view.scan, view.camera) {
        let judgement = Judgement::new(vec![Reason::new("other_scan", error.to_string())], vec![]);
        return LocateOutcome { fit: None, checks: vec![], judgement, panel, view, prepared: None };
    }
    let prepared = model.as_ref().map(|model| PreparedScan::new((panel, model), &view, recipe.locate()));
    let found = prepared.as_ref().map_err(|&error| error.clone()).and_then(PreparedScan::locate);
    let checks = found.as_ref().map_or(Vec::new(), |fit| gate::checks(fit, recipe));
    let judgement = match &found {
        Ok(_) => gate::judgement(&checks),
        Err(error) => gate::refusal(error),
    };
    LocateOutcome { fit: found.ok(), checks, judgement, panel, view, prepared: prepared.ok() }
}

impl LocateOutcome<'_> {
    /// Returns the range errors that are assumed for the 3D camera's scans.
    pub fn range(&self) -> RangeErrors {
        self.view.range
    }

    /// Returns the pose of the drawing's frame in the base frame, if the panel was located and was taught from its
    /// drawing.
    pub fn base_from_drawing(&self) -> Option<KukaPose> {
        // The frame of a panel that was taught from its drawing is the frame of the drawing.
        let fit = self.fit.as_ref().filter(|_| self.panel.reference == TaughtSource::Drawing)?;
        Some(KukaPose::from_rigid(&fit.base_from_panel))
    }

    /// Returns the obstacles that the arm must avoid on its way to a corner: the panel at its located pose, and the
    /// other points of the scan. `None` if the localization is rejected, because then the arm does not move to the
    /// panel.
    pub fn obstacles(&self) -> Option<Obstacles> {
        let fit = self.fit.as_ref().filter(|_| self.judgement.verdict != Verdict::Reject)?;
        let of_panel = self.panel.points().map(|(_, point)| fit.base_from_panel * point);
        let of_scan = self.view.scan.valid_points().map(|(_, point)| self.view.base_from_camera * point);
        Some(Obstacles::default().with_points_of("panel", of_panel).with_points_of("the scan's points", of_scan))
    }

    /// Draws the taught outline and grids at the located pose over the picture of the scan; `None` if no panel was
    /// found.
    pub fn draw_placement(&self, picture: &ColorPicture) -> Option<ResultDrawing> {
        let camera_from_panel = self.view.base_from_camera.inverse() * self.fit.as_ref()?.base_from_panel;
        let view = report::PanelOverlay { picture, camera: self.view.camera, camera_from_panel };
        let caption = "Picture of the scan with the taught outline and grids at the located pose";
        Some(ResultDrawing::new("located", caption, view.located(self.panel)))
    }

    /// Draws a picture of the scan for each reason of the verdict, except for reasons that are not visible in a scan.
    pub fn draw_reasons(&self, picture: &ColorPicture) -> Vec<ResultDrawing> {
        let Some(prepared) = self.prepared.as_ref().filter(|_| !self.judgement.reasons.is_empty()) else {
            return Vec::new();
        };
        let fit = self.fit.as_ref();
        let explained = (&prepared.explain(fit), fit);
        let drawn = reason_pictures(self.panel, (picture, &self.view), explained, &self.judgement);
        drawn.into_iter().map(ResultDrawing::from).collect()
    }

    /// Returns the result for the record; `elapsed_ms` is the time from the scan in memory to the verdict.
    pub fn finding(&self, elapsed_ms: f64) -> Finding {
        let elapsed = Check::new(name::SCAN_TO_VERDICT, "ms", elapsed_ms);
        let finding = Finding::new(Kind::Locate, 0, self.judgement.clone());
        let finding = finding.with_checks(self.checks.iter().cloned()).with_checks([elapsed]);
        let finding = finding.with_detail("3D camera's own errors", json!(self.view.range.describe()));
        let Some(fit) = &self.fit else { return finding };
        let finding = finding.with_detail("base_from_panel", json!(KukaPose::from_rigid(&fit.base_from_panel)));
        match self.base_from_drawing() {
            Some(pose) => finding.with_detail("base_from_drawing", json!(pose)),
            None => finding,
        }
    }
}
