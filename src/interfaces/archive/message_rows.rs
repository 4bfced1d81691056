//! Stores messages in the database: all rows of a batch in one transaction. Pure functions compute the rows for the
//! office's pages from each message.

use super::database::ArchiveError;
use futures_util::future::try_join_all;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cell::CellName;
use panelprep_cell::files::content_hash;
use panelprep_store::history::{KnownQuantity, PastCycle, Quantity};
use panelprep_store::office::{Body, CycleEnd, Message, OfficeVerification};
use panelprep_store::signing::{SignedCycle, Statement, StatementContent};
use std::collections::BTreeMap;
use strum::IntoEnumIterator;
use tokio_postgres::{Client, Transaction};

/// The result of storing a batch of messages.
#[derive(Debug, Default)]
pub(super) struct BatchResult {
    /// Number of new messages.
    pub new: u64,
    /// Number of messages that were already stored with the same content.
    pub known: u64,
    /// Descriptions of the messages with the name of a stored record but other content.
    pub contradictions: Vec<String>,
    /// The number up to which each epoch is now complete, for all epochs in the batch.
    pub archived: BTreeMap<(CellName, String), u64>,
}

/// Stores messages in the order of their arrival.
pub(super) async fn store_messages(client: &mut Client, messages: &[Message]) -> Result<BatchResult, ArchiveError> {
    let failed = ArchiveError::database("keep records");
    let transaction = client.transaction().await.map_err(&failed)?;
    let mut kept = BatchResult::default();
    let all: Vec<(&Message, String)> =
        messages.iter().map(|message| (message, content_hash(message.envelope.body.content()))).collect();
    let is_new = try_join_all(all.iter().map(|(message, hash)| insert(&transaction, (message, hash)))).await?;
    let mut new: Vec<(&Message, &str)> = Vec::new();
    for ((message, hash), is_new) in all.iter().zip(is_new) {
        if is_new {
            new.push((message, hash));
        } else if let Some(words) = store_contradiction(&transaction, (message, hash)).await? {
            kept.contradictions.push(words);
        } else {
            kept.known += 1;
        }
    }
    kept.new = new.len() as u64;
    try_join_all(new.iter().map(|(message, _)| insert_files(&transaction, message))).await?;
    try_join_all(new.iter().map(|(message, hash)| insert_derived_rows(&transaction, (message, hash)))).await?;
    for message in messages {
        let key = (message.cell.clone(), message.envelope.position.epoch.clone());
        kept.archived.entry(key).or_insert(0);
    }
    for ((cell, epoch), archived) in &mut kept.archived {
        *archived = update_archived_number(&transaction, cell, epoch).await?;
    }
    transaction.commit().await.map_err(&failed)?;
    Ok(kept)
}

/// Inserts a message, and returns whether it is new.
async fn insert(transaction: &Transaction<'_>, (message, hash): (&Message, &str)) -> Result<bool, ArchiveError> {
    let sql = "INSERT INTO records (cell, epoch, number, kind, unix_ms, hash, content, signature, public_key)
        VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9) ON CONFLICT DO NOTHING";
    let envelope = &message.envelope;
    let (signature, public_key) = match &envelope.body {
        Body::Signature { signature, public_key, .. } => (Some(signature.as_slice()), Some(public_key.as_str())),
        Body::Cycle(_) | Body::Verification(_) => (None, None),
    };
    let content = envelope.body.content();
    let count = transaction
        .execute(
            sql,
            &[
                &message.cell.as_str(),
                &envelope.position.epoch,
                &number(envelope.position.number),
                &envelope.body.kind().keyword(),
                &envelope.unix_ms,
                &hash,
                &content,
                &signature,
                &public_key,
            ],
        )
        .await
        .map_err(ArchiveError::database("store a record"))?;
    Ok(count == 1)
}

