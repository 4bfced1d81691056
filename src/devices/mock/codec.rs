//! Documents to values and back, in the tags and the order of the channel's file.
//!
//! Received: an attribute or node that the file names becomes a value, everything else is passed over. Sent: a
//! document with every tag of the file, in its order, opened and closed, `%f` of a 32-bit float; a tag that the
//! program did not set is there and empty.

use super::channel_file::{Element, Kind};
use super::fault::EkiFault;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::io::Write;

/// One value, in the controller's own widths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value {
    /// Not set by the program.
    Unset,
    Int(i32),
    Real(f32),
    Frame([f32; 6]),
}

/// One received document: a value for each element of the file, in its order; `None` where it was not there.
pub(super) type Record = Vec<Option<Value>>;

const FRAME_ATTRIBUTES: [&str; 6] = ["X", "Y", "Z", "A", "B", "C"];

/// Reads one document.
pub(super) fn decode(elements: &[Element], document: &[u8]) -> Result<Record, EkiFault> {
    let text = std::str::from_utf8(document).map_err(|_| EkiFault::Malformed)?;
    let mut reader = Reader::from_str(text);
    let mut record = vec![None; elements.len()];
    let mut path = String::new();
    loop {
        match reader.read_event().map_err(|_| EkiFault::Malformed)? {
            Event::Start(node) => {
                descend(&mut path, node.name().into_inner());
                take(elements, &mut record, &path, &node)?;
            }
            Event::Empty(node) => {
                let above = path.len();
                descend(&mut path, node.name().into_inner());
                take(elements, &mut record, &path, &node)?;
                path.truncate(above);
            }
            Event::End(_) => path.truncate(path.rfind('/').unwrap_or(0)),
            Event::Eof => return Ok(record),
            _ => {}
        }
    }
}

fn descend(path: &mut String, name: &str) {
    if !path.is_empty() {
        path.push('/');
    }
    path.push_str(name);
}

fn take(elements: &[Element], record: &mut Record, path: &str, node: &BytesStart<'_>) -> Result<(), EkiFault> {
    let mut frames: Vec<(usize, [Option<f32>; 6])> = Vec::new();
    for (index, element) in elements.iter().enumerate() {
        if element.kind == Some(Kind::Frame) && element.address() == (path, None) {
            frames.push((index, [None; 6]));
        }
    }
    for attribute in node.attributes() {
        let attribute = attribute.map_err(|_| EkiFault::Malformed)?;
        let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|_| EkiFault::Malformed)?;
        let name = attribute.key.into_inner();
        for (index, element) in elements.iter().enumerate() {
            if element.address() == (path, Some(name)) {
                record[index] = scalar(element.kind, &value)?;
            }
        }
        if let Some(place) = FRAME_ATTRIBUTES.iter().position(|known| *known == name) {
            for (_, numbers) in &mut frames {
                numbers[place] = Some(real(&value)?);
            }
        }
    }
    for (index, numbers) in frames {
        // A frame that lacks a number is none.
        let whole: Option<Vec<f32>> = numbers.into_iter().collect();
        let whole: [f32; 6] = whole.and_then(|numbers| numbers.try_into().ok()).ok_or(EkiFault::Malformed)?;
        record[index] = Some(Value::Frame(whole));
    }
    Ok(())
}

/// An empty value pushes nothing.
fn scalar(kind: Option<Kind>, text: &str) -> Result<Option<Value>, EkiFault> {
    match kind {
        _ if text.is_empty() => Ok(None),
        Some(Kind::Int) => text.parse().map(|number| Some(Value::Int(number))).map_err(|_| EkiFault::Malformed),
        Some(Kind::Real) => real(text).map(|number| Some(Value::Real(number))),
        Some(Kind::Frame) | None => Ok(None),
    }
}

fn real(text: &str) -> Result<f32, EkiFault> {
    text.parse().ok().filter(|number: &f32| number.is_finite()).ok_or(EkiFault::Malformed)
}

/// What is sent, with a place for each value.
#[derive(Debug, Clone)]
pub(super) struct Template {
    pieces: Vec<Piece>,
}

#[derive(Debug, Clone)]
enum Piece {
    Text(String),
    /// The value of this tag.
    Slot(String),
}

#[derive(Debug, Default)]
struct Node {
    name: String,
    attributes: Vec<(String, String)>,
    /// The tag whose value is this node's text.
    text: Option<String>,
    children: Vec<Node>,
}

impl Template {
    /// The documents of a channel's SEND section: its first root, which is all that the cell's files have.
    pub(super) fn new(elements: &[Element]) -> Self {
        let mut top = Node::default();
        for element in elements {
            let (path, attribute) = element.address();
            let mut node = &mut top;
            for name in path.split('/') {
                let known = node.children.iter().position(|child| child.name == name);
                let index = known.unwrap_or_else(|| {
                    node.children.push(Node { name: name.to_owned(), ..Node::default() });
                    node.children.len() - 1
                });
                node = &mut node.children[index];
            }
            match attribute {
                Some(attribute) => node.attributes.push((attribute.to_owned(), element.tag.clone())),
                None => node.text = Some(element.tag.clone()),
            }
        }
        let mut template = Template { pieces: Vec::new() };
        if let Some(root) = top.children.first() {
            template.lay_out(root);
        }
        template
    }

