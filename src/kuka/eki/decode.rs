//! Reads a document strictly by its schema: each field occurs exactly once, is finite and in range, and there is no
//! other content. A missing field is an error and never zero.

use super::schema::{Field, Node, Schema};
use super::word::{Keyword, intern_keyword};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use serde::{Deserialize, Serialize};

/// The reason why a document does not match its schema. `field` is a tag of the EthernetKRL file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum DecodeError {
    /// Not well-formed.
    #[error("not XML: {problem}")]
    NotXml {
        /// The parser's message.
        problem: String,
    },
    /// Content that no controller sends: text, comments, instructions, entities.
    #[error("{what} inside <{element}>, which may contain only elements")]
    Foreign {
        /// Kind of the element that is not valid here.
        #[serde(deserialize_with = "intern_keyword")]
        what: Keyword,
        /// The enclosing element; empty outside all elements.
        element: String,
    },
    /// The document is of another kind.
    #[error("the document is <{found}>, expected <{expected}>")]
    Root {
        /// The root element found.
        found: String,
        /// The expected kind.
        expected: String,
    },
    /// Two documents instead of one.
    #[error("a second root element, <{found}>, follows the first")]
    SecondRoot {
        /// The second root element.
        found: String,
    },
    /// An element that the channel file does not define.
    #[error("the element {element} is not defined in the channel's file")]
    UnknownElement {
        /// Its path.
        element: String,
    },
    /// An element appears twice.
    #[error("the element {element} appears twice")]
    RepeatedElement {
        /// Its path.
        element: String,
    },
    /// An attribute that the channel file does not define.
    #[error("{field} is not defined in the channel's file")]
    Unknown {
        /// Its path.
        field: String,
    },
    /// An attribute appears twice.
    #[error("{field} appears twice")]
    Repeated {
        /// Its path.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
    },
    /// An attribute that is missing.
    #[error("{field} is missing")]
    Missing {
        /// Its path.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
    },
    /// An attribute that was never set on the controller.
    #[error("{field} is empty: it was not set on the controller")]
    Empty {
        /// Its path.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
    },
    /// A text that is not a number in the form of EthernetKRL.
    #[error("{field} is \"{found}\", which is not a {needed}")]
    NotANumber {
        /// Its path.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
        /// The text found.
        found: String,
        /// The required form of the value.
        #[serde(deserialize_with = "intern_keyword")]
        needed: Keyword,
    },
    /// A number outside of the range that a controller can report.
    #[error("{field} is {found}; the limits are {low} to {high}")]
    OutOfRange {
        /// Its path.
        #[serde(deserialize_with = "intern_keyword")]
        field: Keyword,
        /// The number found.
        found: f64,
        /// Smallest allowed.
        low: f64,
        /// Largest allowed.
        high: f64,
    },
}

impl Schema {
    /// Returns the values of a document, one for each field, in the order of the fields.
    ///
    /// # Errors
    /// The first part that does not match the schema.
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

/// A document that is partly read: the open elements, each with its children seen so far.
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
        // The second one would silently replace the first: two messages were merged by a loss in between.
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

/// Returns whether white space follows the value of every attribute; the parser does not check this.
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

/// Parses a number in the form of EthernetKRL: `%d`, or `%f`: a sign, digits, a point and digits, and nothing else.
fn number(field: &Field, text: &str) -> Result<f64, DecodeError> {
    let &Field { tag, whole, low, high } = field;
    if text.is_empty() {
        return Err(DecodeError::Empty { field: tag });
    }
    let is_digits = |digits: &str| !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    // Stricter than Rust's parser, which also accepts `inf`, `NaN`, `+1` and `1e5`: no controller writes those.
    let digits = text.strip_prefix('-').unwrap_or(text);
    let right = match digits.split_once('.') {
        Some((before, after)) => !whole && is_digits(before) && is_digits(after),
        None => is_digits(digits),
    };
    let needed = if whole { "whole number" } else { "number such as -12.345678" };
    let wrong = || DecodeError::NotANumber { field: tag, found: text.to_owned(), needed };
    let value: f64 = if right { text.parse().map_err(|_| wrong())? } else { return Err(wrong()) };
    // A field without a limit would let a damaged digit become a pose.
    if value >= low && value <= high {
        Ok(value)
    } else {
        Err(DecodeError::OutOfRange { field: tag, found: value, low, high })
    }
}
