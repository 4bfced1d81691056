//! Archives forged by a person who knows the format: sealed correctly, with names, links and rows that are not
//! allowed.

use super::super::entry::Entry;
use super::super::manifest::{FORMAT, Manifest, ManifestEntry, NAME};
use super::super::seal::HashingWriter;
use super::*;
use panelprep_cell::files::content_hash;

/// One entry of a forged archive.
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

/// Writes an archive as a person who knows the format may make it: sealed, with any names.
fn forge(archive: &Path, manifest: &Manifest, entries: &[Forged]) {
    let sealing = HashingWriter::new(fs::File::create(archive).expect("made"));
    let mut tar = tar::Builder::new(zstd::Encoder::new(sealing, 1).expect("an encoder"));
    let text = serde_json::to_vec(manifest).expect("JSON");
    let first = forged(NAME, &text);
    for entry in std::iter::once(&first).chain(entries) {
        let mut header = tar::Header::new_gnu();
        // The name is written directly into the header, since the library refuses to write such names.
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
    Manifest { format: FORMAT, program: "0".to_owned(), made_unix_s: 0, links: None, entries }
}

/// Archives sealed by a person who knows the format: names that lead elsewhere, links, other contents, more or less
/// than the manifest states.
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
    // Archives with more, and with fewer, entries than the manifest states; an archive of a newer format.
    let entries = named("configuration/recipes/wing.toml");
    let wanted = RestoredParts { store: false, configuration: true };
    for (manifest, words) in [
        (manifest(&entries[..1]), "more files than its manifest lists"),
        (manifest(&[&entries[..], &[forged("configuration/recipes/more.toml", b"x")]].concat_all()), "is missing"),
        (Manifest { format: FORMAT + 1, ..manifest(&entries) }, "restore it with the newer program"),
    ] {
        forge(&archive, &manifest, &entries);
        let message = restore(&Plan { parts: wanted, ..plan(&archive, &cell) }).expect_err("refused").to_string();
        assert!(message.contains(words), "{words}: {message}");
        assert!(!cell.exists());
    }
    forge(&archive, &manifest(&entries), &entries);
    restore(&Plan { parts: wanted, ..plan(&archive, &cell) }).expect("by itself it is right");
}

/// Concatenates items that cannot be cloned.
trait ConcatAll {
    fn concat_all(&self) -> Vec<Forged>;
}

impl ConcatAll for [&[Forged]; 2] {
    fn concat_all(&self) -> Vec<Forged> {
        self.iter().flat_map(|part| part.iter()).map(|entry| forged(&entry.listed.name, &entry.content)).collect()
    }
}

/// A store with changed rows and a new seal: the chain shows the change, and no file of the store is left behind.
#[test]
fn a_store_that_is_not_what_was_written_is_neither_packed_nor_restored() {
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
