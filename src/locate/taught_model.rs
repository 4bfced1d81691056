//! What the localization makes of a taught panel before there is a scan: once, since nothing of it depends on the scan.

use super::LocateError;
use super::grid::{Grid, Motion};
use super::model::Model;
use super::scan_errors::RangeErrors;
use crate::panel::TaughtPanel;
use nalgebra::Vector3;
use std::sync::OnceLock;

/// A taught panel as the localization uses it, for scans that are so far off.
pub struct TaughtModel {
    /// The panel.
    pub(super) model: Model,
    /// What else the taught scan shows: the fixture.
    pub(super) fixture: Grid,
}

impl TaughtModel {
    /// Derives it.
    ///
    /// # Errors
    /// Where the taught panel has too little surface or outline.
    pub fn of(panel: &TaughtPanel, range: RangeErrors) -> Result<Self, LocateError> {
        let (model, fixture) = rayon::join(|| Model::of(panel, range), || fixture(panel));
        Ok(TaughtModel { model: model?, fixture })
    }
}

/// The taught scan without its panel.
fn fixture(panel: &TaughtPanel) -> Grid {
    let motion = Motion::of(&panel.panel_from_camera.inverse());
    let depth_row = motion.turn.row(2).into_owned();
    let raw = panel.scan.raw_points_mm();
    let depth = |index: usize| {
        let [x, y, z] = raw[index];
        let depth = (depth_row * Vector3::new(f64::from(x), f64::from(y), f64::from(z)))[0] + motion.shift.z;
        (depth > 0.0 && !panel.mask.inside[index]).then_some(depth as f32)
    };
    Grid::of_depths((panel.scan.width(), panel.scan.height()), &panel.camera, depth)
}

/// A [`TaughtModel`] that is made when it is first asked for.
#[derive(Default)]
pub struct TaughtModelOnce(OnceLock<Result<TaughtModel, LocateError>>);

impl TaughtModelOnce {
    /// The model; the first call makes it, and what it is called with must be the same each time.
    ///
    /// # Errors
    /// As [`TaughtModel::of`].
    pub fn of(&self, panel: &TaughtPanel, range: RangeErrors) -> Result<&TaughtModel, LocateError> {
        self.0.get_or_init(|| TaughtModel::of(panel, range)).as_ref().map_err(LocateError::clone)
    }
}

impl std::fmt::Debug for TaughtModelOnce {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TaughtModelOnce").field("is_made", &self.0.get().is_some()).finish()
    }
}
