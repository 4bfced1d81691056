//! The store as the loop's record of one cycle.

use super::ports::{Finding, Record, RecordError};
use crate::cycle::{Event, Motion, Outcome};
use crate::files::write_color_jpeg;
use crate::geometry::ColorPicture;
use crate::record::{self, CycleId, Kind, Number};
use crate::store::Store;
use crate::verdict::{Reason, Verdict};
use serde_json::Value;
use std::collections::BTreeMap;

/// One cycle's pages in a store.
#[derive(Debug)]
pub struct StoreRecord<'a> {
    store: &'a mut Store,
    cycle: CycleId,
    /// Pictures that the next finding names.
    seen: Vec<record::Picture>,
    reasons: Vec<Reason>,
}

impl<'a> StoreRecord<'a> {
    /// Writes to this cycle.
    pub fn new(store: &'a mut Store, cycle: CycleId) -> Self {
        StoreRecord { store, cycle, seen: Vec::new(), reasons: Vec::new() }
    }
}

fn failed(error: impl std::error::Error + Send + Sync + 'static) -> RecordError {
    RecordError(Box::new(error))
}

impl Record for StoreRecord<'_> {
    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.store.append(event, Some(self.cycle)).map(drop).map_err(failed)
    }

    fn open_intent(&mut self, motion: &Motion) -> Result<(), RecordError> {
        self.store.open_intent(motion, Some(self.cycle)).map_err(failed)
    }

    fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), RecordError> {
        self.store.close_intent(motion, outcome, done).map_err(failed)
    }

    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
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
        self.store.note(self.cycle, &kept).map_err(failed)
    }

    fn picture(&mut self, name: &str, picture: &ColorPicture) -> Result<(), RecordError> {
        let hash = self.store.put_blob(&write_color_jpeg(picture).map_err(failed)?).map_err(failed)?;
        self.seen.push(record::Picture { caption: name.to_owned(), hash });
        Ok(())
    }

    fn conclude(&mut self, verdict: Verdict) -> Result<(), RecordError> {
        self.store.conclude(self.cycle, verdict, &self.reasons).map_err(failed)
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
