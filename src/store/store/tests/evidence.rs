//! Tests that changes of the store by other programs are detected and named.

use super::super::chain::HASHED_TABLES;
use super::super::{chain, head};
use super::journal::progress;
use super::*;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cycle::{At, Motion, Outcome, Path as MotionPath};
use panelprep_cell::record::{Budget, Finding, Kind};

/// Creates a closed store in which every table contains rows.
pub fn filled_store() -> TempDir {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    store.teach(&teaching("wing")).expect("taught");
    for number in 0..4_u32 {
        let id = store.begin_cycle(&super::cycles::start()).expect("begun");
        let judgement = Judgement { verdict: Verdict::Review, reasons: vec![] };
        let picture = store.store_blob(format!("picture {number}").as_bytes()).expect("kept");
        let mut finding = Finding::new(Kind::Locate, 0, judgement);
        finding.shots.push(panelprep_cell::record::KeptFile { name: "scan".to_owned(), hash: picture });
        store.store_finding(id, &finding).expect("kept");
        let motion = Motion { epoch: 1 + number, path: MotionPath::Park, plan: 0, waypoints: 1 };
        store.open_intent(&motion, Some(id)).expect("opened");
        for done in 0..30 {
            store.append(&progress(100 * number + done), Some(id)).expect("written");
        }
        store.close_intent(&motion, Outcome::Done, 1).expect("closed");
        store.wear_disc(Some(id), 2.5).expect("kept");
        store.set_budget(id, &Budget { locate_mm: Some(0.1), ..Budget::default() }).expect("kept");
        store.set_budget(id, &Budget { locate_mm: Some(0.2), ..Budget::default() }).expect("replaced");
        store.conclude(id, Verdict::Fail, &[]).expect("kept");
    }
    store.store_verification(&super::cycles::verified("scanner", 0.1)).expect("kept");
    drop(store);
    let strike =
        panelprep_vision::calib::health::Strike { by: "A".to_owned(), why: "mistyped".to_owned(), at_unix_s: 9 };
    Store::strike_out_in(&folder.path().join("store"), 1, &strike).expect("struck out");
    folder
}

pub fn store_in(folder: &TempDir) -> std::path::PathBuf {
    folder.path().join("store")
}

pub fn verify(folder: &TempDir) -> StoreVerification {
    Store::verify(&store_in(folder), true).expect("verified")
}

/// Changes the database as another program would. The tests ignore the changed hash of the database file, which every
/// change causes.
pub fn change_outside_the_program(folder: &TempDir, sql: &str) {
    let connection = Connection::open(store_in(folder).join(DATABASE)).expect("opens");
    connection.pragma_update(None, "foreign_keys", "OFF").expect("set");
    connection.execute_batch(sql).unwrap_or_else(|error| panic!("{sql}: {error}"));
}

fn rows_alone(found: &StoreVerification) -> Vec<&str> {
    found
        .differences
        .iter()
        .map(String::as_str)
        .filter(|words| !words.contains("after the program closed it"))
        .collect()
}

/// All tables and columns are in the hash chain, including new ones. The table of parts is an index of texts that are
/// in the chain, and is compared with them.
#[test]
fn every_column_of_every_table_is_in_the_chain() {
    let (_folder, store) = new_store();
    let sql = "SELECT m.name, c.name FROM sqlite_master m, pragma_table_info(m.name) c
        WHERE m.type = 'table' AND m.name NOT LIKE 'sqlite_%' AND m.name NOT IN ('chain', 'cycle_parts')";
    let mut statement = store.connection.prepare(sql).expect("prepared");
    let columns = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).expect("read");
    let columns: Vec<(String, String)> = columns.collect::<Result<_, _>>().expect("read");
    assert!(columns.len() > 40, "{columns:?}");
    for (table, column) in columns {
        let parts = HASHED_TABLES.iter().filter(|part| part.table == table);
        let held = parts.clone().any(|part| part.key == column || part.columns.contains(&column.as_str()));
        assert!(held, "{table}.{column} is in no part of the chain");
    }
}

