//! The queries of the office's pages:
//!
//! - the current state of all cells
//! - cycles, the newest first, and single cycles with their records
//! - the values of one quantity of a panel
//! - the verifications in all cells, which show a cell that differs from the others
//! - recipes by their content: the cells in which each version was used, and since when
//! - accounts: a person with an account may read; no account may change data
//!
//! A [`Reader`] has one connection to the database, and the folder of files. Every query uses an index and returns a
//! limited number of rows, so that it is as fast with a million records as with a thousand.

use super::database::{self, ArchiveError};
use super::files::ContentFiles;
use panelprep_base::verdict::Limit;
use panelprep_store::history::TrendPoint;
use panelprep_store::office::{ArchiveSettings, CellState, RecipeOffer};
use panelprep_store::signing::{SignedCycle, Statement, StatementContent};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Mutex;
use tokio_postgres::Client;
use tokio_postgres::types::ToSql;

/// Maximum time until the database replies to a query of a page.
const QUERY_TIMEOUT: Duration = Duration::from_secs(15);

/// A reader of the archive. Clones share one connection, which is renewed after it was lost.
#[derive(Clone)]
pub struct Reader {
    settings: Arc<ArchiveSettings>,
    client: Arc<Mutex<Option<Arc<Client>>>>,
    files: ContentFiles,
}

type SqlValues<'v> = &'v [&'v (dyn ToSql + Sync)];

impl Reader {
    /// Creates a reader of the archive with these settings, without connecting to the database.
    pub fn new(settings: &ArchiveSettings) -> Self {
        let files = ContentFiles::in_folder(&settings.files);
        Reader { settings: Arc::new(settings.clone()), client: Arc::default(), files }
    }

    /// Returns the content of a file that a record names; `None` if the file is missing or damaged.
    pub fn file(&self, hash: &str) -> Option<Vec<u8>> {
        self.files.get(hash)
    }

    async fn client(&self) -> Result<Arc<Client>, ArchiveError> {
        let mut client = self.client.lock().await;
        match client.as_ref().filter(|client| !client.is_closed()) {
            Some(client) => Ok(client.clone()),
            None => {
                let new = Arc::new(database::open(&self.settings.database).await?);
                *client = Some(new.clone());
                Ok(new)
            }
        }
    }

    async fn rows(&self, sql: &str, values: SqlValues<'_>) -> Result<Vec<tokio_postgres::Row>, ArchiveError> {
        let failed = ArchiveError::database("read the archive");
        let client = self.client().await?;
        // These queries are not prepared: a preparation would need another round trip, and the server plans them in
        // less than a millisecond.
        self.with_timeout(async { client.query(sql, values).await.map_err(failed) }).await
    }

    async fn execute(&self, sql: &str, values: SqlValues<'_>) -> Result<u64, ArchiveError> {
        let failed = ArchiveError::database("write to the archive");
        let client = self.client().await?;
        self.with_timeout(async { client.execute(sql, values).await.map_err(failed) }).await
    }

    /// Waits for a reply within the time limit. If the database does not reply, the connection is dropped, so that the
    /// next query connects again.
    async fn with_timeout<T>(
        &self,
        asking: impl Future<Output = Result<T, ArchiveError>>,
    ) -> Result<T, ArchiveError> {
        let answered = database::with_timeout(QUERY_TIMEOUT, asking).await;
        if let Err(ArchiveError::Silent { .. }) = answered {
            *self.client.lock().await = None;
        }
        answered
    }
}

/// The current state of a cell, as known to the office server.
#[derive(Debug, Clone, PartialEq)]
pub struct CellNow {
    /// The name of the cell.
    pub cell: String,
    /// Time of the cell's last report by the database's clock, ms since 1970; `None` if it has never reported.
    pub heard_unix_ms: Option<i64>,
    /// The state in the last report.
    pub state: Option<CellState>,
    /// Number of the cell's records that are missing in the archive, according to its last report; `None` without a
    /// report.
    pub missing_records: Option<u64>,
    /// The newest cycle: its number, verdict and start time, s since 1970.
    pub last: Option<(i64, String, i64)>,
    /// Number of cycles on the last day, for each verdict.
    pub last_day_counts: Vec<VerdictCount>,
}

/// The number of cycles with a verdict.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VerdictCount {
    /// The keyword of the verdict.
    pub verdict: String,
    /// Number of cycles with this verdict.
    pub count: i64,
}

