//! Tests of the backup of a small cell: complete, in use, and with files outside of its folder; damaged (flipped bits,
//! truncation, missing files, a full disk); and forged by a person who knows the format (a correct seal, but invalid
//! names, links and rows). All damage is reported, and no file is changed.

use super::entry::{Entry, MANIFEST_FORMAT, MANIFEST_NAME, Manifest, ManifestEntry};
use super::read::HashingWriter;
use super::*;
use crate::store::tests::full::SmallDisk;
use crate::store::{CycleStart, Restore, Store, StoreError, StoredTeaching, TaughtCorner, TeachingInputs};
use panelprep_base::geometry::KukaPose;
use panelprep_base::verdict::Verdict;
use panelprep_cell::files::content_hash;
use panelprep_cell::record::CycleId;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const CELL: &str = "store = \"store\"\n[calibration]\nscanner = \"calibration/scanner.toml\"\n";
const LENS: &str = "[camera]\n";
const RECIPE: &str = "panel = \"wing\"\n";
const BOTH: RestoredParts = RestoredParts { store: true, configuration: true };

/// A cell in its own folder, with a taught panel.
struct SmallCell(TempDir);

impl SmallCell {
    fn new() -> Self {
        let cell = SmallCell(tempfile::tempdir().expect("a folder"));
        for (name, text) in [("cell.toml", CELL), ("calibration/scanner.toml", LENS), ("panels/wing.toml", RECIPE)]
        {
            let file = cell.at(name);
            fs::create_dir_all(file.parent().expect("a folder")).expect("made");
            fs::write(file, text).expect("written");
        }
        let mut store = Store::create(&cell.at("store")).expect("a new store");
        store.teach(&teaching()).expect("taught");
        cell
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn configuration(&self) -> Configuration {
        Configuration {
            cell: CELL.to_owned(),
            named_files: vec![("calibration.scanner".to_owned(), self.at("calibration/scanner.toml"))],
            recipes: vec![("panels/wing.toml".to_owned(), self.at("panels/wing.toml"))],
        }
    }

    fn backup(&self, archive: &Path) -> Result<BackupReport, BackupError> {
        write(archive, Some(&self.at("store")), Some(&self.configuration()), 1_800_000_000)
    }

    fn taught(&self, store: &str) -> StoredTeaching {
        Store::open(&self.at(store)).and_then(|store| store.taught("wing", None)).expect("there")
    }
}

fn teaching() -> TeachingInputs {
    TeachingInputs {
        name: "wing".to_owned(),
        scan: b"scan".repeat(1_000),
        recipe_text: RECIPE.to_owned(),
        scanner_calibration_text: LENS.to_owned(),
        base_from_camera_text: "x_mm = 1\n".to_owned(),
        corners: vec![TaughtCorner { picture: b"corner".to_vec(), base_from_flange: KukaPose::default() }],
        flange_camera_text: LENS.to_owned(),
        flange_from_camera_text: "z_mm = 80\n".to_owned(),
    }
}

fn plan<'p>(archive: &'p Path, cell: &'p Path) -> Plan<'p> {
    Plan {
        archive,
        cell,
        store: None,
        parts: BOTH,
        permission: Permission::default(),
        last_cycle: Some(CycleId(0)),
    }
}

/// Returns all files below a folder with their contents, and all folders.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("listed") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            all.insert(path.clone(), vec![]);
            all.extend(content(&path));
        } else {
            all.insert(path.clone(), fs::read(&path).unwrap_or_default());
        }
    }
    all
}

#[test]
fn a_cell_is_restored_in_another_folder() {
    let cell = SmallCell::new();
    let archive = cell.at("backups/cell.tar.zst");
    let written = cell.backup(&archive).expect("written");
    assert_eq!((written.differences.len(), written.manifest.entries.len()), (0, 7), "{:?}", written.manifest);
    assert_eq!(fs::read_dir(cell.at("backups")).expect("listed").count(), 1, "nothing is left beside it");
    assert!(matches!(cell.backup(&archive), Err(BackupError::AlreadyExists { .. })));

    let other = cell.at("other/cell.toml");
    let restored = restore(&plan(&archive, &other)).expect("restored");
    assert_eq!(
        (restored.links, restored.files, restored.replaced_files.len()),
        (written.manifest.links.expect("a store"), 2, 0)
    );
    assert_eq!(cell.taught("other/store").teaching, teaching());
    assert_eq!(cell.taught("other/store").version, cell.taught("store").version);
    for (name, text) in [("cell.toml", CELL), ("calibration/scanner.toml", LENS), ("panels/wing.toml", RECIPE)] {
        assert_eq!(fs::read_to_string(cell.at("other").join(name)).expect("there"), text);
    }
    let store = Store::create(&cell.at("other/store")).expect("opens for writing");
    assert_eq!(store.changed(), [] as [String; 0]);
    // The backup leaves no other files beside the archive.
    let mut names: Vec<_> =
        fs::read_dir(cell.at("other")).expect("listed").map(|e| e.expect("one").file_name()).collect();
    names.sort();
    assert_eq!(names, ["calibration", "cell.toml", "panels", "store"]);
}

