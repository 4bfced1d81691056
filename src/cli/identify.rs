//! Which of the taught panels is in a scan, and what is its recipe? For `panelprep identify` and `panelprep ctl start`
//! without a recipe; `panelprep teach` compares a new panel with the others. The result is a proposal: a person starts
//! the cycle.

use super::disk;
use super::fault::Fault;
use super::load::{self, CellFiles};
use super::output::Outcome;
use panelprep_base::geometry::{Camera, OrganizedCloud};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::check_serial_form;
use panelprep_cell::files::content_hash;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::Recipe;
use panelprep_service::check::check_file;
use panelprep_store::store::Store;
use panelprep_vision::locate::identify::{
    Candidate, ComparedPanel, FoundPanel, Identification, find_indistinguishable, identify,
};
use panelprep_vision::locate::{LocateError, RangeErrors, ScanView, TaughtModel};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A taught panel with the recipe that is valid today: the one of the recipes' folder, else the one of its teaching.
struct KnownPanel {
    /// The panel's recipes in the folder.
    recipe_files: Vec<PathBuf>,
    panel: TaughtPanel,
    model: TaughtModel,
    recipe: Recipe,
}

impl KnownPanel {
    fn candidate(&self) -> Candidate<'_> {
        Candidate { panel: &self.panel, model: &self.model, recipe: &self.recipe }
    }
}

/// A panel that cannot be compared: it never counts as excluded.
struct UnusablePanel {
    /// The panel's name, or its recipe's file.
    name: String,
    cause: String,
}

/// The recipes of a folder.
#[derive(Default)]
struct RecipeFolder {
    recipes: Vec<(PathBuf, Recipe)>,
    /// The files that may be recipes but cannot be read.
    unreadable: Vec<UnusablePanel>,
}

impl RecipeFolder {
    fn read(folder: &Path) -> Result<Self, Fault> {
        let failed = |error: std::io::Error| Fault::file_fault(folder, error);
        let mut found = RecipeFolder::default();
        for entry in std::fs::read_dir(folder).map_err(failed)? {
            let file = entry.map_err(failed)?.path();
            if file.extension().is_none_or(|ending| ending != "toml") || !file.is_file() {
                continue;
            }
            let kind = disk::read_text(&file).ok().and_then(|text| check_file("", &text).kind);
            match load::recipe(&file) {
                Ok(recipe) => found.recipes.push((file, recipe)),
                // Only a file that is certainly of another kind is no recipe.
                Err(_) if kind.is_some_and(|kind| kind != "recipe") => {}
                Err(fault) => {
                    let name = file.display().to_string();
                    found.unreadable.push(UnusablePanel { name, cause: fault.to_string() });
                }
            }
        }
        found.recipes.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(found)
    }

    fn of_panel(&self, name: &str) -> impl Iterator<Item = &(PathBuf, Recipe)> {
        self.recipes.iter().filter(move |(_, recipe)| recipe.panel() == name)
    }
}

/// Taught panels of a cell.
#[derive(Default)]
struct KnownPanels {
    panels: Vec<KnownPanel>,
    unusable: Vec<UnusablePanel>,
}

impl KnownPanels {
    /// Loads the newest teaching of each panel in the store that has one of these names.
    fn load(
        files: &CellFiles,
        range: RangeErrors,
        folder: &RecipeFolder,
        is_wanted: impl Fn(&str) -> bool,
    ) -> Result<Self, Fault> {
        let store = files.store()?;
        let names = store.panel_names().map_err(Fault::stage)?;
        let mut known = KnownPanels::default();
        for name in names.into_iter().filter(|name| is_wanted(name)) {
            match load_panel(&name, (files, &store), range, folder) {
                Ok(panel) => known.panels.push(panel),
                Err(fault) => known.unusable.push(UnusablePanel { name, cause: fault.to_string() }),
            }
        }
        Ok(known)
    }

