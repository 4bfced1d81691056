//! A reader of the archive: one connection to the database, and the folder of files.

use crate::archive::database;
use crate::archive::error::ArchiveError;
use crate::archive::files::ContentFiles;
use panelprep_store::office::ArchiveSettings;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Mutex;
use tokio_postgres::Client;
use tokio_postgres::types::ToSql;

/// Maximum time that a page waits for the database.
const QUERY_TIMEOUT: Duration = Duration::from_secs(15);

/// A reader of the archive. Clones share one connection, which is made anew if it was lost.
#[derive(Clone)]
pub struct Reader {
    settings: Arc<ArchiveSettings>,
    client: Arc<Mutex<Option<Arc<Client>>>>,
    files: ContentFiles,
}

pub(super) type SqlValues<'v> = &'v [&'v (dyn ToSql + Sync)];

impl Reader {
    /// Creates a reader of the archive with these settings; it does not connect yet.
    pub fn new(settings: &ArchiveSettings) -> Self {
        let files = ContentFiles::in_folder(&settings.files);
        Reader { settings: Arc::new(settings.clone()), client: Arc::default(), files }
    }

    /// Returns the bytes of a file that a record names; `None` if it is missing or not whole.
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

    pub(super) async fn rows(
        &self,
        sql: &str,
        values: SqlValues<'_>,
    ) -> Result<Vec<tokio_postgres::Row>, ArchiveError> {
        let failed = ArchiveError::database("read the archive");
        let client = self.client().await?;
        // If the library prepared each query, it would need one more round trip each time; the server plans these
        // queries in less than a millisecond.
        self.with_timeout(async { client.query(sql, values).await.map_err(failed) }).await
    }

    pub(super) async fn change(&self, sql: &str, values: SqlValues<'_>) -> Result<u64, ArchiveError> {
        let failed = ArchiveError::database("write to the archive");
        let client = self.client().await?;
        self.with_timeout(async { client.execute(sql, values).await.map_err(failed) }).await
    }

    /// Waits for an answer within the time limit. The connection to a database that does not answer is dropped, so
    /// that the next page connects again.
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
