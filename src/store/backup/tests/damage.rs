//! Flipped bits, cut ends, missing files, a full disk: all is reported, and nothing is changed.

use super::*;
use crate::store::tests::full::SmallDisk;
use panelprep_cell::files::content_hash;

/// Each changed bit, and each byte cut off the end, is detected.
#[test]
fn a_flipped_bit_or_a_cut_end_is_refused_and_changes_nothing() {
    let cell = SmallCell::new();
    let archive = cell.at("cell.tar.zst");
    cell.backup(&archive).expect("written");
    let whole = fs::read(&archive).expect("read");
    let (spoilt_file, other) = (cell.at("spoilt"), cell.at("other/cell.toml"));
    let refused = |bytes: &[u8], what: &str| {
        fs::write(&spoilt_file, bytes).expect("spoilt");
        match restore(&plan(&spoilt_file, &other)) {
            Err(BackupError::Damaged { .. }) => {}
            other => panic!("{what}: {other:?}"),
        }
        assert!(!cell.at("other").exists(), "{what}");
    };
    for at in 0..whole.len() {
        let mut spoilt = whole.clone();
        spoilt[at] ^= 1 << (at % 8);
        refused(&spoilt, &format!("bit {} of byte {at}", at % 8));
    }
    for length in (0..whole.len()).step_by(101).chain([whole.len() - 1, whole.len() - 56]) {
        refused(&whole[..length], &format!("{length} bytes"));
    }
    refused(&[whole.as_slice(), b"more"].concat(), "bytes at its end");
    fs::write(&spoilt_file, &whole).expect("whole again");
    restore(&plan(&spoilt_file, &other)).expect("restored");
}

#[test]
fn a_damaged_or_missing_file_of_the_store_is_named() {
    let cell = SmallCell::new();
    let hash = content_hash(&teaching().scan);
    let file = cell.at("store/blobs").join(&hash);
    let mut bytes = fs::read(&file).expect("read");
    bytes[17] ^= 1;
    fs::write(&file, &bytes).expect("spoilt");
    let archive = cell.at("backups/cell.tar.zst");
    for words in ["is damaged: its SHA-256 is", "is missing, and no removal was recorded"] {
        let written = cell.backup(&archive).expect("looked at");
        assert!(
            written.differences.iter().any(|found| found.contains(&hash) && found.contains(words)),
            "{written:?}"
        );
        assert_eq!(fs::read_dir(cell.at("backups")).expect("listed").count(), 0);
        let _ = fs::remove_file(&file);
    }
}

/// The disk is full at once, or during the work: existing files stay, files that were begun are removed.
#[test]
fn a_full_disk_leaves_all_as_it_was() {
    let Some(disk) = SmallDisk::mount(4) else { return };
    let cell = SmallCell::new();
    let noise: Vec<u8> = {
        use rand::{RngExt, SeedableRng};
        let mut noise = rand_pcg::Pcg64::seed_from_u64(1);
        (0..8 << 20).map(|_| noise.random()).collect()
    };
    let large = TeachingInputs { scan: noise, ..teaching() };
    Store::create(&cell.at("store")).and_then(|mut store| store.teach(&large)).expect("taught");
    let left = || fs::read_dir(disk.folder()).expect("listed").count();
    let error = cell.backup(&disk.folder().join("cell.tar.zst")).expect_err("no room").to_string();
    assert!(error.contains("No space left"), "{error}");
    assert_eq!(left(), 0);

    let archive = cell.at("cell.tar.zst");
    cell.backup(&archive).expect("written");
    let wanted = RestoredParts { store: true, configuration: false };
    let store = disk.folder().join("store");
    let file = cell.at("cell.toml");
    let on_disk = Plan { parts: wanted, store: Some(&store), ..plan(&archive, &file) };
    let error = restore(&on_disk).expect_err("no room").to_string();
    assert!(error.contains("MB free, and the backup needs 9 MB"), "{error}");
    assert_eq!(left(), 0);

    // The disk becomes full while the configuration is written; the store, on another disk, was already complete.
    let configuration = Configuration { cell: format!("{CELL}#{}\n", "x".repeat(3 << 20)), ..cell.configuration() };
    let archive = cell.at("large.tar.zst");
    write(&archive, Some(&cell.at("store")), Some(&configuration), 0).expect("written");
    fs::write(disk.folder().join("ballast"), vec![7; 2 << 20]).expect("written");
    let before = content(cell.0.path());
    let (file, store) = (disk.folder().join("a/cell.toml"), cell.at("new-store"));
    let error = restore(&Plan { store: Some(&store), ..plan(&archive, &file) }).expect_err("no room").to_string();
    assert!(error.contains("No space left") && !error.contains("could not be undone"), "{error}");
    assert_eq!((left(), content(cell.0.path())), (1, before));
}
