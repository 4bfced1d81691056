//! The store as the loop's record of one cycle.

use super::ports::{Figure, Finding, Record, RecordError};
use super::words::cause;
use crate::cycle::{Event, Motion, Outcome};
use crate::files::write_color_jpeg;
use crate::geometry::ColorPicture;
use crate::record::{Budget, CycleId, KeptFile, Picture};
use crate::store::Store;
use crate::verdict::{Reason, Verdict};

/// One cycle's pages in a store.
#[derive(Debug)]
pub struct StoreRecord<'a> {
    store: &'a mut Store,
    cycle: CycleId,
    budget: Budget,
    /// What the next finding names.
    pictures: Vec<Picture>,
    shots: Vec<KeptFile>,
    /// Of the last finding.
    reasons: Vec<Reason>,
    /// The last event that can end a cycle without a result.
    cause: Option<Reason>,
}

impl<'a> StoreRecord<'a> {
    /// Writes to this cycle.
    pub fn new(store: &'a mut Store, cycle: CycleId) -> Self {
        let (pictures, shots, reasons) = (Vec::new(), Vec::new(), Vec::new());
        StoreRecord { store, cycle, budget: Budget::default(), pictures, shots, reasons, cause: None }
    }

    fn keep(&self, picture: &ColorPicture) -> Result<String, RecordError> {
        self.store.put_blob(&write_color_jpeg(picture).map_err(failed)?).map_err(failed)
    }
}

fn failed(error: impl std::error::Error + Send + Sync + 'static) -> RecordError {
    RecordError(Box::new(error))
}

impl Record for StoreRecord<'_> {
    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.cause = cause(event).or(self.cause.take());
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
        let pictures = std::mem::take(&mut self.pictures);
        let shots = std::mem::take(&mut self.shots);
        self.store.note(self.cycle, &Finding { pictures, shots, ..finding.clone() }).map_err(failed)
    }

    fn picture(&mut self, name: &str, picture: &ColorPicture) -> Result<(), RecordError> {
        let hash = self.keep(picture)?;
        self.shots.push(KeptFile { name: name.to_owned(), hash });
        Ok(())
    }

    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError> {
        let hash = self.keep(&figure.picture)?;
        let Figure { name, caption, .. } = figure;
        self.pictures.push(Picture { name: name.clone(), caption: caption.clone(), hash });
        Ok(())
    }

    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError> {
        self.budget = self.budget.renewed(*measured);
        self.store.set_budget(self.cycle, &self.budget).map_err(failed)
    }

    fn conclude(&mut self, verdict: Verdict) -> Result<(), RecordError> {
        let aborted = verdict == Verdict::Aborted;
        let cause = self.cause.iter().filter(|_| aborted);
        let reasons: Vec<Reason> = self.reasons.iter().chain(cause).cloned().collect();
        self.store.conclude(self.cycle, verdict, &reasons).map_err(failed)
    }
}
