//! Judges a verification and stores it.

use super::super::disk;
use super::super::fault::Fault;
use super::super::load::CellFiles;
use super::super::outcome::Outcome;
use super::date;
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::Judgement;
use panelprep_service::report::{self};
use panelprep_store::store::Store;
use panelprep_vision::calib::health::{self, Verification, VerificationLimits};
use serde_json::json;
use std::path::Path;

/// Creates a verification with the present time.
pub fn verification(files: &CellFiles, subject: &str, error_mm: f64, calibration_hash: String) -> Verification {
    Verification {
        subject: subject.to_owned(),
        error: error_mm,
        limit: files.cell.limits().verify_limit_mm(),
        calibration_hash,
        at_unix_s: date::now_unix_s(),
        struck: None,
    }
}

/// Stores a verification, judges it, and draws the trend.
pub fn store_and_judge(
    files: &CellFiles,
    verification: &Verification,
    pictures: Option<&Path>,
) -> Result<Outcome, Fault> {
    let (store, number) = Store::store_verification_in(files.store_folder(), verification).map_err(Fault::stage)?;
    let (error_mm, limit_mm) = (verification.error, verification.limit);
    let reject = health::exceeded_limit_reason(verification, VerificationLimits::from_limits(files.cell.limits()));
    let mut outcome = Outcome::from_judgement(&Judgement::new(reject.into_iter().collect(), vec![]));
    outcome.add_value("error_mm", json!(error_mm));
    outcome.add_value("limit_mm", json!(limit_mm));
    outcome.add_value("number", json!(number));
    let [off, allowed] = distinguishable_texts(error_mm, limit_mm, 3);
    outcome.add_line(format!(
        "{}: deviation {off} mm (limit {allowed} mm); stored as verification number {number}",
        verification.subject
    ));
    if let Some(folder) = pictures {
        let all = store.verifications(&verification.subject).map_err(Fault::stage)?;
        let file = folder.join(format!("trend_{}.svg", verification.subject));
        disk::write(&file, report::trend(&verification.subject, &all))?;
        outcome.add_line(format!("{}: the trend", file.display()));
    }
    Ok(outcome)
}
