//! The data that the localization derives from a taught panel before there is a scan; derived once, because they do
//! not depend on the scan.

use super::LocateError;
use super::grid::Grid;
use super::model::{Model, taught_grid};
use super::scan_errors::RangeErrors;
use panelprep_cell::panel::TaughtPanel;

/// A taught panel as the localization uses it.
pub struct TaughtModel {
    /// The panel.
    pub(super) model: Model,
    /// The other surfaces in the taught scan: the fixture.
    pub(super) fixture: Grid,
}

impl TaughtModel {
    /// Derives the model.
    ///
    /// # Errors
    /// If the taught panel has too little surface or outline.
    pub fn from_panel(panel: &TaughtPanel, range: RangeErrors) -> Result<Self, LocateError> {
        let (model, fixture) = rayon::join(|| Model::from_panel(panel, range), || taught_grid(panel, false));
        Ok(TaughtModel { model: model?, fixture })
    }
}

impl std::fmt::Debug for TaughtModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TaughtModel").finish_non_exhaustive()
    }
}
