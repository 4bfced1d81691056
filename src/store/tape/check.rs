//! Checks whether a recording is complete: each message has its number and is in order, there are as many messages as
//! the recording's end states, and there is no error before the end.

use super::entry::RecordingStart;
use super::error::TapeError;
use super::format::{END, FORMAT, METADATA, OLDEST_FORMAT, START};
use super::records::{RecordFault, Records, seconds, topic};
use super::topic::Topic;
use mcap::McapError;
use mcap::records::{Metadata, Record};
use std::collections::BTreeMap;
use std::io::Read;

/// A complete recording.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedRecording {
    /// The state in which the loop began.
    pub start: RecordingStart,
    /// The loop's input files, by their names.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Entries in it.
    pub entries: u64,
    /// Length of the recording on the loop's clock, s.
    pub length_s: f64,
}

/// Reads a whole recording and returns its data.
///
/// # Errors
/// If it is not a recording, has another format, has a gap, is damaged or was not finished.
pub fn check_recording(source: impl Read) -> Result<CheckedRecording, TapeError> {
    let mut records = Records::new(source);
    let mut inventory = RecordingInventory::default();
    loop {
        match records.next(|record| inventory.add(&record)) {
            Ok(Some(())) => {}
            Ok(None) => return inventory.check_complete(),
            Err(RecordFault::Content(error)) => return Err(error),
            Err(RecordFault::Bytes(error)) => return Err(inventory.broken_reason(error)),
        }
    }
}

/// The content read so far.
#[derive(Default)]
struct RecordingInventory {
    is_mcap: bool,
    is_ours: bool,
    start: Option<RecordingStart>,
    files: BTreeMap<String, Vec<u8>>,
    topics: BTreeMap<u16, Topic>,
    counts: BTreeMap<Topic, u64>,
    last_ns: u64,
    ended: Option<BTreeMap<String, String>>,
}

impl RecordingInventory {
    fn add(&mut self, record: &Record<'_>) -> Result<(), TapeError> {
        self.is_mcap = true;
        match record {
            Record::Metadata(metadata) if metadata.name == METADATA => self.add_metadata(metadata)?,
            Record::Metadata(metadata) if metadata.name == END => self.ended = Some(metadata.metadata.clone()),
            Record::Attachment { header, data, .. } => self.add_file(&header.name, data)?,
            Record::Channel(channel) => {
                self.require_own_format()?;
                self.topics.insert(channel.id, topic(&channel.topic)?);
            }
            Record::Message { header, .. } => {
                let began_ns = self.start()?.unix_ns;
                let Some(&topic) = self.topics.get(&header.channel_id) else {
                    return Err(TapeError::Foreign {
                        problem: format!("channel {} is not defined", header.channel_id),
                    });
                };
                let from_s = seconds(header.log_time.saturating_sub(began_ns));
                let topic_name = topic.name();
                if header.log_time <= self.last_ns.max(began_ns) {
                    return Err(TapeError::OutOfOrder { topic: topic_name, from_s });
                }
                let before_s = seconds(self.last_ns.saturating_sub(began_ns));
                let count = self.counts.entry(topic).or_default();
                if header.sequence != *count as u32 {
                    let (expected, found) = (*count, u64::from(header.sequence));
                    return Err(TapeError::Gap { topic: topic_name, from_s: before_s, expected, found });
                }
                *count += 1;
                self.last_ns = header.log_time;
            }
            _ => {}
        }
        Ok(())
    }

    fn add_metadata(&mut self, metadata: &Metadata) -> Result<(), TapeError> {
        let value = |key: &str| metadata.metadata.get(key).cloned().unwrap_or_else(|| "none".to_owned());
        let found = value("format").parse();
        if !found.is_ok_and(|found: u32| (OLDEST_FORMAT..=FORMAT).contains(&found)) {
            return Err(TapeError::Version { found: value("format"), program: value("program") });
        }
        self.is_ours = true;
        Ok(())
    }

    fn add_file(&mut self, name: &str, bytes: &[u8]) -> Result<(), TapeError> {
        self.require_own_format()?;
        if name == START {
            let start = serde_json::from_slice(bytes);
            self.start = Some(start.map_err(|error| TapeError::Foreign { problem: format!("{START}: {error}") })?);
        } else {
            self.files.insert(name.to_owned(), bytes.to_vec());
        }
        Ok(())
    }

    fn require_own_format(&self) -> Result<(), TapeError> {
        let problem = || format!("the file does not begin with a metadata record named \"{METADATA}\"");
        if self.is_ours { Ok(()) } else { Err(TapeError::Foreign { problem: problem() }) }
    }

    fn start(&self) -> Result<&RecordingStart, TapeError> {
        self.require_own_format()?;
        let missing = || TapeError::Foreign { problem: format!("the attachment \"{START}\" is missing") };
        self.start.as_ref().ok_or_else(missing)
    }

    fn last_time_s(&self) -> f64 {
        let began_ns = self.start.as_ref().map_or(self.last_ns, |start| start.unix_ns);
        seconds(self.last_ns.saturating_sub(began_ns))
    }

    fn entries(&self) -> u64 {
        self.counts.iter().filter(|(topic, _)| topic.is_entry()).map(|(_, count)| count).sum()
    }

    /// Returns the reason why the recording cannot be read further.
    fn broken_reason(&self, error: McapError) -> TapeError {
        match error {
            McapError::Io(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
                TapeError::Disk { doing: "read", source: error.into() }
            }
            error if !self.is_mcap => TapeError::NotMcap { problem: error.to_string() },
            McapError::UnexpectedEof | McapError::UnexpectedEoc | McapError::Io(_) => self.unfinished_error(),
            error => TapeError::Damaged { from_s: self.last_time_s(), problem: error.to_string() },
        }
    }

    fn unfinished_error(&self) -> TapeError {
        TapeError::Unfinished { entries: self.entries(), until_s: self.last_time_s() }
    }

    /// Checks at the end of the file whether the recording is complete.
    fn check_complete(self) -> Result<CheckedRecording, TapeError> {
        let start = self.start()?.clone();
        let Some(ended) = &self.ended else { return Err(self.unfinished_error()) };
        let text = |key: &str| ended.get(key).map_or("", String::as_str);
        let unreadable = |error: serde_json::Error| TapeError::Foreign { problem: format!("{END}: {error}") };
        let lost: Vec<(String, u64, u64)> = serde_json::from_str(text("lost")).map_err(unreadable)?;
        if let Some((name, from_ns, count)) = lost.into_iter().min_by_key(|(_, from_ns, _)| *from_ns) {
            return Err(TapeError::Lost { topic: topic(&name)?.name(), from_s: seconds(from_ns), count });
        }
        if let Some(why) = ended.get("stopped") {
            return Err(TapeError::Stopped { until_s: self.last_time_s(), why: why.clone() });
        }
        let counts: BTreeMap<String, u64> = serde_json::from_str(text("entries")).map_err(unreadable)?;
        for (name, expected) in counts {
            let topic = topic(&name)?;
            let found = self.counts.get(&topic).copied().unwrap_or(0);
            if found != expected {
                return Err(TapeError::Gap { topic: topic.name(), from_s: self.last_time_s(), expected, found });
            }
        }
        let (entries, length_s) = (self.entries(), self.last_time_s());
        Ok(CheckedRecording { start, files: self.files, entries, length_s })
    }
}