#[test]
fn existing_files_are_replaced_only_with_permission_and_kept() {
    let cell = SmallCell::new();
    let (archive, file) = (cell.at("cell.tar.zst"), cell.at("cell.toml"));
    cell.backup(&archive).expect("written");
    let later = TeachingInputs { scan: b"later".to_vec(), ..teaching() };
    Store::create(&cell.at("store")).and_then(|mut store| store.teach(&later)).expect("taught");
    fs::write(&file, format!("{CELL}# mine\n")).expect("written");
    let before = content(cell.0.path());
    let message =
        |permission| restore(&Plan { permission, ..plan(&archive, &file) }).expect_err("refused").to_string();
    let none = Permission::default();
    let first = message(none);
    assert!(first.contains("cell.toml is already present") && first.contains("--replace configuration"), "{first}");
    let second = message(Permission { replace_configuration: true, ..none });
    assert!(second.contains("store is already present") && second.contains("--replace store"), "{second}");
    assert_eq!(content(cell.0.path()), before);

    let permission = Permission { replace_configuration: true, replace_store: true, outside: false };
    let restored = restore(&Plan { permission, ..plan(&archive, &file) }).expect("restored");
    assert_eq!(restored.configuration, std::slice::from_ref(&file), "what is the same stays");
    assert_eq!(fs::read_to_string(&file).expect("there"), CELL);
    assert_eq!(cell.taught("store").teaching, teaching());
    assert_eq!(restored.replaced_files, [cell.at("store.before-restore-1"), cell.at("cell.toml.before-restore-1")]);
    assert_eq!(cell.taught("store.before-restore-1").teaching, later);
    let found = Store::verify(&cell.at("store.before-restore-1"), true).expect("verified").differences;
    assert_eq!(found, [] as [String; 0]);
    assert!(fs::read_to_string(cell.at("cell.toml.before-restore-1")).expect("kept").contains("# mine"));
}

#[test]
fn a_store_in_use_is_not_replaced() {
    let cell = SmallCell::new();
    let (archive, file) = (cell.at("cell.tar.zst"), cell.at("cell.toml"));
    cell.backup(&archive).expect("written");
    let permission = Permission { replace_store: true, ..Permission::default() };
    let told = || restore(&Plan { permission, ..plan(&archive, &file) }).map_err(|error| error.to_string());
    {
        let _socket = UnixListener::bind(cell.at("store/panelprep.sock")).expect("bound");
        let error = told().expect_err("a service");
        assert!(error.contains("a service is running on") && error.contains("systemctl stop panelprep"), "{error}");
    }
    // An old socket file without a service does not prevent a restore.
    let store = Store::create(&cell.at("store")).expect("opens");
    let error = told().expect_err("a writer");
    assert!(error.contains("is writing to the store"), "{error}");
    drop(store);
    told().expect("free again");
}

#[test]
fn files_outside_of_the_cells_folder_need_permission() {
    let cell = SmallCell::new();
    let elsewhere = cell.at("lenses/scanner.toml");
    fs::create_dir(cell.at("lenses")).expect("made");
    fs::write(&elsewhere, LENS).expect("written");
    fs::create_dir(cell.at("cells")).expect("made");
    let text = "store = \"../store\"\n[calibration]\nscanner = \"../lenses/scanner.toml\"\n";
    let configuration = Configuration {
        cell: text.to_owned(),
        named_files: vec![("calibration.scanner".to_owned(), elsewhere)],
        recipes: vec![],
    };
    let archive = cell.at("cell.tar.zst");
    write(&archive, None, Some(&configuration), 0).expect("written");
    let wanted = RestoredParts { store: false, configuration: true };
    let file = cell.at("new/cells/cell.toml");
    let refused = restore(&Plan { parts: wanted, ..plan(&archive, &file) }).expect_err("outside").to_string();
    assert!(refused.contains("../lenses/scanner.toml") && refused.contains("--outside"), "{refused}");
    assert!(!cell.at("new").exists());
    fs::create_dir_all(cell.at("new/cells")).expect("made");
    let permission = Permission { outside: true, ..Permission::default() };
    restore(&Plan { parts: wanted, permission, ..plan(&archive, &file) }).expect("restored");
    assert!(cell.at("new/lenses/scanner.toml").is_file());
    // No store can be restored from an archive without a store.
    let refused =
        restore(&Plan { permission, ..plan(&archive, &cell.at("x/cell.toml")) }).expect_err("no store").to_string();
    assert!(refused.contains("contains no store"), "{refused}");
}

