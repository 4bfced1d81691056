//! What the loop needs from outside: a robot, cameras, a record, somebody who asks.

use super::lending::LastState;
use super::request::Request;
use crate::cycle::{self, Event, Id, Motion, Outcome, Refusal, State};
use crate::devices::robot::BlockingLink;
use crate::devices::world::Follower;
use crate::eki::{Channel, Command, CommandId, Epoch, LinkLoss, MoveLin, Pace, QueueError, Report, Time};
use crate::files::ClipEntry;
use crate::geometry::{Camera, ColorPicture, OrganizedCloud};
use crate::phase::Phase;
use crate::record::{Asked, Budget, Clock, ContactPath, CycleId, EarlierPass, KeptFile, Picture};
use crate::store::CycleStart;
use crate::supervision::{ThreadFault, Watched};
use crate::tape::Begin;
use crate::verdict::{Reason, Verdict};
use std::sync::Arc;
use std::time::{Duration, Instant};

pub use crate::devices::cameras::Picture as Picture2d;
pub use crate::record::Finding;

/// The robot: commands in, reports out, and the clock that its motions run by.
pub trait Robot {
    /// Queues one command.
    ///
    /// # Errors
    /// Where there is no controller, no open epoch, or the command cannot be executed; likewise for the others.
    fn send(&mut self, command: Command) -> Result<CommandId, QueueError>;
    /// Queues a path whole, in the active base; the id of its last point comes back.
    ///
    /// # Errors
    /// As [`Robot::send`].
    fn send_path(&mut self, points: Vec<MoveLin>) -> Result<CommandId, QueueError>;
    /// The same, of which only so many points are sent before more are permitted.
    ///
    /// # Errors
    /// As [`Robot::send`].
    fn send_path_within(&mut self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError>;
    /// Lets commands up to this one be sent; all of them where it is `None`.
    ///
    /// # Errors
    /// As [`Robot::send`].
    fn permit(&mut self, last: Option<CommandId>) -> Result<(), QueueError>;
    /// Asks for a new epoch with a number above this one.
    ///
    /// # Errors
    /// As [`Robot::send`].
    fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError>;
    /// Ends the epoch.
    ///
    /// # Errors
    /// As [`Robot::send`].
    fn abort(&mut self) -> Result<(), QueueError>;
    /// The next thing to know, or `None` after a while without one. In lock step time passes only in here.
    fn next(&mut self) -> Option<Report>;
    /// Now: virtual in lock step.
    fn now(&self) -> Time;
    /// Whether time passes only in [`Robot::next`].
    fn is_lock_step(&self) -> bool;
    /// Whether what drives it still works; without that nothing is ever told again.
    ///
    /// # Errors
    /// Where its thread failed.
    fn works(&self) -> Result<(), ThreadFault> {
        Ok(())
    }
}

/// The cameras. Each call exposes once, now.
pub trait Eyes {
    /// A 3D shot.
    ///
    /// # Errors
    /// Where the camera gives none; likewise for the others.
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError>;
    /// A picture by the 3D camera's colour sensor, with when it was taken on the camera's own clock.
    ///
    /// # Errors
    /// As [`Eyes::scan`].
    fn picture(&mut self) -> Result<Picture2d, SightError>;
    /// Begins a film: such pictures one after the other, at most so many a second; gives the time on the clock of the
    /// pictures. One that is left ends by itself.
    ///
    /// # Errors
    /// As [`Eyes::scan`].
    fn begin_film(&mut self, pictures_per_second: f64) -> Result<f64, SightError>;
    /// The film's next picture; none where none is due yet. What was dropped on the way is a gap in the times.
    ///
    /// # Errors
    /// As [`Eyes::scan`].
    fn next_of_film(&mut self) -> Result<Option<Picture2d>, SightError>;
    /// Ends the film; how many of its pictures were dropped.
    ///
    /// # Errors
    /// As [`Eyes::scan`].
    fn end_film(&mut self) -> Result<u64, SightError>;
    /// A picture by the flange camera.
    ///
    /// # Errors
    /// As [`Eyes::scan`].
    fn corner_picture(&mut self) -> Result<ColorPicture, SightError>;
    /// Whether they would deliver; each that would not, with why. Exposes nothing that a cycle needs.
    fn check(&mut self) -> Vec<SightError>;
}

/// A camera that gave no picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{camera} gave no picture: {why}")]
pub struct SightError {
    /// Which camera.
    pub camera: &'static str,
    /// What it says.
    pub why: String,
}

/// A picture that is drawn for people.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Its short name, `corner_before`.
    pub name: String,
    /// What it shows.
    pub caption: String,
    /// The picture.
    pub picture: ColorPicture,
}