impl Reader {
    /// Returns all cells in the order of their names, and the time of the database's clock, ms since 1970.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn cells(&self) -> Result<(Vec<CellNow>, i64), ArchiveError> {
        let known =
            "SELECT known.cell, cells.heard_unix_ms, cells.state, last.cycle, last.verdict, last.started_unix_s
            FROM (SELECT cell FROM epochs UNION SELECT cell FROM cells) AS known
            LEFT JOIN cells ON cells.cell = known.cell
            LEFT JOIN LATERAL (SELECT cycle, verdict, started_unix_s FROM cycles WHERE cycles.cell = known.cell
                ORDER BY started_unix_s DESC LIMIT 1) AS last ON TRUE
            ORDER BY known.cell";
        let now = self.rows("SELECT (extract(epoch FROM now()) * 1000)::bigint", &[]).await?;
        let now_unix_ms: i64 = now.first().map_or(0, |row| row.get(0));
        let day_s = now_unix_ms / 1_000 - 86_400;
        let counts = "SELECT cell, verdict, count(*) FROM cycles WHERE started_unix_s >= $1 GROUP BY cell, verdict
            ORDER BY cell, verdict";
        let mut day: BTreeMap<String, Vec<VerdictCount>> = BTreeMap::new();
        for row in self.rows(counts, &[&day_s]).await? {
            day.entry(row.get(0)).or_default().push(VerdictCount { verdict: row.get(1), count: row.get(2) });
        }
        let mut archived: BTreeMap<(String, String), i64> = BTreeMap::new();
        for row in self.rows("SELECT cell, epoch, archived FROM epochs", &[]).await? {
            archived.insert((row.get(0), row.get(1)), row.get(2));
        }
        let cell = |row: tokio_postgres::Row| {
            let cell: String = row.get(0);
            let text: Option<String> = row.get(2);
            let state = text.and_then(|text| CellState::read(text.as_bytes()).ok()).map(|(_, state)| state);
            let behind = state.as_ref().map(|state| {
                let missing = state.last.iter().map(|last| {
                    let has = archived.get(&(cell.clone(), last.epoch.clone())).copied().unwrap_or(0);
                    last.number.saturating_sub(has.unsigned_abs())
                });
                missing.sum()
            });
            let last = row.get::<_, Option<i64>>(3).map(|cycle| (cycle, row.get(4), row.get(5)));
            let day = day.remove(&cell).unwrap_or_default();
            CellNow { heard_unix_ms: row.get(1), state, missing_records: behind, last, last_day_counts: day, cell }
        };
        Ok((self.rows(known, &[]).await?.into_iter().map(cell).collect(), now_unix_ms))
    }
}

/// The filter of a search for cycles. An empty field matches all cycles.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CycleQuery {
    /// The name of the cell.
    pub cell: String,
    /// The name of the panel.
    pub panel: String,
    /// The part's serial number; upper and lower case are equal.
    pub serial: String,
    /// The keyword of the verdict.
    pub verdict: String,
    /// Earliest start time, s since 1970.
    pub from_unix_s: Option<i64>,
    /// Cycles that start before this time, s since 1970.
    pub until_unix_s: Option<i64>,
    /// The last cycle of the previous page: its start time, cell and number. Only older cycles are returned.
    pub before: Option<(i64, String, i64)>,
    /// The maximum number of cycles.
    pub limit: i64,
}

