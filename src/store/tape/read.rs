//! Reads a recording entry by entry, because it may be larger than the memory.
//!
//! [`check_recording`] reads a recording once, and refuses it if any data are missing: the numbers of the messages must
//! be consecutive, their times must increase, their number must agree with the end of the recording, and there must be
//! no error before the end. [`EntryReader`] then returns the entries. Both read the records of the MCAP file in order,
//! and verify the checksum of each record.
//!
//! [`RecordFraming`] finds the beginnings of the file's records in addition to the library's reader, because an
//! uncompressed chunk must be refused before the library reads it: the library assumes that the last record of such a
//! chunk ends with the chunk; otherwise its byte counter underflows. Recordings of this program contain only compressed
//! chunks, whose records are read by their own lengths.

use super::entry::{Entry, RecordingStart, Shot};
use super::error::{END, FORMAT, METADATA, OLDEST_FORMAT, START, TapeError};
use super::topic::{CompressedImage, PointCloud, Topic};
use super::write::POINT_BYTES;
use mcap::McapError;
use mcap::records::{Metadata, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use panelprep_base::geometry::{Camera, OrganizedCloud};
use panelprep_cell::files::read_color;
use prost::Message;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::sync::Arc;

/// An iterator of the entries of a checked recording, in order, each with its picture or points.
pub struct EntryReader<R> {
    records: Records<R>,
    topics: BTreeMap<u16, Topic>,
    began_ns: u64,
}

/// An entry as it is stored.
#[derive(Deserialize)]
struct StoredEntry {
    said: Value,
    heard: Value,
}

/// A message that is read back.
enum Part {
    Entry(Entry),
    Shot(Topic, Vec<u8>),
    Other,
}

impl<R: Read> EntryReader<R> {
    /// Creates an iterator of the entries of a recording that started at the time `began_ns`.
    pub fn new(source: R, began_ns: u64) -> Self {
        EntryReader { records: Records::new(source), topics: BTreeMap::new(), began_ns }
    }

    fn part(&mut self) -> Result<Option<Part>, TapeError> {
        let (topics, began_ns) = (&mut self.topics, self.began_ns);
        let mut at_ns = 0;
        let part = self.records.next(|record| match record {
            Record::Channel(channel) => {
                topics.insert(channel.id, find_topic(&channel.topic)?);
                Ok(Part::Other)
            }
            Record::Message { header, data } => {
                at_ns = header.log_time.saturating_sub(began_ns);
                match topics.get(&header.channel_id) {
                    Some(&topic) => parse_part(topic, at_ns, &data),
                    None => Ok(Part::Other),
                }
            }
            _ => Ok(Part::Other),
        });
        part.map_err(|wrong| match wrong {
            RecordFault::Content(error) => error,
            RecordFault::Bytes(error) => TapeError::Damaged { from_s: seconds(at_ns), problem: error.to_string() },
        })
    }
}

fn parse_part(topic: Topic, at_ns: u64, data: &[u8]) -> Result<Part, TapeError> {
    let unreadable = |problem: String| TapeError::Message { topic: topic.name(), from_s: seconds(at_ns), problem };
    if topic.is_shot() {
        return Ok(Part::Shot(topic, data.to_vec()));
    }
    if !topic.is_entry() {
        return Ok(Part::Other);
    }
    let StoredEntry { said, heard } =
        serde_json::from_slice(data).map_err(|error| unreadable(error.to_string()))?;
    Ok(Part::Entry(Entry { topic, at_ns, action: said, reply: heard, shot: None }))
}

impl<R: Read> Iterator for EntryReader<R> {
    type Item = Result<Entry, TapeError>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut awaits: Option<Entry> = None;
        loop {
            match (self.part(), awaits.as_mut()) {
                (Err(error), _) => return Some(Err(error)),
                (Ok(None), _) => return None,
                (Ok(Some(Part::Entry(entry))), _) if !has_shot(&entry) => return Some(Ok(entry)),
                (Ok(Some(Part::Entry(entry))), _) => awaits = Some(entry),
                (Ok(Some(Part::Shot(topic, data))), Some(entry)) => {
                    let (name, from_s) = (topic.name(), seconds(entry.at_ns));
                    let unreadable = |problem| TapeError::Message { topic: name, from_s, problem };
                    match parse_shot(topic, &data, &entry.reply) {
                        Ok(shot) => entry.shot = Some(shot),
                        Err(problem) => return Some(Err(unreadable(problem))),
                    }
                    return awaits.map(Ok);
                }
                _ => {}
            }
        }
    }
}

