//! What the tree means: one channel. What was noted as wrong is left out here.

use super::Findings;
use super::read::Node;

/// A channel of the controller.
pub(crate) struct Channel {
    /// The file's name without folder and extension, which KRL calls it by.
    pub(super) name: String,
    /// TYPE is Client: the other machine dials.
    pub(super) listens: bool,
    pub(super) type_stated: bool,
    /// Where INTERNAL begins; 1 where there is none.
    pub(super) internal_line: usize,
    pub(super) internal: Address,
    pub(super) external: Address,
    pub(super) environment: Option<Stated<String>>,
    pub(super) is_udp: Option<Stated<bool>>,
    pub(super) is_lifo: Option<Stated<bool>>,
    pub(super) entries: Option<Stated<u32>>,
    pub(super) bytes: Option<Stated<u32>>,
    pub(super) connect_ms: Option<Stated<u32>>,
    /// The line of ALIVE.
    pub(super) alive_line: Option<usize>,
    pub(super) ping: Option<Stated<u32>>,
    pub(super) messages: [Option<String>; 2],
    /// Everything that raises a flag or an output.
    pub(super) signals: Vec<Signal>,
    pub(super) received: Vec<Element>,
    pub(super) raw: Vec<Raw>,
    pub(super) sent: Vec<Element>,
}

/// A value and its line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stated<T> {
    pub(super) value: T,
    pub(super) line: usize,
}

#[derive(Debug, Default)]
pub(super) struct Address {
    pub(super) ip: Option<Stated<String>>,
    pub(super) port: Option<Stated<u32>>,
}

/// `$FLAG[number]` or `$OUT[number]`, and what raises it.
#[derive(Debug, Clone)]
pub(super) struct Signal {
    pub(super) line: usize,
    pub(super) is_flag: bool,
    pub(super) number: u32,
    /// A tag, or `None` for ALIVE.
    pub(super) tag: Option<String>,
}

impl Signal {
    /// As KRL writes it.
    pub(super) fn variable(&self) -> String {
        format!("{}[{}]", if self.is_flag { "$FLAG" } else { "$OUT" }, self.number)
    }

    /// What raises it.
    pub(super) fn cause(&self) -> String {
        self.tag.as_ref().map_or("a connection".to_owned(), |tag| format!("the arrival of {tag}"))
    }
}

/// An element of XML.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) line: usize,
    pub(super) tag: String,
    /// In capitals.
    pub(super) kind: Option<String>,
    pub(super) is_lifo: bool,
}

impl Element {
    /// The outermost name.
    pub(super) fn root(&self) -> &str {
        self.tag.split('/').next().unwrap_or_default()
    }

    /// What is inside that, `@Id`, `P` or `J/@A1`; empty for the root.
    pub(super) fn inside(&self) -> &str {
        self.tag.split_once('/').map_or("", |(_, inside)| inside)
    }
}

/// An element of RAW.
#[derive(Debug)]
pub(super) struct Raw {
    pub(super) line: usize,
    pub(super) is_stream: bool,
    pub(super) size: Option<u32>,
    pub(super) end: Option<String>,
}

