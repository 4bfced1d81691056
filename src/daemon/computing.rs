//! Acts that see and compute, each as one piece of work that takes what it needs and gives back what it found.
//!
//! A [`Work`] owns copies of the artifacts that it reads or changes, and notes what is to be recorded instead of
//! recording it. So it may be done here, while the loop waits, or aside, on a thread of its own, while the loop goes on
//! answering; and where it was abandoned meanwhile its [`Worked`] is dropped whole: nothing of it is installed or
//! recorded. One piece of work is done at a time, in the order in which they were asked for, since they share cameras.

use super::abrasion::Abrasion;
use super::ports::{Eyes, Figure, Finding, Keeper, Kept, Record, RecordError};
use super::sight::{Filming, Sight};
use super::{CycleSetup, DaemonError, Job, Site};
use crate::cycle::{Act, Answer, Grade, Id, Trouble};
use crate::files::ClipEntry;
use crate::geometry::{ColorPicture, Frame, KukaPose, Rigid};
use crate::phase::Phase;
use crate::record::{Budget, KeptFile, Picture};
use crate::supervision::{Supervisor, supervised};
use crate::verdict::Reason;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

/// What an act needs.
#[derive(Debug)]
pub(super) struct Work {
    /// The act.
    pub id: Id,
    pub act: Act,
    /// The film so far, for its next picture.
    pub filming: Option<Box<Filming>>,
    pub sight: Sight,
    pub abrasion: Abrasion,
    /// Where the active tool stands in the active base, as far as known.
    pub tip: Option<KukaPose>,
    pub pass: u8,
}

/// What came of it.
#[derive(Debug)]
pub(super) struct Worked {
    pub id: Id,
    pub found: Result<Found, DaemonError>,
    /// Both as they are now; none where the work was lost.
    pub artifacts: Option<(Sight, Abrasion)>,
    pub notes: Vec<Note>,
}

/// The result of a piece of work.
#[derive(Debug)]
pub(super) enum Found {
    /// The act's answer.
    Answer(Answer),
    /// The film goes on.
    Filming(Box<Filming>),
    /// What a self-test found wrong.
    Wrong(Vec<(Trouble, Reason)>),
}

/// What is to be recorded.
#[derive(Debug)]
pub(super) enum Note {
    Finding(Finding),
    Picture(String, ColorPicture),
    Frame(Arc<ColorPicture>, f64, Phase),
    Figure(Figure),
    /// Packed and written already.
    Kept(Kept),
    Budget(Budget),
}

/// Notes instead of a record. Aside, pictures are packed and written at once: on the loop that would take longer than
/// its deadlines and its watchdog bear.
struct Notes<'k> {
    notes: Vec<Note>,
    keep: Option<&'k mut Keeper>,
}

impl Record for Notes<'_> {
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
        self.notes.push(Note::Finding(finding.clone()));
        Ok(())
    }

    fn picture(&mut self, name: &str, picture: &ColorPicture) -> Result<(), RecordError> {
        let name = name.to_owned();
        self.notes.push(match &mut self.keep {
            Some(keep) => match keep(picture)? {
                Some(hash) => Note::Kept(Kept::Shot(KeptFile { name, hash })),
                None => return Ok(()),
            },
            None => Note::Picture(name, picture.clone()),
        });
        Ok(())
    }

    fn frame(&mut self, picture: &Arc<ColorPicture>, time_s: f64, phase: Phase) -> Result<(), RecordError> {
        self.notes.push(match &mut self.keep {
            Some(keep) => match keep(picture)? {
                Some(file) => Note::Kept(Kept::Frame(ClipEntry { file, time_s, phase })),
                None => return Ok(()),
            },
            None => Note::Frame(picture.clone(), time_s, phase),
        });
        Ok(())
    }

    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError> {
        self.notes.push(match &mut self.keep {
            Some(keep) => {
                let Some(hash) = keep(&figure.picture)? else { return Ok(()) };
                let Figure { name, caption, .. } = figure.clone();
                Note::Kept(Kept::Figure(Picture { name, caption, hash }))
            }
            None => Note::Figure(figure.clone()),
        });
        Ok(())
    }

    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError> {
        self.notes.push(Note::Budget(*measured));
        Ok(())
    }
}