#[test]
fn an_unchanged_store_has_no_differences() {
    let folder = filled_store();
    let found = verify(&folder);
    assert_eq!((found.differences.clone(), found.earlier_differences.len()), (vec![], 0));
    assert!(found.links > 150 && found.files > 5, "{found:?}");
    for _ in 0..3 {
        let mut store = Store::create(&store_in(&folder)).expect("opens");
        assert_eq!(store.changed(), [] as [String; 0]);
        assert_eq!(store.recover().expect("recovers").at, At::Stopped);
        store.append(&progress(1), None).expect("written");
    }
    assert_eq!(verify(&folder).differences, [] as [String; 0]);
}

/// Changes, each with a part of the expected message.
#[test]
fn every_deletion_edit_and_exchange_is_named() {
    let exchange =
        "UPDATE journal SET sequence = -1 WHERE sequence = 7; UPDATE journal SET sequence = 7 WHERE sequence = 9;
        UPDATE journal SET sequence = 9 WHERE sequence = -1";
    let planted = [
        ("DELETE FROM journal WHERE sequence > 20", "deleted: journal line 21 to 120 is missing"),
        ("DELETE FROM findings", "deleted: finding 1 to 4 is missing"),
        ("UPDATE cycles SET verdict = 'pass'", "changed: end of cycle 1 to 4"),
        ("UPDATE cycles SET budget = NULL WHERE id = 2", "changed: error budget of cycle 2"),
        ("UPDATE cycles SET panel = 'fin' WHERE id = 3", "changed: cycle 3"),
        ("UPDATE findings SET finding = replace(finding, 'review', 'accept') WHERE id = 2", "changed: finding 2"),
        ("UPDATE motions SET done = 0 WHERE id = 1", "changed: end of motion 1"),
        ("UPDATE motions SET outcome = NULL, done = 0 WHERE id = 4", "changed: end of motion 4"),
        ("UPDATE discs SET swept_mm2 = 0.0 WHERE id = 1", "entry of the disc's wear 1"),
        ("UPDATE verifications SET error_mm = 0.01", "changed: verification 1"),
        ("UPDATE verification_strikes SET by = 'B'", "changed: strike of verification 1"),
        ("UPDATE taught_corners SET picture_hash = '0' WHERE position = 1", "taught corner 65537"),
        ("UPDATE taught_panels SET name = 'fin'", "changed: taught panel 1"),
        (exchange, "reordered: journal line 7 contains what was written as journal line 9"),
        ("INSERT INTO findings VALUES (9, 1, 'locate', 0, '{}', 0)", "inserted: finding 9"),
        (
            "INSERT INTO journal SELECT sequence + 1, NULL, unix_ms, event, chain FROM journal WHERE sequence = 120",
            "inserted: journal line 121",
        ),
        ("DELETE FROM chain WHERE link > 100", "rolled back"),
        ("DELETE FROM chain WHERE link = 100", "links 100 to 100 of the chain are missing"),
        ("UPDATE chain SET row_key = row_key + 1 WHERE link = 100", "link 100 of the chain was changed or moved"),
        ("DELETE FROM chain", "rolled back"),
        ("DROP TABLE discs", "cannot be read"),
        (
            "CREATE TRIGGER t AFTER INSERT ON journal BEGIN DELETE FROM findings; END",
            "trigger t does not belong to this program",
        ),
        ("DROP INDEX findings_by_cycle", "index findings_by_cycle was changed or is missing"),
    ];
    for (sql, words) in planted {
        let folder = filled_store();
        change_outside_the_program(&folder, sql);
        let found = verify(&folder);
        let reported = rows_alone(&found);
        assert!(reported.iter().any(|found| found.contains(words)), "{sql}: {reported:?}");
    }
}

