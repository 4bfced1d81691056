//! The list of tests that `make test` leaves out because they take long: `make test-rest` finds each of them.

use std::fs;
use std::path::Path;
use std::process::Command;

#[test]
fn each_test_that_is_left_out_exists() {
    let list = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/long.txt")).expect("the list");
    let program = std::env::current_exe().expect("this program");
    let known = Command::new(program).arg("--list").output().expect("the tests' names").stdout;
    let known = String::from_utf8(known).expect("text");
    let known: Vec<&str> = known.lines().filter_map(|line| line.strip_suffix(": test")).collect();
    for name in list.lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
        // A name is searched within all names, so it may occur in its own name only.
        let found: Vec<&&str> = known.iter().filter(|test| test.contains(name)).collect();
        assert_eq!(found, [&name], "tests/long.txt");
    }
}
