//! The two pictures in `src/README.md`: the crates, as their `Cargo.toml` files state them, and the data of a cycle, as the
//! page's table states them. Run these tests with `DRAW=1` to draw them again.

use super::glossary::{DATA_HEAD, table_rows};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::Path;

const WIDTH: usize = 900;
const BOX: [usize; 2] = [150, 40];
const ROW: usize = 78;

/// The crates on which each crate depends, without those that only its tests use; or the data that each datum is made from.
type Dependencies = BTreeMap<String, BTreeSet<String>>;

fn dependencies(root: &Path) -> Dependencies {
    let read =
        |file: &Path| -> toml::Table { fs::read_to_string(file).expect("Cargo.toml").parse().expect("TOML") };
    let members = read(&root.join("Cargo.toml"))["workspace"]["members"].clone();
    let members =
        members.as_array().expect("a list").iter().map(|member| member.as_str().expect("a path").to_owned());
    let of = |folder: &str| {
        let manifest = read(&root.join(folder).join("Cargo.toml"));
        let names = manifest["dependencies"].as_table().expect("a table").keys();
        names.filter_map(|name| name.strip_prefix("panelprep-")).map(str::to_owned).collect()
    };
    let name = |folder: &str| folder.strip_prefix("src/").unwrap_or("panelprep").to_owned();
    members.chain([String::new()]).map(|folder| (name(&folder), of(&folder))).collect()
}

/// Returns all crates that a crate needs, directly or through others.
fn transitive_dependencies(all: &Dependencies, from: &str) -> BTreeSet<String> {
    let direct = all[from].iter();
    direct.flat_map(|name| transitive_dependencies(all, name).into_iter().chain([name.clone()])).collect()
}

/// Returns the dependencies that no other dependency implies.
fn non_transitive_edges(all: &Dependencies) -> Vec<(&str, &str)> {
    let is_implied = |from: &str, to: &str| {
        all[from].iter().any(|other| other != to && transitive_dependencies(all, other).contains(to))
    };
    let pairs = all.iter().flat_map(|(from, direct)| direct.iter().map(move |to| (from.as_str(), to.as_str())));
    pairs.filter(|(from, to)| !is_implied(from, to)).collect()
}

/// Returns the number of crates on the longest way down from a crate.
fn chain_length(all: &Dependencies, name: &str) -> usize {
    all[name].iter().map(|below| chain_length(all, below) + 1).max().unwrap_or(0)
}

/// Returns the row of each crate, from the top: what depends on others is above them.
fn crate_rows(all: &Dependencies) -> BTreeMap<&str, usize> {
    let top = all.keys().map(|name| chain_length(all, name)).max().unwrap_or(0);
    all.keys().map(|name| (name.as_str(), top - chain_length(all, name))).collect()
}

/// Returns the row of each datum, from the top: what is made from others is below them, and what is made from nothing is just
/// above the first datum that is made from it.
fn data_rows(all: &Dependencies) -> BTreeMap<&str, usize> {
    let first_use = |name: &str| {
        let users = all.iter().filter(|(_, parts)| parts.contains(name)).map(|(user, _)| chain_length(all, user));
        users.min().map_or(0, |row| row - 1)
    };
    let row = |name: &str| if all[name].is_empty() { first_use(name) } else { chain_length(all, name) };
    all.keys().map(|name| (name.as_str(), row(name))).collect()
}

