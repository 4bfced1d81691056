//! Transfer of the cell's records to the office server. A separate thread reads the records that the store has queued
//! for the office server, sends them to the broker, and requests which records have arrived. Nothing in the cell waits
//! for this thread, and no answer of the office server changes what the cell does: records are only sent again, or an
//! alarm is raised.
//!
//! `StateReporter` determines the state of the cell that the office receives. `MissingRecords` decides when a record
//! that the office does not have, although the broker accepted it, is sent again. In one round, `Sender` sends new
//! records to the broker and receives the office's answer; the progress is stored in the store's folder (`transfer`).

use super::background::{Background, Plan, Rounds};
use super::gateway::InterfaceContext;
use super::request::RequestKind;
use crate::setup::clock::now_unix_ms;

use super::transfer;
use super::transfer::OfficeStatus;
use panelprep_base::verdict::Reason;
use panelprep_cell::cell::{CellName, Office};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_interfaces::broker::{BrokerError, CellLink, PendingMessage};
use panelprep_store::history::{Alarm, Priority};
use panelprep_store::office::{
    Body, CellState, ChunkOwner, ItemEnvelope, Message, Position, Progress, ReasonText, ReportOutcome, chunks,
};
use panelprep_store::store::Store;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The thread that sends to the office server; dropping this value ends the thread.
#[derive(Debug)]
pub struct OfficeSender {
    _background: Background,
}

impl OfficeSender {
    /// Starts the sender.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn start(parts: OfficeParts) -> std::io::Result<Self> {
        let plan = Plan {
            name: "office",
            task: "the transfer of records to the office server",
            blocking_threads: 2,
            stack_bytes: None,
        };
        Ok(OfficeSender { _background: Background::spawn_rounds(plan, move || Sender::new(&parts))? })
    }
}

/// The parts of the service that the sender needs.
pub struct OfficeParts {
    /// The `[office]` table of the cell's file.
    pub office: Office,
    /// The store's folder.
    pub folder: PathBuf,
    /// The shared parts of the interfaces, which provide the state to report; `None` if no service runs.
    pub front: Option<InterfaceContext>,
    /// The status of the transfer that is shown to people.
    pub status: OfficeStatus,
}

/// Shortest time between two reports of the state.
const MIN_REPORT_INTERVAL: Duration = Duration::from_secs(2);
/// Interval at which the active alarms are read.
const ALARM_POLL_INTERVAL: Duration = Duration::from_secs(5);

/// Determines the state of the cell for each report.
struct StateReporter {
    front: InterfaceContext,
    last_report: Option<Instant>,
    lasting_alarms: Vec<ReasonText>,
    last_alarm_check: Option<Instant>,
}

impl StateReporter {
    pub fn new(front: InterfaceContext) -> Self {
        StateReporter { front, last_report: None, lasting_alarms: Vec::new(), last_alarm_check: None }
    }

    /// Returns the state of the cell; `None` if it was reported less than `MIN_REPORT_INTERVAL` ago.
    pub async fn now(&mut self, cell: &CellName, last: &[Position]) -> Option<CellState> {
        if self.last_report.is_some_and(|reported| reported.elapsed() < MIN_REPORT_INTERVAL) {
            return None;
        }
        if self.last_alarm_check.is_none_or(|stood| stood.elapsed() >= ALARM_POLL_INTERVAL) {
            let front = self.front.clone();
            self.lasting_alarms =
                tokio::task::spawn_blocking(move || lasting_alarms(&front)).await.unwrap_or_default();
            self.last_alarm_check = Some(Instant::now());
        }
        let reply = self
            .front
            .gateway
            .request(RequestKind::State, RequestAuthor::from_source(RequestSource::Program))
            .await;
        self.last_report = Some(Instant::now());
        let mut state = CellState::new(cell);
        state.unix_ms = now_unix_ms();
        env!("CARGO_PKG_VERSION").clone_into(&mut state.version);
        (state.state, state.phase, state.panel) = (reply.state, reply.phase, reply.panel);
        (state.cycle, state.waypoint) = (reply.cycle_id, reply.waypoint.zip(reply.of).map(|(at, of)| [at, of]));
        let reason = |reason: Reason| ReasonText { code: reason.code.into_owned(), message: reason.message };
        state.reasons = reply.reasons.into_iter().map(reason).collect();
        // A reason for which a cycle waits is also an alarm; it is reported only once.
        state.standing =
            self.lasting_alarms.iter().filter(|reported| !state.reasons.contains(reported)).cloned().collect();
        state.last = last.to_vec();
        Some(state)
    }
}

