//! The description of a channel, one sentence for each property.

use panelprep_kuka::eki::channel::{Environment, Protocol, ReadOrder, StatedChannel, StatedElement, StatedRaw};

/// Describes the channel, one sentence for each property.
pub(super) fn describe_channel(channel: &StatedChannel) -> Vec<String> {
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
    descriptions.extend(roots("receives", &channel.received));
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
    descriptions.extend(roots("sends", &channel.sent));
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

/// Returns a sentence for each outermost name, in the file's order.
fn roots(verb: &str, elements: &[StatedElement]) -> Vec<String> {
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