/// A cycle in the archive.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct CycleRow {
    /// The name of the cell.
    pub cell: String,
    /// Number of the cycle in its cell.
    pub cycle: i64,
    /// Start time of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// End time of the cycle, s since 1970.
    pub ended_unix_s: Option<i64>,
    /// The name of the panel.
    pub panel: String,
    /// The part's serial number.
    pub serial: Option<String>,
    /// The work order of the part.
    pub work_order: Option<String>,
    /// The name of the operator.
    pub operator: Option<String>,
    /// The keyword of the verdict.
    pub verdict: String,
    /// The verdict's reasons as JSON: code and message.
    pub reasons: String,
    /// SHA-256 of the recipe's text.
    pub recipe_hash: String,
    /// The version of the program.
    pub program_version: String,
}

/// A signed statement about a cycle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordSignature {
    /// The number of the statement within its cell.
    pub statement: i64,
    /// SHA-256 of the signed statement.
    pub record_hash: String,
    /// Time of the signature, ms since 1970.
    pub unix_ms: i64,
    /// The printed name of the person who signed, and the meaning of the signature; `None` if the cell signed.
    pub person: Option<(String, String)>,
}

/// A cycle with its signed statements.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// The cycle without its signatures.
    pub row: CycleRow,
    /// The signatures on the cycle, in order.
    pub signed: Vec<RecordSignature>,
    /// The statement that the cell signed; `None` if it has not been received.
    pub statement: Option<SignedCycle>,
}

const COLUMNS: &str = "cell, cycle, started_unix_s, ended_unix_s, panel, serial, work_order, operator, verdict, reasons, recipe_hash, program_version";

fn cycle_row(row: &tokio_postgres::Row) -> CycleRow {
    CycleRow {
        cell: row.get(0),
        cycle: row.get(1),
        started_unix_s: row.get(2),
        ended_unix_s: row.get(3),
        panel: row.get(4),
        serial: row.get(5),
        work_order: row.get(6),
        operator: row.get(7),
        verdict: row.get(8),
        reasons: row.get(9),
        recipe_hash: row.get(10),
        program_version: row.get(11),
    }
}