/// Returns whether a message with a picture or points follows this entry.
fn has_shot(entry: &Entry) -> bool {
    entry.topic == Topic::Camera && entry.reply.get("Ok").is_some_and(|shot| shot.get("size_px").is_some())
}

/// The part of a camera's reply that describes the picture.
#[derive(Deserialize)]
struct Answer {
    size_px: [usize; 2],
}

fn parse_shot(topic: Topic, data: &[u8], heard: &Value) -> Result<Shot, String> {
    let answer: Result<Answer, Value> = Result::deserialize(heard).map_err(|error| error.to_string())?;
    let size_px = answer.map_err(|_| "the entry of the picture contains no reply".to_owned())?.size_px;
    let shot = if topic == Topic::Points {
        let cloud = PointCloud::decode(data).map_err(|error| error.to_string())?;
        Shot::Points(Arc::new(parse_points(&cloud, size_px)?))
    } else {
        let image = CompressedImage::decode(data).map_err(|error| error.to_string())?;
        let picture = Arc::new(read_color(&image.data).map_err(|error| error.to_string())?);
        if topic == Topic::FlangePicture { Shot::Flange(picture) } else { Shot::Scanner(picture) }
    };
    let found = shot.size_px();
    if found != size_px {
        return Err(format!(
            "the picture has {}×{} px, but its entry states {}×{} px",
            found[0], found[1], size_px[0], size_px[1]
        ));
    }
    Ok(shot)
}

/// Size of a point in format 2, which has no alpha channel, bytes.
const FORMAT_2_POINT_BYTES: usize = 15;

fn parse_points(cloud: &PointCloud, [width, height]: [usize; 2]) -> Result<OrganizedCloud<Camera>, String> {
    let stride = cloud.point_stride as usize;
    if ![FORMAT_2_POINT_BYTES, POINT_BYTES].contains(&stride) || !cloud.data.len().is_multiple_of(stride) {
        return Err(format!("the points have {stride} bytes each, expected {POINT_BYTES}"));
    }
    // In both formats a point begins with the same data.
    let each = || cloud.data.chunks_exact(stride).filter_map(<[u8]>::first_chunk::<FORMAT_2_POINT_BYTES>);
    let points_mm = each().map(|&[a, b, c, d, e, f, g, h, i, j, k, l, ..]| {
        [[a, b, c, d], [e, f, g, h], [i, j, k, l]].map(f32::from_le_bytes)
    });
    let colors = each().map(|&[.., red, green, blue]| [red, green, blue]);
    OrganizedCloud::new(width, height, points_mm.collect(), colors.collect()).map_err(|error| error.to_string())
}

/// The contents of a complete recording, without its entries.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedRecording {
    /// The state of the control loop at the start.
    pub start: RecordingStart,
    /// The input files of the control loop, by name.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Number of entries in the recording.
    pub entries: u64,
    /// Duration of the recording by the clock of the control loop, s.
    pub length_s: f64,
}

/// Reads a whole recording, checks it, and returns what it contains besides the entries.
///
/// # Errors
/// If the file is not a recording, has another format, is incomplete, has a gap, or is damaged.
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

