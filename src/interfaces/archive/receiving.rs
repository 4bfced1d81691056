//! The main loop of the archive: receives messages from the broker, and stores them in the database and the folder of
//! files.
//!
//! It also detects two cells with the same name: their stores have different epochs, which are reported alternately.
//! And it publishes the recipes that the office offers to the cells.

use super::database::ArchiveError;
use super::files::ContentFiles;
use super::message_rows::BatchResult;
use super::{database, message_rows};
use crate::broker::{Delivery, OfficeLink, Receipt, StateSubscription};
use panelprep_store::office::{
    ArchiveSettings, AssembledItem, CellState, Chunk, ChunkOwner, InvalidItem, Message, OfficeError, PartAssembly,
    Position, RecipeOffer, subject,
};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use tokio_postgres::Client;

/// Maximum number of messages in a batch from the broker.
const BATCH_MESSAGES: usize = 500;
/// Maximum delay before the next attempt after a failure. The delay is one second at first and doubles with each
/// failure, up to this limit.
const MAX_RETRY_DELAY: Duration = Duration::from_secs(30);

/// Maximum number of records in one report about records that wait for their files.
const MAX_REPORTED_RECORDS: usize = 5;
/// Time after which a continuing failure is reported again.
const REPORT_INTERVAL: Duration = Duration::from_secs(3_600);
/// Maximum time until the database replies to a write. After it, the connection is treated as lost; messages that were
/// not acknowledged are delivered again.
const WRITE_TIMEOUT: Duration = Duration::from_secs(60);

/// Runs the archive until `ended` completes. After a temporary failure, a new attempt with a new connection is made.
///
/// # Errors
/// If the tables of the database are newer than this program, its encoding is unsuitable, or a file named in the
/// settings cannot be used.
pub async fn run(settings: &ArchiveSettings, ended: impl Future<Output = ()>) -> Result<(), ArchiveError> {
    tokio::select! {
        failed = run_with_retries(settings) => Err(failed),
        () = ended => Ok(()),
    }
}

async fn run_with_retries(settings: &ArchiveSettings) -> ArchiveError {
    let mut pause = Duration::from_secs(1);
    let mut last_reported: Option<(String, Instant)> = None;
    loop {
        let since = Instant::now();
        let Err(error) = run_receiver(settings).await;
        if !error.is_transient() {
            return error;
        }
        let words = error.to_string();
        let was_good = since.elapsed() > MAX_RETRY_DELAY;
        if was_good {
            pause = Duration::from_secs(1);
        }
        let is_known =
            last_reported.as_ref().is_some_and(|(last, at)| *last == words && at.elapsed() < REPORT_INTERVAL);
        if was_good || !is_known {
            tracing::warn!("{words}; retrying");
            last_reported = Some((words, Instant::now()));
        }
        tokio::time::sleep(pause).await;
        pause = MAX_RETRY_DELAY.min(pause * 2);
    }
}

async fn run_receiver(settings: &ArchiveSettings) -> Result<std::convert::Infallible, ArchiveError> {
    let files = ContentFiles::in_folder(&settings.files);
    files.check_writable()?;
    let mut client = database::open(&settings.database).await?;
    let mut link = OfficeLink::connect(&settings.broker, settings.max_waiting_bytes()).await?;
    tracing::info!("receiving the messages of the cells through the broker {}", settings.broker.address);
    // Publish all archived positions again, because a cell may have missed one, or the broker may have lost one.
    for (cell, epoch, archived) in database::with_timeout(WRITE_TIMEOUT, message_rows::epochs(&client)).await? {
        link.publish_archived(&cell, &epoch, archived).await?;
    }
    database::with_timeout(WRITE_TIMEOUT, republish_offers(&client, &link)).await?;
    let listener = database::open(&settings.database).await?;
    let states = link.states().await?;
    let records = receive(&mut client, &mut link, files);
    tokio::select! {
        Err(error) = records => Err(error),
        Err(error) = listen(&listener, states) => Err(error),
    }
}

async fn receive(
    client: &mut Client,
    link: &mut OfficeLink,
    files: ContentFiles,
) -> Result<std::convert::Infallible, ArchiveError> {
    let mut receiver = Receiver { files, assembly: PartAssembly::default(), waiting: Vec::new() };
    loop {
        let batch = link.next(BATCH_MESSAGES).await?;
        receiver.receive_batch(client, link, batch).await?;
        if link.recreate_stuck_consumer().await? {
            receiver.forget();
        }
    }
}

/// Receives the states that the cells report. A missed state does not matter, because the next one follows after two
/// seconds.
async fn listen(client: &Client, mut states: StateSubscription) -> Result<std::convert::Infallible, ArchiveError> {
    let mut names = Names::default();
    loop {
        let (by, bytes) = states.next().await?;
        database::with_timeout(WRITE_TIMEOUT, store_state((client, &mut names), &by, &bytes)).await?;
    }
}

