//! Writes the loop's data to the store.

use super::ports::{
    Figure, Finding, Note, PictureStore, Port, RecordAnswer, RecordCommand, RecordError, StoredPicture,
};
use crate::setup::MIN_FREE_SPACE_MB;
use panelprep_base::geometry::ColorPicture;
use panelprep_base::phase::Phase;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::Event;
use panelprep_cell::files::{Clip, ClipEntry, write_color_jpeg};
use panelprep_cell::record::{Budget, CycleId, KeptFile, Picture, RequestRecord, RequestedAction};
use panelprep_store::store::{Store, StoreError};
use rayon::prelude::*;
use std::sync::Arc;

/// Number of pictures of a clip that are compressed at the same time.
const BATCH_PICTURES: usize = 8;

/// Writes the record of a cycle into a store; between cycles, only the journal is written.
#[derive(Debug)]
pub struct StoreRecord<'a> {
    store: &'a mut Store,
    cycle: Option<CycleId>,
    /// The position of the last request in the journal, until the reply to it is recorded.
    line: Option<RequestPosition>,
    pages: Pages,
    is_full_reported: bool,
}

/// The position of a request in the journal.
#[derive(Debug, Clone, Copy)]
struct RequestPosition {
    line: u64,
    cycle: Option<CycleId>,
    /// Number of findings of the cycle when the request arrived; the request may cause further findings before the
    /// reply to it is recorded.
    findings: u64,
}

/// The data of the cycle that are not yet written to the store.
#[derive(Debug, Default)]
struct Pages {
    budget: Budget,
    /// The pictures that belong to the next finding.
    pictures: Vec<Picture>,
    shots: Vec<KeptFile>,
    /// The pictures of the clip so far, identified by their hashes. `waiting` contains the last ones, which are not
    /// stored yet.
    clip: Vec<ClipEntry>,
    waiting: Vec<(Arc<ColorPicture>, f64, Phase)>,
    /// Number of findings of the cycle so far.
    findings: u64,
}

impl<'a> StoreRecord<'a> {
    /// Creates a record that writes to this cycle, or to no cycle.
    pub fn new(store: &'a mut Store, cycle: impl Into<Option<CycleId>>) -> Self {
        StoreRecord { store, cycle: cycle.into(), line: None, pages: Pages::default(), is_full_reported: false }
    }

    /// Stores a picture; returns `None` if the disk is full.
    fn store_picture(&self, picture: &ColorPicture) -> Result<Option<String>, RecordError> {
        self.store.store_picture(&write_color_jpeg(picture).map_err(record_error)?).map_err(record_error)
    }

    /// Stores the waiting pictures of the clip, which are compressed in parallel.
    fn store_waiting_pictures(&mut self) -> Result<(), RecordError> {
        let waiting = std::mem::take(&mut self.pages.waiting);
        let compressed: Vec<_> = waiting.par_iter().map(|(picture, ..)| write_color_jpeg(picture)).collect();
        for ((_, time_s, phase), jpeg) in waiting.into_iter().zip(compressed) {
            let file = self.store.store_picture(&jpeg.map_err(record_error)?).map_err(record_error)?;
            self.pages.clip.extend(file.map(|file| ClipEntry { file, time_s, phase }));
        }
        Ok(())
    }

    /// Ends the clip: stores the list of its pictures, and names the list like a picture. A clip without a wet picture
    /// is not stored.
    fn store_clip(&mut self) -> Result<(), RecordError> {
        self.store_waiting_pictures()?;
        let entries = std::mem::take(&mut self.pages.clip);
        if let Ok(clip) = Clip::new(entries) {
            let hash = self.store.store_picture(clip.to_csv().as_bytes()).map_err(record_error)?;
            let name = format!("clip.csv of {} pictures", clip.entries().len());
            self.pages.shots.extend(hash.map(|hash| KeptFile { name, hash }));
        }
        Ok(())
    }
}

/// Returns a function that stores pictures in this store from any thread.
///
/// # Errors
/// If the store is open only for reading.
pub fn picture_store(store: &Store) -> Result<PictureStore, StoreError> {
    let writer = store.blob_writer()?;
    Ok(Box::new(move |picture| {
        writer.store_picture(&write_color_jpeg(picture).map_err(record_error)?).map_err(record_error)
    }))
}

