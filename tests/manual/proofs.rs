//! Tests that the order and the values in the manual agree with the list of acceptance tests on the controller's page.

use super::pages;
use std::fs;

fn page(name: &str) -> String {
    fs::read_to_string(pages::folder().join(name)).expect("a page")
}

/// Returns the position of these words: the number of the page in the manual, and the byte in the page.
fn place(words: &str) -> Option<(usize, usize)> {
    pages::names().iter().enumerate().find_map(|(at, name)| Some((at, page(name).find(words)?)))
}

/// Returns the steps that are not in order: each step must follow the previous one, so that no step needs a later step.
fn out_of_order(steps: &[&str]) -> Vec<String> {
    // The safety concept comes before the work, and names what is done later.
    let pairs = steps.windows(2).map(|two| ((two[0], place(two[0])), (two[1], place(two[1]))));
    pairs
        .filter(|((_, first), (_, second))| first.is_none() || second.is_none() || first >= second)
        .map(|((first, _), (second, _))| format!("{second} before {first}"))
        .collect()
}

#[test]
fn the_manual_follows_the_stages_of_the_proofs() {
    let order = [
        "robot prove --stage A",
        "--sign --out proven-a.html",
        "signed_stage = \"A\"",
        "panelprep calibrate intrinsics",
        "\npanelprep air-run --recipe",
        "robot prove --stage B",
        "signed_stage = \"B\"",
        "panelprep cycle --recipe FOAM --on-foam",
        "robot prove --stage C",
        "signed_stage = \"C\"",
        "\nsudo systemctl enable --now panelprep",
        "\npanelprep ctl start",
    ];
    assert_eq!(out_of_order(&order), [""; 0]);
    let exchanged = ["robot prove --stage B", "\npanelprep air-run --recipe"];
    assert_eq!(out_of_order(&exchanged).len(), 1, "a circle is found");
    // The first test goes to automatic mode only after stage A.
    assert!(!page("cameras.md").contains("AUT"));
}

/// Returns a constant from the controller's files.
fn stated(text: &str, name: &str) -> f64 {
    let rest = text.split(&format!("{name}=")).nth(1).expect(name);
    rest.lines().next().expect("a line").trim().parse().expect("a number")
}

/// Expected values, calculated by hand: 100 + 400 + 12 = 512. 50 mm at 200 mm/s take 250 ms, and acceleration at 2 m/s²
/// to 0.2 m/s adds 100 ms. 512 + 260 + 350 = 1122.
#[test]
fn the_worst_case_of_abort_is_the_sum_of_its_parts() {
    let (data, config) = (page("../kuka/cell_data.dat"), page("../kuka/cell_config.dat"));
    let [retract_mm, speed_m_s, acceleration_m_s2] =
        ["CELL_RETRACT_MM", "CELL_RETRACT_VEL", "CELL_RETRACT_ACC"].map(|name| stated(&config, name));
    let retract_ms = retract_mm / speed_m_s + 1_000.0 * speed_m_s / acceleration_m_s2;
    let (request_ms, brake_ms) = (100.0, 260.0);
    let off_ms = request_ms + stated(&data, "CELL_WATCHDOG_MS") + stated(&data, "CELL_CYCLE_MS");
    let safety = page("safety.md");
    for (row, number) in [
        ("the request on the page", request_ms),
        ("the controller receives no message", stated(&data, "CELL_WATCHDOG_MS")),
        ("a cycle of the submit interpreter", stated(&data, "CELL_CYCLE_MS")),
        ("*tool and water off, sum*", off_ms),
        ("brake from", brake_ms),
        ("retract by", retract_ms),
        ("*at rest, sum*", off_ms + brake_ms + retract_ms),
    ] {
        let line = safety.lines().find(|line| line.starts_with(&format!("| {row}"))).expect(row);
        let cell = line.split(" | ").nth(1).expect("a time").replace('*', "");
        assert_eq!(cell, format!("{number:.0} ms"), "{row}");
    }
    let [off_s, rest_s] = [off_ms, off_ms + brake_ms + retract_ms].map(|ms| format!("{:.2} s", ms / 1_000.0));
    let abort = safety.lines().find(|line| line.starts_with("| Abort |")).expect("a row");
    assert!(abort.contains(&off_s) && abort.contains(&rest_s), "{abort}");
}
