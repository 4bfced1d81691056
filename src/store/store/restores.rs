//! A store that was restored from a backup: the numbers of its further cycles, and the parts whose number of sanding
//! passes is unknown.
//!
//! A backup does not contain the cycles after it was made. After a restore, a new epoch begins; its reason states the
//! last cycle number that is known to be used, the time of the backup, and whether it is proven that nothing was sanded
//! after the backup. Without this proof, no cycle with a part begins until a person has stated the number of sanding
//! passes on this part in the lost cycles. For a part without a serial number, it is also sufficient to state that a
//! different part is in the fixture.

use super::cycles::{CycleStart, normalised_serial};
use super::database::Store;
use super::error::{StoreError, UnknownPassCount};
use super::{chain, search};
use panelprep_cell::cycle::{Event, Report};
use panelprep_cell::record::{ANOTHER_PART_TEXT, CycleId, LostPasses};
use rusqlite::params;
use std::fmt;
use std::fs::File;
use std::io::Write;
use std::path::Path;

/// Beginning of the reason for a new epoch after a restore; a [`Restore`] as text follows.
const RESTORED_ABOVE: &str = "the store was restored from a backup; cycles are numbered above ";
const MADE: &str = "the backup was made at second ";
const NOTHING_ABRADED: &str = "nothing was abraded since then";
/// Name of the file that marks a store as restored but not opened yet. It contains a [`Restore`] as text.
const RESTORED_MARK_FILE: &str = "panelprep.restored";

/// What is known about the cycles after a backup that was restored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Restore {
    /// The last cycle number that is known to be used; further cycles have higher numbers.
    pub last_cycle: CycleId,
    /// Time at which the backup was made, s since 1970; `None` if the mark of the restore does not state it.
    pub made_unix_s: Option<i64>,
    /// Whether it is proven that nothing was sanded after the backup.
    pub is_nothing_abraded: bool,
}

impl Restore {
    /// Parses a restore; values that the text does not contain are treated as unknown.
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
    /// Marks the store in this folder as restored. At the next start a new epoch begins, and the state of the cell is
    /// Aborted.
    ///
    /// # Errors
    /// If the mark cannot be written.
    pub fn mark_restored(folder: &Path, restore: &Restore) -> Result<(), StoreError> {
        let path = folder.join(RESTORED_MARK_FILE);
        let write = || -> std::io::Result<()> {
            let mut file = File::create(&path)?;
            file.write_all(restore.to_string().as_bytes())?;
            file.sync_all()?;
            File::open(folder)?.sync_all()
        };
        write().map_err(|source| StoreError::File { operation: "write", path: path.clone(), source })
    }

    /// Returns what the store in `replaced` shows about the cycles after the backup, which is unpacked and verified in
    /// `backup`. Returns `None` if `replaced` is not a later state of the same store. It is a later state if its hash
    /// chain contains the last link of the backup's chain, no row contradicts its chain, and its incidents are those of
    /// the backup.
    ///
    /// A later state has the same beginning as the backup, and no row is missing before the end that its own head
    /// states. But this end need not be the newest one: an older copy of the store is a later state as well. A person
    /// may also have written the rows after the backup and the head, because the chain contains no secret. Therefore
    /// the caller compares the number of the last cycle with a number from another source.
    pub fn compute_restore(replaced: &Path, backup: &Path, made_unix_s: i64) -> Option<Restore> {
        // The store is verified before a connection is opened, because the verification closes the database file, which
        // would release the locks of the connection.
        let is_whole = Store::verify(replaced, false).is_ok_and(|verified| verified.differences.is_empty());
        if !is_whole {
            return None;
        }
        let (later, store) = (Store::open(replaced).ok()?, Store::open(backup).ok()?);
        if !later.continues(&store).ok()? {
            return None;
        }
        let waiting = mark_in(replaced).ok()?;
        // Permits are committed before contact, so equal permits prove that nothing was sanded.
        let is_nothing_abraded = waiting.is_none_or(|waiting| waiting.is_nothing_abraded)
            && later.last_permit().ok()? == store.last_permit().ok()?
            && later.restores().ok()?.len() == store.restores().ok()?.len();
        let last = later.last_number().ok()?.max(waiting.map_or(0, |waiting| waiting.last_cycle.0));
        Some(Restore { last_cycle: CycleId(last), made_unix_s: Some(made_unix_s), is_nothing_abraded })
    }

