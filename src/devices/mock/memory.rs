//! One channel: its connection, the bytes to be sent, and its buffers. The buffers contain the received values that the
//! program has not read yet; there is one buffer for each tag with a type.
//!
//! A document adds one value to the buffer of each tag that it contains. A missing or empty tag adds none, so the
//! buffers of one channel can get out of step. Each value has the sequence number of its document, by which a program
//! detects this. One value more than the limit of BUFFERING is still stored, and closes the connection. The read
//! functions below correspond to `EKI_CheckBuffer`, `EKI_Get…` and `EKI_ClearBuffer`; on an empty buffer they return an
//! error without waiting.

use super::channel_file::{ChannelFile, EkiError, EkiFault, ElementKind, Environment, FileProblem, ReadOrder};
use super::codec::{Value, decode};
use super::framer::Framer;
use std::collections::VecDeque;

/// A flag or output that the controller sets when an element has arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Raised {
    Flag(u16),
    Output(u16),
}

/// A received value and the sequence number of its document.
#[derive(Debug, Clone, PartialEq)]
struct Entry {
    value: Value,
    counter: u32,
}

#[derive(Debug)]
struct TagMemory {
    order: ReadOrder,
    entries: VecDeque<Entry>,
}

impl TagMemory {
    fn next(&self) -> Option<&Entry> {
        match self.order {
            ReadOrder::Fifo => self.entries.front(),
            ReadOrder::Lifo => self.entries.back(),
        }
    }

    fn pop(&mut self) {
        match self.order {
            ReadOrder::Fifo => self.entries.pop_front(),
            ReadOrder::Lifo => self.entries.pop_back(),
        };
    }
}

/// The receiving side of a channel: the framer and the buffers.
#[derive(Debug)]
pub(super) struct Memory {
    file: ChannelFile,
    framer: Framer,
    /// One buffer for each element of the file; the buffer of an element without a type stays empty.
    tags: Vec<TagMemory>,
    /// Documents stored.
    counter: u32,
    raised: Vec<Raised>,
}

impl Memory {
    pub(super) fn new(file: ChannelFile) -> Self {
        let order = |element: &super::channel_file::Element| element.order.unwrap_or(file.order);
        let empty = |order| TagMemory { order, entries: VecDeque::new() };
        let tags = file.received.iter().map(|element| empty(order(element))).collect();
        Memory { framer: Framer::new(file.limit_bytes), tags, counter: 0, raised: Vec::new(), file }
    }

    /// Decodes and stores the documents that these bytes complete, and returns the number of documents. Documents that
    /// were completed before a fault are stored.
    pub(super) fn receive(&mut self, bytes: &[u8]) -> Result<u32, EkiFault> {
        self.framer.push(bytes);
        let before = self.counter;
        while let Some(document) = self.framer.next()? {
            let arrived = decode(&self.file.received, &document)?;
            self.counter = self.counter.wrapping_add(1);
            let counter = self.counter;
            for arrival in arrived {
                let element = &self.file.received[arrival.element];
                self.raised.extend(element.set_flag.map(Raised::Flag));
                self.raised.extend(element.set_out.map(Raised::Output));
                if let Some(value) = arrival.value {
                    self.tags[arrival.element].entries.push_back(Entry { value, counter });
                }
            }
            if self.tags.iter().any(|tag| tag.entries.len() > self.file.limit_entries) {
                return Err(EkiFault::Overflow);
            }
        }
        Ok(self.counter.wrapping_sub(before))
    }

    /// Returns the flags and outputs that elements have set since the last call.
    pub(super) fn remove_raised_signals(&mut self) -> Vec<Raised> {
        std::mem::take(&mut self.raised)
    }

    /// Returns the number of values in the buffer of this tag.
    pub(super) fn waiting_count(&self, place: usize) -> usize {
        self.tags.get(place).map_or(0, |tag| tag.entries.len())
    }

    /// Returns the next value of this tag, and keeps it in the buffer.
    pub(super) fn peek_value(&self, place: usize) -> Result<&Value, EkiError> {
        self.tags.get(place).and_then(TagMemory::next).map(|entry| &entry.value).ok_or(EkiError::Empty)
    }

    /// Returns the newest value of this tag, and the sequence number of its document.
    pub(super) fn newest_value(&self, place: usize) -> Result<(&Value, u32), EkiError> {
        let newest = self.tags.get(place).and_then(|tag| tag.entries.back());
        newest.map(|entry| (&entry.value, entry.counter)).ok_or(EkiError::Empty)
    }

