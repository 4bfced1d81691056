//! The pages of the manual as steps: commands as they are typed, and the required contents of the cell.

use std::fs;
use std::path::{Path, PathBuf};

/// A step in a page of the manual.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// `<!-- cell: … -->`: the objects that a person has put into the cell.
    Cell(String),
    /// A line of a block of commands.
    Command(String),
}

/// The folder of the pages.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config/manual")
}

/// Returns the names of the pages in the order of the manual's table of contents.
pub fn names() -> Vec<String> {
    let contents = fs::read_to_string(folder().join("README.md")).expect("the contents");
    let linked = contents.lines().filter_map(|line| line.strip_prefix("| [")?.split_once("](")?.1.split_once(')'));
    linked.map(|(name, _)| name.to_owned()).collect()
}

/// Returns the steps of a page.
pub fn steps(text: &str) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut in_block = false;
    for line in text.lines() {
        match (in_block, line) {
            (false, "```sh") => in_block = true,
            (true, "```") => in_block = false,
            (true, command) if !command.trim().is_empty() => steps.push(Step::Command(command.to_owned())),
            (false, line) => {
                if let Some(cell) = line.strip_prefix("<!-- cell: ").and_then(|rest| rest.strip_suffix(" -->")) {
                    steps.push(Step::Cell(cell.to_owned()));
                }
            }
            _ => {}
        }
    }
    assert!(!in_block, "a block of commands has no end");
    steps
}

#[test]
fn the_steps_of_a_page_are_read() {
    let text = "# A\n\n<!-- cell: a board -->\n```sh\na b\nc\n```\ntext `d`\n```\nnot this\n```\n";
    let command = |text: &str| Step::Command(text.to_owned());
    assert_eq!(steps(text), [Step::Cell("a board".to_owned()), command("a b"), command("c")]);
}

/// Every page is in the table of contents, and every link and picture of a page exists.
#[test]
fn every_page_link_and_picture_exists() {
    let names = names();
    let mut there: Vec<String> = fs::read_dir(folder())
        .expect("the manual")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| name.ends_with(".md") && name != "README.md")
        .collect();
    there.sort();
    let mut listed = names.clone();
    listed.sort();
    assert_eq!(listed, there, "the contents list every page");
    for name in names.iter().map(String::as_str).chain(["README.md"]) {
        let text = fs::read_to_string(folder().join(name)).expect("a page");
        assert!(text.starts_with("# "), "{name} has a title");
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let file = link.split('#').next().unwrap_or_default();
            let is_there = link.starts_with("https://") || file.is_empty() || folder().join(file).is_file();
            assert!(is_there, "{name} links to {link}, which is not there");
        }
    }
}

/// Returns the error in a command line: a command, an option or a value that the program does not have. Placeholders
/// are treated as values.
fn command_error(line: &str, program: &clap::Command) -> Option<String> {
    let mut words = line.split_whitespace().skip(1).peekable();
    let mut command = program;
    while let Some(inner) = words.peek().and_then(|word| command.find_subcommand(word)) {
        command = inner;
        words.next();
    }
    let is_placeholder = |word: &str| word == "…" || word.chars().all(|c| c.is_ascii_uppercase());
    let first = words.peek().copied().unwrap_or_default();
    if command.has_subcommands() && !first.is_empty() && !first.starts_with('-') && !is_placeholder(first) {
        return Some(format!("{} has no command {first}", command.get_name()));
    }
    let of = |command: &clap::Command, long: &str| -> Option<Vec<String>> {
        let argument = command.get_arguments().find(|argument| argument.get_long() == Some(long))?;
        Some(argument.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect())
    };
    while let Some(word) = words.next() {
        let Some(long) = word.strip_prefix("--").filter(|long| !["help", "version"].contains(long)) else {
            continue;
        };
        let Some(allowed) = of(command, long).or_else(|| of(program, long)) else {
            return Some(format!("{} has no option --{long}", command.get_name()));
        };
        let value = words.peek().copied().unwrap_or_default();
        if !allowed.is_empty() && !["true", "false"].contains(&allowed[0].as_str()) && !is_placeholder(value) {
            let is_allowed = allowed.iter().any(|allowed| allowed == value);
            if !is_allowed {
                return Some(format!("{} --{long} takes no {value}", command.get_name()));
            }
        }
    }
    None
}

/// Every command that a page names, also in the middle of a sentence, is a command of the program with valid options.
#[test]
fn the_pages_name_only_existing_commands() {
    use clap::CommandFactory as _;
    let program = panelprep::cli::args::Arguments::command();
    assert!(command_error("panelprep calibrate verify --camera scanner --target FILE", &program).is_none());
    assert!(command_error("panelprep calibrate verify --camera eyes", &program).is_some());
    assert!(
        command_error("panelprep calibrate very", &program).is_some()
            && command_error("panelprep shoot --fast", &program).is_some()
    );
    let (mut seen, mut found) = (0, Vec::new());
    for name in names().iter().map(String::as_str).chain(["README.md", "../trial.md", "../kuka/README.md"]) {
        let text = fs::read_to_string(folder().join(name)).expect("a page");
        let typed = steps(&text).into_iter().filter_map(|step| match step {
            Step::Command(line) => Some(line),
            Step::Cell(_) => None,
        });
        let named = text.split('`').filter(|span| span.starts_with("panelprep ")).map(str::to_owned);
        for line in typed.filter(|line| line.starts_with("panelprep ")).chain(named) {
            seen += 1;
            found.extend(command_error(&line, &program).map(|problem| format!("{name}: {line}: {problem}")));
        }
    }
    assert!(seen > 200 && found.is_empty(), "{seen}: {found:#?}");
}