/// If a record with this name but other content is already stored: stores the new content as a contradiction, and
/// returns a text about it.
async fn store_contradiction(
    transaction: &Transaction<'_>,
    (message, hash): (&Message, &str),
) -> Result<Option<String>, ArchiveError> {
    let failed = ArchiveError::database("read a record");
    let position = &message.envelope.position;
    let (cell, number) = (message.cell.as_str(), number(position.number));
    let content = message.envelope.body.content();
    let sql = "SELECT hash FROM records WHERE cell = $1 AND epoch = $2 AND number = $3";
    let row = transaction.query_one(sql, &[&cell, &position.epoch, &number]).await.map_err(&failed)?;
    let found: String = row.get(0);
    if found == hash {
        return Ok(None);
    }
    let sql = "INSERT INTO contradictions (cell, epoch, number, hash, content) VALUES ($1, $2, $3, $4, $5)
        ON CONFLICT DO NOTHING";
    transaction.execute(sql, &[&cell, &position.epoch, &number, &hash, &content]).await.map_err(&failed)?;
    Ok(Some(format!(
        "cell {cell} sent record {number} of epoch {} twice: first with the SHA-256 {found}, now with {hash}",
        position.epoch
    )))
}

async fn insert_files(transaction: &Transaction<'_>, message: &Message) -> Result<(), ArchiveError> {
    let Body::Signature { files, .. } = &message.envelope.body else { return Ok(()) };
    if files.is_empty() {
        return Ok(());
    }
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    let hashes: Vec<&str> = files.iter().map(|file| file.hash.as_str()).collect();
    let gone: Vec<Option<&str>> = files.iter().map(|file| file.gone.as_deref()).collect();
    let position = &message.envelope.position;
    let sql = "INSERT INTO record_files (cell, epoch, number, name, hash, gone)
        SELECT $1, $2, $3, name, hash, gone FROM unnest($4::text[], $5::text[], $6::text[]) AS file (name, hash, gone)
        ON CONFLICT DO NOTHING";
    let values: [&(dyn tokio_postgres::types::ToSql + Sync); 6] =
        [&message.cell.as_str(), &position.epoch, &number(position.number), &names, &hashes, &gone];
    transaction.execute(sql, &values).await.map(drop).map_err(ArchiveError::database("store the files of a record"))
}

/// Inserts the rows for the office's pages, which are computed from the message.
async fn insert_derived_rows(
    transaction: &Transaction<'_>,
    (message, hash): (&Message, &str),
) -> Result<(), ArchiveError> {
    let cell = message.cell.as_str();
    match Rows::from_message(message) {
        Ok(Rows::Cycle(end)) => cycle(transaction, cell, &end).await,
        Ok(Rows::Verification(seen)) => verification(transaction, cell, &seen).await,
        Ok(Rows::Signature(rows)) => signature(transaction, (message, hash), &rows).await,
        Err(problem) => {
            tracing::warn!(
                "cell {cell}, record {}: cannot write the rows for the office's page: {problem}",
                message.envelope.position.number
            );
            Ok(())
        }
    }
}

async fn cycle(transaction: &Transaction<'_>, cell: &str, end: &CycleEnd) -> Result<(), ArchiveError> {
    let sql = "INSERT INTO cycles (cell, cycle, started_unix_s, ended_unix_s, panel, serial, work_order, operator, verdict,
            reasons, recipe_hash, program_version)
        VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12) ON CONFLICT DO NOTHING";
    let part = end.part.clone().unwrap_or_default();
    let values: [&(dyn tokio_postgres::types::ToSql + Sync); 12] = [
        &cell,
        &end.cycle.0,
        &end.started_unix_s,
        &end.ended_unix_s,
        &end.panel,
        &part.serial,
        &part.order,
        &part.operator,
        &end.verdict,
        &end.reasons.to_string(),
        &end.recipe_hash,
        &end.program_version,
    ];
    let failed = ArchiveError::database("store a cycle");
    if transaction.execute(sql, &values).await.map_err(&failed)? == 0 {
        return Ok(());
    }
    let sql =
        "INSERT INTO recipe_uses AS used (panel, recipe_hash, cell, first_unix_s, last_unix_s, cycles, passed)
        VALUES ($1, $2, $3, $4, $4, 1, $5) ON CONFLICT (panel, recipe_hash, cell) DO UPDATE SET
            first_unix_s = least(used.first_unix_s, EXCLUDED.first_unix_s),
            last_unix_s = greatest(used.last_unix_s, EXCLUDED.last_unix_s),
            cycles = used.cycles + 1, passed = used.passed + EXCLUDED.passed";
    let passed = i64::from(end.verdict == Verdict::Pass.keyword());
    let values: [&(dyn tokio_postgres::types::ToSql + Sync); 5] =
        [&end.panel, &end.recipe_hash, &cell, &end.started_unix_s, &passed];
    transaction.execute(sql, &values).await.map(drop).map_err(&failed)
}

