//! Tests that each name in the list of long tests, which `make test` excludes and `make test-rest` runs, is the name of
//! a test.

use std::fs;
use std::path::Path;
use std::process::Command;

#[test]
fn each_excluded_test_exists() {
    let list = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/long.txt")).expect("the list");
    let program = std::env::current_exe().expect("this program");
    let known = Command::new(program).arg("--list").output().expect("the tests' names").stdout;
    let known = String::from_utf8(known).expect("text");
    let known: Vec<&str> = known.lines().filter_map(|line| line.strip_suffix(": test")).collect();
    for name in list.lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
        // The name is a filter that matches parts of names, so it must match only one test.
        let found: Vec<&&str> = known.iter().filter(|test| test.contains(name)).collect();
        assert_eq!(found, [&name], "tests/long.txt");
    }
}
