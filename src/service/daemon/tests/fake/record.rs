//! A record in memory that can refuse to write, and a source of requests that follows a script.

use super::Shared;
use crate::daemon::*;
use panelprep_base::geometry::{Base, ColorPicture, Flange, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::supervision::ThreadFault;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle;
use panelprep_cell::cycle::{At, Event, Motion, Outcome, Refusal, State};
use panelprep_cell::record::{
    Budget, Clock, ContactPath, CycleId, EarlierPass, Picture, RequestAuthor, RequestRecord, RequestSource,
};
use std::collections::VecDeque;
use std::sync::Arc;

pub struct Memory {
    pub(super) world: Shared,
    pub fails_at: usize,
    pub writes: usize,
    pub(super) cycles: i64,
    pub is_full: bool,
    /// Number of writes after which the disk is full; `None` if the disk is never full.
    pub fills_at: Option<usize>,
    pub(super) lacks_room: bool,
    pub worn_mm2: f64,
    /// Each change of the disc's wear, and whether a motion was open at that time.
    pub wears: Vec<(f64, bool)>,
    pub findings: Vec<Finding>,
    pub figures: Vec<String>,
    /// The recorded pictures with their names, each with the pose of the flange at that time.
    pub pictures: Vec<(String, ColorPicture, Rigid<Base, Flange>)>,
    /// The pictures of all films.
    pub frames: Vec<(Arc<ColorPicture>, f64, Phase)>,
    pub budget: Budget,
    pub intents: Vec<(Motion, Option<(Outcome, u32)>)>,
    pub events: Vec<Event>,
    /// Each contact path with the numbers of waypoints that were permitted on it, ordered by time.
    pub contacts: Vec<(ContactPath, Vec<u32>)>,
    pub earlier: Vec<EarlierPass>,
    pub asked: Vec<RequestRecord>,
    pub clocks: Vec<Clock>,
}

impl Memory {
    pub(super) fn default_of(world: &Shared) -> Self {
        Memory {
            world: world.clone(),
            fails_at: 0,
            writes: 0,
            cycles: 0,
            is_full: false,
            fills_at: None,
            lacks_room: false,
            worn_mm2: 0.0,
            wears: Vec::new(),
            findings: Vec::new(),
            figures: Vec::new(),
            pictures: Vec::new(),
            frames: Vec::new(),
            budget: Budget::default(),
            intents: Vec::new(),
            events: Vec::new(),
            contacts: Vec::new(),
            earlier: Vec::new(),
            asked: Vec::new(),
            clocks: Vec::new(),
        }
    }

    fn written(&mut self) -> Result<(), RecordError> {
        self.writes += 1;
        if self.writes >= self.fails_at { Err(RecordError("the disk is full".into())) } else { Ok(()) }
    }
}

impl Port<RecordCommand> for Memory {
    fn perform(&mut self, command: RecordCommand) -> Result<RecordAnswer, RecordError> {
        match command {
            RecordCommand::Note(Note::Finding(finding)) => self.findings.push(finding),
            RecordCommand::Note(Note::Figure(Figure { name, .. }))
            | RecordCommand::Note(Note::Kept(StoredPicture::Figure(Picture { name, .. }))) => {
                self.figures.push(name)
            }
            RecordCommand::Note(Note::Budget(measured)) => self.budget = self.budget.updated_by(measured),
            RecordCommand::Note(Note::Picture(name, picture)) => {
                let flange = self.world.borrow().base_from_flange;
                self.pictures.push((name, picture, flange));
            }
            RecordCommand::Note(Note::Frame(picture, time_s, phase)) => self.frames.push((picture, time_s, phase)),
            RecordCommand::Note(Note::Kept(_)) => {}
            RecordCommand::Event(event) => self.events.push(event),
            RecordCommand::OpenIntent(motion) => self.open_intent(motion),
            RecordCommand::OpenContact { motion, path, permitted } => {
                self.contacts.push((path, vec![permitted]));
                {
                    let mut world = self.world.borrow_mut();
                    (world.permitted, world.in_contact) = (permitted, 0);
                }
                self.open_intent(motion);
            }
            RecordCommand::Permit(waypoints) => {
                self.contacts.last_mut().expect("a contact path").1.push(waypoints);
                self.world.borrow_mut().permitted = waypoints;
            }
            RecordCommand::CloseIntent { motion, outcome, done } => {
                self.world.borrow_mut().intent = None;
                let open = self.intents.last_mut().expect("open");
                assert_eq!((open.0, open.1), (motion, None));
                open.1 = Some((outcome, done));
            }
            RecordCommand::AbradedBefore => return Ok(RecordAnswer::Earlier(self.earlier.clone())),
            RecordCommand::Asked(asked) => self.asked.push(asked),
            RecordCommand::Clock(clock) => self.clocks.push(clock),
            RecordCommand::Conclude { verdict, .. } => {
                return self.written().map(|()| RecordAnswer::Concluded(verdict));
            }
            RecordCommand::Begin(_) => {
                self.cycles += 1;
                // The panel of the new cycle is dry and as greasy as the last one.
                let mut world = self.world.borrow_mut();
                (world.water_off_ms, world.rubbed, world.healed) = (0, 0, false);
                drop(world);
                return self.written().map(|()| RecordAnswer::Cycle(CycleId(self.cycles)));
            }
            RecordCommand::BetweenCycles => return Ok(RecordAnswer::Done),
            RecordCommand::DiscWorn => return Ok(RecordAnswer::Worn(self.worn_mm2)),
            RecordCommand::WearDisc(swept_mm2) => {
                self.worn_mm2 += swept_mm2;
                self.wears.push((swept_mm2, self.world.borrow().intent.is_some()));
            }
            RecordCommand::MountDisc => self.worn_mm2 = 0.0,
            RecordCommand::Check => {
                // There is free space again after a check has reported that there is none.
                let lacks_room = self.is_full || std::mem::take(&mut self.lacks_room);
                let full = || vec![Reason::new("disk_full", "no room")];
                return Ok(RecordAnswer::Wrong(if lacks_room { full() } else { vec![] }));
            }
            RecordCommand::Filled => {
                let fills = self.fills_at.take_if(|at| self.writes >= *at).is_some();
                self.lacks_room |= fills;
                let full = || Reason::new("disk_full", "the disk is full; delete recordings");
                return Ok(RecordAnswer::Full(fills.then(full)));
            }
        }
        self.written().map(|()| RecordAnswer::Done)
    }
}

impl Memory {
    fn open_intent(&mut self, motion: Motion) {
        let mut world = self.world.borrow_mut();
        assert!(world.open && motion.epoch == world.epoch);
        world.intent = Some(motion);
        drop(world);
        self.intents.push((motion, None));
    }
}

/// Maximum number of iterations of the loop; a cycle needs fewer.
const MAX_ITERATIONS: usize = 200_000;

type When = Box<dyn Fn(&State) -> bool>;

/// Sends each request once, in order, when its condition is satisfied; requests to leave when nothing more can happen.
pub struct Asks {
    script: VecDeque<(When, cycle::Request)>,
    /// The request that is sent in every iteration while a cycle is running. The next field counts these requests.
    flood: Option<cycle::Request>,
    asked: usize,
    pub refusals: Vec<(cycle::Request, Refusal)>,
}

impl Asks {
    pub fn nothing() -> Self {
        Asks { script: VecDeque::new(), flood: None, asked: 0, refusals: Vec::new() }
    }

    pub fn without_end(self, request: cycle::Request) -> Self {
        Asks { flood: Some(request), ..self }
    }

    pub fn one_cycle() -> Self {
        Asks::one_cycle_by(cycle::Request::Start { max_passes: 2, max_moves: 3, dries: false })
    }

    pub fn one_cycle_by(start: cycle::Request) -> Self {
        let asks = Asks::nothing();
        let ready = |state: &State| state.facts.robot == panelprep_cell::cycle::Robot::Ready;
        asks.with(ready, cycle::Request::Reset).with(|state| state.at == At::Idle, start)
    }

    pub fn one_air_run() -> Self {
        let ready = |state: &State| state.facts.robot == panelprep_cell::cycle::Robot::Ready;
        Asks::nothing()
            .with(ready, cycle::Request::Reset)
            .with(|state| state.at == At::Idle, cycle::Request::AirRun { max_moves: 3 })
    }

    pub fn with(mut self, when: impl Fn(&State) -> bool + 'static, request: cycle::Request) -> Self {
        self.script.push_back((Box::new(when), request));
        self
    }
}

impl Requester for Asks {
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        let what = match self.script.pop_front_if(|(when, _)| when(state)) {
            Some((_, request)) => Some(RequestKind::Table(request)),
            None => match state.at {
                At::Complete { .. } | At::Aborted { .. } => Some(RequestKind::Leave),
                At::Held(_) | At::Stopped if self.script.is_empty() => Some(RequestKind::Leave),
                At::Execute(_) if self.flood.is_some() => {
                    self.asked += 1;
                    assert!(self.asked < MAX_ITERATIONS, "nothing else has its turn");
                    self.flood.map(RequestKind::Table)
                }
                _ => None,
            },
        };
        Ok(what.map(|what| Request::new(what, RequestAuthor::from_source(RequestSource::Command))))
    }

    fn on_loop_event(&mut self, news: LoopEvent) {
        if let LoopEvent::Refused(request, refusal) = news {
            self.refusals.push((request, refusal));
        }
    }
}
