//! Asks questions on the terminal, and writes the answers to the text of a sample.
//!
//! Each question can also be answered by an option, and may have a proposed answer. An answer is written to the text of
//! the sample and checked there.

use super::super::fault::Fault;
use super::super::output::write_progress;
use panelprep_base::config::{Problem, set_value};
use panelprep_base::number_text::shortest_text;
use std::io::BufRead;
use std::ops::RangeInclusive;
use toml_edit::{DocumentMut, Value};

/// Asks the questions.
pub(super) struct Asker<'i> {
    /// Whether proposed answers are accepted without asking.
    are_proposals_accepted: bool,
    answers: Box<dyn BufRead + 'i>,
}

/// A question.
pub(super) struct Question<'q> {
    text: &'q str,
    option: &'static str,
    given_answer: Option<String>,
    proposal: Option<String>,
}

impl<'q> Question<'q> {
    /// Creates a question, with the option that answers it and the value of this option, if given.
    pub fn new(words: &'q str, option: &'static str, given: Option<&str>) -> Self {
        Question { text: words, option, given_answer: given.map(str::to_owned), proposal: None }
    }

    /// Adds a proposed answer.
    pub fn with_proposal(self, proposal: impl Into<String>) -> Self {
        Question { proposal: Some(proposal.into()), ..self }
    }
}

impl Asker<'static> {
    /// Creates an asker that prints questions on standard error and reads answers from standard input.
    pub fn for_terminal(takes_proposals: bool) -> Self {
        Asker { are_proposals_accepted: takes_proposals, answers: Box::new(std::io::stdin().lock()) }
    }
}

impl Asker<'_> {
    /// Returns the answer as parsed by `read`; if `read` refuses the answer, the question is asked again.
    fn ask<T>(&mut self, question: &Question<'_>, read: impl Fn(&str) -> Result<T, String>) -> Result<T, Fault> {
        let option = question.option;
        let refused = |found: &str, problem| Fault::BadAnswer { option, found: found.to_owned(), problem };
        if let Some(given) = &question.given_answer {
            return read(given).map_err(|problem| refused(given, problem));
        }
        let no_answer = || {
            let is_proposed = question.proposal.is_some();
            Fault::NoAnswer { question: question.text.to_owned(), option, is_proposed }
        };
        if self.are_proposals_accepted {
            let proposal = question.proposal.as_deref().ok_or_else(no_answer)?;
            return read(proposal).map_err(|problem| refused(proposal, problem));
        }
        let proposed = question.proposal.as_ref().map_or(String::new(), |proposal| format!(" [{proposal}]"));
        loop {
            write_progress(&format!("{}{proposed}", question.text));
            let mut line = String::new();
            let count = self
                .answers
                .read_line(&mut line)
                .map_err(|error| Fault::file_fault("standard input".as_ref(), error))?;
            if count == 0 {
                return Err(no_answer());
            }
            let answer = match line.trim() {
                "" => question.proposal.as_deref().unwrap_or_default(),
                answer => answer,
            };
            match read(answer) {
                Ok(answer) => return Ok(answer),
                Err(problem) => write_progress(&format!("\"{answer}\": {problem}")),
            }
        }
    }
}

/// The result of checking an answer; the error states the problem and what is valid.
pub(super) type Refusal = Result<(), String>;

