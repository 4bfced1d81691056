//! `panelprep explain`: what a message's code means and what to do, as the manual's page of messages has it.

use super::args::Explain;
use super::fault::Fault;
use super::outcome::Outcome;
use crate::config::nearest;
use serde_json::json;

const PAGE: &str = include_str!("../../config/manual/messages.md");

/// A row of the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Row {
    code: &'static str,
    meaning: &'static str,
    remedy: &'static str,
}

fn rows() -> impl Iterator<Item = Row> {
    let of = |line: &'static str| {
        let mut cells = line.strip_prefix("| `")?.strip_suffix('|')?.split('|').map(str::trim);
        let (code, meaning, remedy) = (cells.next()?.trim_end_matches('`'), cells.next()?, cells.next()?);
        Some(Row { code, meaning, remedy })
    };
    PAGE.lines().filter_map(of)
}

/// Tells what the code means; without one, lists all of them.
///
/// # Errors
/// Where no message has this code.
pub fn run(args: &Explain) -> Result<Outcome, Fault> {
    let mut outcome = Outcome { exit: 0, json: serde_json::Map::new(), words: vec![] };
    let Some(code) = &args.code else {
        let codes: Vec<&str> = rows().map(|row| row.code).collect();
        outcome.say(codes.join("\n"));
        outcome.put("codes", json!(codes));
        return Ok(outcome);
    };
    let code = code.trim_matches(['(', ')', '`']);
    let Some(row) = rows().find(|row| row.code == code) else {
        let nearest =
            nearest(code, &rows().map(|row| row.code).collect::<Vec<_>>()).map(|(name, _)| name.to_owned());
        return Err(Fault::NoSuchCode { found: code.to_owned(), nearest });
    };
    outcome.say(row.meaning);
    outcome.say(format!("What to do: {}", row.remedy));
    outcome.put("code", json!(row.code));
    outcome.put("meaning", json!(row.meaning));
    outcome.put("remedy", json!(row.remedy));
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_explained_and_a_mistyped_one_is_answered_with_the_nearest() {
        let asked = |code: &str| run(&Explain { code: Some(code.to_owned()) });
        let words = asked("(low_overlap)").expect("a row").words.join("\n");
        assert!(words.contains("overlap") && words.contains("What to do: "), "{words}");
        let fault = asked("low_overlapp").expect_err("no such code").to_string();
        assert!(fault.contains("did you mean low_overlap?"), "{fault}");
        assert!(run(&Explain { code: None }).expect("a list").words[0].lines().count() > 150);
    }
}
