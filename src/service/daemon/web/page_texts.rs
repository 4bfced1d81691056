//! The texts of the page: one translation table with a column for each language. A further language is a further column
//! and needs no code.
//!
//! Messages of the program are English sentences with their values, each with a code. The table also contains the
//! meaning of each code and the remedy (`message.CODE.cause`, `message.CODE.remedy`), from the message pages of the
//! manual. `short.CODE` is the one line that a person at the cell reads first. An additional table may omit these keys;
//! the English texts are then used.

use panelprep_store::history::{codes, row};
use std::collections::BTreeMap;

/// The translation table that is part of the program: English and German.
const TABLE: &str = include_str!("words.csv");
/// The translation tables that other parts of the program add for their pages.
const ADDITIONAL_TABLES: [&str; 2] =
    [panelprep_interfaces::page::drawing::canvas::TRANSLATION_TABLE, include_str!("short.csv")];

/// Prefix of the keys of messages.
const MESSAGE_PREFIX: &str = "message.";
/// Prefix of the keys of the short lines of codes.
const SHORT_PREFIX: &str = "short.";

/// Error: a translation table cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {problem}")]
pub struct WordsError {
    /// The number of the line in the table, counted from 1.
    pub line: u64,
    /// The problem.
    pub problem: String,
}

/// The texts in all languages.
#[derive(Debug, Clone)]
pub struct Translations {
    languages: Vec<String>,
    table: BTreeMap<String, Vec<String>>,
}

/// The texts of one language.
#[derive(Debug, Clone, Copy)]
pub struct Language<'w> {
    words: &'w Translations,
    column: usize,
}

impl Translations {
    /// Reads the program's own translation table, with the columns of an additional table, if there is one.
    ///
    /// # Errors
    /// If a table is not a valid CSV file, or does not contain a key of the program's own table.
    pub fn read(more: Option<&str>) -> Result<Self, WordsError> {
        let mut words = Self::parse_table(TABLE)?;
        for more in ADDITIONAL_TABLES {
            words.table.extend(Self::parse_table(more)?.table);
        }
        words.table.extend(messages(&words.languages));
        let Some(more) = more else { return Ok(words) };
        let more = Self::parse_table(more)?;
        for (at, language) in more.languages.iter().enumerate() {
            let column = words.languages.iter().position(|known| known == language);
            if column.is_none() {
                words.languages.push(language.clone());
            }
            for (key, row) in &mut words.table {
                let has_default = [MESSAGE_PREFIX, SHORT_PREFIX].iter().any(|beginning| key.starts_with(beginning));
                let own = has_default.then(|| row[column.unwrap_or(0)].clone());
                let Some(word) = more.table.get(key).map(|row| row[at].clone()).or(own) else {
                    return Err(WordsError { line: 1, problem: format!("the key {key} is missing; add it") });
                };
                match column {
                    Some(column) => row[column] = word,
                    None => row.push(word),
                }
            }
        }
        Ok(words)
    }

    fn parse_table(text: &str) -> Result<Self, WordsError> {
        let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
        let at = |error: &csv::Error| error.position().map_or(1, csv::Position::line);
        let failed = |error: csv::Error| WordsError { line: at(&error), problem: error.to_string() };
        let languages = reader.headers().map_err(failed)?.iter().skip(1).map(str::to_owned).collect();
        let mut table = BTreeMap::new();
        for record in reader.records() {
            let record = record.map_err(failed)?;
            let line = record.position().map_or(1, csv::Position::line);
            let mut fields = record.iter().map(str::to_owned);
            let key = fields.next().unwrap_or_default();
            let row: Vec<String> = fields.collect();
            if row.iter().any(|word| word.trim().is_empty()) {
                return Err(WordsError {
                    line,
                    problem: format!(
                        "the key {key} has no text in one of the languages; \
                    add it"
                    ),
                });
            }
            if table.insert(key.clone(), row).is_some() {
                return Err(WordsError {
                    line,
                    problem: format!(
                        "the key {key} appears twice; delete one of the \
                    lines"
                    ),
                });
            }
        }
        Ok(Translations { languages, table })
    }

    /// Returns the languages; the default language is the first.
    pub fn languages(&self) -> &[String] {
        &self.languages
    }

    /// Returns the chosen language, or the first available one among those that a browser prefers (`Accept-Language`),
    /// or the default language.
    pub fn language(&self, chosen: Option<&str>, accepted: Option<&str>) -> Language<'_> {
        let place = |name: &str| self.languages.iter().position(|language| language == name);
        let preferred = || {
            accepted?.split(',').find_map(|part| {
                let name = part.split(';').next().unwrap_or("").trim();
                place(name.split('-').next().unwrap_or(""))
            })
        };
        let column = chosen.and_then(place).or_else(preferred).unwrap_or(0);
        Language { words: self, column }
    }
}