async fn verification(
    transaction: &Transaction<'_>,
    cell: &str,
    seen: &OfficeVerification,
) -> Result<(), ArchiveError> {
    let sql = "INSERT INTO verifications (cell, subject, at_unix_s, error, allowed, calibration_hash)
        VALUES ($1, $2, $3, $4, $5, $6) ON CONFLICT DO NOTHING";
    let OfficeVerification { subject, error, limit, calibration_hash, at_unix_s } = seen;
    let values: [&(dyn tokio_postgres::types::ToSql + Sync); 6] =
        [&cell, subject, at_unix_s, error, limit, calibration_hash];
    transaction.execute(sql, &values).await.map(drop).map_err(ArchiveError::database("store a verification"))
}

async fn signature(
    transaction: &Transaction<'_>,
    (message, hash): (&Message, &str),
    rows: &SignatureRows,
) -> Result<(), ArchiveError> {
    let failed = ArchiveError::database("store a signature");
    let cell = message.cell.as_str();
    let (name, meaning) = rows.person.clone().unzip();
    let sql = "INSERT INTO signatures (cell, cycle, statement, record_hash, epoch, number, unix_ms, name, meaning)
        VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9) ON CONFLICT DO NOTHING";
    let position = &message.envelope.position;
    let values: [&(dyn tokio_postgres::types::ToSql + Sync); 9] = [
        &cell,
        &rows.cycle,
        &number(rows.statement),
        &hash,
        &position.epoch,
        &number(position.number),
        &rows.unix_ms,
        &name,
        &meaning,
    ];
    transaction.execute(sql, &values).await.map_err(&failed)?;
    let Some(Quantities { started_unix_s, panel, values }) = &rows.quantities else { return Ok(()) };
    let words: Vec<&str> = values.iter().map(|(word, _, _)| *word).collect();
    let numbers: Vec<f64> = values.iter().map(|(_, value, _)| *value).collect();
    let limits: Vec<&str> = values.iter().map(|(_, _, limit)| limit.as_str()).collect();
    let sql = "INSERT INTO quantities (cell, cycle, started_unix_s, panel, quantity, value, allowed)
        SELECT $1, $2, $3, $4, quantity, value, allowed
        FROM unnest($5::text[], $6::float8[], $7::text[]) AS number (quantity, value, allowed) ON CONFLICT DO NOTHING";
    let values: [&(dyn tokio_postgres::types::ToSql + Sync); 7] =
        [&cell, &rows.cycle, started_unix_s, panel, &words, &numbers, &limits];
    transaction.execute(sql, &values).await.map(drop).map_err(&failed)
}

/// Returns the number up to which an epoch is complete, and stores it if it has increased.
async fn update_archived_number(
    transaction: &Transaction<'_>,
    cell: &CellName,
    epoch: &str,
) -> Result<u64, ArchiveError> {
    let failed = ArchiveError::database("count records");
    let cell = cell.as_str();
    let sql = "INSERT INTO epochs (cell, epoch, archived) VALUES ($1, $2, 0)
        ON CONFLICT (cell, epoch) DO UPDATE SET archived = epochs.archived RETURNING archived";
    let before: i64 = transaction.query_one(sql, &[&cell, &epoch]).await.map_err(&failed)?.get(0);
    let sql =
        "SELECT number FROM records WHERE cell = $1 AND epoch = $2 AND number > $3 ORDER BY number LIMIT 10000";
    let mut archived = before;
    for row in transaction.query(sql, &[&cell, &epoch, &before]).await.map_err(&failed)? {
        if row.get::<_, i64>(0) != archived + 1 {
            break;
        }
        archived += 1;
    }
    let sql = "UPDATE epochs SET archived = $3 WHERE cell = $1 AND epoch = $2";
    transaction.execute(sql, &[&cell, &epoch, &archived]).await.map_err(&failed)?;
    Ok(archived.unsigned_abs())
}