/// Returns the reason for a full disk, with the files that can be deleted and the space that is needed.
fn disk_full_reason(store: &Store) -> Reason {
    Reason::new(
        "disk_full",
        format!("{}; a cycle needs {MIN_FREE_SPACE_MB} MB of free space", store.disk_full_error()),
    )
}

fn record_error(error: impl std::error::Error + Send + Sync + 'static) -> RecordError {
    RecordError(Box::new(error))
}

impl Port<RecordCommand> for StoreRecord<'_> {
    fn perform(&mut self, command: RecordCommand) -> Result<RecordAnswer, RecordError> {
        let cycle = self.cycle;
        match command {
            RecordCommand::Note(note) => self.store_note(note)?,
            RecordCommand::Event(event) => self.event(event)?,
            RecordCommand::OpenIntent(motion) => self.store.open_intent(&motion, cycle).map_err(record_error)?,
            RecordCommand::OpenContact { motion, path, permitted } => {
                self.store.open_contact(&motion, cycle, (&path, permitted)).map_err(record_error)?;
            }
            RecordCommand::Permit(waypoints) => self.store.store_permit(waypoints).map_err(record_error)?,
            RecordCommand::CloseIntent { motion, outcome, done } => {
                self.store.close_intent(&motion, outcome, done).map_err(record_error)?;
            }
            RecordCommand::AbradedBefore => {
                let earlier = cycle.map_or(Ok(Vec::new()), |cycle| self.store.earlier_abrasions(cycle));
                return Ok(RecordAnswer::Earlier(earlier.map_err(record_error)?));
            }
            RecordCommand::Asked(asked) => self.store_request(&asked)?,
            RecordCommand::Clock(clock) => {
                cycle.map_or(Ok(()), |cycle| self.store.store_clock(cycle, clock)).map_err(record_error)?;
            }
            RecordCommand::Conclude { verdict, because } => return self.conclude(verdict, &because),
            RecordCommand::Begin(start) => {
                self.end_cycle_record();
                let cycle = self.store.begin_cycle(&start).map_err(record_error)?;
                self.cycle = Some(cycle);
                return Ok(RecordAnswer::Cycle(cycle));
            }
            RecordCommand::BetweenCycles => self.end_cycle_record(),
            RecordCommand::DiscWorn => {
                return Ok(RecordAnswer::Worn(self.store.disc_worn_mm2().map_err(record_error)?));
            }
            RecordCommand::WearDisc(swept_mm2) => self.store.wear_disc(cycle, swept_mm2).map_err(record_error)?,
            RecordCommand::MountDisc => self.store.mount_disc().map_err(record_error)?,
            RecordCommand::Check => return Ok(RecordAnswer::Wrong(self.disk_space_problems())),
            RecordCommand::Filled => return Ok(RecordAnswer::Full(self.disk_full_reason())),
        }
        Ok(RecordAnswer::Done)
    }
}

