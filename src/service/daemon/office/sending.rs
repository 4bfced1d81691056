//! One round: new records go to the broker, and the office's answer comes back.

use super::parts::OfficeParts;
use super::resend::MissingRecords;
use super::state::StateReporter;
use super::status::OfficeStatus;
use crate::daemon::background::Rounds;
use crate::daemon::progress_file;
use panelprep_cell::cell::Office;
use panelprep_interfaces::broker::{BrokerError, CellLink, PendingMessage};
use panelprep_store::office::{Body, ChunkOwner, ItemEnvelope, Message, Position, Progress, ReportOutcome, chunks};
use panelprep_store::store::Store;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The file in the store's folder that records how far the records were sent.
const PROGRESS: &str = "office.json";
/// Number of records that are read at a time.
const BATCH_RECORDS: usize = 200;
/// Largest number of bytes that are being sent at a time.
const MAX_IN_FLIGHT_BYTES: usize = 32 << 20;
/// Largest number of files of which the sender remembers that they are already in this stream: most records name the
/// same recipe and calibrations.
const MAX_FILES: usize = 50_000;
/// Interval at which the office is queried.
const POLL_INTERVAL: Duration = Duration::from_secs(5);
/// Interval at which offers of recipes are requested.
const OFFER_POLL_INTERVAL: Duration = Duration::from_secs(30);

/// Sends the items of this cell to the office.
pub(super) struct Sender {
    office: Office,
    folder: PathBuf,
    status: OfficeStatus,
    state_reporter: Option<StateReporter>,
    progress: Progress,
    store: Option<Store>,
    link: Option<CellLink>,
    last_request: Option<Instant>,
    files: BTreeSet<String>,
    last_offer_request: Option<Instant>,
    /// Since when the office has lacked the same record of an epoch, although the broker accepted it.
    missing_records: BTreeMap<String, MissingRecords>,
}

impl Rounds for Sender {
    /// Sends the new records.
    async fn run_round(&mut self) -> Result<bool, String> {
        let last = self.last_positions()?;
        let was = self.progress.clone();
        let sent = self.exchange_messages(&last).await;
        if self.progress != was {
            progress_file::write(&self.folder, PROGRESS, &self.progress)?;
        }
        self.update_status(&last)?;
        sent
    }

    fn forget(&mut self) {
        (self.link, self.store, self.last_request) = (None, None, None);
        self.last_offer_request = None;
    }

    fn report_result(&self, problem: Option<&str>) -> bool {
        self.status.record_problem(problem)
    }
}

impl Sender {
    pub fn new(parts: &OfficeParts) -> Self {
        let OfficeParts { office, folder, front, status } = parts;
        Sender {
            office: office.clone(),
            folder: folder.clone(),
            status: status.clone(),
            state_reporter: front.clone().map(StateReporter::new),
            progress: progress_file::read(folder, PROGRESS),
            store: None,
            link: None,
            last_request: None,
            files: BTreeSet::new(),
            last_offer_request: None,
            missing_records: BTreeMap::new(),
        }
    }