    fn lay_out(&mut self, node: &Node) {
        self.text(&format!("<{}", node.name));
        for (name, tag) in &node.attributes {
            self.text(&format!(" {name}=\""));
            self.pieces.push(Piece::Slot(tag.clone()));
            self.text("\"");
        }
        self.text(">");
        if let Some(tag) = &node.text {
            self.pieces.push(Piece::Slot(tag.clone()));
        }
        node.children.iter().for_each(|child| self.lay_out(child));
        self.text(&format!("</{}>", node.name));
    }

    fn text(&mut self, text: &str) {
        match self.pieces.last_mut() {
            Some(Piece::Text(last)) => last.push_str(text),
            _ => self.pieces.push(Piece::Text(text.to_owned())),
        }
    }

    /// Writes one document after what is in `out` already.
    pub(super) fn write(&self, out: &mut Vec<u8>, value: impl Fn(&str) -> Value) {
        for piece in &self.pieces {
            match piece {
                Piece::Text(text) => out.extend_from_slice(text.as_bytes()),
                Piece::Slot(tag) => write_value(out, value(tag)),
            }
        }
    }
}

fn write_value(out: &mut Vec<u8>, value: Value) {
    // Writing into memory cannot fail.
    let _ = match value {
        Value::Int(number) => write!(out, "{number}"),
        Value::Real(number) => write!(out, "{number:.6}"),
        Value::Unset | Value::Frame(_) => Ok(()),
    };
}

#[cfg(test)]
mod tests {
    use super::super::channel_file::ChannelFile;
    use super::*;

    fn commands() -> ChannelFile {
        ChannelFile::parse(include_str!("../../../config/kuka/CELLCMD.xml")).expect("read")
    }

    /// The command of the agreed wire, by hand. 0.1 is no 32-bit float; the nearest one is taken.
    #[test]
    fn a_command_becomes_its_values_in_the_files_order() {
        let document = "<Cmd Id=\"17\" Ep=\"3\" Op=\"2\" N1=\"0\" N2=\"1\" R1=\"2.000000\" R2=\"0.100000\">\
                        <P X=\"1.000000\" Y=\"-2.500000\" Z=\"0.000000\" A=\"90.000000\" B=\"0.000000\" C=\"0.100000\"></P></Cmd>";
        let record = decode(&commands().received, document.as_bytes()).expect("decoded");
        let ints = [17, 3, 2, 0, 1].map(|number| Some(Value::Int(number)));
        assert_eq!(record[..5], ints);
        assert_eq!(record[5..7], [Some(Value::Real(2.0)), Some(Value::Real(0.1_f32))]);
        assert_eq!(record[7], Some(Value::Frame([1.0, -2.5, 0.0, 90.0, 0.0, 0.1])));
        assert_eq!(record[8], None);
    }

    #[test]
    fn other_order_unknown_tags_and_self_closing_are_taken() {
        let document =
            "<Cmd Op=\"1\" New=\"x\" Id=\"2\"><Other/><P C=\"6\" B=\"5\" A=\"4\" Z=\"3\" Y=\"2\" X=\"1\"/></Cmd>";
        let record = decode(&commands().received, document.as_bytes()).expect("decoded");
        assert_eq!((record[0], record[1], record[2]), (Some(Value::Int(2)), None, Some(Value::Int(1))));
        assert_eq!(record[7], Some(Value::Frame([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])));
    }

    #[test]
    fn wrong_values_close_the_channel() {
        for wrong in [
            "<Cmd Id=\"1.0\"></Cmd>",
            "<Cmd Id=\"2147483648\"></Cmd>",
            "<Cmd R1=\"nan\"></Cmd>",
            "<Cmd R1=\"1e400\"></Cmd>",
            "<Cmd R1=\"1,5\"></Cmd>",
            "<Cmd Id=\"1\" Id=\"2\"></Cmd>",
            "<Cmd><P X=\"1\"></P></Cmd>",
            "<Cmd Id=\"&bomb;\"></Cmd>",
            "<Cmd></Cme>",
        ] {
            assert_eq!(decode(&commands().received, wrong.as_bytes()), Err(EkiFault::Malformed), "{wrong}");
        }
    }

    /// By hand, after MA's sample: `%f` of a 32-bit float, −90.00003 becomes −90.000031.
    #[test]
    fn what_is_sent_has_every_tag_in_the_files_order() {
        let template = Template::new(&commands().sent);
        let mut out = Vec::new();
        template.write(&mut out, |tag| match tag {
            "Ack/@Rx" => Value::Int(17),
            "Ack/@Done" => Value::Real(-90.000_03),
            "Ack/@Ep" => Value::Int(-3),
            _ => Value::Unset,
        });
        let expected = "<Ack Rx=\"17\" Done=\"-90.000031\" Free=\"\" Err=\"\" ErrId=\"\" Ep=\"-3\"></Ack>";
        assert_eq!(String::from_utf8(out).expect("text"), expected);
        let nested = ["A/B", "A/B/@x", "A/C/D/@y"].map(|tag| Element { tag: tag.to_owned(), kind: None });
        let mut out = Vec::new();
        Template::new(&nested).write(&mut out, |_| Value::Int(1));
        assert_eq!(String::from_utf8(out).expect("text"), "<A><B x=\"1\">1</B><C><D y=\"1\"></D></C></A>");
    }
}
