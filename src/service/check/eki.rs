//! Checks classic EthernetKRL files, of this program or of other authors: errors, pitfalls, and a description of the
//! channel.
//!
//! The reader (`eki::channel`) already reports everything that differs from the manual. This module adds:
//!
//! - the pitfalls of `eki.md` 6, which the controller accepts although they lead to problems, and properties that
//!   cannot work;
//! - conflicts between the channels of one controller: the same name, port, flag or output, and different addresses of
//!   the controller;
//! - a description of the channel, one sentence for each property.
//!
//! The facts are in `eki.md` 1 and 6. RAW channels, channels on which the controller connects as a client, and unknown
//! names are read as well, and all problems are reported.
//!
//! This module does not check the newer dialect of EthernetKRL 6; it only reports that a file is written in this
//! dialect.

use panelprep_base::config::Problem;
use panelprep_kuka::eki::channel::{
    Environment, Findings, Protocol, ReadOrder, Signal, Stated, StatedChannel, StatedElement, StatedRaw, read,
};
use std::collections::{BTreeMap, BTreeSet};

/// The result of the check of one EthernetKRL file.
pub(super) struct EkiCheckResult {
    /// Properties that the controller refuses or with which it cannot work.
    pub(super) problems: Vec<Problem>,
    /// Properties that the controller accepts although they lead to problems.
    pub(super) warnings: Vec<Problem>,
    /// Description of the channel, one sentence for each property.
    pub(super) descriptions: Vec<String>,
    /// The channel; `None` if the file is not a channel.
    pub(super) channel: Option<StatedChannel>,
}

/// Checks one EthernetKRL file by itself; `name` is the file's name in messages.
pub(super) fn check_eki_file(name: &str, text: &str) -> EkiCheckResult {
    let (channel, mut found) = match read(name, text) {
        Ok(read) => read,
        Err(problem) => {
            return EkiCheckResult {
                problems: vec![problem],
                warnings: vec![],
                descriptions: vec![],
                channel: None,
            };
        }
    };
    find_pitfalls(&channel, &mut found);
    let says = describe_channel(&channel);
    let Findings { mut problems, mut warnings, .. } = found;
    problems.sort_by_key(|problem| problem.line);
    warnings.sort_by_key(|warning| warning.line);
    EkiCheckResult { problems, warnings, descriptions: says, channel: Some(channel) }
}

/// The ports that the controller's firewall opens.
const FIREWALL_PORTS: std::ops::RangeInclusive<u16> = 54_600..=54_615;
/// First number that no `$FLAG` of KRL has: flags end at 1024. The manual's range for Set_Flag includes 1025, therefore
/// 1025 gives only a warning; larger numbers are problems.
const FIRST_INVALID_FLAG: u32 = 1025;

/// Adds to `found` the pitfalls that can be detected in the file of one channel.
fn find_pitfalls(channel: &StatedChannel, found: &mut Findings) {
    check_addresses(channel, found);
    check_lifetime(channel, found);
    check_buffers(channel, found);
    check_signals(channel, found);
    check_elements(channel, found);
    check_raw_elements(channel, found);
}

