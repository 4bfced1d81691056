//! What stops a command, in words, and the one place where errors of all modules meet.

use crate::daemon::DaemonError;
use crate::requirements::{Purpose, Unmet};
use std::error::Error;
use std::path::{Path, PathBuf};

/// Why a command could not do its work: bad input, or a disk that refuses. Exit code 2, where nothing else is said.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Controller's files and cell's file that mean other ports.
    #[error(
        "{}: CELLCMD.xml and CELLSTAT.xml listen on ports {files}, the cell's file says {cells}; make both the same: PORT in the \
         files, command_port and state_port in [robot]", folder.display()
    )]
    OtherPorts {
        /// The folder of the controller's files.
        folder: PathBuf,
        /// Their ports.
        files: String,
        /// The cell's ports.
        cells: String,
    },
    /// A file is not what it must be.
    #[error("{}: {cause}", file.display())]
    File {
        /// The file as the user named it.
        file: PathBuf,
        /// What is wrong with it.
        cause: Box<dyn Error + Send + Sync>,
    },
    /// A configuration file has problems; each stands with its line.
    #[error(transparent)]
    Configuration(#[from] crate::config::Problems),
    /// The cell's file names no such calibration.
    #[error("{}: [calibration] {key} is missing; this command needs it: name the file that holds it", cell.display())]
    NotCalibrated {
        /// The cell's file.
        cell: PathBuf,
        /// The key.
        key: &'static str,
    },
    /// A mount that was measured with another correction of the arm than the cell's, or with none.
    #[error(
        "{}: was measured with {} and the cell's file names {}: poses of the robot would be corrected twice or not at all; \
         calibrate it again with the correction in use, or name in [calibration] robot_correction the one that it was measured with",
        file.display(), correction_words(found.as_deref()), correction_words(ours.as_deref())
    )]
    OtherCorrection {
        /// The mount's file.
        file: PathBuf,
        /// The hash in it.
        found: Option<String>,
        /// The hash of the cell's.
        ours: Option<String>,
    },
    /// Nothing simulated has the fault.
    #[error("--tool-fault needs [tool] kind \"simulated\" and the robot kind \"mock\" in the cell's file")]
    NoToolThatFails,
    /// The arm's errors are simulated by the mock in this program alone.
    #[error("--arm-error-mm needs the robot kind \"mock\": a controller in another process has an arm of its own")]
    ArmErrorInRehearsal,
    /// The correction's file is not the one that was read.
    #[error(
        "{}: the file of [calibration] robot_correction has changed since this program read it; start it again", cell.display()
    )]
    CorrectionChanged {
        /// The cell's file.
        cell: PathBuf,
    },
    /// The cell's file names a calibration that is not there.
    #[error(
        "{}: [calibration] {key} names {}, which is not there; {}", cell.display(), file.display(), super::load::CALIBRATION_ADVICE
    )]
    CalibrationAway {
        /// The cell's file.
        cell: PathBuf,
        /// The key.
        key: &'static str,
        /// The calibration's file.
        file: PathBuf,
    },
    /// The cell's file does not say what the command needs.
    #[error("{}", each(cell, *purpose, unmet))]
    Unmet {
        /// The cell's file.
        cell: PathBuf,
        /// What is to be done.
        purpose: Purpose,
        /// What it does not say.
        unmet: Vec<Unmet>,
    },
    /// The tool has a point and no axis.
    #[error(
        "{file}: the tool's axis was not measured (axis_measured is not true); a pad that is not flat grinds an edge: \
         run `panelprep calibrate tcp` with [[axis]], or with [[plate]] and [[flat]]"
    )]
    NoAxis {
        /// The tool's file.
        file: String,
    },
    /// A program ended while a motion was under way.
    #[error(
        "a motion is open in the store: a program ended while the robot moved, and nothing moves before a person has \
         looked; look at the cell, jog the pad off the panel where it touches, then run `panelprep clear --cell {}`",
        cell.display()
    )]
    MotionOpen {
        /// The cell's file.
        cell: PathBuf,
    },
    /// The last cycle was aborted.
    #[error(
        "the last cycle in this store was aborted and nobody has said that the cause is gone; look at the cell, then run \
         `panelprep clear --cell {}`", cell.display()
    )]
    NotCleared {
        /// The cell's file.
        cell: PathBuf,
    },
    /// Something in the store is not what was written there.
    #[error(
        "something in the store is not what this program wrote there: `panelprep store verify` names it; nothing moves before a \
         person has looked at the cell and run `panelprep clear --cell {}`", cell.display()
    )]
    StoreChanged {
        /// The cell's file.
        cell: PathBuf,
    },
    /// There is nothing to teach by.
    #[error("there is no scan to teach by: name it, --scan FILE, or take it now, --live DIR")]
    NoScan,
    /// The terminal is closed.
    #[error(
        "nobody answers at the terminal: what was taken so far is in the folder of --live, and can be named by --scan, --corner and --flange"
    )]
    NobodyAnswers,
    /// The controller's axis angles are no numbers.
    #[error("the controller reports axis angles that are no numbers: nothing can be said of where the flange is")]
    NoAxes,
    /// No message has this code.
    #[error("no message has the code {found}{}; `panelprep explain` lists all codes", nearest.as_ref().map_or(String::new(), |nearest| format!(": did you mean {nearest}?")))]
    NoSuchCode {
        /// As it was typed.
        found: String,
        /// The one that is most like it.
        nearest: Option<String>,
    },
    /// A date of a search is none.
    #[error("{option}: {cause}")]
    Date {
        /// The option.
        option: &'static str,
        /// What is wrong with it.
        cause: crate::history::DateError,
    },
    /// Conditions of a search beside something else that is asked of the history.
    #[error(
        "conditions such as --part belong to the search, `panelprep history` without another word; leave them out here"
    )]
    SearchBesideTask,
    /// No cycle was about this panel.
    #[error("no cycle in this store was about a panel {panel}; {}", panels_words(panels))]
    NoCyclesOf {
        /// The panel as it was named.
        panel: String,
        /// Those that cycles were about.
        panels: Vec<String>,
    },
    /// No cycle has a number of this name.
    #[error(
        "no cycle of panel {panel} has a number {found}{}; write a word of this list: {}; or the name of a check as the page of a \
         cycle has it, in quotes",
        nearest.as_ref().map_or(String::new(), |nearest| format!(": did you mean {nearest}?")), words.join(", ")
    )]
    NoSuchNumber {
        /// As it was typed.
        found: String,
        /// The panel.
        panel: String,
        /// The one that is most like it.
        nearest: Option<String>,
        /// The words of those that have one.
        words: Vec<&'static str>,
    },
    /// A tool, or a touch, without poses.
    #[error("there are no poses: name their file, or read them from the controller with --live DIR")]
    NoPoses,
    /// A live calibration without a camera.
    #[error("--live takes pictures: name the camera, --camera scanner or --camera flange-camera")]
    NoLiveCamera,
    /// A board that is not simulated.
    #[error("the simulated cell has chessboards alone: --board COLUMNSxROWS with --square-mm")]
    NoSimulatedBoard,
    /// A film would be written over another one.
    #[error("{} holds a film already, clip.csv or 00001.png; name another folder", folder.display())]
    ClipIsThere {
        /// The folder.
        folder: PathBuf,
    },
    /// A folder without a clip.
    #[error(
        "{}: there is no clip.csv; a clip is a folder of numbered pictures with a clip.csv that says when each was taken, as `panelprep \
         shoot film` writes it", folder.display()
    )]
    NoClip {
        /// The folder.
        folder: PathBuf,
    },
    /// A clip of a set that nobody labelled.
    #[error(
        "{}: it has no labels, neither mask.png in its folder truth nor beside its pictures; mark what broke with `panelprep label --clip {}`",
        clip.display(), clip.display()
    )]
    NoLabels {
        /// The clip's folder.
        clip: PathBuf,
    },
    /// Labels that cannot be read.
    #[error("{}: {cause}; move it away to begin anew", file.display())]
    BadLabels {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        cause: crate::labels::FormError,
    },
    /// A person labelled another clip, or this one before it was changed.
    #[error(
        "{}: these labels were made for other pictures than those of {}; look at each break again with `panelprep label --clip {}`",
        labels.display(), clip.display(), clip.display()
    )]
    OtherClip {
        /// The labels' file.
        labels: PathBuf,
        /// The clip's folder.
        clip: PathBuf,
    },
    /// A mask would be written over a person's.
    #[error(
        "{}: holds the labels of a person, and the mask of this inspection would replace theirs; name another folder for --pictures",
        folder.display()
    )]
    HoldsLabels {
        /// The folder.
        folder: PathBuf,
    },
    /// No picture of a film would be wet, and no test could look at it.
    #[error("--wet-from-s is {wet_from_s} and the film lasts {seconds} s; allowed is 0 to {seconds}")]
    NeverWet {
        /// As asked for.
        wet_from_s: f64,
        /// The film's length.
        seconds: f64,
    },
    /// A simulated camera without a simulated world.
    #[error("a camera is simulated and there is no simulated world that it could look at")]
    NoWorld,
    /// A force without a tool that has one.
    #[error("the cell's [tool] is a spring: it has no force to be verified")]
    NoCompliantTool,
    /// A readings file without a reading.
    #[error("the file has no [[readings]]")]
    NoReadings,
    /// A simulated tool without a simulated world.
    #[error(
        "[tool] kind = \"simulated\" and there is no simulated world that it could press on: nothing that is simulated may decide how a \
         real arm moves"
    )]
    NoWorldForTool,
    /// A flange camera that this program cannot open.
    #[error(
        "[flange_camera] kind = \"gige\": this program was built without the cargo feature gige; use one that was built with \
         it; without, \"simulated\" and \"recorded\" are allowed"
    )]
    BuiltWithoutGige,
    /// A camera that was not told how to take a shot.
    #[error(
        "[scanner] {key} is missing; kind = \"zivid\" needs it to take a shot: name the file that Zivid Studio saved \
         (settings for 3D shots with colour, settings_2d for pictures)"
    )]
    NoCameraSettings {
        /// The key.
        key: &'static str,
    },
    /// Cameras that are not the ones in use.
    #[error(
        "a camera's settings, or the serial number or size in its calibration, have changed since the service started, and it \
         takes shots by those of then; restart it"
    )]
    CamerasChanged,
    /// A calibration that no simulated scanner fits.
    #[error(
        "the scanner's calibration is for {}×{} px, which the simulated scanner does not deliver; the nearest is {}×{} \
         px: render the cell's files with `panelprep render`", found_px[0], found_px[1], nearest_px[0], nearest_px[1]
    )]
    NoSuchSimulatedSize {
        /// In the calibration.
        found_px: [usize; 2],
        /// The nearest that is delivered.
        nearest_px: [usize; 2],
    },
    /// A simulated controller proves nothing of a real one.
    #[error(
        "[robot] kind is \"mock\": there is no controller to prove anything on; set kind = \"eki\" and host in the cell's file (to try \
         the command, run panelprep mock-robot and set host = \"127.0.0.1\")"
    )]
    NothingToProve,
    /// A pose on the command line that is none.
    #[error("\"{found}\" is no {what}: {problem}")]
    NotSix {
        /// What was given.
        found: String,
        /// What it should be.
        what: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// Nobody listens.
    #[error(
        "{}: no service answers; start `panelprep run` with the same --cell and --store (or `systemctl start panelprep`), \
         then try again", socket.display()
    )]
    NoService {
        /// The socket.
        socket: PathBuf,
    },
    /// Options that do not go together.
    #[error("{found} --corner and {flanges} --flange: each corner picture needs the flange's pose at that picture")]
    CornerWithoutFlange {
        /// Corner pictures named.
        found: usize,
        /// Flange poses named.
        flanges: usize,
    },
    /// Corner pictures that show no corner: all of them.
    #[error("{}", .0.join("; "))]
    Corners(Vec<String>),
    /// No corner picture for a cell that runs cycles.
    #[error(
        "a cycle of this cell looks at taught corners before each contact, and no corner picture was given: name one or, better, \
         two with --corner FILE --flange POSE.json each (a cell without [calibration] flange_camera needs none)"
    )]
    NoCorner,
    /// More corner pictures than corners were taught.
    #[error("{found} corner pictures, but {taught} corners were taught of this panel; teach them with --corner")]
    CornersNotTaught {
        /// Pictures named.
        found: usize,
        /// Corners taught.
        taught: usize,
    },
    /// The recipe is not the one that was taught.
    #[error(
        "{}: [{table}] differs from the recipe with which panel \"{panel}\" was taught (version {version}); \
         teach it again or take the change back", recipe.display()
    )]
    TaughtOtherwise {
        /// The recipe's file.
        recipe: PathBuf,
        /// The table that differs.
        table: &'static str,
        /// The panel.
        panel: String,
        /// Its taught version.
        version: String,
    },
    /// A corner picture in the store that measures nothing.
    #[error("the corner picture {number} that was taught: {cause}; then teach the panel again with it")]
    TaughtCorner {
        /// Which, from 1.
        number: usize,
        /// What is wrong with it.
        cause: String,
    },
    /// A grid that the region does not have.
    #[error("grid {grid} is not in the region of {rows} rows and {columns} columns, r1c1 to r{rows}c{columns}")]
    NoSuchGrid {
        /// The grid asked for.
        grid: String,
        /// Rows of the region.
        rows: usize,
        /// Columns of the region.
        columns: usize,
    },
    /// A folder that holds other things.
    #[error("{}: is not empty and was not written by `panelprep render`; name a new folder", folder.display())]
    NotOurs {
        /// The folder.
        folder: PathBuf,
    },
    /// A part that may not be abraded any more.
    #[error(
        "the part {serial} was abraded in as many passes as [process] max_passes_per_part allows, {most}: {history}; take it \
         out, and let the inspector decide about it with the pages of these cycles"
    )]
    PartUsedUp {
        /// Its serial number.
        serial: String,
        /// How many passes are allowed.
        most: usize,
        /// Which cycles, and how many passes in each.
        history: String,
    },
    /// A cycle whose record nobody signed yet.
    #[error(
        "cycle {cycle} is not signed: it is not over, or its signing failed; `panelprep store verify` tells more"
    )]
    NotSigned {
        /// The cycle.
        cycle: i64,
    },
    /// Nothing to verify with.
    #[error(
        "no public key to verify with ({problem}): name the cell's with --public-key FILE; `panelprep record export` writes it"
    )]
    NoPublicKey {
        /// Why the cell's own store has none.
        problem: String,
    },
    /// A name of the part that cannot be kept as it stands.
    #[error("{option} \"{found}\": {problem}; name it as it is to stand on the cycle's page")]
    PartName {
        /// The option.
        option: &'static str,
        /// What was given.
        found: String,
        /// What is wrong.
        problem: String,
    },
    /// The demonstration's page for others.
    #[error(
        "{address}: the demonstration has accounts with known passwords, so that its page is for this computer alone; name an address such as 127.0.0.1:8090"
    )]
    DemoPage {
        /// As asked for.
        address: std::net::SocketAddr,
    },
    /// An account of the operator's page.
    #[error("account {name}: {problem}")]
    Account {
        /// Its name.
        name: String,
        /// What is wrong.
        problem: String,
    },
    /// The cycle that was waited for is not the service's last one any more.
    #[error("{} was waited for, and the service runs {}; look at the cycle's page", shown(*waited_for), shown(*found))]
    OtherCycle {
        /// The one that was begun.
        waited_for: Option<i64>,
        /// The service's last one.
        found: Option<i64>,
    },
    /// A recording where a client may not have one written.
    #[error("--record \"{file}\": {words}")]
    RecordName {
        /// The name, with what cannot be printed as escapes.
        file: String,
        /// What is wrong with it, and what is allowed.
        words: &'static str,
    },
    /// A new file would be written over another one.
    #[error("{} is there already and is not written over; name another file with --out, or move it away", file.display())]
    IsThere {
        /// The file.
        file: PathBuf,
    },
    /// A question that nobody answered.
    #[error("{question} has no answer: give {option}, or --yes to take what is proposed")]
    NoAnswer {
        /// What was asked.
        question: String,
        /// The option that answers it.
        option: &'static str,
    },
    /// An answer that cannot be taken.
    #[error("{option} \"{found}\": {problem}")]
    BadAnswer {
        /// The option.
        option: &'static str,
        /// What was given.
        found: String,
        /// What is wrong, and what is allowed.
        problem: String,
    },
    /// A thread of the program failed. Exit code 3.
    #[error(transparent)]
    Broken(#[from] crate::supervision::ThreadFault),
    /// A stage refused its input, in its own words.
    #[error(transparent)]
    Stage(Box<dyn Error + Send + Sync>),
}

