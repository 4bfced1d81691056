//! A store that was restored from a backup: the numbers of its later cycles, and the parts whose abrasions it does not
//! know any more.
//!
//! A backup lacks what the cell did after it was made. The reason of the epoch that begins after a restore states the
//! last number that is known to be used, when the backup was made, and whether it is proven that nothing was abraded
//! since then. Without this proof, no cycle of a part begins before a person has stated for this part what happened
//! to it: another part is in the fixture, or the number of passes that it had in the lost cycles.

use super::cycles::CycleStart;
use super::database::Store;
use super::error::StoreError;
use super::lost_count::LostCount;
use super::part_passes::normalised_serial;
use super::parts;
use crate::cycle::{Event, Report};
use crate::record::{ANOTHER_PART_TEXT, CycleId, LostPasses};
use rusqlite::params;
use std::fmt;
use std::fs::File;
use std::io::Write;
use std::path::Path;

/// The reason why an epoch begins after a restore; a [`Restore`] as text follows it.
const RESTORED_ABOVE: &str = "the store was restored from a backup; cycles are numbered above ";
const MADE: &str = "the backup was made at second ";
const NOTHING_ABRADED: &str = "nothing was abraded since then";
/// Marks a store that was restored and not opened since; contains a [`Restore`] as text.
const RESTORED: &str = "panelprep.restored";

/// A restore of a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Restore {
    /// The last number of a cycle that is known to be used; later cycles are numbered above it.
    pub last_cycle: CycleId,
    /// Time at which the backup was made, s since 1970; `None` if an earlier version of this program restored it.
    pub made_unix_s: Option<i64>,
    /// Whether it is proven that nothing was abraded after the backup.
    pub is_nothing_abraded: bool,
}

impl Restore {
    /// Reads it; what the text does not state is not known.
    fn parse(text: &str) -> Self {
        let mut parts = text.trim().split("; ");
        let last = parts.next().and_then(|number| number.parse().ok()).unwrap_or(0);
        let mut restore = Restore { last_cycle: CycleId(last), made_unix_s: None, is_nothing_abraded: false };
        for part in parts {
            restore.is_nothing_abraded |= part == NOTHING_ABRADED;
            restore.made_unix_s =
                restore.made_unix_s.or(part.strip_prefix(MADE).and_then(|second| second.parse().ok()));
        }
        restore
    }
}

impl fmt::Display for Restore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.last_cycle.0)?;
        self.made_unix_s.map_or(Ok(()), |second| write!(f, "; {MADE}{second}"))?;
        if self.is_nothing_abraded { write!(f, "; {NOTHING_ABRADED}") } else { Ok(()) }
    }
}