    /// Loads the panels of the recipes in a folder, and only those.
    fn of_folder(files: &CellFiles, range: RangeErrors, folder: RecipeFolder) -> Result<Self, Fault> {
        let mut known = Self::load(files, range, &folder, |name| folder.of_panel(name).next().is_some())?;
        let is_known = |name: &str| {
            known.panels.iter().any(|panel| panel.recipe.panel() == name)
                || known.unusable.iter().any(|panel| panel.name == name)
        };
        let not_taught = folder.recipes.iter().filter(|(_, recipe)| !is_known(recipe.panel()));
        let not_taught: Vec<UnusablePanel> = not_taught
            .map(|(file, recipe)| UnusablePanel {
                name: recipe.panel().to_owned(),
                cause: format!("{}: this panel was not taught", file.display()),
            })
            .collect();
        known.unusable.extend(not_taught.into_iter().chain(folder.unreadable));
        Ok(known)
    }

    fn candidates(&self) -> Vec<Candidate<'_>> {
        self.panels.iter().map(KnownPanel::candidate).collect()
    }

    /// Returns whether a part with this serial number may be this panel, by the form of the numbers that the recipes
    /// state.
    fn has_serial(&self, name: &str, serial: &str) -> bool {
        let has_form = |recipe: &Recipe| {
            let pattern = recipe.outline().serial_pattern()?;
            Some(check_serial_form(serial, &pattern).is_ok())
        };
        let is_of = |panel: &&KnownPanel| panel.recipe.panel() == name;
        let own = self.panels.iter().find(is_of).and_then(|panel| has_form(&panel.recipe));
        // A panel without a form is not that of a number that has the form of another one.
        own.unwrap_or_else(|| !self.panels.iter().any(|other| has_form(&other.recipe) == Some(true)))
    }
}

fn load_panel(
    name: &str,
    (files, store): (&CellFiles, &Store),
    range: RangeErrors,
    folder: &RecipeFolder,
) -> Result<KnownPanel, Fault> {
    let teaching = store.taught(name, None).map_err(Fault::stage)?.teaching;
    let taught_recipe = Recipe::check("the taught recipe", &teaching.recipe_text)?;
    let panel = load::derive_panel(&teaching, (&taught_recipe, &files.scanner_lens()?))?;
    let model = TaughtModel::from_panel(&panel, range).map_err(Fault::stage)?;
    let recipe = folder.of_panel(name).next().map_or(taught_recipe, |(_, recipe)| recipe.clone());
    let recipe_files = folder.of_panel(name).map(|(file, _)| file.clone()).collect();
    Ok(KnownPanel { recipe_files, panel, model, recipe })
}

/// The panel that a scan shows, as it is proposed to a person.
pub struct Proposal {
    /// The result with all panels that were compared.
    pub outcome: Outcome,
    /// The panel's name and its recipe's file, if the panel is accepted and has exactly one recipe.
    pub startable: Option<(String, PathBuf)>,
    /// Why nothing can be started; empty if something can.
    pub reasons: Vec<Reason>,
}

/// What limits a proposal, beside the scan.
#[derive(Default)]
pub struct ProposalLimits<'a> {
    /// The folder of recipes whose panels alone are compared; `None` for all panels of the store.
    pub panels: Option<&'a Path>,
    /// The panel that the order names.
    pub expected: Option<&'a str>,
    /// The part's serial number.
    pub serial: Option<&'a str>,
}

/// Compares a scan, as the camera delivers it, with the taught panels, and proposes the panel that it shows.
///
/// # Errors
/// If a file is invalid, or no store exists.
pub fn propose(
    files: &CellFiles,
    scan: OrganizedCloud<Camera>,
    limits: &ProposalLimits<'_>,
) -> Result<Proposal, Fault> {
    let scanner = files.scanner()?;
    let (camera, errors) = (scanner.value, scanner.scan_errors);
    let base_from_camera = files.base_from_camera()?.value;
    let known = match limits.panels {
        Some(folder) => KnownPanels::of_folder(files, errors.range, RecipeFolder::read(folder)?)?,
        None => {
            let folder = RecipeFolder::read(&files.cell.page().recipes)?;
            KnownPanels::load(files, errors.range, &folder, |_| true)?
        }
    };
    let scan = errors.correct_scan(scan);
    let begin = Instant::now();
    let view = ScanView { scan: &scan, camera: &camera, base_from_camera, range: errors.range };
    let mut identified = identify(&view, &known.candidates());
    let elapsed_ms = begin.elapsed().as_secs_f64() * 1e3;
    if let Some(expected) = limits.expected {
        identified = identified.with_expected(&format!("the order for \"{expected}\""), |name| name == expected);
    }
    if let Some(serial) = limits.serial {
        let what = format!("the serial number \"{}\"", serial.escape_debug());
        identified = identified.with_expected(&what, |name| known.has_serial(name, serial));
    }
    let mut proposal = report(&identified, &known)?;
    proposal.outcome.add_value("elapsed_ms", json!(elapsed_ms));
    Ok(proposal)
}

