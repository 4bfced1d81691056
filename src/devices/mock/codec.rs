//! Converts documents to values and back, with the tags and the order of the channel's file.
//!
//! Receiving: each attribute or node that the file defines becomes a value; all others are skipped. Sending: a document
//! contains every tag of the file in the order of the file. Numbers are written as `%f` of a 32-bit float. A tag that
//! the program did not set is present but empty.

use super::channel_file::{EkiFault, Element, ElementKind};
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::io::Write;

/// A value with the number of bits that the controller uses.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    /// A value that the program did not set.
    Unset,
    Int(i32),
    Real(f32),
    Bool(bool),
    Text(String),
    Frame([f32; 6]),
}

/// An element that a received document contains: its index in the file and its value. There is no value if the element
/// is empty or has no type.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Arrival {
    pub(super) element: usize,
    pub(super) value: Option<Value>,
}

const FRAME_ATTRIBUTES: [&str; 6] = ["X", "Y", "Z", "A", "B", "C"];
/// Longest KRL string.
const MAX_TEXT_LENGTH: usize = 512;

/// Decodes one document. Returns those elements of the file that the document contains, in the order of the document.
/// If a node is repeated, its elements are returned several times.
pub(super) fn decode(elements: &[Element], document: &[u8]) -> Result<Vec<Arrival>, EkiFault> {
    let text = std::str::from_utf8(document).map_err(|_| EkiFault::Malformed)?;
    let mut reader = Reader::from_str(text);
    let mut reading = Reading { elements, arrived: Vec::with_capacity(elements.len()), path: String::new() };
    // The text of the innermost open node; text in a node that also has children is ignored.
    let mut content = String::new();
    loop {
        match reader.read_event().map_err(|_| EkiFault::Malformed)? {
            Event::Start(node) => {
                content.clear();
                reading.enter_element(node.name().into_inner());
                reading.read_attributes(&node)?;
            }
            Event::Empty(node) => {
                let above = reading.path.len();
                reading.enter_element(node.name().into_inner());
                reading.read_attributes(&node)?;
                reading.read_node_text("")?;
                reading.path.truncate(above);
            }
            Event::Text(text) => content.push_str(&text),
            Event::GeneralRef(name) => content.push(predefined(&name).ok_or(EkiFault::Malformed)?),
            Event::End(_) => {
                reading.read_node_text(content.trim())?;
                content.clear();
                reading.path.truncate(reading.path.rfind('/').unwrap_or(0));
            }
            Event::Eof => return Ok(reading.arrived),
            _ => {}
        }
    }
}

fn predefined(name: &str) -> Option<char> {
    let known = [("lt", '<'), ("gt", '>'), ("amp", '&'), ("apos", '\''), ("quot", '"')];
    known.iter().find(|(known, _)| *known == name).map(|&(_, character)| character)
}

struct Reading<'a> {
    elements: &'a [Element],
    arrived: Vec<Arrival>,
    path: String,
}

