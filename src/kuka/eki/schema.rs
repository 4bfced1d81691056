//! The schema of one kind of document: it assigns the tags of an EthernetKRL file to the fields that this program
//! knows.
//!
//! The file defines names and order. The caller defines the required fields, their ranges and their meaning. A document
//! is read strictly by its schema: each field occurs exactly once, is finite and in range, and no other content is
//! accepted. A missing field is an error and is never read as zero.

use super::channel::{Element, Kind};
use super::ids::{Keyword, intern_keyword};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// A field that the program knows: its tag, whether it is an integer, and its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Field {
    pub tag: &'static str,
    pub whole: bool,
    pub low: f64,
    pub high: f64,
}

/// Returns a field that contains an integer in this range.
pub(super) const fn integer_field(tag: &'static str, low: i32, high: i32) -> Field {
    Field { tag, whole: true, low: low as f64, high: high as f64 }
}

/// Returns a field that contains a positive or negative number of at most this magnitude.
pub(super) const fn number_field(tag: &'static str, largest: f64) -> Field {
    Field { tag, whole: false, low: -largest, high: largest }
}

/// The reason why the tags of a channel's file do not match the fields of this program.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SchemaError {
    /// The file has a tag that matches no field.
    #[error("line {line}: this program does not use the tag {tag}")]
    Unknown {
        /// The line of the tag in the file; the first line is 1.
        line: usize,
        /// The tag.
        tag: String,
    },
    /// The tag has another type than the field.
    #[error("line {line}: the Type of the tag {tag} must be {needed}, found {found}")]
    Type {
        /// The line of the tag in the file; the first line is 1.
        line: usize,
        /// The tag.
        tag: String,
        /// The required type of the field.
        needed: &'static str,
        /// The type that the file states.
        found: Kind,
    },
    /// The tag appears twice.
    #[error("line {line}: the tag {tag} appears twice")]
    Twice {
        /// The line of the second tag in the file; the first line is 1.
        line: usize,
        /// The tag.
        tag: String,
    },
    /// The file has no tag for a field.
    #[error("the tag {tag} is missing")]
    Missing {
        /// The tag.
        tag: &'static str,
    },
}

/// An element of a document with its attributes (name and index of the field) and its children, in the file's order.
#[derive(Debug, Clone, PartialEq, Default)]
struct Node {
    name: String,
    path: String,
    attributes: Vec<(String, usize)>,
    children: Vec<Node>,
}

impl Node {
    /// Returns the child element with this name; creates it if there is none.
    fn child(&mut self, name: &str) -> &mut Node {
        let at = self.children.iter().position(|child| child.name == name).unwrap_or_else(|| {
            let path = if self.path.is_empty() { name.to_owned() } else { format!("{}/{name}", self.path) };
            self.children.push(Node { name: name.to_owned(), path, ..Node::default() });
            self.children.len() - 1
        });
        &mut self.children[at]
    }

    #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
    fn write(&self, fields: &[Field], values: &[f64], text: &mut String) {
        let _ = write!(text, "<{}", self.name);
        for (name, field) in &self.attributes {
            let value = values[*field];
            // A number without fraction is formatted as an integer. The digits are the same, but formatting the exact
            // decimals of a float takes ten times as long.
            let is_plain =
                value.fract() == 0.0 && value.abs() < 1e15 && !(value == 0.0 && value.is_sign_negative());
            let _ = match fields[*field].whole {
                true => write!(text, " {name}=\"{}\"", value as i64),
                false if is_plain => write!(text, " {name}=\"{}.000000\"", value as i64),
                false => write!(text, " {name}=\"{value:.6}\""),
            };
        }
        text.push('>');
        self.children.iter().for_each(|child| child.write(fields, values, text));
        let _ = write!(text, "</{}>", self.name);
    }
}

/// The schema of one kind of document.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Schema {
    fields: &'static [Field],
    /// An additional node above the root; the root is its only child.
    parent: Node,
}

const FRAME: [&str; 6] = ["X", "Y", "Z", "A", "B", "C"];