fn check_addresses(channel: &StatedChannel, found: &mut Findings) {
    let internal_line = channel.internal_line;
    if !channel.type_stated {
        let message = "is not stated: the controller assumes Server, connects to the other machine and does not \
                       listen; write Client if the PC connects";
        found.warn(1, "CONFIGURATION/EXTERNAL/TYPE", message);
    }
    if channel.does_controller_listen() {
        match &channel.internal.port {
            Some(port) if !FIREWALL_PORTS.contains(&port.value) => found.add_problem(
                port.line,
                "CONFIGURATION/INTERNAL/PORT",
                format!("is {}; the controller's firewall lets only ports 54600 to 54615 through", port.value),
            ),
            Some(_) => {}
            None => found.warn(
                internal_line,
                "CONFIGURATION/INTERNAL/PORT",
                "is not stated: the controller assumes 54600, which another channel may use",
            ),
        }
        let ignored = [
            ("IP", channel.external.ip.as_ref().map(|ip| ip.line)),
            ("PORT", channel.external.port.as_ref().map(|port| port.line)),
        ];
        for (name, line) in ignored.into_iter().filter_map(|(name, line)| Some((name, line?))) {
            let message =
                "is not used: TYPE is Client, so the other machine connects; only the address in INTERNAL is used";
            found.warn(line, format!("CONFIGURATION/EXTERNAL/{name}"), message);
        }
    } else {
        let missing = [("IP", channel.external.ip.is_none()), ("PORT", channel.external.port.is_none())];
        for (name, _) in missing.into_iter().filter(|(_, missing)| *missing) {
            let message = "is missing; the controller connects to the other machine and needs its address";
            found.add_problem(1, format!("CONFIGURATION/EXTERNAL/{name}"), message);
        }
    }
    let side = if channel.does_controller_listen() { "INTERNAL" } else { "EXTERNAL" };
    if let Some(ip) = &channel.server().ip
        && !is_address(&ip.value)
    {
        let message = format!(
            "is \"{}\", which is not an address such as 172.31.1.147; if it is a placeholder, replace it",
            ip.value
        );
        found.warn(ip.line, format!("CONFIGURATION/{side}/IP"), message);
    }
    if let Some(udp) = channel.protocol.filter(|protocol| protocol.value == Protocol::Udp) {
        let message =
            "is UDP, which the manual does not recommend: messages may be lost, duplicated or out of order";
        found.warn(udp.line, "CONFIGURATION/INTERNAL/PROTOCOL", message);
    }
    if let Some(wait) = channel.connect_ms.as_ref().filter(|_| channel.does_controller_listen()) {
        let message = format!(
            "stops the channel after {} ms without a client (error 2048); without this attribute, the controller waits \
             without limit",
            wait.value
        );
        found.warn(wait.line, "CONFIGURATION/INTERNAL/TIMEOUT/@Connect", message);
    }
}

/// Returns whether the text is an IPv4 address.
fn is_address(text: &str) -> bool {
    let parts: Vec<&str> = text.split('.').collect();
    parts.len() == 4 && parts.iter().all(|part| part.parse::<u8>().is_ok())
}

fn check_lifetime(channel: &StatedChannel, found: &mut Findings) {
    let key = "CONFIGURATION/INTERNAL/ENVIRONMENT";
    let consequence = "the channel is deleted when the program is reset or deselected, which disconnects the client. \
                       Set Submit or System for the channels of state and abort";
    match &channel.environment {
        Some(stated) if stated.value == Environment::Program => {
            found.warn(stated.line, key, format!("is Program: {consequence}"))
        }
        Some(_) => {}
        None => found.warn(
            channel.internal_line,
            key,
            format!("is not stated, so the default, Program, applies: {consequence}"),
        ),
    }
    if !channel.signals().any(|signal| signal.tag.is_none()) {
        let message = "sets no flag and no output: the program cannot detect that a client connects or disconnects";
        found.warn(channel.alive_line.unwrap_or(channel.internal_line), "CONFIGURATION/INTERNAL/ALIVE", message);
    }
}

fn check_buffers(channel: &StatedChannel, found: &mut Findings) {
    let key = "CONFIGURATION/INTERNAL/BUFFERING";
    if channel.entries.is_none() && !channel.received.is_empty() {
        let message = "states no Limit: each memory has 16 entries, and the 17th entry closes the connection instead \
                       of waiting; the maximum Limit is 512";
        found.warn(channel.internal_line, format!("{key}/@Limit"), message);
    }
    let lifo = channel.order.filter(|order| order.value == ReadOrder::Lifo).map(|lifo| (lifo.line, key.to_owned()));
    let own = channel.received.iter().filter(|element| element.order == Some(ReadOrder::Lifo));
    let own = own.map(|element| (element.line, format!("RECEIVE/XML/ELEMENT[{}]", element.tag)));
    for (line, key) in lifo.into_iter().chain(own) {
        let message = "reads the newest entry first: read values of several tags between EKI_Lock and EKI_Unlock, \
                       otherwise they may come from different messages";
        found.warn(line, format!("{key}/@Mode"), message);
    }
}

fn check_signals(channel: &StatedChannel, found: &mut Findings) {
    for (index, signal) in channel.signals().enumerate() {
        let key = signal.key();
        let same = |other: &&Signal| other.variable() == signal.variable();
        if let Some(other) = channel.signals().take(index).find(same) {
            let message = format!(
                "{} is also set by {} (line {}); the program cannot distinguish the two",
                signal.variable(),
                other.describe_cause(),
                other.line
            );
            found.add_problem(signal.line, &key, message);
        }
        if signal.is_flag && signal.number == FIRST_INVALID_FLAG {
            found.warn(signal.line, &key, "$FLAG ends at 1024, though the manual allows 1025; use a lower number");
        }
    }
}

