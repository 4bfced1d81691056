//! Checks in the source what the program prints for people. No text contains a debug format, and no measured number
//! beside its limit is rounded so that it could look equal to it.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use syn::visit::{self, Visit};

/// Texts that are read by machines, or by programmers: part of the file's name, part of the text.
const FOR_MACHINES: [(&str, &str); 26] = [
    // TOML and digests need every digit, and quotes around a text.
    ("cell/calibration.rs", "{number:?}"),
    ("cell/calibration.rs", "{:?}"),
    ("cell/calibration.rs", "{coefficients_mm:?}"),
    ("cell/provenance.rs", "{:?}"),
    ("cell/robot_correction.rs", "{number:?}"),
    ("cli/render.rs", "verify_limit_mm = {:?}"),
    ("cli/render.rs", "observation_s"),
    ("cli/calibrate/files/pose.rs", "base_from_flange"),
    ("cli/calibrate/files/pose.rs", "axes_deg = {"),
    ("cli/calibrate/live/touching.rs", "axes_deg = {"),
    ("cli/tune.rs", "channel_weights = {"),
    ("cli/tune.rs", "persist_s = {"),
    ("cli/tune.rs", "min_break_mm2 = {"),
    ("cli/tune.rs", "lamp = {"),
    ("cli/tune.rs", "hsv_min = {"),
    ("cli/tune.rs", "hsv_max = {"),
    ("store/journal.rs", "{before} {sequence}"),
    ("daemon/abrasion.rs", "{:?}"),
    ("cell/lens.rs", "supported_error_px = {"),
    ("cell/robot_correction.rs", "numbers = {"),
    ("cell/robot_correction.rs", "middle_mm = {middle_mm:?}"),
    ("cli/render_boards.rs", "p{number}_axes_deg = {"),
    ("cell/robot_correction.rs", "left_out_before_mm = {"),
    ("cell/robot_correction.rs", "left_out_after_mm = {"),
    // Output of `Debug` itself.
    ("devices/zivid/wire.rs", "{found:02x?}"),
    ("devices/zivid/scanner.rs", "?found"),
];

/// The texts in a file that people read, as they are written in its code.
#[derive(Default)]
struct Texts {
    found: Vec<String>,
    /// Modules that are compiled only for tests.
    for_tests: Vec<String>,
}

fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let list = attribute.meta.require_list();
        attribute.path().is_ident("cfg") && list.is_ok_and(|list| list.tokens.to_string().contains("test"))
            || attribute.path().is_ident("test")
    })
}

/// Returns the string literals in a token sequence, and the markers of `tracing` before a field.
fn literals(tokens: &str, marks: bool) -> Vec<String> {
    let (mut found, mut code, mut rest) = (Vec::new(), String::new(), tokens);
    while let Some(start) = rest.find('"') {
        code.push_str(&rest[..start]);
        let mut escaped = false;
        let end = rest[start + 1..].find(|c| {
            let ends = c == '"' && !escaped;
            escaped = c == '\\' && !escaped;
            ends
        });
        let Some(end) = end.map(|end| start + 1 + end + 1) else { break };
        found.extend(syn::parse_str::<syn::LitStr>(&rest[start..end]).ok().map(|text| text.value()));
        rest = &rest[end..];
    }
    code.push_str(rest);
    let marked = code.split(['(', ',']).filter_map(|part| part.trim().strip_prefix('?')).filter(|_| marks);
    found.extend(marked.map(|name| format!("?{}", name.trim())));
    found
}

