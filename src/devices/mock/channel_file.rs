//! The mock's parser for EthernetKRL configuration files: buffers, flags, received and sent elements.
//!
//! Sections and attributes are those of the classic dialect. Unknown ones are ignored, as the controller does. This
//! file also defines the errors that EthernetKRL reports to the program, the faults that close a channel, and the
//! errors that prevent the mock from starting.

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

/// The data type of a received element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ElementKind {
    Int,
    Real,
    Bool,
    Text,
    Frame,
}

/// The order in which the values in a tag's buffer are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ReadOrder {
    /// The oldest value is read first.
    Fifo,
    /// The newest value is read first.
    Lifo,
}

/// The event on which the controller closes a channel, in addition to a new I/O configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Environment {
    /// The robot program is deselected or reset.
    Program,
    /// The submit program is cancelled.
    Submit,
    /// The channel stays open until the controller is shut down.
    System,
}

/// A received or sent element. The tag `Root/Child/@Name` names an attribute; a tag without `@` names the node itself.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Element {
    /// The tag as written in the file.
    pub(super) tag: String,
    /// The data type; `None` if the element only sets a flag.
    pub(super) kind: Option<ElementKind>,
    /// The read order of this element, if it differs from the channel's order.
    pub(super) order: Option<ReadOrder>,
    /// The numbers of the `$FLAG` and `$OUT` that are set when the element has arrived.
    pub(super) set_flag: Option<u16>,
    pub(super) set_out: Option<u16>,
    /// The position of `/@` in the tag.
    attribute_position: Option<usize>,
}

impl Element {
    /// Creates an element that sets no flag or output.
    pub(super) fn new(tag: &str, kind: Option<ElementKind>) -> Self {
        let split = tag.find("/@");
        Element { tag: tag.to_owned(), kind, order: None, set_flag: None, set_out: None, attribute_position: split }
    }

    /// Returns the path of the node, and the name of the attribute if the element is an attribute.
    pub(super) fn address(&self) -> (&str, Option<&str>) {
        match self.attribute_position {
            Some(at) => (&self.tag[..at], Some(&self.tag[at + 2..])),
            None => (&self.tag, None),
        }
    }
}

/// One channel's configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelFile {
    /// Maximum number of values in the buffer of each tag; one more value closes the connection.
    pub(super) limit_entries: usize,
    /// The order in which values are read, unless a tag states another order.
    pub(super) order: ReadOrder,
    /// Maximum number of bytes of an incomplete document.
    pub(super) limit_bytes: usize,
    /// The TCP port on which the controller listens.
    pub(super) port: u16,
    pub(super) environment: Environment,
    /// How long an open channel waits for a client, ms; `None` if it waits without limit.
    pub(super) listens_for_ms: Option<u64>,
    /// The numbers of the `$FLAG` and `$OUT` that are true while a client is connected.
    pub(super) alive: (Option<u16>, Option<u16>),
    pub(super) received: Vec<Element>,
    pub(super) sent: Vec<Element>,
}

impl ChannelFile {
    /// Returns the TCP port that the file states.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// Parses the text of an EthernetKRL file.
    ///
    /// # Errors
    /// If the text is not XML, has no RECEIVE or SEND elements, or contains an invalid number or keyword.
    pub fn parse(text: &str) -> Result<Self, FileProblem> {
        // The controller's defaults: 16 entries, 16384 bytes, port 54600.
        let mut file = ChannelFile {
            limit_entries: 16,
            order: ReadOrder::Fifo,
            limit_bytes: 16_384,
            port: 54_600,
            environment: Environment::Program,
            listens_for_ms: None,
            alive: (None, None),
            received: Vec::new(),
            sent: Vec::new(),
        };
        let mut reader = Reader::from_str(text);
        let mut path: Vec<String> = Vec::new();
        loop {
            match reader.read_event().map_err(|error| FileProblem::Xml(error.to_string()))? {
                Event::Start(node) => {
                    path.push(node.name().into_inner().to_owned());
                    file.read_element(&path, &node)?;
                }
                Event::Empty(node) => {
                    path.push(node.name().into_inner().to_owned());
                    file.read_element(&path, &node)?;
                    path.pop();
                }
                Event::Text(text) => file.read_value(&path, text.into_inner().trim())?,
                Event::End(_) => {
                    path.pop();
                }
                Event::Eof => break,
                _ => {}
            }
        }
        match (file.received.is_empty(), file.sent.is_empty()) {
            (true, _) => Err(FileProblem::Missing("RECEIVE elements")),
            (_, true) => Err(FileProblem::Missing("SEND elements")),
            _ => Ok(file),
        }
    }

