//! Errors that are injected while a world runs, to check that the world detects them: requirements that the controller
//! does not satisfy, changed limits of the connection, writes that are not flushed or not made, and commands that do
//! not reach the robot. Each represents a change of the product's source with the same effect.

use panelprep::cycle::Report;
use panelprep::daemon::{Note, RecordCommand, RobotCommand};
use panelprep::devices::mock::Rule;
use panelprep::eki::{Command, LinkLimits, Signal};
use std::path::Path;
use std::time::Duration;

/// A mistake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sabotage {
    /// The controller does not follow this rule.
    Controller(Rule),
    /// The client's watchdog waits for this multiple of its time.
    Patience(u32),
    /// The client sends far more commands ahead than permitted.
    Window,
    /// Data written to these files is not flushed.
    NoFlush(Files),
    /// This part of the record is acknowledged but not written.
    NotWritten(Row),
    /// Contact waypoints are sent before the record permits them.
    Unpermitted,
    /// An abort does not reach the connection.
    NoAbort,
    /// A command that switches this output off is omitted.
    StaysOn(u16),
    /// A command that switches the lens shutter on is omitted.
    LensStaysOpen,
    /// A new epoch may have a number that an earlier process used.
    OldEpoch,
    /// The controller moves at another override, and neither reports it nor reacts to it.
    HidesOverride,
    /// After a jog, the axis positions from before the jog are reported.
    HidesJogs,
    /// A contact path is saved without the grids that it touches.
    NoGrids,
    /// A restored store does not state that it is restored.
    UnmarkedRestore,
    /// A decision of a second screen does not contain the step that the screen shows.
    NoStep,
}

/// The files whose flush is omitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Files {
    Head,
    Log,
    Blobs,
    BlobsFolder,
    Database,
    Everything,
}

/// The rows that are not written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Row {
    Event,
    Progress,
    Verdict,
    Finding,
    Asked,
    Intent,
    Close,
}

/// Each injected error with its description.
pub const ALL: [(&str, Sabotage); 36] = [
    ("the controller takes commands of ended epochs", Sabotage::Controller(Rule::EpochCheck)),
    ("the controller has no watchdog", Sabotage::Controller(Rule::Watchdog)),
    ("the controller continues without its link", Sabotage::Controller(Rule::LinkLoss)),
    ("a stop discards nothing", Sabotage::Controller(Rule::Discard)),
    ("a stop in contact does not retract", Sabotage::Controller(Rule::Retract)),
    ("outputs do not go off by themselves", Sabotage::Controller(Rule::OutputsOff)),
    ("the controller takes any jump of its epoch", Sabotage::Controller(Rule::EpochStep)),
    ("the client's watchdog × 4", Sabotage::Patience(4)),
    ("the client has no watchdog", Sabotage::Patience(9_000)),
    ("the window is a minute and 1,000 commands", Sabotage::Window),
    ("the head is not flushed", Sabotage::NoFlush(Files::Head)),
    ("the database's log is not flushed", Sabotage::NoFlush(Files::Log)),
    ("blobs are not flushed", Sabotage::NoFlush(Files::Blobs)),
    ("the blobs' folder is not flushed", Sabotage::NoFlush(Files::BlobsFolder)),
    ("the database's file is not flushed", Sabotage::NoFlush(Files::Database)),
    ("nothing is flushed", Sabotage::NoFlush(Files::Everything)),
    ("events are not written", Sabotage::NotWritten(Row::Event)),
    ("progress is not written", Sabotage::NotWritten(Row::Progress)),
    ("verdicts are not written", Sabotage::NotWritten(Row::Verdict)),
    ("findings are not written", Sabotage::NotWritten(Row::Finding)),
    ("requests are not written", Sabotage::NotWritten(Row::Asked)),
    ("motions are not opened in the store", Sabotage::NotWritten(Row::Intent)),
    ("motions are not closed in the store", Sabotage::NotWritten(Row::Close)),
    ("contact before it is permitted", Sabotage::Unpermitted),
    ("aborts are not sent", Sabotage::NoAbort),
    ("the tool is not switched off", Sabotage::StaysOn(5)),
    ("the water is not switched off", Sabotage::StaysOn(2)),
    ("the light is not switched off", Sabotage::StaysOn(1)),
    ("the extraction is not switched off", Sabotage::StaysOn(4)),
    ("the lens is not shut", Sabotage::LensStaysOpen),
    ("an old epoch is used again", Sabotage::OldEpoch),
    ("the controller does not mind its override", Sabotage::HidesOverride),
    ("a jog is not told", Sabotage::HidesJogs),
    ("a contact path does not say where it touches", Sabotage::NoGrids),
    ("a restored store is taken for the one it replaces", Sabotage::UnmarkedRestore),
    ("a decision carries no step", Sabotage::NoStep),
];

