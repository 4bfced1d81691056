//! Walks the XML events of one file.

use super::{ChannelError, ChannelFile, Element, Environment, Kind, Memory, Order, Peer, Protocol, Unknown};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// The entries of a memory that a file does not state (`eki.md` 1.3).
const DEFAULT_ENTRIES: u32 = 16;
const DEFAULT_BYTES: u32 = 16_384;
const DEFAULT_PORT: u16 = 54_600;
const LAST_FLAG: u32 = 1025;
const LAST_OUTPUT: u32 = 4096;

impl ChannelFile {
    /// Reads the text of a classic EthernetKRL file.
    ///
    /// # Errors
    /// The first thing in it that the controller would refuse or this program cannot use.
    pub fn parse(text: &str) -> Result<Self, ChannelError> {
        let mut walk = Walk { text, path: Vec::new(), found: Found::default() };
        let mut reader = Reader::from_str(text);
        reader.config_mut().check_comments = false;
        loop {
            let at = usize::try_from(reader.buffer_position()).unwrap_or(usize::MAX);
            let event = reader.read_event().map_err(|error| ChannelError::NotXml {
                line: walk.line(usize::try_from(reader.error_position()).unwrap_or(at)),
                problem: error.to_string(),
            })?;
            match event {
                Event::Start(tag) => walk.open(&tag, at)?,
                Event::Empty(tag) => {
                    walk.open(&tag, at)?;
                    walk.path.pop();
                }
                Event::End(_) => {
                    walk.path.pop();
                }
                Event::Text(content) => walk.content(content.trim(), at)?,
                Event::Eof if !walk.path.is_empty() => {
                    let problem = format!("{} is never closed", walk.path.join("/"));
                    return Err(ChannelError::NotXml { line: walk.line(at), problem });
                }
                Event::Eof => break,
                Event::Comment(_) | Event::Decl(_) => {}
                Event::CData(_) | Event::PI(_) | Event::DocType(_) | Event::GeneralRef(_) => {
                    let problem = "a document type, an instruction or an entity has no place here".to_owned();
                    return Err(ChannelError::NotXml { line: walk.line(at), problem });
                }
            }
        }
        if !walk.found.root {
            return Err(ChannelError::NotEthernetKrl { line: 1, found: "missing".to_owned() });
        }
        Ok(walk.found.finish())
    }
}

/// What was read so far; what the file does not say is `None`.
#[derive(Default)]
struct Found {
    root: bool,
    peer: Option<Peer>,
    internal: (Option<String>, Option<u16>),
    external: (Option<String>, Option<u16>),
    environment: Option<Environment>,
    protocol: Option<Protocol>,
    order: Option<Order>,
    entries: Option<u32>,
    bytes: Option<u32>,
    connect_timeout_ms: Option<u32>,
    alive: [Option<u32>; 3],
    received: Vec<Element>,
    sent: Vec<Element>,
    unknown: Vec<Unknown>,
}

impl Found {
    fn finish(self) -> ChannelFile {
        let peer = self.peer.unwrap_or(Peer::Server);
        let (address, port) = match peer {
            Peer::Client => self.internal,
            Peer::Server => self.external,
        };
        let [alive_flag, alive_out, ping] = self.alive;
        ChannelFile {
            peer,
            address,
            port: port.unwrap_or(DEFAULT_PORT),
            environment: self.environment.unwrap_or(Environment::Program),
            protocol: self.protocol.unwrap_or(Protocol::Tcp),
            memory: Memory {
                order: self.order.unwrap_or(Order::Fifo),
                entries: self.entries.unwrap_or(DEFAULT_ENTRIES),
                bytes: self.bytes.unwrap_or(DEFAULT_BYTES),
            },
            connect_timeout_ms: self.connect_timeout_ms,
            alive_flag,
            alive_out,
            ping,
            received: self.received,
            sent: self.sent,
            unknown: self.unknown,
        }
    }
}

/// One attribute of the element at hand.
struct Attribute<'a> {
    line: usize,
    name: String,
    value: &'a str,
}

impl Attribute<'_> {
    fn number(&self, low: u32, high: u32) -> Result<u32, ChannelError> {
        number(self.line, &self.name, self.value, low, high)
    }

    fn order(&self) -> Result<Order, ChannelError> {
        let words = [("FIFO", Order::Fifo), ("LIFO", Order::Lifo)];
        word(self.line, &self.name, self.value, &words, "FIFO, LIFO")
    }

    fn kind(&self) -> Result<Kind, ChannelError> {
        let words = [
            ("INT", Kind::Int),
            ("REAL", Kind::Real),
            ("BOOL", Kind::Bool),
            ("STRING", Kind::Text),
            ("FRAME", Kind::Frame),
        ];
        word(self.line, &self.name, self.value, &words, "STRING, REAL, INT, BOOL, FRAME")
    }
}

