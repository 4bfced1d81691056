//! Backups and restores of a world's store by the product's own code: backups while a process writes, restores between
//! two processes.

use super::Running;
use super::disk;
use super::inside::Inside;
use super::ledger::Ledger;
use super::sabotage::Sabotage;
use panelprep::backup::{self, Permission, Plan, RestoredParts};
use panelprep::cycle::{At, Cause, State};
use panelprep::record::CycleId;
use panelprep::store::Store;
use std::path::{Path, PathBuf};

/// Name of a file that exists in a restored store that has not been opened since.
const RESTORED: &str = "panelprep.restored";

/// A backup of a store.
#[derive(Debug)]
pub struct Backup {
    archive: PathBuf,
    /// The acknowledgements that the backed-up store contains.
    ledger: Ledger,
}

/// Backs up the store in this folder, whose content is in the ledger; the process continues.
pub fn backs_up(world: &mut Inside, store: &Path, ledger: &Ledger) {
    if !std::mem::take(&mut world.backs_up) || disk::is_over() || disk::had_io_error() {
        return;
    }
    let archive = store.with_file_name("backup");
    let _ = std::fs::remove_file(&archive);
    match backup::write(&archive, Some(store), None, 0) {
        Ok(written) if written.differences.is_empty() => {
            world.counts.backups += 1;
            world.backup = Some(Backup { archive, ledger: ledger.clone() });
        }
        Ok(written) => world.wrong("backup", format!("the store does not verify: {:?}", written.differences)),
        Err(error) => world.wrong("backup", error.to_string()),
    }
}

impl Running {
    /// Replaces the present store by the last backup, if a person requests this.
    pub(super) fn restores(&mut self) {
        let Some(backup) = self.world.lock().restorable() else { return };
        disk::leave();
        let plan = Plan {
            archive: &backup.archive,
            cell: Path::new("/nowhere/cell.toml"),
            store: Some(&self.store()),
            parts: RestoredParts { store: true, configuration: false },
            permission: Permission { replace_store: true, ..Permission::default() },
            last_cycle: Some(self.last_number()),
        };
        let restored = backup::restore(&plan);
        let mut world = self.world.lock();
        match restored {
            Ok(restored) if restored.differences.is_empty() => {
                world.counts.restores += 1;
                restored.replaced_files.iter().for_each(|kept| drop(std::fs::remove_dir_all(kept)));
            }
            Ok(restored) => {
                world.wrong("restore", format!("the backup does not verify: {:?}", restored.differences))
            }
            Err(error) => world.wrong("restore", error.to_string()),
        }
        if world.truth.reboots > 0 {
            // Neither the store nor the restarted controller knows these epochs any more.
            world.oracles.epochs_begin_anew();
        }
        drop(world);
        if self.sabotage == Some(Sabotage::UnmarkedRestore) {
            let _ = std::fs::remove_file(self.store().join(RESTORED));
        }
        self.ledger = backup.ledger.replaces(&mut self.ledger);
        self.world.lock().lost_passes = self.ledger.touched.lost();
        self.is_restored = true;
        self.watch();
    }

    /// Returns the last cycle number that the people know: from their own list, or from the page of the present store.
    fn last_number(&self) -> CycleId {
        let shown = Store::open(&self.store()).and_then(|store| store.newest_cycle()).ok().flatten();
        self.ledger.last().max(shown).unwrap_or(CycleId(0))
    }

    /// Checks that a restored store waits until a person has stated what may have happened since the backup.
    pub(super) fn asks_after_a_restore(&mut self, rested: &State) -> Result<(), (&'static str, String)> {
        if !std::mem::take(&mut self.is_restored) {
            return Ok(());
        }
        self.world.lock().counts.judged("a restored store asks");
        let is_asked = rested.at == At::Aborted { cause: Cause::StoreRestored };
        let what = || ("a restored store asks", format!("it starts in {:?}", rested.at));
        if is_asked { Ok(()) } else { Err(what()) }
    }

    /// Records the grids that the arm has touched so far on a path whose process has ended.
    pub(super) fn touches(&mut self) {
        let executed = self.world.lock().executed_on_path();
        self.ledger.touched.executed(executed);
    }
}

impl Inside {
    /// Returns the backup that must be restored now, if there is one.
    fn restorable(&mut self) -> Option<Backup> {
        let wants = std::mem::take(&mut self.restores);
        self.backup.take_if(|_| wants)
    }
}
