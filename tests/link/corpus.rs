//! The hostile corpus: every line of `fixtures/eki/hostile.txt` is applied to each field to which it refers, and must
//! get exactly the verdict that it states.

use super::cell::wire;
use panelprep::eki::Framer;

const TABLE: &str = include_str!("../../fixtures/eki/hostile.txt");

/// A field of the table.
struct Field<'a> {
    tag: &'a str,
    is_int: bool,
    low: f64,
    high: f64,
}

impl<'a> Field<'a> {
    fn read(words: &[&'a str]) -> Self {
        let [tag, kind, low, high] = *words else { panic!("{words:?}") };
        let number = |text: &str| text.parse().expect("a number");
        Field { tag, is_int: kind == "int", low: number(low), high: number(high) }
    }

    /// Returns the path of the field's element, and the name of the field.
    fn parts(&self) -> (&'a str, &'a str) {
        self.tag.split_once("/@").expect("an attribute")
    }

    /// Returns the byte range of the field's value in the document.
    fn value_range(&self, document: &str) -> std::ops::Range<usize> {
        let (path, name) = self.parts();
        let element = format!("<{} ", path.rsplit('/').next().expect("a name"));
        let element = document.find(&element).expect("the element");
        let start =
            element + document[element..].find(&format!(" {name}=\"")).expect("the attribute") + name.len() + 3;
        start..start + document[start..].find('"').expect("quoted")
    }

    /// Returns a number in the format of this field.
    fn formatted_number(&self, value: f64) -> String {
        if self.is_int { format!("{value:.0}") } else { format!("{value:.6}") }
    }

    fn verdict(&self, template: &str, at: usize) -> String {
        let (path, name) = self.parts();
        let step = if self.is_int { 1.0 } else { 0.5 };
        let values = [
            ("{f}", self.tag.to_owned()),
            ("{p}", path.to_owned()),
            ("{n}", name.to_owned()),
            ("{at}", at.to_string()),
            ("{low}", self.low.to_string()),
            ("{high}", self.high.to_string()),
            ("{below}", (self.low - step).to_string()),
            ("{above}", (self.high + step).to_string()),
        ];
        values.iter().fold(template.to_owned(), |text, (name, value)| text.replace(name, value))
    }

    /// Returns the document with this edit.
    fn edited(&self, document: &str, edit: &str) -> String {
        let place = self.value_range(document);
        let (_, name) = self.parts();
        let whole = place.start - name.len() - 3..place.end + 1;
        let (step, mut text) = (if self.is_int { 1.0 } else { 0.5 }, document.to_owned());
        match edit {
            "below" => text.replace_range(place, &self.formatted_number(self.low - step)),
            "above" => text.replace_range(place, &self.formatted_number(self.high + step)),
            "missing" => text.replace_range(whole, ""),
            "twice" => text.insert_str(whole.end, &document[whole]),
            "empty" => text.replace_range(place, ""),
            "renamed" => text.insert(whole.start + 1, 'Q'),
            other => panic!("no such edit: {other}"),
        }
        text
    }
}

/// Replaces `\n`, `\r` and `\xNN` by the bytes that they represent.
fn unescape(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = text;
    while let Some(at) = rest.find('\\') {
        bytes.extend_from_slice(&rest.as_bytes()[..at]);
        let (byte, length) = match rest.as_bytes()[at + 1] {
            b'n' => (b'\n', 2),
            b'r' => (b'\r', 2),
            _ => (u8::from_str_radix(&rest[at + 2..at + 4], 16).expect("two digits"), 4),
        };
        bytes.push(byte);
        rest = &rest[at + length..];
    }
    bytes.extend_from_slice(rest.as_bytes());
    bytes
}

/// Returns the verdict on a stream: the number of valid documents, then the first error.
fn verdict(stream: &[u8]) -> String {
    let (mut framer, wire, mut good) = (Framer::default(), wire(), 0);
    framer.push(stream);
    let error = loop {
        match framer.next_document() {
            Ok(None) => break None,
            Err(error) => break Some(error.to_string()),
            Ok(Some(document)) => {
                let read = if document.starts_with("<St") || document.contains("St ") {
                    wire.decode_state(&document).map(drop)
                } else {
                    wire.decode_ack(&document).map(drop)
                };
                if let Err(error) = read {
                    break Some(error.to_string());
                }
                good += 1;
            }
        }
    };
    match (good, error) {
        (0, Some(error)) => error,
        (good, Some(error)) => format!("ok {good}, then {error}"),
        (good, None) => format!("ok {good}"),
    }
}

/// Returns every message and its required verdict.
fn corpus() -> Vec<(Vec<u8>, String)> {
    let lines = || TABLE.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    let after = |start: &'static str| lines().filter_map(move |line| line.strip_prefix(start));
    let (ack, state) = (after("ack ").next().expect("one"), after("state ").next().expect("one"));
    let is_field = |rest: &&str| rest.starts_with("Ack/") || rest.starts_with("St/");
    let fields: Vec<Field> =
        after("field ").filter(is_field).map(|rest| Field::read(&rest.split(' ').collect::<Vec<_>>())).collect();
    assert_eq!(fields.len(), 43, "6 of the acknowledgement, 37 of the state");
    let document = |field: &Field| if field.tag.starts_with("Ack") { ack } else { state };
    let split = |rest: &'static str| rest.split_once(" => ").expect("an arrow");

    let mut corpus = Vec::new();
    for (start, of_int) in [("int ", true), ("real ", false)] {
        for (value, template) in after(start).map(split) {
            let value = unescape(value.trim_matches('"'));
            for field in fields.iter().filter(|field| field.is_int == of_int) {
                let (text, place) = (document(field), field.value_range(document(field)));
                let bytes = [&text.as_bytes()[..place.start], &value, &text.as_bytes()[place.end..]].concat();
                corpus.push((bytes, field.verdict(template, place.start)));
            }
        }
    }
    for (edit, template) in after("field ").filter(|rest| !is_field(rest)).map(split) {
        for field in &fields {
            let text = field.edited(document(field), edit);
            corpus.push((text.into_bytes(), field.verdict(template, 0)));
        }
    }
    for (start, text) in [("in ack ", ack), ("in state ", state)] {
        for rest in after(start) {
            let (from, rest) = split(rest);
            let (to, expected) = split(rest);
            assert!(text.contains(from), "{from}");
            corpus.push((text.replacen(from, to, 1).into_bytes(), expected.to_owned()));
        }
    }
    for (stream, expected) in after("stream ").map(split) {
        let written = stream.replace("{ack}", ack).replace("{state}", state);
        corpus.push((unescape(&written), expected.to_owned()));
    }
    corpus
}

#[test]
fn every_hostile_message_gets_its_verdict() {
    let corpus = corpus();
    assert!(corpus.len() >= 500, "{} messages", corpus.len());
    let wrong: Vec<String> = corpus
        .iter()
        .filter(|(message, expected)| verdict(message) != *expected)
        .map(|(message, expected)| {
            let text = String::from_utf8_lossy(message);
            format!("{text}\n  said:     {}\n  expected: {expected}\n", verdict(message))
        })
        .collect();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), corpus.len(), wrong[..wrong.len().min(20)].join("\n"));
}