impl<'ast> Visit<'ast> for Texts {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if is_for_tests(&item.attrs) {
            self.for_tests.push(item.ident.to_string());
            return;
        }
        visit::visit_item_mod(self, item);
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_for_tests(&item.attrs) {
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_attribute(&mut self, attribute: &'ast syn::Attribute) {
        if attribute.path().is_ident("error")
            && let Ok(list) = attribute.meta.require_list()
        {
            self.found.extend(literals(&list.tokens.to_string(), false));
        }
    }

    fn visit_macro(&mut self, invocation: &'ast syn::Macro) {
        let name = invocation.path.segments.last().map(|last| last.ident.to_string()).unwrap_or_default();
        let for_programmers =
            ["assert", "assert_eq", "assert_ne", "debug_assert", "unreachable", "panic", "debug", "trace"];
        if !for_programmers.contains(&name.as_str()) {
            let is_log = ["info", "warn", "error"].contains(&name.as_str());
            self.found.extend(literals(&invocation.tokens.to_string(), is_log));
        }
        visit::visit_macro(self, invocation);
    }
}

/// Returns each file below `src` with its texts, without code that is compiled only for tests.
pub fn texts() -> Vec<(String, Vec<String>)> {
    let (mut left_out, mut files) = (BTreeSet::new(), Vec::new());
    for (name, source) in sources().iter().filter_map(|(name, source)| Some((name.strip_prefix("src/")?, source))) {
        let path = PathBuf::from(name);
        let mut texts = Texts::default();
        texts.visit_file(&syn::parse_file(source).expect("it parses"));
        let below = match path.file_stem().and_then(|stem| stem.to_str()) {
            Some("mod" | "lib" | "main") => path.parent().map_or_else(PathBuf::new, Path::to_owned),
            _ => path.with_extension(""),
        };
        left_out.extend(texts.for_tests.iter().map(|name| below.join(name)));
        files.push((path, texts.found));
    }
    let is_left_out = |path: &Path| left_out.iter().any(|module| path.with_extension("").starts_with(module));
    let kept = files.into_iter().filter(|(path, _)| !is_left_out(path));
    kept.map(|(path, found)| (path.display().to_string(), found)).collect()
}

fn is_for_machines(file: &str, text: &str) -> bool {
    FOR_MACHINES.iter().any(|(name, part)| file.ends_with(name) && text.contains(part))
}

/// Returns whether a text has the form `{:?}` or `{value:?}`, or `?value` in a log.
fn has_debug_form(text: &str) -> bool {
    let inside = |part: &str| {
        part.split('}').next().is_some_and(|spec| spec.split(':').nth(1).is_some_and(|form| form.ends_with('?')))
    };
    text.strip_prefix('?')
        .is_some_and(|name| !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || c == '_'))
        || text.replace("{{", "").split('{').skip(1).any(inside)
}

/// Returns whether a number is rounded in a text that states a limit. A position in a picture is not a measured number.
fn rounds_beside_a_limit(text: &str) -> bool {
    let says = ["allowed", "needed", "wanted", "limit", "limits", "minimum"];
    let words: Vec<&str> = text.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
    let mut rest = text.replace("{:.0}, {:.0}) px", "").replace("{u:.0}, {v:.0}) px", "");
    rest = rest.replace("{{", "");
    let rounds = rest.split('{').skip(1).any(|part| {
        part.split('}').next().is_some_and(|spec| spec.split_once(':').is_some_and(|(_, form)| form.contains('.')))
    });
    rounds && says.iter().any(|word| words.contains(word))
}

#[test]
fn no_text_for_people_has_a_form_for_programmers() {
    let texts = texts();
    assert!(texts.len() > 150 && texts.iter().map(|(_, found)| found.len()).sum::<usize>() > 1_000);
    let wrong: Vec<String> = texts
        .iter()
        .flat_map(|(file, found)| found.iter().map(move |text| (file, text)))
        .filter(|(file, text)| has_debug_form(text) && !is_for_machines(file, text))
        .map(|(file, text)| format!("{file}: {text}"))
        .collect();
    assert!(wrong.is_empty(), "say it in words, or add it to FOR_MACHINES: {wrong:#?}");
}

#[test]
fn a_number_beside_its_limit_is_printed_by_number_text() {
    let wrong: Vec<String> = texts()
        .iter()
        .flat_map(|(file, found)| found.iter().map(move |text| (file, text)))
        .filter(|(_, text)| rounds_beside_a_limit(text))
        .map(|(file, text)| format!("{file}: {text}"))
        .collect();
    assert!(
        wrong.is_empty(),
        "rounded, both may read the same: print them by `number_text::distinguishable_texts`: {wrong:#?}"
    );
}