/// A line for each thing that is missing.
fn each(cell: &Path, purpose: Purpose, unmet: &[Unmet]) -> String {
    let line = |Unmet { key, message }: &Unmet| {
        format!("{}: {key}: {message} ({} need it)", cell.display(), purpose.commands())
    };
    unmet.iter().map(line).collect::<Vec<_>>().join("\n")
}

impl Fault {
    /// The code by which a command ends, and the word for scripts.
    pub fn code(&self) -> (u8, &'static str) {
        match self {
            Fault::Broken(_) => (3, "program_fault"),
            _ => (2, "bad_input"),
        }
    }

    /// What is wrong with this file.
    pub fn file(file: &Path, cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Fault::File { file: file.to_owned(), cause: cause.into() }
    }

    /// Why the loop had to end.
    pub fn of_loop(error: DaemonError) -> Self {
        match error {
            DaemonError::Broken(fault) => Fault::Broken(fault),
            other => Fault::stage(other),
        }
    }

    /// What a stage says.
    pub fn stage(cause: impl Error + Send + Sync + 'static) -> Self {
        Fault::Stage(Box::new(cause))
    }
}

fn shown(cycle: Option<i64>) -> String {
    cycle.map_or("no cycle".to_owned(), |cycle| format!("cycle {cycle}"))
}

fn panels_words(panels: &[String]) -> String {
    match panels {
        [] => "it has no cycles at all".to_owned(),
        _ => format!("its cycles are about {}", panels.join(", ")),
    }
}

fn correction_words(hash: Option<&str>) -> String {
    match hash {
        None => "no correction of the arm".to_owned(),
        Some(hash) => format!("the correction of the arm {}", hash.get(..12).unwrap_or(hash)),
    }
}