impl Asker<'_> {
    /// Asks for a text that `check` accepts.
    pub fn ask_text(
        &mut self,
        question: &Question<'_>,
        check: impl Fn(&String) -> Refusal,
    ) -> Result<String, Fault> {
        self.ask(question, |answer| check_answer(parse_text(answer)?, &check))
    }

    /// Asks for one of the valid values, which `check` must accept.
    pub fn ask_choice<T: Copy>(
        &mut self,
        question: &Question<'_>,
        allowed: &[(&str, T)],
        check: impl Fn(&T) -> Refusal,
    ) -> Result<T, Fault> {
        self.ask(question, |answer| check_answer(parse_choice(answer, allowed)?, &check))
    }

    /// Asks for a whole number in this range.
    pub fn count(&mut self, question: &Question<'_>, range: RangeInclusive<u32>) -> Result<f64, Fault> {
        self.ask(question, |answer| {
            let count = answer.trim().parse::<u32>().ok().filter(|count| range.contains(count));
            let allowed = || format!("valid: a whole number from {} to {}", range.start(), range.end());
            count.map(f64::from).ok_or_else(allowed)
        })
    }

    /// Asks for `N` numbers, separated by commas or spaces, which `check` must accept.
    pub fn numbers<const N: usize>(
        &mut self,
        question: &Question<'_>,
        check: impl Fn(&[f64; N]) -> Refusal,
    ) -> Result<[f64; N], Fault> {
        self.ask(question, |answer| check_answer(numbers(answer)?, &check))
    }

    /// Asks for both corners of a box that `check` accepts. If the box is refused, both corners are asked again,
    /// because the error may be in either corner.
    pub fn box_mm(
        &mut self,
        [least, greatest]: [Question<'_>; 2],
        check: impl Fn(&BoxMm) -> Refusal,
    ) -> Result<BoxMm, Fault> {
        loop {
            let corners = [self.numbers(&least, accept_any)?, self.numbers(&greatest, accept_any)?];
            let Err(problem) = check(&corners) else { return Ok(corners) };
            let is_asked =
                |question: &Question<'_>| question.given_answer.is_none() && !self.are_proposals_accepted;
            if !is_asked(&least) && !is_asked(&greatest) {
                let found = corners[1].map(shortest_text).join(",");
                return Err(Fault::BadAnswer { option: greatest.option, found, problem });
            }
            write_progress(&problem);
        }
    }
}

/// A box, given by its minimum and its maximum corner, mm in the robot's base.
pub(super) type BoxMm = [[f64; 3]; 2];

/// Accepts every answer.
pub(super) fn accept_any<T>(_: &T) -> Refusal {
    Ok(())
}

fn check_answer<T>(answer: T, check: impl Fn(&T) -> Refusal) -> Result<T, String> {
    check(&answer)?;
    Ok(answer)
}

fn parse_text(answer: &str) -> Result<String, String> {
    match answer.trim() {
        "" => Err("an answer is needed".to_owned()),
        answer if answer.chars().any(char::is_control) => Err("valid: printable characters".to_owned()),
        answer => Ok(answer.to_owned()),
    }
}

fn parse_choice<T: Copy>(answer: &str, allowed: &[(&str, T)]) -> Result<T, String> {
    let found = allowed.iter().find(|(word, _)| *word == answer).map(|(_, value)| *value);
    let names: Vec<&str> = allowed.iter().map(|(word, _)| *word).collect();
    found.ok_or_else(|| format!("valid: {}", names.join(" or ")))
}

fn numbers<const N: usize>(answer: &str) -> Result<[f64; N], String> {
    let parts = answer.split([',', ' ']).filter(|part| !part.is_empty());
    let numbers: Option<Vec<f64>> =
        parts.map(|part| part.parse().ok().filter(|number: &f64| number.is_finite())).collect();
    let allowed = || match N {
        1 => "valid: a number".to_owned(),
        _ => format!("valid: {N} numbers, separated by commas or spaces"),
    };
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(allowed)
}

/// Sets a value in an existing table of a TOML document; the comment next to the value is kept.
pub(super) fn set(document: &mut DocumentMut, table: &str, key: &str, value: impl Into<Value>) {
    let mut below = table.split('.').filter(|name| !name.is_empty());
    let home = below.try_fold(document.as_table_mut(), |home, name| home.get_mut(name)?.as_table_mut());
    if let Some(home) = home {
        set_value(home, key, value);
    }
}

/// Returns the first problem at a key that begins with `keys`, as an error.
pub(super) fn refusal(problems: Vec<Problem>, keys: &str) -> Refusal {
    let first = problems.into_iter().find(|problem| problem.key.starts_with(keys));
    first.map_or(Ok(()), |Problem { key, message, .. }| Err(format!("{key}: {message}")))
}