/// Returns the active alarms that a person must know. The call blocks while it waits for a camera or the disk.
fn lasting_alarms(front: &InterfaceContext) -> Vec<ReasonText> {
    front.check_alarms();
    let lasting = front.people.read(|store| front.alarms.active_in_order(store)).unwrap_or_else(|error| {
        tracing::warn!(
            "the alarms cannot be reported to the office server: {error}; they are reported again \
                        automatically"
        );
        Vec::new()
    });
    let is_told = |alarm: &Alarm| alarm.priority > Priority::Note;
    lasting
        .into_iter()
        .filter(is_told)
        .map(|alarm| ReasonText { code: alarm.code, message: alarm.message })
        .collect()
}

/// A missing record is first sent again after the alarm's delay divided by this number; each further delay is twice as
/// long.
const FIRST_RETRY_DIVISOR: u32 = 6;
/// Maximum interval between two repetitions.
const MAX_RETRY_INTERVAL: Duration = Duration::from_secs(2 * 3_600);

/// The last progress of the office server within an epoch while records are missing, and its time; `None` if no record
/// is missing.
#[derive(Debug, Clone, Copy, Default)]
struct MissingRecords(Option<StalledSince>);

#[derive(Debug, Clone, Copy)]
struct StalledSince {
    archived: u64,
    at: Instant,
    pause: Duration,
}

impl MissingRecords {
    /// Updates the progress: whether the office server lacks records, and the number up to which it has all of them.
    /// Returns whether the next record must be sent again.
    pub fn is_resend_due(&mut self, (lacks, archived): (bool, u64), behind_min: usize) -> bool {
        self.is_resend_due_at((lacks, archived), behind_min, Instant::now())
    }

    fn is_resend_due_at(&mut self, (lacks, archived): (bool, u64), behind_min: usize, now: Instant) -> bool {
        let first = Duration::from_secs(60) * u32::try_from(behind_min).unwrap_or(u32::MAX) / FIRST_RETRY_DIVISOR;
        match &mut self.0 {
            Some(since) if lacks && since.archived == archived => {
                let is_due = now.duration_since(since.at) >= since.pause;
                if is_due {
                    (since.at, since.pause) = (now, MAX_RETRY_INTERVAL.min(since.pause * 2));
                }
                is_due
            }
            since => {
                *since = lacks.then_some(StalledSince { archived, at: now, pause: first.min(MAX_RETRY_INTERVAL) });
                false
            }
        }
    }
}

/// Name of the file in the store's folder that contains the position up to which the records were sent.
const PROGRESS_FILE_NAME: &str = "office.json";
/// Number of records that are read from the store at a time.
const BATCH_RECORDS: usize = 200;
/// Maximum number of bytes that are sent to the broker and not yet acknowledged.
const MAX_IN_FLIGHT_BYTES: usize = 32 << 20;
/// Maximum number of files for which the sender remembers that they were sent on this connection: most records name the
/// same recipe and calibrations.
const MAX_REMEMBERED_FILES: usize = 50_000;
/// Interval at which the office server is asked which records it has.
const POLL_INTERVAL: Duration = Duration::from_secs(5);
/// Interval at which the offered recipes are requested.
const OFFER_POLL_INTERVAL: Duration = Duration::from_secs(30);