/// Reports the proposed panel, and each panel with the evidence for it.
fn report(identified: &Identification, known: &KnownPanels) -> Result<Proposal, Fault> {
    let not_compared = known.unusable.iter().map(|panel| {
        let message = format!(
            "panel \"{}\" could not be compared, so that it is not excluded: {}; correct this or teach the panel again",
            panel.name, panel.cause
        );
        Reason::new("panel_not_compared", message)
    });
    let not_compared = Judgement::new(vec![], not_compared.collect());
    let judgement = identified.judgement.clone().combined_with(not_compared);
    let mut outcome = Outcome::from_judgement(&judgement);
    let best = identified.best();
    outcome.add_value("panel", json!(best));
    outcome.add_value("margin_mm", json!(identified.margin_mm()));
    let (mut startable, mut reasons) = (None, judgement.reasons.clone());
    if let Some(name) = best {
        outcome.add_line(format!("panel {name}"));
        let of_best = known.panels.iter().filter(|panel| panel.recipe.panel() == name);
        let files: Vec<&PathBuf> = of_best.flat_map(|panel| &panel.recipe_files).collect();
        let mut recipes = Vec::new();
        for file in &files {
            let sha256 = content_hash(&disk::read(file)?);
            outcome.add_line(format!("recipe {}, SHA-256 {sha256}", file.display()));
            recipes.push(json!({"file": file, "sha256": sha256}));
        }
        outcome.add_value("recipes", json!(recipes));
        match (judgement.verdict, &files[..]) {
            (Verdict::Accept, [file]) => startable = Some((name.to_owned(), (*file).clone())),
            (Verdict::Accept, _) => reasons.push(no_single_recipe(name, files.len())),
            _ => {}
        }
    }
    identified.compared.iter().for_each(|compared| outcome.add_line(describe(compared)));
    outcome.add_value("panels", identified.compared.iter().map(to_json).collect());
    let unusable = known.unusable.iter().map(|panel| json!({"panel": panel.name, "cause": panel.cause}));
    outcome.add_value("not_compared", unusable.collect());
    Ok(Proposal { outcome, startable, reasons })
}

fn no_single_recipe(name: &str, count: usize) -> Reason {
    let message = format!(
        "the scan shows panel \"{name}\", and the recipes' folder has {count} recipes of this panel, not one; start \
         with the recipe of your choice"
    );
    Reason::new("no_single_recipe", message)
}

/// Describes the result for one panel, for a person.
fn describe(compared: &ComparedPanel) -> String {
    let result = match &compared.located {
        Ok(found) => describe_found(found),
        Err(error) => error.to_string(),
    };
    format!("  {}: {result}", compared.name)
}

fn describe_found(found: &FoundPanel) -> String {
    let fit = &found.fit;
    let number = |value: f64, decimals: usize| fixed_decimals(value, decimals).to_string();
    let seen = format!(
        "{} (outline {} mm, surface {} mm rms, bend {} mm; {} % of the outline and {} % of the surface found)",
        found.judgement.verdict.keyword(),
        number(fit.outline_rms_mm, 2),
        number(fit.rms_mm, 2),
        fit.deviation_mm.map_or_else(|| "unknown".to_owned(), |bend_mm| number(bend_mm, 2)),
        number(100.0 * fit.outline_found, 0),
        number(100.0 * fit.overlap(), 0)
    );
    let Some(difference) = found.difference else { return format!("the best, {seen}") };
    format!(
        "{seen}; where it differs from the best, {} mm support only the best, {} mm only this one, {} mm are not seen: {}",
        number(difference.for_first_mm, 0),
        number(difference.for_second_mm, 0),
        number(difference.unseen_mm, 0),
        found.distinction.map_or_else(
            || "not distinguished".to_owned(),
            |distinction| format!("distinguished by {}", <&str>::from(distinction))
        )
    )
}