/// Returns the start data of a cycle with the taught panel.
fn start() -> CycleStart {
    CycleStart {
        panel: "wing".to_owned(),
        taught_version: "1".to_owned(),
        recipe_text: RECIPE.to_owned(),
        file_texts: vec![],
        recording: None,
        is_air_run: false,
    }
}

/// Adds `count` cycles without sanding passes.
fn add_cycles(store: &Path, count: usize) {
    let mut store = Store::create(store).expect("a store");
    for _ in 0..count {
        let id = store.begin_cycle(&start()).expect("begun");
        store.conclude(id, Verdict::Aborted, &[]).expect("concluded");
    }
}

/// On a new computer, it is unknown which cycle numbers were already used: without a person's statement of the last
/// number, nothing is restored. A number below that of the last cycle in the backup is refused.
#[test]
fn without_a_replaced_store_a_person_states_the_last_cycle() {
    let cell = SmallCell::new();
    add_cycles(&cell.at("store"), 2);
    let (archive, file) = (cell.at("cell.tar.zst"), cell.at("other/cell.toml"));
    cell.backup(&archive).expect("written");
    let restored = |last_cycle| restore(&Plan { last_cycle, ..plan(&archive, &file) });
    let message = restored(None).expect_err("refused").to_string();
    assert!(message.contains("--last-cycle") && message.contains("the last one of the backup is 2"), "{message}");
    assert!(!cell.at("other/store").exists() && !file.exists(), "nothing is left");
    let message = restored(Some(CycleId(1))).expect_err("refused").to_string();
    assert!(message.contains("--last-cycle 1 is below 2"), "{message}");
    restored(Some(CycleId(9))).expect("restored");
    let mut store = Store::create(&cell.at("other/store")).expect("opens");
    assert!(matches!(store.begin_cycle(&start()), Err(StoreError::CountUnknown(_))));
    let air_run = CycleStart { is_air_run: true, ..start() };
    assert_eq!(store.begin_cycle(&air_run).expect("begun"), CycleId(10));
    drop(store);

    // An empty store on the new computer does not contain the numbers either.
    fs::create_dir_all(cell.at("fresh")).expect("a folder");
    drop(Store::create(&cell.at("fresh/store")).expect("a new store"));
    let permission = Permission { replace_store: true, ..Permission::default() };
    let file = cell.at("fresh/cell.toml");
    let fresh = Plan { permission, last_cycle: None, ..plan(&archive, &file) };
    assert!(matches!(restore(&fresh), Err(BackupError::LastCycleUnknown { own: 2, .. })));
}

/// Restores a backup that was made after cycle 1, in place of the present store. Returns what is known about the cycles
/// after the backup, and the number of the next air-run.
fn replaced_store(cell: &SmallCell, last_cycle: Option<i64>) -> Result<(Restore, CycleId), BackupError> {
    let (archive, file) = (cell.at("cell.tar.zst"), cell.at("cell.toml"));
    let permission = Permission { replace_store: true, ..Permission::default() };
    let parts = RestoredParts { store: true, configuration: false };
    let last_cycle = last_cycle.map(CycleId);
    let restored = restore(&Plan { permission, parts, last_cycle, ..plan(&archive, &file) })?;
    let mut store = Store::create(&cell.at("store")).expect("opens");
    let known = restored.since_backup.expect("a store was restored");
    let begun = store.begin_cycle(&start());
    let continues = match &begun {
        Ok(_) => true,
        Err(StoreError::CountUnknown(_)) => false,
        Err(error) => panic!("{error}"),
    };
    assert_eq!(continues, known.is_nothing_abraded, "{begun:?}");
    let next = store.begin_cycle(&CycleStart { is_air_run: true, ..start() }).expect("begun");
    Ok((known, next))
}