fn check_elements(channel: &StatedChannel, found: &mut Findings) {
    if channel.received.is_empty() && channel.raw.is_empty() && channel.sent.is_empty() {
        found.warn(1, "RECEIVE", "neither RECEIVE nor SEND has an ELEMENT: the channel carries no data");
    }
    check_duplicates("RECEIVE", &channel.received, found);
    check_duplicates("SEND", &channel.sent, found);
    let raises = |tag: &str| channel.signals().any(|signal| signal.tag.as_deref() == Some(tag));
    for element in &channel.received {
        let key = format!("RECEIVE/XML/ELEMENT[{}]", element.tag);
        let is_attribute = element.tag_below_root().contains('@');
        match element.kind.as_deref() {
            None if !raises(&element.tag) => {
                let message = "has neither Type nor flag nor output: received data is neither stored nor reported";
                found.warn(element.line, &key, message);
            }
            Some("FRAME") if is_attribute => {
                let message = "is a FRAME in an attribute; a FRAME is an element with the attributes X Y Z A B C";
                found.add_problem(element.line, &key, message);
            }
            _ => {}
        }
        let below = format!("{}/@", element.tag);
        if element.kind.as_deref() == Some("FRAME")
            && let Some(part) = channel.received.iter().find(|other| other.tag.starts_with(&below))
        {
            let message =
                format!("is a FRAME, but {} (line {}) is defined as a part of this FRAME", part.tag, part.line);
            found.warn(element.line, &key, message);
        }
    }
    check_root_flags(channel, found);
}

/// Warns if no flag indicates that a whole message has arrived. The flag of a root element does; the flag of a leaf
/// element only indicates that the message contained this leaf.
fn check_root_flags(channel: &StatedChannel, found: &mut Findings) {
    let mut seen = BTreeSet::new();
    for element in channel.received.iter().filter(|element| !element.tag_below_root().is_empty()) {
        let root = element.root();
        let raised: Vec<&str> = channel.signals().filter_map(|signal| signal.tag.as_deref()).collect();
        if !seen.insert(root) || raised.iter().any(|tag| contains_all_data(channel, root, tag)) {
            continue;
        }
        let inside = format!("{root}/");
        let message = match raised.iter().find(|tag| tag.starts_with(&inside)) {
            Some(leaf) => format!(
                "no flag is set when a whole <{root}> has arrived: a message without {leaf} does not set the flag of \
                 this element; add <ELEMENT Tag=\"{root}\" Set_Flag=\"…\"/>"
            ),
            None => format!(
                "no flag is set when a <{root}> has arrived; call EKI_CheckBuffer cyclically in the program, or add \
                 <ELEMENT Tag=\"{root}\" Set_Flag=\"…\"/>"
            ),
        };
        found.warn(element.line, format!("RECEIVE/XML/ELEMENT[{root}]"), message);
    }
}

/// Returns whether the element with this tag contains all data of this root element, so that its flag indicates that
/// all data have arrived.
fn contains_all_data(channel: &StatedChannel, root: &str, tag: &str) -> bool {
    let inside = format!("{tag}/");
    let mut data = channel.received.iter().filter(|element| element.root() == root && element.kind.is_some());
    tag == root || (!tag.contains('@') && data.all(|element| element.tag.starts_with(&inside)))
}

fn check_duplicates(section: &str, elements: &[StatedElement], found: &mut Findings) {
    let mut first: BTreeMap<&str, &StatedElement> = BTreeMap::new();
    for element in elements {
        let Some(other) = first.get(element.tag.as_str()) else {
            first.insert(&element.tag, element);
            continue;
        };
        let (key, line) = (format!("{section}/XML/ELEMENT[{}]", element.tag), other.line);
        if element.kind.is_some() && other.kind.is_some() && element.kind != other.kind {
            found.add_problem(
                element.line,
                key,
                format!("is defined twice with different types (line {line}); both share one memory"),
            );
        } else {
            found.warn(element.line, key, format!("is defined twice (line {line}); both share one memory"));
        }
    }
}

fn check_raw_elements(channel: &StatedChannel, found: &mut Findings) {
    let key = "RECEIVE/RAW/ELEMENT";
    for second in channel.raw.iter().skip(1) {
        found.add_problem(second.line, key, "a channel has at most one RAW element");
    }
    for raw in &channel.raw {
        if !channel.received.is_empty() {
            found.add_problem(raw.line, key, "XML and RAW cannot be mixed on one channel");
        }
        if raw.is_stream && raw.end.is_none() {
            found.add_problem(raw.line, key, "is a STREAM without EOS: the end of a text is not defined");
        }
        if !raw.is_stream && raw.size.is_none() {
            found.add_problem(raw.line, key, "is of type BYTE without Size: the length of a record is not defined");
        }
    }
}