impl Reading<'_> {
    fn enter_element(&mut self, name: &str) {
        if !self.path.is_empty() {
            self.path.push('/');
        }
        self.path.push_str(name);
    }

    /// Decodes the attributes of a node: separate values, or the six numbers of a frame.
    fn read_attributes(&mut self, node: &BytesStart<'_>) -> Result<(), EkiFault> {
        let path = self.path.as_str();
        let own = |element: &Element, attribute: Option<&str>| element.address() == (path, attribute);
        let frame =
            self.elements.iter().position(|element| element.kind == Some(ElementKind::Frame) && own(element, None));
        let mut numbers = [None; 6];
        // A client usually writes its attributes in the order of the file, so each search starts after the last match.
        let mut next = 0;
        for attribute in node.attributes() {
            let attribute = attribute.map_err(|_| EkiFault::Malformed)?;
            let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|_| EkiFault::Malformed)?;
            let name = attribute.key.into_inner();
            let place = FRAME_ATTRIBUTES.iter().position(|known| *known == name);
            if let (Some(place), true) = (place, frame.is_some()) {
                numbers[place] = Some(parse_real(&value)?);
            }
            let (before, behind) = self.elements.split_at(next);
            let found = behind.iter().chain(before).position(|element| own(element, Some(name)));
            if let Some(found) = found.map(|found| (found + next) % self.elements.len()) {
                self.arrived.push(Arrival { element: found, value: scalar(self.elements[found].kind, &value)? });
                next = found + 1;
            }
        }
        if let Some(element) = frame {
            // If a number is missing, the node is not a frame.
            let [Some(x), Some(y), Some(z), Some(a), Some(b), Some(c)] = numbers else {
                return Err(EkiFault::Malformed);
            };
            self.arrived.push(Arrival { element, value: Some(Value::Frame([x, y, z, a, b, c])) });
        }
        Ok(())
    }

    /// Decodes the text of a node at its end tag.
    fn read_node_text(&mut self, content: &str) -> Result<(), EkiFault> {
        for (index, element) in self.elements.iter().enumerate() {
            if element.kind != Some(ElementKind::Frame) && element.address() == (self.path.as_str(), None) {
                self.arrived.push(Arrival { element: index, value: scalar(element.kind, content)? });
            }
        }
        Ok(())
    }
}

/// Parses a value; returns `None` for an empty text.
fn scalar(kind: Option<ElementKind>, text: &str) -> Result<Option<Value>, EkiFault> {
    let value = match kind {
        _ if text.is_empty() => return Ok(None),
        None | Some(ElementKind::Frame) => return Ok(None),
        Some(ElementKind::Int) => Value::Int(text.parse().map_err(|_| EkiFault::Malformed)?),
        Some(ElementKind::Real) => Value::Real(parse_real(text)?),
        Some(ElementKind::Bool) if text == "1" || text.eq_ignore_ascii_case("true") => Value::Bool(true),
        Some(ElementKind::Bool) if text == "0" || text.eq_ignore_ascii_case("false") => Value::Bool(false),
        Some(ElementKind::Bool) => return Err(EkiFault::Malformed),
        Some(ElementKind::Text) if text.len() > MAX_TEXT_LENGTH => return Err(EkiFault::TextTooLong),
        Some(ElementKind::Text) => Value::Text(text.to_owned()),
    };
    Ok(Some(value))
}

fn parse_real(text: &str) -> Result<f32, EkiFault> {
    text.parse().ok().filter(|number: &f32| number.is_finite()).ok_or(EkiFault::Malformed)
}

/// The template of a document to be sent, with a slot for each value.
#[derive(Debug, Clone)]
pub(super) struct Template {
    pieces: Vec<Piece>,
}

#[derive(Debug, Clone)]
enum Piece {
    Text(String),
    /// The index of the value in the list of values to write; `None` for a tag that the program does not set.
    Slot(Option<usize>),
}

#[derive(Debug, Default)]
struct Node {
    name: String,
    attributes: Vec<(String, String)>,
    /// The tag whose value is the text of this node.
    text: Option<String>,
    children: Vec<Node>,
}

impl Template {
    /// Creates the template for the documents of a channel's SEND section. If the section has several root elements,
    /// only the first is used; the cell's files have one. `tags` are the tags that the program sets, in this order.
    pub(super) fn new(elements: &[Element], tags: &[&str]) -> Self {
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
            template.add_node(root, tags);
        }
        template
    }

    fn add_node(&mut self, node: &Node, tags: &[&str]) {
        let place = |tag: &str| Piece::Slot(tags.iter().position(|known| *known == tag));
        self.text(&format!("<{}", node.name));
        for (name, tag) in &node.attributes {
            self.text(&format!(" {name}=\""));
            self.pieces.push(place(tag));
            self.text("\"");
        }
        self.text(">");
        if let Some(tag) = &node.text {
            self.pieces.push(place(tag));
        }
        node.children.iter().for_each(|child| self.add_node(child, tags));
        self.text(&format!("</{}>", node.name));
    }

    fn text(&mut self, text: &str) {
        match self.pieces.last_mut() {
            Some(Piece::Text(last)) => last.push_str(text),
            _ => self.pieces.push(Piece::Text(text.to_owned())),
        }
    }

    /// Appends one document to `out`, with one value for each tag of the program.
    pub(super) fn write(&self, out: &mut Vec<u8>, values: &[Value]) {
        for piece in &self.pieces {
            match piece {
                Piece::Text(text) => out.extend_from_slice(text.as_bytes()),
                Piece::Slot(place) => {
                    write_value(out, place.and_then(|place| values.get(place)).unwrap_or(&Value::Unset));
                }
            }
        }
    }
}

