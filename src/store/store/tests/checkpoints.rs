//! A start reads the journal from its last checkpoint on, with the same result as a start that reads the whole
//! journal.

use super::evidence::{behind_its_back, store_in, verify};
use super::journal::progress;
use super::*;
use panelprep_cell::cycle::{At, Event, Report};

/// A start reads the journal from the last checkpoint, and reaches the same state.
#[test]
fn a_checkpoint_folds_as_the_whole_journal() {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    for done in 0..2_500 {
        store.append(&progress(done), None).expect("written");
    }
    drop(store);
    let path = store_in(&folder);
    let mut store = Store::create(&path).expect("opens");
    let whole = store.recover().expect("recovers");
    let checkpoint = store.checkpoint().expect("read").expect("a long tail was read");
    assert_eq!((checkpoint.sequence, checkpoint.settled.state()), (2_500, store.state().expect("known")));
    drop(store);
    let mut store = Store::create(&path).expect("opens");
    assert_eq!(store.recover().expect("recovers"), whole);
    store.append(&Event::Reported(Report::Boot), None).expect("written");
    let folded = store.state().expect("known");
    assert_eq!(folded, panelprep_cell::cycle::fold_journal(store.journal().expect("whole")));
}

/// The duration of a start with this number of lines in the journal: `cargo test -- --ignored --nocapture
/// a_million`.
fn started(lines: u32) -> [std::time::Duration; 3] {
    let (folder, mut store) = new_store();
    super::super::journal::fill(&mut store, lines).expect("filled");
    drop(store);
    // The first start finds no checkpoint, folds the whole journal and writes a checkpoint.
    std::array::from_fn(|_| {
        let since = std::time::Instant::now();
        let mut store = Store::create(&store_in(&folder)).expect("opens");
        assert_eq!(store.recover().expect("recovers").at, At::Stopped);
        let took = since.elapsed();
        assert_eq!(store.lines().expect("counted"), i64::from(lines));
        took
    })
}

#[test]
#[ignore = "a minute: it writes a million lines"]
fn a_start_at_a_million_lines_reads_the_last_of_them() {
    let took = started(1_000_000);
    eprintln!("start at a million lines: {took:?} (the first one folds all of them)");
    assert!(took[2].as_secs_f64() < 2.0, "{took:?}");
}

/// A start reads only the lines since the last checkpoint, for a journal of any length.
#[test]
fn a_start_does_not_read_the_whole_journal() {
    let (folder, mut store) = new_store();
    super::super::journal::fill(&mut store, 30_000).expect("filled");
    store.recover().expect("recovers");
    store.append(&progress(1), None).expect("written");
    drop(store);
    // A change that only a reader of the whole journal would detect.
    behind_its_back(&folder, "UPDATE journal SET event = '{}' WHERE sequence = 7");
    let mut store = Store::create(&store_in(&folder)).expect("opens");
    assert_eq!(store.recover().expect("the tail alone").at, At::Stopped);
    assert!(store.journal().is_err());
    drop(store);
    assert!(verify(&folder).differences.iter().any(|words| words.contains("journal line 7 ")));
    // A recent change is detected at once.
    behind_its_back(&folder, "UPDATE checkpoints SET folded = replace(folded, 'stopped', 'idle')");
    let store = Store::create(&store_in(&folder)).expect("opens");
    assert!(store.changed().iter().any(|words| words.contains("checkpoint 30000")), "{:?}", store.changed());
}
