//! Recordings of cycles: the beginning is created from the files that a cycle uses, and the same files are read back
//! from a recording. `panelprep replay` runs a recorded cycle again without devices and finds the differences.

use super::args::Replay;
use super::cycle_files::{Calibrated, EARLIER_REMOVAL_TEXT, TaughtRecipe};
use super::fault::Fault;
use super::load::{self, CellFiles, LoadedPanel};
use super::output::Outcome;
use panelprep_base::geometry::Rigid;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::{
    Cell, FlangeCameraMount, Intrinsics, LensExtent, Mount, MountedPose, RemovalCalibration, RobotCorrection,
    ScannerMount, ToolMount,
};
use panelprep_cell::files::{read_flange, write_pose};
use panelprep_cell::recipe::Recipe;
use panelprep_service::daemon::{
    self, Calibrations, CellSetup, Computing, CycleSetup, LoopPorts, LoopStart, MIN_FREE_SPACE_FOR_RECORDING_MB,
    Player, RecordingPlan, RecordingResult, RecordingStatus, ReplayResult, disk_full_message, free_mb,
};
use panelprep_service::report::page::{Row, Section};
use panelprep_service::stages::removal::EarlierRemoval;
use panelprep_store::store::{TaughtCorner, TeachingInputs};
use panelprep_store::tape::{self, CheckedRecording, EntryReader};
use panelprep_toolpath::removal::model::Model;
use panelprep_vision::locate::ScanErrors;
use serde_json::json;
use std::fs::File;
use std::io::BufReader;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// Returns the first content of a recording of this cycle.
///
/// # Errors
/// If the teaching cannot be read.
pub fn plan(
    file: Option<PathBuf>,
    files: &CellFiles,
    (taught_recipe, calibrated): (&TaughtRecipe, &Calibrated),
) -> Result<RecordingPlan, Fault> {
    let teaching = files.store()?.taught(taught_recipe.recipe.panel(), Some(&taught_recipe.taught.version));
    let mut parts = texts(taught_recipe, calibrated)?;
    parts.extend(taught_parts(&teaching.map_err(Fault::stage)?.teaching));
    Ok(RecordingPlan { file, files: parts, calibrations: calibrated.values })
}

/// Checks, before anything moves, that a recording could begin in this file or, without a file, in this store.
///
/// # Errors
/// If the file exists already, its folder does not exist, or there is too little room.
pub fn check_recording_file(file: Option<&Path>, store: &Path) -> Result<(), Fault> {
    if let Some(file) = file {
        if file.exists() {
            return Err(file_exists_fault(file));
        }
        let folder = file.parent().unwrap_or(Path::new("/"));
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        if !folder.is_dir() {
            return Err(missing_folder_fault(folder));
        }
        if rustix::fs::access(folder, rustix::fs::Access::WRITE_OK | rustix::fs::Access::EXEC_OK).is_err() {
            let words = "this program's user may not write to this folder, or the systemd unit prevents it; record to another folder";
            return Err(Fault::file_fault(folder, words));
        }
    }
    let place = file.unwrap_or(store);
    let free_mb = free_mb(place).map_err(|error| Fault::file_fault(place, error))?;
    if free_mb < MIN_FREE_SPACE_FOR_RECORDING_MB {
        return Err(Fault::file_fault(place, disk_full_message(free_mb)));
    }
    Ok(())
}

/// Checks the same for a file that a command names, which this program writes with the rights of its user. The file
/// must also be outside the store, where only the program names files. The store may be made later.
///
/// # Errors
/// As [`check_recording_file`], and if the file is inside the store or is a link.
pub fn check_command_file(file: &Path, store: &Path) -> Result<(), Fault> {
    // A link is refused as an existing file, wherever it leads, and also if it leads nowhere.
    if file.symlink_metadata().is_ok() {
        return Err(file_exists_fault(file));
    }
    check_recording_file(Some(file), store)?;
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if store.exists() && is_inside_store(folder, store)? {
        return Err(refused_name(file, STORE_PATH_REFUSAL));
    }
    Ok(())
}