impl Schema {
    /// Assigns a channel's tags to the fields of one kind of document.
    ///
    /// # Errors
    /// If tags and fields do not match.
    pub(super) fn new(elements: &[Element], fields: &'static [Field]) -> Result<Self, SchemaError> {
        let mut above = Node::default();
        let mut seen = vec![false; fields.len()];
        // A tag without a type only sets a flag on the controller; it has no value.
        for element in elements.iter().filter(|element| element.kind.is_some() || element.tag.contains('@')) {
            let Element { line, kind, .. } = *element;
            let tags = match kind {
                Some(Kind::Frame) => FRAME.map(|name| format!("{}/@{name}", element.tag)).to_vec(),
                _ => vec![element.tag.clone()],
            };
            for tag in tags {
                let Some(index) = fields.iter().position(|field| field.tag == tag) else {
                    return Err(SchemaError::Unknown { line, tag });
                };
                let (needed, fits) = match fields[index].whole {
                    true => ("INT", matches!(kind, None | Some(Kind::Int))),
                    false => ("REAL", matches!(kind, None | Some(Kind::Real | Kind::Frame))),
                };
                // If the types differ, this program and the controller would read different numbers from the same
                // message.
                if let (Some(found), false) = (kind, fits) {
                    return Err(SchemaError::Type { line, tag, needed, found });
                }
                if std::mem::replace(&mut seen[index], true) {
                    return Err(SchemaError::Twice { line, tag });
                }
                let (elements, attribute) = tag.split_once("/@").unwrap_or((&tag, ""));
                let node = elements.split('/').fold(&mut above, Node::child);
                node.attributes.push((attribute.to_owned(), index));
            }
        }
        match seen.iter().position(|seen| !seen) {
            Some(missing) => Err(SchemaError::Missing { tag: fields[missing].tag }),
            None => Ok(Schema { fields, parent: above }),
        }
    }

    /// Writes the document with these values: one value for each field, already checked by the caller.
    pub(super) fn encode(&self, values: &[f64]) -> Vec<u8> {
        let mut text = String::with_capacity(256);
        self.parent.children.iter().for_each(|root| root.write(self.fields, values, &mut text));
        text.into_bytes()
    }
}

/// The reason why a document does not match its schema. `field` is the tag in the EthernetKRL file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum DecodeError {
    /// Not well-formed.
    #[error("not XML: {problem}")]
    NotXml {
        /// The parser's message.
        problem: String,
    },
    /// The document contains text, comments, instructions or entities, which no controller sends.
    #[error("{what} inside <{element}>, which may contain only elements")]
    Foreign {
        /// The kind of content that is not valid here.
        #[serde(deserialize_with = "intern_keyword")]
        what: Keyword,
        /// The enclosing element; empty if the content is outside of all elements.
        element: String,
    },
    /// The document is of another kind than expected.
    #[error("the document is <{found}>, expected <{expected}>")]
    Root {
        /// The root element of the received document.
        found: String,
        /// The expected kind.
        expected: String,
    },
    /// There is a second root element after the first.
    #[error("a second root element, <{found}>, follows the first")]
    SecondRoot {
        /// The name of the second root element.
        found: String,
    },
    /// The document has an element that the channel's file does not define.
    #[error("the element {element} is not defined in the channel's file")]
    UnknownElement {
        /// Path of the element or attribute.
        element: String,
    },
    /// An element appears twice.
    #[error("the element {element} appears twice")]
    RepeatedElement {
        /// Path of the element or attribute.
        element: String,
    },
    /// The document has an attribute that the channel's file does not define.
    #[error("{field} is not defined in the channel's file")]
    Unknown {
        /// Path of the element or attribute.
        field: String,
    },
    /// An attribute appears twice.
    #[error("{field} appears twice")]
    Repeated {
        /// Path of the element or attribute.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
    },
    /// A required attribute is missing.
    #[error("{field} is missing")]
    Missing {
        /// Path of the element or attribute.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
    },
    /// The attribute is empty, because its value was never set on the controller.
    #[error("{field} is empty: it was not set on the controller")]
    Empty {
        /// Path of the element or attribute.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
    },
    /// The value is not a number in the format of EthernetKRL.
    #[error("{field} is \"{found}\", which is not a {needed}")]
    NotANumber {
        /// Path of the element or attribute.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
        /// The text found.
        found: String,
        /// The required format of the value.
        #[serde(deserialize_with = "intern_keyword")]
        needed: Keyword,
    },
    /// The number is outside of the range that a controller can report.
    #[error("{field} is {found}; the limits are {low} to {high}")]
    OutOfRange {
        /// Path of the element or attribute.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
        /// The number found.
        found: f64,
        /// Minimum valid value.
        low: f64,
        /// Maximum valid value.
        high: f64,
    },
}

impl Schema {
    /// Returns the values of a document, one for each field, in the order of the fields.
    ///
    /// # Errors
    /// If the document does not match the schema; the error describes the first difference.
    pub(super) fn decode(&self, document: &str) -> Result<Vec<f64>, DecodeError> {
        let mut reading =
            PartialDocument { fields: self.fields, values: vec![None; self.fields.len()], open: Vec::new() };
        reading.open.push((&self.parent, Vec::new()));
        let mut reader = Reader::from_str(document);
        loop {
            let event = reader.read_event().map_err(|error| xml_error(&error))?;
            let what = match event {
                Event::Start(tag) => {
                    reading.enter_element(&tag)?;
                    continue;
                }
                Event::Empty(tag) => {
                    reading.enter_element(&tag)?;
                    reading.open.pop();
                    continue;
                }
                Event::End(_) => {
                    reading.open.pop();
                    continue;
                }
                Event::Text(text) if text.trim().is_empty() => continue,
                Event::Eof => break,
                Event::Text(_) => "text",
                Event::CData(_) => "CDATA",
                Event::Comment(_) => "a comment",
                Event::Decl(_) | Event::PI(_) => "an instruction",
                Event::DocType(_) => "a document type",
                Event::GeneralRef(_) => "an entity",
            };
            let element = reading.open.last().map_or_else(String::new, |(node, _)| node.path.clone());
            return Err(DecodeError::Foreign { what, element });
        }
        if let [_, .., (node, _)] = reading.open.as_slice() {
            return Err(DecodeError::NotXml { problem: format!("<{}> is never closed", node.path) });
        }
        let value = |(value, field): (&Option<f64>, &Field)| value.ok_or(DecodeError::Missing { field: field.tag });
        reading.values.iter().zip(self.fields).map(value).collect()
    }
}