/// What a phase leaves. Each call returns when it is kept.
pub trait Record {
    /// What a stage found. Pictures and figures that came since the last finding are its own.
    ///
    /// # Errors
    /// Where it cannot be kept; likewise for the others.
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError>;
    /// A picture as a camera gave it.
    ///
    /// # Errors
    /// As [`Record::finding`].
    fn picture(&mut self, name: &str, picture: &ColorPicture) -> Result<(), RecordError>;
    /// The next picture of a clip, with its time; the next finding names the clip.
    ///
    /// # Errors
    /// As [`Record::finding`].
    fn frame(&mut self, picture: &Arc<ColorPicture>, time_s: f64, phase: Phase) -> Result<(), RecordError>;
    /// A picture that is drawn for people.
    ///
    /// # Errors
    /// As [`Record::finding`].
    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError>;
    /// Parts of the error at the tool that were measured now; the others stay as they are known.
    ///
    /// # Errors
    /// As [`Record::finding`].
    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError>;
}

/// A picture that was kept already; what follows is to name it.
#[derive(Debug, Clone, PartialEq)]
pub enum Kept {
    /// As a camera gave it.
    Shot(KeptFile),
    /// The next picture of a clip, named by its hash.
    Frame(ClipEntry),
    /// Drawn for people.
    Figure(Picture),
}

/// Keeps a picture, which takes longer than a loop may wait; its name in the store comes back. None where the disk is full and
/// the picture was dropped.
pub type Keeper = Box<dyn FnMut(&ColorPicture) -> Result<Option<String>, RecordError> + Send>;

/// What is remembered. Each call returns when it is on disk.
pub trait Journal: Record {
    /// A picture that is on disk already.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn kept(&mut self, kept: Kept) -> Result<(), RecordError>;
    /// One line of the journal.
    ///
    /// # Errors
    /// Where the store does not write; likewise for the others.
    fn event(&mut self, event: &Event) -> Result<(), RecordError>;
    /// A motion begins.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn open_intent(&mut self, motion: &Motion) -> Result<(), RecordError>;
    /// A contact path begins, of which so many waypoints may be sent.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn open_contact(&mut self, motion: &Motion, path: &ContactPath, permitted: u32) -> Result<(), RecordError>;
    /// So many waypoints of the contact path under way may be sent.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn permit(&mut self, waypoints: u32) -> Result<(), RecordError>;
    /// Where the tool was on this panel in earlier cycles, or may have been, as far as the part is still the same.
    ///
    /// # Errors
    /// Where it cannot be read.
    fn abraded_before(&mut self) -> Result<Vec<EarlierPass>, RecordError>;
    /// What somebody asked, with its answer. What the table was asked follows its event.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn asked(&mut self, asked: &Asked) -> Result<(), RecordError>;
    /// What the clock says: where a cycle begins, and where it is concluded.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn clock(&mut self, clock: Clock) -> Result<(), RecordError>;
    /// A motion is over: the robot stands.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), RecordError>;
    /// The cycle's result.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn conclude(&mut self, verdict: Verdict) -> Result<(), RecordError>;
    /// A cycle begins; what follows is its.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn begin(&mut self, start: &CycleStart) -> Result<CycleId, RecordError>;
    /// What follows belongs to no cycle.
    fn between_cycles(&mut self);
    /// What the disc in use has swept, mm².
    ///
    /// # Errors
    /// Where it cannot be read.
    fn disc_worn_mm2(&mut self) -> Result<f64, RecordError>;
    /// The disc in use swept so much more, mm².
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn wear_disc(&mut self, swept_mm2: f64) -> Result<(), RecordError>;
    /// A new disc was mounted.
    ///
    /// # Errors
    /// As [`Journal::event`].
    fn mount_disc(&mut self) -> Result<(), RecordError>;
    /// Whether a cycle's record would find its place; else why not.
    fn check(&mut self) -> Vec<Reason>;
    /// That the disk has filled since this was last asked: why, and what to delete. Pictures are dropped from then on; the
    /// journal goes on until the cell rests.
    fn filled(&mut self) -> Option<Reason> {
        None
    }
}

/// The store does not write. Nothing moves without it.
#[derive(Debug, thiserror::Error)]
#[error("the record cannot be written: {0}")]
pub struct RecordError(pub Box<dyn std::error::Error + Send + Sync>);

