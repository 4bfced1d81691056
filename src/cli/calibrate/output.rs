//! Writes a calibration with its evidence.

use super::super::disk;
use super::super::fault::Fault;
use super::super::outcome::Outcome;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cell::Provenance;
use std::path::Path;

pub(super) fn provenance(pictures: Vec<String>, residuals: Vec<f64>) -> Provenance {
    let program = Some(concat!("panelprep ", env!("CARGO_PKG_VERSION")).to_owned());
    Provenance { program, pictures, residuals }
}

/// Writes a calibration unless it was rejected, and reports this.
pub(super) fn write_calibration(
    outcome: &mut Outcome,
    judgement: &Judgement,
    file: &Path,
    text: &str,
) -> Result<(), Fault> {
    if judgement.verdict == Verdict::Reject {
        outcome.add_line(format!("{}: not written", file.display()));
        return Ok(());
    }
    disk::write_durable(file, text)?;
    outcome.add_line(format!("{}: written", file.display()));
    Ok(())
}