/// Returns whether a folder is the store or is inside it, after all links are resolved.
fn is_inside_store(folder: &Path, store: &Path) -> Result<bool, Fault> {
    let resolved = |path: &Path| path.canonicalize().map_err(|error| Fault::file_fault(path, error));
    Ok(resolved(folder)?.starts_with(resolved(store)?))
}

fn refused_name(file: &Path, words: &'static str) -> Fault {
    let shown: String =
        file.to_string_lossy().chars().flat_map(char::escape_debug).take(MAX_SHOWN_CHARACTERS).collect();
    Fault::RecordName { file: shown, words }
}

const STORE_PATH_REFUSAL: &str = "the file is inside the store, where only the service names files; name a file outside of \
                            the store, or give --record without a name to record to the store's recordings/";

/// Returns the path of a recording that a client of the service names. It must be an absolute path of a new file
/// outside the store; all links in it are resolved. So a client cannot make the service write into its store or over an
/// existing file.
///
/// # Errors
/// If the name does not meet these conditions, or its folder does not exist.
pub fn check_client_file(file: &Path, store: &Path) -> Result<PathBuf, Fault> {
    let refused = |words| refused_name(file, words);
    let Some(text) = file.to_str() else { return Err(refused("the path is not UTF-8")) };
    if text.chars().any(char::is_control) {
        return Err(refused("the path contains control characters, such as a line feed"));
    }
    if !file.is_absolute() {
        return Err(refused(
            "the path is relative, but the service runs in another folder; give the absolute path",
        ));
    }
    let is_plain = file.components().all(|part| matches!(part, Component::RootDir | Component::Normal(_)));
    let name = file.file_name().filter(|_| is_plain && !text.ends_with('/') && !text.contains("/./"));
    let (Some(name), Some(folder)) = (name, file.parent()) else {
        return Err(refused("the path contains . or .., or names a folder; give the absolute path of a new file"));
    };
    if !folder.is_dir() {
        return Err(missing_folder_fault(folder));
    }
    if is_inside_store(folder, store)? {
        return Err(refused(STORE_PATH_REFUSAL));
    }
    let folder = folder.canonicalize().map_err(|error| Fault::file_fault(folder, error))?;
    let file = folder.join(name);
    // A link is refused as an existing file, wherever it leads, and also if it leads nowhere.
    match file.symlink_metadata() {
        Ok(_) => Err(file_exists_fault(&file)),
        Err(_) => Ok(file),
    }
}

/// Maximum number of characters of a refused name that are shown.
const MAX_SHOWN_CHARACTERS: usize = 200;

/// Returns the fault to report if the disk refuses a recording in a new file.
pub fn refused(file: &Path, error: std::io::Error) -> Fault {
    match error.kind() {
        std::io::ErrorKind::AlreadyExists => file_exists_fault(file),
        _ => Fault::file_fault(file, error),
    }
}

fn missing_folder_fault(folder: &Path) -> Fault {
    let words = "this program sees no such folder; create the folder, or record to another folder (the systemd unit of the service \
                 hides home folders and gives the service a private /tmp)";
    Fault::file_fault(folder, words)
}

fn file_exists_fault(file: &Path) -> Fault {
    Fault::file_fault(file, "already exists; remove it, or record to another file")
}

/// Returns the section about the recording on a cycle's page.
pub fn section(recorded: &RecordingResult) -> Section {
    let whole = recorded.is == RecordingStatus::Whole;
    let rows = vec![
        Row::new("file", &recorded.file, ""),
        Row::new("entries", if whole { recorded.entries.to_string() } else { "not known".to_owned() }, ""),
        Row::new("can be replayed", if whole { "yes" } else { "no" }, "yes"),
    ];
    Section { heading: "Recording".to_owned(), text: recorded.message.clone(), rows, figures: vec![] }
}

