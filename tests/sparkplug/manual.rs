//! Tests that the manual's tables of MQTT Sparkplug agree with the program and its tests.

use panelprep::sparkplug::{METRICS, NodeCommand};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use strum::VariantArray;

/// Returns the rows of a page that begin with this text, as cells.
fn rows(page: &str, begin: &str) -> Vec<Vec<String>> {
    let text =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("config/manual").join(page)).expect("a page");
    let rows = text.lines().filter(|line| line.starts_with(begin));
    rows.map(|line| line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()).collect()
}

/// The manual's table lists the program's metrics in their order, with alias, type and meaning, and its commands.
#[test]
fn the_manual_lists_every_metric() {
    let listed: Vec<_> =
        rows("sparkplug.md", "| ").into_iter().filter(|row| row[0].parse::<u32>().is_ok()).collect();
    let known = METRICS.iter().enumerate().map(|(place, metric)| {
        let (alias, name) = ((place + 1).to_string(), format!("`{}`", metric.name));
        vec![alias, name, metric.datatype.type_name().to_owned(), metric.meaning.to_owned()]
    });
    assert_eq!(listed, known.collect::<Vec<_>>());
    let listed: Vec<_> =
        rows("sparkplug.md", "| `Node Control/").into_iter().map(|row| row[..2].to_vec()).collect();
    let known = NodeCommand::VARIANTS.iter().map(|command| {
        let alias = command.alias().map_or(String::new(), |alias| alias.to_string());
        vec![format!("`{}`", command.name()), alias]
    });
    assert_eq!(listed, known.collect::<Vec<_>>());
}

/// The table of assertions contains each assertion once, each named test exists, and the numbers in the table's summary
/// are correct.
#[test]
fn the_assertions_name_existing_tests() {
    let page = "sparkplug-assertions.md";
    let all = rows(page, "| `");
    let names: BTreeSet<&str> = all.iter().map(|row| row[0].as_str()).collect();
    assert_eq!((all.len(), names.len()), (299, 299), "as many as the specification has");
    assert_eq!(names.iter().filter(|name| name.chars().all(|c| !c.is_ascii_uppercase())).count(), 295);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = [
        "src/interfaces/sparkplug/tests/mod.rs",
        "src/interfaces/sparkplug/tests/commanded.rs",
        "src/interfaces/sparkplug/tests/walks.rs",
        "src/service/daemon/sparkplug/tests.rs",
        "src/cell/cell/sparkplug.rs",
        "tests/sparkplug.rs",
    ];
    let code: String = files.map(|file| fs::read_to_string(root.join(file)).expect("code")).concat();
    for row in &all {
        let is_right = match row[1].as_str() {
            "tested" => code.contains(&format!("fn {}(", row[2].trim_matches('`'))),
            "not applicable" | "open" => !row[2].is_empty() && !row[2].starts_with('`'),
            _ => false,
        };
        assert!(is_right, "{row:?}");
    }
    for result in ["tested", "not applicable", "open"] {
        let count = all.iter().filter(|row| row[1] == result).count().to_string();
        assert_eq!(rows(page, &format!("| {result} |"))[0][1], count, "{result}");
    }
}
