//! The manual's elements and attributes with their valid content (`eki.md` 1.2 to 1.4), and the list of problems that
//! are found in a file.
//!
//! Keywords are accepted in upper and lower case, because the manual itself mixes both.

use super::tree::Node;
use panelprep_base::config::Problem;
use std::collections::BTreeSet;
use strum::{Display, EnumString, VariantNames};

/// The role of the other machine, as the file of the controller states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive)]
pub enum PeerRole {
    /// The other machine connects; the controller listens.
    Client,
    /// The other machine listens; the controller connects.
    Server,
}

/// The event on which the controller closes the channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive)]
pub enum Environment {
    /// The channel is closed when the robot program is reset or deselected.
    Program,
    /// The channel is closed when the submit interpreter is cancelled.
    Submit,
    /// The channel is closed only when the controller loads a new I/O configuration.
    System,
}

/// The order in which the values in a tag's buffer are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive, serialize_all = "UPPERCASE")]
pub enum ReadOrder {
    /// The oldest value is read first.
    Fifo,
    /// The newest value is read first.
    Lifo,
}

/// The transport protocol of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive, serialize_all = "UPPERCASE")]
pub enum Protocol {
    /// A stream.
    Tcp,
    /// UDP datagrams; the manual advises against UDP.
    Udp,
}

/// The data type of a tag's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumString, VariantNames)]
#[strum(ascii_case_insensitive, serialize_all = "UPPERCASE")]
pub enum Kind {
    /// Characters.
    #[strum(serialize = "STRING")]
    Text,
    /// A single-precision floating-point number, sent in the format `%f`.
    Real,
    /// A signed 32-bit integer.
    Int,
    /// 0 or 1.
    Bool,
    /// A frame, sent as the six attributes X, Y, Z, A, B and C.
    Frame,
}

/// The errors and warnings of one file, in the order in which they were found.
#[derive(Debug, Default)]
pub struct Findings {
    /// Entries that the controller refuses, or with which the channel cannot work.
    pub problems: Vec<Problem>,
    /// Entries that the controller accepts but that may cause problems, including all entries of `unknown`.
    pub warnings: Vec<Problem>,
    /// Names and texts that the manual does not define.
    pub unknown: Vec<Problem>,
}

impl Findings {
    /// Notes a problem.
    pub fn add_problem(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        self.problems.push(Problem { line, key: key.into(), message: message.into() });
    }

    /// Notes a warning.
    pub fn warn(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        self.warnings.push(Problem { line, key: key.into(), message: message.into() });
    }

    /// Adds a warning for a name or a text that the manual does not define.
    fn unknown(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        let warning = Problem { line, key: key.into(), message: message.into() };
        self.unknown.push(warning.clone());
        self.warnings.push(warning);
    }
}

/// The rule for the value of an attribute, or for the text inside an element.
enum ContentRule {
    Words(&'static [&'static str]),
    Number(u32, u32),
    /// Any text is valid, because addresses are often placeholders. Tags are checked in `stated`.
    Free,
    /// Character codes such as `13,10`; alternatives are separated by `|`.
    Codes,
}

struct KnownElement {
    path: &'static str,
    attributes: &'static [(&'static str, ContentRule)],
    text: Option<ContentRule>,
    /// Whether the element may occur only once in its parent.
    once: bool,
}

const fn section(path: &'static str) -> KnownElement {
    KnownElement { path, attributes: &[], text: None, once: true }
}

const fn text(path: &'static str, rule: ContentRule) -> KnownElement {
    KnownElement { path, attributes: &[], text: Some(rule), once: true }
}