const RECIPE: &str = "recipe.toml";
const CORRECTION: &str = "robot_correction.toml";
const REMOVAL: &str = "removal.toml";
const VERSION: &str = "taught/version.txt";
const SCAN: &str = "taught/scan.pcd";
const TAUGHT: [&str; 5] = [
    "taught/recipe.toml",
    "taught/scanner.toml",
    "taught/base_from_camera.toml",
    "taught/flange_camera.toml",
    "taught/flange_from_camera.toml",
];

fn corner(index: usize) -> [String; 2] {
    ["png", "json"].map(|kind| format!("taught/corner{}.{kind}", index + 1))
}

fn texts(taught_recipe: &TaughtRecipe, calibrated: &Calibrated) -> Result<Vec<(String, Vec<u8>)>, Fault> {
    let start = taught_recipe.start(calibrated)?;
    let files = start.file_texts.into_iter().map(|(name, text)| (format!("{name}.toml"), text.into_bytes()));
    let more = [(RECIPE, start.recipe_text), (VERSION, start.taught_version)];
    Ok(files.chain(more.map(|(name, text)| (name.to_owned(), text.into_bytes()))).collect())
}

fn taught_parts(teaching: &TeachingInputs) -> Vec<(String, Vec<u8>)> {
    let TeachingInputs { recipe_text, scanner_calibration_text, base_from_camera_text, .. } = teaching;
    let TeachingInputs { flange_camera_text, flange_from_camera_text, .. } = teaching;
    let texts =
        [recipe_text, scanner_calibration_text, base_from_camera_text, flange_camera_text, flange_from_camera_text];
    let texts = TAUGHT.into_iter().zip(texts).map(|(name, text)| (name.to_owned(), text.clone().into_bytes()));
    let corners = teaching.corners.iter().enumerate().flat_map(|(index, taught)| {
        let [picture, pose] = corner(index);
        [(picture, taught.picture.clone()), (pose, write_pose(&taught.base_from_flange).into_bytes())]
    });
    texts.chain([(SCAN.to_owned(), teaching.scan.clone())]).chain(corners).collect()
}

/// The files and data that a recorded cycle used.
struct RecordedCycle {
    /// The cell.
    pub cell: Cell,
    /// The recipe.
    pub recipe: Recipe,
    /// The taught panel.
    pub taught: LoadedPanel,
    /// The calibrations.
    pub calibrations: Calibrations,
    /// The area of the picture in which the flange camera's lens is calibrated.
    pub lens: LensExtent,
    /// The removal from the part by earlier cycles.
    pub removed_before: EarlierRemoval,
}

impl RecordedCycle {
    /// Reads and checks the files in a recording.
    ///
    /// # Errors
    /// If one is missing or invalid.
    pub fn read(file: &Path, checked: &CheckedRecording) -> Result<Self, Fault> {
        let parts = Parts { file, checked };
        let recipe = Recipe::check(RECIPE, parts.text(RECIPE)?)?;
        let flange_camera = parts.intrinsics("flange_camera.toml")?;
        let scanner = parts.intrinsics("scanner.toml")?;
        let calibrations = Calibrations {
            scanner: scanner.camera,
            scan_errors: ScanErrors::from_measured(scanner.errors.as_ref()),
            base_from_camera: parts.mount::<ScannerMount>("base_from_camera.toml")?,
            flange_camera: flange_camera.camera,
            flange_from_camera: parts.mount::<FlangeCameraMount>("flange_from_camera.toml")?,
            flange_from_tool: parts.mount::<ToolMount>("flange_from_tool.toml")?,
            hand_eye_mm: checked.start.hand_eye_mm,
            robot_mm: checked.start.robot_mm,
            removal: parts.removal()?,
        };
        let cell = Cell::check("cell.toml", parts.text("cell.toml")?)?;
        let cell = match checked.files.contains_key(CORRECTION) {
            true => cell.with_arm_correction(RobotCorrection::check(CORRECTION, parts.text(CORRECTION)?)?.numbers),
            false => cell,
        };
        let (taught, removed_before) = (parts.taught(&recipe, &scanner)?, parts.removed_before()?);
        Ok(RecordedCycle { cell, taught, recipe, calibrations, lens: flange_camera.extent, removed_before })
    }
}

