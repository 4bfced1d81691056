//! The results of a calibration: its file with date and evidence, and the verifications in the store.
//!
//! A verification is judged and stored. `panelprep calibrate history` lists the verifications by pictures and touches,
//! and `strike` marks a verification as no longer valid.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use super::super::output::Outcome;
use super::args::StrikeOut;
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cell::{Date, Provenance};
use panelprep_service::report;
use panelprep_service::setup::{CellFiles, clock::now_unix_s};
use panelprep_store::store::Store;
use panelprep_vision::calib::health::{self, Strike, TOOL_FORCE, Verification, VerificationLimits};
use serde_json::{Value, json};
use std::path::Path;

/// Returns today's date in UTC.
pub fn today_utc() -> Option<Date> {
    Some(Date::from_unix_s(now_unix_s()))
}

pub(super) fn provenance(pictures: Vec<String>, residuals: Vec<f64>) -> Provenance {
    let program = Some(concat!("panelprep ", env!("CARGO_PKG_VERSION")).to_owned());
    Provenance { program, pictures, residuals }
}

/// Writes a calibration unless it was rejected, and reports whether it was written.
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

/// Creates a verification with the current time.
pub fn verification(files: &CellFiles, subject: &str, error_mm: f64, calibration_hash: String) -> Verification {
    Verification {
        subject: subject.to_owned(),
        error: error_mm,
        limit: files.cell.limits().verify_limit_mm(),
        calibration_hash,
        at_unix_s: now_unix_s(),
        struck: None,
    }
}

/// Stores a verification, judges it, and draws the trend of all verifications.
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

/// Lists the verifications in the store.
///
/// # Errors
/// If there is no store, or it cannot be read.
pub fn run_history(common: &Common) -> Result<Outcome, Fault> {
    let all = CellFiles::read(&common.paths())?.store()?.verification_history().map_err(Fault::stage)?;
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    if all.is_empty() {
        outcome.add_line("the store contains no verification yet");
    }
    all.iter().for_each(|(number, verification)| outcome.add_line(line(*number, verification)));
    let rows: Vec<Value> = all.iter().map(|(number, verification)| row(*number, verification)).collect();
    outcome.add_value("verifications", json!(rows));
    Ok(outcome)
}

/// Strikes out a verification.
///
/// # Errors
/// If there is no store, or the verification does not exist or is already struck out.
pub fn strike_out(args: &StrikeOut, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let strike = Strike { by: args.by.clone(), why: args.why.clone(), at_unix_s: now_unix_s() };
    let struck = Store::strike_out_in(files.store_folder(), args.number, &strike);
    let (_, verification) = struck.map_err(Fault::stage)?;
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    outcome.add_line(line(args.number, &verification));
    let again = match verification.subject.as_str() {
        "tool" => "calibrate touch",
        TOOL_FORCE => "calibrate force --verify",
        _ => "calibrate verify",
    };
    outcome.add_line(format!(
        "the verification stays in the store but is no longer valid; run `panelprep {again}` again"
    ));
    outcome.add_value("verification", row(args.number, &verification));
    Ok(outcome)
}

fn line(number: i64, verification: &Verification) -> String {
    let Verification { subject, error, limit, at_unix_s, .. } = verification;
    let day = Date::from_unix_s(*at_unix_s);
    let struck = verification.struck.as_ref().map(|Strike { by, why, at_unix_s }| {
        format!("; struck out on {} by {by}: {why}", Date::from_unix_s(*at_unix_s))
    });
    let struck = struck.unwrap_or_default();
    let [off, limit] = distinguishable_texts(*error, *limit, 3);
    let unit = health::unit(subject);
    format!("{number:5}  {day}  {subject:13}  deviation {off} {unit} (limit {limit} {unit}){struck}")
}

fn row(number: i64, verification: &Verification) -> Value {
    let struck = verification.struck.as_ref();
    let struck = struck.map(|it| json!({"by": it.by, "why": it.why, "at_unix_s": it.at_unix_s}));
    json!({
        "number": number, "subject": verification.subject, "error_mm": verification.error,
        "limit_mm": verification.limit, "unit": health::unit(&verification.subject), "at_unix_s": verification.at_unix_s, "struck": struck,
    })
}
