//! Handles messages as text: divides a stream into documents, and reads and replaces single values. The bench has its
//! own reader, so that errors of the program's reader are not hidden. It relies on each document ending with the end
//! tag of its root element, as both sides write it.

const ENDS: [&[u8]; 4] = [b"</Cmd>", b"</Ack>", b"</Req>", b"</St>"];
/// Maximum size of a message, bytes; longer input without an end is discarded.
const MAX_BYTES: usize = 65_536;

/// Divides a stream of bytes into documents.
#[derive(Debug, Default)]
pub struct Splitter {
    rest: Vec<u8>,
}

impl Splitter {
    /// Adds bytes. Returns the documents that these bytes complete.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        self.rest.extend_from_slice(bytes);
        let mut documents = Vec::new();
        while let Some(end) = ENDS.iter().filter_map(|end| end_of(&self.rest, end)).min() {
            let rest = self.rest.split_off(end);
            documents.push(std::mem::replace(&mut self.rest, rest));
        }
        if self.rest.len() > MAX_BYTES {
            self.rest.clear();
        }
        documents
    }
}

fn end_of(bytes: &[u8], end: &[u8]) -> Option<usize> {
    bytes.windows(end.len()).position(|window| window == end).map(|at| at + end.len())
}

/// Returns the start and end of an attribute's value in the text; `Base/X` is the attribute X of the element Base.
fn place(document: &str, name: &str) -> Option<(usize, usize)> {
    let (element, attribute) = name.split_once('/').unwrap_or(("", name));
    let from = if element.is_empty() { 0 } else { document.find(&format!("<{element} "))? };
    let start = document[from..].find(&format!(" {attribute}=\""))? + from + attribute.len() + 3;
    Some((start, document[start..].find('"')? + start))
}

pub fn value<'d>(document: &'d str, name: &str) -> Option<&'d str> {
    place(document, name).map(|(start, end)| &document[start..end])
}

pub fn number(document: &str, name: &str) -> Option<f64> {
    value(document, name)?.parse().ok()
}

/// Returns an attribute's value as an integer; 0 if it is not an integer.
pub fn whole(document: &str, name: &str) -> i64 {
    value(document, name).and_then(|text| text.parse().ok()).unwrap_or(0)
}

/// Returns the document with another value of this attribute.
pub fn replaced(document: &str, name: &str, by: &str) -> Option<String> {
    let (start, end) = place(document, name)?;
    Some(format!("{}{by}{}", &document[..start], &document[end..]))
}