/// A person who can rewrite the whole chain in the database does not change the head outside of it.
#[test]
fn a_rewritten_chain_contradicts_its_head() {
    let folder = filled_store();
    change_outside_the_program(&folder, "UPDATE cycles SET verdict = 'pass'");
    let connection = Connection::open(store_in(&folder).join(DATABASE)).expect("opens");
    connection.execute("DELETE FROM chain", []).expect("forged");
    let forged = chain_all_rows(&connection);
    drop(connection);
    let found = verify(&folder);
    let reported = rows_alone(&found);
    assert!(matches!(reported[..], [words] if words.contains("rolled back")), "{forged:?} {reported:?}");
    // The rewritten chain has the same number of links, but another verdict.
    let folder = filled_store();
    let connection = Connection::open(store_in(&folder).join(DATABASE)).expect("opens");
    let sql = "UPDATE cycles SET verdict = 'pass' WHERE id = 4";
    connection.execute(sql, []).expect("changed");
    let links: Vec<(String, i64)> = {
        let mut read = connection.prepare("SELECT part, row_key FROM chain ORDER BY link").expect("prepared");
        let rows = read.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).expect("read");
        rows.collect::<Result<_, _>>().expect("read")
    };
    connection.execute("DELETE FROM chain", []).expect("forged");
    let mut place = chain::ChainPosition::START;
    for (part, key) in links {
        place =
            chain::add_link(&connection, place, chain::hashed_table(&part).expect("ours"), key).expect("forged");
    }
    drop(connection);
    let found = verify(&folder);
    assert!(matches!(rows_alone(&found)[..], [words] if words.contains("the chain was rewritten")), "{found:?}");
}

/// A bit is flipped in every page, at many positions. The hash of the file detects every flip; rows, links and SQLite
/// detect most of them.
#[test]
fn a_flipped_bit_in_any_page_is_detected() {
    let folder = filled_store();
    let path = store_in(&folder).join(DATABASE);
    let bytes = fs::read(&path).expect("the database");
    let (pages, mut flips, mut named) = (bytes.len() / 4096, 0, 0);
    for page in 0..pages {
        for offset in [3, 24, 100, 700, 2_000, 3_000, 3_900, 4_090] {
            let mut spoilt = bytes.clone();
            spoilt[page * 4096 + offset] ^= 0x04;
            fs::write(&path, spoilt).expect("spoilt");
            let found = Store::verify(&store_in(&folder), false).map_or(1, |found| {
                named += usize::from(!rows_alone(&found).is_empty());
                found.differences.len()
            });
            assert!(found > 0, "page {page}, byte {offset} is silent");
            flips += 1;
        }
    }
    eprintln!("{flips} flips in {pages} pages, all found; {named} of them in what rows, links and pages say");
    assert!(pages > 10 && named > flips / 4);
    fs::write(&path, bytes).expect("as it was");
    assert_eq!(verify(&folder).differences, [] as [String; 0]);
}

/// A flipped bit in any byte of the head is reported. The store can still be opened if the other copy contains its
/// position.
#[test]
fn a_flipped_bit_in_the_head_is_detected() {
    let folder = filled_store();
    let path = store_in(&folder).join(head::FILE);
    let bytes = fs::read(&path).expect("the head");
    for place in 0..bytes.len() {
        let mut spoilt = bytes.clone();
        spoilt[place] ^= 0x01;
        fs::write(&path, spoilt).expect("spoilt");
        let found = Store::verify(&store_in(&folder), false).expect("verified");
        assert!(!found.differences.is_empty(), "byte {place} is silent");
    }
}

/// The last transaction is missing, and the head contains no possible next position. A crash cannot cause this.
#[test]
fn a_missing_last_transaction_is_detected() {
    let folder = filled_store();
    change_outside_the_program(
        &folder,
        "DELETE FROM chain WHERE link = (SELECT max(link) FROM chain); DELETE FROM verification_strikes",
    );
    let found = verify(&folder);
    assert!(found.differences.iter().any(|words| words.contains("rolled back: 1 entries")), "{found:?}");
}
