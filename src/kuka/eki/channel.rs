//! Reads a classic EthernetKRL file, which configures one communication channel of the controller. All other code of
//! the product uses this reader; only the mock controller has its own, so that each checks the other.
//!
//! One file configures one channel: which machine listens and at which address, how much is buffered, and which tags
//! are sent. `RECEIVE` and `SEND` are named from the controller's side. `TYPE` is the role of the other machine:
//! `Client` means that the controller listens.
//!
//! `tree` parses the text to a tree, and `manual` compares the tree with the manual and reports every problem with its
//! line. `stated` extracts the file's statements, each value with its line. [`ChannelFile`] is the channel that the
//! client uses: the statements, and the manual's defaults for everything that the file does not state. `panelprep
//! check` prints all problems and warnings; the client refuses a file with a problem, and a RAW channel.

mod manual;
mod stated;
mod tree;

pub use manual::{Environment, Findings, Kind, PeerRole, Protocol, ReadOrder};
use panelprep_base::config::Problem;
pub use stated::{Signal, Stated, StatedChannel, StatedElement, StatedRaw};

/// The manual's default values for entries that a file omits (`eki.md` 1.3).
const DEFAULT_MEMORY_ENTRIES: u32 = 16;
const DEFAULT_MEMORY_BYTES: u32 = 16_384;
const DEFAULT_PORT: u16 = 54_600;

/// The receive buffers of a channel: the controller has one buffer for each tag with a type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory {
    /// The order in which buffered values are read, unless a tag states another order.
    pub order: ReadOrder,
    /// Maximum number of values in each buffer; one more value closes the connection.
    pub entries: u32,
    /// Maximum number of bytes that are received and not yet parsed.
    pub bytes: u32,
}

/// A tag that is received or sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    /// The tag's path without a leading slash, for example `Cmd/@Id`.
    pub tag: String,
    /// The data type of the tag's value; `None` if the tag only sets a flag.
    pub kind: Option<Kind>,
    /// The read order of the tag's values, if it differs from the channel's order.
    pub order: Option<ReadOrder>,
    /// The number of the `$FLAG` that the controller sets when the element has arrived.
    pub set_flag: Option<u32>,
    /// The number of the `$OUT` that the controller sets when the element has arrived.
    pub set_out: Option<u32>,
    /// The line of the element in the file; the first line is 1.
    pub line: usize,
}

/// The configuration of one channel, parsed from an EthernetKRL file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelFile {
    /// The role of the other machine.
    pub peer: PeerRole,
    /// The address of the machine that listens: the controller's, or the other machine's if the controller connects.
    /// The text is not checked, because files often contain placeholders.
    pub address: Option<String>,
    /// The TCP port of the machine that listens.
    pub port: u16,
    /// The event on which the controller closes the channel.
    pub environment: Environment,
    /// The transport protocol of the channel.
    pub protocol: Protocol,
    /// The receive buffers of the channel.
    pub memory: Memory,
    /// Maximum time for which the controller tries to connect, or waits for a connection, ms.
    pub connect_timeout_ms: Option<u32>,
    /// The number of the `$FLAG` that is true while the channel is connected.
    pub alive_flag: Option<u32>,
    /// The number of the `$OUT` that is true while the channel is connected.
    pub alive_out: Option<u32>,
    /// The value of the attribute `Ping` of the element `ALIVE`, as written in the file.
    pub ping: Option<u32>,
    /// The tags that the controller receives, in the order of the file.
    pub received: Vec<Element>,
    /// The tags that the controller sends, in the order of the file.
    pub sent: Vec<Element>,
    /// The names and texts in the file that the manual does not define, in the order of the file.
    pub unknown: Vec<Problem>,
}

/// The reason why the client cannot use a file as a channel. Each reason names its line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ChannelError {
    /// The file has errors; this is the first of them.
    #[error("line {}: {}{}{}", .0.line, .0.key, if .0.key.is_empty() { "" } else { ": " }, .0.message)]
    Wrong(Problem),
    /// The file configures a RAW channel, which transfers bytes instead of tags.
    #[error("line {line}: found a RAW channel, which transfers bytes; this program supports only XML channels")]
    Raw {
        /// Line, from 1.
        line: usize,
    },
}

impl ChannelFile {
    /// Parses the text of a classic EthernetKRL file.
    ///
    /// # Errors
    /// If the file has an entry that the controller would refuse or this program cannot use; the error names the first
    /// one.
    pub fn parse(text: &str) -> Result<Self, ChannelError> {
        let (stated, found) = read("", text).map_err(ChannelError::Wrong)?;
        if let Some(first) = found.problems.into_iter().min_by_key(|problem| problem.line) {
            return Err(ChannelError::Wrong(first));
        }
        match stated.raw_line {
            Some(line) => Err(ChannelError::Raw { line }),
            None => Ok(ChannelFile::from_stated(&stated, found.unknown)),
        }
    }

