//! `panelprep calibrate removal`: the removal by the disc, from measured depths on test coupons.

use super::super::disk;
use super::super::fault::Fault;
use super::super::outcome::Outcome;
use super::args::Removal as Args;
use super::date;
use super::output::{provenance, write_calibration};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::RemovalCalibration;
use panelprep_cell::files::content_hash;
use panelprep_toolpath::removal::coupons::{Coupon, CouponTool};
use panelprep_toolpath::removal::fit::{CouponFit, fit};
use panelprep_toolpath::removal::gate;
use panelprep_toolpath::removal::model::MM2_PER_M2;
use panelprep_toolpath::removal::pad::PadWithDisc;
use panelprep_toolpath::removal::power::Power;
use panelprep_toolpath::removal::speed::Orbit;
use panelprep_toolpath::removal::table::read_coupons;
use serde_json::{Value, json};

/// Fits the model, reports how well it predicts left-out coupons, and writes it.
///
/// # Errors
/// If the table has problems, each with its line and column, or writing to the disk fails.
pub fn run(args: &Args) -> Result<Outcome, Fault> {
    let bytes = disk::read(&args.coupons)?;
    let coupons = read_coupons(&bytes).map_err(|error| Fault::file_fault(&args.coupons, error))?;
    let tool = CouponTool {
        pad: PadWithDisc { radius_mm: args.disc_diameter_mm / 2.0, stiffness_n_mm3: args.pad_n_mm3 },
        orbit: Orbit { diameter_mm: args.orbit_mm, speed_rev_min: args.orbit_rev_min },
    };
    let found = match fit(&coupons, &tool) {
        Ok(found) => found,
        Err(error) => return Ok(refused(error.to_string(), args)),
    };
    let checks = gate::checks(&found, &coupons);
    let judgement = Judgement::from_checks(&checks);
    let mut outcome = Outcome::from_judgement(&judgement);
    outcome.add_checks(&checks);
    report_result(&mut outcome, &found, &coupons);
    let left_out = found.left_out_coupons.iter().map(|one| one.map_or(f64::NAN, |one| 100.0 * one.deviation.abs()));
    let residuals = if found.left_out_coupons.iter().all(Option::is_some) { left_out.collect() } else { vec![] };
    let made = provenance(vec![content_hash(&bytes)], residuals);
    let counts = (coupons.len(), found.discs.map_or(0, |discs| discs.count));
    let text = RemovalCalibration::to_text(&numbers(&found, (&coupons, &tool)), counts, (date::today_utc(), &made));
    RemovalCalibration::check(&args.out.display().to_string(), &text)?;
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}

/// Returns the verdict for coupons that determine no model.
fn refused(message: String, args: &Args) -> Outcome {
    let judgement = Judgement::new(vec![Reason::new("no_model", message)], vec![]);
    let mut outcome = Outcome::from_judgement(&judgement);
    outcome.add_value("preston_mm2_per_n", Value::Null);
    outcome.add_line(format!("{}: not written", args.out.display()));
    outcome
}

/// Returns the numbers of the file with their keys.
fn numbers(found: &CouponFit, (coupons, tool): (&[Coupon], &CouponTool)) -> Vec<(&'static str, f64)> {
    let force_n =
        |of: fn(f64, f64) -> f64| coupons.iter().map(|coupon| coupon.force_n).reduce(of).unwrap_or(f64::NAN);
    let [k, b] = [0, 1].map(|index| found.covariance[(index, index)].sqrt());
    let correlation = if k * b > 0.0 { found.covariance[(0, 1)] / (k * b) } else { 0.0 };
    let law = found.powers.force.map_or_else(Vec::new, |power| {
        vec![("force_power", power.value), ("force_power_uncertainty", power.uncertainty)]
    });
    let discs = found.discs.map(|discs| ("disc_deviation_percent", 100.0 * discs.deviation));
    let always = [
        ("preston_mm2_per_n", found.preston_mm2_per_n),
        ("preston_deviation_percent", 100.0 * k),
        ("wear_per_m2", found.decay_per_mm2 * MM2_PER_M2),
        ("wear_deviation_per_m2", b * MM2_PER_M2),
        ("correlation", correlation.clamp(-1.0, 1.0)),
        ("coupon_deviation_percent", 100.0 * found.coupon_deviation),
        ("left_out_percent", 100.0 * found.cross_validation_rms()),
        ("least_force_n", force_n(f64::min)),
        ("most_force_n", force_n(f64::max)),
        ("pad_n_mm3", tool.pad.stiffness_n_mm3),
        ("orbit_mm", tool.orbit.diameter_mm),
        ("orbit_rev_min", tool.orbit.speed_rev_min),
    ];
    always.into_iter().chain(law).chain(discs).collect()
}