impl Work {
    /// Does it. `readable` looks at the calibrations for a self-test.
    fn perform(
        mut self,
        job: Option<&Job<'_>>,
        eyes: &mut dyn Eyes,
        readable: &mut dyn FnMut() -> Vec<Reason>,
        keep: Option<&mut Keeper>,
    ) -> Worked {
        let mut notes = Notes { notes: Vec::new(), keep };
        let found = match (self.act, job) {
            (Act::SelfTest, _) => Ok(Found::Wrong(test(eyes, readable))),
            (_, Some(job)) => self.phase(job, eyes, &mut notes),
            (_, None) => Ok(Found::Answer(Answer::Failed(Trouble::Unexpected))),
        };
        let Work { id, sight, abrasion, .. } = self;
        Worked { id, found, artifacts: Some((sight, abrasion)), notes: notes.notes }
    }

    fn phase(&mut self, job: &Job<'_>, eyes: &mut dyn Eyes, notes: &mut Notes) -> Result<Found, DaemonError> {
        let pass = self.pass;
        let answer = match (self.act, self.filming.take()) {
            (Act::Film, None) => {
                // It only looks: nothing of it is new.
                let begun = std::mem::take(&mut self.sight).film(job, pass, eyes, notes)?;
                return Ok(film(begun));
            }
            (Act::Film, Some(filming)) => {
                return Ok(film(self.sight.watch(job, *filming, pass, eyes, notes)?));
            }
            (Act::Locate, _) => self.sight.locate(job, eyes, notes)?,
            (Act::DryPicture, _) => self.sight.dry_picture(eyes, notes)?,
            (Act::Plan { pass }, _) => self.abrasion.make(job, (pass, &self.sight), notes)?,
            (Act::Refine { view }, _) => match self.tip() {
                Some(tip) => {
                    let answer = self.sight.refine(job, (view, tip), eyes, notes)?;
                    self.surveyed(job, answer, notes)?
                }
                None => Answer::Failed(Trouble::Unexpected),
            },
            (Act::Verify { view }, _) => match self.tip() {
                Some(tip) => self.sight.verify(job, (pass, view, tip), eyes, notes)?,
                None => Answer::Failed(Trouble::Unexpected),
            },
            _ => Answer::Failed(Trouble::Unexpected),
        };
        Ok(Found::Answer(answer))
    }

    /// Where the corner says that the panel's place is good: whether the arm reaches it, before it is wetted.
    fn surveyed(&mut self, job: &Job<'_>, answer: Answer, notes: &mut Notes) -> Result<Answer, DaemonError> {
        match (answer, self.sight.approach()) {
            (Answer::Graded(grade @ (Grade::Accept | Grade::Review)), Some(panel)) => {
                self.abrasion.survey(job, (self.pass, grade, &panel), notes)
            }
            (answer, _) => Ok(answer),
        }
    }

    /// Where the flange camera stands, while it is the tool and the base the robot's own.
    fn tip<To: Frame, From: Frame>(&self) -> Option<Rigid<To, From>> {
        self.tip.map(|pose| pose.to_rigid())
    }
}

fn film(filmed: Result<Filming, Answer>) -> Found {
    match filmed {
        Ok(filming) => Found::Filming(Box::new(filming)),
        Err(answer) => Found::Answer(answer),
    }
}

fn test(eyes: &mut dyn Eyes, readable: &mut dyn FnMut() -> Vec<Reason>) -> Vec<(Trouble, Reason)> {
    let blind = eyes.check().into_iter().map(|error| (Trouble::Camera, Reason::new("camera", error.to_string())));
    let unreadable = readable().into_iter().map(|reason| (Trouble::Computing, reason));
    blind.chain(unreadable).collect()
}

/// No piece of work takes so long: the table has long given up its answer, the robot stands, and whatever hangs in there
/// keeps every later act from being done.
const LONGEST_WORK: Duration = Duration::from_secs(180);

/// How far computing steps back.
pub(super) const NICE: i32 = 19;

/// Looks at the calibrations: what cannot be read, in words.
pub(super) type Readable = Box<dyn FnMut() -> Vec<Reason> + Send>;