/// Returns all epochs, each with the number up to which it is complete.
pub(super) async fn epochs(client: &Client) -> Result<Vec<(CellName, String, u64)>, ArchiveError> {
    let sql = "SELECT cell, epoch, archived FROM epochs ORDER BY cell, epoch";
    let rows = client.query(sql, &[]).await.map_err(ArchiveError::database("read its epochs"))?;
    let epoch = |row: &tokio_postgres::Row| {
        let cell = CellName::new(&row.get::<_, String>(0)).ok()?;
        Some((cell, row.get(1), row.get::<_, i64>(2).unsigned_abs()))
    };
    Ok(rows.iter().filter_map(epoch).collect())
}

fn number(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// The rows that are computed from a message.
#[derive(Debug, Clone, PartialEq)]
enum Rows {
    Cycle(CycleEnd),
    Verification(OfficeVerification),
    Signature(SignatureRows),
}

/// The rows of a signed statement.
#[derive(Debug, Clone, PartialEq)]
struct SignatureRows {
    pub cycle: i64,
    /// The number of the statement within its cell.
    pub statement: u64,
    pub unix_ms: i64,
    /// The name of the person who signed, and the meaning of the signature; `None` if the cell signed.
    pub person: Option<(String, &'static str)>,
    /// The measured quantities of the cycle; `None` if the statement does not contain them, or this program cannot read
    /// its record.
    pub quantities: Option<Quantities>,
}

/// The measured quantities of a cycle.
#[derive(Debug, Clone, PartialEq)]
struct Quantities {
    pub started_unix_s: i64,
    pub panel: String,
    /// Keyword and value of each quantity, and its limit as JSON.
    pub values: Vec<(&'static str, f64, String)>,
}

impl Rows {
    /// Computes the rows of a message, whose content was already parsed on arrival.
    pub fn from_message(message: &Message) -> Result<Self, String> {
        let wrong = |error: serde_json::Error| error.to_string();
        match &message.envelope.body {
            Body::Cycle(content) => serde_json::from_slice(content).map(Rows::Cycle).map_err(wrong),
            Body::Verification(content) => serde_json::from_slice(content).map(Rows::Verification).map_err(wrong),
            Body::Signature { statement, .. } => {
                let statement = Statement::read(statement).map_err(|error| error.to_string())?;
                Ok(Rows::Signature(signature_rows(&statement)))
            }
        }
    }
}

fn signature_rows(statement: &Statement) -> SignatureRows {
    let (person, quantities) = match &statement.says {
        StatementContent::Person(person) => (Some((person.name.clone(), person.meaning.printed_text())), None),
        StatementContent::Cycle(cycle) => (None, extract_quantities(cycle)),
    };
    SignatureRows {
        cycle: statement.cycle().0,
        statement: statement.number,
        unix_ms: statement.unix_ms,
        person,
        quantities,
    }
}

/// Returns the quantities of a cycle; `None` if another version of the program wrote the record in a format that cannot
/// be read. The archive stores such a record, too.
fn extract_quantities(cycle: &SignedCycle) -> Option<Quantities> {
    let record = cycle.cycle_record().ok()?;
    let past = PastCycle { record, part: cycle.part.clone(), disc: None };
    // The trends of the cell exclude these cycles as well.
    if past.record.is_air_run() || past.record.has_no_part() {
        return None;
    }
    let value = |known: KnownQuantity| {
        let (value, limit) = Quantity::Known(known).value_and_limit(&past)?;
        value.is_finite().then(|| (known.keyword(), value, serde_json::to_string(&limit).unwrap_or_default()))
    };
    let values = KnownQuantity::iter().filter_map(value).collect();
    Some(Quantities { started_unix_s: past.record.started_unix_s, panel: past.record.panel, values })
}