/// The parts of a recording.
struct Parts<'a> {
    file: &'a Path,
    checked: &'a CheckedRecording,
}

impl Parts<'_> {
    fn bytes(&self, name: &str) -> Result<&[u8], Fault> {
        let missing = || Fault::file_fault(self.file, format!("the recording has no attachment \"{name}\""));
        self.checked.files.get(name).map(Vec::as_slice).ok_or_else(missing)
    }

    fn text(&self, name: &str) -> Result<&str, Fault> {
        let named = |error| Fault::file_fault(self.file, format!("attachment \"{name}\": {error}"));
        std::str::from_utf8(self.bytes(name)?).map_err(named)
    }

    /// Returns the removal from the part by earlier cycles.
    fn removed_before(&self) -> Result<EarlierRemoval, Fault> {
        let name = format!("{EARLIER_REMOVAL_TEXT}.toml");
        if !self.checked.files.contains_key(&name) {
            return Ok(EarlierRemoval::default());
        }
        toml::from_str(self.text(&name)?).map_err(|error| Fault::file_fault(self.file, error))
    }

    /// Returns the removal model of the disc, if the cell had one.
    fn removal(&self) -> Result<Option<Model>, Fault> {
        if !self.checked.files.contains_key(REMOVAL) {
            return Ok(None);
        }
        Ok(Some(Model::from(&RemovalCalibration::check(REMOVAL, self.text(REMOVAL)?)?.numbers)))
    }

    fn intrinsics(&self, name: &str) -> Result<Intrinsics, Fault> {
        Ok(Intrinsics::check(name, self.text(name)?)?)
    }

    fn mount<M: Mount>(&self, name: &str) -> Result<Rigid<M::To, M::From>, Fault> {
        Ok(MountedPose::<M>::check(name, self.text(name)?)?.rigid())
    }

    fn taught(&self, recipe: &Recipe, now: &Intrinsics) -> Result<LoadedPanel, Fault> {
        let named = |name: &str, error: &dyn std::error::Error| {
            Fault::file_fault(self.file, format!("attachment \"{name}\": {error}"))
        };
        let mut corners = Vec::new();
        for [picture, pose] in (0..).map(corner).take_while(|[picture, _]| self.checked.files.contains_key(picture))
        {
            let base_from_flange = read_flange(self.bytes(&pose)?).map_err(|error| named(&pose, &error))?;
            corners.push(TaughtCorner { picture: self.bytes(&picture)?.to_vec(), base_from_flange });
        }
        let text = |index: usize| self.text(TAUGHT[index]).map(str::to_owned);
        let teaching = TeachingInputs {
            name: recipe.panel().to_owned(),
            scan: self.bytes(SCAN)?.to_vec(),
            recipe_text: text(0)?,
            scanner_calibration_text: text(1)?,
            base_from_camera_text: text(2)?,
            corners,
            flange_camera_text: text(3)?,
            flange_from_camera_text: text(4)?,
        };
        let taught_recipe = Recipe::check(TAUGHT[0], &teaching.recipe_text)?;
        let name = |index: usize| format!("recorded corner {}", index + 1);
        load::derive(&teaching, (&taught_recipe, now), self.text(VERSION)?.to_owned(), &name)
    }
}

/// Number of differences that are shown to a person; the JSON has them all.
const MAX_SHOWN_DIFFERENCES: usize = 20;

