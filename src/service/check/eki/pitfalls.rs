//! Properties that the controller accepts although they lead to problems (the pitfalls of `eki.md` 6), and
//! properties that cannot work.

use panelprep_kuka::eki::channel::{
    Environment, Findings, Protocol, ReadOrder, Signal, StatedChannel, StatedElement,
};
use std::collections::{BTreeMap, BTreeSet};

/// The ports that the controller's firewall opens.
const PORTS: std::ops::RangeInclusive<u16> = 54_600..=54_615;
/// The first number beyond the last `$FLAG`, 1024. The manual's range for Set_Flag still includes it, so it only gives
/// a warning; larger numbers are refused as outside of that range.
const FLAG_END: u32 = 1025;

/// Adds everything to `found` that is visible from one channel's own file.
pub(super) fn find(channel: &StatedChannel, found: &mut Findings) {
    addresses(channel, found);
    check_lifetime(channel, found);
    check_buffers(channel, found);
    signals(channel, found);
    elements(channel, found);
    raw(channel, found);
}

fn addresses(channel: &StatedChannel, found: &mut Findings) {
    let internal_line = channel.internal_line;
    if !channel.type_stated {
        let message = "is not stated: the controller assumes Server, connects to the other machine and does not \
                       listen; write Client if the PC connects";
        found.warn(1, "CONFIGURATION/EXTERNAL/TYPE", message);
    }
    if channel.does_controller_listen() {
        match &channel.internal.port {
            Some(port) if !PORTS.contains(&port.value) => found.add_problem(
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

/// Returns whether this is an address of four numbers.
pub(super) fn is_address(text: &str) -> bool {
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

fn signals(channel: &StatedChannel, found: &mut Findings) {
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
        if signal.is_flag && signal.number == FLAG_END {
            found.warn(signal.line, &key, "$FLAG ends at 1024, though the manual allows 1025");
        }
    }
}

fn elements(channel: &StatedChannel, found: &mut Findings) {
    if channel.received.is_empty() && channel.raw.is_empty() && channel.sent.is_empty() {
        found.warn(1, "RECEIVE", "neither RECEIVE nor SEND has an ELEMENT: the channel carries no data");
    }
    duplicates("RECEIVE", &channel.received, found);
    duplicates("SEND", &channel.sent, found);
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
    root_flags(channel, found);
}

/// Warns if no flag shows that a message is complete: a root's flag shows this, a leaf's flag shows only that the leaf
/// was present.
fn root_flags(channel: &StatedChannel, found: &mut Findings) {
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

/// Returns whether all data below this root lie inside of the element of this tag, so that its flag shows that all
/// have arrived.
fn contains_all_data(channel: &StatedChannel, root: &str, tag: &str) -> bool {
    let inside = format!("{tag}/");
    let mut data = channel.received.iter().filter(|element| element.root() == root && element.kind.is_some());
    tag == root || (!tag.contains('@') && data.all(|element| element.tag.starts_with(&inside)))
}

fn duplicates(section: &str, elements: &[StatedElement], found: &mut Findings) {
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

fn raw(channel: &StatedChannel, found: &mut Findings) {
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
