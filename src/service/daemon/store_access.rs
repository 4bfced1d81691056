//! The store as an interface uses it: one connection for reading, and one for writing rows that no cycle waits for.
//! Each is opened when it is first needed.

use panelprep_store::store::{Store, StoreError};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Connections to the store in a folder.
#[derive(Debug)]
pub(super) struct StoreAccess {
    folder: PathBuf,
    reader: Mutex<Option<Store>>,
    writer: Mutex<Option<Store>>,
}

impl StoreAccess {
    pub fn new(folder: PathBuf) -> Self {
        StoreAccess { folder, reader: Mutex::default(), writer: Mutex::default() }
    }

    pub fn read<T>(&self, read: impl FnOnce(&Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let mut reader = lock(&self.reader);
        let store = match reader.take() {
            Some(store) => store,
            None => Store::open(&self.folder)?,
        };
        let result = read(&store);
        *reader = Some(store);
        result
    }

    pub fn write<T>(&self, write: impl FnOnce(&mut Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let mut writer = lock(&self.writer);
        let mut store = match writer.take() {
            Some(store) => store,
            None => Store::open_for_accounts(&self.folder)?,
        };
        let result = write(&mut store);
        *writer = Some(store);
        result
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // If a reader panicked, its connection is gone, and the next reader opens another.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