    fn from_stated(stated: &StatedChannel, unknown: Vec<Problem>) -> Self {
        let server = stated.server();
        let signal =
            |is_flag| stated.alive.iter().find(|signal| signal.is_flag == is_flag).map(|signal| signal.number);
        ChannelFile {
            peer: stated.peer_role(),
            address: server.ip.as_ref().map(|ip| ip.value.clone()),
            port: server.port.map_or(DEFAULT_PORT, |port| port.value),
            environment: stated.environment.map_or(Environment::Program, |environment| environment.value),
            protocol: stated.protocol.map_or(Protocol::Tcp, |protocol| protocol.value),
            memory: Memory {
                order: stated.order.map_or(ReadOrder::Fifo, |order| order.value),
                entries: stated.entries.map_or(DEFAULT_MEMORY_ENTRIES, |entries| entries.value),
                bytes: stated.bytes.map_or(DEFAULT_MEMORY_BYTES, |bytes| bytes.value),
            },
            connect_timeout_ms: stated.connect_ms.map(|timeout| timeout.value),
            alive_flag: signal(true),
            alive_out: signal(false),
            ping: stated.ping.map(|ping| ping.value),
            received: stated.received.iter().map(Element::from_stated).collect(),
            sent: stated.sent.iter().map(Element::from_stated).collect(),
            unknown,
        }
    }
}

impl Element {
    fn from_stated(stated: &StatedElement) -> Self {
        let signal =
            |is_flag| stated.signals.iter().find(|signal| signal.is_flag == is_flag).map(|signal| signal.number);
        Element {
            tag: stated.tag.clone(),
            kind: stated.kind.as_ref().and_then(|kind| kind.parse().ok()),
            order: stated.order,
            set_flag: signal(true),
            set_out: signal(false),
            line: stated.line,
        }
    }
}

