//! Which of the taught panels is in a scan, and what is its recipe? The result is a proposal: a person starts the cycle.

use super::cell_files::CellFiles;
use super::fault::SetupFault;
use super::recipes::{RecipeText, is_of_other_kind, toml_files};
use super::teaching::derive_panel;
use crate::requirements::recipe_fits::parse_plausible_recipe;
use panelprep_base::geometry::{Camera, OrganizedCloud};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::check_serial_form;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::Recipe;
use panelprep_store::store::Store;
use panelprep_vision::locate::identify::{
    Candidate, ComparedPanel, Identification, find_indistinguishable, identify,
};
use panelprep_vision::locate::{LocateError, RangeErrors, ScanView, TaughtModel};
use std::path::Path;
use std::time::Instant;

/// A taught panel with the recipe that is valid today: the one of the recipes' folder, else the one of its teaching.
struct KnownPanel {
    /// The panel's recipes in the folder.
    folder_recipes: Vec<RecipeText>,
    panel: TaughtPanel,
    model: TaughtModel,
    recipe: Recipe,
}

impl KnownPanel {
    fn candidate(&self) -> Candidate<'_> {
        Candidate { panel: &self.panel, model: &self.model, recipe: &self.recipe }
    }
}

/// A panel that cannot be compared: it is never treated as excluded.
#[derive(Debug)]
pub struct UnusablePanel {
    /// The panel's name, or the file of its recipe.
    pub name: String,
    /// Why it cannot be compared.
    pub cause: String,
}

/// The recipes of a folder.
#[derive(Default)]
struct RecipeFolder {
    recipes: Vec<(RecipeText, Recipe)>,
    /// The files that may be recipes but cannot be read.
    unreadable: Vec<UnusablePanel>,
}

impl RecipeFolder {
    fn read(folder: &Path) -> Result<Self, SetupFault> {
        let mut found = RecipeFolder::default();
        for (file, text) in toml_files(folder)? {
            let name = file.display().to_string();
            let cause = match text.map(|text| (parse_plausible_recipe(&name, &text), text)) {
                Ok((Ok(recipe), text)) => {
                    found.recipes.push((RecipeText { name, text }, recipe));
                    continue;
                }
                Ok((Err(_), text)) if is_of_other_kind(&text) => continue,
                Ok((Err(problems), _)) => problems.to_string(),
                Err(fault) => fault.to_string(),
            };
            found.unreadable.push(UnusablePanel { name, cause });
        }
        Ok(found)
    }

    fn of_panel(&self, name: &str) -> impl Iterator<Item = &(RecipeText, Recipe)> {
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
    ) -> Result<Self, SetupFault> {
        let store = files.store()?;
        let names = store.panel_names().map_err(SetupFault::stage)?;
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
    fn of_folder(files: &CellFiles, range: RangeErrors, folder: RecipeFolder) -> Result<Self, SetupFault> {
        let mut known = Self::load(files, range, &folder, |name| folder.of_panel(name).next().is_some())?;
        let is_known = |name: &str| {
            known.panels.iter().any(|panel| panel.recipe.panel() == name)
                || known.unusable.iter().any(|panel| panel.name == name)
        };
        let not_taught = folder.recipes.iter().filter(|(_, recipe)| !is_known(recipe.panel()));
        let not_taught: Vec<UnusablePanel> = not_taught
            .map(|(file, recipe)| UnusablePanel {
                name: recipe.panel().to_owned(),
                cause: format!("{}: this panel was not taught", file.name),
            })
            .collect();
        known.unusable.extend(not_taught.into_iter().chain(folder.unreadable));
        Ok(known)
    }

    fn panel(&self, name: &str) -> Option<&KnownPanel> {
        self.panels.iter().find(|panel| panel.recipe.panel() == name)
    }

    /// Returns the recipes of a panel in the recipes' folder.
    fn recipes_of(&self, name: &str) -> Vec<RecipeText> {
        self.panel(name).map_or_else(Vec::new, |panel| panel.folder_recipes.clone())
    }

    fn candidates(&self) -> Vec<Candidate<'_>> {
        self.panels.iter().map(KnownPanel::candidate).collect()
    }

    /// Returns the form of a panel's serial numbers, if its recipe states one.
    fn serial_pattern(&self, name: &str) -> Option<String> {
        self.panel(name)?.recipe.outline().serial_pattern()
    }

    /// Returns whether a part with this serial number may be this panel, by the form of the numbers that the recipes
    /// state.
    fn has_serial(&self, name: &str, serial: &str) -> bool {
        let has_form = |recipe: &Recipe| {
            let pattern = recipe.outline().serial_pattern()?;
            Some(check_serial_form(Some(serial), &pattern).is_ok())
        };
        let own = self.panel(name).and_then(|panel| has_form(&panel.recipe));
        // A panel without a form is not that of a number that has the form of another one.
        own.unwrap_or_else(|| !self.panels.iter().any(|other| has_form(&other.recipe) == Some(true)))
    }
}

