//! Parses the text of a channel file to a tree of XML nodes with their line numbers.

use panelprep_base::config::Problem;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Maximum nesting depth of elements; channel files have at most four levels.
const MAX_DEPTH: usize = 32;

/// An XML element of the file.
#[derive(Debug)]
pub(super) struct Node {
    /// As written.
    pub(super) name: String,
    /// The path of the element below the root, in capital letters, for example `RECEIVE/XML/ELEMENT`; empty for the
    /// root.
    pub(super) path: String,
    pub(super) line: usize,
    pub(super) attributes: Vec<Attribute>,
    /// The text directly inside the element, trimmed.
    pub(super) text: String,
    /// The line on which the text begins.
    pub(super) text_line: usize,
    pub(super) children: Vec<Node>,
}

#[derive(Debug)]
pub(super) struct Attribute {
    /// As written.
    pub(super) name: String,
    pub(super) value: String,
    pub(super) line: usize,
}

impl Node {
    /// Returns the node's attribute of this name; upper and lower case are equivalent.
    pub(super) fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|attribute| attribute.name.eq_ignore_ascii_case(name))
    }

    /// Returns all nodes with this path among this node and its descendants.
    pub(super) fn nodes_at<'a>(&'a self, path: &str) -> Vec<&'a Node> {
        let mut found: Vec<&Node> = self.children.iter().flat_map(|child| child.nodes_at(path)).collect();
        if self.path == path {
            found.insert(0, self);
        }
        found
    }

    /// Returns the name of the node for messages: its path, and the tag if the node is an ELEMENT.
    pub(super) fn key(&self) -> String {
        let path = if self.path.is_empty() { &self.name } else { &self.path };
        match self.attribute("Tag") {
            Some(tag) if self.path.ends_with("/ELEMENT") => format!("{path}[{}]", tag.value),
            _ => path.clone(),
        }
    }
}

/// Parses the whole text of a channel file and returns its root node.
///
/// # Errors
/// If the text is not well-formed XML.
pub(super) fn tree(text: &str) -> Result<Node, Problem> {
    let mut reader = Reader::from_str(text);
    reader.config_mut().check_comments = false;
    let mut open: Vec<Node> = Vec::new();
    let mut root: Option<Node> = None;
    loop {
        let at = offset(reader.buffer_position());
        let event = reader.read_event().map_err(|error| {
            let at = offset(reader.error_position());
            xml_problem(line_number(text, at), &error.to_string())
        })?;
        let line = line_number(text, at);
        match event {
            Event::Start(tag) | Event::Empty(tag) if open.is_empty() && root.is_some() => {
                return Err(xml_problem(line, &format!("{} follows the end of the root element", tag.name().0)));
            }
            Event::Start(tag) => {
                open.push(node(text, at, &tag, open.last())?);
                if open.len() > MAX_DEPTH {
                    return Err(xml_problem(
                        line,
                        &format!("elements are nested more than {MAX_DEPTH} levels deep"),
                    ));
                }
            }
            Event::Empty(tag) => close(node(text, at, &tag, open.last())?, &mut open, &mut root),
            Event::End(_) => {
                if let Some(node) = open.pop() {
                    close(node, &mut open, &mut root);
                }
            }
            Event::Text(content) => add_text(text, at, &content, &mut open)?,
            Event::CData(content) => add_text(text, at, &content, &mut open)?,
            Event::GeneralRef(name) => add_text(text, at, &format!("&{};", &*name), &mut open)?,
            Event::DocType(_) => {
                return Err(xml_problem(line, "a document type (DOCTYPE) is not valid in a channel file"));
            }
            Event::Eof => break,
            Event::Comment(_) | Event::Decl(_) | Event::PI(_) => {}
        }
    }
    match (open.last(), root) {
        (Some(node), _) => Err(xml_problem(node.line, &format!("{} is never closed", node.name))),
        (None, None) => Err(xml_problem(1, "the file contains no element")),
        (None, Some(root)) => Ok(root),
    }
}

fn offset(position: u64) -> usize {
    usize::try_from(position).unwrap_or(usize::MAX)
}

fn line_number(text: &str, at: usize) -> usize {
    1 + text.as_bytes()[..at.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}

fn xml_problem(line: usize, what: &str) -> Problem {
    Problem { line, key: String::new(), message: format!("not XML: {what}") }
}

fn close(node: Node, open: &mut [Node], root: &mut Option<Node>) {
    match open.last_mut() {
        Some(parent) => parent.children.push(node),
        None => *root = Some(node),
    }
}

fn add_text(text: &str, at: usize, content: &str, open: &mut [Node]) -> Result<(), Problem> {
    let trimmed = content.trim();
    if trimmed.is_empty() {
        return Ok(());
    }
    let blanks = content.len() - content.trim_start().len();
    let line = line_number(text, at + blanks);
    let Some(node) = open.last_mut() else {
        let stray = trimmed.trim_start_matches('\u{feff}');
        return if stray.is_empty() {
            Ok(())
        } else {
            Err(xml_problem(line, &format!("\"{stray}\" is outside of the elements")))
        };
    };
    if node.text.is_empty() {
        node.text_line = line;
    } else {
        node.text.push(' ');
    }
    node.text.push_str(trimmed);
    Ok(())
}

fn node(text: &str, at: usize, tag: &BytesStart<'_>, parent: Option<&Node>) -> Result<Node, Problem> {
    let line = line_number(text, at);
    let name = tag.name().0.to_owned();
    let path = match parent {
        None => String::new(),
        Some(parent) if parent.path.is_empty() => name.to_ascii_uppercase(),
        Some(parent) => format!("{}/{}", parent.path, name.to_ascii_uppercase()),
    };
    let mut attributes: Vec<Attribute> = Vec::new();
    let mut cursor = at + name.len();
    for attribute in tag.attributes().with_checks(false) {
        let attribute = attribute.map_err(|error| xml_problem(line, &error.to_string()))?;
        let key = attribute.key.0;
        // The attributes of an element may be on several lines.
        cursor += text.get(cursor..).and_then(|rest| rest.find(key)).unwrap_or(0);
        let attribute =
            Attribute { name: key.to_owned(), value: attribute.value.to_string(), line: line_number(text, cursor) };
        cursor += key.len() + attribute.value.len();
        attributes.push(attribute);
    }
    Ok(Node { name, path, line, attributes, text: String::new(), text_line: line, children: Vec::new() })
}