impl Reader {
    /// Returns the cycles that match a query, the newest first.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn cycles(&self, query: &CycleQuery) -> Result<Vec<CycleRow>, ArchiveError> {
        let CycleQuery { cell, panel, serial, verdict, from_unix_s, until_unix_s, before, limit } = query;
        let serial = serial.to_lowercase();
        let (before_s, before_cell, before_cycle) = before.clone().unwrap_or((i64::MAX, String::new(), i64::MAX));
        let (from_s, until_s) = (from_unix_s.unwrap_or(i64::MIN), until_unix_s.unwrap_or(i64::MAX));
        let mut values: Vec<&(dyn tokio_postgres::types::ToSql + Sync)> =
            vec![&before_s, &before_cell, &before_cycle, &from_s, &until_s, limit];
        // The SQL text contains only the conditions of this query, so that the server can choose a suitable index.
        let mut conditions = String::new();
        for (column, value) in [("cell", cell), ("panel", panel), ("lower(serial)", &serial), ("verdict", verdict)]
        {
            if !value.is_empty() {
                values.push(value);
                conditions += &format!(" AND {column} = ${}", values.len());
            }
        }
        let sql = format!(
            "SELECT {COLUMNS} FROM cycles WHERE started_unix_s <= $1 AND (started_unix_s, cell, cycle) < ($1, $2, $3)
             AND started_unix_s >= $4 AND started_unix_s < $5{conditions}
             ORDER BY started_unix_s DESC, cell DESC, cycle DESC LIMIT $6"
        );
        Ok(self.rows(&sql, &values).await?.iter().map(cycle_row).collect())
    }

    /// Returns a cycle of a cell with its signed statements. If several cycles have this number, the newest one is
    /// returned.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn record(&self, cell: &str, cycle: i64) -> Result<Option<Record>, ArchiveError> {
        let sql = format!(
            "SELECT {COLUMNS} FROM cycles WHERE cell = $1 AND cycle = $2 ORDER BY started_unix_s DESC LIMIT 1"
        );
        let rows = self.rows(&sql, &[&cell, &cycle]).await?;
        let Some(row) = rows.first().map(cycle_row) else { return Ok(None) };
        let sql =
            "SELECT statement, record_hash, unix_ms, name, meaning FROM signatures WHERE cell = $1 AND cycle = $2
            ORDER BY statement";
        let signed = self.rows(sql, &[&cell, &cycle]).await?.into_iter().map(|row| RecordSignature {
            statement: row.get(0),
            record_hash: row.get(1),
            unix_ms: row.get(2),
            person: row.get::<_, Option<String>>(3).zip(row.get::<_, Option<String>>(4)),
        });
        let signed: Vec<RecordSignature> = signed.collect();
        let mut statement = None;
        if let Some(own) = signed.iter().rfind(|one| one.person.is_none()) {
            let sql = "SELECT content FROM records JOIN signatures USING (cell, epoch, number)
                WHERE signatures.cell = $1 AND statement = $2 AND record_hash = $3 LIMIT 1";
            let rows = self.rows(sql, &[&cell, &own.statement, &own.record_hash]).await?;
            let content: Option<Vec<u8>> = rows.first().map(|row| row.get(0));
            statement =
                content.and_then(|content| Statement::read(&content).ok()).and_then(|read| match read.says {
                    StatementContent::Cycle(cycle) => Some(cycle),
                    StatementContent::Person(_) => None,
                });
        }
        Ok(Some(Record { row, signed, statement }))
    }

    /// Returns the names of all panels with cycles, and the names of all cells.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn names(&self) -> Result<(Vec<String>, Vec<String>), ArchiveError> {
        // Each next name is found through the index, so that the query does not read a table of a million cycles to
        // find ten names.
        let panels = "WITH RECURSIVE name AS (SELECT min(panel) AS panel FROM cycles
            UNION ALL SELECT (SELECT min(panel) FROM cycles WHERE panel > name.panel) FROM name WHERE name.panel IS NOT NULL)
            SELECT panel FROM name WHERE panel IS NOT NULL LIMIT 1000";
        let panels = self.rows(panels, &[]).await?.iter().map(|row| row.get(0)).collect();
        let cells = self.rows("SELECT DISTINCT cell FROM epochs ORDER BY cell", &[]).await?;
        Ok((panels, cells.iter().map(|row| row.get(0)).collect()))
    }
}

/// The values of one cell, the oldest first.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct CellNumbers {
    /// The name of the cell.
    pub cell: String,
    /// The values of the cell.
    pub points: Vec<TrendPoint>,
}

fn group_by_cell(values: impl Iterator<Item = (String, TrendPoint)>) -> Vec<CellNumbers> {
    let mut cells: BTreeMap<String, Vec<TrendPoint>> = BTreeMap::new();
    for (cell, point) in values {
        cells.entry(cell).or_default().push(point);
    }
    cells.into_iter().map(|(cell, points)| CellNumbers { cell, points }).collect()
}

fn point(at_unix_s: i64, value: f64, limit: Limit) -> TrendPoint {
    TrendPoint { cycle: None, at_unix_s, serial: None, value, limit }
}

impl Reader {
    /// Returns the newest values of a quantity of a panel in all cells, at most `most`, grouped by cell, the oldest
    /// first.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn numbers(&self, panel: &str, quantity: &str, most: i64) -> Result<Vec<CellNumbers>, ArchiveError> {
        let sql = "SELECT cell, started_unix_s, value, allowed FROM quantities WHERE panel = $1 AND quantity = $2
            ORDER BY started_unix_s DESC LIMIT $3";
        let rows = self.rows(sql, &[&panel, &quantity, &most]).await?;
        let value = |row: &tokio_postgres::Row| {
            let limit = serde_json::from_str(&row.get::<_, String>(3)).unwrap_or(Limit::Unlimited);
            (row.get(0), point(row.get(1), row.get(2), limit))
        };
        Ok(group_by_cell(rows.iter().rev().map(value)))
    }

    /// Returns the newest verifications of a device in all cells, at most `most` for each cell, grouped by cell, the
    /// oldest first.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn verifications(&self, subject: &str, most: i64) -> Result<Vec<CellNumbers>, ArchiveError> {
        let sql = "SELECT epochs.cell, seen.at_unix_s, seen.error, seen.allowed
            FROM (SELECT DISTINCT cell FROM epochs) AS epochs
            CROSS JOIN LATERAL (SELECT at_unix_s, error, allowed FROM verifications
                WHERE verifications.cell = epochs.cell AND subject = $1 ORDER BY at_unix_s DESC LIMIT $2) AS seen
            ORDER BY epochs.cell, seen.at_unix_s";
        let rows = self.rows(sql, &[&subject, &most]).await?;
        let value =
            |row: &tokio_postgres::Row| (row.get(0), point(row.get(1), row.get(2), Limit::AtMost(row.get(3))));
        Ok(group_by_cell(rows.iter().map(value)))
    }
}

