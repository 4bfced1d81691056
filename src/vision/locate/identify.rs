//! Which of several taught panels is in a scan?
//!
//! Each taught panel whose size is in the scan is located, and the gate judges its fit. Two panels that differ little
//! may both pass the gate, since it allows a part of the outline to lie elsewhere. Therefore the best panel is compared
//! with every other one at the places at which the two differ (`difference`). It is accepted only if the scan shows it
//! there and not the other one. A part that distinguishes two panels and is not seen is no agreement: then a person
//! decides.
//!
//! Two panels of one outline are distinguished by their surface only as far as the recipe allows no bend that makes
//! one of them the other. Known limits: marks do not distinguish panels; a panel that was not taught is rejected only
//! as far as it differs from each taught one by more than a stretch of its outline, or as the gate detects it.

mod difference;

#[cfg(test)]
mod tests;

pub use difference::{Difference, MIN_RATIO, MIN_SEEN_SHARE};

use super::deviation::Deviation;
use super::evidence::CHANCE_MATCH_MM;
use super::fit::{FitInputs, Residuals, Samples};
use super::{Fit, LocateError, PreparedScan, ScanView, TaughtModel, gate, search};
use difference::{Contradiction, PlacedPanel};
use panelprep_base::geometry::statistics::PANEL_MAX_95;
use panelprep_base::number_text::{distinguishable_percents, distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::files;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::{self, Recipe};

/// Largest stretch of the best panel's outline that the scan contradicts, mm and px: the larger one of the two counts.
const MAX_CONTRADICTION_MM: f64 = 10.0;
const MAX_CONTRADICTION_PX: f64 = 8.0;

/// A taught panel with which a scan is compared.
#[derive(Clone, Copy)]
pub struct Candidate<'a> {
    /// The panel.
    pub panel: &'a TaughtPanel,
    /// The panel as the localization uses it, for the range errors of the scan's camera.
    pub model: &'a TaughtModel,
    /// Its recipe.
    pub recipe: &'a Recipe,
}

/// What distinguishes the best panel from another one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
pub enum Distinction {
    /// Outline or material is where the best panel has it, and not where the other one has it.
    #[strum(serialize = "outline and material")]
    Outline,
    /// The other panel would have to be bent by more than its recipe allows.
    #[strum(serialize = "a bend beyond its limit")]
    Bend,
    /// The scan differs from the other panel's surface by more than its recipe allows, and no smooth bend explains this.
    #[strum(serialize = "its surface")]
    Surface,
}

/// A taught panel that was located in the scan.
#[derive(Debug, Clone)]
pub struct FoundPanel {
    /// The pose with its evidence.
    pub fit: Fit,
    /// The gate's verdict on the fit.
    pub judgement: Judgement,
    /// Whether the gate finds that the object is another panel, whatever its pose.
    pub is_other: bool,
    /// The longest stretch of its outline that the scan contradicts, mm.
    pub contradiction_mm: f64,
    /// The limit of this stretch, mm.
    pub max_contradiction_mm: f64,
    /// The best panel compared with this one; `None` for the best one itself.
    pub difference: Option<Difference>,
    /// What distinguishes this panel from the best one; `None` if nothing does.
    pub distinction: Option<Distinction>,
}

/// The result for one taught panel.
#[derive(Debug, Clone)]
pub struct ComparedPanel {
    /// The panel's name.
    pub name: String,
    /// The located panel, or why it was not located.
    pub located: Result<Box<FoundPanel>, LocateError>,
}

impl ComparedPanel {
    /// Returns whether the scan does not show that this panel is another one than the best one.
    pub fn is_undecided(&self) -> bool {
        match &self.located {
            Ok(found) => found.difference.is_some() && found.distinction.is_none(),
            Err(LocateError::EmptyBox { .. } | LocateError::NoPieceFits { .. }) => false,
            // Too little of the panel was matched: this is no evidence against it.
            Err(LocateError::Degenerate { .. }) => true,
        }
    }
}

/// The comparison of a scan with taught panels.
#[derive(Debug, Clone)]
pub struct Identification {
    /// The result for each panel: the best one first, then the others that were located, then those that were not.
    pub compared: Vec<ComparedPanel>,
    /// Whether the scan shows the best panel, and only that one.
    pub judgement: Judgement,
}