/// Returns the statements of a file, and every difference between the file and the manual; `name` is the file's name.
///
/// # Errors
/// If the text is not XML or not a classic EthernetKRL file.
pub fn read(name: &str, text: &str) -> Result<(StatedChannel, Findings), Problem> {
    let root = tree::tree(text)?;
    manual::is_classic_dialect(&root)?;
    let mut found = Findings::default();
    manual::check_against_manual(&root, &mut found);
    let stated = StatedChannel::from_xml(name, &root, &mut found);
    Ok((stated, found))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eki::{CELLCMD, CELLSTAT};

    /// Returns a minimal channel file. Line 3 has these elements in `INTERNAL`, and line 4 has these elements in
    /// `RECEIVE/XML`.
    fn file(internal: &str, received: &str) -> String {
        format!(
            "<ETHERNETKRL><CONFIGURATION>\n<EXTERNAL><TYPE>Client</TYPE></EXTERNAL>\n<INTERNAL>{internal}</INTERNAL>\n\
             </CONFIGURATION><RECEIVE><XML>{received}</XML></RECEIVE><SEND/></ETHERNETKRL>"
        )
    }

    #[test]
    fn the_shipped_files_state_role_port_and_tags() {
        let command = ChannelFile::parse(CELLCMD).expect("reads");
        assert_eq!(
            (command.peer, command.port, command.environment),
            (PeerRole::Client, 54_600, Environment::Submit)
        );
        assert_eq!(command.memory, Memory { order: ReadOrder::Fifo, entries: 512, bytes: 65_534 });
        assert_eq!(command.alive_flag, Some(850));
        let received: Vec<&str> = command.received.iter().map(|element| element.tag.as_str()).collect();
        assert_eq!(received[..3], ["Cmd/@Id", "Cmd/@Ep", "Cmd/@Op"]);
        assert_eq!(received[7..], ["Cmd/P", "Cmd"]);
        assert_eq!((command.received[7].kind, command.received[8].kind), (Some(Kind::Frame), None));
        assert_eq!((command.received[8].set_flag, command.received[8].line), (Some(851), 29));
        assert_eq!(command.sent.len(), 6);
        let state = ChannelFile::parse(CELLSTAT).expect("reads");
        assert_eq!((state.port, state.received.len(), state.sent.len()), (54_601, 5, 37));
        assert_eq!((command.unknown, state.unknown), (vec![], vec![]));
    }

    /// The manual's defaults apply to entries that the file omits. If the controller connects, the port is that of the
    /// other machine.
    #[test]
    fn values_that_a_file_does_not_state_have_the_manuals_default() {
        let silent = ChannelFile::parse(&file("", "")).expect("reads");
        assert_eq!(silent.memory, Memory { order: ReadOrder::Fifo, entries: 16, bytes: 16_384 });
        assert_eq!(
            (silent.port, silent.environment, silent.protocol),
            (54_600, Environment::Program, Protocol::Tcp)
        );
        let dials = "<ETHERNETKRL><CONFIGURATION><EXTERNAL><IP>192.168.1.2</IP><PORT>18735</PORT></EXTERNAL>\
                     <INTERNAL><IP>address.of.controller</IP><PORT>54605</PORT></INTERNAL></CONFIGURATION>\
                     <RECEIVE></RECEIVE></ETHERNETKRL>";
        let dials = ChannelFile::parse(dials).expect("reads");
        assert_eq!(
            (dials.peer, dials.port, dials.address.as_deref()),
            (PeerRole::Server, 18_735, Some("192.168.1.2"))
        );
    }

    #[test]
    fn keywords_are_read_in_any_case_and_unknown_names_are_listed() {
        let text = file(
            "<buffering mode=\"lifo\" LIMIT=\"15\"/><Sendflag>1</Sendflag><ALIVE ElementName=\"x\"/>",
            ";text",
        );
        let read = ChannelFile::parse(&text).expect("reads");
        assert_eq!((read.memory.order, read.memory.entries), (ReadOrder::Lifo, 15));
        let unknown: Vec<(usize, &str)> =
            read.unknown.iter().map(|unknown| (unknown.line, unknown.key.as_str())).collect();
        assert_eq!(
            unknown,
            [
                (3, "CONFIGURATION/INTERNAL/SENDFLAG"),
                (3, "CONFIGURATION/INTERNAL/ALIVE/@ElementName"),
                (4, "RECEIVE/XML")
            ]
        );
    }

    #[test]
    fn entries_that_the_controller_refuses_are_reported_with_their_line() {
        let cases = [
            (
                file("<BUFFERING Limit=\"513\"/>", ""),
                "line 3: CONFIGURATION/INTERNAL/BUFFERING/@Limit: is \"513\"; valid: a whole number 1 to 512",
            ),
            (
                file("<PORT>abc</PORT>", ""),
                "line 3: CONFIGURATION/INTERNAL/PORT: is \"abc\"; valid: a whole number 1 to 65534",
            ),
            (
                file("<ENVIRONMENT>Robot</ENVIRONMENT>", ""),
                "line 3: CONFIGURATION/INTERNAL/ENVIRONMENT: is \"Robot\"; valid: one of Program, Submit, System",
            ),
            (
                file("", "<ELEMENT Tag=\"A/@B\" Type=\"AXIS\"/>"),
                "line 4: RECEIVE/XML/ELEMENT[A/@B]/@Type: is \"AXIS\"; valid: one of STRING, REAL, INT, BOOL, FRAME; \
                 send axes as six REAL attributes or in a FRAME",
            ),
            (
                file("", "<ELEMENT Type=\"INT\"/>"),
                "line 4: RECEIVE/XML/ELEMENT: has no Tag; an element without this path transfers no data",
            ),
            (
                file("", "<ELEMENT Tag=\"/A\"/>"),
                "line 4: RECEIVE/XML/ELEMENT[/A]/@Tag: is \"/A\"; write the path as Root/Child or Root/Child/@Attribute",
            ),
            (
                file("", "<ELEMENT Tag=\"A\" tag=\"B\"/>"),
                "line 4: RECEIVE/XML/ELEMENT[A]/@tag: appears twice in one element; remove one of the two attributes",
            ),
            (
                "\n<EthernetKRL2></EthernetKRL2>".to_owned(),
                "line 2: EthernetKRL2: the root element is EthernetKRL2; the root element of an EthernetKRL file is \
                 ETHERNETKRL",
            ),
            ("<ETHERNETKRL>\n<SEND>".to_owned(), "line 2: not XML: SEND is never closed"),
            (
                "<ETHERNETKRL><RECEIVE>\n<RAW><ELEMENT/></RAW></RECEIVE></ETHERNETKRL>".to_owned(),
                "line 2: found a RAW channel, which transfers bytes; this program supports only XML channels",
            ),
        ];
        for (text, verdict) in cases {
            let error = ChannelFile::parse(&text).expect_err(&text);
            assert_eq!(error.to_string(), verdict);
        }
        for text in ["", "<A", "<ETHERNETKRL></B>", "<!DOCTYPE a><ETHERNETKRL/>"] {
            assert!(ChannelFile::parse(text).is_err(), "{text}");
        }
    }
}
