//! Bytes to entries, one at a time: a recording may be larger than the memory.
//!
//! [`check`] reads a recording once and refuses it where anything is missing; [`Entries`] then gives what it holds.

use super::entry::{Entry, Shot, Start};
use super::error::TapeError;
use super::format::{END, FORMAT, METADATA, OLDEST_FORMAT, START};
use super::framing::Framing;
use super::topic::Topic;
use super::well_known::{CompressedImage, PointCloud};
use super::write::STRIDE;
use crate::files::read_color;
use crate::geometry::{Camera, OrganizedCloud};
use mcap::McapError;
use mcap::records::{Metadata, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::Message;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::sync::Arc;

/// No record of ours is longer: the points of a full-size scan take 35 MB.
const LONGEST: usize = 256 << 20;
/// What is read at once.
const PIECE_BYTES: usize = 1 << 20;

/// A recording in which nothing is missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// How the loop began.
    pub start: Start,
    /// The files that it worked by, by their names.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Entries in it.
    pub entries: u64,
    /// Its length on the loop's clock, s.
    pub length_s: f64,
}

/// The records of a file, one after the other.
struct Records<R> {
    source: R,
    framing: Framing,
    reader: LinearReader,
}

impl<R: Read> Records<R> {
    fn new(source: R) -> Self {
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true)
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(LONGEST);
        Records { source, framing: Framing::default(), reader: LinearReader::new_with_options(options) }
    }

    /// Hands the next record over; `None` behind the last one.
    fn next<T>(&mut self, take: impl FnOnce(Record<'_>) -> Result<T, TapeError>) -> Result<Option<T>, Wrong> {
        loop {
            match self.reader.next_event() {
                None => return Ok(None),
                Some(Err(error)) => return Err(Wrong::Bytes(error)),
                Some(Ok(LinearReadEvent::ReadRequest(needed))) => {
                    // Room grows with what comes, whatever length a record claims.
                    let into = self.reader.insert(needed.min(PIECE_BYTES));
                    let read = loop {
                        match self.source.read(into) {
                            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                            read => break read.map_err(|error| Wrong::Bytes(error.into()))?,
                        }
                    };
                    let framed = self.framing.take(&into[..read]);
                    self.reader.notify_read(read);
                    framed.map_err(Wrong::Content)?;
                }
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    if opcode == op::ATTACHMENT && !is_whole_attachment(data) {
                        return Err(Wrong::Bytes(McapError::UnexpectedEof));
                    }
                    let record = mcap::parse_record(opcode, data).map_err(Wrong::Bytes)?;
                    return take(record).map(Some).map_err(Wrong::Content);
                }
            }
        }
    }
}

/// What went wrong: the container, or what is in it.
enum Wrong {
    Bytes(McapError),
    Content(TapeError),
}

/// Whether an attachment's record is as long as its lengths say; its parser takes that for granted.
fn is_whole_attachment(body: &[u8]) -> bool {
    let length = |at: usize| {
        let bytes = body.get(at..)?.first_chunk::<4>()?;
        usize::try_from(u32::from_le_bytes(*bytes)).ok()
    };
    let after = |at: usize| Some(at + 4 + length(at)?);
    let data = after(16).and_then(after);
    data.is_some_and(|data| data.checked_add(8 + 4).is_some_and(|least| least <= body.len()))
}

/// Reads a recording whole and says what it is.
///
/// # Errors
/// Where it is none, is of another format, has a gap, is damaged or was not finished.
pub fn check(source: impl Read) -> Result<Checked, TapeError> {
    let mut records = Records::new(source);
    let mut seen = Seen::default();
    loop {
        match records.next(|record| seen.take(&record)) {
            Ok(Some(())) => {}
            Ok(None) => return seen.whole(),
            Err(Wrong::Content(error)) => return Err(error),
            Err(Wrong::Bytes(error)) => return Err(seen.broken(error)),
        }
    }
}

/// What was read so far.
#[derive(Default)]
struct Seen {
    is_mcap: bool,
    is_ours: bool,
    start: Option<Start>,
    files: BTreeMap<String, Vec<u8>>,
    topics: BTreeMap<u16, Topic>,
    counts: BTreeMap<Topic, u64>,
    last_ns: u64,
    ended: Option<BTreeMap<String, String>>,
}