const fn element_with_text(path: &'static str, attributes: &'static [(&'static str, ContentRule)]) -> KnownElement {
    KnownElement { path, attributes, text: None, once: true }
}

const fn element(path: &'static str, attributes: &'static [(&'static str, ContentRule)]) -> KnownElement {
    KnownElement { path, attributes, text: None, once: false }
}

/// The ranges of the numbers of `$FLAG_NUMBER_RULE` and `$OUT` according to the manual.
const FLAG_NUMBER_RULE: ContentRule = ContentRule::Number(1, 1025);
const OUTPUT_NUMBER_RULE: ContentRule = ContentRule::Number(1, 4096);
const READ_ORDER_RULE: ContentRule = ContentRule::Words(ReadOrder::VARIANTS);
const VALUE_TYPE_RULE: ContentRule = ContentRule::Words(Kind::VARIANTS);

const KNOWN_ELEMENTS: [KnownElement; 24] = [
    section("CONFIGURATION"),
    section("CONFIGURATION/EXTERNAL"),
    text("CONFIGURATION/EXTERNAL/TYPE", ContentRule::Words(PeerRole::VARIANTS)),
    text("CONFIGURATION/EXTERNAL/IP", ContentRule::Free),
    text("CONFIGURATION/EXTERNAL/PORT", ContentRule::Number(1, 65_534)),
    section("CONFIGURATION/INTERNAL"),
    text("CONFIGURATION/INTERNAL/ENVIRONMENT", ContentRule::Words(Environment::VARIANTS)),
    element_with_text(
        "CONFIGURATION/INTERNAL/BUFFERING",
        &[("Mode", READ_ORDER_RULE), ("Limit", ContentRule::Number(1, 512))],
    ),
    element_with_text("CONFIGURATION/INTERNAL/BUFFSIZE", &[("Limit", ContentRule::Number(1, 65_534))]),
    element_with_text("CONFIGURATION/INTERNAL/TIMEOUT", &[("Connect", ContentRule::Number(0, 65_534))]),
    element_with_text(
        "CONFIGURATION/INTERNAL/ALIVE",
        &[
            ("Set_Flag", FLAG_NUMBER_RULE),
            ("Set_Out", OUTPUT_NUMBER_RULE),
            ("Ping", ContentRule::Number(1, 65_534)),
        ],
    ),
    text("CONFIGURATION/INTERNAL/IP", ContentRule::Free),
    text("CONFIGURATION/INTERNAL/PORT", ContentRule::Number(1, 65_534)),
    text("CONFIGURATION/INTERNAL/PROTOCOL", ContentRule::Words(Protocol::VARIANTS)),
    element_with_text(
        "CONFIGURATION/INTERNAL/MESSAGES",
        &[
            ("Logging", ContentRule::Words(&["error", "warning", "disabled"])),
            ("Display", ContentRule::Words(&["error", "disabled"])),
        ],
    ),
    section("RECEIVE"),
    section("RECEIVE/XML"),
    element(
        "RECEIVE/XML/ELEMENT",
        &[
            ("Tag", ContentRule::Free),
            ("Type", VALUE_TYPE_RULE),
            ("Set_Flag", FLAG_NUMBER_RULE),
            ("Set_Out", OUTPUT_NUMBER_RULE),
            ("Mode", READ_ORDER_RULE),
        ],
    ),
    section("RECEIVE/RAW"),
    element(
        "RECEIVE/RAW/ELEMENT",
        &[
            ("Tag", ContentRule::Free),
            ("Type", ContentRule::Words(&["BYTE", "STREAM"])),
            ("Set_Flag", FLAG_NUMBER_RULE),
            ("Set_Out", OUTPUT_NUMBER_RULE),
            ("Size", ContentRule::Number(1, 3600)),
            ("EOS", ContentRule::Codes),
        ],
    ),
    section("SEND"),
    section("SEND/XML"),
    element("SEND/XML/ELEMENT", &[("Tag", ContentRule::Free), ("Type", VALUE_TYPE_RULE)]),
    section(""),
];

/// Checks that the root element is that of the classic dialect (KSS 8).
pub(super) fn is_classic_dialect(root: &Node) -> Result<(), Problem> {
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
pub(super) fn check_against_manual(root: &Node, found: &mut Findings) {
    let mut reported = BTreeSet::new();
    check_spelling(root.line, &root.name, &root.name, "ETHERNETKRL", &mut reported, found);
    node(root, &mut reported, found);
}

fn node(node: &Node, reported: &mut BTreeSet<String>, found: &mut Findings) {
    let Some(known) = KNOWN_ELEMENTS.iter().find(|known| known.path == node.path) else {
        return unknown(node, found);
    };
    if let Some(name) = known.path.rsplit('/').next().filter(|name| !name.is_empty()) {
        check_spelling(node.line, &node.path, &node.name, name, reported, found);
    }
    attributes(node, known, reported, found);
    match &known.text {
        Some(rule) if node.text.is_empty() => {
            found.add_problem(node.line, node.key(), format!("is empty; valid: {}", describe_rule(rule)));
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
        let once = KNOWN_ELEMENTS.iter().any(|known| known.path == child.path && known.once);
        if once && !seen.insert(&child.path) {
            found.add_problem(
                child.line,
                child.key(),
                "appears twice, and it is not known which of the two elements the controller uses; remove one of them",
            );
        }
        self::node(child, reported, found);
    }
}

fn attributes(node: &Node, known: &KnownElement, reported: &mut BTreeSet<String>, found: &mut Findings) {
    let mut seen = BTreeSet::new();
    for attribute in &node.attributes {
        let key = format!("{}/@{}", node.key(), attribute.name);
        if !seen.insert(attribute.name.to_ascii_uppercase()) {
            found.add_problem(
                attribute.line,
                &key,
                "appears twice in one element; remove one of the two attributes",
            );
            continue;
        }
        let right = known.attributes.iter().find(|(name, _)| name.eq_ignore_ascii_case(&attribute.name));
        if let Some((name, rule)) = right {
            check_spelling(attribute.line, &key, &attribute.name, name, reported, found);
            value(attribute.line, &key, &attribute.value, rule, found);
        } else {
            let names: Vec<&str> = known.attributes.iter().map(|(name, _)| *name).collect();
            let meant = suggested_names(&attribute.name, &names);
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
    let inside = |known: &&KnownElement| known.path.rsplit_once('/').map_or("", |(parent, _)| parent) == parent;
    let here = KNOWN_ELEMENTS.iter().filter(|known| !known.path.is_empty()).filter(inside);
    let names: Vec<&str> = here.filter_map(|known| known.path.rsplit('/').next()).collect();
    let elsewhere = KNOWN_ELEMENTS.iter().find(|known| {
        let name = known.path.rsplit('/').next().unwrap_or_default();
        !name.is_empty() && name.eq_ignore_ascii_case(&node.name)
    });
    let meant = match (suggested_names(&node.name, &names), elsewhere) {
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
fn suggested_names(written: &str, known: &[&str]) -> String {
    let closeness = |name: &str| strsim::jaro_winkler(&written.to_uppercase(), &name.to_uppercase());
    let nearest = known.iter().max_by(|a, b| closeness(a).total_cmp(&closeness(b)));
    match nearest {
        Some(name) if closeness(name) > 0.8 => format!("; did you mean {name}?"),
        Some(_) => format!("; valid here: {}", known.join(", ")),
        None => "; no name is valid here".to_owned(),
    }
}

fn check_spelling(
    line: usize,
    key: &str,
    written: &str,
    right: &str,
    reported: &mut BTreeSet<String>,
    found: &mut Findings,
) {
    if written != right && reported.insert(written.to_owned()) {
        let message = format!(
            "found {written}, but the manual writes {right}; it is not known whether the controller accepts this \
             spelling"
        );
        found.warn(line, key, message);
    }
}

fn describe_rule(rule: &ContentRule) -> String {
    match rule {
        ContentRule::Words(words) => format!("one of {}", words.join(", ")),
        ContentRule::Number(low, high) => format!("a whole number {low} to {high}"),
        ContentRule::Free => "a value".to_owned(),
        ContentRule::Codes => {
            "1 to 32 character codes from 0 to 255, such as 13,10, with | between alternatives".to_owned()
        }
    }
}

fn value(line: usize, key: &str, value: &str, rule: &ContentRule, found: &mut Findings) {
    let right = match rule {
        ContentRule::Words(words) => words.iter().any(|word| word.eq_ignore_ascii_case(value)),
        ContentRule::Number(low, high) => value.parse().is_ok_and(|number: u32| (*low..=*high).contains(&number)),
        ContentRule::Free => true,
        ContentRule::Codes => value.split('|').all(|codes| {
            let codes: Vec<&str> = codes.split(',').collect();
            codes.len() <= 32 && codes.iter().all(|code| code.trim().parse::<u8>().is_ok())
        }),
    };
    if !right {
        let is_axis = matches!(rule, ContentRule::Words(_)) && value.eq_ignore_ascii_case("AXIS");
        let hint = if is_axis { "; send axes as six REAL attributes or in a FRAME" } else { "" };
        found.add_problem(line, key, format!("is \"{value}\"; valid: {}{hint}", describe_rule(rule)));
    }
}
