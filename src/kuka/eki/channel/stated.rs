//! The values that a file states for one channel, each with its line. Values that were reported as invalid are omitted.

use super::manual::{Environment, Findings, PeerRole, Protocol, ReadOrder};
use super::tree::Node;
use std::str::FromStr;

/// The configuration of one channel of the controller, as its file states it.
pub struct StatedChannel {
    /// The file's name without folder and extension. KRL programs use this name to open the channel.
    pub name: String,
    /// The value of TYPE, if its keyword is valid; the manual's default is `Server`.
    peer: Option<PeerRole>,
    /// Whether the file contains TYPE, with a valid keyword or another.
    pub type_stated: bool,
    /// The line where INTERNAL begins; 1 if there is none.
    pub internal_line: usize,
    /// The address of the controller.
    pub internal: Address,
    /// The address of the other machine.
    pub external: Address,
    /// The event on which the controller closes the channel.
    pub environment: Option<Stated<Environment>>,
    /// TCP or UDP.
    pub protocol: Option<Stated<Protocol>>,
    /// The order in which buffered values are read.
    pub order: Option<Stated<ReadOrder>>,
    /// Maximum number of values in the buffer of each tag.
    pub entries: Option<Stated<u32>>,
    /// Maximum number of bytes in the receive buffer.
    pub bytes: Option<Stated<u32>>,
    /// The time limit of a connection attempt, ms.
    pub connect_ms: Option<Stated<u32>>,
    /// The line of the element ALIVE.
    pub alive_line: Option<usize>,
    /// The flags and outputs that are on while the channel is connected.
    pub(super) alive: Vec<Signal>,
    /// The value of the attribute `Ping` of ALIVE, as written in the file.
    pub ping: Option<Stated<u32>>,
    /// The attributes `Logging` and `Display` of the element MESSAGES.
    pub messages: [Option<String>; 2],
    /// The elements that the controller receives.
    pub received: Vec<StatedElement>,
    /// The line of the first RAW section.
    pub(super) raw_line: Option<usize>,
    /// The elements of the RAW section.
    pub raw: Vec<StatedRaw>,
    /// The elements that the controller sends.
    pub sent: Vec<StatedElement>,
}

/// A value that the file states, and its line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stated<T> {
    /// The value.
    pub value: T,
    /// The line of the value in the file.
    pub line: usize,
}

/// The address and port on which one of the two machines listens.
#[derive(Debug, Default)]
pub struct Address {
    /// The IP address.
    pub ip: Option<Stated<String>>,
    /// The port.
    pub port: Option<Stated<u16>>,
}

/// A variable `$FLAG[number]` or `$OUT[number]`, and the event on which the controller sets it.
#[derive(Debug, Clone)]
pub struct Signal {
    /// The line of the signal in the file.
    pub line: usize,
    /// Whether the signal is a flag; otherwise it is an output.
    pub is_flag: bool,
    /// The number of the flag or output.
    pub number: u32,
    /// The tag whose arrival sets the signal; `None` if the signal belongs to ALIVE.
    pub tag: Option<String>,
}

impl Signal {
    /// Returns the variable in KRL notation, for example `$FLAG[5]`.
    pub fn variable(&self) -> String {
        format!("{}[{}]", if self.is_flag { "$FLAG" } else { "$OUT" }, self.number)
    }

    /// Describes the event that sets the signal.
    pub fn describe_cause(&self) -> String {
        self.tag.as_ref().map_or("a connection".to_owned(), |tag| format!("the arrival of {tag}"))
    }

    /// Returns the name of the file's element that contains the signal, for use in messages.
    pub fn key(&self) -> String {
        self.tag.as_ref().map_or("CONFIGURATION/INTERNAL/ALIVE".to_owned(), |tag| format!("RECEIVE ELEMENT[{tag}]"))
    }
}

