//! The checks of today's form: profile of the surface and flatness, with their uncertainties, against the recipe.

use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{LimitSource, Severity};
use panelprep_cell::panel::TaughtSource;
use panelprep_cell::recipe;
use panelprep_cell::record::{Check, name};
use panelprep_toolpath::surface::{Flatness, Form, Measured};

/// A measured figure of form, as its checks name it.
struct Figure<'a> {
    name: &'static str,
    /// The subject of a sentence.
    subject: String,
    code: &'static str,
    measured: &'a Measured,
    limit_mm: Option<f64>,
    set_by: LimitSource,
}

/// Returns the checks of a form; `None` if today's scan does not show it.
pub(super) fn form_checks(form: Option<&Form>, reference: TaughtSource, limits: &recipe::Surface) -> Vec<Check> {
    let is_limited = limits.max_profile_mm().is_some() || limits.max_flatness_mm().is_some();
    let Some(form) = form else {
        let unknown = Check::new(profile_name(reference), "mm", None);
        return vec![unknown.with_consequence_if(is_limited, Severity::Review, "form_hidden", || {
            "the scan in which the panel was located does not show the region's form, so profile and flatness are not known: \
             remove what hides the region, then locate again"
                .to_owned()
        })];
    };
    let profile = Figure {
        name: profile_name(reference),
        subject: format!("the profile of the surface relative to {}", reference.describe()),
        code: "profile",
        measured: &form.profile,
        limit_mm: limits.max_profile_mm(),
        set_by: LimitSource::recipe("surface.max_profile_mm"),
    };
    let mut checks = vec![
        profile.check(),
        Check::new(name::PROFILE_UNCERTAINTY, "mm", form.profile.uncertainty_mm),
        Check::new(name::PROFILE_FRONT, "mm", form.front.value_mm),
        Check::new(name::PROFILE_BEHIND, "mm", form.behind.value_mm),
    ];
    checks.extend(flatness_checks(form.flatness.as_ref(), limits.max_flatness_mm()));
    checks.push(seen_check(form.seen_percent, is_limited, limits));
    checks
}

/// Returns the name of the profile's check: its reference is part of the name.
fn profile_name(reference: TaughtSource) -> &'static str {
    match reference {
        TaughtSource::Scan => name::PROFILE,
        TaughtSource::Drawing => name::PROFILE_FROM_DRAWING,
    }
}

/// Returns the checks of the flatness: of a flat panel, or if the recipe limits it.
fn flatness_checks(flatness: Option<&Flatness>, limit_mm: Option<f64>) -> Vec<Check> {
    let Some(flat) = flatness else {
        let unknown = Check::new(name::FLATNESS, "mm", None);
        let unknown = unknown.with_consequence_if(limit_mm.is_some(), Severity::Review, "form_hidden", || {
            "the seen part of the region is a line, which determines no flatness: remove what hides the region, then locate again"
                .to_owned()
        });
        return vec![unknown];
    };
    if limit_mm.is_none() && !flat.is_nominal_flat() {
        return vec![];
    }
    let figure = Figure {
        name: name::FLATNESS,
        subject: match flat.is_nominal_flat() {
            true => "the flatness of the region".to_owned(),
            false => format!(
                "the flatness of the region, which is not a flat one (flatness {} mm as taught),",
                fixed_decimals(flat.nominal_mm, 2)
            ),
        },
        code: "flatness",
        measured: &flat.zone,
        limit_mm,
        set_by: LimitSource::recipe("surface.max_flatness_mm"),
    };
    vec![
        figure.check(),
        Check::new(name::FLATNESS_UNCERTAINTY, "mm", flat.zone.uncertainty_mm),
        Check::new("flatness of the region, about the plane of least squares", "mm", flat.least_squares_mm),
    ]
}

/// Checks the share of the region to which the figures apply.
fn seen_check(seen_percent: f64, is_limited: bool, limits: &recipe::Surface) -> Check {
    let least_percent = 100.0 - limits.max_missing_percent();
    let seen = Check::new("region in which the form was measured", "%", seen_percent);
    if !is_limited {
        return seen;
    }
    seen.with_min(least_percent, LimitSource::recipe("surface.max_missing_percent")).reviews("form_hidden", || {
        let [percent, least] = distinguishable_texts(seen_percent, least_percent, 1);
        format!(
            "profile and flatness were measured in {percent} % of the region only (limit {least} %), and the rest is not known: \
             remove what hides the region, then locate again"
        )
    })
}

