//! The messages of the cell's programs: commands, requests and refusals with their numbers in the protocol, and the
//! last documents that the controller sent.

use super::channel_file::{EkiFault, ElementKind, FileProblem};
use super::codec::Template;
use super::memory::{Memory, as_int};
use super::setup::Setup;

/// The tags that the programs set in each message, in the order in which they set them.
const ACK_TAGS: [&str; 6] = ["Ack/@Rx", "Ack/@Done", "Ack/@Free", "Ack/@Err", "Ack/@ErrId", "Ack/@Ep"];
#[rustfmt::skip] // a row for each element
const STATE_TAGS: [&str; 37] = [
    "St/@T", "St/@Seq", "St/@Re", "St/@Ep", "St/@Boot", "St/@Sum",
    "St/@Mode", "St/@Flags", "St/@In", "St/@Out", "St/@Done", "St/@Under", "St/@Ov",
    "St/J/@A1", "St/J/@A2", "St/J/@A3", "St/J/@A4", "St/J/@A5", "St/J/@A6",
    "St/Tcp/@X", "St/Tcp/@Y", "St/Tcp/@Z", "St/Tcp/@A", "St/Tcp/@B", "St/Tcp/@C",
    "St/Base/@X", "St/Base/@Y", "St/Base/@Z", "St/Base/@A", "St/Base/@B", "St/Base/@C",
    "St/Tool/@X", "St/Tool/@Y", "St/Tool/@Z", "St/Tool/@A", "St/Tool/@B", "St/Tool/@C",
];

pub(super) const MOVE_J: i32 = 1;
pub(super) const MOVE_LIN: i32 = 2;
pub(super) const SET_BASE: i32 = 3;
pub(super) const SET_TCP: i32 = 4;
pub(super) const SET_ACC_SPEED: i32 = 5;
pub(super) const SET_DIGOUT: i32 = 6;
pub(super) const SET_DIGIN: i32 = 7;
pub(super) const CALL_SUBROUTINE: i32 = 8;
pub(super) const HEARTBEAT: i32 = 10;
pub(super) const ABORT: i32 = 11;
pub(super) const RESET: i32 = 12;
pub(super) const LINE: i32 = 13;
/// The bits of the outputs to a production line while no client is connected: only the fault output is on.
pub(super) const UNCONNECTED_LINE_OUTPUTS: i32 = 32;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Ack {
    pub(super) received: i32,
    pub(super) done: i32,
    pub(super) free: i32,
    pub(super) refusal: (i32, i32),
    pub(super) epoch: i32,
}

/// The last documents that were sent, to detect changes.
#[derive(Debug)]
pub(super) struct LastAnswers {
    pub(super) ack: Template,
    pub(super) state: Template,
    pub(super) last_ack: Option<(Ack, u64)>,
    pub(super) last_state_ms: u64,
    pub(super) sequence: i32,
    pub(super) answered: i32,
}

impl LastAnswers {
    pub(super) fn new(setup: &Setup) -> Self {
        LastAnswers {
            ack: Template::new(&setup.commands.sent, &ACK_TAGS),
            state: Template::new(&setup.states.sent, &STATE_TAGS),
            last_ack: None,
            last_state_ms: 0,
            sequence: setup.first_state,
            answered: 0,
        }
    }

    /// Discards the last acknowledgement, because nothing was sent to a new client.
    pub(super) fn forget_ack(&mut self) {
        self.last_ack = None;
    }
}

/// A channel of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// CELLCMD: receives commands, sends acknowledgements.
    Command,
    /// CELLSTAT: receives requests, sends state messages.
    State,
}

impl Channel {
    pub(super) fn opposite(self) -> Self {
        match self {
            Channel::Command => Channel::State,
            Channel::State => Channel::Command,
        }
    }
}

/// The reason why a command is refused; its number is the attribute `Err` of the acknowledgement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The command's id is not the next one.
    IdGap = 1,
    /// The command does not belong to the current epoch.
    WrongEpoch = 2,
    /// The ring is full.
    RingFull = 3,
    /// The operation is not known.
    UnknownOperation = 4,
    /// A value is outside of its range.
    OutOfRange = 5,
    /// The base or the tool was not set in this epoch.
    NoBaseOrTool = 6,
    /// The input cannot be set.
    ReadOnly = 7,
    /// The target is out of reach, or an axis would be outside of its limits.
    Unreachable = 8,
    /// Mode, drives, emergency stop or guard do not permit motion.
    NoMotion = 9,
    /// The program has stopped this epoch.
    Stopped = 10,
    /// A motion with contact was commanded at an override other than 100 %.
    Override = 11,
    /// A linear motion ends outside of the box, or is too long in contact.
    OutsideBox = 12,
}

impl Refusal {
    /// Returns the refusal with this number.
    pub(super) fn from_number(number: u8) -> Option<Self> {
        let all = [
            Refusal::IdGap,
            Refusal::WrongEpoch,
            Refusal::RingFull,
            Refusal::UnknownOperation,
            Refusal::OutOfRange,
            Refusal::NoBaseOrTool,
            Refusal::ReadOnly,
            Refusal::Unreachable,
            Refusal::NoMotion,
            Refusal::Stopped,
            Refusal::Override,
            Refusal::OutsideBox,
        ];
        all.into_iter().find(|refusal| *refusal as u8 == number)
    }
}