/// An element of an XML channel: one value that is received or sent.
#[derive(Debug)]
pub struct StatedElement {
    /// The line of the element in the file.
    pub line: usize,
    /// The path of the element, such as `Ack/@Rx`.
    pub tag: String,
    /// The keyword of the data type in capital letters, valid or not.
    pub kind: Option<String>,
    /// The order in which the element's buffered values are read.
    pub order: Option<ReadOrder>,
    /// The signals that the element's arrival sets.
    pub(super) signals: Vec<Signal>,
}

impl StatedElement {
    /// Returns the first name in the tag's path: the root element of the message.
    pub fn root(&self) -> &str {
        self.tag.split('/').next().unwrap_or_default()
    }

    /// Returns the part of the tag's path below the root element, for example `@Id`, `P` or `J/@A1`; empty for the
    /// root.
    pub fn tag_below_root(&self) -> &str {
        self.tag.split_once('/').map_or("", |(_, inside)| inside)
    }
}

/// An element of a RAW channel: a block of bytes that is received or sent.
#[derive(Debug)]
pub struct StatedRaw {
    /// The line of the element in the file.
    pub line: usize,
    /// Whether the element is a stream of variable length; otherwise its size is fixed.
    pub is_stream: bool,
    /// The size, bytes.
    pub size: Option<u32>,
    /// The end marker of a stream, as character codes.
    pub end: Option<String>,
    /// The signals that the element's arrival sets.
    signals: Vec<Signal>,
}

impl StatedChannel {
    /// Extracts the statements from the parsed file with this name, and reports elements without a usable tag.
    pub(super) fn from_xml(name: &str, root: &Node, found: &mut Findings) -> StatedChannel {
        let internal = |part: &str| first_node(root, &format!("CONFIGURATION/INTERNAL/{part}"));
        let peer = first_node(root, "CONFIGURATION/EXTERNAL/TYPE").filter(|node| !node.text.is_empty());
        let alive = internal("ALIVE");
        let messages = internal("MESSAGES");
        let message = |part: &str| messages.and_then(|node| node.attribute(part)).map(|at| at.value.to_lowercase());
        let mut elements = |path: &str| -> Vec<StatedElement> {
            root.nodes_at(path).into_iter().filter_map(|node| element(node, found)).collect()
        };
        StatedChannel {
            name: file_stem(name),
            peer: peer.and_then(|node| node.text.parse().ok()),
            type_stated: peer.is_some(),
            internal_line: first_node(root, "CONFIGURATION/INTERNAL").map_or(1, |node| node.line),
            internal: Address::from_xml(root, "INTERNAL"),
            external: Address::from_xml(root, "EXTERNAL"),
            environment: parse_stated(internal("ENVIRONMENT"), parse_keyword),
            protocol: parse_stated(internal("PROTOCOL"), parse_keyword),
            order: internal("BUFFERING").and_then(parse_read_order),
            entries: number(internal("BUFFERING"), "Limit", 512),
            bytes: number(internal("BUFFSIZE"), "Limit", 65_534),
            connect_ms: number(internal("TIMEOUT"), "Connect", 65_534),
            alive_line: alive.map(|node| node.line),
            alive: alive.map_or(Vec::new(), |node| signals(node, None)),
            ping: number(alive, "Ping", 65_534),
            messages: [message("Logging"), message("Display")],
            received: elements("RECEIVE/XML/ELEMENT"),
            sent: elements("SEND/XML/ELEMENT"),
            raw_line: first_node(root, "RECEIVE/RAW")
                .or_else(|| first_node(root, "SEND/RAW"))
                .map(|node| node.line),
            raw: root.nodes_at("RECEIVE/RAW/ELEMENT").into_iter().map(raw).collect(),
        }
    }

    /// Returns the role of the other machine.
    pub(super) fn peer_role(&self) -> PeerRole {
        self.peer.unwrap_or(PeerRole::Server)
    }

    /// Returns whether the controller listens, so that the other machine connects.
    pub fn does_controller_listen(&self) -> bool {
        self.peer_role() == PeerRole::Client
    }

    /// Returns the address of the machine that listens.
    pub fn server(&self) -> &Address {
        if self.does_controller_listen() { &self.internal } else { &self.external }
    }