impl Identification {
    /// Returns the name of the panel that the scan shows, if one was located that may be it.
    pub fn best(&self) -> Option<&str> {
        let first = self.compared.first()?;
        let found = first.located.as_ref().ok()?;
        (found.difference.is_none() && !found.is_other).then_some(&*first.name)
    }

    /// Returns the smallest excess of the evidence for the best panel over that for another one, mm of outline and
    /// surface; `None` if no other panel was located.
    pub fn margin_mm(&self) -> Option<f64> {
        let differences = self.compared.iter().filter_map(|other| other.located.as_ref().ok()?.difference);
        differences.map(|difference| difference.for_first_mm - difference.for_second_mm).reduce(f64::min)
    }

    /// Returns the same result, judged with what else is known of the part, such as its order (`what`): if this does
    /// not belong to the panel that the scan shows, a person decides.
    #[must_use]
    pub fn with_expected(self, what: &str, is_expected: impl Fn(&str) -> bool) -> Self {
        let Some(name) = self.best().filter(|name| !is_expected(name)) else { return self };
        let message = format!(
            "the scan shows panel \"{name}\", but {what} belongs to another panel; check the part and its order, then \
             start with the recipe of the panel that is in the cell"
        );
        let differs = Judgement::new(vec![], vec![Reason::new("other_panel", message)]);
        Identification { judgement: self.judgement.clone().combined_with(differs), ..self }
    }
}

/// A candidate at its pose in the scan.
struct Located<'a> {
    candidate: Candidate<'a>,
    found: FoundPanel,
    placed: PlacedPanel<'a>,
    contradiction: Contradiction,
}

/// Compares a scan with taught panels, each in the search box of its own recipe.
pub fn identify(view: &ScanView<'_>, candidates: &[Candidate<'_>]) -> Identification {
    // The localization uses only depths and the lens's rays: a scan of another lens would be compared all the same.
    if let Err(error) = files::check_lens(view.scan, view.camera) {
        let judgement = Judgement::new(vec![Reason::new("other_scan", error.to_string())], vec![]);
        return Identification { compared: vec![], judgement };
    }
    let (mut located, not_located) = locate_all(view, candidates, |candidate| candidate.recipe.locate());
    let is_possible = choose_best(&mut located);
    let compared: Vec<ComparedPanel> = compare_with_best(located, view).into_iter().chain(not_located).collect();
    let judgement = judge(&compared, is_possible);
    Identification { compared, judgement }
}

/// Returns the taught panels that a scan of this panel does not distinguish from it. The scan is the one from which the
/// panel was taught; the others are searched in the box of its recipe.
///
/// # Errors
/// If the panel itself is not found in the scan.
pub fn find_indistinguishable<'a>(
    view: &ScanView<'_>,
    panel: Candidate<'a>,
    others: &[Candidate<'a>],
) -> Result<Vec<ComparedPanel>, LocateError> {
    let settings = panel.recipe.locate();
    let own = locate_one(view, panel, settings)?;
    let (located, not_located) = locate_all(view, others, |_| settings);
    let all = std::iter::once(own).chain(located).collect();
    let compared = compare_with_best(all, view).into_iter().chain(not_located);
    Ok(compared.filter(ComparedPanel::is_undecided).collect())
}

/// Locates the candidates. Returns those that were found, and the results for the others.
fn locate_all<'a>(
    view: &ScanView<'_>,
    candidates: &[Candidate<'a>],
    settings: impl Fn(&Candidate<'a>) -> &'a recipe::Locate,
) -> (Vec<Located<'a>>, Vec<ComparedPanel>) {
    let (mut located, mut others) = (Vec::new(), Vec::new());
    for candidate in candidates {
        match locate_one(view, *candidate, settings(candidate)) {
            Ok(found) => located.push(found),
            Err(error) => {
                others.push(ComparedPanel { name: candidate.recipe.panel().to_owned(), located: Err(error) })
            }
        }
    }
    (located, others)
}

fn locate_one<'a>(
    view: &ScanView<'_>,
    candidate: Candidate<'a>,
    settings: &recipe::Locate,
) -> Result<Located<'a>, LocateError> {
    let prepared = PreparedScan::new((candidate.panel, candidate.model), view, settings);
    check_size(&prepared)?;
    let fit = prepared.locate()?;
    let camera_from_panel = view.base_from_camera.inverse() * fit.base_from_panel;
    let (inputs, model) = (prepared.inputs(), &candidate.model.model);
    let residuals = Residuals::at_pose(&camera_from_panel, inputs, &Samples::all_of_model(model).surface_only());
    let deviation = Deviation::from_residuals(&residuals, model, None);
    let bent = deviation.map(|deviation| deviation.bent_panel(model));
    let inputs = FitInputs { model: bent.as_ref().unwrap_or(model), ..inputs };
    let placed = PlacedPanel::new(candidate.model, &camera_from_panel, inputs);
    let contradiction = placed.contradiction();
    let (px_per_mm, _) = view.camera.px_per_mm_at((camera_from_panel * model.centre_point()).mm.z);
    let found = FoundPanel {
        judgement: gate::judge(&fit, candidate.recipe),
        is_other: gate::is_other_panel(&fit, settings),
        contradiction_mm: contradiction.longest_mm,
        max_contradiction_mm: MAX_CONTRADICTION_MM.max(MAX_CONTRADICTION_PX / px_per_mm),
        difference: None,
        distinction: None,
        fit,
    };
    Ok(Located { candidate, found, placed, contradiction })
}