fn write_value(out: &mut Vec<u8>, value: &Value) {
    #[expect(clippy::let_underscore_must_use, reason = "writing into memory cannot fail")]
    let _ = match value {
        Value::Int(number) => write!(out, "{number}"),
        Value::Real(number) => write_real(out, *number),
        Value::Bool(value) => write!(out, "{}", i32::from(*value)),
        Value::Text(text) => escape_text(out, text),
        Value::Unset | Value::Frame(_) => Ok(()),
    };
}

/// Writes a number in the format `%f`. Below 10⁶, the product of a 32-bit float and 10⁶ is exact in 64 bits, so
/// rounding it to the nearest even integer gives the digits of `%f`.
fn write_real(out: &mut Vec<u8>, number: f32) -> std::io::Result<()> {
    if number.abs() < 1e6 {
        let millionths = (f64::from(number) * 1e6).round_ties_even().abs() as u64;
        let sign = if number.is_sign_negative() { "-" } else { "" };
        write!(out, "{sign}{}.{:06}", millionths / 1_000_000, millionths % 1_000_000)
    } else {
        write!(out, "{number:.6}")
    }
}

fn escape_text(out: &mut Vec<u8>, text: &str) -> std::io::Result<()> {
    text.chars().try_for_each(|character| match character {
        '&' => out.write_all(b"&amp;"),
        '<' => out.write_all(b"&lt;"),
        '>' => out.write_all(b"&gt;"),
        '"' => out.write_all(b"&quot;"),
        '\'' => out.write_all(b"&apos;"),
        other => write!(out, "{other}"),
    })
}

#[cfg(test)]
mod tests {
    use super::super::channel_file::ChannelFile;
    use super::*;
    use proptest::prelude::*;

    fn commands() -> ChannelFile {
        ChannelFile::parse(include_str!("../../../config/kuka/CELLCMD.xml")).expect("read")
    }

    /// Returns the values of a document in the order of the file; if an element is repeated, its last value.
    fn values(document: &str) -> [Option<Value>; 9] {
        let mut values = [const { None }; 9];
        for Arrival { element, value } in decode(&commands().received, document.as_bytes()).expect("decoded") {
            values[element] = value;
        }
        values
    }

    /// Expected values of a command of the protocol, calculated by hand. 0.1 cannot be represented as a 32-bit float;
    /// the nearest float is used.
    #[test]
    fn a_command_becomes_its_values_in_the_files_order() {
        let document = "<Cmd Id=\"17\" Ep=\"3\" Op=\"2\" N1=\"0\" N2=\"1\" R1=\"2.000000\" R2=\"0.100000\">\
                        <P X=\"1.000000\" Y=\"-2.500000\" Z=\"0.000000\" A=\"90.000000\" B=\"0.000000\" C=\"0.100000\"></P></Cmd>";
        let values = values(document);
        let ints = [17, 3, 2, 0, 1].map(|number| Some(Value::Int(number)));
        assert_eq!(values[..5], ints);
        assert_eq!(values[5..7], [Some(Value::Real(2.0)), Some(Value::Real(0.1_f32))]);
        assert_eq!(values[7], Some(Value::Frame([1.0, -2.5, 0.0, 90.0, 0.0, 0.1])));
        assert_eq!(values[8], None);
    }