/// Formats numbers as a person types them.
pub(super) fn format_numbers(numbers: &[f64]) -> String {
    numbers.iter().copied().map(shortest_text).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asker(answers: &'static str, takes_proposals: bool) -> Asker<'static> {
        Asker { are_proposals_accepted: takes_proposals, answers: Box::new(answers.as_bytes()) }
    }

    fn question(given: Option<&str>, proposal: Option<&str>) -> Question<'static> {
        let question = Question::new("how many rows", "--rows", given);
        match proposal {
            Some(proposal) => question.with_proposal(proposal),
            None => question,
        }
    }

    /// The value of the option has priority over the typed text. An empty line accepts the proposal. After an invalid
    /// answer the question is asked again.
    #[test]
    fn an_answer_comes_from_the_option_the_terminal_or_the_proposal() {
        let of = |mut asker: Asker<'_>, question: &Question<'_>| {
            asker.numbers::<1>(question, accept_any).map(|[rows]| rows)
        };
        assert_eq!(of(asker("5\n", false), &question(Some("3"), Some("4"))).expect("given"), 3.0);
        assert_eq!(of(asker("5\n", false), &question(None, Some("4"))).expect("typed"), 5.0);
        assert_eq!(of(asker("\n", false), &question(None, Some("4"))).expect("proposed"), 4.0);
        assert_eq!(of(asker("many\n\n6\n", false), &question(None, None)).expect("the third"), 6.0);
        assert_eq!(of(asker("5\n", true), &question(None, Some("4"))).expect("taken"), 4.0);
        for (asker, question, words) in [
            (asker("", false), question(None, Some("4")), "how many rows has no answer: give --rows"),
            (asker("", false), question(None, Some("4")), "--rows, or --yes to accept"),
            (asker("", true), question(None, None), "how many rows has no answer: give --rows"),
            (asker("5\n", false), question(Some("x"), None), "--rows \"x\": valid: a number"),
        ] {
            let message = of(asker, &question).expect_err("refused").to_string();
            assert!(message.contains(words), "{message}");
        }
        // If there is no proposal, --yes does not answer the question.
        let message = of(asker("", true), &question(None, None)).expect_err("refused").to_string();
        assert!(message.ends_with("give --rows"), "{message}");
        // A count is checked against its range immediately, before the file is created.
        let of = |given| asker("", true).count(&question(Some(given), None), 1..=50);
        assert_eq!(of("50").expect("allowed"), 50.0);
        for wrong in ["0", "51", "2.5", "many"] {
            let message = of(wrong).expect_err("refused").to_string();
            assert!(
                message.contains(&format!("--rows \"{wrong}\": valid: a whole number from 1 to 50")),
                "{message}"
            );
        }
    }

    /// If a box is refused, both corners are asked again. A corner that an option states is not asked again: if its box
    /// is refused, the error names the option.
    #[test]
    fn both_corners_of_a_refused_box_are_asked_again() {
        let corners = |given: [Option<&str>; 2]| {
            let least = Question::new("least", "--min", given[0]).with_proposal("0,0,0");
            [least, Question::new("greatest", "--max", given[1]).with_proposal("9,9,9")]
        };
        let check = |[least, greatest]: &BoxMm| match least[0] < greatest[0] {
            true => Ok(()),
            false => Err("no box".to_owned()),
        };
        let of = |mut asker: Asker<'_>, given| asker.box_mm(corners(given), check);
        assert_eq!(
            of(asker("7,0,0\n5,1,1\n1,0,0\n\n", false), [None; 2]).expect("the second"),
            [[1.0, 0.0, 0.0], [9.0; 3]]
        );
        let given = [Some("7,0,0"), None];
        assert_eq!(
            of(asker("5,1,1\n8,1,1\n", false), given).expect("the second"),
            [[7.0, 0.0, 0.0], [8.0, 1.0, 1.0]]
        );
        let told = of(asker("", true), [Some("9,0,0"), None]).expect_err("refused").to_string();
        assert_eq!(told, "--max \"9,9,9\": no box");
    }

    #[test]
    fn only_the_requested_number_of_values_is_accepted() {
        assert_eq!(numbers::<3>("1, -2.5 3"), Ok([1.0, -2.5, 3.0]));
        for wrong in ["1,2", "1,2,3,4", "1,2,NaN", "1,2,x"] {
            assert_eq!(numbers::<3>(wrong), Err("valid: 3 numbers, separated by commas or spaces".to_owned()));
        }
    }
}