    fn get<T>(&mut self, place: usize, read: impl Fn(&Value) -> Option<T>) -> Result<(T, u32), EkiError> {
        let tag = self.tags.get_mut(place).ok_or(EkiError::Empty)?;
        let entry = tag.next().ok_or(EkiError::Empty)?;
        let found = read(&entry.value).map(|value| (value, entry.counter));
        if found.is_some() {
            tag.pop();
        }
        found.ok_or(EkiError::Type)
    }

    /// Removes and returns an integer, with the sequence number of its document.
    pub(super) fn get_int(&mut self, place: usize) -> Result<(i32, u32), EkiError> {
        self.get(place, as_int)
    }

    /// Removes and returns a real number, with the sequence number of its document.
    pub(super) fn get_real(&mut self, place: usize) -> Result<(f64, u32), EkiError> {
        self.get(place, |value| if let Value::Real(number) = value { Some(f64::from(*number)) } else { None })
    }

    /// Removes and returns the six numbers of a frame, with the sequence number of their document.
    pub(super) fn get_frame(&mut self, place: usize) -> Result<([f64; 6], u32), EkiError> {
        self.get(place, |value| if let Value::Frame(numbers) = value { Some(numbers.map(f64::from)) } else { None })
    }

    /// Discards all values in the buffers; the connection stays open.
    pub(super) fn clear_buffers(&mut self) {
        self.tags.iter_mut().for_each(|tag| tag.entries.clear());
    }

    /// Resets the receiving side, as when the channel is cleared, initialised and opened again: all values and an
    /// incomplete document are discarded.
    pub(super) fn clear(&mut self) {
        self.framer = Framer::new(self.file.limit_bytes);
        self.raised.clear();
        self.clear_buffers();
    }

    /// Returns the index of the element with this tag.
    pub(super) fn find(&self, tag: &str) -> Option<usize> {
        self.file.received.iter().position(|element| element.tag == tag)
    }

    /// Returns the index of the element with this tag; the element must have this type.
    pub(super) fn position_of(&self, tag: &'static str, kind: ElementKind) -> Result<usize, FileProblem> {
        let found = self.file.received.iter().position(|element| element.tag == tag && element.kind == Some(kind));
        found.ok_or(FileProblem::NotReceived(tag))
    }
}

pub(super) fn as_int(value: &Value) -> Option<i32> {
    if let Value::Int(number) = value { Some(*number) } else { None }
}

/// One channel: its received values and the bytes to be sent.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) memory: Memory,
    pub(super) out: Vec<u8>,
    pub(super) connected: bool,
    pub(super) fault: Option<EkiFault>,
    /// The time at which the program opens the channel again.
    pub(super) listens_at_ms: u64,
    pub(super) environment: Environment,
    pub(super) listens_for_ms: Option<u64>,
    /// The numbers of the $FLAG and $OUT that are true while a client is connected.
    pub(super) alive: (Option<u16>, Option<u16>),
    /// The flags and outputs that the channel's elements set.
    pub(super) raises: Vec<Raised>,
}