struct Walk<'a> {
    text: &'a str,
    path: Vec<String>,
    found: Found,
}

impl Walk<'_> {
    fn line(&self, offset: usize) -> usize {
        1 + self.text.as_bytes()[..offset.min(self.text.len())].iter().filter(|&&byte| byte == b'\n').count()
    }

    fn open(&mut self, tag: &BytesStart<'_>, at: usize) -> Result<(), ChannelError> {
        let line = self.line(at);
        let name = tag.name().0.to_ascii_uppercase();
        if self.path.is_empty() {
            if name != "ETHERNETKRL" || self.found.root {
                return Err(ChannelError::NotEthernetKrl { line, found: tag.name().0.to_owned() });
            }
            self.found.root = true;
        }
        self.path.push(name);
        let path = self.path.join("/");
        let path = path.strip_prefix("ETHERNETKRL").unwrap_or_default().trim_start_matches('/').to_owned();
        let mut element =
            Element { tag: String::new(), kind: None, order: None, set_flag: None, set_out: None, line };
        let mut seen: Vec<String> = Vec::new();
        for attribute in tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| ChannelError::NotXml { line, problem: error.to_string() })?;
            let name = attribute.key.0.to_ascii_uppercase();
            if seen.contains(&name) {
                return Err(ChannelError::Twice { line, name });
            }
            let attribute = Attribute { line, name: name.clone(), value: attribute.value.as_ref() };
            self.attribute(&path, &attribute, &mut element)?;
            seen.push(name);
        }
        match path.as_str() {
            "RECEIVE/XML/ELEMENT" => self.found.received.push(checked(element)?),
            "SEND/XML/ELEMENT" => self.found.sent.push(checked(element)?),
            "RECEIVE/RAW" | "SEND/RAW" => return Err(ChannelError::Raw { line }),
            known if KNOWN.contains(&known) => {}
            _ => self.found.unknown.push(Unknown { line, name: path }),
        }
        Ok(())
    }

    fn attribute(&mut self, path: &str, at: &Attribute<'_>, element: &mut Element) -> Result<(), ChannelError> {
        let found = &mut self.found;
        match (path, at.name.as_str()) {
            ("CONFIGURATION/INTERNAL/BUFFERING", "MODE") => found.order = Some(at.order()?),
            ("CONFIGURATION/INTERNAL/BUFFERING", "LIMIT") => found.entries = Some(at.number(1, 512)?),
            ("CONFIGURATION/INTERNAL/BUFFSIZE", "LIMIT") => found.bytes = Some(at.number(1, 65_534)?),
            ("CONFIGURATION/INTERNAL/TIMEOUT", "CONNECT") => {
                found.connect_timeout_ms = Some(at.number(0, 65_534)?);
            }
            ("CONFIGURATION/INTERNAL/ALIVE", "SET_FLAG") => found.alive[0] = Some(at.number(1, LAST_FLAG)?),
            ("CONFIGURATION/INTERNAL/ALIVE", "SET_OUT") => found.alive[1] = Some(at.number(1, LAST_OUTPUT)?),
            ("CONFIGURATION/INTERNAL/ALIVE", "PING") => found.alive[2] = Some(at.number(1, 65_534)?),
            ("CONFIGURATION/INTERNAL/MESSAGES", "LOGGING") => {
                let words = [("error", ()), ("warning", ()), ("disabled", ())];
                word(at.line, &at.name, at.value, &words, "error, warning, disabled")?;
            }
            ("CONFIGURATION/INTERNAL/MESSAGES", "DISPLAY") => {
                let words = [("error", ()), ("disabled", ())];
                word(at.line, &at.name, at.value, &words, "error, disabled")?;
            }
            ("RECEIVE/XML/ELEMENT" | "SEND/XML/ELEMENT", "TAG") => element.tag = at.value.to_owned(),
            ("RECEIVE/XML/ELEMENT" | "SEND/XML/ELEMENT", "TYPE") => element.kind = Some(at.kind()?),
            ("RECEIVE/XML/ELEMENT", "MODE") => element.order = Some(at.order()?),
            ("RECEIVE/XML/ELEMENT", "SET_FLAG") => element.set_flag = Some(at.number(1, LAST_FLAG)?),
            ("RECEIVE/XML/ELEMENT", "SET_OUT") => element.set_out = Some(at.number(1, LAST_OUTPUT)?),
            (path, name) => found.unknown.push(Unknown { line: at.line, name: format!("{path}/@{name}") }),
        }
        Ok(())
    }

    fn content(&mut self, content: &str, at: usize) -> Result<(), ChannelError> {
        if content.is_empty() {
            return Ok(());
        }
        let line = self.line(at);
        let path = self.path.iter().skip(1).map(String::as_str).collect::<Vec<_>>();
        let found = &mut self.found;
        match path.as_slice() {
            ["CONFIGURATION", side @ ("EXTERNAL" | "INTERNAL"), name @ ("IP" | "PORT")] => {
                let (address, port) = if *side == "EXTERNAL" { &mut found.external } else { &mut found.internal };
                if *name == "IP" {
                    *address = Some(content.to_owned());
                } else {
                    *port = u16::try_from(number(line, name, content, 1, 65_534)?).ok();
                }
            }
            ["CONFIGURATION", "EXTERNAL", name @ "TYPE"] => {
                let words = [("Client", Peer::Client), ("Server", Peer::Server)];
                found.peer = Some(word(line, name, content, &words, "Client, Server")?);
            }
            ["CONFIGURATION", "INTERNAL", name @ "ENVIRONMENT"] => {
                let words = [
                    ("Program", Environment::Program),
                    ("Submit", Environment::Submit),
                    ("System", Environment::System),
                ];
                found.environment = Some(word(line, name, content, &words, "Program, Submit, System")?);
            }
            ["CONFIGURATION", "INTERNAL", name @ "PROTOCOL"] => {
                let words = [("TCP", Protocol::Tcp), ("UDP", Protocol::Udp)];
                found.protocol = Some(word(line, name, content, &words, "TCP, UDP")?);
            }
            path => found.unknown.push(Unknown { line, name: format!("{}: \"{content}\"", path.join("/")) }),
        }
        Ok(())
    }
}

