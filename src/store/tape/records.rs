//! The records of an MCAP file, in order, each with its checksums verified.

use super::error::TapeError;
use super::framing::RecordFraming;
use super::topic::Topic;
use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::Read;

/// No record of this program is longer: the points of a full-size scan need 35 MB.
const MAX_RECORD_BYTES: usize = 256 << 20;

/// Number of bytes that are read at once.
const PIECE_BYTES: usize = 1 << 20;

/// The records of a file, in order.
pub(super) struct Records<R> {
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

    /// Passes on the next record; `None` after the last one.
    pub(super) fn next<T>(
        &mut self,
        take: impl FnOnce(Record<'_>) -> Result<T, TapeError>,
    ) -> Result<Option<T>, RecordFault> {
        loop {
            match self.reader.next_event() {
                None => return Ok(None),
                Some(Err(error)) => return Err(RecordFault::Bytes(error)),
                Some(Ok(LinearReadEvent::ReadRequest(needed))) => {
                    // The buffer grows only with received bytes, whatever length a record states.
                    let into = self.reader.insert(needed.min(PIECE_BYTES));
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

/// The source of an error: the container, or its content.
pub(super) enum RecordFault {
    Bytes(McapError),
    Content(TapeError),
}

/// Returns whether an attachment's record is as long as its lengths state; its parser assumes this.
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
pub(super) fn topic(name: &str) -> Result<Topic, TapeError> {
    Topic::from_name(name).ok_or_else(|| TapeError::Foreign { problem: format!("unknown topic \"{name}\"") })
}

pub(super) fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}