/// Checks that the test detects injected texts.
#[test]
fn planted_texts_are_found() {
    let code = r#"
        #[derive(thiserror::Error)] enum E { #[error("{found:?} is no name")] A { found: String } }
        fn f() { let _ = format!("stopped, {:?}", 1); tracing::info!(?who, "asked"); assert!(true, "{:?}", 2); }
        #[cfg(test)] mod tests { fn g() { let _ = format!("{:?}", 3); } }
        #[cfg(test)] mod others;
    "#;
    let mut texts = Texts::default();
    texts.visit_file(&syn::parse_file(code).expect("it parses"));
    let found: Vec<&String> = texts.found.iter().filter(|text| has_debug_form(text)).collect();
    assert_eq!(found, ["{found:?} is no name", "stopped, {:?}", "?who"]);
    assert_eq!(texts.for_tests, ["tests", "others"]);
    assert!(rounds_beside_a_limit("{:.0} % of the panel, allowed are {:.0} %"));
    for right in
        ["{found} %, allowed are {allowed} %", "at ({:.0}, {:.0}) px, needed are {needed}", "{age:.1} h ago"]
    {
        assert!(!rounds_beside_a_limit(right), "{right}");
    }
}

/// Words of a former dialect of this code, with the standard term. They are refused in comments and in texts for
/// people.
const DIALECT: [(&str, &str); 15] = [
    ("told", "reported, measured, commanded"),
    ("whoever", "the person, the operator, the caller"),
    ("somebody", "a person, the operator, the client"),
    ("someone", "a person, the operator, the client"),
    ("nobody", "no person, no client"),
    ("whichever", "the one that"),
    ("thereof", "of the …"),
    ("anyhow", "in any case"),
    ("so often", "interval, rate, number of times"),
    ("so much", "the amount"),
    ("so many", "the number"),
    ("goes on", "continues"),
    ("go on", "continue"),
    ("went on", "continued"),
    ("is there already", "already exists"),
];

/// Words of the same dialect that are refused only in texts for people.
const DIALECT_OF_TEXTS: [(&str, &str); 3] =
    [("allowed are", "limit"), ("allowed is", "valid:"), ("needed are", "at least … are needed")];

/// Function names of the same dialect, with the kind of name that is used instead.
const DIALECT_NAMES: [(&str, &str); 9] = [
    ("of", "new, from_…, compute_…"),
    ("told", "report, summary, to_json"),
    ("tell", "publish, send, report"),
    ("hear", "receive, on_event"),
    ("heard", "received"),
    ("says", "states, describes"),
    ("stands", "status, state, pose"),
    ("takes", "accepts"),
    ("minds", "rejects"),
];

/// Maximum length of a comment line, characters. The formatter wraps code, not comments.
const COMMENT_LINE: usize = 130;

/// Maximum length of the subject of a commit, characters.
const SUBJECT: usize = 72;

/// Returns the terms of a list that are in a text, as whole words; names of placeholders are ignored.
pub fn dialect<'l>(text: &str, list: &'l [(&'l str, &'l str)]) -> impl Iterator<Item = &'l (&'l str, &'l str)> {
    let without: String = text.split('{').map(|part| part.split_once('}').map_or(part, |(_, rest)| rest)).collect();
    let words: Vec<String> = without
        .split(|c: char| !c.is_alphanumeric() && c != '_')
        .filter(|word| !word.is_empty())
        .map(str::to_lowercase)
        .collect();
    let plain = format!(" {} ", words.join(" "));
    list.iter().filter(move |(word, _)| plain.contains(&format!(" {word} ")))
}

/// Returns one line for each term of the list in this text.
fn refused(file: &str, text: &str, list: &[(&str, &str)]) -> Vec<String> {
    dialect(text, list).map(|(word, standard)| format!("{file}: \"{word}\" → {standard}: {text}")).collect()
}

/// Returns the comments of a file, each paragraph as one text, because a phrase may be broken over two lines.
pub fn comments(source: &str) -> Vec<String> {
    let (mut found, mut current) = (Vec::new(), String::new());
    for line in source.lines() {
        match line.trim_start().strip_prefix("//") {
            Some(text) => {
                current.push_str(text.trim_start_matches(['/', '!']));
                current.push(' ');
            }
            None if !current.is_empty() => found.push(std::mem::take(&mut current)),
            None => {}
        }
    }
    found.push(current);
    found
}

