//! Conflicts between the channels of one controller: the same name, port, flag or output, and addresses that differ.

use super::pitfalls::is_address;
use panelprep_base::config::Problem;
use panelprep_kuka::eki::channel::{Stated, StatedChannel};

/// Returns the ports and signals that two channels both use, as problems of both: the channel's index in the list,
/// and the problem.
pub fn find_clashes(channels: &[(usize, &str, &StatedChannel)]) -> Vec<(usize, Problem)> {
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

/// Returns warnings if one controller listens at different addresses: one for each channel with another address than
/// the first channel. A controller has few networks, and usually only one for this purpose.
pub fn differing_address_warnings(channels: &[(usize, &str, &StatedChannel)]) -> Vec<(usize, Problem)> {
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