    fn read_element(&mut self, path: &[String], node: &BytesStart<'_>) -> Result<(), FileProblem> {
        let names: Vec<&str> = path.iter().map(String::as_str).collect();
        match names[..] {
            ["ETHERNETKRL", "CONFIGURATION", "INTERNAL", "BUFFERING"] => {
                self.limit_entries = count(node, "Limit")?.unwrap_or(self.limit_entries);
                self.order = parse_read_order(node)?.unwrap_or(self.order);
            }
            ["ETHERNETKRL", "CONFIGURATION", "INTERNAL", "BUFFSIZE"] => {
                self.limit_bytes = count(node, "Limit")?.unwrap_or(self.limit_bytes);
            }
            ["ETHERNETKRL", "CONFIGURATION", "INTERNAL", "TIMEOUT"] => {
                self.listens_for_ms = count(node, "Connect")?
            }
            ["ETHERNETKRL", "CONFIGURATION", "INTERNAL", "ALIVE"] => {
                self.alive = (count(node, "Set_Flag")?, count(node, "Set_Out")?);
            }
            ["ETHERNETKRL", "RECEIVE", "XML", "ELEMENT"] => self.received.push(element(node)?),
            ["ETHERNETKRL", "SEND", "XML", "ELEMENT"] => self.sent.push(element(node)?),
            _ => {}
        }
        Ok(())
    }

    fn read_value(&mut self, path: &[String], text: &str) -> Result<(), FileProblem> {
        let names: Vec<&str> = path.iter().map(String::as_str).collect();
        match (&names[..], text) {
            (["ETHERNETKRL", "CONFIGURATION", "INTERNAL", "PORT"], _) => self.port = number("PORT", text)?,
            (["ETHERNETKRL", "CONFIGURATION", "INTERNAL", "ENVIRONMENT"], _) => {
                self.environment = match text {
                    "Program" => Environment::Program,
                    "Submit" => Environment::Submit,
                    "System" => Environment::System,
                    _ => return Err(invalid_word("ENVIRONMENT", text, "Program, Submit or System")),
                };
            }
            _ => {}
        }
        Ok(())
    }
}

fn count<N: std::str::FromStr>(node: &BytesStart<'_>, name: &str) -> Result<Option<N>, FileProblem> {
    attribute(node, name)?.map(|text| number(name, &text)).transpose()
}

fn parse_read_order(node: &BytesStart<'_>) -> Result<Option<ReadOrder>, FileProblem> {
    match attribute(node, "Mode")?.as_deref() {
        None => Ok(None),
        Some("FIFO") => Ok(Some(ReadOrder::Fifo)),
        Some("LIFO") => Ok(Some(ReadOrder::Lifo)),
        Some(other) => Err(invalid_word("Mode", other, "FIFO or LIFO")),
    }
}

fn element(node: &BytesStart<'_>) -> Result<Element, FileProblem> {
    let tag = attribute(node, "Tag")?.ok_or(FileProblem::Missing("Tag in an ELEMENT"))?;
    let kind = match attribute(node, "Type")?.as_deref() {
        None => None,
        Some("INT") => Some(ElementKind::Int),
        Some("REAL") => Some(ElementKind::Real),
        Some("BOOL") => Some(ElementKind::Bool),
        Some("STRING") => Some(ElementKind::Text),
        Some("FRAME") => Some(ElementKind::Frame),
        Some(other) => return Err(FileProblem::Type { tag, found: other.to_owned() }),
    };
    let (set_flag, set_out) = (count(node, "Set_Flag")?, count(node, "Set_Out")?);
    Ok(Element { order: parse_read_order(node)?, set_flag, set_out, ..Element::new(&tag, kind) })
}

fn attribute(node: &BytesStart<'_>, name: &str) -> Result<Option<String>, FileProblem> {
    for attribute in node.attributes() {
        let attribute = attribute.map_err(|error| FileProblem::Xml(error.to_string()))?;
        if attribute.key.into_inner() == name {
            let value = attribute.normalized_value(XmlVersion::Implicit1_0);
            return value
                .map(|value| Some(value.into_owned()))
                .map_err(|error| FileProblem::Xml(error.to_string()));
        }
    }
    Ok(None)
}

fn number<N: std::str::FromStr>(name: &str, found: &str) -> Result<N, FileProblem> {
    found.parse().map_err(|_| FileProblem::Number { name: name.to_owned(), found: found.to_owned() })
}

fn invalid_word(name: &'static str, found: &str, allowed: &'static str) -> FileProblem {
    FileProblem::Word { name, found: found.to_owned(), allowed }
}

/// The error number that a read function of EthernetKRL reports to the program (`Msg_No`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EkiError {
    /// The buffer of the tag is empty; the function does not wait.
    #[error("15: access to an empty memory")]
    Empty,
    /// The buffer of the tag contains values of another type.
    #[error("20: the memory contains values of another type")]
    Type,
}

