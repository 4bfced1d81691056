//! Reads the last verifications in the store, to decide whether a cycle may start with these calibrations.

use super::calibrate::{now_unix_s, tool};
use super::fault::Fault;
use super::load::CellFiles;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_store::store::calibration_hash;
use panelprep_vision::calib::health::{
    CameraHealth, TOOL_FORCE, VerificationLimits, expiry_warning, health, judge_start,
};

/// The verifications of the cameras that expire soon.
///
/// # Errors
/// If there is no store.
pub fn expiring_verifications(files: &CellFiles) -> Result<Vec<Reason>, Fault> {
    let (store, demands) = (files.store()?, VerificationLimits::from_limits(files.cell.limits()));
    let mut ending = Vec::new();
    for subject in ["scanner", "flange_camera"] {
        let last = store.newest_verification(subject).map_err(Fault::stage)?;
        ending.extend(last.and_then(|last| expiry_warning(&last, now_unix_s(), demands)));
    }
    Ok(ending)
}

/// Reads what [`judge_start`] needs and judges it.
///
/// # Errors
/// If a calibration cannot be read, or there is no store.
pub fn judge(files: &CellFiles) -> Result<Judgement, Fault> {
    let store = files.store()?;
    let last = |subject: &str| store.newest_verification(subject).map_err(Fault::stage);
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
        &tool::force_hash(tool),
        now_unix_s(),
        tool::verification_limits(files, tool),
    );
    Ok(start.combined_with(of_force))
}
