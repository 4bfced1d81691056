//! The surface of the region, and the part of it that the arm reaches at the panel's pose. Both are determined before
//! the panel is wetted.
//!
//! Today's form is checked against the recipe: profile of the surface and flatness, with their uncertainties.

use super::{ResultDrawing, names};
use crate::report::{surface_map, today_map};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Judgement, LimitSource, Reason, Severity};
use panelprep_cell::force::check_stroke;
use panelprep_cell::panel::{GridId, TaughtPanel, TaughtSource};
use panelprep_cell::recipe::{self, FitMethod, Recipe};
use panelprep_cell::record::{Check, Finding, Kind, name};
use panelprep_toolpath::path::disc::DiscWearPlan;
use panelprep_toolpath::path::panel_reach::{GridReach, ReachSetup};
use panelprep_toolpath::path::{check_pad, panel_reach};
use panelprep_toolpath::removal::model::Model;
use panelprep_toolpath::surface::{
    self, Deviation, DeviationMap, Fit, Flatness, Form, Measured, TodaysScan, TodaysSurfaceFit,
};

/// Properties of the tool that the path does not contain: its error, its disc's wear and removal model, and its stroke.
#[derive(Debug, Clone, Copy)]
pub struct ToolState {
    /// `[limits] tool_error_mm` of the cell's file.
    pub error_mm: Option<f64>,
    /// Area that the present disc has swept, mm².
    pub worn_mm2: f64,
    /// The disc's removal model, if it is calibrated.
    pub removal: Option<Model>,
    /// The stroke of a compliant tool, mm.
    pub stroke_mm: Option<f64>,
    /// Whether the path is run in the air; then the checks of contact, wear and removal have no consequence.
    pub in_air: bool,
}

impl ToolState {
    /// Checks whether the stroke of a compliant tool is larger than the unknown errors of a path over this surface;
    /// `None` for another tool.
    pub(super) fn check_stroke(&self, fit: &Fit, settings: &recipe::Path) -> Option<Check> {
        let errors_mm = [self.error_mm, Some(fit.deviation.p95_mm), Some(settings.chord_error_mm())];
        self.stroke_mm.map(|stroke_mm| check_stroke(stroke_mm, settings.press_in_mm(), errors_mm))
    }

    /// Returns this check of contact, wear or removal, without its consequence if the path is run in the air.
    pub(super) fn contact_check(&self, check: Check) -> Check {
        if self.in_air { check.without_consequence() } else { check }
    }
}

/// The part of a panel that the arm reaches, grid by grid.
#[derive(Debug)]
pub struct RegionSurvey {
    /// All grids; empty if the arm does not reach the panel, or no path is possible on the surface.
    pub grids: Vec<GridReach>,
    /// Failed checks of grids that the arm does not reach, and of steps that are too large.
    violations: Vec<Check>,
    /// Checks whether the tool is suitable for the path.
    tool_checks: Vec<Check>,
    /// Checks of the difference between today's surface and the taught surface.
    todays_checks: Vec<Check>,
    /// The verdict.
    pub judgement: Judgement,
}

/// Computes the arm's motion over each grid separately, from the arm's pose before contact. `stand` is this pose, or
/// the reason why the arm does not reach it.
pub fn survey_grids(
    (panel, fit): (&TaughtPanel, &Fit),
    stand: Result<ReachSetup<'_>, Reason>,
    recipe: &Recipe,
    tool: ToolState,
) -> RegionSurvey {
    let rejected = |reason| RegionSurvey {
        grids: vec![],
        violations: vec![],
        tool_checks: vec![],
        todays_checks: vec![],
        judgement: Judgement::new(vec![reason], vec![]),
    };
    let stand = match stand {
        Ok(stand) => stand,
        Err(reason) => return rejected(reason),
    };
    let (around, settings) = ((&panel.region, panel.outline.as_slice()), recipe.path());
    match panel_reach::check_grids(&fit.surface, around, &stand, settings) {
        Ok(grids) => {
            let (pad, disc) = (check_pad(settings, tool.error_mm), check_disc(&grids, settings, tool));
            let stroke = tool.check_stroke(fit, settings);
            let of_tool = pad.into_iter().chain(stroke).chain([disc]).map(|check| tool.contact_check(check));
            let of_tool: Vec<Check> = of_tool.collect();
            let broken = panel_reach::grid_violations(&grids);
            let judgement = Judgement::from_checks(broken.iter().chain(&of_tool));
            RegionSurvey { grids, violations: broken, tool_checks: of_tool, todays_checks: vec![], judgement }
        }
        Err(error) => rejected(super::reason("no_path", &error)),
    }
}