/// Checks whether a piece in the search box has the panel's area and reach, as far as the gate allows the panel to be
/// hidden: the gate would reject any other piece after a whole search.
fn check_size(prepared: &PreparedScan<'_>) -> Result<(), LocateError> {
    let (model, grid) = (&prepared.taught_model.model, &prepared.grid);
    let min_share = gate::min_reviewed_overlap(prepared.settings);
    let outline_mm: f64 = model.outline.iter().map(|sample| sample.length_mm).sum();
    let reach_mm = search::reach_mm(model);
    let is_alike = |found: f64, taught: f64, resolution: f64| {
        found + resolution >= min_share * taught && min_share * (found - resolution) <= taught
    };
    let has_size = search::candidates(model, grid, &prepared.pieces).iter().any(|piece| {
        // A block may be missing everywhere along the border.
        let block_mm = grid.factor as f64 * piece.centre.z / grid.camera.fx_px;
        is_alike(piece.area_mm2, model.area_mm2, outline_mm * block_mm)
            && is_alike(piece.reach_mm, reach_mm, 2.0 * block_mm)
    });
    // If large parts of the panel gave no points, its size is not known: the search decides.
    if has_size || model.has_missing_parts() {
        return Ok(());
    }
    Err(super::no_fit_error(model, &prepared.pieces, prepared.inside.iter().filter(|inside| **inside).count()))
}

/// Moves the best panel to the front: the one that no other one beats at the places at which they differ. A panel that
/// the gate excludes is not the best if there is another. Returns whether the first one may be in the scan.
fn choose_best(located: &mut [Located<'_>]) -> bool {
    located.sort_by(|a, b| {
        let key = |it: &Located<'_>| (it.found.is_other, it.found.judgement.verdict.severity());
        key(a).cmp(&key(b)).then(a.found.fit.outline_absent.total_cmp(&b.found.fit.outline_absent))
    });
    let possible = located.iter().take_while(|it| !it.found.is_other).count();
    let mut best = 0;
    for other in 1..possible {
        if located[other].placed.difference_from(&located[best].placed).evidence_ratio() >= MIN_RATIO {
            best = other;
        }
    }
    if possible > 0 {
        located.swap(0, best);
    }
    possible > 0
}

/// Compares the first panel with each of the others.
fn compare_with_best(mut located: Vec<Located<'_>>, view: &ScanView<'_>) -> Vec<ComparedPanel> {
    if let Some((best, others)) = located.split_first_mut() {
        for other in others {
            let difference = best.placed.difference_from(&other.placed);
            other.found.difference = Some(difference);
            other.found.distinction = match difference.shows_first() || is_excluded_by_outline(best, other) {
                true => Some(Distinction::Outline),
                false => distinguish_by_surface(&best.found, other, view),
            };
        }
    }
    let compared = |it: Located<'_>| ComparedPanel {
        name: it.candidate.recipe.panel().to_owned(),
        located: Ok(Box::new(it.found)),
    };
    located.into_iter().map(compared).collect()
}

/// Returns whether the gate excludes the other panel, and more of its outline is contradicted than the gate allows, by
/// a length that does not match by chance and is not due to the scan: the scan contradicts this length of the best
/// panel as well.
fn is_excluded_by_outline(best: &Located<'_>, other: &Located<'_>) -> bool {
    let allowed_mm = gate::MAX_OUTLINE_ABSENT_FRACTION * other.contradiction.in_view_mm;
    let excess_mm = other.contradiction.whole_mm - allowed_mm;
    !best.found.is_other && other.found.is_other && excess_mm >= CHANCE_MATCH_MM + best.contradiction.whole_mm
}