/// Returns the meaning of every code and the remedy, in each language that has a message page in the manual, otherwise
/// in English.
fn messages(languages: &[String]) -> BTreeMap<String, Vec<String>> {
    let mut table = BTreeMap::new();
    for code in codes() {
        let row = |language: &String| row(&code.code, language);
        let cause = |language: &String| row(language).map_or(&*code.cause, |row| row.cause).to_owned();
        let remedy = |language: &String| row(language).map_or(&*code.remedy, |row| row.remedy).to_owned();
        table.insert(format!("{MESSAGE_PREFIX}{}.cause", code.code), languages.iter().map(cause).collect());
        table.insert(format!("{MESSAGE_PREFIX}{}.remedy", code.code), languages.iter().map(remedy).collect());
    }
    table
}

impl<'w> Language<'w> {
    /// Returns the meaning of this code, and its remedy; `None` if the code is not in the manual.
    pub fn message(&self, code: &str) -> Option<(&'w str, &'w str)> {
        let word = |what: &str| {
            let row = self.words.table.get(&format!("{MESSAGE_PREFIX}{code}.{what}"))?;
            row.get(self.column).map(String::as_str)
        };
        Some((word("cause")?, word("remedy")?))
    }

    /// Returns the short line of this code; `None` if it has none.
    pub fn short(&self, code: &str) -> Option<&'w str> {
        self.words.table.get(&format!("{SHORT_PREFIX}{code}"))?.get(self.column).map(String::as_str)
    }

    /// Returns whether the language is English, as the program's sentences are.
    pub fn is_english(&self) -> bool {
        self.name() == "en"
    }

    /// Returns the text for this key; if there is no text, the key itself, so that a test detects this.
    pub fn text(&self, key: &'w str) -> &'w str {
        self.words.table.get(key).and_then(|row| row.get(self.column)).map_or(key, String::as_str)
    }

    /// Returns the name of the language, such as `en`.
    pub fn name(&self) -> &'w str {
        self.words.languages.get(self.column).map_or("en", String::as_str)
    }

    /// Returns every key with this prefix and its text, for a script.
    pub fn texts_with_prefix(&self, beginning: &str) -> BTreeMap<&'w str, &'w str> {
        let words = self.words.table.iter().filter(|(key, _)| key.starts_with(beginning));
        words.filter_map(|(key, row)| Some((key.as_str(), row.get(self.column)?.as_str()))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_store::history::Priority;

    #[test]
    fn a_language_is_a_column() {
        let words = Translations::read(None).expect("the program's own");
        assert_eq!(words.languages(), ["en", "de"]);
        let word = |chosen, accepted| words.language(chosen, accepted).text("action.stop");
        assert_eq!((word(None, None), word(Some("de"), None)), ("Stop", "Stopp"));
        assert_eq!(word(None, Some("fr-CH, de-AT;q=0.9, en;q=0.8")), "Stopp", "the first that there is");
        assert_eq!(word(Some("xx"), Some("*")), "Stop");
        let rows = ADDITIONAL_TABLES.iter().flat_map(|table| table.lines().skip(1));
        let own = TABLE.lines().chain(rows).filter(|line| !line.starts_with('#'));
        let more: String = own
            .map(|line| {
                let key = line.split(',').next().unwrap_or("");
                if key == "key" { "key,fr\n".to_owned() } else { format!("{key},mot de {key}\n") }
            })
            .collect();
        let words = Translations::read(Some(&more)).expect("a further column");
        assert_eq!(words.language(Some("fr"), None).text("action.stop"), "mot de action.stop");
        let message = |name| words.language(Some(name), None).message("low_overlap").expect("a row");
        assert_ne!(message("de"), message("en"));
        assert_eq!(message("fr"), message("en"), "a table without messages has them in English");
        assert!(words.language(Some("de"), None).message("no_such_code").is_none());
        let short = Translations::read(Some("key,fr\naction.stop,Arrêt\n")).expect_err("not whole");
        assert!(short.problem.contains("is missing"), "{short}");
    }

    /// Every code that aborts a cycle, or after which a device may still move, has a short line in each language.
    #[test]
    fn each_urgent_code_has_a_short_line_in_each_language() {
        let words = Translations::read(None).expect("the program's own");
        let short = |language, code: &str| words.language(Some(language), None).short(code);
        for code in codes().iter().filter(|code| code.priority == Priority::High) {
            let lines = ["en", "de"].map(|language| short(language, &code.code).expect(&code.code));
            assert!(lines[0] != lines[1], "{lines:?}");
        }
        for (key, row) in words.table.iter().filter(|(key, _)| key.starts_with(SHORT_PREFIX)) {
            assert!(
                codes().iter().any(|code| key.strip_prefix(SHORT_PREFIX) == Some(&*code.code)),
                "{key} is no code"
            );
            assert!(row.iter().all(|line| line.chars().count() <= 85), "{row:?}");
        }
        assert_eq!(short("de", "guard_open"), Some("Die Schutztür ist offen."));
        assert_eq!(short("en", "no_such_code"), None);
    }

    #[test]
    fn an_incomplete_translation_table_is_refused() {
        let problem = |text: &str| Translations::parse_table(text).expect_err("refused").to_string();
        assert_eq!(problem("key,en\na,b\na,c\n"), "line 3: the key a appears twice; delete one of the lines");
        assert_eq!(problem("key,en,de\na,b,\n"), "line 2: the key a has no text in one of the languages; add it");
        assert!(problem("key,en\na,b,c\n").contains("line: 2"));
    }
}