/// Checks whether the disc lasts for the largest grid, so that it is changed before the panel is wetted.
fn check_disc(grids: &[GridReach], settings: &recipe::Path, tool: ToolState) -> Check {
    let largest_mm2 = grids.iter().map(|grid| grid.swept_mm2).fold(0.0, f64::max);
    let (worn_after_mm2, life_mm2) = (tool.worn_mm2 + largest_mm2, settings.disc_life_mm2());
    DiscWearPlan { swept_mm2: largest_mm2, wear_after_mm2: worn_after_mm2, life_mm2 }
        .check_wear(name::WORN_BY_A_GRID, "one grid")
}

/// The surface of the panel in today's scan, and its checks.
#[derive(Debug)]
pub struct TodaysSurface {
    /// The surface on which paths are planned.
    pub fit: Fit,
    /// Checks of the surface's distance from the taught surface, and of its accuracy.
    pub checks: Vec<Check>,
    /// Root mean square distance of the scan's points from this surface, mm; `None` if the scan shows too little of the
    /// surface for a comparison.
    pub rms_mm: Option<f64>,
    /// Drawing of the distance from the taught surface, pixel by pixel.
    pub drawing: Option<ResultDrawing>,
}

/// Corrects the taught surface by the scan in which the panel was located. The surface of the thesis's method is only
/// compared with the scan and is not corrected: the panel's deviation from it is treated as an error of the surface.
pub fn correct_by_scan(
    (panel, taught): (&TaughtPanel, &Fit),
    scan: &TodaysScan,
    limits: &recipe::Surface,
) -> TodaysSurface {
    let points = (scan.points.as_slice(), limits.max_hole_mm());
    match surface::correct_taught_surface(&taught.surface, panel, &taught.map, points) {
        Ok(todays) => {
            let reference = panel.reference;
            let nominal_scans = u8::from(reference == TaughtSource::Scan);
            let form = scan.errors.and_then(|errors| Form::compute((taught, nominal_scans), &todays, &errors));
            let form_rows = form_checks(form.as_ref(), reference, limits);
            let checks = deviation_checks(&todays, reference, limits).into_iter().chain(form_rows).collect();
            let picture = today_map(&todays.map, reference, limits.max_deviation_mm());
            let caption = map_caption(reference, form.as_ref());
            let drawing = Some(ResultDrawing::new("deviation", caption, picture));
            if limits.method() == FitMethod::Thesis {
                let rms_mm = Some(todays.rms_mm.hypot(todays.largest_mm));
                return TodaysSurface { fit: taught.clone(), checks, rms_mm, drawing };
            }
            let rms_mm = Some(todays.rms_mm);
            TodaysSurface { fit: Fit { surface: todays.surface, ..taught.clone() }, checks, rms_mm, drawing }
        }
        Err(error) => {
            let unknown = Check::new(deviation_name(panel.reference), "mm", None);
            let unknown =
                unknown.with_consequence_if(true, Severity::Review, "no_surface_today", || error.to_string());
            TodaysSurface { fit: taught.clone(), checks: vec![unknown], rms_mm: None, drawing: None }
        }
    }
}

/// Returns the caption of the deviation map, with the uncertainty if it is known.
fn map_caption(reference: TaughtSource, form: Option<&Form>) -> String {
    let uncertainty = match form {
        Some(form) => format!("uncertainty (95 %) up to {} mm", fixed_decimals(form.largest_uncertainty_mm(), 2)),
        None => "uncertainty not known".to_owned(),
    };
    let other = reference.describe();
    format!("Distance of today's panel surface in front of or behind {other}; {uncertainty}")
}

/// Returns the name of the check of the deviation, which names the reference surface.
fn deviation_name(reference: TaughtSource) -> &'static str {
    match reference {
        TaughtSource::Scan => name::DEVIATION,
        TaughtSource::Drawing => name::DEVIATION_FROM_DRAWING,
    }
}