/// Returns whether the surface excludes the other panel, by more than the scan's uncertainty.
fn distinguish_by_surface(best: &FoundPanel, other: &Located<'_>, view: &ScanView<'_>) -> Option<Distinction> {
    let (fit, recipe) = (&other.found.fit, other.candidate.recipe);
    let error_mm = PANEL_MAX_95 * view.range.scan_to_scan_mm;
    // A bend that could not be measured excludes nothing.
    if fit.deviation_mm.is_some_and(|mm| mm - error_mm > recipe.surface().max_deviation_mm()) {
        return Some(Distinction::Bend);
    }
    // The best panel explains the scan to its own residual: this part is the scan's noise.
    let excess_mm = (fit.rms_mm.powi(2) - best.fit.rms_mm.powi(2)).max(0.0).sqrt();
    (excess_mm > recipe.locate().max_rms_mm()).then_some(Distinction::Surface)
}

/// Judges the comparison of the panels, the best one first.
fn judge(compared: &[ComparedPanel], is_possible: bool) -> Judgement {
    let first = compared.first().and_then(|first| Some((&*first.name, first.located.as_deref().ok()?)));
    let Some((name, found)) = first.filter(|_| is_possible) else {
        return Judgement::new(vec![no_known_panel(first, compared.len())], vec![]);
    };
    let named = |reason: &Reason| Reason {
        code: reason.code.clone(),
        message: format!("panel \"{name}\": {}", reason.message),
    };
    let of_gate: Vec<Reason> = found.judgement.reasons.iter().map(named).collect();
    let (reject, mut review) = match found.judgement.verdict {
        Verdict::Reject => (of_gate, vec![]),
        _ => (vec![], of_gate),
    };
    if gate::exceeds_limit(found.contradiction_mm, found.max_contradiction_mm) {
        review.push(part_differs(name, found));
    }
    let undecided = compared.iter().skip(1).filter(|other| other.is_undecided());
    review.extend(undecided.map(|other| panels_alike(name, other)));
    Judgement::new(reject, review)
}

fn no_known_panel(nearest: Option<(&str, &FoundPanel)>, count: usize) -> Reason {
    let nearest = nearest.map_or_else(String::new, |(name, found)| {
        let reasons: Vec<&str> = found.judgement.reasons.iter().map(|reason| reason.message.as_str()).collect();
        format!("; the nearest one is \"{name}\": {}", reasons.join("; "))
    });
    let message = format!(
        "the scan shows none of the {count} taught panels{nearest}; check which panel is in the cell, and teach it if \
         it is new"
    );
    Reason::new("no_known_panel", message)
}

fn part_differs(name: &str, found: &FoundPanel) -> Reason {
    let [differs, limit] = distinguishable_texts(found.contradiction_mm, found.max_contradiction_mm, 0);
    let message = format!(
        "a stretch of {differs} mm of the outline is not where panel \"{name}\" has it (limit {limit} mm): it may be a \
         panel that was not taught; check the panel and remove what touches its edge"
    );
    Reason::new("part_differs", message)
}

fn panels_alike(name: &str, other: &ComparedPanel) -> Reason {
    let difference = match &other.located {
        Ok(found) => found.difference.unwrap_or_default(),
        Err(error) => {
            return Reason::new("panels_alike", format!("panel \"{}\" is not excluded: {error}", other.name));
        }
    };
    let mm = |value: f64| fixed_decimals(value, 0);
    let [ratio, min_ratio] = distinguishable_texts(difference.evidence_ratio(), MIN_RATIO, 1);
    let [seen, min_seen] = distinguishable_percents(difference.seen_share(), MIN_SEEN_SHARE, 0);
    let message = format!(
        "it is panel \"{name}\" or panel \"{}\": where they differ, {} mm of outline and surface support only the first \
         and {} mm only the second, a ratio of {ratio} (at least {min_ratio} is needed), and {seen} % of the places are \
         seen (at least {min_seen} % are needed); a person must decide",
        other.name,
        mm(difference.for_first_mm),
        mm(difference.for_second_mm)
    );
    Reason::new("panels_alike", message)
}
