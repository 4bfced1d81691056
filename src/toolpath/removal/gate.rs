//! The acceptance checks of a removal model: it is accepted, needs a person's review, or is rejected.

use super::coupons::Coupon;
use super::fit::CouponFit;
use super::model::{MIN_DISCS, MM2_PER_M2, UNKNOWN_DISC_DEVIATION};
use super::power::Power;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource};

/// Two upper limits: above the first a person must review the model, above the second it is rejected.
type Bounds = [f64; 2];

/// Limits of the 95 % uncertainty of k, percent, at the swept area of a coupon's disc at which k is least certain.
const UNCERTAINTY_LIMITS_PERCENT: Bounds = [12.0, 40.0];
/// Limits of the scatter σ of a coupon, percent.
const COUPON_SCATTER_LIMITS_PERCENT: Bounds = [10.0, 30.0];
/// Limits of the rms deviation of the coupons from their predictions in the cross-validation, percent.
const CROSS_VALIDATION_LIMITS_PERCENT: Bounds = [12.0, 40.0];
/// Limits of the scatter σ of ln k from disc to disc, percent.
const DISC_SCATTER_LIMITS_PERCENT: Bounds = [100.0 * UNKNOWN_DISC_DEVIATION, 30.0];
/// Minimum number of coupons at which no review is needed.
const MIN_MEASURED_PLACES: f64 = 8.0;

/// Returns all acceptance checks of a removal model.
pub fn checks(found: &CouponFit, coupons: &[Coupon]) -> Vec<Check> {
    let known = |coupon: &Coupon| 100.0 * found.relative_preston_error_95(coupon.worn_mm2);
    // The largest uncertainty over the swept areas of all coupons is used, because discs will be used up to this wear,
    // and because k is least certain at the ends of the fitted line.
    let known_percent = coupons.iter().map(known).fold(0.0, f64::max);
    vec![
        check_coupon_count(coupons.len()),
        bounded_check(
            "k_uncertain",
            ("uncertainty of k, 95 %, at the worst wear measured", known_percent),
            UNCERTAINTY_LIMITS_PERCENT,
            "uncertainty of k (95 %), percent",
        ),
        bounded_check(
            "coupons_differ",
            ("a coupon differs from the model, σ", 100.0 * found.coupon_deviation),
            COUPON_SCATTER_LIMITS_PERCENT,
            "deviation of the coupons from the model, percent",
        ),
        bounded_check(
            "left_out",
            ("left-out coupons, rms", 100.0 * found.cross_validation_rms()),
            CROSS_VALIDATION_LIMITS_PERCENT,
            "deviation of the left-out coupons from their prediction by the others, percent",
        ),
        check_disc_scatter(found),
        check_disc_deviation(found),
        check_outliers(found, coupons),
        check_exponent(
            ("power by which the depth goes with the load", "force times sliding distance"),
            "not_preston",
            found.power,
        ),
        check_optional_exponent(
            ("power by which the depth goes with the force", "the force"),
            "force_power",
            found.powers.force,
        ),
        check_optional_exponent(
            ("power by which the depth goes with the passes", "the passes"),
            "passes_power",
            found.powers.passes,
        ),
        check_wear(found),
    ]
}