/// What was read so far.
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
                self.topics.insert(channel.id, find_topic(&channel.topic)?);
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

    /// Returns the error for a recording that cannot be read any further.
    fn broken_reason(&self, error: McapError) -> TapeError {
        match error {
            McapError::Io(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
                TapeError::Disk { doing: "read", source: error.into() }
            }
            error if !self.is_mcap => TapeError::NotMcap { problem: error.to_string() },
            McapError::UnexpectedEof | McapError::UnexpectedEoc | McapError::Io(_) => {
                self.unfinished_recording_error()
            }
            error => TapeError::Damaged { from_s: self.last_time_s(), problem: error.to_string() },
        }
    }

    fn unfinished_recording_error(&self) -> TapeError {
        TapeError::Unfinished { entries: self.entries(), until_s: self.last_time_s() }
    }

    /// Checks at the end of the file that the recording is complete.
    fn check_complete(self) -> Result<CheckedRecording, TapeError> {
        let start = self.start()?.clone();
        let Some(ended) = &self.ended else { return Err(self.unfinished_recording_error()) };
        let text = |key: &str| ended.get(key).map_or("", String::as_str);
        let unreadable = |error: serde_json::Error| TapeError::Foreign { problem: format!("{END}: {error}") };
        let lost: Vec<(String, u64, u64)> = serde_json::from_str(text("lost")).map_err(unreadable)?;
        if let Some((name, from_ns, count)) = lost.into_iter().min_by_key(|(_, from_ns, _)| *from_ns) {
            return Err(TapeError::Lost { topic: find_topic(&name)?.name(), from_s: seconds(from_ns), count });
        }
        if let Some(why) = ended.get("stopped") {
            return Err(TapeError::Stopped { until_s: self.last_time_s(), why: why.clone() });
        }
        let counts: BTreeMap<String, u64> = serde_json::from_str(text("entries")).map_err(unreadable)?;
        for (name, expected) in counts {
            let topic = find_topic(&name)?;
            let found = self.counts.get(&topic).copied().unwrap_or(0);
            if found != expected {
                return Err(TapeError::Gap { topic: topic.name(), from_s: self.last_time_s(), expected, found });
            }
        }
        let (entries, length_s) = (self.entries(), self.last_time_s());
        Ok(CheckedRecording { start, files: self.files, entries, length_s })
    }
}

/// Maximum length of a record, bytes. The longest records are the points of a full-size scan, 35 MB.
const MAX_RECORD_BYTES: usize = 256 << 20;

/// Number of bytes in one read.
const READ_BYTES: usize = 1 << 20;

/// The records of an MCAP file, in order.
struct Records<R> {
    source: R,
    framing: RecordFraming,
    reader: LinearReader,
}

impl<R: Read> Records<R> {
    pub(super) fn new(source: R) -> Self {
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true)
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        Records { source, framing: RecordFraming::default(), reader: LinearReader::new_with_options(options) }
    }

    /// Calls the function with the next record; `None` after the last record.
    pub(super) fn next<T>(
        &mut self,
        take: impl FnOnce(Record<'_>) -> Result<T, TapeError>,
    ) -> Result<Option<T>, RecordFault> {
        loop {
            match self.reader.next_event() {
                None => return Ok(None),
                Some(Err(error)) => return Err(RecordFault::Bytes(error)),
                Some(Ok(LinearReadEvent::ReadRequest(needed))) => {
                    // The buffer grows only by the bytes that were read, even if a record states a larger length.
                    let into = self.reader.insert(needed.min(READ_BYTES));
                    let read = loop {
                        match self.source.read(into) {
                            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                            read => break read.map_err(|error| RecordFault::Bytes(error.into()))?,
                        }
                    };
                    let framed = self.framing.feed(&into[..read]);
                    self.reader.notify_read(read);
                    framed.map_err(RecordFault::Content)?;
                }
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    if opcode == op::ATTACHMENT && !is_complete_attachment(data) {
                        return Err(RecordFault::Bytes(McapError::UnexpectedEof));
                    }
                    let record = mcap::parse_record(opcode, data).map_err(RecordFault::Bytes)?;
                    return take(record).map(Some).map_err(RecordFault::Content);
                }
            }
        }
    }
}

/// Where an error occurred: in the MCAP container, or in the content of a record.
enum RecordFault {
    Bytes(McapError),
    Content(TapeError),
}

/// Returns whether the length of an attachment's record agrees with the lengths stated inside it; the library's parser
/// assumes this.
fn is_complete_attachment(body: &[u8]) -> bool {
    let length = |at: usize| {
        let bytes = body.get(at..)?.first_chunk::<4>()?;
        usize::try_from(u32::from_le_bytes(*bytes)).ok()
    };
    let after = |at: usize| Some(at + 4 + length(at)?);
    let data = after(16).and_then(after);
    data.is_some_and(|data| data.checked_add(8 + 4).is_some_and(|least| least <= body.len()))
}

/// Returns the topic with this name.
fn find_topic(name: &str) -> Result<Topic, TapeError> {
    Topic::from_name(name).ok_or_else(|| TapeError::Foreign { problem: format!("unknown topic \"{name}\"") })
}

fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