impl Store {
    /// Marks the folder of a restored store: the store lacks the rows that were written after it was copied. Its next
    /// start begins a new epoch and rests in Aborted.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn mark_restored(folder: &Path, restore: &Restore) -> Result<(), StoreError> {
        let path = folder.join(RESTORED);
        let write = || -> std::io::Result<()> {
            let mut file = File::create(&path)?;
            file.write_all(restore.to_string().as_bytes())?;
            file.sync_all()?;
            File::open(folder)?.sync_all()
        };
        write().map_err(|source| StoreError::File { operation: "write", path: path.clone(), source })
    }

    /// Returns what the store in the folder `replaced` shows about the time after the backup that is unpacked in
    /// `backup`. `None` if it cannot be read or is not a later state of the same store: then it does not show which
    /// numbers were used.
    pub fn compute_restore(replaced: &Path, backup: &Path, made_unix_s: i64) -> Option<Restore> {
        let (later, store) = (Store::open(replaced).ok()?, Store::open(backup).ok()?);
        let last_epoch = store.outbox_epochs().ok()?.pop()?.epoch;
        let is_same = later.outbox_epochs().ok()?.iter().any(|epoch| epoch.epoch == last_epoch);
        if !is_same {
            return None;
        }
        let last = later.newest_cycle().ok()?.map_or(0, |cycle| cycle.0).max(later.numbered_above().ok()?);
        let waiting = mark_in(replaced).ok()?;
        // Permits are committed before contact. Only in a store without a missing row do they show that there was none.
        let is_whole = || Store::verify(replaced, false).is_ok_and(|verified| verified.differences.is_empty());
        let is_nothing_abraded = waiting.is_none_or(|waiting| waiting.is_nothing_abraded)
            && later.last_permit().ok()? == store.last_permit().ok()?
            && later.restores().ok()?.len() == store.restores().ok()?.len()
            && is_whole();
        let last = last.max(waiting.map_or(0, |waiting| waiting.last_cycle.0));
        Some(Restore { last_cycle: CycleId(last), made_unix_s: Some(made_unix_s), is_nothing_abraded })
    }

    fn last_permit(&self) -> Result<i64, StoreError> {
        let last = self.connection.query_row("SELECT coalesce(max(id), 0) FROM permits", [], |row| row.get(0));
        last.map_err(|error| self.database_error("read the motions of", &error))
    }

    /// Begins a new epoch if the store was restored, and leaves the cell aborted.
    pub(super) fn begin_epoch_if_restored(&mut self) -> Result<(), StoreError> {
        let Some(marked) = mark_in(self.folder())? else { return Ok(()) };
        self.recover()?;
        self.append(&Event::Reported(Report::StoreRestored), None)?;
        let replaced = marked.last_cycle.0;
        let own = self.newest_cycle()?.map_or(0, |cycle| cycle.0).max(self.numbered_above()?);
        let restore = Restore { last_cycle: CycleId(own.max(replaced)), ..marked };
        self.begin_epoch(&format!("{RESTORED_ABOVE}{restore}"))?;
        let path = self.folder().join(RESTORED);
        std::fs::remove_file(&path).map_err(|source| StoreError::File { operation: "remove", path, source })
    }

    /// The restores of this store, in order, each with the time at which the store was first opened, ms since 1970.
    fn restores(&self) -> Result<Vec<(Restore, i64)>, StoreError> {
        if !self.has_table("outbox")? {
            return Ok(Vec::new());
        }
        let read = || -> Result<Vec<(Restore, i64)>, rusqlite::Error> {
            let sql = "SELECT substr(why, length(?1) + 1), unix_ms FROM outbox_epochs
                 WHERE substr(why, 1, length(?1)) = ?1 ORDER BY id";
            let restore =
                |row: &rusqlite::Row<'_>| Ok((Restore::parse(&row.get::<_, String>(0)?), row.get::<_, i64>(1)?));
            self.connection.prepare_cached(sql)?.query_map([RESTORED_ABOVE], restore)?.collect()
        };
        read().map_err(|error| self.database_error("read the epochs of", &error))
    }

    /// The number above which cycles continue after restores; 0 if there was none.
    pub(super) fn numbered_above(&self) -> Result<i64, StoreError> {
        Ok(self.restores()?.iter().map(|(restore, _)| restore.last_cycle.0).max().unwrap_or(0))
    }

    /// Returns why the abrasions of this panel's part cannot be counted: cycles are lost by a restore, and since then
    /// no start stated what happened to the part in them. An empty serial number means a part without one.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn lost_count(&self, panel: &str, serial: &str) -> Result<Option<LostCount>, StoreError> {
        let mut restores = self.restores()?;
        restores.retain(|(restore, _)| !restore.is_nothing_abraded);
        let Some((first, _)) = restores.first() else { return Ok(None) };
        let stated = self.last_statement((panel, serial), first.last_cycle)?;
        let is_open = |(restore, _): &&(Restore, i64)| stated.is_none_or(|stated| stated.0 <= restore.last_cycle.0);
        Ok(restores.iter().find(is_open).map(|(restore, opened_unix_ms)| LostCount {
            serial: serial.trim().to_owned(),
            made_unix_s: restore.made_unix_s,
            restored_unix_s: opened_unix_ms.div_euclid(1_000),
        }))
    }

    /// The last cycle above this number whose start stated what happened to the part in lost cycles.
    fn last_statement(&self, (panel, serial): (&str, &str), above: CycleId) -> Result<Option<CycleId>, StoreError> {
        self.ensure_parts_table()?;
        let read = || -> Result<Vec<(i64, String)>, rusqlite::Error> {
            let sql =
                "SELECT cycles.id, coalesce(serial, '') FROM cycles LEFT JOIN cycle_parts ON cycle_id = cycles.id
                 WHERE panel = ?1 AND cycles.id > ?2
                 AND EXISTS (SELECT 1 FROM json_each(files) WHERE value ->> 'name' IN (?3, ?4)) ORDER BY 1 DESC";
            let mut statement = self.connection.prepare_cached(sql)?;
            let values = params![panel, above.0, ANOTHER_PART_TEXT, LostPasses::FILE];
            statement.query_map(values, |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        let cycles = read().map_err(|error| self.database_error("read the cycles of", &error))?;
        let own = normalised_serial(serial);
        Ok(cycles.into_iter().find(|(_, of)| normalised_serial(of) == own).map(|(id, _)| CycleId(id)))
    }

    /// Refuses a cycle whose abrasions could not be counted. An air-run abrades nothing.
    pub(super) fn check_count(&self, start: &CycleStart) -> Result<(), StoreError> {
        let is_stated = |(name, text): &(String, String)| {
            name == ANOTHER_PART_TEXT || (name == LostPasses::FILE && LostPasses::read(text).is_some())
        };
        if start.is_air_run || start.file_texts.iter().any(is_stated) {
            return Ok(());
        }
        let serial = parts::parse_part(&start.file_texts).and_then(|part| part.serial).unwrap_or_default();
        self.lost_count(&start.panel, &serial)?.map_or(Ok(()), |lost| Err(StoreError::CountUnknown(lost)))
    }
}

/// Returns the mark of a store that was restored and not opened since.
fn mark_in(folder: &Path) -> Result<Option<Restore>, StoreError> {
    let path = folder.join(RESTORED);
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(Some(Restore::parse(&text))),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(source) => Err(StoreError::File { operation: "read", path, source }),
    }
}