/// The reason why a channel was closed; a reception error has the number that the controller logs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EkiFault {
    /// The connection was disrupted.
    #[error("512: connection disrupted")]
    Disrupted,
    /// The client does not respond.
    #[error("768: no response from the other system")]
    NoContact,
    /// The document is not XML, or a value does not have the type of its element.
    #[error("1024: error reading received XML")]
    Malformed,
    /// More bytes than BUFFSIZE were received without the end of a document.
    #[error("1024: more bytes than BUFFSIZE without the end of a document")]
    TooLong,
    /// The buffer of a tag received more values than the limit of BUFFERING.
    #[error("1280: memory limit reached")]
    Overflow,
    /// A text is too long for a KRL string.
    #[error("1536: string too long")]
    TextTooLong,
    /// No client connected within TIMEOUT; the channel does not listen any more until the program opens it again.
    #[error("2048: server time limit reached")]
    TimeLimit,
    /// The robot program could not read a value that it needs, and closed the channel.
    #[error("the robot program closed the EKI channel: {0}; start the program again")]
    Unread(EkiError),
    /// The robot program read values of different documents in one row, and closed the channel.
    #[error(
        "the robot program closed the EKI channel: an element was missing, so the buffers of the tags contain values \
         of different messages; start the program again"
    )]
    Drifted,
}

/// The reason why the mock controller cannot start.
#[derive(Debug, thiserror::Error)]
pub enum MockError {
    /// A program or data list of the controller has errors.
    #[error("{0}")]
    Program(String),
    /// An EthernetKRL file does not satisfy the mock's requirements.
    #[error("{channel}.xml: {problem}")]
    File {
        /// CELLCMD or CELLSTAT.
        channel: &'static str,
        /// The problem.
        problem: FileProblem,
    },
    /// The mock cannot listen on a port.
    #[error("cannot listen on {address}: {reason}")]
    Listen {
        /// The address.
        address: std::net::SocketAddr,
        /// The system's error.
        reason: std::io::Error,
    },
    /// The operating system cannot start a thread.
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
}

/// The reason why the mock cannot use an EthernetKRL file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FileProblem {
    /// The file is not XML.
    #[error("is not XML: {0}")]
    Xml(String),
    /// A required section is missing.
    #[error("has no {0}")]
    Missing(&'static str),
    /// The text of an attribute or element is not a number.
    #[error("{name} is \"{found}\"; valid: a whole number")]
    Number {
        /// The name of the attribute or element.
        name: String,
        /// The text found.
        found: String,
    },
    /// A text is not one of the valid keywords.
    #[error("{name} is \"{found}\"; valid: {allowed}")]
    Word {
        /// The name of the attribute or element.
        name: &'static str,
        /// The text found.
        found: String,
        /// The valid words.
        allowed: &'static str,
    },
    /// An element has a type that the controller does not know.
    #[error("the element {tag} has the type \"{found}\"; valid: INT, REAL, BOOL, STRING, FRAME or no type")]
    Type {
        /// The element.
        tag: String,
        /// Its type.
        found: String,
    },
    /// The file does not receive an element that the controller's program reads.
    #[error("does not receive {0} in the form that the program reads")]
    NotReceived(&'static str),
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values: the channel settings in config/kuka, read from the files by a person.
    #[test]
    fn the_shipped_files_are_read() {
        let commands = ChannelFile::parse(include_str!("../../../config/kuka/CELLCMD.xml")).expect("read");
        assert_eq!((commands.limit_entries, commands.limit_bytes, commands.port), (512, 65_534, 54_600));
        assert_eq!((commands.environment, commands.alive), (Environment::Submit, (Some(850), None)));
        assert_eq!(commands.received.len(), 9);
        assert_eq!(commands.received[7], Element::new("Cmd/P", Some(ElementKind::Frame)));
        assert_eq!(commands.received[7].address(), ("Cmd/P", None));
        assert_eq!((commands.received[8].kind, commands.received[8].set_flag), (None, Some(851)));
        assert_eq!(commands.sent[4].address(), ("Ack", Some("ErrId")));
        let state = ChannelFile::parse(include_str!("../../../config/kuka/CELLSTAT.xml")).expect("read");
        assert_eq!((state.limit_entries, state.port, state.sent.len()), (64, 54_601, 37));
        assert_eq!(state.sent[36].address(), ("St/Tool", Some("C")));
    }

    #[test]
    fn each_error_of_a_file_is_reported() {
        let file = |inside: &str| ChannelFile::parse(&format!("<ETHERNETKRL>{inside}</ETHERNETKRL>"));
        assert_eq!(file(""), Err(FileProblem::Missing("RECEIVE elements")));
        let odd = "<RECEIVE><XML><ELEMENT Tag=\"A/@B\" Type=\"AXIS\"/></XML></RECEIVE>";
        assert_eq!(file(odd), Err(FileProblem::Type { tag: "A/@B".to_owned(), found: "AXIS".to_owned() }));
        let many = "<CONFIGURATION><INTERNAL><BUFFERING Limit=\"many\"/></INTERNAL></CONFIGURATION>";
        assert_eq!(file(many), Err(FileProblem::Number { name: "Limit".to_owned(), found: "many".to_owned() }));
        let pile = "<CONFIGURATION><INTERNAL><BUFFERING Mode=\"PILE\"/></INTERNAL></CONFIGURATION>";
        assert_eq!(file(pile), Err(invalid_word("Mode", "PILE", "FIFO or LIFO")));
        assert!(matches!(ChannelFile::parse("<a"), Err(FileProblem::Xml(_))));
    }
}
