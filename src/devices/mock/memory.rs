//! What a channel has received and the program has not yet read.
//!
//! Whole records wait in one queue; the controller keeps one queue per tag instead, which differs only for documents
//! that lack an element. Here such a document is refused as malformed when the program reads it.

use super::channel_file::ChannelFile;
use super::codec::{Record, Value, decode};
use super::fault::{EkiFault, FileProblem};
use super::framer::Framer;
use std::collections::VecDeque;

/// A channel's receiving side.
#[derive(Debug)]
pub(super) struct Memory {
    file: ChannelFile,
    framer: Framer,
    records: VecDeque<Record>,
}

impl Memory {
    pub(super) fn new(file: ChannelFile) -> Self {
        Memory { framer: Framer::new(file.limit_bytes), records: VecDeque::new(), file }
    }

    /// Stores what these bytes complete. What came whole before a fault is kept.
    pub(super) fn receive(&mut self, bytes: &[u8]) -> Result<(), EkiFault> {
        self.framer.push(bytes);
        while let Some(document) = self.framer.next()? {
            let record = decode(&self.file.received, &document)?;
            // A document without any element of the file is passed over.
            if record.iter().any(Option::is_some) {
                self.records.push_back(record);
            }
            if self.records.len() > self.file.limit_records {
                return Err(EkiFault::Overflow);
            }
        }
        Ok(())
    }

    /// The records that wait, oldest first.
    pub(super) fn records(&self) -> impl DoubleEndedIterator<Item = &Record> {
        self.records.iter()
    }

    pub(super) fn front(&self) -> Option<&Record> {
        self.records.front()
    }

    pub(super) fn pop(&mut self) -> Option<Record> {
        self.records.pop_front()
    }

    /// Closed and opened again: half a document is forgotten, records too, as after EKI_Clear.
    pub(super) fn clear(&mut self) {
        self.framer = Framer::new(self.file.limit_bytes);
        self.records.clear();
    }

    /// Where in a record this tag's value stands.
    pub(super) fn place(&self, tag: &'static str) -> Result<usize, FileProblem> {
        self.file.received.iter().position(|element| element.tag == tag).ok_or(FileProblem::NotReceived(tag))
    }
}

/// The whole number at this place.
pub(super) fn int(record: &Record, place: usize) -> Result<i32, EkiFault> {
    match record.get(place) {
        Some(Some(Value::Int(number))) => Ok(*number),
        _ => Err(EkiFault::Malformed),
    }
}

/// The real number at this place.
pub(super) fn real(record: &Record, place: usize) -> Result<f64, EkiFault> {
    match record.get(place) {
        Some(Some(Value::Real(number))) => Ok(f64::from(*number)),
        _ => Err(EkiFault::Malformed),
    }
}

/// The frame's six numbers at this place.
pub(super) fn frame(record: &Record, place: usize) -> Result<[f64; 6], EkiFault> {
    match record.get(place) {
        Some(Some(Value::Frame(numbers))) => Ok(numbers.map(f64::from)),
        _ => Err(EkiFault::Malformed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn memory() -> Memory {
        Memory::new(ChannelFile::parse(include_str!("../../../config/kuka/CELLSTAT.xml")).expect("read"))
    }

    /// Limit 64: the 65th closes the channel and is stored all the same.
    #[test]
    fn one_record_too_many_is_stored_and_closes() {
        let mut memory = memory();
        let request = b"<Req Id=\"1\" Ep=\"0\" Op=\"9\" N1=\"0\"></Req><Else/>";
        assert_eq!(memory.receive(&request.repeat(64)), Ok(()));
        assert_eq!(memory.receive(request), Err(EkiFault::Overflow));
        assert_eq!(memory.records().count(), 65);
    }

    #[test]
    fn what_came_before_a_fault_stays() {
        let mut memory = memory();
        assert_eq!(memory.receive(b"<Req Id=\"7\"></Req>oops"), Err(EkiFault::Malformed));
        let record = memory.pop().expect("one");
        let id = memory.place("Req/@Id").expect("received");
        assert_eq!(int(&record, id), Ok(7));
        assert_eq!(memory.place("Req/@R1"), Err(FileProblem::NotReceived("Req/@R1")));
    }
}
