//! The connections of the service to people and other programs: the operator's page, the quality system and a line,
//! with their shared parts; `plant` has the others.
//!
//! The operator's page shows and changes the set-up: recipes in a folder, and the calibrations with their age. It also
//! shows the pages of cycles, and accepts signatures on them.

use super::args::{Common, Doctor};
use super::calibrate::now_unix_s;
use super::fault::Fault;
use super::identify::{ProposalLimits, propose};
use super::load::{self, CellFiles};
use super::plant::{self, OfficeStatus, PlantConnections};
use super::report::{self, StoredCycle};
use super::{cycle_files, disk, doctor, record};
use panelprep_base::config::Problems;
use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud};
use panelprep_base::number_text::{fixed_decimals, utc_day};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cell::PartRules;
use panelprep_cell::files;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::CycleId;
use panelprep_service::check::{self, FileReport};
use panelprep_service::daemon::{
    AccountService, Alarms, Equipment, ExaminedItem, Gateway, InterfaceContext, LineFront, LineParts, LinkedRobot,
    LiveView, OperatorPage, PageError, PageParts, PushParts, PushSender, PushStatus, RecipeProposal, RecipeText,
    RecordPdf, RecordSource, SetupSource,
};
use panelprep_store::office::RecipeOffer;
use panelprep_store::store::{PersonSigningRequest, Store, free_mb};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The parts that all interfaces share.
pub struct SharedInterfaceParts {
    parts: InterfaceContext,
    record_transfers: RecordTransfers,
}

impl SharedInterfaceParts {
    /// Creates the shared parts for a cell with these files.
    pub fn new((files, common): (&Arc<CellFiles>, &Common), gateway: Gateway) -> Self {
        let record_transfers = RecordTransfers::default();
        let people = Arc::new(AccountService::new(files.store_folder().to_owned()));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let setup = Arc::new(FolderSource::new(files, common, &record_transfers));
        SharedInterfaceParts { parts: InterfaceContext { gateway, people, alarms, setup }, record_transfers }
    }
}

/// Connects the cell to the systems of a plant that its file names.
///
/// # Errors
/// If a connection cannot be started, or the program was built without these systems.
pub fn plant_connections(files: &CellFiles, fronts: &SharedInterfaceParts) -> Result<PlantConnections, Fault> {
    plant::connect(files, &fronts.parts, &fronts.record_transfers.office)
}

/// Sends signed records to the quality system, if the cell's file names one.
///
/// # Errors
/// If the sender cannot be started.
pub fn push_sender(files: &Arc<CellFiles>, fronts: &SharedInterfaceParts) -> Result<Option<PushSender>, Fault> {
    let Some(push) = files.cell.push().cloned() else { return Ok(None) };
    tracing::info!("signed records are uploaded to URLs below {}", push.target_folder);
    let (folder, records) = (files.store_folder().to_owned(), Arc::new(StoreRecords(files.clone())));
    let parts = PushParts { push, folder, records, status: fronts.record_transfers.push.clone() };
    PushSender::start(parts).map(Some).map_err(Fault::stage)
}

/// Watches the line through its digital signals, if the cell's file has a line.
///
/// # Errors
/// If the operating system cannot start a thread.
pub fn line_front(
    files: &CellFiles,
    fronts: &SharedInterfaceParts,
    robot: &LinkedRobot,
) -> Result<Option<LineFront>, Fault> {
    let (Some(line), Some(inputs)) =
        (files.cell.line().cloned(), LineParts::input_bits(files.cell.inputs_outputs()))
    else {
        return Ok(None);
    };
    tracing::info!("the line's signals request cycles with the recipe {}", line.recipe.display());
    let (last, outputs) = (robot.last_state(), robot.line());
    let (gateway, people) = (fronts.parts.gateway.clone(), fronts.parts.people.clone());
    LineFront::serve(LineParts { line, inputs, last, outputs, gateway, people }).map(Some).map_err(Fault::stage)
}

