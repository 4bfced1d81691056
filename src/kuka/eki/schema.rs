//! One kind of document: the tags of an EthernetKRL file, connected to the fields that this program knows.
//!
//! Names and order come from the file. The required fields, their ranges and their meaning come from the caller.
//! `decode` reads a document by this schema.

use super::channel::{Element, Kind};
use std::fmt::Write;

/// A field that the program knows: its tag, whether it is a whole number, and its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Field {
    pub tag: &'static str,
    pub whole: bool,
    pub low: f64,
    pub high: f64,
}

/// Returns a field with a whole number in this range.
pub(super) const fn integer_field(tag: &'static str, low: i32, high: i32) -> Field {
    Field { tag, whole: true, low: low as f64, high: high as f64 }
}

/// Returns a field with a number of at most this magnitude, of either sign.
pub(super) const fn number_field(tag: &'static str, largest: f64) -> Field {
    Field { tag, whole: false, low: -largest, high: largest }
}

/// The reason why a channel's tags do not match this program.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SchemaError {
    /// A tag that matches no field.
    #[error("line {line}: this program does not use the tag {tag}")]
    Unknown {
        /// Line in the file, from 1.
        line: usize,
        /// The tag.
        tag: String,
    },
    /// A tag with another type.
    #[error("line {line}: the Type of the tag {tag} must be {needed}, found {found}")]
    Type {
        /// Line in the file, from 1.
        line: usize,
        /// The tag.
        tag: String,
        /// The required type of the field.
        needed: &'static str,
        /// The kind that the file states.
        found: Kind,
    },
    /// A tag appears twice.
    #[error("line {line}: the tag {tag} appears twice")]
    Twice {
        /// Line in the file, from 1.
        line: usize,
        /// The tag.
        tag: String,
    },
    /// A field without a tag.
    #[error("the tag {tag} is missing")]
    Missing {
        /// The tag.
        tag: &'static str,
    },
}

/// An element with its attributes (name and field) and children, in the file's order.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Node {
    pub(super) name: String,
    pub(super) path: String,
    pub(super) attributes: Vec<(String, usize)>,
    pub(super) children: Vec<Node>,
}

impl Node {
    /// Returns the child of this name, which is created if there is none.
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
            // A whole number is written as an integer: the digits are the same, and writing the exact decimals of a
            // float takes ten times as long.
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

/// One kind of document.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Schema {
    pub(super) fields: &'static [Field],
    /// A node above the root, with the root as its only child.
    pub(super) parent: Node,
}

const FRAME: [&str; 6] = ["X", "Y", "Z", "A", "B", "C"];

impl Schema {
    /// Connects a channel's tags to the fields of one kind of document.
    ///
    /// # Errors
    /// If the two differ.
    pub(super) fn new(elements: &[Element], fields: &'static [Field]) -> Result<Self, SchemaError> {
        let mut above = Node::default();
        let mut seen = vec![false; fields.len()];
        // A tag without a type sets a flag when its element has arrived; it carries no value.
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
                // With another type, program and controller would read another number in the same message.
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

    /// Writes the document with these values, which the caller has checked; one value for each field.
    pub(super) fn encode(&self, values: &[f64]) -> Vec<u8> {
        let mut text = String::with_capacity(256);
        self.parent.children.iter().for_each(|root| root.write(self.fields, values, &mut text));
        text.into_bytes()
    }
}