/// The last cycle of the replaced store is cycle 3, and no cycle after the backup had a sanding pass. This is a proof
/// only if a person states the same number: a larger number means that the replaced store is an older copy.
#[test]
fn nothing_was_abraded_only_if_a_person_states_the_same_last_cycle() {
    // If it is proven that nothing was sanded, cycle 4 can start before the air-run.
    for (stated, is_nothing_abraded, last, next) in
        [(Some(3), true, 3, 5), (None, false, 3, 4), (Some(2), false, 3, 4), (Some(9), false, 9, 10)]
    {
        let cell = SmallCell::new();
        add_cycles(&cell.at("store"), 1);
        cell.backup(&cell.at("cell.tar.zst")).expect("written");
        add_cycles(&cell.at("store"), 2);
        let known = Restore { last_cycle: CycleId(last), made_unix_s: Some(1_800_000_000), is_nothing_abraded };
        assert_eq!(replaced_store(&cell, stated).expect("restored"), (known, CycleId(next)), "{stated:?}");
    }
}

/// A changed row makes the replaced store invalid as a proof, so a person must state the last cycle. A number that can
/// be read in this store is not used again.
#[test]
fn a_changed_store_proves_nothing_and_its_numbers_are_not_used_again() {
    let cell = SmallCell::new();
    add_cycles(&cell.at("store"), 1);
    cell.backup(&cell.at("cell.tar.zst")).expect("written");
    add_cycles(&cell.at("store"), 2);
    rusqlite::Connection::open(cell.at("store/panelprep.sqlite"))
        .and_then(|rows| rows.execute("UPDATE taught_panels SET taught_at_unix_s = 7", []))
        .expect("changed");
    assert!(matches!(replaced_store(&cell, None), Err(BackupError::LastCycleUnknown { own: 1, .. })));
    let (known, next) = replaced_store(&cell, Some(2)).expect("restored");
    assert_eq!((known.is_nothing_abraded, known.last_cycle, next), (false, CycleId(3), CycleId(4)));
}

/// Every flipped bit and every truncation of the archive is detected.
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

/// The disk is full at the start, or becomes full during the restore. Existing files are kept, and incomplete files are
/// removed.
#[test]
fn a_full_disk_changes_no_existing_file() {
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

    // The disk becomes full while the configuration is written; the store is on another disk and is already complete.
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

/// An entry of a forged archive.
struct Forged {
    listed: ManifestEntry,
    header_name: String,
    kind: tar::EntryType,
    content: Vec<u8>,
}

fn forged(name: &str, content: &[u8]) -> Forged {
    let listed =
        ManifestEntry { name: name.to_owned(), bytes: content.len() as u64, sha256: content_hash(content) };
    Forged { listed, header_name: name.to_owned(), kind: tar::EntryType::Regular, content: content.to_vec() }
}

/// Writes an archive as a person who knows the format could: with a correct seal and any entry names.
fn forge(archive: &Path, manifest: &Manifest, entries: &[Forged]) {
    let sealing = HashingWriter::new(fs::File::create(archive).expect("made"));
    let mut tar = tar::Builder::new(zstd::Encoder::new(sealing, 1).expect("an encoder"));
    let text = serde_json::to_vec(manifest).expect("JSON");
    let first = forged(MANIFEST_NAME, &text);
    for entry in std::iter::once(&first).chain(entries) {
        let mut header = tar::Header::new_gnu();
        // The name is written directly into the header, because the library refuses such names.
        let name = &mut header.as_old_mut().name;
        name[..entry.header_name.len()].copy_from_slice(entry.header_name.as_bytes());
        header.set_entry_type(entry.kind);
        header.set_size(entry.content.len() as u64);
        header.set_mode(0o644);
        header.set_cksum();
        tar.append(&header, entry.content.as_slice()).expect("appended");
    }
    tar.into_inner().and_then(zstd::Encoder::finish).and_then(HashingWriter::seal).expect("sealed");
}

fn manifest(entries: &[Forged]) -> Manifest {
    let entries = entries.iter().map(|entry| entry.listed.clone()).collect();
    Manifest { format: MANIFEST_FORMAT, program: "0".to_owned(), made_unix_s: 0, links: None, entries }
}

/// Forged archives with a correct seal: paths outside of the folder, links, other contents, and more or fewer entries
/// than in the manifest.
#[test]
fn a_forged_archive_is_refused_and_changes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let (archive, cell) = (folder.path().join("forged"), folder.path().join("cell/cell.toml"));
    let named = |name: &str| vec![forged("configuration/cell.toml", CELL.as_bytes()), forged(name, b"x")];
    let mut cases: Vec<(&str, Vec<Forged>)> = [
        "../../evil.toml",
        "/tmp/evil.toml",
        "configuration/recipes/../../../evil.toml",
        "configuration/recipes//tmp/evil.toml",
        "configuration/named/../../evil",
        "store/../../evil",
        "store/blobs/../../../evil",
    ]
    .map(|name| ("not a file of a backup", named(name)))
    .into();
    let mut link = named("configuration/recipes/evil.toml");
    (link[1].kind, link[1].listed.bytes) = (tar::EntryType::Symlink, 1);
    cases.push(("where its manifest lists", link));
    let mut elsewhere = named("configuration/recipes/evil.toml");
    elsewhere[1].header_name = "../../evil.toml".to_owned();
    cases.push(("where its manifest lists", elsewhere));
    let mut other = named("configuration/recipes/evil.toml");
    other[1].content = b"y".to_vec();
    cases.push(("the SHA-256 of the file configuration/recipes/evil.toml", other));
    let mut twice = named("configuration/recipes/evil.toml");
    twice.push(forged("configuration/recipes/evil.toml", b"x"));
    cases.push(("twice", twice));
    let mut unnamed = named("configuration/named/calibration.scanner");
    unnamed[0] = forged("configuration/cell.toml", b"store = \"store\"\n");
    cases.push(("names no calibration.scanner", unnamed));
    cases.push((
        "this program does not accept the cell's file",
        vec![forged("configuration/cell.toml", b"stoer = 1")],
    ));
    for (words, entries) in cases {
        forge(&archive, &manifest(&entries), &entries);
        let wanted = RestoredParts { store: false, configuration: true };
        let message = restore(&Plan { parts: wanted, ..plan(&archive, &cell) }).expect_err("refused").to_string();
        assert!(message.contains(words), "{words}: {message}");
        let names: Vec<_> =
            fs::read_dir(folder.path()).expect("listed").map(|e| e.expect("one").file_name()).collect();
        assert_eq!(names, ["forged"], "{words}");
    }
    // Archives with more or fewer entries than in the manifest, and an archive with a newer format.
    let entries = named("configuration/recipes/wing.toml");
    let wanted = RestoredParts { store: false, configuration: true };
    for (manifest, words) in [
        (manifest(&entries[..1]), "more files than its manifest lists"),
        (manifest(&[&entries[..], &[forged("configuration/recipes/more.toml", b"x")]].concat_all()), "is missing"),
        (Manifest { format: MANIFEST_FORMAT + 1, ..manifest(&entries) }, "restore it with the newer program"),
    ] {
        forge(&archive, &manifest, &entries);
        let message = restore(&Plan { parts: wanted, ..plan(&archive, &cell) }).expect_err("refused").to_string();
        assert!(message.contains(words), "{words}: {message}");
        assert!(!cell.exists());
    }
    forge(&archive, &manifest(&entries), &entries);
    restore(&Plan { parts: wanted, ..plan(&archive, &cell) }).expect("by itself it is right");
}