    /// Returns all flags and outputs that the channel sets.
    pub fn signals(&self) -> impl Iterator<Item = &Signal> {
        let received = self.received.iter().flat_map(|element| &element.signals);
        self.alive.iter().chain(received).chain(self.raw.iter().flat_map(|raw| &raw.signals))
    }
}

impl Address {
    fn from_xml(root: &Node, side: &str) -> Address {
        let part = |name: &str| first_node(root, &format!("CONFIGURATION/{side}/{name}"));
        Address {
            ip: parse_stated(part("IP"), |text| Some(text.to_owned())),
            port: parse_stated(part("PORT"), |text| text.parse().ok().filter(|port| (1..=65_534).contains(port))),
        }
    }
}

fn file_stem(name: &str) -> String {
    let file = name.rsplit(['/', '\\']).next().unwrap_or_default();
    file.rsplit_once('.').map_or(file, |(stem, _)| stem).to_owned()
}

fn first_node<'a>(root: &'a Node, path: &str) -> Option<&'a Node> {
    root.nodes_at(path).first().copied()
}

fn parse_stated<T>(node: Option<&Node>, read: impl Fn(&str) -> Option<T>) -> Option<Stated<T>> {
    let node = node.filter(|node| !node.text.is_empty())?;
    Some(Stated { value: read(&node.text)?, line: node.text_line })
}

fn parse_keyword<T: FromStr>(text: &str) -> Option<T> {
    text.parse().ok()
}

fn parse_read_order(node: &Node) -> Option<Stated<ReadOrder>> {
    let at = node.attribute("Mode")?;
    Some(Stated { value: parse_keyword(&at.value)?, line: at.line })
}

fn number(node: Option<&Node>, name: &str, high: u32) -> Option<Stated<u32>> {
    let at = node?.attribute(name)?;
    let value = at.value.parse().ok().filter(|number| *number <= high)?;
    Some(Stated { value, line: at.line })
}

fn signals(node: &Node, tag: Option<&str>) -> Vec<Signal> {
    let signal = |name: &str, is_flag: bool| {
        let number = number(Some(node), name, 4096).filter(|number| number.value > 0)?;
        Some(Signal { line: number.line, is_flag, number: number.value, tag: tag.map(str::to_owned) })
    };
    [signal("Set_Flag", true), signal("Set_Out", false)].into_iter().flatten().collect()
}

fn element(node: &Node, found: &mut Findings) -> Option<StatedElement> {
    let Some(tag) = node.attribute("Tag").filter(|tag| !tag.value.is_empty()) else {
        found.add_problem(node.line, node.key(), "has no Tag; an element without this path transfers no data");
        return None;
    };
    if !is_path(&tag.value) {
        let key = format!("{}/@Tag", node.key());
        let message = format!("is \"{}\"; write the path as Root/Child or Root/Child/@Attribute", tag.value);
        found.add_problem(tag.line, key, message);
        return None;
    }
    let kind = node.attribute("Type").map(|kind| kind.value.to_uppercase());
    // The manual defines read order and signals for RECEIVE only, not for SEND.
    let is_received = node.path.starts_with("RECEIVE/");
    let order = parse_read_order(node).filter(|_| is_received).map(|order| order.value);
    let signals = if is_received { signals(node, Some(&tag.value)) } else { Vec::new() };
    Some(StatedElement { line: node.line, tag: tag.value.clone(), kind, order, signals })
}

fn raw(node: &Node) -> StatedRaw {
    StatedRaw {
        line: node.line,
        is_stream: node.attribute("Type").is_some_and(|at| at.value.eq_ignore_ascii_case("STREAM")),
        size: number(Some(node), "Size", 3600).map(|size| size.value),
        end: node.attribute("EOS").map(|at| at.value.clone()),
        signals: signals(node, Some("a record")),
    }
}

fn is_path(tag: &str) -> bool {
    let is_name = |part: &str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c))
    };
    match tag.rsplit_once('/') {
        None => is_name(tag),
        Some((parents, last)) => parents.split('/').all(is_name) && is_name(last.strip_prefix('@').unwrap_or(last)),
    }
}
