//! The values of one quantity of a panel in all cells, and the verifications of all cells: they show which cell
//! differs from the others.

use super::reader::Reader;
use crate::archive::error::ArchiveError;
use panelprep_base::verdict::Limit;
use panelprep_store::history::TrendPoint;
use std::collections::BTreeMap;

/// Values of one cell, the oldest first.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct CellNumbers {
    /// The cell.
    pub cell: String,
    /// Its values.
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
    /// Returns the newest values of a quantity of a panel in all cells, at most `most`: grouped by cell, the oldest
    /// first.
    ///
    /// # Errors
    /// If the database does not answer.
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

    /// Returns the newest verifications of a subject in all cells, at most `most` for each cell: grouped by cell, the
    /// oldest first.
    ///
    /// # Errors
    /// If the database does not answer.
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
