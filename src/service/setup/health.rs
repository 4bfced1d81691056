//! Whether a cycle may start with the cell's calibrations, by their last verifications in the store; and the equipment
//! with the age of its calibrations, for people.

use super::cell_files::{CellFiles, last_touch_check};
use super::clock::now_unix_s;
use super::fault::SetupFault;
use panelprep_base::number_text::{fixed_decimals, utc_day};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::{Cell, CompliantTool};
use panelprep_store::store::{Store, calibration_hash};
use panelprep_vision::calib::force::verification_limits;
use panelprep_vision::calib::health::{
    CameraHealth, TOOL_FORCE, VerificationLimits, expiry_warning, health, judge_start,
};

const DAY_S: i64 = 86_400;

/// Returns the verifications of the cameras and of the tool's force that expire soon.
///
/// # Errors
/// If there is no store.
pub fn expiring_verifications(files: &CellFiles) -> Result<Vec<Reason>, SetupFault> {
    let (store, demands) = (files.store()?, VerificationLimits::from_limits(files.cell.limits()));
    let mut ending = Vec::new();
    let force = force_verification(&files.cell).map(|_| TOOL_FORCE);
    for subject in ["scanner", "flange_camera"].into_iter().chain(force) {
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
    let touch = last_touch_check(&store, &files.hash_with_arm(&[&files.flange_from_tool()?.text]));
    let touch = touch.map_err(SetupFault::stage)?;
    let start =
        judge_start(&cameras, touch.as_ref(), now_unix_s(), VerificationLimits::from_limits(files.cell.limits()));
    let Some((hash, demands)) = force_verification(&files.cell) else { return Ok(start) };
    let of_force = health(TOOL_FORCE, last(TOOL_FORCE)?.as_ref(), &hash, now_unix_s(), demands);
    Ok(start.combined_with(of_force))
}

/// Returns the hash and the limits that the verification of the tool's force must have; `None` if the cell needs none: a
/// spring has no force control, and a simulated tool has exactly its stated values.
pub fn force_verification(cell: &Cell) -> Option<(String, VerificationLimits)> {
    let tool = cell.tool().compliant().filter(|tool| tool.address.is_some())?;
    Some((force_hash(tool), verification_limits(cell.limits(), tool)))
}

/// Returns the hash of the values that a verification of the force checks: payload and zero from the cell's file.
pub fn force_hash(tool: &CompliantTool) -> String {
    calibration_hash(&[&format!("payload_kg {} zero_n {}", tool.payload_kg, tool.zero_n)])
}

/// A camera, the tool or another item with a dated calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equipment {
    /// Name of the equipment.
    pub name: String,
    /// The calibration of the equipment and when it was made, as text.
    pub calibration: String,
    /// The last verification of the equipment, as text.
    pub verification: String,
}

/// The equipment of a cell, and whether a cycle may start with it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EquipmentList {
    /// The verdict over all verifications.
    pub verdict: Verdict,
    /// The reasons of the verdict, as text.
    pub reasons: Vec<String>,
    /// The equipment.
    pub items: Vec<Equipment>,
}

impl CellFiles {
    /// Returns the equipment, and whether a cycle may start with it.
    ///
    /// # Errors
    /// If a file cannot be read; the error is a text for people.
    pub fn list_equipment(&self) -> Result<EquipmentList, String> {
        let judged = judge_health(self).map_err(|fault| fault.to_string())?;
        let reasons = judged.reasons.iter().map(|reason| format!("{} ({})", reason.message, reason.code)).collect();
        let store = self.store().map_err(|fault| fault.to_string())?;
        let named = self.cell.calibration().named_files();
        let items = named.into_iter().map(|(name, file)| {
            let made = std::fs::metadata(file).and_then(|found| found.modified()).ok();
            let made_s =
                made.and_then(|at| at.duration_since(std::time::UNIX_EPOCH).ok()).map(|at| at.as_secs() as i64);
            let calibration = match made_s {
                Some(at_s) => format!("{}, file of {}", file.display(), describe_age(at_s)),
                None => format!("{}: is missing", file.display()),
            };
            Equipment { name: name.replace('_', " "), calibration, verification: verification(&store, name) }
        });
        Ok(EquipmentList { verdict: judged.verdict, reasons, items: items.collect() })
    }
}

fn describe_age(at_unix_s: i64) -> String {
    let days = (now_unix_s() - at_unix_s).div_euclid(DAY_S);
    format!("{}, {days} days ago", utc_day(at_unix_s))
}

/// Describes the last verification of a calibration; only both cameras and the tool are verified.
fn verification(store: &Store, calibration: &str) -> String {
    let subject = match calibration {
        "scanner" | "flange_camera" => calibration,
        "base_from_camera" => "scanner",
        "flange_from_camera" => "flange_camera",
        "flange_from_tool" => "tool",
        _ => return "–".to_owned(),
    };
    match store.newest_verification(subject) {
        Ok(Some(last)) => {
            let [error, limit] = [last.error, last.limit].map(|mm| fixed_decimals(mm, 3));
            format!("{error} mm (limit {limit} mm), {}", describe_age(last.at_unix_s))
        }
        Ok(None) => "never".to_owned(),
        Err(error) => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::testing::write_cell;
    use panelprep_vision::calib::health::Verification;

    /// A start needs a verification of the force that is not older than a day, so its end is announced as well.
    #[test]
    fn a_verification_of_the_force_that_expires_soon_is_reported() {
        let folder = tempfile::tempdir().expect("a folder");
        let tool = "[limits]\nverify_max_age_h = 24\n[tool]\nkind = 'acf'\nhost = '127.0.0.1'\nstroke_mm = 30\n\
                    min_force_n = -60\nmax_force_n = 100\npayload_kg = 1.5\n";
        let files = write_cell(folder.path(), tool, &[]);
        let (calibration_hash, demands) = force_verification(&files.cell).expect("needed");
        let verified = Verification {
            subject: TOOL_FORCE.to_owned(),
            error: 0.1,
            limit: demands.limit,
            calibration_hash,
            at_unix_s: now_unix_s() - 23 * 3_600,
            struck: None,
        };
        Store::store_verification_in(files.store_folder(), &verified).expect("kept");
        let found = expiring_verifications(&files).expect("a store");
        assert!(
            matches!(&found[..], [soon] if soon.message.starts_with("tool_force was verified 23")),
            "{found:?}"
        );
        let spring = write_cell(folder.path(), "", &[]);
        assert_eq!(expiring_verifications(&spring).expect("a store"), []);
    }
}