impl Link {
    pub(super) fn new(memory: Memory, file: &ChannelFile) -> Self {
        let flags = file.received.iter().filter_map(|element| element.set_flag.map(Raised::Flag));
        let outputs = file.received.iter().filter_map(|element| element.set_out.map(Raised::Output));
        Link {
            memory,
            out: Vec::new(),
            connected: false,
            fault: None,
            listens_at_ms: 0,
            environment: file.environment,
            listens_for_ms: file.listens_for_ms,
            alive: file.alive,
            raises: flags.chain(outputs).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELLSTAT: &str = include_str!("../../../config/kuka/CELLSTAT.xml");

    fn memory(change: impl Fn(&str) -> String) -> Memory {
        Memory::new(ChannelFile::parse(&change(CELLSTAT)).expect("read"))
    }

    fn shipped() -> Memory {
        memory(str::to_owned)
    }

    fn request(id: i32) -> String {
        format!("<Req Id=\"{id}\" Ep=\"0\" Op=\"9\" N1=\"0\"></Req>")
    }

    /// The limit is 64 values: the 65th value is still stored, but closes the channel.
    #[test]
    fn one_entry_too_many_is_stored_and_closes_the_channel() {
        let mut memory = shipped();
        let id = memory.position_of("Req/@Id", ElementKind::Int).expect("received");
        assert_eq!(memory.receive(format!("{}<Else/>", request(1)).repeat(64).as_bytes()), Ok(128));
        assert_eq!(memory.receive(request(2).as_bytes()), Err(EkiFault::Overflow));
        assert_eq!(memory.waiting_count(id), 65);
        // If the file states no limit, the buffer has room for 16 values.
        let mut memory = super::tests::memory(|file| file.replace(" Limit=\"64\"", ""));
        assert_eq!(memory.receive(request(1).repeat(16).as_bytes()), Ok(16));
        assert_eq!(memory.receive(request(1).as_bytes()), Err(EkiFault::Overflow));
    }

    /// Errors 15 and 20 of the manual: a read of an empty buffer does not wait, and a value of another type stays in
    /// the buffer.
    #[test]
    fn an_empty_memory_and_a_wrong_type_are_errors_at_once() {
        let mut memory = shipped();
        let id = memory.position_of("Req/@Id", ElementKind::Int).expect("received");
        assert_eq!(memory.get_int(id), Err(EkiError::Empty));
        assert_eq!(memory.receive(b"<Req Id=\"7\"></Req>oops"), Err(EkiFault::Malformed));
        assert_eq!(memory.get_real(id), Err(EkiError::Type));
        assert_eq!(memory.get_int(id), Ok((7, 1)), "what came before a fault stays");
        assert_eq!(memory.get_int(id), Err(EkiError::Empty));
        assert_eq!(memory.position_of("Req/@R1", ElementKind::Real), Err(FileProblem::NotReceived("Req/@R1")));
        assert_eq!(memory.position_of("Req/@Id", ElementKind::Real), Err(FileProblem::NotReceived("Req/@Id")));
    }

    /// N1 is missing in the second document. The program reads the N1 of a subsequent document instead, and only the
    /// sequence numbers show this.
    #[test]
    fn a_missing_element_lets_the_memories_drift() {
        let mut memory = shipped();
        let [id, n1] =
            ["Req/@Id", "Req/@N1"].map(|tag| memory.position_of(tag, ElementKind::Int).expect("received"));
        let without = "<Req Id=\"2\" Ep=\"0\" Op=\"9\"></Req><Req Id=\"3\" Ep=\"0\" Op=\"9\" N1=\"\"></Req>";
        memory.receive(format!("{}{without}{}", request(1), request(4)).as_bytes()).expect("good XML");
        assert_eq!((memory.waiting_count(id), memory.waiting_count(n1)), (4, 2));
        assert_eq!((memory.get_int(id), memory.get_int(n1)), (Ok((1, 1)), Ok((0, 1))));
        assert_eq!((memory.get_int(id), memory.get_int(n1)), (Ok((2, 2)), Ok((0, 4))));
        assert_eq!(memory.get_int(n1), Err(EkiError::Empty));
        memory.clear_buffers();
        assert_eq!(memory.waiting_count(id), 0);
    }

    /// The channel is LIFO, and one of its tags is FIFO.
    #[test]
    fn the_newest_entry_is_first_if_the_file_states_so() {
        let mut memory = memory(|file| {
            let file = file.replace("Mode=\"FIFO\"", "Mode=\"LIFO\"");
            file.replace("Tag=\"Req/@N1\" Type=\"INT\"", "Tag=\"Req/@N1\" Type=\"INT\" Mode=\"FIFO\"")
        });
        let [id, n1] =
            ["Req/@Id", "Req/@N1"].map(|tag| memory.position_of(tag, ElementKind::Int).expect("received"));
        for number in 1..=3 {
            let document = format!("<Req Id=\"{number}\" N1=\"{number}\"></Req>");
            memory.receive(document.as_bytes()).expect("good XML");
        }
        let mut all = |place| [0; 3].map(|_| memory.get_int(place).map(|(number, _)| number));
        assert_eq!(all(id), [Ok(3), Ok(2), Ok(1)]);
        assert_eq!(all(n1), [Ok(1), Ok(2), Ok(3)]);
    }

    /// The flag of the root element is set by each document, but the flag of a child element only if the document
    /// contains the child.
    #[test]
    fn elements_that_arrived_set_their_flags() {
        let mut memory = memory(|file| {
            let leaf = "Tag=\"Req/@N1\" Type=\"INT\"";
            file.replace(leaf, &format!("{leaf} Set_Flag=\"860\" Set_Out=\"12\""))
        });
        memory.receive(b"<Req Id=\"1\"></Req>").expect("good XML");
        assert_eq!(memory.remove_raised_signals(), [Raised::Flag(854)]);
        memory.receive(b"<Req Id=\"1\" N1=\"4\"></Req><Else/>").expect("good XML");
        assert_eq!(memory.remove_raised_signals(), [Raised::Flag(860), Raised::Output(12), Raised::Flag(854)]);
        assert_eq!(memory.remove_raised_signals(), []);
    }

    /// An incomplete document may have up to 16384 bytes; one more byte is an error.
    #[test]
    fn buffsize_limits_the_bytes_of_an_incomplete_document() {
        let mut memory = shipped();
        let open = format!("<Req Id=\"{}", " ".repeat(16_384 - 9));
        assert_eq!(memory.receive(open.as_bytes()), Ok(0));
        assert_eq!(memory.receive(b" "), Err(EkiFault::TooLong));
    }
}
