//! kill -9: the journal of a killed process contains all acknowledged lines, and at most one more.

use super::journal::progress;
use super::*;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

const FOLDER: &str = "PANELPREP_TEST_APPENDS_TO";

/// Not a separate test: the child, which appends until it is killed, and reports each line.
#[test]
#[ignore = "run by the test below as a process of its own"]
fn appends_until_killed() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    let mut store = Store::create(Path::new(&folder)).expect("the lease of a killed process is free");
    let begin = store.journal().expect("whole").len() as u32;
    println!("begins after {begin}");
    for done in begin + 1.. {
        let sequence = store.append(&progress(done), None).expect("written");
        println!("appended {sequence}");
    }
}

/// Starts this test program as a separate process, which executes the work of one test in this folder until it is
/// killed.
pub(super) fn until_killed(test: &str, (variable, folder): (&str, &Path)) -> Child {
    Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", test, "--ignored", "--nocapture"])
        .env(variable, folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("a child")
}

#[test]
fn a_killed_process_leaves_a_prefix_without_duplicates() {
    let (folder, store) = new_store();
    drop(store);
    let path = folder.path().join("store");
    let mut before = 0;
    for kill in 0..10_u64 {
        let mut child = until_killed("store::tests::killed::appends_until_killed", (FOLDER, &path));
        let reported = BufReader::new(child.stdout.take().expect("its output"));
        let mut acknowledged = None;
        for line in reported.lines().map_while(Result::ok) {
            if let Some(count) = line.strip_prefix("begins after ") {
                assert_eq!(count.parse(), Ok(before), "kill {kill}");
                let refused = Store::create(&path).expect_err("the child writes").to_string();
                assert!(refused.contains(&format!("process {} is writing", child.id())), "{refused}");
            }
            acknowledged =
                line.strip_prefix("appended ").and_then(|count| count.parse::<u64>().ok()).or(acknowledged);
            // Between 1 and 28 lines, then the kill hits the child at any point; its output of the meantime is read
            // too.
            if acknowledged == Some(before + 1 + kill * 3) {
                child.kill().expect("killed");
            }
        }
        assert!(!child.wait().expect("ended").success());
        let acknowledged = acknowledged.expect("the child appends");
        let journal = Store::open(&path).expect("opens").journal().expect("whole");
        let found = journal.len() as u64;
        assert!(
            (acknowledged..=acknowledged + 1).contains(&found),
            "kill {kill}: {acknowledged} told, {found} there"
        );
        assert_eq!(journal, (1..=found as u32).map(progress).collect::<Vec<_>>());
        before = found;
    }
}
