//! Numbers of cycles.

use super::super::CycleCounts;
use super::cycles::start;
use super::*;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::{Motion, Outcome, Path};

#[test]
fn cycles_are_counted_once_they_are_over() {
    let (_folder, mut store) = new_store();
    assert_eq!(store.cycle_counts().expect("counted"), CycleCounts::default());
    for (verdict, path) in
        [(Verdict::Pass, Path::Contact), (Verdict::Fail, Path::Contact), (Verdict::Pass, Path::Air)]
    {
        let id = store.begin_cycle(&start()).expect("begun");
        let motion = Motion { epoch: 1, path, plan: 1, waypoints: 5 };
        store.open_intent(&motion, Some(id)).expect("opened");
        store.close_intent(&motion, Outcome::Done, 5).expect("closed");
        store.conclude(id, verdict, &[]).expect("kept");
    }
    store.begin_cycle(&start()).expect("begun");
    let counts = CycleCounts { ended: 3, passed: 2, contacts: 2 };
    assert_eq!(store.cycle_counts().expect("counted"), counts, "the fourth one still runs");
}
