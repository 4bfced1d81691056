//! Stores the signature of a page of which each row was proven.

use super::super::args::Prove;
use super::super::disk;
use super::super::fault::{DeviceFault, Fault};
use super::super::load::CellFiles;
use super::super::outcome::Outcome;
use panelprep_base::verdict::Judgement;
use panelprep_cell::cell::ProofStage;
use panelprep_cell::files::content_hash;
use panelprep_service::daemon::current_user;
use panelprep_store::store::{ProofsPage, Store};
use serde_json::json;

/// Stores that a person signed the page: with the stage, the person, the date and the checksum of the programs.
///
/// # Errors
/// If the stage before it is not signed, the page is not the newest one of which each row was proven, the cell was
/// accepted with other programs, or the store cannot be read or written.
pub(super) fn run(args: &Prove, files: &CellFiles) -> Result<Outcome, Fault> {
    let robot = files.cell.robot();
    let stage = args.stage.unwrap_or_else(|| ProofStage::after(robot.signed_stage()));
    if let Some(before) = stage.before().filter(|before| robot.signed_stage() < Some(*before)) {
        return Err(DeviceFault::ProvenTooEarly { stage, before }.into());
    }
    let page_sha256 = content_hash(&disk::read(&args.out)?);
    let newest = files.store()?.newest_proofs(|page| !page.is_signed && page.stage == stage);
    let Some(proven) = newest.map_err(Fault::stage)?.filter(|page| page.page_sha256 == page_sha256) else {
        return Err(DeviceFault::PageNotProven { page: args.out.clone(), stage }.into());
    };
    let (reported, accepted) = (proven.programs_sum, robot.programs_sum());
    if accepted != Some(reported) {
        return Err(DeviceFault::ProofsOfOtherPrograms { reported, accepted }.into());
    }
    let signature = ProofsPage { by: args.by.clone(), is_signed: true, ..proven };
    Store::store_proofs_in(files.store_folder(), &signature, current_user()).map_err(Fault::stage)?;
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    let letter = stage.letter();
    outcome.add_line(format!(
        "the signature of stage {letter} by {} is stored, for programs with the checksum {reported}; now set signed_stage = \
         \"{letter}\" in [robot] of the cell's file",
        args.by
    ));
    outcome.add_value("stage", json!(letter));
    outcome.add_value("programs_sum", json!(reported));
    outcome.add_value("page", json!(args.out.display().to_string()));
    Ok(outcome)
}
