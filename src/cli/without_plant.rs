//! Replaces the plant connections in a program that was built without them: cell files and commands that need them are
//! refused.

use super::args::{Archive, Fleet};
use super::fault::{DeviceFault, Fault};
use super::load::CellFiles;
use super::output::Outcome;
use panelprep_base::verdict::Reason;
use panelprep_service::daemon::InterfaceContext;
use panelprep_store::office::RecipeOffer;

/// The connections: none.
pub struct PlantConnections;

/// The status of the transfer to the office server, which this program does not support.
#[derive(Debug, Clone, Default)]
pub struct OfficeStatus;

impl OfficeStatus {
    /// Returns no offer.
    pub fn recipe_offer(&self, _panel: &str) -> Option<RecipeOffer> {
        None
    }

    /// Returns no reasons: a cell whose file names an office server is refused, so nothing is transferred.
    pub fn reasons(&self, _behind_min: usize, _now_unix_ms: i64) -> Vec<Reason> {
        vec![]
    }
}

/// Connects nothing: a cell whose file names a plant connection was already refused ([`DeviceFault::missing_plant`]).
///
/// # Errors
/// Never.
pub fn connect(
    _files: &CellFiles,
    _context: &InterfaceContext,
    _status: &OfficeStatus,
) -> Result<PlantConnections, Fault> {
    Ok(PlantConnections)
}

/// Refuses the command `panelprep archive`.
///
/// # Errors
/// Always.
pub fn run_archive(_args: &Archive) -> Result<Outcome, Fault> {
    Err(DeviceFault::BuiltWithoutPlant { what: "panelprep archive".to_owned() }.into())
}

/// Refuses the command `panelprep fleet`.
///
/// # Errors
/// Always.
pub fn run_fleet(_args: &Fleet) -> Result<Outcome, Fault> {
    Err(DeviceFault::BuiltWithoutPlant { what: "panelprep fleet".to_owned() }.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::Cell;

    #[test]
    fn a_program_without_the_plant_says_how_to_build_it() {
        let cell = "[opcua]\nlisten = '127.0.0.1:4840'\n[office]\nbroker = 'nats://10.0.0.1:4222'\ncell = 'a'\n";
        let cell = Cell::check("cell.toml", cell).expect("good");
        assert_eq!(cell.plant_tables(), ["[office]", "[opcua] listen"]);
        let words = Fault::from(DeviceFault::missing_plant(&cell).expect("refused")).to_string();
        assert!(words.starts_with("[office], [opcua] listen: ") && words.contains("--features plant"), "{words}");
        let without = Cell::check("cell.toml", "").expect("good");
        assert!(DeviceFault::missing_plant(&without).is_none());
    }
}
