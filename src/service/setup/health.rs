//! Whether a cycle may start with the cell's calibrations, by their last verifications in the store.

use super::cell_files::CellFiles;
use super::clock::now_unix_s;
use super::fault::SetupFault;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::CompliantTool;
use panelprep_store::store::calibration_hash;
use panelprep_vision::calib::force::verification_limits;
use panelprep_vision::calib::health::{
    CameraHealth, TOOL_FORCE, VerificationLimits, expiry_warning, health, judge_start,
};

/// Returns the verifications of the cameras that expire soon.
///
/// # Errors
/// If there is no store.
pub fn expiring_verifications(files: &CellFiles) -> Result<Vec<Reason>, SetupFault> {
    let (store, demands) = (files.store()?, VerificationLimits::from_limits(files.cell.limits()));
    let mut ending = Vec::new();
    for subject in ["scanner", "flange_camera"] {
        let last = store.newest_verification(subject).map_err(SetupFault::stage)?;
        ending.extend(last.and_then(|last| expiry_warning(&last, now_unix_s(), demands)));
    }
    Ok(ending)
}

/// Reads what [`judge_start`] needs and judges it.
///
/// # Errors
/// If a calibration cannot be read, or there is no store.
pub fn judge_health(files: &CellFiles) -> Result<Judgement, SetupFault> {
    let store = files.store()?;
    let last = |subject: &str| store.newest_verification(subject).map_err(SetupFault::stage);
    let scanner = calibration_hash(&[&files.scanner()?.text, &files.base_from_camera()?.text]);
    let flange = files.hash_with_arm(&[&files.flange_camera()?.text, &files.flange_from_camera()?.text]);
    let (last_scanner, last_flange) = (last("scanner")?, last("flange_camera")?);
    let cameras = [
        CameraHealth { subject: "scanner", last: last_scanner.as_ref(), calibration_hash: &scanner },
        CameraHealth { subject: "flange_camera", last: last_flange.as_ref(), calibration_hash: &flange },
    ];
    let touch = files.last_touch_check(&files.flange_from_tool()?.text);
    let start =
        judge_start(&cameras, touch.as_ref(), now_unix_s(), VerificationLimits::from_limits(files.cell.limits()));
    // A simulated tool has exactly its stated values and needs no verification.
    let tool = files.cell.tool().compliant().filter(|tool| tool.address.is_some());
    let Some(tool) = tool else { return Ok(start) };
    let last_force = last(TOOL_FORCE)?;
    let of_force = health(
        TOOL_FORCE,
        last_force.as_ref(),
        &force_hash(tool),
        now_unix_s(),
        verification_limits(files.cell.limits(), tool),
    );
    Ok(start.combined_with(of_force))
}

/// Returns the hash of the values that a verification of the force checks: payload and zero from the cell's file.
pub fn force_hash(tool: &CompliantTool) -> String {
    calibration_hash(&[&format!("payload_kg {} zero_n {}", tool.payload_kg, tool.zero_n)])
}