/// Sends the records and files of this cell to the office server.
struct Sender {
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
    /// For each epoch: since when the office server has missed the same record, although the broker acknowledged it.
    missing_records: BTreeMap<String, MissingRecords>,
}

impl Rounds for Sender {
    /// Sends the new records, and requests the answers of the office server.
    async fn run_round(&mut self) -> Result<bool, String> {
        let last = self.last_positions()?;
        let was = self.progress.clone();
        let sent = self.exchange_messages(&last).await;
        if self.progress != was {
            transfer::write_progress(&self.folder, PROGRESS_FILE_NAME, &self.progress)?;
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
            progress: transfer::read_progress(folder, PROGRESS_FILE_NAME),
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
            tracing::info!(
                "sending records to the office server through the broker {}",
                self.office.broker.address
            );
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

    /// Requests the recipes that the office server offers for the panels taught in this cell. If a request fails, it is
    /// repeated later.
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
        self.store.as_ref().ok_or_else(|| "the store is closed: restart the service".to_owned())
    }

    fn last_positions(&mut self) -> Result<Vec<Position>, String> {
        self.store()?.outbox_epochs().map_err(|error| error.to_string())
    }

    /// For each epoch, requests up to which number the office server has the records. Missing records are sent again.
    async fn request_positions(&mut self, last: &[Position]) -> Result<(), String> {
        let Some(link) = &self.link else { return Ok(()) };
        let stream = link.stream().await.map_err(|error| error.to_string())?;
        self.progress.set_stream(&stream);
        let (mut more, mut again) = (Vec::new(), Vec::new());
        for last in last {
            // If the office server never answered for an epoch, it has no records of this epoch: it may be a new office
            // server.
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
                        "the office server has only the records up to {archived} of epoch {}: the later records are \
                         sent again",
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

    /// Sends some records after this position, each record after its files, and waits until the broker has acknowledged
    /// them.
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
                if self.files.len() >= MAX_REMEMBERED_FILES {
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
                    // The message states that the file is missing, so that the office server does not wait for the
                    // file.
                    Err(error) => {
                        tracing::warn!("cannot send the file {} to the office server: {error}", file.name);
                        file.gone = Some("damaged in the cell's store".to_owned());
                    }
                }
            }
        }
        let position = envelope.position.clone();
        let message = Message { cell: cell.clone(), envelope };
        let message = message.bytes().map_err(|error| error.to_string())?;
        whole.push((ChunkOwner::Message(position), message));
        let link = self.link.as_ref().ok_or_else(|| {
            "the connection to the broker is lost; it is opened again \
                                                     automatically"
                .to_owned()
        })?;
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

    /// Sends the first missing records once more, with their files: the broker may have lost them after it acknowledged
    /// them.
    async fn resend_missing(&mut self, epoch: &str) -> Result<(), String> {
        let archived = Position { epoch: epoch.to_owned(), number: self.progress.last_archived(epoch) };
        tracing::warn!(
            "the office server still has only the records up to {} of epoch {epoch}: some of the following records \
             are sent again",
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

#[cfg(test)]
mod tests {
    use super::*;

    /// With an alarm after 60 min, a record is sent again after 10 min, after 20 min more and after 40 min more; the
    /// delays begin again when the office makes progress.
    #[test]
    fn a_missing_record_is_resent_at_increasing_intervals() {
        let (mut lacking, begin) = (MissingRecords::default(), Instant::now());
        let mut due =
            |told, minute: u64| lacking.is_resend_due_at(told, 60, begin + Duration::from_secs(60 * minute));
        let found: Vec<u64> = (0..=75).filter(|minute| due((true, 7), *minute)).collect();
        assert_eq!(found, [10, 30, 70]);
        assert!(!due((true, 8), 76) && !due((true, 8), 85) && due((true, 8), 86), "it got on");
        assert!(
            !due((false, 9), 200) && !due((true, 9), 300) && due((true, 9), 310),
            "it lacked nothing meanwhile"
        );
    }
}