fn describe_power(power: Option<Power>) -> String {
    power.map_or("(unknown)".to_owned(), |power| {
        format!("{} ± {}", fixed_decimals(power.value, 2), fixed_decimals(power.uncertainty, 2))
    })
}

fn report_result(outcome: &mut Outcome, found: &CouponFit, coupons: &[Coupon]) {
    let known_percent = 100.0 * found.preston_share_95(0.0);
    let [wear, wear_95] = [found.decay_per_mm2, found.decay_95_per_mm2()].map(|per_mm2| per_mm2 * MM2_PER_M2);
    outcome.add_value("preston_mm2_per_n", json!(found.preston_mm2_per_n));
    outcome.add_value("preston_uncertainty_percent", json!(known_percent));
    outcome.add_value("wear_per_m2", json!(wear));
    outcome.add_value("wear_uncertainty_per_m2", json!(wear_95));
    outcome.add_value("coupon_deviation_percent", json!(100.0 * found.coupon_deviation));
    outcome.add_value("left_out_percent", json!(100.0 * found.cross_validation_rms()));
    let power = |power: Power| json!({"value": power.value, "uncertainty": power.uncertainty});
    outcome.add_value("power", power(found.power));
    outcome.add_value("force_power", json!(found.powers.force.map(power)));
    outcome.add_value("passes_power", json!(found.powers.passes.map(power)));
    outcome.add_value("discs", json!(found.discs.map(|discs| discs.count)));
    outcome.add_value("disc_deviation_percent", json!(found.discs.map(|discs| 100.0 * discs.deviation)));
    outcome.add_line(format!(
        "Preston's coefficient k of a new disc: {:.3e} mm²/N ± {} % (95 %)",
        found.preston_mm2_per_n,
        fixed_decimals(known_percent, 1)
    ));
    outcome.add_line(format!(
        "wear: ln k falls by {} ± {} for each square metre that the disc has swept",
        fixed_decimals(wear, 2),
        fixed_decimals(wear_95, 2)
    ));
    outcome.add_line(format!(
        "{} measured places, {} % rms from the model; places that were left out of the fit: {} % rms from the prediction",
        coupons.len(),
        fixed_decimals(100.0 * found.coupon_deviation, 1),
        fixed_decimals(100.0 * found.cross_validation_rms(), 1)
    ));
    outcome.add_line(match found.discs {
        Some(discs) => {
            format!("{} discs, which differ by {} % (σ)", discs.count, fixed_decimals(100.0 * discs.deviation, 1))
        }
        None => "the scatter from disc to disc is not known".to_owned(),
    });
    outcome.add_line(format!(
        "exponents of the depth: {} for the force, {} for the number of passes",
        describe_power(found.powers.force),
        describe_power(found.powers.passes)
    ));
    outcome.add_line("coupon            line   measured µm     predicted µm   off %".to_owned());
    let mut rows = Vec::with_capacity(coupons.len());
    for (coupon, one) in coupons.iter().zip(&found.left_out_coupons) {
        let foretold = one.map(|one| (one.foretold_um, 100.0 * one.deviation, one.is_outlier));
        let (by_others, off, mark) =
            foretold.map_or(("none".to_owned(), "–".to_owned(), ""), |(um, off, is_out)| {
                (
                    fixed_decimals(um, 1).to_string(),
                    fixed_decimals(off, 1).to_string(),
                    if is_out { "   outlier" } else { "" },
                )
            });
        outcome.add_line(format!(
            "{:16}  {:4}   {:11}   {by_others:>16}   {off:>5}{mark}",
            coupon.name,
            coupon.line,
            fixed_decimals(coupon.depth_um, 1)
        ));
        rows.push(json!({
            "coupon": coupon.name, "line": coupon.line, "depth_um": coupon.depth_um,
            "foretold_um": one.map(|one| one.foretold_um), "interval_um": one.map(|one| one.interval_um),
            "off_percent": one.map(|one| 100.0 * one.deviation), "outlier": one.map(|one| one.is_outlier),
        }));
    }
    outcome.add_value("coupons", json!(rows));
}