/// Returns the ports and signals that two channels use: one problem for each of the two channels, with the index of the
/// channel in the list.
pub(super) fn find_clashes(channels: &[(usize, &str, &StatedChannel)]) -> Vec<(usize, Problem)> {
    let mut found = Vec::new();
    for (nth, (place, _, channel)) in channels.iter().enumerate() {
        for (other_nth, (_, other_file, other)) in channels.iter().enumerate() {
            if nth != other_nth {
                found.extend(compare_pair(channel, other_file, other).into_iter().map(|problem| (*place, problem)));
            }
        }
    }
    found
}

/// Returns a warning for each channel on which the controller listens at another address than on the first channel. A
/// controller usually has only one network for this purpose.
pub(super) fn differing_address_warnings(channels: &[(usize, &str, &StatedChannel)]) -> Vec<(usize, Problem)> {
    let listening = channels.iter().filter(|(_, _, channel)| channel.does_controller_listen());
    let mut stated = listening.filter_map(|(place, file, channel)| {
        let ip = channel.internal.ip.as_ref().filter(|ip| is_address(&ip.value))?;
        Some((*place, *file, ip))
    });
    let Some((_, first_file, first)) = stated.next() else { return Vec::new() };
    let others = stated.filter(|(_, _, ip)| ip.value != first.value);
    let warning = |(place, _, ip): (usize, &str, &Stated<String>)| {
        let message = format!(
            "is {}, and {first_file} has {}: the controller listens on the network adapter with this address; if no \
             adapter has this address, EKI_Open fails, and a PC that connects to the other address finds no open port",
            ip.value, first.value
        );
        (place, Problem { line: ip.line, key: "CONFIGURATION/INTERNAL/IP".to_owned(), message })
    };
    others.map(warning).collect()
}

fn compare_pair(channel: &StatedChannel, other_file: &str, other: &StatedChannel) -> Vec<Problem> {
    let mut found = Vec::new();
    let mut note = |line: usize, key: String, message: String| found.push(Problem { line, key, message });
    if channel.name.eq_ignore_ascii_case(&other.name) {
        let message = format!(
            "{other_file} also defines the channel {}; rename one of the files, because KRL uses the file's name as \
             the channel's name",
            other.name
        );
        note(1, String::new(), message);
    }
    if channel.does_controller_listen() && other.does_controller_listen() {
        let port = |channel: &StatedChannel| channel.internal.port.as_ref().map_or(54_600, |port| port.value);
        if port(channel) == port(other) {
            let line = channel.internal.port.as_ref().map_or(channel.internal_line, |port| port.line);
            let message = format!(
                "is {}, as in {other_file}; each channel needs its own port: while one of the two is open, EKI_Open of \
                 the other fails with \"Create server failed\"",
                port(channel)
            );
            note(line, "CONFIGURATION/INTERNAL/PORT".to_owned(), message);
        }
    }
    for signal in channel.signals() {
        let same = other.signals().find(|theirs| theirs.variable() == signal.variable());
        if let Some(theirs) = same {
            let message = format!(
                "{} is also set by {} in {other_file} (line {})",
                signal.variable(),
                theirs.describe_cause(),
                theirs.line
            );
            note(signal.line, signal.key(), message);
        }
    }
    found
}

/// Describes the channel, one sentence for each property.
fn describe_channel(channel: &StatedChannel) -> Vec<String> {
    let mut descriptions = vec![describe_listener(channel), describe_lifetime(channel), describe_buffers(channel)];
    descriptions.extend(
        channel
            .signals()
            .filter(|signal| signal.tag.is_none())
            .map(|signal| format!("{} is true while the other system is connected", signal.variable())),
    );
    descriptions.push(match &channel.ping {
        Some(ping) => format!("the connection is monitored (Ping {})", ping.value),
        None => "no Ping: EthernetKRL itself does not detect a disconnected cable".to_owned(),
    });
    let [logging, display] = &channel.messages;
    if logging.is_some() || display.is_some() {
        let word = |word: &Option<String>| word.clone().unwrap_or_else(|| "by the controller's default".to_owned());
        descriptions.push(format!(
            "messages: Logging {}, Display on the smartPAD {}",
            word(logging),
            word(display)
        ));
    }
    descriptions.extend(describe_roots("receives", &channel.received));
    descriptions.extend(channel.raw.iter().map(describe_raw));
    for signal in channel.signals() {
        if let Some(tag) = &signal.tag {
            let inside = format!("{tag}/");
            let whole = channel.received.iter().any(|element| element.tag.starts_with(&inside));
            let when = if whole { format!("a whole <{tag}>") } else { tag.clone() };
            descriptions
                .push(format!("{} is set when {when} has arrived; the program resets it", signal.variable()));
        }
    }
    descriptions.extend(describe_roots("sends", &channel.sent));
    if channel.received.is_empty() && channel.raw.is_empty() {
        descriptions.push("receives nothing".to_owned());
    }
    if channel.sent.is_empty() {
        descriptions.push("has no elements to send; EKI_Send can send a plain text".to_owned());
    }
    descriptions
}

