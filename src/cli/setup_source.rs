//! Provides the set-up for the operator's page, which shows and changes it: recipes in a folder, and the
//! calibrations with their age.

use super::args::{Common, Doctor};
use super::calibrate::now_unix_s;
use super::fault::Fault;
use super::load::{self, CellFiles};
use super::{disk, doctor, health};
use panelprep_base::config::Problems;
use panelprep_base::geometry::ColorPicture;
use panelprep_base::number_text::{fixed_decimals, utc_day};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cell::PartRules;
use panelprep_cell::files;
use panelprep_cell::recipe::Recipe;
use panelprep_service::check::{self, FileReport};
use panelprep_service::daemon::{Equipment, ExaminedItem, OfficeStatus, PushStatus, RecipeText, SetupSource};
use panelprep_store::office::RecipeOffer;
use panelprep_store::store::{Store, free_mb};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const DAY_S: i64 = 86_400;
/// The kind of a recipe's file, as `panelprep check` calls it.
const RECIPE: &str = "recipe";

/// The status of the transfers of records out of the cell.
#[derive(Debug, Clone, Default)]
pub struct RecordTransfers {
    /// State of the transfer to the office.
    pub office: OfficeStatus,
    /// Transfers to the quality system.
    pub push: PushStatus,
}

/// The folder of recipes, and the cell's files.
pub struct FolderSource {
    /// The folder.
    pub recipes: PathBuf,
    /// The cell's files.
    pub files: Arc<CellFiles>,
    /// The arguments common to all commands.
    pub common: Common,
    /// The status of the transfer of records.
    pub record_transfers: RecordTransfers,
}

impl FolderSource {
    /// Creates the source with the recipes' folder that the cell's file names.
    pub fn new(files: &Arc<CellFiles>, common: &Common, on_their_way: &RecordTransfers) -> Self {
        let recipes = files.cell.page().recipes.clone();
        FolderSource {
            recipes,
            files: files.clone(),
            common: common.clone(),
            record_transfers: on_their_way.clone(),
        }
    }

    /// Returns the file of a recipe of the folder; any other name is refused.
    fn recipe_file(&self, name: &str) -> Result<PathBuf, String> {
        match self.recipes()?.iter().any(|known| known == name) {
            true => Ok(self.recipes.join(name)),
            false => Err(format!("there is no recipe \"{}\" in {}", name.escape_debug(), self.recipes.display())),
        }
    }
}