/// Serves the operator's page, if the cell's file names an address for it.
///
/// # Errors
/// If the server cannot be started. If its certificate or its texts are missing, there is no page, which raises an
/// alarm.
pub fn operator_page(
    files: &Arc<CellFiles>,
    fronts: &SharedInterfaceParts,
    view: LiveView,
) -> Result<Option<OperatorPage>, Fault> {
    let parts = PageParts {
        page: files.cell.page().clone(),
        folder: files.store_folder().to_owned(),
        front: fronts.parts.clone(),
        view,
        records: Arc::new(StoreRecords(files.clone())),
    };
    let page = match OperatorPage::serve(parts) {
        Ok(page) => page,
        // The cell can still be stopped and queried through its socket.
        Err(error @ PageError::File(_)) => {
            fronts.parts.alarms.set_connection_problem("the operator's page", Some(&error.to_string()));
            tracing::warn!("{error}; the cell works without the operator's page until the service is restarted");
            None
        }
        Err(error) => return Err(Fault::stage(error)),
    };
    if let Some(page) = &page {
        tracing::info!("operator's page: {}", page.url);
        if let Some(fingerprint) = &page.fingerprint {
            tracing::info!("SHA-256 of the page's self-signed certificate: {fingerprint}");
        }
    }
    Ok(page)
}

const DAY_S: i64 = 86_400;
/// The kind of a recipe's file, as `panelprep check` calls it.
const RECIPE: &str = "recipe";

/// The status of the transfers of records out of the cell.
#[derive(Debug, Clone, Default)]
struct RecordTransfers {
    /// State of the transfer to the office.
    pub office: OfficeStatus,
    /// Transfers to the quality system.
    pub push: PushStatus,
}

/// The folder of recipes, and the cell's files.
struct FolderSource {
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
    pub fn new(files: &Arc<CellFiles>, common: &Common, record_transfers: &RecordTransfers) -> Self {
        let recipes = files.cell.page().recipes.clone();
        FolderSource {
            recipes,
            files: files.clone(),
            common: common.clone(),
            record_transfers: record_transfers.clone(),
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

    fn propose_recipe(&self, scan: OrganizedCloud<Camera>, serial: Option<&str>) -> Result<RecipeProposal, String> {
        let limits = ProposalLimits { serial, ..ProposalLimits::default() };
        let proposal = propose(&self.files, scan, &limits).map_err(|fault| fault.to_string())?;
        let (panel, file) = proposal.startable.unzip();
        let recipe = file.and_then(|file| Some(file.file_name()?.to_str()?.to_owned()));
        Ok(RecipeProposal { panel: panel.unwrap_or_default(), recipe, reasons: proposal.reasons })
    }

    fn cycle_obstacles(&self) -> Vec<Reason> {
        let unreadable = |fault: Fault| vec![Reason::new("calibration", fault.to_string())];
        let verified =
            cycle_files::judge_health(&self.files).map(|judged| judged.reasons).unwrap_or_else(unreadable);
        let ending = cycle_files::expiring_verifications(&self.files).unwrap_or_default();
        let store = self.files.store_folder();
        let room = free_mb(store)
            .ok()
            .and_then(|free_mb| doctor::check_low_disk_space(&store.display().to_string(), free_mb));
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
        let judged = cycle_files::judge_health(&self.files).map_err(|fault| fault.to_string())?;
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

/// The cycles of a cell's store.
struct StoreRecords(pub Arc<CellFiles>);

impl RecordSource for StoreRecords {
    fn page(&self, cycle: CycleId) -> Result<String, String> {
        let files = &self.0;
        let page = report::page_file(files.store_folder(), cycle);
        // An existing page also contains the result of the recording.
        if let Ok(text) = disk::read_text(&page) {
            return Ok(text);
        }
        let made = files.store().and_then(|store| StoredCycle::read(&store, cycle));
        made.map(|kept| kept.html(None, vec![])).map_err(|fault| fault.to_string())
    }

    fn pdf(&self, cycle: CycleId) -> Result<Option<RecordPdf>, String> {
        let made = || {
            let (store, key) = (self.0.store()?, record::key(&self.0)?);
            let rows = store.cycle_signatures(cycle).map_err(Fault::stage)?;
            record::signed_pdf(&store, &key, &rows)
        };
        made().map_err(|fault| fault.to_string())
    }

    fn sign(&self, signs: &PersonSigningRequest) -> Result<u64, String> {
        record::sign_by_person(&self.0, signs).map(|row| row.number).map_err(|fault| fault.to_string())
    }
}
