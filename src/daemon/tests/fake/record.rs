//! A record in memory that can refuse.

use super::super::super::*;
use super::Shared;
use crate::cycle::{Event, Motion, Outcome};
use crate::geometry::ColorPicture;
use crate::phase::Phase;
use crate::record::{Budget, CycleId};
use crate::store::CycleStart;
use crate::verdict::{Reason, Verdict};
use std::sync::Arc;

pub struct Memory {
    pub(super) world: Shared,
    pub fails_at: usize,
    pub writes: usize,
    pub(super) cycles: i64,
    pub is_full: bool,
    /// So many writes find room before the disk is full; none where it has room for all.
    pub fills_at: Option<usize>,
    pub(super) lacks_room: bool,
    pub worn_mm2: f64,
    /// Each entry of the disc's wear, and whether a motion was open then.
    pub wears: Vec<(f64, bool)>,
    pub findings: Vec<Finding>,
    pub figures: Vec<String>,
    pub budget: Budget,
    pub intents: Vec<(Motion, Option<(Outcome, u32)>)>,
    pub events: Vec<Event>,
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
            budget: Budget::default(),
            intents: Vec::new(),
            events: Vec::new(),
        }
    }

    fn written(&mut self) -> Result<(), RecordError> {
        self.writes += 1;
        if self.writes >= self.fails_at { Err(RecordError("the disk is full".into())) } else { Ok(()) }
    }
}

impl Record for Memory {
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
        self.findings.push(finding.clone());
        self.written()
    }

    fn picture(&mut self, _: &str, _: &ColorPicture) -> Result<(), RecordError> {
        self.written()
    }

    fn frame(&mut self, _: &Arc<ColorPicture>, _: f64, _: Phase) -> Result<(), RecordError> {
        self.written()
    }

    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError> {
        self.figures.push(figure.name.clone());
        self.written()
    }

    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError> {
        self.budget = self.budget.renewed(*measured);
        self.written()
    }
}

impl Journal for Memory {
    fn kept(&mut self, kept: Kept) -> Result<(), RecordError> {
        if let Kept::Figure(figure) = kept {
            self.figures.push(figure.name);
        }
        self.written()
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.events.push(*event);
        self.written()
    }

    fn open_intent(&mut self, motion: &Motion) -> Result<(), RecordError> {
        let mut world = self.world.borrow_mut();
        assert!(world.open && motion.epoch == world.epoch);
        world.intent = Some(*motion);
        drop(world);
        self.intents.push((*motion, None));
        self.written()
    }

    fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), RecordError> {
        self.world.borrow_mut().intent = None;
        let open = self.intents.last_mut().expect("open");
        assert_eq!((open.0, open.1), (*motion, None));
        open.1 = Some((outcome, done));
        self.written()
    }

    fn conclude(&mut self, _: Verdict) -> Result<(), RecordError> {
        self.written()
    }

    fn begin(&mut self, _: &CycleStart) -> Result<CycleId, RecordError> {
        self.cycles += 1;
        // Another panel, dry and as greasy as the last one.
        let mut world = self.world.borrow_mut();
        (world.water_off_ms, world.rubbed, world.healed) = (0, 0, false);
        drop(world);
        self.written().map(|()| CycleId(self.cycles))
    }

    fn between_cycles(&mut self) {}

    fn disc_worn_mm2(&mut self) -> Result<f64, RecordError> {
        Ok(self.worn_mm2)
    }

    fn wear_disc(&mut self, swept_mm2: f64) -> Result<(), RecordError> {
        self.worn_mm2 += swept_mm2;
        self.wears.push((swept_mm2, self.world.borrow().intent.is_some()));
        self.written()
    }

    fn mount_disc(&mut self) -> Result<(), RecordError> {
        self.worn_mm2 = 0.0;
        self.written()
    }

    fn check(&mut self) -> Vec<Reason> {
        // Somebody makes room as soon as a check has said that there is none.
        let lacks_room = self.is_full || std::mem::take(&mut self.lacks_room);
        if lacks_room { vec![Reason::new("disk_full", "no room")] } else { vec![] }
    }

    fn filled(&mut self) -> Option<Reason> {
        self.fills_at.take_if(|at| self.writes >= *at)?;
        self.lacks_room = true;
        Some(Reason::new("disk_full", "the disk is full; delete recordings"))
    }
}
