//! The port of the record. Each command returns after its data are stored on the disk.

use super::port::{Command, Port};
use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud, Panel, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::{Event, Motion, Outcome};
use panelprep_cell::files::ClipEntry;
use panelprep_cell::record::{
    Budget, Clock, ContactPath, CycleId, EarlierPass, Finding, KeptFile, Picture, RequestRecord,
};
use panelprep_store::store::CycleStart;
use std::sync::Arc;

/// Stores a picture, which takes longer than the loop may wait. Returns the name of the picture in the store; `None` if
/// the disk is full and the picture was dropped.
pub type PictureStore = Box<dyn FnMut(&ColorPicture) -> Result<Option<String>, RecordError> + Send>;

/// A picture with drawings for people.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// The short name of the figure, such as `corner_before`.
    pub name: String,
    /// Caption of the figure.
    pub caption: String,
    /// The picture.
    pub picture: ColorPicture,
}

/// A partial result of a phase. Pictures and figures belong to the finding that is recorded after them.
#[derive(Debug, Clone)]
pub enum Note {
    /// The finding of a stage.
    Finding(Finding),
    /// A picture from a camera, with the name under which it is recorded.
    Picture(String, ColorPicture),
    /// The next picture of a clip, with its time, s. The next finding refers to the clip.
    Frame(Arc<ColorPicture>, f64, Phase),
    /// A figure for people.
    Figure(Figure),
    /// A picture that is already in the store.
    Kept(StoredPicture),
    /// The components of the error at the tool that were measured now; the other components keep their known values.
    Budget(Budget),
}

/// Reference to a stored picture, which is added to the next finding.
#[derive(Debug, Clone, PartialEq)]
pub enum StoredPicture {
    /// An original picture of a camera.
    Shot(KeptFile),
    /// The next picture of a clip, identified by its hash.
    Frame(ClipEntry),
    /// Drawn for people.
    Figure(Picture),
}

/// The commands to the record.
#[derive(Debug)]
pub enum RecordCommand {
    /// Records the result of a phase.
    Note(Note),
    /// Writes one line of the journal.
    Event(Event),
    /// Opens a motion.
    OpenIntent(Motion),
    /// Opens a contact path, and permits its first waypoints.
    OpenContact {
        /// The motion.
        motion: Motion,
        /// The grids that the path will touch, and the wear of the disc that it will cause.
        path: ContactPath,
        /// The number of waypoints that may be sent now.
        permitted: u32,
    },
    /// Sets the number of permitted waypoints of the contact path in progress.
    Permit(u32),
    /// Records the end of a motion; the robot is stationary.
    CloseIntent {
        /// The motion.
        motion: Motion,
        /// Outcome of the motion.
        outcome: Outcome,
        /// Number of executed waypoints.
        done: u32,
    },
    /// Requests the places where the tool touched this panel in earlier cycles, or may have touched it, if the part is
    /// still the same.
    AbradedBefore,
    /// Records a request with its reply. A request to the state table is recorded after the event that it causes.
    Asked(RequestRecord),
    /// Records the time of the clock, when a cycle begins and when it is concluded.
    Clock(Clock),
    /// Records the end of the cycle according to the state table, and the reasons if it was ended early.
    Conclude {
        /// The table's verdict.
        verdict: Verdict,
        /// The reasons for the verdict.
        because: Vec<Reason>,
    },
    /// Begins a cycle; the following commands belong to this cycle.
    Begin(CycleStart),
    /// Ends the assignment to a cycle; the following commands belong to no cycle.
    BetweenCycles,
    /// Requests the area that the present disc has swept, mm².
    DiscWorn,
    /// Adds this area, mm², to the area that the present disc has swept.
    WearDisc(f64),
    /// Records that a new disc was mounted.
    MountDisc,
    /// Checks whether the disk has space for the record of a cycle; if not, the answer contains the reason.
    Check,
    /// Checks whether the disk has become full since the last check; the answer contains the reason, and what to
    /// delete. After that, pictures are dropped; the journal continues until the cell is idle.
    Filled,
}

/// The answers of the record.
#[derive(Debug)]
pub enum RecordAnswer {
    /// Answer to commands that only store data: the data are stored.
    Done,
    /// Answer to `Begin`.
    Cycle(CycleId),
    /// Answer to `Conclude`: the recorded verdict, which is never better than the findings.
    Concluded(Verdict),
    /// Answer to `DiscWorn`, mm².
    Worn(f64),
    /// Answer to `AbradedBefore`.
    Earlier(Vec<EarlierPass>),
    /// Answer to `Check`.
    Wrong(Vec<Reason>),
    /// Answer to `Filled`.
    Full(Option<Reason>),
}

