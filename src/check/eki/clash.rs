//! Conflicts between the channels of one controller: the same name, port, flag or output.

use crate::config::Problem;
use crate::eki::channel::StatedChannel;

/// The ports and signals that two channels both use, as problems of both: the channel's place in the list, and the
/// problem.
pub(crate) fn clashes(channels: &[(usize, &str, &StatedChannel)]) -> Vec<(usize, Problem)> {
    let mut found = Vec::new();
    for (nth, (place, _, channel)) in channels.iter().enumerate() {
        for (other_nth, (_, other_file, other)) in channels.iter().enumerate() {
            if nth != other_nth {
                found.extend(pair(channel, other_file, other).into_iter().map(|problem| (*place, problem)));
            }
        }
    }
    found
}

fn pair(channel: &StatedChannel, other_file: &str, other: &StatedChannel) -> Vec<Problem> {
    let mut found = Vec::new();
    let mut note = |line: usize, key: String, message: String| found.push(Problem { line, key, message });
    if channel.name.eq_ignore_ascii_case(&other.name) {
        let message =
            format!("{other_file} is a channel {} too; the file's name is the channel's in KRL", other.name);
        note(1, String::new(), message);
    }
    if channel.listens() && other.listens() {
        let port = |channel: &StatedChannel| channel.internal.port.as_ref().map_or(54_600, |port| port.value);
        if port(channel) == port(other) {
            let line = channel.internal.port.as_ref().map_or(channel.internal_line, |port| port.line);
            let message = format!("is {}, as in {other_file}; each channel needs a port of its own", port(channel));
            note(line, "CONFIGURATION/INTERNAL/PORT".to_owned(), message);
        }
    }
    for signal in channel.signals() {
        let same = other.signals().find(|theirs| theirs.variable() == signal.variable());
        if let Some(theirs) = same {
            let message = format!(
                "{} is raised by {} in {other_file} too (line {})",
                signal.variable(),
                theirs.cause(),
                theirs.line
            );
            note(signal.line, signal.key(), message);
        }
    }
    found
}