    async fn exchange_messages(&mut self, last: &[Position]) -> Result<bool, String> {
        let broken = |error: BrokerError| error.to_string();
        if self.link.is_none() {
            let link = CellLink::connect(&self.office.broker, &self.office.cell).await.map_err(broken)?;
            let stream = link.stream().await.map_err(broken)?;
            self.progress.set_stream(&stream);
            self.files.clear();
            tracing::info!("sending records to the office through the broker {}", self.office.broker.address);
            self.link = Some(link);
        }
        let Some(link) = &self.link else { return Ok(false) };
        let state = match &mut self.state_reporter {
            Some(teller) => teller.now(&self.office.cell, last).await,
            None => None,
        };
        if let Some(state) = state {
            let bytes = state.bytes().map_err(|error| error.to_string())?;
            link.publish_state(bytes).await.map_err(broken)?;
        }
        if self.last_request.is_none_or(|asked| asked.elapsed() >= POLL_INTERVAL) {
            self.request_positions(last).await?;
        }
        self.request_offers().await;
        for last in last {
            let sent = Position { epoch: last.epoch.clone(), number: self.progress.last_sent(&last.epoch) };
            if sent.number < last.number {
                self.send(&sent).await?;
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Asks which recipes the office offers for the panels taught to this cell. If an offer cannot be obtained, it
    /// is requested again later.
    async fn request_offers(&mut self) {
        if self.last_offer_request.is_some_and(|offered| offered.elapsed() < OFFER_POLL_INTERVAL) {
            return;
        }
        self.last_offer_request = Some(Instant::now());
        let panels = self.store().and_then(|store| store.cycle_panels().map_err(|error| error.to_string()));
        let (Some(link), Ok(panels)) = (&self.link, panels) else { return };
        let mut offers = Vec::new();
        for panel in panels {
            match link.recipe_offer(&panel).await {
                Ok(offer) => offers.extend(offer),
                Err(error) => tracing::warn!("{error}"),
            }
        }
        self.status.record_offers(offers);
    }

    fn store(&mut self) -> Result<&Store, String> {
        if self.store.is_none() {
            self.store = Some(Store::open(&self.folder).map_err(|error| error.to_string())?);
        }
        self.store.as_ref().ok_or_else(|| "the store is closed".to_owned())
    }

    fn last_positions(&mut self) -> Result<Vec<Position>, String> {
        self.store()?.outbox_epochs().map_err(|error| error.to_string())
    }

    /// Asks which records of each epoch the office has. Missing records are sent again.
    async fn request_positions(&mut self, last: &[Position]) -> Result<(), String> {
        let Some(link) = &self.link else { return Ok(()) };
        let stream = link.stream().await.map_err(|error| error.to_string())?;
        self.progress.set_stream(&stream);
        let (mut more, mut again) = (Vec::new(), Vec::new());
        for last in last {
            // An office that never answered about an epoch has no records of this epoch: it may be a different office
            // than before.
            let archived = link.archived_number(&last.epoch).await.map_err(|error| error.to_string())?.unwrap_or(0);
            match self.progress.process_archived(&last.epoch, archived, last.number) {
                ReportOutcome::Known => {
                    let lacks = archived < self.progress.last_sent(&last.epoch);
                    if self
                        .missing_records
                        .entry(last.epoch.clone())
                        .or_default()
                        .is_resend_due((lacks, archived), self.office.alarm_delay_min)
                    {
                        again.push(last.epoch.clone());
                    }
                }
                ReportOutcome::HasLess => {
                    self.files.clear();
                    tracing::warn!(
                        "the office has only the records up to {archived} of epoch {}: the later records are sent \
                         again",
                        last.epoch
                    );
                }
                ReportOutcome::HasMore => more.push((last.epoch.clone(), archived, last.number)),
            }
        }
        self.status.record_newer_epochs(more);
        self.last_request = Some(Instant::now());
        for epoch in again {
            self.resend_missing(&epoch).await?;
        }
        Ok(())
    }

    /// Sends some records after this position, each record after its files, and waits until the broker has them.
    async fn send(&mut self, after: &Position) -> Result<(), String> {
        let envelopes = self.store()?.outbox_rows_after(after, BATCH_RECORDS).map_err(|error| error.to_string())?;
        let mut under_way: Vec<(Position, Vec<PendingMessage>)> = Vec::new();
        let mut bytes = 0;
        let mut broken = None;
        for envelope in envelopes {
            let position = envelope.position.clone();
            match self.send_record(envelope, &mut bytes).await {
                Ok(sending) => under_way.push((position, sending)),
                Err(problem) => {
                    broken = Some(problem);
                    break;
                }
            }
            if bytes >= MAX_IN_FLIGHT_BYTES {
                break;
            }
        }
        for (position, all) in under_way {
            for sending in all {
                sending.wait_acknowledged().await.map_err(|error| error.to_string())?;
            }
            self.progress.record_accepted(&position);
        }
        broken.map_or(Ok(()), Err)
    }

    /// Sends a record after its files; files that are already being sent are not sent again.
    async fn send_record(
        &mut self,
        mut envelope: ItemEnvelope,
        bytes: &mut usize,
    ) -> Result<Vec<PendingMessage>, String> {
        let cell = self.office.cell.clone();
        let mut whole: Vec<(ChunkOwner, Vec<u8>)> = Vec::new();
        if let Body::Signature { files, .. } = &mut envelope.body {
            for file in files.iter_mut().filter(|file| file.gone.is_none()) {
                if self.files.len() >= MAX_FILES {
                    self.files.clear();
                }
                if self.files.contains(&file.hash) {
                    continue;
                }
                match self.store()?.blob(&file.hash) {
                    Ok(content) => {
                        self.files.insert(file.hash.clone());
                        whole.push((ChunkOwner::File(file.hash.clone()), content));
                    }
                    // The office does not wait for a file that is reported as lost.
                    Err(error) => {
                        tracing::warn!("cannot send the file {} to the office: {error}", file.name);
                        file.gone = Some("damaged in the cell's store".to_owned());
                    }
                }
            }
        }
        let position = envelope.position.clone();
        let message = Message { cell: cell.clone(), envelope };
        let message = message.bytes().map_err(|error| error.to_string())?;
        whole.push((ChunkOwner::Message(position), message));
        let link = self.link.as_ref().ok_or_else(|| "the connection is lost".to_owned())?;
        let mut sending = Vec::new();
        for (what, content) in whole {
            *bytes += content.len();
            for chunk in chunks(&cell, &what, &content).map_err(|error| error.to_string())? {
                sending.push(
                    link.send(&chunk, self.progress.resend_count()).await.map_err(|error| error.to_string())?,
                );
            }
        }
        Ok(sending)
    }

    /// Sends the first records that the office lacks once more, with their files: a broker that accepted them may have
    /// lost them.
    async fn resend_missing(&mut self, epoch: &str) -> Result<(), String> {
        let archived = Position { epoch: epoch.to_owned(), number: self.progress.last_archived(epoch) };
        tracing::warn!(
            "the office still has only the records up to {} of epoch {epoch}: some of the following records are \
             sent again",
            archived.number
        );
        self.progress.restart_sending();
        self.files.clear();
        self.send(&archived).await
    }

    fn update_status(&mut self, last: &[Position]) -> Result<(), String> {
        let behind = self.progress.missing_count(last);
        let mut oldest: Option<i64> = None;
        for last in last {
            let archived = Position { epoch: last.epoch.clone(), number: self.progress.last_archived(&last.epoch) };
            if archived.number < last.number {
                let since = self.store()?.outbox_waits_since(&archived).map_err(|error| error.to_string())?;
                oldest = [oldest, since].into_iter().flatten().min();
            }
        }
        self.status.record_backlog(behind, oldest);
        Ok(())
    }
}