/// Elements that hold others, or nothing but attributes or text.
const KNOWN: [&str; 20] = [
    "",
    "CONFIGURATION",
    "CONFIGURATION/EXTERNAL",
    "CONFIGURATION/EXTERNAL/TYPE",
    "CONFIGURATION/EXTERNAL/IP",
    "CONFIGURATION/EXTERNAL/PORT",
    "CONFIGURATION/INTERNAL",
    "CONFIGURATION/INTERNAL/ENVIRONMENT",
    "CONFIGURATION/INTERNAL/BUFFERING",
    "CONFIGURATION/INTERNAL/BUFFSIZE",
    "CONFIGURATION/INTERNAL/TIMEOUT",
    "CONFIGURATION/INTERNAL/ALIVE",
    "CONFIGURATION/INTERNAL/IP",
    "CONFIGURATION/INTERNAL/PORT",
    "CONFIGURATION/INTERNAL/PROTOCOL",
    "CONFIGURATION/INTERNAL/MESSAGES",
    "RECEIVE",
    "RECEIVE/XML",
    "SEND",
    "SEND/XML",
];

fn checked(element: Element) -> Result<Element, ChannelError> {
    if element.tag.is_empty() {
        return Err(ChannelError::NoTag { line: element.line });
    }
    let is_name = |part: &str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c))
    };
    let parts: Vec<&str> = element.tag.split('/').collect();
    let (last, parents) = parts.split_last().unwrap_or((&"", &[]));
    let leaf = if parents.is_empty() { *last } else { last.strip_prefix('@').unwrap_or(last) };
    if !parents.iter().all(|part| is_name(part)) || !is_name(leaf) {
        return Err(ChannelError::Path { line: element.line, found: element.tag });
    }
    Ok(element)
}

fn number(line: usize, name: &str, found: &str, low: u32, high: u32) -> Result<u32, ChannelError> {
    found.parse().ok().filter(|number| (low..=high).contains(number)).ok_or_else(|| ChannelError::Number {
        line,
        name: name.to_owned(),
        found: found.to_owned(),
        low,
        high,
    })
}

fn word<T: Copy>(
    line: usize,
    name: &str,
    found: &str,
    words: &[(&str, T)],
    allowed: &'static str,
) -> Result<T, ChannelError> {
    let hit = words.iter().find(|(word, _)| word.eq_ignore_ascii_case(found));
    hit.map(|&(_, value)| value).ok_or_else(|| ChannelError::Word {
        line,
        name: name.to_owned(),
        found: found.to_owned(),
        allowed,
    })
}