impl Channel {
    pub(super) fn of(name: &str, root: &Node, found: &mut Findings) -> Channel {
        let internal = |part: &str| first(root, &format!("CONFIGURATION/INTERNAL/{part}"));
        let peer = stated(first(root, "CONFIGURATION/EXTERNAL/TYPE"), |text| Some(text.to_uppercase()));
        let alive = internal("ALIVE");
        let word = |node: Option<&Node>, right: &str, other: &str| {
            stated(node, |text| match text.to_uppercase() {
                text if text == right => Some(true),
                text if text == other => Some(false),
                _ => None,
            })
        };
        let messages = internal("MESSAGES");
        let message = |part: &str| messages.and_then(|node| node.attribute(part)).map(|at| at.value.to_lowercase());
        let mut channel = Channel {
            name: stem(name),
            listens: peer.as_ref().is_some_and(|peer| peer.value == "CLIENT"),
            type_stated: peer.is_some(),
            internal_line: first(root, "CONFIGURATION/INTERNAL").map_or(1, |node| node.line),
            internal: Address::of(root, "INTERNAL"),
            external: Address::of(root, "EXTERNAL"),
            environment: stated(internal("ENVIRONMENT"), |text| {
                let words = ["Program", "Submit", "System"];
                words.iter().find(|word| word.eq_ignore_ascii_case(text)).map(|word| (*word).to_owned())
            }),
            is_udp: word(internal("PROTOCOL"), "UDP", "TCP"),
            is_lifo: internal("BUFFERING").and_then(|node| {
                let at = node.attribute("Mode")?;
                Some(Stated { value: at.value.eq_ignore_ascii_case("LIFO"), line: at.line })
            }),
            entries: number(internal("BUFFERING"), "Limit", 512),
            bytes: number(internal("BUFFSIZE"), "Limit", 65_534),
            connect_ms: number(internal("TIMEOUT"), "Connect", 65_534),
            alive_line: alive.map(|node| node.line),
            ping: number(alive, "Ping", 65_534),
            messages: [message("Logging"), message("Display")],
            signals: alive.map_or(Vec::new(), |node| signals(node, None)),
            received: Vec::new(),
            raw: Vec::new(),
            sent: Vec::new(),
        };
        for node in root.at("RECEIVE/XML/ELEMENT") {
            if let Some(element) = element(node, found) {
                channel.signals.extend(signals(node, Some(&element.tag)));
                channel.received.push(element);
            }
        }
        for node in root.at("RECEIVE/RAW/ELEMENT") {
            channel.signals.extend(signals(node, Some("a record")));
            channel.raw.push(Raw {
                line: node.line,
                is_stream: node.attribute("Type").is_some_and(|at| at.value.eq_ignore_ascii_case("STREAM")),
                size: number(Some(node), "Size", 3600).map(|size| size.value),
                end: node.attribute("EOS").map(|at| at.value.clone()),
            });
        }
        channel.sent = root.at("SEND/XML/ELEMENT").into_iter().filter_map(|node| element(node, found)).collect();
        channel
    }

    /// The address that is listened on.
    pub(super) fn server(&self) -> &Address {
        if self.listens { &self.internal } else { &self.external }
    }
}

impl Address {
    fn of(root: &Node, side: &str) -> Address {
        let part = |name: &str| first(root, &format!("CONFIGURATION/{side}/{name}"));
        Address {
            ip: stated(part("IP"), |text| Some(text.to_owned())),
            port: stated(part("PORT"), |text| text.parse().ok().filter(|port| (1..=65_534).contains(port))),
        }
    }
}

fn stem(name: &str) -> String {
    let file = name.rsplit(['/', '\\']).next().unwrap_or_default();
    file.rsplit_once('.').map_or(file, |(stem, _)| stem).to_owned()
}

fn first<'a>(root: &'a Node, path: &str) -> Option<&'a Node> {
    root.at(path).first().copied()
}

fn stated<T>(node: Option<&Node>, read: impl Fn(&str) -> Option<T>) -> Option<Stated<T>> {
    let node = node.filter(|node| !node.text.is_empty())?;
    Some(Stated { value: read(&node.text)?, line: node.text_line })
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

fn element(node: &Node, found: &mut Findings) -> Option<Element> {
    let Some(tag) = node.attribute("Tag").filter(|tag| !tag.value.is_empty()) else {
        found.wrong(node.line, node.key(), "has no Tag; an element without a path carries nothing");
        return None;
    };
    if !is_path(&tag.value) {
        let key = format!("{}/@Tag", node.key());
        let message = format!("is \"{}\"; a path is written Root/Child or Root/Child/@Attribute", tag.value);
        found.wrong(tag.line, key, message);
        return None;
    }
    let kind = node.attribute("Type").map(|kind| kind.value.to_uppercase());
    let is_lifo = node.attribute("Mode").is_some_and(|mode| mode.value.eq_ignore_ascii_case("LIFO"));
    Some(Element { line: node.line, tag: tag.value.clone(), kind, is_lifo })
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