/// Checks the difference between today's surface and the taught surface against the limits.
fn deviation_checks(todays: &TodaysSurfaceFit, reference: TaughtSource, limits: &recipe::Surface) -> [Check; 4] {
    let (deviation_mm, limit_mm) = (todays.largest_mm, limits.max_deviation_mm());
    let (rms_mm, limit_rms_mm) = (todays.rms_mm, limits.max_rms_mm());
    let (percent, limit_percent) = (todays.missing_percent, limits.max_missing_percent());
    let (hole_mm, limit_hole_mm) = (todays.largest_hole_mm, limits.max_hole_mm());
    [
        Check::new(deviation_name(reference), "mm", deviation_mm)
            .with_max(limit_mm, LimitSource::recipe("surface.max_deviation_mm"))
            .or_review("deviates", || {
                let [mm, limit_mm] = distinguishable_texts(deviation_mm, limit_mm, 2);
                let (other, clamped) = match reference {
                    TaughtSource::Scan => (reference.describe(), "that it is clamped as at teaching"),
                    TaughtSource::Drawing => (reference.describe(), "that it is clamped without a bend"),
                };
                format!(
                    "the panel's surface is up to {mm} mm from {other} (limit {limit_mm} mm): look at the \
                     deviation map; check that it is the right panel and {clamped}"
                )
            }),
        Check::new("residual of today's surface, rms", "mm", rms_mm)
            .with_max(limit_rms_mm, LimitSource::recipe("surface.max_rms_mm"))
            .or_review("rough_today", || {
                let [mm, limit_mm] = distinguishable_texts(rms_mm, limit_rms_mm, 3);
                format!(
                    "the scan points are {mm} mm rms from the surface fitted to today's scan (limit {limit_mm} \
                     mm): the panel bends within less than 70 mm, or the scan is noisy; inspect the panel, then \
                     scan again"
                )
            }),
        Check::new("region that today's scan does not show", "%", percent)
            .with_max(limit_percent, LimitSource::recipe("surface.max_missing_percent"))
            .or_review("hidden_today", || {
                let [percent, limit_percent] = distinguishable_texts(percent, limit_percent, 1);
                format!(
                    "{percent} % of the region is hidden in the scan or covered by an object (limit \
                     {limit_percent} %), so the surface there is unknown: remove the object, then locate again"
                )
            }),
        Check::new("largest square that today's scan does not show", "mm", hole_mm)
            .with_max(limit_hole_mm, LimitSource::recipe("surface.max_hole_mm"))
            .or_review("hidden_today", || {
                let [mm, limit_mm] = distinguishable_texts(hole_mm, limit_hole_mm, 1);
                format!(
                    "a square of {mm} mm side length in the region is hidden or covered by an object (limit \
                     {limit_mm} mm): look at the deviation map, remove the object, then locate again"
                )
            }),
    ]
}

/// Draws the deviation of the taught scan from the fitted surface, pixel by pixel.
pub fn draw_surface(map: &DeviationMap) -> ResultDrawing {
    ResultDrawing::new("surface", "Scan of the region compared with the fitted surface", surface_map(map))
}

impl RegionSurvey {
    /// Returns this survey with the checks of today's surface.
    pub fn with_todays_checks(mut self, checks: Vec<Check>) -> Self {
        self.judgement = self.judgement.combined_with(Judgement::from_checks(&checks));
        self.todays_checks = checks;
        self
    }

    /// Returns the result for the record.
    pub fn finding(&self, pass: u8, deviation: &Deviation, (panel, recipe): (&TaughtPanel, &Recipe)) -> Finding {
        let reached = self.grids.iter().filter_map(|grid| grid.outcome.as_ref().ok());
        let missed: Vec<GridId> =
            self.grids.iter().filter(|grid| grid.outcome.is_err()).map(|grid| grid.id).collect();
        let least_deg = reached.clone().copied().reduce(f64::min);
        let all = panel.region.ids().count() as f64;
        let finding = Finding::new(Kind::Reach, pass, self.judgement.clone())
            .with_checks(surface_checks(deviation, recipe))
            .with_checks([
                Check::new("grids within the arm's reach", "", reached.count() as f64)
                    .with_min(all, LimitSource::Program),
                Check::new("room beyond the arm's margins, at least", "°", least_deg),
            ]);
        let finding = finding.with_checks(self.todays_checks.iter().cloned());
        let finding = finding.with_checks(self.violations.iter().chain(&self.tool_checks).cloned());
        if missed.is_empty() { finding } else { finding.with_detail("out_of_reach", names(&missed)) }
    }
}

/// Returns the checks of the deviation between the taught surface and its scan.
fn surface_checks(deviation: &Deviation, recipe: &Recipe) -> [Check; 5] {
    let limits = recipe.surface();
    [
        Check::new("residual of the surface, rms", "mm", deviation.rms_mm)
            .with_max(limits.max_rms_mm(), LimitSource::recipe("surface.max_rms_mm")),
        Check::new("residual of the surface, 95 %", "mm", deviation.p95_mm),
        Check::new("the scan's white noise", "mm", deviation.noise_mm),
        Check::new("region without points that fit", "%", deviation.missing_percent)
            .with_max(limits.max_missing_percent(), LimitSource::recipe("surface.max_missing_percent")),
        Check::new("largest hole in the region", "mm", deviation.largest_hole_mm)
            .with_max(limits.max_hole_mm(), LimitSource::recipe("surface.max_hole_mm")),
    ]
}

/// A measured form value (profile or flatness), with the texts of its check.
struct FormFigure<'a> {
    name: &'static str,
    /// The form value as the subject of a sentence.
    subject: String,
    code: &'static str,
    measured: &'a Measured,
    limit_mm: Option<f64>,
    set_by: LimitSource,
}

