//! The program without the systems of a plant: the commands of the office are refused.

use super::args::{Archive, Fleet};
use super::fault::Fault;
use super::output::Outcome;
use panelprep_service::setup::SetupFault;

/// Refuses the command `panelprep archive`.
///
/// # Errors
/// Always.
pub fn run(_args: &Archive) -> Result<Outcome, Fault> {
    Err(SetupFault::BuiltWithoutPlant { what: "panelprep archive".to_owned() }.into())
}

/// Refuses the command `panelprep fleet`.
///
/// # Errors
/// Always.
pub fn run_fleet(_args: &Fleet) -> Result<Outcome, Fault> {
    Err(SetupFault::BuiltWithoutPlant { what: "panelprep fleet".to_owned() }.into())
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
        let words = SetupFault::missing_plant(&cell).expect("refused").to_string();
        assert!(words.starts_with("[office], [opcua] listen: ") && words.contains("--features plant"), "{words}");
        let without = Cell::check("cell.toml", "").expect("good");
        assert!(SetupFault::missing_plant(&without).is_none());
    }
}