/// Runs the recorded cycle again and reports the differences.
///
/// # Errors
/// If the recording cannot be used: it is not a recording, has a gap, has another format, or was not finished.
pub fn replay(args: &Replay) -> Result<Outcome, Fault> {
    let file = args.recording.as_path();
    let refused = |error| Fault::file_fault(file, error);
    let checked = tape::check_recording(open(file)?).map_err(refused)?;
    let recorded = RecordedCycle::read(file, &checked)?;
    let RecordedCycle { cell, recipe, taught, calibrations, lens, removed_before } = recorded;
    let cell = Arc::new(CellSetup::new(&cell).map_err(Fault::stage)?.for_replay());
    let setup = CycleSetup::new(cell.clone(), recipe, (taught.panel, taught.corners), (calibrations, lens))
        .map(|setup| setup.with_earlier_removal(removed_before));
    let cycle = Some(Arc::new(setup.map_err(Fault::stage)?));

    let start = &checked.start;
    let player = Player::new(EntryReader::new(open(file)?, start.unix_ns), start.lock_step);
    let ports = LoopPorts {
        robot: &mut player.clone(),
        tool: &mut player.clone(),
        record: &mut player.clone(),
        requests: &mut player.clone(),
        computing: Computing::inline(Box::new(player.clone()), start.lock_step),
        lock_step: start.lock_step,
    };
    let ended = daemon::run(LoopStart { cell, cycle, state: start.state, before: start.begin.clone() }, ports);
    let played = player.replay_result();
    if let Some(error) = played.error {
        return Err(refused(error));
    }
    if played.is_complete && played.differences.is_empty() {
        ended.as_ref().map_err(|error| Fault::file_fault(file, error.to_string()))?;
    }
    let verdict = ended.ok().and_then(|ended| ended.verdict);
    Ok(outcome(&checked, &played, verdict))
}

fn open(file: &Path) -> Result<BufReader<File>, Fault> {
    panelprep_base::disk::open(file).map(BufReader::new).map_err(|error| Fault::file_fault(file, error))
}

fn outcome(checked: &CheckedRecording, played: &ReplayResult, verdict: Option<Verdict>) -> Outcome {
    let same = played.is_complete && played.differences.is_empty();
    let (entries, length_s, by) = (played.entries, checked.length_s, &checked.start.program);
    let reasons = match same {
        true => vec![],
        false => vec![Reason::new(
            "differs",
            format!("the replayed cycle differs from the recording in {} places", played.differences.len()),
        )],
    };
    let judgement = Judgement { verdict: if same { Verdict::Pass } else { Verdict::Fail }, reasons };
    let mut outcome = Outcome::from_judgement(&judgement);
    // The verdict of this command is about the replay; the cycle has its own verdict.
    let word = if same { "the same as recorded" } else { "not the same as recorded" };
    outcome.lines[0] = format!("replay: {word}");
    outcome.add_value("same", json!(same));
    outcome.add_value("differences", json!(played.differences));
    outcome.add_value("to_the_end", json!(played.is_complete));
    outcome.add_value("entries", json!(entries));
    outcome.add_value("recorded_s", json!(length_s));
    outcome.add_value("recorded_by", json!(by));
    outcome.add_value("cycle_verdict", json!(verdict));
    outcome.add_line(format!(
        "{entries} of {} entries replayed, over {length_s:.1} s, recorded by panelprep {by}",
        checked.entries
    ));
    if let Some(verdict) = verdict {
        outcome.add_line(format!("the cycle's verdict: {}", verdict.keyword()));
    }
    for difference in played.differences.iter().take(MAX_SHOWN_DIFFERENCES) {
        outcome.add_line(format!("  {difference}"));
    }
    if let Some(more @ 1..) = played.differences.len().checked_sub(MAX_SHOWN_DIFFERENCES) {
        outcome.add_line(format!("  and {more} more; --json lists all of them"));
    }
    if !played.is_complete {
        outcome.add_line("the replay stopped at the point where it differs from the recording");
    }
    outcome
}