    /// Returns the number of the last cycle in the store in `replaced`, if it has an epoch of the store in `backup`.
    /// The store may be damaged or changed: the number proves nothing, but all numbers up to it may have been used.
    /// Returns `None` if the number cannot be read, or it is another store.
    pub fn last_readable_number(replaced: &Path, backup: &Path) -> Option<CycleId> {
        let (found, store) = (Store::open_any_schema(replaced).ok()?, Store::open(backup).ok()?);
        let epochs = store.outbox_epochs().ok()?;
        let is_known = |epoch: &str| epochs.iter().any(|own| own.epoch == epoch);
        let is_same = found.outbox_epochs().ok()?.iter().any(|epoch| is_known(&epoch.epoch));
        if is_same { found.last_number().ok().map(CycleId) } else { None }
    }

    /// Returns whether this store's chain contains the last link of the other store's chain, and both have the same
    /// incidents.
    fn continues(&self, other: &Store) -> Result<bool, StoreError> {
        let end = chain::last_link(&other.connection)
            .map_err(|error| other.database_error("read the chain of", &error))?;
        let own = self.link_hash(end.link).map_err(|error| self.database_error("read the chain of", &error))?;
        // The start of a chain is link 0, which is not stored; every chain contains it.
        Ok(own == Some(end.hash) && self.incidents()? == other.incidents()?)
    }

    /// Returns the last cycle number that is known to be used; 0 if there is none.
    fn last_number(&self) -> Result<i64, StoreError> {
        Ok(self.newest_cycle()?.map_or(0, |cycle| cycle.0).max(self.numbered_above()?))
    }

    fn last_permit(&self) -> Result<i64, StoreError> {
        let last = self.connection.query_row("SELECT coalesce(max(id), 0) FROM permits", [], |row| row.get(0));
        last.map_err(|error| self.database_error("read the motions of", &error))
    }

    /// Begins a new epoch if the store was restored; the state is then Aborted.
    pub(super) fn begin_epoch_if_restored(&mut self) -> Result<(), StoreError> {
        let Some(marked) = mark_in(self.folder())? else { return Ok(()) };
        self.recover()?;
        self.append(&Event::Reported(Report::StoreRestored), None)?;
        let replaced = marked.last_cycle.0;
        let own = self.last_number()?;
        let restore = Restore { last_cycle: CycleId(own.max(replaced)), ..marked };
        self.begin_epoch(&format!("{RESTORED_ABOVE}{restore}"))?;
        let path = self.folder().join(RESTORED_MARK_FILE);
        std::fs::remove_file(&path).map_err(|source| StoreError::File { operation: "remove", path, source })
    }

    /// Returns the restores of this store in order, each with the time at which the restored store was first opened, ms
    /// since 1970.
    fn restores(&self) -> Result<Vec<(Restore, i64)>, StoreError> {
        let read = || -> Result<Vec<(Restore, i64)>, rusqlite::Error> {
            let sql = "SELECT substr(why, length(?1) + 1), unix_ms FROM outbox_epochs
                 WHERE substr(why, 1, length(?1)) = ?1 ORDER BY id";
            let restore =
                |row: &rusqlite::Row<'_>| Ok((Restore::parse(&row.get::<_, String>(0)?), row.get::<_, i64>(1)?));
            self.connection.prepare_cached(sql)?.query_map([RESTORED_ABOVE], restore)?.collect()
        };
        read().map_err(|error| self.database_error("read the epochs of", &error))
    }