impl Sabotage {
    /// Returns the limits of the connection with the injected error.
    pub fn limits(self, limits: LinkLimits) -> LinkLimits {
        match self {
            Sabotage::Patience(times) => LinkLimits { watchdog: limits.watchdog * times, ..limits },
            Sabotage::Window => LinkLimits { window: Duration::from_secs(60), window_commands: 1_000, ..limits },
            _ => limits,
        }
    }

    /// Returns whether flushing this file or folder does nothing.
    pub fn forgets_flush(self, path: &Path, is_folder: bool) -> bool {
        let Sabotage::NoFlush(files) = self else { return false };
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let in_blobs = path.parent().is_some_and(|parent| parent.ends_with("blobs"));
        match files {
            Files::Head => name == "panelprep.head",
            Files::Log => name.ends_with("-wal"),
            Files::Blobs => in_blobs && !is_folder,
            Files::BlobsFolder => name == "blobs",
            Files::Database => name == "panelprep.sqlite",
            Files::Everything => true,
        }
    }

    /// Returns whether this command is acknowledged and not written.
    pub fn skips(self, command: &RecordCommand) -> bool {
        use panelprep::cycle::Event::Reported;
        let Sabotage::NotWritten(row) = self else { return false };
        match row {
            Row::Event => matches!(command, RecordCommand::Event(_)),
            Row::Progress => matches!(command, RecordCommand::Event(Reported(Report::Progress { .. }))),
            Row::Verdict => matches!(command, RecordCommand::Conclude { .. }),
            Row::Finding => matches!(command, RecordCommand::Note(Note::Finding(_))),
            Row::Asked => matches!(command, RecordCommand::Asked(_)),
            Row::Intent => matches!(command, RecordCommand::OpenIntent(_) | RecordCommand::OpenContact { .. }),
            Row::Close => matches!(command, RecordCommand::CloseIntent { .. }),
        }
    }

    /// Returns the changed command for the robot; `None` if the command is omitted.
    pub fn command(self, command: RobotCommand) -> Option<RobotCommand> {
        let switched = |number, on| RobotCommand::Send(Command::SetDigout(Signal { number, on }));
        match (self, command) {
            (Sabotage::NoAbort, RobotCommand::Abort) => None,
            (Sabotage::Unpermitted, RobotCommand::Path { points, .. }) => {
                Some(RobotCommand::Path { points, permitted: None })
            }
            (Sabotage::StaysOn(output), RobotCommand::Send(Command::SetDigout(Signal { number, on: false })))
                if number == output =>
            {
                Some(switched(output, true))
            }
            (Sabotage::LensStaysOpen, RobotCommand::Send(Command::SetDigout(Signal { number: 3, on: true }))) => {
                Some(switched(3, false))
            }
            (Sabotage::OldEpoch, RobotCommand::OpenEpoch(_)) => {
                Some(RobotCommand::OpenEpoch(panelprep::eki::Epoch(0)))
            }
            (_, command) => Some(command),
        }
    }
}
