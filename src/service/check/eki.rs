//! Checks classic EthernetKRL files, shipped or foreign: errors, pitfalls, and a description of the channel.
//!
//! The client's reader (`eki::channel`) notes everything that differs from the manual. Here `pitfalls` finds what the
//! controller accepts although it leads to problems, `clash` finds conflicts between two files, and `describe`
//! describes a channel. The facts are in `eki.md` 1 and 6. RAW channels, channels on which the controller connects as
//! a client, and unknown names are read as well, and all problems are reported.
//!
//! This module does not judge the newer dialect of EthernetKRL 6; it only reports that a file is written in it.

mod clash;
mod describe;
mod pitfalls;
#[cfg(test)]
mod tests;

pub(super) use clash::{differing_address_warnings, find_clashes};
use panelprep_base::config::Problem;
use panelprep_kuka::eki::channel::{Findings, StatedChannel, read};

/// The result of the check of one file.
pub(super) struct EkiCheckResult {
    /// Properties that the controller refuses or with which it cannot work.
    pub(super) problems: Vec<Problem>,
    /// Properties that the controller accepts although they lead to problems.
    pub(super) warnings: Vec<Problem>,
    /// The properties of the channel, a sentence each.
    pub(super) descriptions: Vec<String>,
    /// The channel; `None` if the file is not a channel.
    pub(super) channel: Option<StatedChannel>,
}

/// Checks one file by itself; `name` is the file's name.
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
    pitfalls::find(&channel, &mut found);
    let says = describe::describe_channel(&channel);
    let Findings { mut problems, mut warnings, .. } = found;
    problems.sort_by_key(|problem| problem.line);
    warnings.sort_by_key(|warning| warning.line);
    EkiCheckResult { problems, warnings, descriptions: says, channel: Some(channel) }
}
