//! Tests that the table of `tests/bench/README.md` and the benches contain the same figures, and that the table is
//! rewritten correctly.

use super::figures_rows::{figures, parse, replaced, rows};
use super::words::sources;
use std::collections::BTreeSet;
use std::path::Path;

fn page() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bench/README.md");
    std::fs::read_to_string(path).expect("the page")
}

/// Returns the names of all figures in a source, in their order; an error with the place of a figure whose name is not
/// a literal.
fn figure_names(source: &str) -> Result<Vec<String>, String> {
    let uses = source.match_indices("Figure(").filter(|(at, _)| !source[..*at].ends_with("pub struct "));
    let name = |(at, found): (usize, &str)| {
        let rest = source[at + found.len()..].trim_start();
        let end = rest.char_indices().skip(1).find(|(end, c)| *c == '"' && !rest[..*end].ends_with('\\'));
        let literal = end.filter(|_| rest.starts_with('"')).map(|(end, _)| &rest[..=end]);
        let literal = literal.and_then(|literal| syn::parse_str::<syn::LitStr>(literal).ok());
        literal
            .map(|literal| literal.value())
            .ok_or_else(|| format!("no literal: {}", rest.lines().next().unwrap_or("")))
    };
    uses.map(name).collect()
}

/// This file contains figures that no bench reports, because it tests how names are found.
const THIS_FILE: &str = "tests/figures.rs";

#[test]
fn each_figure_of_a_bench_has_one_row_and_each_row_a_figure() {
    let mut reported = BTreeSet::new();
    // Another type `Figure` of the program is a picture of the record.
    let reports = |source: &str| source.contains("goal::Figure") || source.contains("goal::{Figure");
    for (file, source) in sources().iter().filter(|(file, source)| file != THIS_FILE && reports(source)) {
        reported.extend(figure_names(source).unwrap_or_else(|error| panic!("{file}: {error}")));
    }
    let page = page();
    let table: Vec<String> = rows(&page).into_iter().flat_map(figures).collect();
    assert!(table.len() > 60, "{} figures", table.len());
    let stated: BTreeSet<String> = table.iter().cloned().collect();
    assert_eq!(table.len(), stated.len(), "a figure has two rows");
    let without_row: Vec<_> = reported.difference(&stated).collect();
    assert!(without_row.is_empty(), "add a row to tests/bench/README.md: {without_row:#?}");
    let without_figure: Vec<_> = stated.difference(&reported).collect();
    assert!(without_figure.is_empty(), "no bench reports these rows, delete or report them: {without_figure:#?}");
}

#[test]
fn names_are_literals() {
    let source = "Figure(\"a: b\").report(x); Figure(\n    \"a: \\\"c\\\"\",\n)";
    assert_eq!(figure_names(source), Ok(vec!["a: b".to_owned(), "a: \"c\"".to_owned()]));
    assert!(figure_names("Figure(name)").is_err());
}

const TABLE: &str = "# Numbers\n\n| Figure | Goal | Measured | Command | Commit |\n|---|---|---|---|---|\n\
    | link: rate · idle | 95 % · 60 ms | 100 % · 44.6 ms | `link` | `aaaaaaa` · `bbbbbbb` |\n\
    | store: query | 100 ms | 14.8 ms | `history` | `ccccccc` |\n\nText.\n";

const OUTPUT: &str = "seed 1 is good\n\
    GOAL\tlink: idle\t60 ms\t70.0 ms\tMISSED\tlink -- 500\n\
    GOAL\tlink: idle\t60 ms\t64.9 ms\tMISSED\tlink -- 1000\n";

#[test]
fn a_measured_figure_replaces_its_part_of_the_row_only() {
    let measured = parse(OUTPUT).expect("good lines");
    let new = replaced(TABLE, &measured, "ddddddd").expect("a row");
    let expected = "| link: rate · idle | 95 % · 60 ms | 100 % · 64.9 ms: **missed** | `link` · `link -- 1000` | `aaaaaaa` · `ddddddd` |";
    assert_eq!(rows(&new)[0], expected);
    assert_eq!(new.replace(expected, rows(TABLE)[0]), TABLE, "nothing else changes");
    let not_run = parse("GOAL\tstore: query\t100 ms\tnot run\tnot run\thistory\n").expect("a good line");
    let new = replaced(&new, &not_run, "ddddddd").expect("a row");
    assert_eq!(rows(&new)[1], "| store: query | 100 ms | not run | `history` | `ddddddd` |");
}

#[test]
fn a_figure_without_a_row_and_a_damaged_line_are_errors() {
    let unknown = parse("GOAL\tlink: busy\t90 ms\t45.5 ms\tok\tlink\n").expect("a good line");
    let error = replaced(TABLE, &unknown, "ddddddd").expect_err("no row");
    assert!(error.contains("link: busy"), "{error}");
    for damaged in [
        "GOAL\tlink: idle\t60 ms\t64.9 ms\n",
        "GOAL\tlink: idle\t60 ms\t64.9 ms\tgood\tlink\n",
        "GOAL\tlink: idle\t60 ms\t\tok\tlink\n",
        "GOAL\tlink: idle\t60 ms · 70 ms\t64.9 ms\tok\tlink\n",
    ] {
        assert!(parse(damaged).expect_err("damaged").starts_with("line 1"), "{damaged}");
    }
    let damaged_row = TABLE.replace("95 % · 60 ms", "95 % · 60 ms · 1");
    assert!(replaced(&damaged_row, &parse(OUTPUT).expect("good lines"), "ddddddd").is_err());
}

/// A new value of each figure can be written into each row of the page.
#[test]
fn every_row_of_the_page_can_be_rewritten() {
    let page = page();
    for row in rows(&page) {
        for figure in figures(row) {
            let line = format!("GOAL\t{figure}\t1 mm\t0.5 mm\tok\tseeds\n");
            let new = replaced(&page, &parse(&line).expect("a good line"), "ddddddd").expect("written");
            assert!(new.contains("0.5 mm") && new.contains("`ddddddd`") && new != page, "{row}");
        }
    }
}
