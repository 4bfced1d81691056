//! Parsers for option values that several commands read in the same way.

use panelprep_cell::cell::ProofStage;

/// Accepts a stage of the list of proofs.
///
/// # Errors
/// If there is no such stage.
pub fn parse_stage(text: &str) -> Result<ProofStage, String> {
    text.parse().map_err(|_| "valid: A, B or C".to_owned())
}

/// Accepts a text from a person, without the blanks around it.
///
/// # Errors
/// If it is empty.
pub fn parse_non_empty(text: &str) -> Result<String, String> {
    match text.trim() {
        "" => Err("must not be empty".to_owned()),
        text => Ok(text.to_owned()),
    }
}