struct Receiver {
    files: ContentFiles,
    assembly: PartAssembly<Receipt>,
    /// Records with files that have not been received yet. A cell is informed about a record only after all of its
    /// files are stored.
    waiting: Vec<(Message, Vec<Receipt>)>,
}

impl Receiver {
    async fn receive_batch(
        &mut self,
        client: &mut Client,
        link: &OfficeLink,
        batch: Vec<Delivery>,
    ) -> Result<(), ArchiveError> {
        let mut kept = Vec::new();
        for Delivery { bytes, subject, receipt } in batch {
            let chunk = match Chunk::read(&bytes).and_then(|chunk| check_sender(&subject, chunk)) {
                Ok(chunk) => chunk,
                Err(error) => {
                    refuse((&subject, &error), vec![receipt]).await?;
                    continue;
                }
            };
            let whole = match self.assembly.add(chunk, receipt) {
                Ok(None) => continue,
                Ok(Some(whole)) => whole,
                Err(InvalidItem { error, receipts }) => {
                    refuse((&subject, &error), receipts).await?;
                    continue;
                }
            };
            match &whole.what {
                ChunkOwner::File(hash) => {
                    self.files.store(hash, &whole.bytes)?;
                    kept.extend(whole.receipts);
                }
                ChunkOwner::Message(position) => match parse_message(&whole, position) {
                    Ok(message) => {
                        // If the broker delivers a message again, its previous receipts are no longer valid, so the
                        // previous entry is removed.
                        self.waiting.retain(|(before, _)| *before != message);
                        self.waiting.push((message, whole.receipts));
                    }
                    Err(error) => refuse((&subject, &error), whole.receipts).await?,
                },
            }
        }
        let files = &self.files;
        let whole = self.waiting.extract_if(.., |(message, _)| files.has_all_files(message));
        let (messages, receipts): (Vec<Message>, Vec<Vec<Receipt>>) = whole.unzip();
        if !messages.is_empty() {
            let BatchResult { new, known, contradictions, archived } =
                database::with_timeout(WRITE_TIMEOUT, message_rows::store_messages(client, &messages)).await?;
            contradictions.iter().for_each(|words| tracing::error!("{words}"));
            tracing::debug!("{new} new records, {known} already present");
            for ((cell, epoch), number) in archived {
                link.publish_archived(&cell, &epoch, number).await?;
            }
        }
        for receipt in kept.iter().chain(receipts.iter().flatten()) {
            receipt.acknowledge().await?;
        }
        Ok(())
    }

    /// Discards all messages that were not acknowledged; the broker delivers them again.
    fn forget(&mut self) {
        for (Message { cell, envelope }, _) in self.waiting.iter().take(MAX_REPORTED_RECORDS) {
            let Position { epoch, number } = &envelope.position;
            tracing::warn!("cell {cell}: record {number} of epoch {epoch} waits for its files");
        }
        self.assembly = PartAssembly::default();
        self.waiting.clear();
    }
}

fn parse_message(whole: &AssembledItem<Receipt>, position: &Position) -> Result<Message, OfficeError> {
    let message = Message::read(&whole.bytes)?;
    match message.cell == whole.cell && message.envelope.position == *position {
        true => Ok(message),
        false => {
            let problem = "the cell or the record number differs from that in the message parts".to_owned();
            Err(OfficeError::Form { what: "head of a message", problem })
        }
    }
}

/// Checks that a message chunk was received on the subject of the cell that it names. The broker restricts which cell
/// may send on which subject.
fn check_sender(subject: &str, chunk: Chunk) -> Result<Chunk, OfficeError> {
    match subject == subject::records(&chunk.cell) {
        true => Ok(chunk),
        false => Err(OfficeError::Form {
            what: "line of a message part",
            problem: format!(
                "the message part names the cell {}, but was received on the subject {}",
                chunk.cell,
                subject.escape_debug()
            ),
        }),
    }
}

async fn refuse((subject, error): (&str, &OfficeError), receipts: Vec<Receipt>) -> Result<(), ArchiveError> {
    tracing::error!("a message on the subject {} is refused: {error}", subject.escape_debug());
    for receipt in &receipts {
        receipt.refuse().await?;
    }
    Ok(())
}