/// Where requests come from, and what is told of them. Who does not care for news leaves it.
pub trait Requests {
    /// What is requested now, seen the state. Comes back within milliseconds, whatever the loop is doing.
    ///
    /// # Errors
    /// Where a thread of the program failed: the loop stops the robot and ends.
    fn next(&mut self, state: &State) -> Result<Option<Request>, ThreadFault>;
    /// What was asked of the table is not done; of a reset that may come later.
    fn refused(&mut self, request: cycle::Request, refusal: Refusal);
    /// What was requested cannot be begun.
    fn unable(&mut self, _reasons: Vec<Reason>) {}
    /// A cycle began, with what the loop remembers from before it.
    fn begun(&mut self, _cycle: CycleId, _before: Begin) {}
    /// Whether the result of this piece of work comes to the loop now that it is there. A replay lets it in when it came.
    fn lets_in(&mut self, _result: Id) -> bool {
        true
    }
    /// A cycle has its verdict.
    fn concluded(&mut self, _verdict: Verdict) {}
    /// A film is under way: so many seconds of it were seen.
    fn filmed(&mut self, _seconds: f64) {}
    /// That a new disc was mounted is kept.
    fn disc_mounted(&mut self) {}
    /// What was found last is not as it should be for these reasons, or for none.
    fn noted(&mut self, _reasons: &[Reason]) {}
}

/// A robot at the end of a link.
pub struct LinkedRobot {
    link: BlockingLink,
    pace: Pace,
    started: Instant,
    virtual_now: Time,
    follower: Option<Follower>,
    last: LastState,
}

impl LinkedRobot {
    /// The robot behind this link, which runs at this pace.
    pub fn new(link: BlockingLink, pace: Pace) -> Self {
        LinkedRobot {
            link,
            pace,
            started: Instant::now(),
            virtual_now: Time::default(),
            follower: None,
            last: LastState::default(),
        }
    }

    /// Where the robot's last state is to be read, now and later.
    pub fn last_state(&self) -> LastState {
        self.last.clone()
    }

    /// The same with a simulated world around it, which follows what the controller tells. A controller that is no mock is
    /// reported as lost: nothing that is simulated may decide how a real arm moves.
    pub fn followed(self, follower: Follower) -> Self {
        LinkedRobot { follower: Some(follower), ..self }
    }

    /// The link's thread, for who supervises it.
    pub fn watched(&self) -> Watched {
        self.link.watched()
    }
}

/// How long the loop waits for the robot before it looks elsewhere, by the wall clock. In lock step time does not pass
/// by looking elsewhere.
const PATIENCE: Duration = Duration::from_millis(20);

impl Robot for LinkedRobot {
    fn send(&mut self, command: Command) -> Result<CommandId, QueueError> {
        self.link.send(command)
    }

    fn send_path(&mut self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        self.link.send_path(points)
    }

    fn send_path_within(&mut self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError> {
        self.link.send_path_within(points, permitted)
    }

    fn permit(&mut self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.link.permit(last)
    }

    fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        self.link.open_epoch_above(above)
    }

    fn abort(&mut self) -> Result<(), QueueError> {
        self.link.abort()
    }

    fn next(&mut self) -> Option<Report> {
        let report = self.link.next(PATIENCE);
        match &report {
            Some(Report::State(state) | Report::Connected { state }) => self.last.is(Some(state)),
            Some(Report::LinkLost { .. }) => self.last.is(None),
            _ => {}
        }
        if let Some(Report::State(state) | Report::Connected { state }) = &report {
            self.virtual_now = Time::at_ms(u64::from(state.time_ms));
            if let Some(follower) = &self.follower {
                if !Follower::may_follow(state) {
                    let problem =
                        "the cameras are simulated, and this is not a mock controller; nothing is sent to it";
                    let (channel, problem) = (Channel::State, problem.to_owned());
                    return Some(Report::LinkLost { why: LinkLoss::System { channel, problem } });
                }
                follower.hear(state);
            }
        }
        report
    }

    fn now(&self) -> Time {
        match self.pace {
            Pace::LockStep => self.virtual_now,
            Pace::Wall => Time::after_start(self.started.elapsed()),
        }
    }

    fn is_lock_step(&self) -> bool {
        self.pace == Pace::LockStep
    }

    fn works(&self) -> Result<(), ThreadFault> {
        self.link.watched().check()
    }
}