/// Returns the result for one panel, for scripts.
fn to_json(compared: &ComparedPanel) -> Value {
    let mut object = match &compared.located {
        Err(error) => json!({"cause": error.to_string()}),
        Ok(found) => json!({
            "verdict": found.judgement.verdict,
            "reasons": found.judgement.reasons,
            "outline_rms_mm": found.fit.outline_rms_mm,
            "rms_mm": found.fit.rms_mm,
            "deviation_mm": found.fit.deviation_mm,
            "outline_found": found.fit.outline_found,
            "overlap": found.fit.overlap(),
            "contradiction_mm": found.contradiction_mm,
            "for_best_mm": found.difference.map(|difference| difference.for_first_mm),
            "for_this_mm": found.difference.map(|difference| difference.for_second_mm),
            "unseen_mm": found.difference.map(|difference| difference.unseen_mm),
            "distinguished_by": found.distinction.map(<&str>::from),
        }),
    };
    object["panel"] = json!(compared.name);
    object["is_undecided"] = json!(compared.is_undecided());
    object
}

/// Compares a panel that is taught, in its own scan, with the other panels of the store. Returns the warnings.
///
/// # Errors
/// If the store or the recipes' folder cannot be read.
pub fn report_alike_panels(
    (panel, recipe): (&TaughtPanel, &Recipe),
    view: &ScanView<'_>,
    files: &CellFiles,
    outcome: &mut Outcome,
) -> Result<Vec<String>, Fault> {
    let folder = RecipeFolder::read(&files.cell.page().recipes)?;
    let others = KnownPanels::load(files, view.range, &folder, |name| name != recipe.panel())?;
    let unknown = |name: &str, cause: &str| {
        format!("it is not known whether a scan distinguishes this panel from \"{name}\": {cause}")
    };
    let mut warnings: Vec<String> =
        others.unusable.iter().map(|other| unknown(&other.name, &other.cause)).collect();
    let model = TaughtModel::from_panel(panel, view.range);
    let alike = model
        .as_ref()
        .map_err(LocateError::clone)
        .and_then(|model| find_indistinguishable(view, Candidate { panel, model, recipe }, &others.candidates()));
    match &alike {
        Ok(alike) => warnings.extend(alike.iter().map(describe_alike)),
        // That the panel is not found in its own scan is already a reason for a review.
        Err(error) => {
            let names = others.panels.iter().map(|other| other.recipe.panel());
            warnings.extend(names.map(|name| unknown(name, &error.to_string())));
        }
    }
    outcome.add_value("compared_panels", json!(others.panels.len()));
    outcome.add_value("alike", json!(alike.ok().map(|alike| alike.iter().map(to_json).collect::<Vec<_>>())));
    Ok(warnings)
}

fn describe_alike(other: &ComparedPanel) -> String {
    let evidence = match &other.located {
        Err(error) => error.to_string(),
        Ok(found) => {
            let difference = found.difference.unwrap_or_default();
            let mm = |value: f64| fixed_decimals(value, 0);
            let bend = found.fit.deviation_mm.map_or_else(
                || "its bend is unknown".to_owned(),
                |mm| format!("a bend of {} mm makes one of the other", fixed_decimals(mm, 2)),
            );
            format!(
                "{} mm of outline and surface show only this panel, {} mm only the other, {} mm are not seen, and {bend}",
                mm(difference.for_first_mm),
                mm(difference.for_second_mm),
                mm(difference.unseen_mm)
            )
        }
    };
    format!(
        "a scan cannot distinguish this panel from \"{}\": {evidence}; `panelprep identify` will ask a person to decide",
        other.name
    )
}