/// Where work is done.
pub(super) enum Computing<'p> {
    /// Here: the loop waits while a result is taken.
    Here { job: &'p Job<'p>, eyes: &'p mut dyn Eyes, orders: VecDeque<Work> },
    /// On a thread of its own.
    Aside(Box<Aside>),
}

/// The thread and what it was given.
pub(super) struct Aside {
    orders: Sender<(Work, Option<Arc<CycleSetup>>)>,
    results: Receiver<Worked>,
    under_way: VecDeque<Id>,
    /// Of the first of these, once it is there.
    result: Option<Worked>,
}

impl<'p> Computing<'p> {
    pub fn here(job: &'p Job<'p>, eyes: &'p mut dyn Eyes) -> Self {
        Computing::Here { job, eyes, orders: VecDeque::new() }
    }

    /// Starts the thread, which steps back behind the loop and the robot's link where they must keep time. It ends
    /// when nobody gives orders; nobody waits for its end, since a camera may hang.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn aside(
        (mut eyes, mut readable, mut keep): (Box<dyn Eyes + Send>, Readable, Keeper),
        site: Site,
        steps_back: bool,
        supervisor: &Supervisor,
    ) -> std::io::Result<Self> {
        let (orders, taken) = mpsc::channel::<(Work, Option<Arc<CycleSetup>>)>();
        let (tell, results) = mpsc::channel();
        let (sign, watched) = supervised("computing", LONGEST_WORK);
        let serve = move || {
            // Threads that this one starts inherit it.
            if steps_back && let Err(error) = rustix::process::setpriority_process(None, NICE) {
                tracing::warn!("computing runs at the loop's priority: {error}");
            }
            for (work, task) in taken {
                sign.works();
                let job = task.as_deref().map(|task| task.job(&site));
                let worked = work.perform(job.as_ref(), &mut *eyes, &mut *readable, Some(&mut keep));
                sign.rests();
                if tell.send(worked).is_err() {
                    break;
                }
            }
            sign.done();
        };
        thread::Builder::new().name("computing".to_owned()).spawn(serve)?;
        supervisor.watch(watched);
        let aside = Aside { orders, results, under_way: VecDeque::new(), result: None };
        Ok(Computing::Aside(Box::new(aside)))
    }

    /// Has it done; `task` is what the service's cycle works by.
    pub fn submit(&mut self, work: Work, task: Option<Arc<CycleSetup>>) {
        match self {
            Computing::Here { orders, .. } => orders.push_back(work),
            Computing::Aside(aside) => {
                aside.under_way.push_back(work.id);
                // Refused only where the thread has ended, which `poll` finds out.
                let _ = aside.orders.send((work, task));
            }
        }
    }

    /// Whose result can be taken; waits so long for it.
    pub fn ready(&mut self, patience: Duration) -> Option<Id> {
        match self {
            Computing::Here { orders, .. } => orders.front().map(|work| work.id),
            Computing::Aside(aside) => aside.ready(patience),
        }
    }

    /// The result that is ready.
    pub fn take(&mut self) -> Option<Worked> {
        match self {
            Computing::Here { job, eyes, orders } => {
                // The command that runs one cycle has just read its calibrations.
                Some(orders.pop_front()?.perform(Some(job), &mut **eyes, &mut Vec::new, None))
            }
            Computing::Aside(aside) => aside.result.take(),
        }
    }
}

impl Aside {
    fn ready(&mut self, patience: Duration) -> Option<Id> {
        if self.result.is_none() {
            let id = *self.under_way.front()?;
            self.result = Some(match self.results.recv_timeout(patience) {
                Ok(worked) => worked,
                Err(RecvTimeoutError::Timeout) => return None,
                Err(RecvTimeoutError::Disconnected) => lost(id),
            });
            self.under_way.pop_front();
        }
        self.result.as_ref().map(|worked| worked.id)
    }
}

/// The thread has ended by a fault in it, which was reported where it happened.
fn lost(id: Id) -> Worked {
    let found = Ok(Found::Answer(Answer::Failed(Trouble::Computing)));
    Worked { id, found, artifacts: None, notes: vec![] }
}