impl Seen {
    fn take(&mut self, record: &Record<'_>) -> Result<(), TapeError> {
        self.is_mcap = true;
        match record {
            Record::Metadata(metadata) if metadata.name == METADATA => self.begin(metadata)?,
            Record::Metadata(metadata) if metadata.name == END => self.ended = Some(metadata.metadata.clone()),
            Record::Attachment { header, data, .. } => self.file(&header.name, data)?,
            Record::Channel(channel) => {
                self.ours()?;
                self.topics.insert(channel.id, topic(&channel.topic)?);
            }
            Record::Message { header, .. } => {
                let began_ns = self.start()?.unix_ns;
                let Some(&topic) = self.topics.get(&header.channel_id) else {
                    return Err(TapeError::Foreign {
                        problem: format!("channel {} is not there", header.channel_id),
                    });
                };
                let from_s = seconds(header.log_time.saturating_sub(began_ns));
                let topic_name = topic.name();
                if header.log_time <= self.last_ns.max(began_ns) {
                    return Err(TapeError::Order { topic: topic_name, from_s });
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

    fn begin(&mut self, metadata: &Metadata) -> Result<(), TapeError> {
        let value = |key: &str| metadata.metadata.get(key).cloned().unwrap_or_else(|| "none".to_owned());
        let found = value("format").parse();
        if !found.is_ok_and(|found: u32| (OLDEST_FORMAT..=FORMAT).contains(&found)) {
            return Err(TapeError::Version { found: value("format"), program: value("program") });
        }
        self.is_ours = true;
        Ok(())
    }

    fn file(&mut self, name: &str, bytes: &[u8]) -> Result<(), TapeError> {
        self.ours()?;
        if name == START {
            let start = serde_json::from_slice(bytes);
            self.start = Some(start.map_err(|error| TapeError::Foreign { problem: format!("{START}: {error}") })?);
        } else {
            self.files.insert(name.to_owned(), bytes.to_vec());
        }
        Ok(())
    }

    fn ours(&self) -> Result<(), TapeError> {
        let problem = || format!("it does not begin with a metadata record named \"{METADATA}\"");
        if self.is_ours { Ok(()) } else { Err(TapeError::Foreign { problem: problem() }) }
    }

    fn start(&self) -> Result<&Start, TapeError> {
        self.ours()?;
        let missing = || TapeError::Foreign { problem: format!("the attachment \"{START}\" is missing") };
        self.start.as_ref().ok_or_else(missing)
    }

    fn until_s(&self) -> f64 {
        let began_ns = self.start.as_ref().map_or(self.last_ns, |start| start.unix_ns);
        seconds(self.last_ns.saturating_sub(began_ns))
    }

    fn entries(&self) -> u64 {
        self.counts.iter().filter(|(topic, _)| topic.is_entry()).map(|(_, count)| count).sum()
    }

    /// Why the bytes do not go on.
    fn broken(&self, error: McapError) -> TapeError {
        match error {
            McapError::Io(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
                TapeError::Disk { doing: "read", source: error.into() }
            }
            error if !self.is_mcap => TapeError::NotMcap { problem: error.to_string() },
            McapError::UnexpectedEof | McapError::UnexpectedEoc | McapError::Io(_) => self.unfinished(),
            error => TapeError::Damaged { from_s: self.until_s(), problem: error.to_string() },
        }
    }

    fn unfinished(&self) -> TapeError {
        TapeError::Unfinished { entries: self.entries(), until_s: self.until_s() }
    }

    /// The file's end was reached: is all there?
    fn whole(self) -> Result<Checked, TapeError> {
        let start = self.start()?.clone();
        let Some(ended) = &self.ended else { return Err(self.unfinished()) };
        let text = |key: &str| ended.get(key).map_or("", String::as_str);
        let unreadable = |error: serde_json::Error| TapeError::Foreign { problem: format!("{END}: {error}") };
        let lost: Vec<(String, u64, u64)> = serde_json::from_str(text("lost")).map_err(unreadable)?;
        if let Some((name, from_ns, count)) = lost.into_iter().min_by_key(|(_, from_ns, _)| *from_ns) {
            return Err(TapeError::Lost { topic: topic(&name)?.name(), from_s: seconds(from_ns), count });
        }
        if let Some(why) = ended.get("stopped") {
            return Err(TapeError::Stopped { until_s: self.until_s(), why: why.clone() });
        }
        let counts: BTreeMap<String, u64> = serde_json::from_str(text("entries")).map_err(unreadable)?;
        for (name, expected) in counts {
            let topic = topic(&name)?;
            let found = self.counts.get(&topic).copied().unwrap_or(0);
            if found != expected {
                return Err(TapeError::Gap { topic: topic.name(), from_s: self.until_s(), expected, found });
            }
        }
        let (entries, length_s) = (self.entries(), self.until_s());
        Ok(Checked { start, files: self.files, entries, length_s })
    }
}

fn topic(name: &str) -> Result<Topic, TapeError> {
    Topic::named(name).ok_or_else(|| TapeError::Foreign { problem: format!("it has no topic \"{name}\"") })
}

fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

/// The entries of a checked recording, in order, each with its picture or points.
pub struct Entries<R> {
    records: Records<R>,
    topics: BTreeMap<u16, Topic>,
    began_ns: u64,
}

/// What an entry is written as.
#[derive(Deserialize)]
struct Body {
    said: Value,
    heard: Value,
}

/// One message of those that are read back.
enum Part {
    Entry(Entry),
    Shot(Topic, Vec<u8>),
    Other,
}

impl<R: Read> Entries<R> {
    /// The entries of a recording that began at this time.
    pub fn new(source: R, began_ns: u64) -> Self {
        Entries { records: Records::new(source), topics: BTreeMap::new(), began_ns }
    }

    fn part(&mut self) -> Result<Option<Part>, TapeError> {
        let (topics, began_ns) = (&mut self.topics, self.began_ns);
        let mut at_ns = 0;
        let part = self.records.next(|record| match record {
            Record::Channel(channel) => {
                topics.insert(channel.id, topic(&channel.topic)?);
                Ok(Part::Other)
            }
            Record::Message { header, data } => {
                at_ns = header.log_time.saturating_sub(began_ns);
                match topics.get(&header.channel_id) {
                    Some(&topic) => read_part(topic, at_ns, &data),
                    None => Ok(Part::Other),
                }
            }
            _ => Ok(Part::Other),
        });
        part.map_err(|wrong| match wrong {
            Wrong::Content(error) => error,
            Wrong::Bytes(error) => TapeError::Damaged { from_s: seconds(at_ns), problem: error.to_string() },
        })
    }
}

fn read_part(topic: Topic, at_ns: u64, data: &[u8]) -> Result<Part, TapeError> {
    let unreadable = |problem: String| TapeError::Message { topic: topic.name(), from_s: seconds(at_ns), problem };
    if topic.is_shot() {
        return Ok(Part::Shot(topic, data.to_vec()));
    }
    if !topic.is_entry() {
        return Ok(Part::Other);
    }
    let Body { said, heard } = serde_json::from_slice(data).map_err(|error| unreadable(error.to_string()))?;
    Ok(Part::Entry(Entry { topic, at_ns, said, heard, shot: None }))
}

impl<R: Read> Iterator for Entries<R> {
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
                    match shot(topic, &data, &entry.heard) {
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

/// Whether a camera's answer is a picture or points.
fn has_shot(entry: &Entry) -> bool {
    entry.topic == Topic::Camera && entry.heard.get("Ok").is_some_and(|shot| shot.get("size_px").is_some())
}

/// What a camera's answer says of its picture.
#[derive(Deserialize)]
struct Answer {
    size_px: [usize; 2],
}

fn shot(topic: Topic, data: &[u8], heard: &Value) -> Result<Shot, String> {
    let answer: Result<Answer, Value> = Result::deserialize(heard).map_err(|error| error.to_string())?;
    let size_px = answer.map_err(|_| "a picture without an answer".to_owned())?.size_px;
    let shot = if topic == Topic::Points {
        let cloud = PointCloud::decode(data).map_err(|error| error.to_string())?;
        Shot::Points(Arc::new(points(&cloud, size_px)?))
    } else {
        let image = CompressedImage::decode(data).map_err(|error| error.to_string())?;
        let picture = Arc::new(read_color(&image.data).map_err(|error| error.to_string())?);
        if topic == Topic::FlangePicture { Shot::Flange(picture) } else { Shot::Scanner(picture) }
    };
    let found = shot.size_px();
    if found != size_px {
        return Err(format!(
            "a picture of {}×{} px where {}×{} was said",
            found[0], found[1], size_px[0], size_px[1]
        ));
    }
    Ok(shot)
}

/// Bytes of one point in format 2, which had no alpha.
const STRIDE_OF_2: usize = 15;

fn points(cloud: &PointCloud, [width, height]: [usize; 2]) -> Result<OrganizedCloud<Camera>, String> {
    let stride = cloud.point_stride as usize;
    if ![STRIDE_OF_2, STRIDE].contains(&stride) || !cloud.data.len().is_multiple_of(stride) {
        return Err(format!("points of {stride} bytes; ours have {STRIDE}"));
    }
    // What both have in common stands first.
    let each = || cloud.data.chunks_exact(stride).filter_map(<[u8]>::first_chunk::<STRIDE_OF_2>);
    let points_mm = each().map(|&[a, b, c, d, e, f, g, h, i, j, k, l, ..]| {
        [[a, b, c, d], [e, f, g, h], [i, j, k, l]].map(f32::from_le_bytes)
    });
    let colors = each().map(|&[.., red, green, blue]| [red, green, blue]);
    OrganizedCloud::new(width, height, points_mm.collect(), colors.collect()).map_err(|error| error.to_string())
}
