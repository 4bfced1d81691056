//! `panelprep explain`: the meaning of a message's code and the remedy, as in the manual's page of messages.

use super::args::Explain;
use super::fault::Fault;
use super::outcome::Outcome;
use panelprep_base::config::nearest;
use panelprep_store::history::{code, codes, row};
use serde_json::json;

/// Explains the code; without one, lists all codes.
///
/// # Errors
/// If no message has this code.
pub fn run(args: &Explain) -> Result<Outcome, Fault> {
    let mut outcome = Outcome { exit_code: 0, json: serde_json::Map::new(), lines: vec![] };
    let Some(word) = &args.code else {
        let words: Vec<&str> = codes().iter().map(|code| &*code.code).collect();
        outcome.add_line(words.join("\n"));
        outcome.add_value("codes", json!(words));
        return Ok(outcome);
    };
    let word = word.trim_matches(['(', ')', '`']);
    let Some(known) = code(word) else {
        let words: Vec<&str> = codes().iter().map(|code| &*code.code).collect();
        let nearest = nearest(word, &words).map(|(name, _)| name.to_owned());
        return Err(Fault::NoSuchCode { found: word.to_owned(), nearest });
    };
    let (cause, remedy) =
        row(word, &args.language).map_or((&*known.cause, &*known.remedy), |row| (row.cause, row.remedy));
    outcome.add_line(cause);
    outcome.add_line(if args.language == "en" { format!("What to do: {remedy}") } else { remedy.to_owned() });
    outcome.add_value("code", json!(known.code));
    outcome.add_value("priority", json!(known.priority));
    outcome.add_value("meaning", json!(cause));
    outcome.add_value("remedy", json!(remedy));
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_explained_and_a_mistyped_one_is_answered_with_the_nearest() {
        let asked_in = |code: &str, language: &str| {
            run(&Explain { code: Some(code.to_owned()), language: language.to_owned() })
        };
        let asked = |code: &str| asked_in(code, "en");
        let words = asked("(low_overlap)").expect("a row").lines.join("\n");
        assert!(words.contains("overlap") && words.contains("What to do: "), "{words}");
        let fault = asked("low_overlapp").expect_err("no such code").to_string();
        assert!(fault.contains("did you mean low_overlap?"), "{fault}");
        let german = asked_in("low_overlap", "de").expect("a row").lines.join("\n");
        assert!(german.contains("min_overlap") && german != words, "{german}");
        assert!(
            run(&Explain { code: None, language: "en".to_owned() }).expect("a list").lines[0].lines().count() > 150
        );
    }
}