/// Length of the magic number at the beginning of a file, bytes.
const MAGIC_BYTES: u64 = 8;
/// Length of a record's kind and length fields, bytes.
const HEAD_BYTES: usize = 9;
/// Number of bytes in a chunk before the length of the compression's name: two times, the size, the checksum.
const BYTES_BEFORE_NAME: usize = 28;
/// Number of bytes of a chunk's record up to and including the length of the compression's name.
const CHUNK_HEAD_BYTES: usize = HEAD_BYTES + BYTES_BEFORE_NAME + 4;

/// Finds the records in the bytes of a file, which are passed in pieces of any size.
#[derive(Debug)]
struct RecordFraming {
    /// Number of bytes to skip: the magic number, or the rest of a record.
    skip: u64,
    /// The bytes of a record's head that were received so far.
    head: Vec<u8>,
}

impl Default for RecordFraming {
    fn default() -> Self {
        RecordFraming { skip: MAGIC_BYTES, head: Vec::with_capacity(CHUNK_HEAD_BYTES) }
    }
}

impl RecordFraming {
    /// Processes the next bytes of the file.
    ///
    /// # Errors
    /// If an uncompressed chunk begins in these bytes.
    pub fn feed(&mut self, mut bytes: &[u8]) -> Result<(), TapeError> {
        while !bytes.is_empty() {
            let skipped = usize::try_from(self.skip).unwrap_or(usize::MAX).min(bytes.len());
            bytes = &bytes[skipped..];
            self.skip -= skipped as u64;
            let missing = self.missing_head_bytes().min(bytes.len());
            self.head.extend_from_slice(&bytes[..missing]);
            bytes = &bytes[missing..];
            if self.skip == 0 && self.missing_head_bytes() == 0 {
                self.check_compression()?;
                self.skip = self.length().saturating_sub((self.head.len() - HEAD_BYTES) as u64);
                self.head.clear();
            }
        }
        Ok(())
    }

    /// Returns how many bytes of a record's head are still missing.
    fn missing_head_bytes(&self) -> usize {
        let needed = match self.head.first() {
            Some(&op::CHUNK) if self.head.len() >= HEAD_BYTES => {
                let rest = usize::try_from(self.length()).unwrap_or(usize::MAX);
                HEAD_BYTES + rest.min(CHUNK_HEAD_BYTES - HEAD_BYTES)
            }
            _ => HEAD_BYTES,
        };
        needed.saturating_sub(self.head.len())
    }

    fn length(&self) -> u64 {
        self.head.get(1..).and_then(|rest| rest.first_chunk()).map_or(0, |length| u64::from_le_bytes(*length))
    }

    fn check_compression(&self) -> Result<(), TapeError> {
        let is_chunk = self.head.first() == Some(&op::CHUNK);
        match self.head.get(HEAD_BYTES + BYTES_BEFORE_NAME..) {
            Some([0, 0, 0, 0]) if is_chunk => {
                Err(TapeError::Foreign { problem: "the file has a chunk that is not compressed".to_owned() })
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the bytes of a file: the magic number, a short record, a record of another kind whose content looks like
    /// a chunk, and then a chunk.
    fn file(name: &[u8]) -> Vec<u8> {
        let record = |op: u8, content: &[u8]| [&[op][..], &(content.len() as u64).to_le_bytes(), content].concat();
        let chunk = [&[7; BYTES_BEFORE_NAME][..], &(name.len() as u32).to_le_bytes(), name, &[1; 20]].concat();
        let inside = record(op::CHUNK, &[0; 40]);
        [
            b"\x89MCAP0\r\n".to_vec(),
            record(op::HEADER, b"ab"),
            record(op::METADATA, &inside),
            record(op::CHUNK, &chunk),
        ]
        .concat()
    }

    #[test]
    fn an_uncompressed_chunk_is_refused_in_pieces_of_any_size() {
        for step in [1, 2, 3, 8, 64, 1_000] {
            let read = |bytes: &[u8]| {
                let mut framing = RecordFraming::default();
                bytes.chunks(step).try_for_each(|piece| framing.feed(piece))
            };
            assert!(read(&file(b"zstd")).is_ok(), "{step}");
            let error = read(&file(b"")).expect_err("refused").to_string();
            assert!(error.contains("a chunk that is not compressed"), "{step}: {error}");
            // A chunk that ends before the name of its compression is passed on to the library, which refuses it.
            assert!(
                read(&[&file(b"zstd")[..8], &[op::CHUNK, 3, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, op::HEADER]].concat())
                    .is_ok()
            );
        }
    }
}
