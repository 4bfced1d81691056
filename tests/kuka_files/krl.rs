//! Parses KRL as text, as far as the tests need it: files, routines, statements, words, calls.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The folder of the controller's files.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config/kuka")
}

/// One `.src` or `.dat` file.
pub struct File {
    pub name: String,
    pub text: String,
    pub routines: Vec<Routine>,
}

/// One routine: `DEF … END` or `DEFFCT … ENDFCT`.
pub struct Routine {
    pub name: String,
    pub file: String,
    pub global: bool,
    pub parameters: Vec<String>,
    /// The statements without comments, blank lines and the closing keyword.
    pub body: Vec<Statement>,
}

/// One line that is neither blank nor a comment.
#[derive(Clone)]
pub struct Statement {
    pub line: usize,
    /// Without its comment.
    pub code: String,
    /// Without `;`.
    pub comment: String,
}

impl Statement {
    /// Returns the words of the statement, without strings. A word after `.` or `#` is a part of another name and is
    /// also omitted.
    pub fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        let (mut word, mut before, mut in_string) = (String::new(), ' ', false);
        for c in self.code.chars().chain([' ']) {
            if c == '"' {
                in_string = !in_string;
            }
            if !in_string && (c.is_ascii_alphanumeric() || c == '_' || c == '$') {
                word.push(c);
                continue;
            }
            if !word.is_empty() && !word.starts_with(|c: char| c.is_ascii_digit()) && !['.', '#'].contains(&before)
            {
                words.push(word.to_uppercase());
            }
            word.clear();
            before = if in_string && c != '"' { ' ' } else { c };
        }
        words
    }

    /// Returns every `NAME(arguments)` in the statement, with the arguments split at their commas.
    pub fn calls(&self) -> Vec<(String, Vec<String>)> {
        let mut calls = Vec::new();
        for (at, _) in self.code.match_indices('(') {
            let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
            let name: String = self.code[..at].chars().rev().take_while(|&c| is_name(c)).collect();
            let name: String = name.chars().rev().collect();
            if !name.is_empty() {
                calls.push((name.to_uppercase(), arguments(&self.code[at + 1..])));
            }
        }
        calls
    }

    pub fn first_word(&self) -> String {
        self.words().first().cloned().unwrap_or_default()
    }
}

/// Splits the arguments at the commas, up to the closing bracket.
fn arguments(text: &str) -> Vec<String> {
    let (mut depth, mut found) = (0, vec![String::new()]);
    for c in text.chars() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' if depth == 0 => break,
            ')' | ']' | '}' => depth -= 1,
            ',' if depth == 0 => {
                found.push(String::new());
                continue;
            }
            _ => {}
        }
        found.last_mut().expect("never empty").push(c);
    }
    let found: Vec<String> = found.iter().map(|argument| argument.trim().to_owned()).collect();
    if found == [""] { Vec::new() } else { found }
}

fn statement(line: usize, text: &str) -> Option<Statement> {
    let (code, comment) = text.split_once(';').unwrap_or((text, ""));
    let code = code.trim().to_owned();
    (!code.is_empty() && !code.starts_with('&')).then(|| Statement {
        line,
        code,
        comment: comment.trim().to_owned(),
    })
}

impl File {
    pub fn read(path: &Path) -> File {
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        let text = std::fs::read_to_string(path).expect("readable");
        let mut routines: Vec<Routine> = Vec::new();
        let mut open = false;
        for statement in text.lines().enumerate().filter_map(|(index, text)| statement(index + 1, text)) {
            let words = statement.words();
            let place = words.iter().position(|word| word == "DEF" || word == "DEFFCT");
            if let Some(place) = place {
                assert!(!open, "{name}:{}: the routine before is not closed", statement.line);
                let (routine, parameters) = statement.calls().first().cloned().expect("DEF NAME(…)");
                let parameter = |text: &String| text.split(':').next().unwrap_or_default().trim().to_uppercase();
                let parameters = parameters.iter().map(parameter).collect();
                let global = place == 1 && words[0] == "GLOBAL";
                routines.push(Routine { name: routine, file: name.clone(), global, parameters, body: Vec::new() });
                open = true;
            } else if ["END", "ENDFCT"].contains(&words.first().map_or("", String::as_str)) {
                assert!(open, "{name}:{}: closes nothing", statement.line);
                open = false;
            } else if let Some(routine) = routines.last_mut().filter(|_| open) {
                routine.body.push(statement);
            } else {
                assert!(name.ends_with(".dat"), "{name}:{}: outside of a routine", statement.line);
            }
        }
        assert!(!open, "{name}: the last routine is not closed");
        File { name, text, routines }
    }

    /// Returns every statement of the file, also of a data list.
    pub fn statements(&self) -> Vec<Statement> {
        self.text.lines().enumerate().filter_map(|(index, text)| statement(index + 1, text)).collect()
    }
}

/// Returns all KRL files, sorted by name.
pub fn files() -> Vec<File> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder())
        .expect("the folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "src" || extension == "dat"))
        .collect();
    paths.sort();
    paths.iter().map(|path| File::read(path)).collect()
}

/// Returns the declarations of the data lists: each name with its initial value as written; arrays by element, such as
/// `CELL_IN[1]`.
pub fn data(files: &[File]) -> BTreeMap<String, String> {
    let mut data = BTreeMap::new();
    for statement in files.iter().filter(|file| file.name.ends_with(".dat")).flat_map(File::statements) {
        let code = statement.code.as_str();
        if let Some(declared) = code.strip_prefix("DECL GLOBAL ") {
            let declared = declared.strip_prefix("CONST ").unwrap_or(declared);
            let (_, rest) = declared.split_once(' ').expect("a type and a name");
            let (name, value) = rest.split_once('=').unwrap_or((rest, ""));
            let name = name.split('[').next().unwrap_or_default();
            assert!(data.insert(name.to_owned(), value.to_owned()).is_none(), "{name} is declared twice");
        } else if let Some((name, value)) = code.split_once('=') {
            data.insert(name.to_owned(), value.to_owned());
        }
    }
    data
}
