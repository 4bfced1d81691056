//! Recipes by their content: the cells in which each version ran, and since when.

use super::reader::Reader;
use crate::archive::error::ArchiveError;
use panelprep_store::office::RecipeOffer;

/// The use of a version of a recipe in a cell.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct RecipeUse {
    /// The recipe's panel.
    pub panel: String,
    /// SHA-256 of the recipe's text.
    pub recipe_hash: String,
    /// The cell.
    pub cell: String,
    /// Time at which the first cycle with this recipe began in this cell, s since 1970.
    pub first_unix_s: i64,
    /// Time at which the last cycle with this recipe began in this cell, s since 1970.
    pub last_unix_s: i64,
    /// Number of cycles with this recipe in this cell.
    pub cycles: i64,
    /// Number of these cycles that passed.
    pub passed: i64,
}

impl Reader {
    /// Returns the office's offer for this panel; `None` if there is none.
    ///
    /// # Errors
    /// If the database does not answer.
    pub async fn offer(&self, panel: &str) -> Result<Option<RecipeOffer>, ArchiveError> {
        let rows = self.rows("SELECT offer FROM offers WHERE panel = $1", &[&panel]).await?;
        Ok(rows.first().and_then(|row| RecipeOffer::read(&row.get::<_, Vec<u8>>(0)).ok()))
    }

    /// Returns every version of a panel's recipe in every cell, the most recently used first.
    ///
    /// # Errors
    /// If the database does not answer.
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
