//! The store as the loop's record of one cycle.

use super::ports::{Finding, Journal, Record, RecordError};
use crate::cycle::{Event, Motion, Outcome};
use crate::files::write_color_jpeg;
use crate::geometry::ColorPicture;
use crate::record::{self, CycleId, Kind, Number};
use crate::store::{CycleStart, Store};
use crate::verdict::{Reason, Verdict};
use serde_json::Value;
use std::collections::BTreeMap;

/// Free disk below which no cycle begins: its pictures and the journal of its worst day, MB.
const FLOOR_MB: u64 = 500;

/// A cycle's pages in a store; between cycles only the journal is written.
#[derive(Debug)]
pub struct StoreRecord<'a> {
    store: &'a mut Store,
    cycle: Option<CycleId>,
    /// Pictures that the next finding names.
    seen: Vec<record::Picture>,
    reasons: Vec<Reason>,
}

impl<'a> StoreRecord<'a> {
    /// Writes to this cycle, or to none.
    pub fn new(store: &'a mut Store, cycle: impl Into<Option<CycleId>>) -> Self {
        StoreRecord { store, cycle: cycle.into(), seen: Vec::new(), reasons: Vec::new() }
    }
}

fn failed(error: impl std::error::Error + Send + Sync + 'static) -> RecordError {
    RecordError(Box::new(error))
}

impl Journal for StoreRecord<'_> {
    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.store.append(event, self.cycle).map(drop).map_err(failed)
    }

    fn open_intent(&mut self, motion: &Motion) -> Result<(), RecordError> {
        self.store.open_intent(motion, self.cycle).map_err(failed)
    }

    fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), RecordError> {
        self.store.close_intent(motion, outcome, done).map_err(failed)
    }

    fn conclude(&mut self, verdict: Verdict) -> Result<(), RecordError> {
        self.cycle.map_or(Ok(()), |cycle| self.store.conclude(cycle, verdict, &self.reasons).map_err(failed))
    }

    fn begin(&mut self, start: &CycleStart) -> Result<CycleId, RecordError> {
        self.between_cycles();
        let cycle = self.store.begin_cycle(start).map_err(failed)?;
        self.cycle = Some(cycle);
        Ok(cycle)
    }

    fn between_cycles(&mut self) {
        self.cycle = None;
        self.seen.clear();
        self.reasons.clear();
    }

    fn check(&mut self) -> Vec<Reason> {
        match self.store.free_mb() {
            Ok(free_mb) if free_mb >= FLOOR_MB => vec![],
            Ok(free_mb) => {
                let message =
                    format!("the store's disk has {free_mb} MB left, a cycle needs {FLOOR_MB} MB; make room");
                vec![Reason::new("disk_full", message)]
            }
            Err(error) => vec![Reason::new("store", error.to_string())],
        }
    }
}

impl Record for StoreRecord<'_> {
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
        let Some(cycle) = self.cycle else { return Ok(()) };
        self.reasons.clone_from(&finding.judgement.reasons);
        let numbers = finding.numbers.as_object().into_iter().flatten();
        let (mut single, mut details) = (Vec::new(), BTreeMap::new());
        for (name, value) in numbers {
            match value {
                Value::Number(number) => single.push(Number::new(name.clone(), "", number.as_f64())),
                other => drop(details.insert(name.clone(), other.clone())),
            }
        }
        let kept = record::Finding {
            kind: kind(finding.stage),
            pass: finding.pass,
            judgement: finding.judgement.clone(),
            numbers: single,
            details,
            pictures: std::mem::take(&mut self.seen),
        };
        self.store.note(cycle, &kept).map_err(failed)
    }

    fn picture(&mut self, name: &str, picture: &ColorPicture) -> Result<(), RecordError> {
        if self.cycle.is_none() {
            return Ok(());
        }
        let hash = self.store.put_blob(&write_color_jpeg(picture).map_err(failed)?).map_err(failed)?;
        self.seen.push(record::Picture { caption: name.to_owned(), hash });
        Ok(())
    }
}

fn kind(stage: &str) -> Kind {
    match stage {
        "locate" => Kind::Locate,
        "refine" | "dry" => Kind::Refine,
        "inspect" => Kind::Inspect,
        "plan" => Kind::Plan,
        "verify" => Kind::Verify,
        // Gate and robot.
        _ => Kind::Abrade,
    }
}
