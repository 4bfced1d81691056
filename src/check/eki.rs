//! Classic EthernetKRL files, ours and foreign ones: what is wrong, what is a trap, what the channel does.
//!
//! `read` makes a tree of the text, `schema` holds it against the manual, `channel` takes the meaning out of it,
//! `traps` finds what the controller accepts and a person regrets, `clash` what two files do to each other, `say` puts
//! it in words. Facts: `eki.md` 1 and 6. Wider than the client's own reader, which takes what the client can use and
//! stops at the first error: here RAW channels, dialling controllers and unknown names are read as well, and all problems
//! are told.
//!
//! Does not judge the newer dialect of EthernetKRL 6; it says that the file is one.

mod channel;
mod clash;
mod read;
mod say;
mod schema;
#[cfg(test)]
mod tests;
mod traps;

use crate::config::Problem;
pub(super) use channel::Channel;
pub(super) use clash::clashes;

/// What was found in one file.
pub(super) struct Checked {
    /// What the controller refuses or cannot work with.
    pub(super) problems: Vec<Problem>,
    /// What it accepts and a person regrets.
    pub(super) warnings: Vec<Problem>,
    /// What the channel does, a sentence each.
    pub(super) says: Vec<String>,
    /// The channel; `None` where the file is none.
    pub(super) channel: Option<Channel>,
}

/// Checks one file by itself; `name` is that of the file.
pub(super) fn check(name: &str, text: &str) -> Checked {
    let mut found = Findings::default();
    let channel = read::tree(text).and_then(|root| {
        schema::is_classic(&root)?;
        schema::check(&root, &mut found);
        Ok(Channel::of(name, &root, &mut found))
    });
    let (channel, says) = match channel {
        Ok(channel) => {
            traps::find(&channel, &mut found);
            let says = say::sentences(&channel);
            (Some(channel), says)
        }
        Err(problem) => {
            found.problems.push(problem);
            (None, Vec::new())
        }
    };
    let Findings { mut problems, mut warnings } = found;
    problems.sort_by_key(|problem| problem.line);
    warnings.sort_by_key(|warning| warning.line);
    Checked { problems, warnings, says, channel }
}

/// What the steps note.
#[derive(Default)]
struct Findings {
    problems: Vec<Problem>,
    warnings: Vec<Problem>,
}

impl Findings {
    fn wrong(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        self.problems.push(Problem { line, key: key.into(), message: message.into() });
    }

    fn warn(&mut self, line: usize, key: impl Into<String>, message: impl Into<String>) {
        self.warnings.push(Problem { line, key: key.into(), message: message.into() });
    }
}