/// Returns all Rust files below `src` and `tests`, each with its path relative to the project's root and its text.
pub fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut folders, mut files) = (vec![root.join("src"), root.join("tests")], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let name = path.strip_prefix(root).expect("below the root").display().to_string();
                files.push((name, fs::read_to_string(&path).expect("text")));
            }
        }
    }
    files
}

#[test]
fn comments_and_texts_use_standard_terms() {
    let sources = sources();
    assert!(sources.len() > 500);
    let mut wrong = Vec::new();
    for (file, source) in &sources {
        comments(source).iter().for_each(|text| wrong.extend(refused(file, text, &DIALECT)));
    }
    for (file, found) in texts() {
        for text in found.iter().filter(|text| text.contains(' ')) {
            wrong.extend(refused(&file, text, &DIALECT));
            wrong.extend(refused(&file, text, &DIALECT_OF_TEXTS));
        }
    }
    assert!(wrong.is_empty(), "{} places, write the standard term: {wrong:#?}", wrong.len());
}

#[test]
fn no_function_has_a_dialect_name() {
    let wrong: Vec<String> = sources()
        .iter()
        .flat_map(|(file, source)| {
            let names = source.split("fn ").skip(1).filter_map(|rest| rest.split(['(', '<']).next());
            let known = names.filter_map(|name| DIALECT_NAMES.iter().find(|(dialect, _)| *dialect == name));
            known.map(move |(name, standard)| format!("{file}: fn {name} → {standard}")).collect::<Vec<_>>()
        })
        .collect();
    assert!(wrong.is_empty(), "{} functions: {wrong:#?}", wrong.len());
}

#[test]
fn comment_lines_and_subjects_of_commits_are_short() {
    // A row of a table, a formula and an example of JSON cannot be broken.
    let is_one_piece = |text: &str| text.starts_with(['|', '{']) || text.starts_with("   ") || text.contains("──");
    let is_long = |line: &str| {
        let comment = line.trim_start().strip_prefix("//").map(|text| text.trim_start_matches(['/', '!']));
        line.chars().count() > COMMENT_LINE
            && comment.is_some_and(|text| !is_one_piece(text.strip_prefix(' ').unwrap_or(text)))
    };
    let wrong: Vec<String> = sources()
        .iter()
        .flat_map(|(file, source)| {
            let long = source.lines().enumerate().filter(|(_, line)| is_long(line));
            long.map(move |(index, _)| format!("{file}:{}", index + 1)).collect::<Vec<_>>()
        })
        .collect();
    assert!(wrong.is_empty(), "longer than {COMMENT_LINE} characters: {wrong:#?}");
    let log = std::process::Command::new("git")
        .args(["log", "--no-merges", "--max-count=30", "--format=%s"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output();
    match log {
        Ok(output) if output.status.success() => {
            let subjects = String::from_utf8_lossy(&output.stdout).into_owned();
            let wrong: Vec<&str> = subjects.lines().filter(|line| line.chars().count() > SUBJECT).collect();
            assert!(wrong.is_empty(), "longer than {SUBJECT} characters: {wrong:#?}");
        }
        _ => eprintln!("not run: the subjects of commits, since this is no clone"),
    }
}

/// Checks that the test detects injected dialect.
#[test]
fn planted_dialect_is_found() {
    let planted = "/// Where nobody stands, it goes\n/// on so often.\nfn f() {}\n// Retold: a golden rule.\n";
    let found: Vec<Vec<&str>> =
        comments(planted).iter().map(|text| dialect(text, &DIALECT).map(|(word, _)| *word).collect()).collect();
    assert_eq!(found, [vec!["nobody", "so often", "goes on"], vec![]]);
}

/// The page of measured numbers is one table: figure, goal, measured, command, commit.
#[test]
fn the_page_of_measured_numbers_is_one_short_table() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bench/README.md");
    let page = fs::read_to_string(page).expect("the page");
    let table = super::figures_rows::rows(&page);
    assert!((1..=60).contains(&table.len()), "{} rows, at most 60: replace a row of the same figure", table.len());
    for row in table {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
        assert!(cells.len() == 5 && cells.iter().all(|cell| !cell.is_empty()), "five cells: {row}");
        assert!(cells[0].contains(": "), "a figure begins with its area: {row}");
    }
}
