//! `panelprep calibrate force`: payload and zero of a compliant tool, and whether they are still valid.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::{CalibrationFault, Fault};
use super::super::load::CellFiles;
use super::super::outcome::Outcome;
use super::args::Force as Args;
use super::{date, files};
use panelprep_base::geometry::{Base, Flange, Rigid, STANDARD_GRAVITY_M_S2, Tool};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Check, Judgement, LimitSource};
use panelprep_cell::cell::CompliantTool;
use panelprep_cell::force::{SensorLoad, down_cosine};
use panelprep_store::store::{Store, calibration_hash};
use panelprep_vision::calib::force::{AttitudeReading, ForceCalibration, calibrate};
use panelprep_vision::calib::health::{self, TOOL_FORCE, Verification, VerificationLimits};
use serde_json::json;
use std::path::Path;

/// Maximum error of a reading without contact, as a share of the tool's band.
const MAX_BAND_ERROR_SHARE: f64 = 0.5;

/// Determines payload and zero, or with `--verify` compares them with the cell's file and stores the result.
///
/// # Errors
/// If the readings file has problems or gives no result, the tool's axis is not known, or with `--verify` the cell has
/// no compliant tool.
pub fn run(args: &Args, common: &Common) -> Result<Outcome, Fault> {
    let text = disk::read_text(&args.readings)?;
    let cell = CellFiles::read(common)?;
    let flange_from_tool = cell.flange_from_tool()?.value;
    let readings = read(&args.readings.display().to_string(), &text, flange_from_tool)?;
    if args.verify { verify(&cell, &readings) } else { measure(&cell, (&args.readings, &readings)) }
}

fn read(name: &str, text: &str, flange_from_tool: Rigid<Flange, Tool>) -> Result<Vec<AttitudeReading>, Fault> {
    let readings = files::force_readings(name, text)?.into_iter();
    let at = |flange: Rigid<Base, Flange>| down_cosine(&(flange * flange_from_tool));
    Ok(readings.map(|(flange, force_n)| AttitudeReading { downwards: at(flange), force_n }).collect())
}

fn measure(files: &CellFiles, (file, readings): (&Path, &[AttitudeReading])) -> Result<Outcome, Fault> {
    let found = calibrate(readings).map_err(|error| Fault::file_fault(file, error))?;
    let SensorLoad { payload_kg, zero_n } = found.weight;
    let known = check_uncertainty(&found, files.cell.tool().compliant());
    let mut outcome = Outcome::from_judgement(&Judgement::from_checks([&known]));
    outcome.add_checks(&[known]);
    outcome.add_value("payload_kg", json!(payload_kg));
    outcome.add_value("payload_95_kg", json!(found.payload_95_kg));
    outcome.add_value("zero_n", json!(zero_n));
    outcome.add_value("zero_95_n", json!(found.zero_95_n));
    outcome.add_value("rms_n", json!(found.rms_n));
    outcome.add_line(format!(
        "payload {payload_kg:.3} ± {:.3} kg, zero {zero_n:.2} ± {:.2} N (95 %)",
        found.payload_95_kg, found.zero_95_n
    ));
    outcome.add_line(format!("{} readings, residuals {:.2} N rms", found.readings, found.rms_n));
    outcome.add_line(format!(
        "write payload_kg = {payload_kg:.3} and zero_n = {zero_n:.2} into [tool] of the cell's file, then verify with --verify"
    ));
    Ok(outcome)
}

/// Compares the uncertainty of the force, from payload and zero, with the limit of a verification.
fn check_uncertainty(found: &ForceCalibration, tool: Option<&CompliantTool>) -> Check {
    let known_n = found.zero_95_n + STANDARD_GRAVITY_M_S2 * found.payload_95_kg;
    let check = Check::new("force by payload and zero, 95 %, at the worst attitude", "N", known_n);
    let Some(tool) = tool else { return check };
    let allowed_n = MAX_BAND_ERROR_SHARE * tool.band_n;
    check.with_max(allowed_n, LimitSource::cell("tool.band_n")).reviews("force_uncertain", || {
        let [found, allowed] = distinguishable_texts(known_n, allowed_n, 1);
        format!(
            "the force has an uncertainty of {found} N (limit {allowed} N); take more readings, at attitudes \
                 that differ more"
        )
    })
}

fn verify(files: &CellFiles, readings: &[AttitudeReading]) -> Result<Outcome, Fault> {
    let tool = files.cell.tool().compliant().ok_or(CalibrationFault::NoCompliantTool)?;
    let weight = SensorLoad::from(tool);
    let off_n = |read: &AttitudeReading| weight.contact_n(read.force_n, read.downwards).abs();
    let error_n = readings.iter().map(off_n).reduce(f64::max).ok_or(CalibrationFault::NoReadings)?;
    let demands = verification_limits(files, tool);
    let verification = Verification {
        subject: TOOL_FORCE.to_owned(),
        error: error_n,
        limit: demands.limit,
        calibration_hash: hash(tool),
        at_unix_s: date::now_unix_s(),
        struck: None,
    };
    let (_, number) = Store::store_verification_in(files.store_folder(), &verification).map_err(Fault::stage)?;
    let reject = health::exceeded_limit_reason(&verification, demands);
    let mut outcome = Outcome::from_judgement(&Judgement::new(reject.into_iter().collect(), vec![]));
    outcome.add_value("error_n", json!(error_n));
    outcome.add_value("limit_n", json!(demands.limit));
    outcome.add_value("number", json!(number));
    let [off, allowed] = distinguishable_texts(error_n, demands.limit, 2);
    outcome.add_line(format!(
        "force without contact: deviation {off} N (limit {allowed} N); stored as verification number {number}"
    ));
    Ok(outcome)
}

/// Returns the limits for the last verification of a tool's force, in N.
pub fn verification_limits(files: &CellFiles, tool: &CompliantTool) -> VerificationLimits {
    VerificationLimits {
        limit: MAX_BAND_ERROR_SHARE * tool.band_n,
        ..VerificationLimits::from_limits(files.cell.limits())
    }
}

/// Returns the hash of the values that a verification of the force checks: payload and zero from the cell's file.
pub fn hash(tool: &CompliantTool) -> String {
    calibration_hash(&[&format!("payload_kg {} zero_n {}", tool.payload_kg, tool.zero_n)])
}

#[cfg(test)]
mod tests {
    use super::super::super::render_boards::FORCE_TEXT;
    use super::*;
    use panelprep_base::geometry::KukaPose;
    use panelprep_cell::cell::Cell;

    /// After `make demo`, a cycle runs on the cell in the repository: its file states the values that the demo
    /// measures for the tool.
    #[test]
    fn the_simulated_cell_states_what_the_demo_measures() {
        let flange_from_tool = KukaPose { z_mm: panelprep_sim::TOOL_LENGTH_MM, ..KukaPose::default() }.to_rigid();
        let readings = read("force.toml", FORCE_TEXT, flange_from_tool).unwrap_or_else(|fault| panic!("{fault}"));
        let found = calibrate(&readings).unwrap_or_else(|error| panic!("{error}")).weight;
        let cell =
            Cell::check("cell.toml", include_str!("../../../config/cell.toml")).unwrap_or_else(|p| panic!("{p}"));
        let stated = cell.tool().compliant().expect("compliant");
        let written = [found.payload_kg, found.zero_n].map(|number| format!("{number:.3}"));
        assert_eq!(written, [stated.payload_kg, stated.zero_n].map(|number| format!("{number:.3}")));
    }
}