/// The use of a version of a recipe in a cell.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct RecipeUse {
    /// The panel of the recipe.
    pub panel: String,
    /// SHA-256 of the recipe's text.
    pub recipe_hash: String,
    /// The name of the cell.
    pub cell: String,
    /// Start time of the first cycle with this recipe in this cell, s since 1970.
    pub first_unix_s: i64,
    /// Start time of the last cycle with this recipe in this cell, s since 1970.
    pub last_unix_s: i64,
    /// Number of cycles with this recipe in this cell.
    pub cycles: i64,
    /// Number of these cycles that passed.
    pub passed: i64,
}

impl Reader {
    /// Returns the recipe that the office offers for this panel; `None` if there is no offer.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn offer(&self, panel: &str) -> Result<Option<RecipeOffer>, ArchiveError> {
        let rows = self.rows("SELECT offer FROM offers WHERE panel = $1", &[&panel]).await?;
        Ok(rows.first().and_then(|row| RecipeOffer::read(&row.get::<_, Vec<u8>>(0)).ok()))
    }

    /// Returns the use of every version of a panel's recipe in every cell, the most recently used version first.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn recipes(&self, panel: &str) -> Result<Vec<RecipeUse>, ArchiveError> {
        let sql =
            "SELECT recipe_hash, cell, first_unix_s, last_unix_s, cycles, passed FROM recipe_uses WHERE panel = $1
            ORDER BY last_unix_s DESC LIMIT 1000";
        let used = |row: &tokio_postgres::Row| RecipeUse {
            panel: panel.to_owned(),
            recipe_hash: row.get(0),
            cell: row.get(1),
            first_unix_s: row.get(2),
            last_unix_s: row.get(3),
            cycles: row.get(4),
            passed: row.get(5),
        };
        Ok(self.rows(sql, &[&panel]).await?.iter().map(used).collect())
    }
}

/// An account for the office's page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OfficeAccount {
    /// The name with which the person logs in.
    pub name: String,
    /// The person's printed name.
    pub printed_name: String,
    /// The hash of the password (`accounts::hash_password`).
    pub password_hash: String,
}

impl Reader {
    /// Returns the account with this name.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn account(&self, name: &str) -> Result<Option<OfficeAccount>, ArchiveError> {
        let sql = "SELECT name, printed_name, password_hash FROM accounts WHERE name = $1";
        let rows = self.rows(sql, &[&name]).await?;
        let account = |row: &tokio_postgres::Row| OfficeAccount {
            name: row.get(0),
            printed_name: row.get(1),
            password_hash: row.get(2),
        };
        Ok(rows.first().map(account))
    }

    /// Stores an account, and replaces an existing account with the same name.
    ///
    /// # Errors
    /// If the database does not reply.
    pub async fn store_account(&self, account: &OfficeAccount) -> Result<(), ArchiveError> {
        let sql = "INSERT INTO accounts (name, printed_name, password_hash) VALUES ($1, $2, $3)
            ON CONFLICT (name) DO UPDATE SET printed_name = EXCLUDED.printed_name, password_hash = EXCLUDED.password_hash";
        let OfficeAccount { name, printed_name, password_hash } = account;
        self.execute(sql, &[name, printed_name, password_hash]).await.map(drop)
    }
}