/// A command that was received.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Command {
    pub(super) id: i32,
    pub(super) epoch: i32,
    pub(super) operation: i32,
    pub(super) n: [i32; 2],
    pub(super) r: [f64; 2],
    /// The pose X, Y, Z, A, B, C, or the angles of the axes 1 to 6.
    pub(super) p: [f64; 6],
}

/// A request that was received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) id: i32,
    pub(super) epoch: i32,
    pub(super) operation: i32,
    pub(super) n1: i32,
}

/// The indices of a command's elements in the channel's buffers.
#[derive(Debug, Clone, Copy)]
pub(super) struct CommandPositions {
    ints: [usize; 5],
    reals: [usize; 2],
    frame: usize,
}

impl CommandPositions {
    pub(super) fn new(memory: &Memory) -> Result<Self, FileProblem> {
        let ints = ["Cmd/@Id", "Cmd/@Ep", "Cmd/@Op", "Cmd/@N1", "Cmd/@N2"];
        let [id, epoch, operation, n1, n2] = ints.map(|tag| memory.position_of(tag, ElementKind::Int));
        let (r1, r2) =
            (memory.position_of("Cmd/@R1", ElementKind::Real)?, memory.position_of("Cmd/@R2", ElementKind::Real)?);
        let ints = [id?, epoch?, operation?, n1?, n2?];
        Ok(CommandPositions { ints, reals: [r1, r2], frame: memory.position_of("Cmd/P", ElementKind::Frame)? })
    }

    /// Returns whether a command is in the buffers, complete or not.
    pub(super) fn is_waiting(&self, memory: &Memory) -> bool {
        memory.waiting_count(self.ints[0]) > 0
    }

    /// Reads the eight elements of the next command from the buffers; all must have the sequence number of the same
    /// document.
    pub(super) fn pop(&self, memory: &mut Memory) -> Result<Command, EkiFault> {
        let mut row = RowReader::default();
        let [id, epoch, operation, n1, n2] = self.ints.map(|place| row.take_value(memory.get_int(place)));
        let [r1, r2] = self.reals.map(|place| row.take_value(memory.get_real(place)));
        let p = row.take_value(memory.get_frame(self.frame));
        row.finish()?;
        Ok(Command { id, epoch, operation, n: [n1, n2], r: [r1, r2], p })
    }

    /// Returns the epoch and the id of the next command, which define the order of commands.
    pub(super) fn next_epoch_and_id(&self, memory: &Memory) -> Option<(i32, i32)> {
        let number = |place| memory.peek_value(place).ok().and_then(as_int);
        Some((number(self.ints[1])?, number(self.ints[0])?))
    }

    /// Returns the epoch and the id of the last command that arrived; `None` if one of the two is missing.
    pub(super) fn newest_epoch_and_id(&self, memory: &Memory) -> Option<(i32, i32)> {
        let [(id, of_id), (epoch, of_epoch)] =
            [memory.newest_value(self.ints[0]).ok()?, memory.newest_value(self.ints[1]).ok()?];
        let one_document = of_id == of_epoch;
        Some((as_int(epoch)?, as_int(id)?)).filter(|_| one_document)
    }
}

/// The indices of a request's elements in the channel's buffers.
#[derive(Debug, Clone, Copy)]
pub(super) struct RequestPositions([usize; 4]);

impl RequestPositions {
    /// Returns the number of requests in the buffers.
    pub(super) fn waiting_count(&self, memory: &Memory) -> usize {
        memory.waiting_count(self.0[0])
    }

    pub(super) fn new(memory: &Memory) -> Result<Self, FileProblem> {
        let tags = ["Req/@Id", "Req/@Ep", "Req/@Op", "Req/@N1"];
        let [id, epoch, operation, n1] = tags.map(|tag| memory.position_of(tag, ElementKind::Int));
        Ok(RequestPositions([id?, epoch?, operation?, n1?]))
    }

    /// Returns whether a request is in the buffers, complete or not.
    pub(super) fn is_waiting(&self, memory: &Memory) -> bool {
        memory.waiting_count(self.0[0]) > 0
    }

    /// Returns operation, epoch and N1 of the next request, and keeps it in the buffers; `None` if one of them is
    /// missing.
    pub(super) fn next(&self, memory: &Memory) -> Option<Request> {
        let [id, epoch, operation, n1] = self.0.map(|place| memory.peek_value(place).ok().and_then(as_int));
        Some(Request { id: id?, epoch: epoch?, operation: operation?, n1: n1? })
    }

    /// Removes and returns the next request.
    pub(super) fn pop(&self, memory: &mut Memory) -> Result<Request, EkiFault> {
        let mut row = RowReader::default();
        let [id, epoch, operation, n1] = self.0.map(|place| row.take_value(memory.get_int(place)));
        row.finish()?;
        Ok(Request { id, epoch, operation, n1 })
    }
}

/// Reads the values of one command or request; all must belong to the same document.
#[derive(Default)]
struct RowReader {
    fault: Option<EkiFault>,
    counter: Option<u32>,
}

impl RowReader {
    fn take_value<T: Default>(&mut self, read: Result<(T, u32), super::channel_file::EkiError>) -> T {
        match read {
            Ok((value, counter)) => {
                if *self.counter.get_or_insert(counter) != counter {
                    self.fault.get_or_insert(EkiFault::Drifted);
                }
                value
            }
            Err(error) => {
                self.fault.get_or_insert(EkiFault::Unread(error));
                T::default()
            }
        }
    }

    fn finish(self) -> Result<(), EkiFault> {
        self.fault.map_or(Ok(()), Err)
    }
}
