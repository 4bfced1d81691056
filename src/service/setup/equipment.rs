//! The cell's equipment: the age of each calibration and its last verification, for people.

use super::cell_files::CellFiles;
use super::clock::now_unix_s;
use super::health::judge_health;
use panelprep_base::number_text::{fixed_decimals, utc_day};
use panelprep_base::verdict::Verdict;
use panelprep_store::store::Store;

const DAY_S: i64 = 86_400;

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