/// Concatenates lists whose items cannot be cloned.
trait ConcatAll {
    fn concat_all(&self) -> Vec<Forged>;
}

impl ConcatAll for [&[Forged]; 2] {
    fn concat_all(&self) -> Vec<Forged> {
        self.iter().flat_map(|part| part.iter()).map(|entry| forged(&entry.listed.name, &entry.content)).collect()
    }
}

/// A store with changed rows in an archive with a new seal is refused, because its hash chain is broken. No file of the
/// store is left.
#[test]
fn a_changed_store_is_neither_packed_nor_restored() {
    let cell = SmallCell::new();
    let archive = cell.at("cell.tar.zst");
    let database = cell.at("store/panelprep.sqlite");
    rusqlite::Connection::open(&database)
        .and_then(|rows| rows.execute("UPDATE taught_panels SET taught_at_unix_s = 7", []))
        .expect("changed");
    let written = cell.backup(&archive).expect("looked at");
    assert!(written.differences.iter().any(|words| words.contains("changed: taught panel 1")), "{written:?}");
    assert!(!archive.exists());

    let files = ["store/panelprep.sqlite", "store/panelprep.head"]
        .map(|name| forged(name, &fs::read(cell.at(name)).expect("read")));
    let blobs = fs::read_dir(cell.at("store/blobs")).expect("listed").map(|blob| {
        let bytes = fs::read(blob.expect("a file").path()).expect("read");
        forged(&Entry::Blob(content_hash(&bytes)).name(), &bytes)
    });
    let entries: Vec<Forged> = files.into_iter().chain(blobs).collect();
    forge(&archive, &Manifest { links: Some(9), ..manifest(&entries) }, &entries);
    let before = content(cell.0.path());
    let wanted = RestoredParts { store: true, configuration: false };
    let other = cell.at("other-store");
    let restored = restore(&Plan { parts: wanted, store: Some(&other), ..plan(&archive, &cell.at("cell.toml")) })
        .expect("looked at");
    assert!(restored.differences.iter().any(|words| words.contains("changed: taught panel 1")), "{restored:?}");
    assert_eq!(content(cell.0.path()), before);
}