fn describe_listener(channel: &StatedChannel) -> String {
    let server = channel.server();
    let ip = server.ip.as_ref().map(|ip| ip.value.as_str());
    let protocol = channel.protocol.map_or(Protocol::Tcp, |protocol| protocol.value);
    let port = server.port.as_ref().map(|port| port.value);
    if channel.does_controller_listen() {
        let port = port.map_or("54600, not stated".to_owned(), |port| port.to_string());
        format!(
            "channel {}: the controller listens on {}, port {port}, {protocol}, and accepts one client",
            channel.name,
            ip.unwrap_or("its own address")
        )
    } else {
        let port = port.map_or("not stated".to_owned(), |port| port.to_string());
        let gives_up = channel.connect_ms.as_ref().map_or(2000, |connect| connect.value);
        format!(
            "channel {}: the controller connects to {}, port {port}, {protocol}, and gives up after {gives_up} ms",
            channel.name,
            ip.unwrap_or("an address that is not stated")
        )
    }
}

fn describe_lifetime(channel: &StatedChannel) -> String {
    let until = match channel.environment.map_or(Environment::Program, |stated| stated.value) {
        Environment::Submit => "the submit interpreter is cancelled or the inputs and outputs are reconfigured",
        Environment::System => "the inputs and outputs are reconfigured",
        Environment::Program => "the program is reset or deselected, or the inputs and outputs are reconfigured",
    };
    format!("the channel exists until {until}")
}

fn describe_buffers(channel: &StatedChannel) -> String {
    let entries = channel.entries.as_ref().map_or(16, |entries| entries.value);
    let bytes = channel.bytes.as_ref().map_or(16_384, |bytes| bytes.value);
    let order = match channel.order.map_or(ReadOrder::Fifo, |order| order.value) {
        ReadOrder::Fifo => "oldest",
        ReadOrder::Lifo => "newest",
    };
    format!(
        "at most {entries} entries of each tag wait for the program, the {order} entry is read first, one more entry \
         closes the connection; at most {bytes} received bytes wait to be interpreted"
    )
}

/// Returns one sentence for each root element, in the order of the file.
fn describe_roots(verb: &str, elements: &[StatedElement]) -> Vec<String> {
    let mut names: Vec<&str> = Vec::new();
    for element in elements {
        if !names.contains(&element.root()) {
            names.push(element.root());
        }
    }
    let sentence = |root: &&str| {
        let inside: Vec<String> = elements
            .iter()
            .filter(|element| element.root() == *root)
            .filter(|element| element.kind.is_some() || (verb == "sends" && !element.tag_below_root().is_empty()))
            .map(|element| {
                let name = if element.tag_below_root().is_empty() { "its text" } else { element.tag_below_root() };
                match element.kind.as_deref() {
                    Some("FRAME") => format!("{name} FRAME (X Y Z A B C)"),
                    Some(kind) => format!("{name} {kind}"),
                    None => name.to_owned(),
                }
            })
            .collect();
        if inside.is_empty() {
            format!("{verb} <{root}>")
        } else {
            format!("{verb} <{root}>: {}", inside.join(", "))
        }
    };
    names.iter().map(sentence).collect()
}

fn describe_raw(raw: &StatedRaw) -> String {
    let size = raw.size.map_or("not stated".to_owned(), |size| size.to_string());
    if raw.is_stream {
        let end = raw.end.as_deref().unwrap_or("not stated");
        format!("receives text that ends with the codes {end}, size {size}")
    } else {
        format!("receives records of bytes, size {size}")
    }
}

#[cfg(test)]
mod tests;