fn xml_error(error: &dyn std::fmt::Display) -> DecodeError {
    DecodeError::NotXml { problem: error.to_string() }
}

/// The state while a document is read: the open elements, each with the names of its children so far.
struct PartialDocument<'a> {
    fields: &'static [Field],
    values: Vec<Option<f64>>,
    open: Vec<(&'a Node, Vec<&'a str>)>,
}

impl PartialDocument<'_> {
    fn enter_element(&mut self, tag: &BytesStart<'_>) -> Result<(), DecodeError> {
        let found = tag.name().0;
        let at_root = self.open.len() == 1;
        let Some((parent, seen)) = self.open.last_mut() else {
            return Err(DecodeError::SecondRoot { found: found.to_owned() });
        };
        if at_root && !seen.is_empty() {
            return Err(DecodeError::SecondRoot { found: found.to_owned() });
        }
        let parent: &Node = parent;
        let Some(node) = parent.children.iter().find(|child| child.name == found) else {
            let expected = parent.children.first().map_or_else(String::new, |root| root.name.clone());
            return Err(match at_root {
                true => DecodeError::Root { found: found.to_owned(), expected },
                false => DecodeError::UnknownElement { element: format!("{}/{found}", parent.path) },
            });
        };
        // A repeated element would silently replace the first one. It can occur if bytes were lost and two messages
        // were merged.
        if seen.contains(&node.name.as_str()) {
            return Err(DecodeError::RepeatedElement { element: node.path.clone() });
        }
        seen.push(&node.name);
        if !are_attributes_spaced(tag) {
            return Err(xml_error(&"no space between two attributes"));
        }
        for attribute in tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| xml_error(&error))?;
            self.set_field(node, attribute.key.0, &attribute.value)?;
        }
        self.open.push((node, Vec::new()));
        Ok(())
    }

    fn set_field(&mut self, node: &Node, name: &str, text: &str) -> Result<(), DecodeError> {
        let Some(&(_, index)) = node.attributes.iter().find(|(known, _)| known == name) else {
            return Err(DecodeError::Unknown { field: format!("{}/@{name}", node.path) });
        };
        let value = number(&self.fields[index], text)?;
        match self.values[index].replace(value) {
            Some(_) => Err(DecodeError::Repeated { field: self.fields[index].tag }),
            None => Ok(()),
        }
    }
}

/// Returns whether white space separates all attributes of a tag; the XML parser does not check this.
fn are_attributes_spaced(tag: &str) -> bool {
    let (mut quote, mut is_valued) = (None, false);
    tag.bytes().all(|byte| {
        let is_right = !is_valued || byte.is_ascii_whitespace();
        is_valued = quote == Some(byte);
        quote = match quote {
            None if matches!(byte, b'"' | b'\'') => Some(byte),
            Some(open) if open != byte => Some(open),
            _ => None,
        };
        is_right
    })
}

/// Parses a number in the format of EthernetKRL (`%d` or `%f`): an optional minus sign, digits, and for `%f` a decimal
/// point and digits.
fn number(field: &Field, text: &str) -> Result<f64, DecodeError> {
    let &Field { tag, whole, low, high } = field;
    if text.is_empty() {
        return Err(DecodeError::Empty { field: tag });
    }
    let is_digits = |digits: &str| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    // Rust's parser also accepts `inf`, `NaN`, `+1` and `1e5`, which no controller writes.
    let digits = text.strip_prefix('-').unwrap_or(text);
    let right = match digits.split_once('.') {
        Some((before, after)) => !whole && is_digits(before) && is_digits(after),
        None => is_digits(digits),
    };
    let needed = if whole { "whole number" } else { "number such as -12.345678" };
    let wrong = || DecodeError::NotANumber { field: tag, found: text.to_owned(), needed };
    let value: f64 = if right { text.parse().map_err(|_| wrong())? } else { return Err(wrong()) };
    // Without limits, a corrupted digit would result in a wrong pose.
    if value >= low && value <= high {
        Ok(value)
    } else {
        Err(DecodeError::OutOfRange { field: tag, found: value, low, high })
    }
}
