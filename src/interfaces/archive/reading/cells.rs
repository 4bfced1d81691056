//! The current state of all cells.

use super::reader::Reader;
use crate::archive::error::ArchiveError;
use panelprep_store::office::CellState;
use std::collections::BTreeMap;

/// A cell as the office sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct CellNow {
    /// Its name.
    pub cell: String,
    /// The time of its last report, ms since 1970 by the database's clock; `None` if it never reported.
    pub heard_unix_ms: Option<i64>,
    /// The state that it reported.
    pub state: Option<CellState>,
    /// The number of its records that the archive lacks, by its last report; `None` if it reported nothing.
    pub missing_records: Option<u64>,
    /// The newest cycle: number, verdict and when it began, s since 1970.
    pub last: Option<(i64, String, i64)>,
    /// The cell's cycles of the last day, by their verdicts.
    pub last_day_counts: Vec<VerdictCount>,
}

/// The number of cycles with a verdict.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VerdictCount {
    /// The verdict's word.
    pub verdict: String,
    /// Number of cycles with this verdict.
    pub count: i64,
}

impl Reader {
    /// Returns all cells, by name, and the database's clock, ms since 1970.
    ///
    /// # Errors
    /// If the database does not answer.
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