/// Creates a check with two upper limits: above the first a person must review the model, above the second it is
/// rejected.
fn bounded_check(
    code: &'static str,
    (name, percent): (&'static str, f64),
    [review, reject]: Bounds,
    words: &str,
) -> Check {
    let is_refused = percent.is_nan() || percent > reject;
    let limit = if is_refused { reject } else { review };
    let check = Check::new(name, "%", percent).with_max(limit, LimitSource::Program);
    let message = || {
        let [found, allowed] = distinguishable_texts(percent, limit, 1);
        format!("{words}: {found} (limit {allowed}); measure more coupons, or look for differences between them")
    };
    if is_refused { check.or_reject(code, message) } else { check.or_review(code, message) }
}

fn check_coupon_count(count: usize) -> Check {
    Check::new("measured places", "", count as f64).with_min(MIN_MEASURED_PLACES, LimitSource::Program).or_review(
        "few_coupons",
        || {
            format!(
                "only {count} points were measured; measure {MIN_MEASURED_PLACES} \
            or more"
            )
        },
    )
}

fn check_outliers(found: &CouponFit, coupons: &[Coupon]) -> Check {
    let named =
        found.left_out_coupons.iter().zip(coupons).filter_map(|(one, coupon)| Some((one.as_ref()?, coupon)));
    let out: Vec<String> = named
        .filter(|(one, _)| one.is_outlier)
        .map(|(one, coupon)| {
            let [low, high] = one.interval_um.map(|um| fixed_decimals(um, 1));
            format!(
                "{} (line {}): {} µm, but the other coupons predict {low} to {high} µm",
                coupon.name,
                coupon.line,
                fixed_decimals(coupon.depth_um, 1)
            )
        })
        .collect();
    Check::new("coupons that the others contradict", "", out.len() as f64)
        .with_max(0.0, LimitSource::Program)
        .or_review("outliers", || {
            format!("{}; measure these coupons again, or remove a line if you know what was wrong", out.join("; "))
        })
}

/// Checks whether the scatter from disc to disc is known, because the model is also used for discs that sanded no
/// coupon.
fn check_disc_scatter(found: &CouponFit) -> Check {
    let count = found.discs.map_or(0, |discs| discs.count);
    Check::new("discs whose scatter is known", "", count as f64)
        .with_min(MIN_DISCS as f64, LimitSource::Program)
        .or_review("few_discs", || match count {
            0 => format!(
                "the scatter from disc to disc is not known: name the disc of each coupon in the column disc, and use \
                 {MIN_DISCS} discs or more, each for two coupons or more"
            ),
            _ => format!("the coupons were treated by {count} discs (at least {MIN_DISCS} are needed); measure \
                          coupons of more discs"),
        })
}

/// Checks the scatter from disc to disc; the value is missing if no disc sanded two coupons.
fn check_disc_deviation(found: &CouponFit) -> Check {
    const NAME: &str = "the discs differ, σ";
    found.discs.map_or_else(
        || Check::new(NAME, "%", None),
        |discs| {
            let words = "discs differ from each other by percent";
            bounded_check("discs_differ", (NAME, 100.0 * discs.deviation), DISC_SCATTER_LIMITS_PERCENT, words)
        },
    )
}

/// Checks an exponent; without a value if the coupons do not determine it.
fn check_optional_exponent(words: (&'static str, &str), code: &'static str, found: Option<Power>) -> Check {
    found.map_or_else(|| Check::new(words.0, "", None), |found| check_exponent(words, code, found))
}

fn check_exponent((name, what): (&'static str, &str), code: &'static str, found: Power) -> Check {
    Check::new(name, "", found.value).with_consequence_if(
        found.contradicts_preston(),
        panelprep_base::verdict::Severity::Review,
        code,
        || {
            format!(
                "the depth is proportional to {what} to the power of {} ± {} (1 by Preston's law); use the model \
                 only near the loads of the coupons",
                fixed_decimals(found.value, 2),
                fixed_decimals(found.uncertainty, 2)
            )
        },
    )
}

fn check_wear(found: &CouponFit) -> Check {
    let [per_m2, known_m2] = [found.decay_per_mm2, found.decay_95_per_mm2()].map(|per_mm2| per_mm2 * MM2_PER_M2);
    Check::new("decay of k by what the disc swept", "1/m²", per_m2).with_consequence_if(
        // A person must review the model, but it is not rejected: within the measured wear the model is valid; beyond
        // it, the model assumes a wear that was not measured.
        per_m2 < known_m2,
        panelprep_base::verdict::Severity::Review,
        "wear_not_told",
        || {
            format!(
                "the disc's wear, {} ± {} per square metre, cannot be distinguished from zero; measure coupons \
                 with discs nearer to the end of their life",
                fixed_decimals(per_m2, 2),
                fixed_decimals(known_m2, 2)
            )
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::coupons::tests::TOOL;
    use super::super::fit::{fit, tests::coupons};
    use super::*;
    use panelprep_base::verdict::{Judgement, Verdict};

    fn judged(off: &[f64]) -> (Verdict, Vec<String>) {
        let made = assign_to_discs(coupons(off));
        let judgement = Judgement::from_checks(&checks(&fit(&made, &TOOL).expect("a model"), &made));
        (judgement.verdict, judgement.reasons.into_iter().map(|reason| reason.code.into_owned()).collect())
    }

    /// Distributes the coupons over four discs, so that each disc has coupons of different wear.
    fn assign_to_discs(mut made: Vec<Coupon>) -> Vec<Coupon> {
        made.iter_mut().enumerate().for_each(|(index, own)| own.disc = Some(format!("D{}", index % 4)));
        made
    }

    const GOOD: [f64; 12] = [0.02, -0.01, 0.0, 0.01, -0.02, 0.015, 0.0, -0.015, 0.01, 0.0, -0.01, 0.005];

    #[test]
    fn good_coupons_are_accepted_and_doubtful_ones_need_a_review() {
        assert_eq!(judged(&GOOD), (Verdict::Accept, vec![]));
        assert_eq!(judged(&GOOD[..7]), (Verdict::Review, vec!["few_coupons".to_owned()]));
        let mut one_off = GOOD;
        one_off[4] = 0.4;
        let (verdict, codes) = judged(&one_off);
        assert!(verdict == Verdict::Review && codes.contains(&"outliers".to_owned()), "{codes:?}");
        let (verdict, codes) = judged(&GOOD.map(|off| 30.0 * off));
        assert!(verdict == Verdict::Reject && codes.contains(&"coupons_differ".to_owned()), "{codes:?}");
    }

    #[test]
    fn an_outlier_is_reported_by_name_and_line() {
        let mut one_off = GOOD;
        one_off[4] = 0.4;
        let made = coupons(&one_off);
        let all = checks(&fit(&made, &TOOL).expect("a model"), &made);
        let words =
            all.iter().find_map(|check| check.message.clone().filter(|words| words.contains("A4 (line 6)")));
        assert!(words.is_some(), "{all:?}");
    }

    /// Without the disc column, with one disc and with two discs, the scatter from disc to disc is not known.
    #[test]
    fn unknown_discs_need_a_review() {
        let codes = |discs: usize| -> Vec<String> {
            let mut made = coupons(&GOOD);
            if discs > 0 {
                made.iter_mut().enumerate().for_each(|(index, own)| own.disc = Some(format!("D{}", index % discs)));
            }
            let all = checks(&fit(&made, &TOOL).expect("a model"), &made);
            Judgement::from_checks(&all).reasons.into_iter().map(|reason| reason.code.into_owned()).collect()
        };
        assert_eq!([0, 1, 2].map(codes), [["few_discs"]; 3].map(|codes| codes.map(str::to_owned).to_vec()));
        assert_eq!(codes(3), Vec::<String>::new());
    }

    #[test]
    fn a_depth_not_proportional_to_the_force_needs_a_review() {
        let mut made = assign_to_discs(coupons(&GOOD));
        for (index, own) in made.iter_mut().enumerate() {
            own.force_n = [10.0, 20.0][index / 4 % 2];
            own.depth_um *= (own.force_n / 20.0).sqrt();
        }
        let all = checks(&fit(&made, &TOOL).expect("a model"), &made);
        let codes: Vec<String> =
            Judgement::from_checks(&all).reasons.into_iter().map(|reason| reason.code.into_owned()).collect();
        assert!(codes.contains(&"force_power".to_owned()), "{codes:?}");
    }
}
