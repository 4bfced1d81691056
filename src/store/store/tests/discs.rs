//! Wear of a disc.

use super::*;

/// Calculated by hand: 100 + 250.5, then a new disc and 40.
#[test]
fn wear_adds_up_until_a_new_disc_is_mounted() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut store = Store::create(folder.path()).expect("a new store");
    assert_eq!(store.disc_worn_mm2().expect("known"), 0.0);
    store.wear_disc(None, 100.0).expect("kept");
    store.wear_disc(None, 250.5).expect("kept");
    assert_eq!(store.disc_worn_mm2().expect("known"), 350.5);
    store.mount_disc().expect("kept");
    assert_eq!(store.disc_worn_mm2().expect("known"), 0.0);
    store.wear_disc(None, 40.0).expect("kept");
    assert!(matches!(store.wear_disc(None, f64::NAN), Err(StoreError::NotFinite { .. })));
    drop(store);
    let store = Store::open(folder.path()).expect("for reading");
    assert_eq!(store.disc_worn_mm2().expect("known"), 40.0);
}

#[test]
fn a_reader_wears_no_disc() {
    let folder = tempfile::tempdir().expect("a folder");
    drop(Store::create(folder.path()).expect("a new store"));
    let mut store = Store::open(folder.path()).expect("for reading");
    assert!(matches!(store.wear_disc(None, 1.0), Err(StoreError::ReadOnly { .. })));
    assert!(matches!(store.mount_disc(), Err(StoreError::ReadOnly { .. })));
}