fn load_panel(
    name: &str,
    (files, store): (&CellFiles, &Store),
    range: RangeErrors,
    folder: &RecipeFolder,
) -> Result<KnownPanel, SetupFault> {
    let teaching = store.taught(name, None).map_err(SetupFault::stage)?.teaching;
    let taught_recipe = Recipe::check("the taught recipe", &teaching.recipe_text)?;
    let panel = derive_panel(&teaching, &taught_recipe, &files.scanner_lens()?)?;
    let model = TaughtModel::from_panel(&panel, range).map_err(SetupFault::stage)?;
    let recipe = folder.of_panel(name).next().map_or(taught_recipe, |(_, recipe)| recipe.clone());
    let folder_recipes = folder.of_panel(name).map(|(text, _)| text.clone()).collect();
    Ok(KnownPanel { folder_recipes, panel, model, recipe })
}

/// The panel that a scan shows, as it is proposed to a person.
#[derive(Debug)]
pub struct PanelProposal {
    /// The evidence for each panel that was compared.
    pub identified: Identification,
    /// The panels that could not be compared.
    pub unusable: Vec<UnusablePanel>,
    /// The verdict, also about the panels that could not be compared and about the part's serial number.
    pub judgement: Judgement,
    /// The recipes of the best panel in the recipes' folder.
    pub recipes: Vec<RecipeText>,
    /// Duration of the comparison, ms.
    pub elapsed_ms: f64,
}

impl PanelProposal {
    /// Returns the panel's name and its recipe, if the panel is accepted and has exactly one recipe; otherwise the
    /// reasons why nothing can be started.
    ///
    /// # Errors
    /// As described.
    pub fn startable(&self) -> Result<(&str, &RecipeText), Vec<Reason>> {
        let name = self.identified.best();
        match (self.judgement.verdict, name, &self.recipes[..]) {
            (Verdict::Accept, Some(name), [recipe]) => Ok((name, recipe)),
            (Verdict::Accept, Some(name), recipes) => {
                let no_single = no_single_recipe_reason(name, recipes.len());
                Err(self.judgement.reasons.iter().cloned().chain([no_single]).collect())
            }
            _ => Err(self.judgement.reasons.clone()),
        }
    }
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
) -> Result<PanelProposal, SetupFault> {
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
    let mut review: Vec<Reason> = known.unusable.iter().map(not_compared_reason).collect();
    let unnumbered = identified.best().filter(|_| limits.serial.is_none());
    review.extend(unnumbered.and_then(|name| Some(no_serial_reason(name, &known.serial_pattern(name)?))));
    let judgement = identified.judgement.clone().combined_with(Judgement::new(vec![], review));
    let recipes = identified.best().map_or_else(Vec::new, |name| known.recipes_of(name));
    Ok(PanelProposal { identified, unusable: known.unusable, judgement, recipes, elapsed_ms })
}

fn not_compared_reason(panel: &UnusablePanel) -> Reason {
    let message = format!(
        "panel \"{}\" could not be compared, so that it is not excluded: {}; correct this or teach the panel again",
        panel.name, panel.cause
    );
    Reason::new("panel_not_compared", message)
}

fn no_serial_reason(name: &str, pattern: &str) -> Reason {
    let message = format!(
        "the recipe of panel \"{name}\" states the form \"{pattern}\" of its serial numbers ([panel] serial_pattern), \
         but no serial number is stated, so that it is not known whether it agrees; enter the serial number of the \
         part (--part), then identify the panel again"
    );
    Reason::new("part_name", message)
}

fn no_single_recipe_reason(name: &str, count: usize) -> Reason {
    let message = format!(
        "the scan shows panel \"{name}\", and the recipes' folder has {count} recipes of this panel, not one; start \
         with the recipe of your choice"
    );
    Reason::new("no_single_recipe", message)
}

/// The other panels from which a new panel was distinguished, or not.
#[derive(Debug)]
pub struct AlikePanels {
    /// Number of panels that were compared.
    pub compared: usize,
    /// The panels that a scan cannot distinguish from the new one; an error if the new panel could not be compared.
    pub alike: Result<Vec<ComparedPanel>, LocateError>,
    /// The panels of which this is not known.
    pub unusable: Vec<UnusablePanel>,
}

/// Compares a panel that is taught, in its own scan, with the other panels of the store.
///
/// # Errors
/// If the store or the recipes' folder cannot be read.
pub fn find_alike_panels(
    (panel, recipe): (&TaughtPanel, &Recipe),
    view: &ScanView<'_>,
    files: &CellFiles,
) -> Result<AlikePanels, SetupFault> {
    let folder = RecipeFolder::read(&files.cell.page().recipes)?;
    let mut others = KnownPanels::load(files, view.range, &folder, |name| name != recipe.panel())?;
    let model = TaughtModel::from_panel(panel, view.range);
    let alike = model
        .as_ref()
        .map_err(LocateError::clone)
        .and_then(|model| find_indistinguishable(view, Candidate { panel, model, recipe }, &others.candidates()));
    if let Err(error) = &alike {
        // That the panel is not found in its own scan is already a reason for a review.
        let unknown = others.panels.iter().map(|other| other.recipe.panel().to_owned());
        let unknown = unknown.map(|name| UnusablePanel { name, cause: error.to_string() });
        others.unusable.extend(unknown);
    }
    Ok(AlikePanels { compared: others.panels.len(), alike, unusable: others.unusable })
}