fn drawing(all: &Dependencies, row_of: &BTreeMap<&str, usize>) -> String {
    let mut rows: BTreeMap<usize, Vec<&str>> = BTreeMap::new();
    for (name, row) in row_of {
        rows.entry(*row).or_default().push(name);
    }
    // Crates that depend on the simulator are on the right, where the lines that pass other rows go down.
    rows.values_mut().for_each(|row| row.sort_by_key(|name| transitive_dependencies(all, name).contains("sim")));
    let bottom = rows.keys().copied().max().unwrap_or(0);
    let place = |name: &str| {
        let row = &rows[&row_of[name]];
        let index = row.iter().position(|other| *other == name).expect("in its row");
        [WIDTH * (2 * index + 1) / (2 * row.len()), 30 + ROW * row_of[name]]
    };
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {}\" font-family=\"sans-serif\" \
         font-size=\"16\" text-anchor=\"middle\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
        60 + ROW * bottom
    );
    for (from, to) in non_transitive_edges(all) {
        // From the upper end down.
        let (from, to) = if row_of[from] < row_of[to] { (from, to) } else { (to, from) };
        let ([x1, y1], [x2, y2]) = (place(from), place(to));
        let half = BOX.map(|side| side / 2);
        let line = if row_of[to] - row_of[from] > 1 {
            let [x1, x2, x] = [x1 + half[0], x2 + half[0], WIDTH - 10];
            format!("M{x1} {y1}C{x} {y1} {x} {y2} {x2} {y2}")
        } else {
            format!("M{x1} {}L{x2} {}", y1 + half[1], y2 - half[1])
        };
        writeln!(text, "<path d=\"{line}\" fill=\"none\" stroke=\"#789\" stroke-width=\"1.5\"/>")
            .expect("a string");
    }
    for name in all.keys() {
        let [x, y] = place(name);
        let [left, up] = [x - BOX[0] / 2, y - BOX[1] / 2];
        writeln!(
            text,
            "<rect x=\"{left}\" y=\"{up}\" width=\"{}\" height=\"{}\" rx=\"6\" fill=\"#eef3f8\" stroke=\"#456\"/>\
             <text x=\"{x}\" y=\"{}\" fill=\"#123\">{name}</text>",
            BOX[0],
            BOX[1],
            y + 6
        )
        .expect("a string");
    }
    text + "</svg>\n"
}

/// Compares a picture with its file, or writes the file if `DRAW` is set.
fn assert_drawn(file: &str, drawn: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    if std::env::var_os("DRAW").is_some() {
        fs::write(&file, drawn).expect("the picture");
    }
    assert_eq!(fs::read_to_string(&file).expect("the picture"), drawn, "draw it again with DRAW=1");
}

/// Returns the data of a cycle from the table in `src/README.md`; panics at a row that does not have its four cells.
fn data_of_a_cycle(page: &str) -> Dependencies {
    let datum = |cells: Vec<&str>| {
        let [name, _, parts, _] = cells[..] else { panic!("four cells: {cells:?}") };
        (name.to_owned(), parts.split(", ").filter(|part| *part != "–").map(str::to_owned).collect())
    };
    table_rows(page, DATA_HEAD).map(datum).collect()
}

#[test]
fn the_picture_of_the_data_is_drawn_from_the_table() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/README.md");
    let all = data_of_a_cycle(&fs::read_to_string(page).expect("the page"));
    let parts: BTreeSet<&String> = all.values().flatten().collect();
    assert!(parts.iter().all(|part| all.contains_key(*part)), "each datum has its own row: {parts:?}");
    // A signed record goes back to the scan, to the film and to the poses that the robot reported.
    let signed = transitive_dependencies(&all, "signed record");
    assert!(
        ["scan", "film pictures", "reported poses"].iter().all(|source| signed.contains(*source)),
        "{signed:?}"
    );
    assert_drawn("src/cycle.svg", &drawing(&all, &data_rows(&all)));
}

#[test]
fn the_picture_of_the_crates_is_drawn_from_their_manifests() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let all = dependencies(root);
    assert!((8..=12).contains(&all.len()), "{all:?}");
    assert_drawn("src/crates.svg", &drawing(&all, &crate_rows(&all)));
}

/// Of three crates in a line, the arrow from the first to the last is implied.
#[test]
fn an_implied_arrow_is_not_drawn() {
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    let all = [("a", names(&["b", "c"])), ("b", names(&["c"])), ("c", names(&[]))];
    let all: Dependencies = all.into_iter().map(|(name, direct)| (name.to_owned(), direct)).collect();
    assert_eq!(non_transitive_edges(&all), [("a", "b"), ("b", "c")]);
    assert_eq!(["a", "b", "c"].map(|name| chain_length(&all, name)), [2, 1, 0]);
}