    /// Returns the number above which new cycles are numbered because of restores; 0 without a restore.
    pub(super) fn numbered_above(&self) -> Result<i64, StoreError> {
        Ok(self.restores()?.iter().map(|(restore, _)| restore.last_cycle.0).max().unwrap_or(0))
    }

    /// Returns why the number of sanding passes on a part of this panel is unknown: cycles were lost by a restore, and
    /// no start request since then has stated the passes on the part in these cycles
    /// ([`UnknownPassCount::is_another_part_sufficient`]). `None` if the number is known. The serial number of a part
    /// without one is empty.
    ///
    /// # Errors
    /// If the cycles cannot be read.
    pub fn unknown_pass_count(&self, panel: &str, serial: &str) -> Result<Option<UnknownPassCount>, StoreError> {
        let mut restores = self.restores()?;
        restores.retain(|(restore, _)| !restore.is_nothing_abraded);
        let Some((first, _)) = restores.first() else { return Ok(None) };
        let stated = self.last_statement((panel, serial), first.last_cycle)?;
        let is_open = |(restore, _): &&(Restore, i64)| stated.is_none_or(|stated| stated.0 <= restore.last_cycle.0);
        Ok(restores.iter().find(is_open).map(|(restore, opened_unix_ms)| UnknownPassCount {
            serial: serial.trim().to_owned(),
            made_unix_s: restore.made_unix_s,
            restored_unix_s: opened_unix_ms.div_euclid(1_000),
        }))
    }

    /// Returns the last cycle above this number whose start request stated the passes on the part in lost cycles.
    fn last_statement(&self, (panel, serial): (&str, &str), above: CycleId) -> Result<Option<CycleId>, StoreError> {
        let own = normalised_serial(serial);
        let accepted =
            if UnknownPassCount::is_another_part_sufficient(serial) { ANOTHER_PART_TEXT } else { LostPasses::FILE };
        let read = || -> Result<Vec<(i64, String)>, rusqlite::Error> {
            let sql =
                "SELECT cycles.id, coalesce(serial, '') FROM cycles LEFT JOIN cycle_parts ON cycle_id = cycles.id
                 WHERE panel = ?1 AND cycles.id > ?2
                 AND EXISTS (SELECT 1 FROM json_each(files) WHERE value ->> 'name' IN (?3, ?4)) ORDER BY 1 DESC";
            let mut statement = self.connection.prepare_cached(sql)?;
            let values = params![panel, above.0, accepted, LostPasses::FILE];
            statement.query_map(values, |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        let cycles = read().map_err(|error| self.database_error("read the cycles of", &error))?;
        Ok(cycles.into_iter().find(|(_, of)| normalised_serial(of) == own).map(|(id, _)| CycleId(id)))
    }

    /// Refuses the start of a cycle if the number of sanding passes on its part is unknown. An air-run has no contact
    /// and is never refused.
    pub(super) fn check_count(&self, start: &CycleStart) -> Result<(), StoreError> {
        let serial = search::parse_part(&start.file_texts).and_then(|part| part.serial).unwrap_or_default();
        let is_stated = |(name, text): &(String, String)| {
            (name == ANOTHER_PART_TEXT && UnknownPassCount::is_another_part_sufficient(&serial))
                || (name == LostPasses::FILE && LostPasses::read(text).is_some())
        };
        if start.is_air_run || start.file_texts.iter().any(is_stated) {
            return Ok(());
        }
        self.unknown_pass_count(&start.panel, &serial)?.map_or(Ok(()), |lost| Err(StoreError::CountUnknown(lost)))
    }
}

/// Returns the restore that the mark in this folder states; `None` if the store is not marked as restored.
fn mark_in(folder: &Path) -> Result<Option<Restore>, StoreError> {
    let path = folder.join(RESTORED_MARK_FILE);
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(Some(Restore::parse(&text))),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(source) => Err(StoreError::File { operation: "read", path, source }),
    }
}