impl Figure<'_> {
    /// The figure beside its limit. A value is good only if it is within the limit with its whole uncertainty.
    fn check(&self) -> Check {
        let Measured { value_mm, uncertainty_mm } = *self.measured;
        let number = Check::new(self.name, "mm", value_mm);
        let Some(limit_mm) = self.limit_mm else { return number };
        let is_beyond = value_mm.is_nan() || value_mm > limit_mm;
        let code = if is_beyond { self.code } else { "form_uncertain" };
        let is_proven = self.measured.is_surely_within(limit_mm);
        number.with_max(limit_mm, self.set_by.clone()).with_consequence_if(!is_proven, Severity::Review, code, || {
            let [value, limit] = distinguishable_texts(value_mm, limit_mm, 2);
            let (subject, uncertainty) = (&self.subject, fixed_decimals(uncertainty_mm, 2));
            let remedy = match (is_beyond, self.measured.is_surely_beyond(limit_mm)) {
                (true, true) => "look at the deviation map; rework the panel, or accept it if this form is permitted",
                (true, false) => {
                    "the uncertainty includes the limit: look at the deviation map, and measure the panel by other means"
                }
                (false, _) => {
                    "the uncertainty includes the limit, so it is not proven that the limit is kept: measure the panel by \
                     other means, or the 3D camera's errors by calibrate scanner"
                }
            };
            format!("{subject} is {value} mm, uncertainty {uncertainty} mm (limit {limit} mm): {remedy}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::{Judgement, Verdict};
    use panelprep_cell::recipe::Recipe;

    fn measured(value_mm: f64, uncertainty_mm: f64) -> Measured {
        Measured { value_mm, uncertainty_mm }
    }

    fn form(profile: Measured, flat: Measured, nominal_mm: f64, seen_percent: f64) -> Form {
        let flatness = Some(Flatness { zone: flat, least_squares_mm: flat.value_mm, nominal_mm });
        Form {
            profile,
            front: measured(profile.value_mm / 2.0, 0.05),
            behind: measured(-0.1, 0.05),
            flatness,
            seen_percent,
            places: vec![],
        }
    }

    fn recipe(keys: &str) -> Recipe {
        let text = format!(
            "panel = \"p\"\nregion = {{ corners_px = [[0, 0], [9, 0], [9, 9], [0, 9]], rows = 1, columns = 1 }}\n\
             locate.box_min_mm = [0, 0, 0]\nlocate.box_max_mm = [1, 1, 1]\n[surface]\n{keys}"
        );
        Recipe::check("f", &text).unwrap_or_else(|problems| panic!("{problems}"))
    }

    fn codes(form: Option<&Form>, keys: &str) -> (Verdict, Vec<String>) {
        let checks = form_checks(form, TaughtSource::Scan, recipe(keys).surface());
        let judgement = Judgement::from_checks(&checks);
        (judgement.verdict, judgement.reasons.into_iter().map(|reason| reason.code.into_owned()).collect())
    }

    /// By hand: 0.8 + 0.2 mm keep a limit of 1.0 mm, and do not keep 0.99 mm; 0.8 mm alone keeps it.
    #[test]
    fn only_what_is_proven_is_accepted() {
        let good = form(measured(0.8, 0.2), measured(0.3, 0.1), 0.0, 100.0);
        let with = |mm: f64| format!("max_profile_mm = {mm}\nmax_flatness_mm = 0.4");
        assert_eq!(codes(Some(&good), &with(1.0)), (Verdict::Accept, vec![]));
        assert_eq!(codes(Some(&good), &with(0.99)), (Verdict::Review, vec!["form_uncertain".to_owned()]));
        assert_eq!(codes(Some(&good), &with(0.79)), (Verdict::Review, vec!["profile".to_owned()]));
        let both = "max_profile_mm = 0.5\nmax_flatness_mm = 0.2";
        assert_eq!(codes(Some(&good), both).1, ["profile", "flatness"]);
        assert_eq!(codes(Some(&good), ""), (Verdict::Accept, vec![]), "without a limit, the figures are reported");
        let unknown = form(measured(0.1, f64::NAN), measured(0.1, f64::INFINITY), 0.0, 100.0);
        assert_eq!(codes(Some(&unknown), &with(1.0)).0, Verdict::Review);
    }

    #[test]
    fn what_was_not_seen_is_not_good() {
        let hidden = form(measured(0.1, 0.1), measured(0.1, 0.1), 0.0, 89.0);
        assert_eq!(codes(Some(&hidden), "max_profile_mm = 1.0").1, ["form_hidden"]);
        assert_eq!(codes(None, "max_flatness_mm = 1.0").1, ["form_hidden"]);
        assert_eq!(codes(None, "").0, Verdict::Accept, "no limit, and the missing surface has its own reason");
        let line = Form { flatness: None, seen_percent: 95.0, ..hidden };
        assert_eq!(codes(Some(&line), "max_flatness_mm = 1.0").1, ["form_hidden"]);
    }

    /// Only a panel that was taught from its drawing is compared with the drawing. A curved panel has no flatness,
    /// unless the recipe limits it.
    #[test]
    fn the_reference_is_named() {
        let round = form(measured(0.1, 0.1), measured(22.0, 0.1), 21.7, 100.0);
        let names = |reference: TaughtSource, keys: &str| -> Vec<String> {
            let checks = form_checks(Some(&round), reference, recipe(keys).surface());
            checks.into_iter().map(|check| check.name).collect()
        };
        let drawing = TaughtSource::Drawing;
        assert_eq!(names(TaughtSource::Scan, "")[0], name::PROFILE);
        assert_eq!(names(drawing, "")[0], name::PROFILE_FROM_DRAWING);
        assert!(!names(drawing, "").contains(&name::FLATNESS.to_owned()));
        assert!(names(drawing, "max_flatness_mm = 1.0").contains(&name::FLATNESS.to_owned()));
    }
}