impl SetupSource for FolderSource {
    fn recipes(&self) -> Result<Vec<String>, String> {
        let failed = |error: std::io::Error| format!("{}: {error}", self.recipes.display());
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&self.recipes).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let Ok(name) = entry.file_name().into_string() else { continue };
            if name.ends_with(".toml") && entry.path().is_file() && is_recipe(&entry.path()) {
                names.push(name);
            }
        }
        names.sort();
        Ok(names)
    }

    fn recipe(&self, name: &str) -> Result<RecipeText, String> {
        let file = self.recipe_file(name)?;
        let text = disk::read_text(&file).map_err(|fault| fault.to_string())?;
        Ok(RecipeText { name: file.display().to_string(), text })
    }

    fn recipe_offer(&self, name: &str) -> Result<Option<RecipeOffer>, String> {
        let RecipeText { name, text } = self.recipe(name)?;
        // The problems of the recipe are reported next to it.
        let Ok(recipe) = Recipe::check(&name, &text) else { return Ok(None) };
        Ok(self.record_transfers.office.recipe_offer(recipe.panel()).filter(|offer| offer.text != text))
    }

    fn problems(&self, name: &str, text: &str) -> Vec<String> {
        let FileReport { kind, problems: list, .. } = check::check_file(name, text);
        let problems = Problems { file: name.to_owned(), list }.to_string();
        let mut problems: Vec<String> = problems.lines().map(str::to_owned).collect();
        if let Some(other) = kind.filter(|kind| *kind != RECIPE) {
            problems.push(format!("the text is not a recipe but a file of the kind {other}"));
        }
        problems
    }

    fn not_taught(&self, name: &str, text: &str) -> Option<String> {
        let recipe = Recipe::check(name, text).ok()?;
        load::teaching_of(&self.files, Path::new(name), &recipe).err().map(|fault| fault.to_string())
    }

    fn save(&self, name: &str, text: &str) -> Result<Option<String>, String> {
        let file = self.recipe_file(name)?;
        let problems = self.problems(name, text);
        if !problems.is_empty() {
            return Err(problems.join("\n"));
        }
        let former = disk::read_text(&file).ok();
        disk::write_durable(&file, text).map_err(|fault| fault.to_string())?;
        Ok(former)
    }

    fn taught_picture(&self, name: &str) -> Result<ColorPicture, String> {
        let RecipeText { name, text } = self.recipe(name)?;
        let recipe = Recipe::check(&name, &text).map_err(|problems| problems.to_string())?;
        let store = self.files.store().map_err(|fault| fault.to_string())?;
        let taught = store.taught(recipe.panel(), None).map_err(|error| error.to_string())?;
        let scan = files::read_any_cloud(&taught.teaching.scan, None).map_err(|error| error.to_string())?;
        Ok(scan.picture())
    }

    fn cycle_obstacles(&self) -> Vec<Reason> {
        let unreadable = |fault: Fault| vec![Reason::new("calibration", fault.to_string())];
        let verified = health::judge(&self.files).map(|judged| judged.reasons).unwrap_or_else(unreadable);
        let ending = health::expiring_verifications(&self.files).unwrap_or_default();
        let store = self.files.store_folder();
        let room =
            free_mb(store).ok().and_then(|free_mb| doctor::low_disk_space(&store.display().to_string(), free_mb));
        let RecordTransfers { office, push } = &self.record_transfers;
        let now_unix_ms = now_unix_s() * 1_000;
        let office = self.files.cell.office().map(|it| office.reasons(it.alarm_delay_min, now_unix_ms));
        let push = self.files.cell.push().map(|it| push.reasons(it.alarm_delay_min, now_unix_ms));
        let behind = office.into_iter().chain(push).flatten();
        room.into_iter().chain(verified).chain(ending).chain(behind).collect()
    }

    fn examine_cell(&self) -> Vec<ExaminedItem> {
        let checks = doctor::run_checks(&Doctor { kuka: None, accept: false, warm_up: false }, &self.common);
        let examined = checks.into_iter().map(|check| ExaminedItem {
            is_right: check.is_passed(),
            name: check.name,
            found: check.found,
            advice: check.advice,
        });
        examined.collect()
    }

    fn part_rules(&self) -> PartRules {
        self.files.cell.part().clone()
    }

    fn list_equipment(&self) -> Result<(Verdict, Vec<String>, Vec<Equipment>), String> {
        let judged = health::judge(&self.files).map_err(|fault| fault.to_string())?;
        let reasons = judged.reasons.iter().map(|reason| format!("{} ({})", reason.message, reason.code)).collect();
        let store = self.files.store().map_err(|fault| fault.to_string())?;
        let named = self.files.cell.calibration().named_files();
        let equipment = named.into_iter().map(|(name, file)| {
            let made = std::fs::metadata(file).and_then(|found| found.modified()).ok();
            let made_s =
                made.and_then(|at| at.duration_since(std::time::UNIX_EPOCH).ok()).map(|at| at.as_secs() as i64);
            let calibration = match made_s {
                Some(at_s) => format!("{}, file of {}", file.display(), describe_age(at_s)),
                None => format!("{}: is missing", file.display()),
            };
            Equipment { name: name.replace('_', " "), calibration, verification: verification(&store, name) }
        });
        Ok((judged.verdict, reasons, equipment.collect()))
    }
}

/// Returns whether a file is a recipe by its content: other files of the same folder are the cell's and its
/// calibrations.
fn is_recipe(file: &Path) -> bool {
    disk::read_text(file).is_ok_and(|text| check::check_file("", &text).kind == Some(RECIPE))
}

fn describe_age(at_unix_s: i64) -> String {
    let days = (now_unix_s() - at_unix_s).div_euclid(DAY_S);
    format!("{}, {days} days ago", utc_day(at_unix_s))
}

/// Describes the last verification of a calibration; only both cameras and the tool are verified.
fn verification(store: &Store, calibration: &str) -> String {
    let subject = match calibration {
        "scanner" | "flange_camera" => calibration,
        "base_from_camera" => "scanner",
        "flange_from_camera" => "flange_camera",
        "flange_from_tool" => "tool",
        _ => return "–".to_owned(),
    };
    match store.newest_verification(subject) {
        Ok(Some(last)) => {
            let [error, limit] = [last.error, last.limit].map(|mm| fixed_decimals(mm, 3));
            format!("{error} mm (limit {limit} mm), {}", describe_age(last.at_unix_s))
        }
        Ok(None) => "never".to_owned(),
        Err(error) => error.to_string(),
    }
}