    #[test]
    fn other_order_unknown_tags_and_empty_elements_are_accepted() {
        let values = values(
            "<Cmd Op=\"1\" New=\"x\" Id=\"2\"><Other/><P C=\"6\" B=\"5\" A=\"4\" Z=\"3\" Y=\"2\" X=\"1\"/></Cmd>",
        );
        assert_eq!((&values[0], &values[1], &values[2]), (&Some(Value::Int(2)), &None, &Some(Value::Int(1))));
        assert_eq!(values[7], Some(Value::Frame([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])));
    }

    /// Tests the text of elements, BOOL and STRING values, and the five predefined entities of XML.
    #[test]
    fn the_text_of_an_element_is_also_a_value() {
        let elements = [("S/Name", ElementKind::Text), ("S/On", ElementKind::Bool), ("S/N", ElementKind::Int)]
            .map(|(tag, kind)| Element::new(tag, Some(kind)));
        let document = "<S><Name> a &lt;b&gt; &amp; c </Name><On>1</On><N></N><N>4</N><N>5</N></S>";
        let found = decode(&elements, document.as_bytes()).expect("decoded");
        let value = |element, value| Arrival { element, value };
        let expected = [
            value(0, Some(Value::Text("a <b> & c".to_owned()))),
            value(1, Some(Value::Bool(true))),
            value(2, None),
            value(2, Some(Value::Int(4))),
            value(2, Some(Value::Int(5))),
        ];
        assert_eq!(found, expected);
        let long = format!("<S><Name>{}</Name></S>", "x".repeat(MAX_TEXT_LENGTH + 1));
        assert_eq!(decode(&elements, long.as_bytes()), Err(EkiFault::TextTooLong));
        let mut out = Vec::new();
        Template::new(&elements[..1], &["S/Name"]).write(&mut out, &[Value::Text("a<b".to_owned())]);
        assert_eq!(out, b"<S><Name>a&lt;b</Name></S>");
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

    fn written(number: f32) -> String {
        let mut out = Vec::new();
        write_real(&mut out, number).expect("memory");
        String::from_utf8(out).expect("text")
    }

    /// 1/128 is 0.0078125, which is halfway between two values: `%f` rounds to the even digit.
    #[test]
    fn numbers_are_written_in_percent_f_format() {
        for (number, text) in [
            (0.007_812_5, "0.007812"),
            (-0.0, "-0.000000"),
            (999_999.94, "999999.937500"),
            (1e6, "1000000.000000"),
            (f32::MAX, "340282346638528859811704183484516925440.000000"),
        ] {
            assert_eq!(written(number), text);
        }
    }

    proptest! {
        #[test]
        fn written_numbers_are_the_exact_decimals(bits in any::<u32>()) {
            let number = f32::from_bits(bits);
            prop_assert_eq!(written(number), format!("{number:.6}"));
        }
    }

    /// Expected value, calculated by hand: `%f` writes −90.00003 as a 32-bit float, which is −90.000031.
    #[test]
    fn a_sent_document_has_every_tag_in_the_files_order() {
        let template = Template::new(&commands().sent, &["Ack/@Done", "Ack/@Rx", "Ack/@Ep", "Ack/@Free"]);
        let mut out = Vec::new();
        template.write(&mut out, &[Value::Real(-90.000_03), Value::Int(17), Value::Int(-3), Value::Unset]);
        let expected = "<Ack Rx=\"17\" Done=\"-90.000031\" Free=\"\" Err=\"\" ErrId=\"\" Ep=\"-3\"></Ack>";
        assert_eq!(String::from_utf8(out).expect("text"), expected);
        let nested = ["A/B", "A/B/@x", "A/C/D/@y"].map(|tag| Element::new(tag, None));
        let mut out = Vec::new();
        Template::new(&nested, &["A/B", "A/B/@x", "A/C/D/@y"]).write(&mut out, &[const { Value::Int(1) }; 3]);
        assert_eq!(String::from_utf8(out).expect("text"), "<A><B x=\"1\">1</B><C><D y=\"1\"></D></C></A>");
    }
}