/// Returns the checks of a form; `form` is `None` if today's scan does not show the form.
fn form_checks(form: Option<&Form>, reference: TaughtSource, limits: &recipe::Surface) -> Vec<Check> {
    let is_limited = limits.max_profile_mm().is_some() || limits.max_flatness_mm().is_some();
    let Some(form) = form else {
        let unknown = Check::new(profile_name(reference), "mm", None);
        return vec![unknown.with_consequence_if(is_limited, Severity::Review, "form_hidden", || {
            "the scan in which the panel was located does not show the region's form, so profile and flatness are not known: \
             remove what hides the region, then locate again"
                .to_owned()
        })];
    };
    let profile = FormFigure {
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
    checks.push(visible_fraction_check(form.seen_percent, is_limited, limits));
    checks
}

/// Returns the name of the check of the profile, which names the reference surface.
fn profile_name(reference: TaughtSource) -> &'static str {
    match reference {
        TaughtSource::Scan => name::PROFILE,
        TaughtSource::Drawing => name::PROFILE_FROM_DRAWING,
    }
}

/// Returns the checks of the flatness, if the panel is nominally flat or the recipe limits the flatness.
fn flatness_checks(flatness: Option<&Flatness>, limit_mm: Option<f64>) -> Vec<Check> {
    let Some(flat) = flatness else {
        let unknown = Check::new(name::FLATNESS, "mm", None);
        let unknown = unknown.with_consequence_if(limit_mm.is_some(), Severity::Review, "form_hidden", || {
            "the visible part of the region is a line, from which no flatness can be determined: remove what hides \
             the region, then locate again"
                .to_owned()
        });
        return vec![unknown];
    };
    if limit_mm.is_none() && !flat.is_nominal_flat() {
        return vec![];
    }
    let figure = FormFigure {
        name: name::FLATNESS,
        subject: match flat.is_nominal_flat() {
            true => "the flatness of the region".to_owned(),
            false => format!(
                "the flatness of the region, which was not flat when it was taught (flatness {} mm),",
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

/// Checks the fraction of the region in which the form was measured.
fn visible_fraction_check(seen_percent: f64, is_limited: bool, limits: &recipe::Surface) -> Check {
    let least_percent = 100.0 - limits.max_missing_percent();
    let seen = Check::new("region in which the form was measured", "%", seen_percent);
    if !is_limited {
        return seen;
    }
    seen.with_min(least_percent, LimitSource::recipe("surface.max_missing_percent")).or_review("form_hidden", || {
        let [percent, least] = distinguishable_texts(seen_percent, least_percent, 1);
        format!(
            "profile and flatness were measured in {percent} % of the region only (limit {least} %), and the rest is not known: \
             remove what hides the region, then locate again"
        )
    })
}

impl FormFigure<'_> {
    /// Checks the form value against its limit. It passes only if it is within the limit together with its uncertainty.
    fn check(&self) -> Check {
        let Measured { value_mm, uncertainty_mm } = *self.measured;
        let number = Check::new(self.name, "mm", value_mm);
        let Some(limit_mm) = self.limit_mm else { return number };
        let is_beyond = value_mm.is_nan() || value_mm > limit_mm;
        let code = if is_beyond { self.code } else { "form_uncertain" };
        let is_proven = self.measured.is_within_with_uncertainty(limit_mm);
        number.with_max(limit_mm, self.set_by.clone()).with_consequence_if(!is_proven, Severity::Review, code, || {
            let [value, limit] = distinguishable_texts(value_mm, limit_mm, 2);
            let (subject, uncertainty) = (&self.subject, fixed_decimals(uncertainty_mm, 2));
            let remedy = match (is_beyond, self.measured.is_beyond_with_uncertainty(limit_mm)) {
                (true, true) => "look at the deviation map; rework the panel, or accept it if this form is permitted",
                (true, false) => {
                    "the limit is within the uncertainty: look at the deviation map, and measure the panel by other \
                     means"
                }
                (false, _) => {
                    "the limit is within the uncertainty, so it is not proven that the limit is kept: measure the \
                     panel by other means, or the 3D camera's errors by calibrate scanner"
                }
            };
            format!("{subject} is {value} mm, uncertainty {uncertainty} mm (limit {limit} mm): {remedy}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::Verdict;

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

    /// Expected results, by hand: 0.8 mm + 0.2 mm is within a limit of 1.0 mm, but not within 0.99 mm; 0.8 mm alone is
    /// within both.
    #[test]
    fn a_form_is_accepted_only_with_its_uncertainty() {
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
    fn a_form_that_was_not_seen_needs_a_review() {
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
    fn checks_name_their_reference() {
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
