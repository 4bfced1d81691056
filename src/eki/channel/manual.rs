//! The manual's elements and attributes, with their allowed content (`eki.md` 1.2 to 1.4).

use super::findings::Findings;
use super::kinds::{Environment, Kind, Peer, Protocol, ReadOrder};
use super::tree::Node;
use crate::config::Problem;
use std::collections::BTreeSet;
use strum::VariantNames;

/// The allowed content of an attribute, or between the tags of an element.
enum Rule {
    Words(&'static [&'static str]),
    Number(u32, u32),
    /// Any text, since placeholders for addresses are common; `stated` reads tags.
    Free,
    /// Character codes such as `13,10`, alternatives separated by `|`.
    Codes,
}

struct Known {
    path: &'static str,
    attributes: &'static [(&'static str, Rule)],
    text: Option<Rule>,
    /// The element may occur only once in its parent.
    once: bool,
}

const fn section(path: &'static str) -> Known {
    Known { path, attributes: &[], text: None, once: true }
}

const fn text(path: &'static str, rule: Rule) -> Known {
    Known { path, attributes: &[], text: Some(rule), once: true }
}

const fn filled(path: &'static str, attributes: &'static [(&'static str, Rule)]) -> Known {
    Known { path, attributes, text: None, once: true }
}

const fn element(path: &'static str, attributes: &'static [(&'static str, Rule)]) -> Known {
    Known { path, attributes, text: None, once: false }
}

/// The ranges of `$FLAG` and `$OUT` numbers by the manual.
const FLAG: Rule = Rule::Number(1, 1025);
const OUT: Rule = Rule::Number(1, 4096);
const ORDER: Rule = Rule::Words(ReadOrder::VARIANTS);
const KINDS: Rule = Rule::Words(Kind::VARIANTS);

const KNOWN: [Known; 24] = [
    section("CONFIGURATION"),
    section("CONFIGURATION/EXTERNAL"),
    text("CONFIGURATION/EXTERNAL/TYPE", Rule::Words(Peer::VARIANTS)),
    text("CONFIGURATION/EXTERNAL/IP", Rule::Free),
    text("CONFIGURATION/EXTERNAL/PORT", Rule::Number(1, 65_534)),
    section("CONFIGURATION/INTERNAL"),
    text("CONFIGURATION/INTERNAL/ENVIRONMENT", Rule::Words(Environment::VARIANTS)),
    filled("CONFIGURATION/INTERNAL/BUFFERING", &[("Mode", ORDER), ("Limit", Rule::Number(1, 512))]),
    filled("CONFIGURATION/INTERNAL/BUFFSIZE", &[("Limit", Rule::Number(1, 65_534))]),
    filled("CONFIGURATION/INTERNAL/TIMEOUT", &[("Connect", Rule::Number(0, 65_534))]),
    filled(
        "CONFIGURATION/INTERNAL/ALIVE",
        &[("Set_Flag", FLAG), ("Set_Out", OUT), ("Ping", Rule::Number(1, 65_534))],
    ),
    text("CONFIGURATION/INTERNAL/IP", Rule::Free),
    text("CONFIGURATION/INTERNAL/PORT", Rule::Number(1, 65_534)),
    text("CONFIGURATION/INTERNAL/PROTOCOL", Rule::Words(Protocol::VARIANTS)),
    filled(
        "CONFIGURATION/INTERNAL/MESSAGES",
        &[
            ("Logging", Rule::Words(&["error", "warning", "disabled"])),
            ("Display", Rule::Words(&["error", "disabled"])),
        ],
    ),
    section("RECEIVE"),
    section("RECEIVE/XML"),
    element(
        "RECEIVE/XML/ELEMENT",
        &[("Tag", Rule::Free), ("Type", KINDS), ("Set_Flag", FLAG), ("Set_Out", OUT), ("Mode", ORDER)],
    ),
    section("RECEIVE/RAW"),
    element(
        "RECEIVE/RAW/ELEMENT",
        &[
            ("Tag", Rule::Free),
            ("Type", Rule::Words(&["BYTE", "STREAM"])),
            ("Set_Flag", FLAG),
            ("Set_Out", OUT),
            ("Size", Rule::Number(1, 3600)),
            ("EOS", Rule::Codes),
        ],
    ),
    section("SEND"),
    section("SEND/XML"),
    element("SEND/XML/ELEMENT", &[("Tag", Rule::Free), ("Type", KINDS)]),
    section(""),
];

/// Checks whether the root is the root element of the classic dialect.
pub(super) fn is_classic(root: &Node) -> Result<(), Problem> {
    let found = &root.name;
    let message = if found.eq_ignore_ascii_case("ETHERNETKRL") {
        return Ok(());
    } else if found == "Channel" && root.attribute("Version").is_some() {
        "the file is a channel of EthernetKRL 6 (iiQKA.OS2); KSS 8 reads only files with the root element ETHERNETKRL"
            .to_owned()
    } else {
        format!("the root element is {found}; the root element of an EthernetKRL file is ETHERNETKRL")
    };
    Err(Problem { line: root.line, key: found.clone(), message })
}

/// Compares every element and attribute with the manual.
pub(super) fn check(root: &Node, found: &mut Findings) {
    let mut told = BTreeSet::new();
    spelling(root.line, &root.name, &root.name, "ETHERNETKRL", &mut told, found);
    node(root, &mut told, found);
}

fn node(node: &Node, told: &mut BTreeSet<String>, found: &mut Findings) {
    let Some(known) = KNOWN.iter().find(|known| known.path == node.path) else {
        return unknown(node, found);
    };
    if let Some(name) = known.path.rsplit('/').next().filter(|name| !name.is_empty()) {
        spelling(node.line, &node.path, &node.name, name, told, found);
    }
    attributes(node, known, told, found);
    match &known.text {
        Some(rule) if node.text.is_empty() => {
            found.wrong(node.line, node.key(), format!("is empty; valid: {}", allowed(rule)));
        }
        Some(rule) => value(node.text_line, &node.path, &node.text, rule, found),
        None if node.text.is_empty() => {}
        None => found.unknown(
            node.text_line,
            node.key(),
            format!("the text \"{}\" is not valid here; write a comment as <!-- … -->", node.text),
        ),
    }
    let mut seen = BTreeSet::new();
    for child in &node.children {
        let once = KNOWN.iter().any(|known| known.path == child.path && known.once);
        if once && !seen.insert(&child.path) {
            found.wrong(
                child.line,
                child.key(),
                "appears twice; it is not known which of the two elements the controller uses",
            );
        }
        self::node(child, told, found);
    }
}

fn attributes(node: &Node, known: &Known, told: &mut BTreeSet<String>, found: &mut Findings) {
    let mut seen = BTreeSet::new();
    for attribute in &node.attributes {
        let key = format!("{}/@{}", node.key(), attribute.name);
        if !seen.insert(attribute.name.to_ascii_uppercase()) {
            found.wrong(attribute.line, &key, "appears twice in one element");
            continue;
        }
        let right = known.attributes.iter().find(|(name, _)| name.eq_ignore_ascii_case(&attribute.name));
        if let Some((name, rule)) = right {
            spelling(attribute.line, &key, &attribute.name, name, told, found);
            value(attribute.line, &key, &attribute.value, rule, found);
        } else {
            let names: Vec<&str> = known.attributes.iter().map(|(name, _)| *name).collect();
            let meant = meant(&attribute.name, &names);
            found.unknown(
                attribute.line,
                key,
                format!("no manual describes this attribute{meant}; the controller ignores it"),
            );
        }
    }
}

fn unknown(node: &Node, found: &mut Findings) {
    let parent = node.path.rsplit_once('/').map_or("", |(parent, _)| parent);
    let inside = |known: &&Known| known.path.rsplit_once('/').map_or("", |(parent, _)| parent) == parent;
    let here = KNOWN.iter().filter(|known| !known.path.is_empty()).filter(inside);
    let names: Vec<&str> = here.filter_map(|known| known.path.rsplit('/').next()).collect();
    let elsewhere = KNOWN.iter().find(|known| {
        let name = known.path.rsplit('/').next().unwrap_or_default();
        !name.is_empty() && name.eq_ignore_ascii_case(&node.name)
    });
    let meant = match (meant(&node.name, &names), elsewhere) {
        (meant, _) if meant.contains("mean") => meant,
        (_, Some(known)) => format!("; its place is {}", known.path),
        (meant, None) => meant,
    };
    found.unknown(
        node.line,
        node.key(),
        format!("no manual describes this element here{meant}; the controller ignores it"),
    );
}

/// Returns the most similar valid name, or all of them.
fn meant(written: &str, known: &[&str]) -> String {
    let closeness = |name: &str| strsim::jaro_winkler(&written.to_uppercase(), &name.to_uppercase());
    let nearest = known.iter().max_by(|a, b| closeness(a).total_cmp(&closeness(b)));
    match nearest {
        Some(name) if closeness(name) > 0.8 => format!("; did you mean {name}?"),
        Some(_) => format!("; valid here: {}", known.join(", ")),
        None => "; no name is valid here".to_owned(),
    }
}

fn spelling(line: usize, key: &str, written: &str, right: &str, told: &mut BTreeSet<String>, found: &mut Findings) {
    if written != right && told.insert(written.to_owned()) {
        let message = format!(
            "found {written}, but the manual writes {right}; it is not known whether the controller accepts this \
             spelling"
        );
        found.warn(line, key, message);
    }
}

fn allowed(rule: &Rule) -> String {
    match rule {
        Rule::Words(words) => format!("one of {}", words.join(", ")),
        Rule::Number(low, high) => format!("a whole number {low} to {high}"),
        Rule::Free => "a value".to_owned(),
        Rule::Codes => {
            "1 to 32 character codes from 0 to 255, such as 13,10, with | between alternatives".to_owned()
        }
    }
}

fn value(line: usize, key: &str, value: &str, rule: &Rule, found: &mut Findings) {
    let right = match rule {
        Rule::Words(words) => words.iter().any(|word| word.eq_ignore_ascii_case(value)),
        Rule::Number(low, high) => value.parse().is_ok_and(|number: u32| (*low..=*high).contains(&number)),
        Rule::Free => true,
        Rule::Codes => value.split('|').all(|codes| {
            let codes: Vec<&str> = codes.split(',').collect();
            codes.len() <= 32 && codes.iter().all(|code| code.trim().parse::<u8>().is_ok())
        }),
    };
    if !right {
        let is_axis = matches!(rule, Rule::Words(_)) && value.eq_ignore_ascii_case("AXIS");
        let hint = if is_axis { "; send axes as six REAL attributes or in a FRAME" } else { "" };
        found.wrong(line, key, format!("is \"{value}\"; valid: {}{hint}", allowed(rule)));
    }
}
