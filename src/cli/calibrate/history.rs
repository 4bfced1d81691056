//! `panelprep calibrate history` and `strike`: the verifications by pictures and touches in the store, and which of
//! them do not count.

use super::super::args::Common;
use super::super::fault::Fault;
use super::super::load::CellFiles;
use super::super::outcome::Outcome;
use super::args::StrikeOut;
use super::date;
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::Judgement;
use panelprep_cell::cell::Date;
use panelprep_store::store::Store;
use panelprep_vision::calib::health::{self, Strike, TOOL_FORCE, Verification};
use serde_json::{Value, json};

/// Lists the verifications.
///
/// # Errors
/// If there is no store, or it cannot be read.
pub fn run(common: &Common) -> Result<Outcome, Fault> {
    let all = CellFiles::read(common)?.store()?.verification_history().map_err(Fault::stage)?;
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    if all.is_empty() {
        outcome.add_line("the store contains no verification yet");
    }
    all.iter().for_each(|(number, verification)| outcome.add_line(line(*number, verification)));
    let rows: Vec<Value> = all.iter().map(|(number, verification)| row(*number, verification)).collect();
    outcome.add_value("verifications", json!(rows));
    Ok(outcome)
}

/// Strikes a verification out.
///
/// # Errors
/// If there is no store, or the verification does not exist or is already struck out.
pub fn strike_out(args: &StrikeOut, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let strike = Strike { by: args.by.clone(), why: args.why.clone(), at_unix_s: date::now_unix_s() };
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