impl StoreRecord<'_> {
    fn store_note(&mut self, note: Note) -> Result<(), RecordError> {
        match note {
            Note::Finding(finding) => self.finding(finding),
            Note::Picture(name, picture) => self.picture(name, &picture),
            Note::Frame(picture, time_s, phase) => self.frame(picture, time_s, phase),
            Note::Figure(figure) => self.figure(figure),
            Note::Budget(measured) => self.budget(measured),
            Note::Kept(kept) => {
                self.name(kept);
                Ok(())
            }
        }
    }

    fn finding(&mut self, finding: Finding) -> Result<(), RecordError> {
        let Some(cycle) = self.cycle else { return Ok(()) };
        // A finding refers to the pictures before it; therefore they must be in the store before the finding is
        // written.
        self.store_clip()?;
        let (pictures, shots) = (std::mem::take(&mut self.pages.pictures), std::mem::take(&mut self.pages.shots));
        let mut kept = Finding { pictures, shots, ..finding };
        // A value that is not a finite number is recorded as not measured, so that a failed fit does not prevent the
        // record of its rejection.
        let dropped = self.store.dropped_pictures();
        if dropped > 0 {
            kept.details.insert("pictures_not_kept_since_the_disk_was_full".to_owned(), dropped.into());
        }
        kept.checks.iter_mut().for_each(|number| number.value = number.value.filter(|value| value.is_finite()));
        self.store.store_finding(cycle, &kept).map_err(record_error)?;
        self.pages.findings += 1;
        Ok(())
    }

    fn picture(&mut self, name: String, picture: &ColorPicture) -> Result<(), RecordError> {
        if self.cycle.is_some() {
            let hash = self.store_picture(picture)?;
            self.pages.shots.extend(hash.map(|hash| KeptFile { name, hash }));
        }
        Ok(())
    }

    fn frame(&mut self, picture: Arc<ColorPicture>, time_s: f64, phase: Phase) -> Result<(), RecordError> {
        if self.cycle.is_some() {
            self.pages.waiting.push((picture, time_s, phase));
            // The pictures are stored in batches: compressing one picture after the other is slower than the camera,
            // and the pictures of a whole clip do not fit into memory.
            if self.pages.waiting.len() >= BATCH_PICTURES {
                self.store_waiting_pictures()?;
            }
        }
        Ok(())
    }

    fn figure(&mut self, figure: Figure) -> Result<(), RecordError> {
        if self.cycle.is_some() {
            let hash = self.store_picture(&figure.picture)?;
            let Figure { name, caption, .. } = figure;
            self.pages.pictures.extend(hash.map(|hash| Picture { name, caption, hash }));
        }
        Ok(())
    }

    fn budget(&mut self, measured: Budget) -> Result<(), RecordError> {
        let Some(cycle) = self.cycle else { return Ok(()) };
        self.pages.budget = self.pages.budget.updated_by(measured.without_non_finite());
        self.store.set_budget(cycle, &self.pages.budget).map_err(record_error)
    }

    fn name(&mut self, kept: StoredPicture) {
        match kept {
            StoredPicture::Shot(shot) => self.pages.shots.push(shot),
            StoredPicture::Frame(frame) => self.pages.clip.push(frame),
            StoredPicture::Figure(figure) => self.pages.pictures.push(figure),
        }
    }

    fn event(&mut self, event: Event) -> Result<(), RecordError> {
        let line = self.store.append(&event, self.cycle).map_err(record_error)?;
        if matches!(event, Event::Asked(_)) {
            self.line = Some(RequestPosition { line, cycle: self.cycle, findings: self.pages.findings });
        }
        Ok(())
    }

    fn store_request(&mut self, asked: &RequestRecord) -> Result<(), RecordError> {
        let line = self.line.take().filter(|_| matches!(asked.wanted, RequestedAction::For(_)));
        let (cycle, findings) = line.map_or((self.cycle, self.pages.findings), |line| (line.cycle, line.findings));
        let asked = RequestRecord { findings: cycle.map(|_| findings), ..asked.clone() };
        self.store.store_request(&asked, cycle, line.map(|line| line.line)).map_err(record_error)
    }

    fn conclude(&mut self, verdict: Verdict, because: &[Reason]) -> Result<RecordAnswer, RecordError> {
        let Some(cycle) = self.cycle else { return Ok(RecordAnswer::Concluded(verdict)) };
        // The stored verdict is returned, so that the signature and the page state the verdict that is on the disk.
        let kept = self.store.conclude(cycle, verdict, because).map_err(record_error)?;
        Ok(RecordAnswer::Concluded(kept.verdict))
    }

    fn end_cycle_record(&mut self) {
        self.cycle = None;
        self.pages = Pages::default();
    }

    fn disk_space_problems(&mut self) -> Vec<Reason> {
        match self.store.free_mb() {
            Ok(free_mb) if free_mb >= MIN_FREE_SPACE_MB && self.store.has_free_space() => {
                self.is_full_reported = false;
                vec![]
            }
            Ok(_) => vec![disk_full_reason(self.store)],
            Err(_) if self.store.is_disk_full() => vec![disk_full_reason(self.store)],
            Err(error) => vec![Reason::new("store", error.to_string())],
        }
    }

    fn disk_full_reason(&mut self) -> Option<Reason> {
        let is_new =
            self.store.is_disk_full() && !std::mem::replace(&mut self.is_full_reported, self.store.is_disk_full());
        is_new.then(|| disk_full_reason(self.store))
    }
}
