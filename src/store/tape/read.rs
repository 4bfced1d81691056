//! Converts bytes to entries, one at a time: a recording may be larger than the memory.
//!
//! `check` reads a recording once and refuses it if anything is missing; [`EntryReader`] then returns its entries.

use super::entry::{Entry, Shot};
use super::error::TapeError;
use super::records::{RecordFault, Records, seconds, topic};
use super::topic::Topic;
use super::well_known::{CompressedImage, PointCloud};
use super::write::STRIDE;
use mcap::records::Record;
use panelprep_base::geometry::{Camera, OrganizedCloud};
use panelprep_cell::files::read_color;
use prost::Message;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::sync::Arc;

/// The entries of a checked recording, in order, each with its picture or points.
pub struct EntryReader<R> {
    records: Records<R>,
    topics: BTreeMap<u16, Topic>,
    began_ns: u64,
}

/// The stored form of an entry.
#[derive(Deserialize)]
struct StoredEntry {
    said: Value,
    heard: Value,
}

/// One message of the kinds that are read back.
enum Part {
    Entry(Entry),
    Shot(Topic, Vec<u8>),
    Other,
}

impl<R: Read> EntryReader<R> {
    /// Creates the entries of a recording that began at this time.
    pub fn new(source: R, began_ns: u64) -> Self {
        EntryReader { records: Records::new(source), topics: BTreeMap::new(), began_ns }
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

/// Returns whether a camera's answer is a picture or points.
fn has_shot(entry: &Entry) -> bool {
    entry.topic == Topic::Camera && entry.reply.get("Ok").is_some_and(|shot| shot.get("size_px").is_some())
}

/// The data about a picture in a camera's answer.
#[derive(Deserialize)]
struct Answer {
    size_px: [usize; 2],
}

fn parse_shot(topic: Topic, data: &[u8], heard: &Value) -> Result<Shot, String> {
    let answer: Result<Answer, Value> = Result::deserialize(heard).map_err(|error| error.to_string())?;
    let size_px = answer.map_err(|_| "the entry of the picture has no response".to_owned())?.size_px;
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
            "the picture has {}×{} px, but its entry states {}×{} px",
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
        return Err(format!("the points have {stride} bytes each, expected {STRIDE}"));
    }
    // The data that both formats have in common come first.
    let each = || cloud.data.chunks_exact(stride).filter_map(<[u8]>::first_chunk::<STRIDE_OF_2>);
    let points_mm = each().map(|&[a, b, c, d, e, f, g, h, i, j, k, l, ..]| {
        [[a, b, c, d], [e, f, g, h], [i, j, k, l]].map(f32::from_le_bytes)
    });
    let colors = each().map(|&[.., red, green, blue]| [red, green, blue]);
    OrganizedCloud::new(width, height, points_mm.collect(), colors.collect()).map_err(|error| error.to_string())
}
