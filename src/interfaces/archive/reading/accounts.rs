//! Accounts of the office's page: a person with an account may read, and no one may change anything.

use super::reader::Reader;
use crate::archive::error::ArchiveError;

/// An account.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OfficeAccount {
    /// The name by which its owner logs in.
    pub name: String,
    /// The owner's printed name.
    pub printed_name: String,
    /// The password's hash (`accounts::hash_password`).
    pub password_hash: String,
}

impl Reader {
    /// Returns the account with this name.
    ///
    /// # Errors
    /// If the database does not answer.
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

    /// Stores an account; an account of the same name is replaced.
    ///
    /// # Errors
    /// If the database does not answer.
    pub async fn store_account(&self, account: &OfficeAccount) -> Result<(), ArchiveError> {
        let sql = "INSERT INTO accounts (name, printed_name, password_hash) VALUES ($1, $2, $3)
            ON CONFLICT (name) DO UPDATE SET printed_name = EXCLUDED.printed_name, password_hash = EXCLUDED.password_hash";
        let OfficeAccount { name, printed_name, password_hash } = account;
        self.change(sql, &[name, printed_name, password_hash]).await.map(drop)
    }
}