impl Command for RecordCommand {
    type Answer = Result<RecordAnswer, RecordError>;
}

/// Error: the store cannot be written. Without the store, no motion is permitted.
#[derive(Debug, thiserror::Error)]
#[error("the record of the cycle cannot be written: {0}")]
pub struct RecordError(pub Box<dyn std::error::Error + Send + Sync>);

impl RecordError {
    /// Returns the error for an answer to a different command; no port gives such an answer.
    fn mismatch_error<T>() -> Result<T, Self> {
        Err(RecordError("internal fault: the answer of the record does not match the command; report this".into()))
    }
}

/// The commands of the record as functions. They fail if the record cannot be written or read.
pub trait RecordPort: Port<RecordCommand> {
    /// Performs a command whose answer only confirms that its data are stored.
    fn perform_and_forget(&mut self, command: RecordCommand) -> Result<(), RecordError> {
        self.perform(command).map(drop)
    }

    /// Returns the places where the tool touched this panel in earlier cycles.
    fn earlier_abrasions(&mut self) -> Result<Vec<EarlierPass>, RecordError> {
        let known = self.perform(RecordCommand::AbradedBefore)?;
        let RecordAnswer::Earlier(earlier) = known else { return RecordError::mismatch_error() };
        Ok(earlier)
    }

    /// Begins a cycle.
    fn begin(&mut self, start: CycleStart) -> Result<CycleId, RecordError> {
        let begun = self.perform(RecordCommand::Begin(start))?;
        let RecordAnswer::Cycle(cycle) = begun else { return RecordError::mismatch_error() };
        Ok(cycle)
    }

    /// Records the end of a cycle; returns the recorded verdict.
    fn conclude(&mut self, verdict: Verdict, because: Vec<Reason>) -> Result<Verdict, RecordError> {
        let kept = self.perform(RecordCommand::Conclude { verdict, because })?;
        let RecordAnswer::Concluded(kept) = kept else { return RecordError::mismatch_error() };
        Ok(kept)
    }

    /// Returns the area that the present disc has swept, mm².
    fn disc_worn_mm2(&mut self) -> Result<f64, RecordError> {
        let worn = self.perform(RecordCommand::DiscWorn)?;
        let RecordAnswer::Worn(worn_mm2) = worn else { return RecordError::mismatch_error() };
        Ok(worn_mm2)
    }

    /// Returns the reasons why the disk has no space for the record of a cycle; empty if there is space.
    fn disk_space_problems(&mut self) -> Vec<Reason> {
        match self.perform(RecordCommand::Check) {
            Ok(RecordAnswer::Wrong(reasons)) => reasons,
            Ok(_) => vec![],
            Err(error) => vec![Reason::new("store", error.to_string())],
        }
    }

    /// Returns a reason if the disk has become full since the last check.
    fn disk_full_reason(&mut self) -> Option<Reason> {
        let Ok(RecordAnswer::Full(why)) = self.perform(RecordCommand::Filled) else { return None };
        why
    }
}

impl<P: Port<RecordCommand> + ?Sized> RecordPort for P {}

/// The interface through which a phase stores its results. Each function returns after the data are stored, and fails
/// if they cannot be stored.
pub trait Record {
    /// Stores a note.
    fn record_note(&mut self, note: Note) -> Result<(), RecordError>;

    /// Shows a scan in which the panel was found in the live view; the scan is not recorded.
    fn show_scan(&mut self, _scan: &OrganizedCloud<Camera>, _panel_from_camera: &Rigid<Panel, Camera>) {}

    /// See [`Note::Finding`].
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
        self.record_note(Note::Finding(finding.clone()))
    }

    /// See [`Note::Picture`].
    fn picture(&mut self, name: &str, picture: &ColorPicture) -> Result<(), RecordError> {
        self.record_note(Note::Picture(name.to_owned(), picture.clone()))
    }

    /// See [`Note::Frame`].
    fn frame(&mut self, picture: &Arc<ColorPicture>, time_s: f64, phase: Phase) -> Result<(), RecordError> {
        self.record_note(Note::Frame(picture.clone(), time_s, phase))
    }

    /// See [`Note::Figure`].
    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError> {
        self.record_note(Note::Figure(figure.clone()))
    }

    /// See [`Note::Budget`].
    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError> {
        self.record_note(Note::Budget(*measured))
    }
}