/// Stores the newest state of a cell, for the pages. An invalid state is logged and dropped.
async fn store_state((client, names): (&Client, &mut Names), by: &str, bytes: &[u8]) -> Result<(), ArchiveError> {
    let (cell, state) = match CellState::read(bytes) {
        Ok(read) if by == subject::state(&read.0) => read,
        Ok((cell, _)) => {
            tracing::error!("a state of the cell {cell} was received on the wrong subject {}", by.escape_debug());
            return Ok(());
        }
        Err(error) => {
            tracing::error!("a state on the subject {} is ignored: {error}", by.escape_debug());
            return Ok(());
        }
    };
    if names.detect_duplicate_name(cell.as_str(), &state) {
        tracing::error!("two cells have the name {cell}: set another name for one of them at [office] cell");
    }
    let text = String::from_utf8_lossy(bytes).into_owned();
    let sql =
        "INSERT INTO cells (cell, heard_unix_ms, state) VALUES ($1, (extract(epoch FROM now()) * 1000)::bigint, $2)
        ON CONFLICT (cell) DO UPDATE SET heard_unix_ms = EXCLUDED.heard_unix_ms, state = EXCLUDED.state";
    let kept = client.execute(sql, &[&cell.as_str(), &text]).await;
    kept.map(drop).map_err(ArchiveError::database("store the state of a cell"))
}

/// The epochs that each cell has reported, by the name of the cell.
#[derive(Debug, Default)]
struct Names(BTreeMap<String, ReportedEpochs>);

#[derive(Debug, Default)]
struct ReportedEpochs {
    /// The epochs in the last report. `previous_epochs` are the last different epochs before.
    last: Vec<String>,
    previous_epochs: Vec<String>,
    is_reported: bool,
}

impl Names {
    /// Returns true when it is first detected that two cells use this name: the reported epochs have changed, and then
    /// changed back to the previous ones. A change without a change back may be a restored store.
    pub fn detect_duplicate_name(&mut self, cell: &str, state: &CellState) -> bool {
        let mut epochs: Vec<String> = state.last.iter().map(|position| position.epoch.clone()).collect();
        epochs.sort();
        let heard = self.0.entry(cell.to_owned()).or_default();
        if epochs == heard.last {
            return false;
        }
        let came_back = epochs == heard.previous_epochs && !epochs.is_empty() && !heard.last.is_empty();
        heard.previous_epochs = std::mem::replace(&mut heard.last, epochs);
        came_back && !std::mem::replace(&mut heard.is_reported, true)
    }
}

/// Stores an offer, which replaces the previous offer for its panel, and publishes it to the cells.
///
/// # Errors
/// If the database or the broker does not accept the offer.
pub async fn publish_offer(settings: &ArchiveSettings, offer: &RecipeOffer) -> Result<(), ArchiveError> {
    let client = database::open(&settings.database).await?;
    let link = OfficeLink::connect(&settings.broker, settings.max_waiting_bytes()).await?;
    let sql = "INSERT INTO offers (panel, recipe_hash, offer) VALUES ($1, $2, $3)
        ON CONFLICT (panel) DO UPDATE SET recipe_hash = EXCLUDED.recipe_hash, offer = EXCLUDED.offer";
    let bytes = offer.bytes().unwrap_or_default();
    let kept = client.execute(sql, &[&offer.panel, &offer.hash(), &bytes]).await;
    kept.map_err(ArchiveError::database("store an offer"))?;
    link.publish_offer(offer).await?;
    Ok(())
}

/// Publishes all offers to the cells again, because the broker may have lost them.
async fn republish_offers(client: &Client, link: &OfficeLink) -> Result<(), ArchiveError> {
    let rows =
        client.query("SELECT offer FROM offers", &[]).await.map_err(ArchiveError::database("read offers"))?;
    for row in rows {
        match RecipeOffer::read(&row.get::<_, Vec<u8>>(0)) {
            Ok(offer) => link.publish_offer(&offer).await?,
            Err(error) => tracing::error!("an offer in the database is not sent to the cells: {error}"),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::CellName;
    use panelprep_store::office::Position;

    #[test]
    fn a_restored_store_is_one_cell_and_two_alternating_stores_are_two() {
        let told = |epochs: &[&str]| {
            let mut state = CellState::new(&CellName::new("a").expect("a name"));
            let position = |epoch: &&str| Position { epoch: (*epoch).to_owned(), number: 1 };
            state.last = epochs.iter().map(position).collect();
            state
        };
        let mut names = Names::default();
        for epochs in [&["1"][..], &["1"], &["1", "2"], &["3"], &["3", "4"]] {
            assert!(!names.detect_duplicate_name("a", &told(epochs)), "{epochs:?}");
        }
        let found: Vec<bool> = [&["5"][..], &["6"], &["5"], &["6"]]
            .iter()
            .map(|epochs| names.detect_duplicate_name("b", &told(epochs)))
            .collect();
        assert_eq!(found, [false, false, true, false], "told once");
    }
}
