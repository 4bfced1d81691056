//! What the cell's programs understand: commands, requests, refusals; their numbers on the wire.

use super::codec::Record;
use super::fault::{EkiFault, FileProblem};
use super::memory::{Memory, frame, int, real};

/// A channel of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// CELLCMD: commands in, acknowledgements out.
    Command,
    /// CELLSTAT: requests in, states out.
    State,
}

/// Why a command is refused; the number is `Err` in the acknowledgement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// Its id is not the next one.
    IdGap = 1,
    /// Its epoch is not the present one.
    WrongEpoch = 2,
    /// No place in the ring.
    RingFull = 3,
    /// No such operation.
    UnknownOperation = 4,
    /// A number is outside of its range.
    OutOfRange = 5,
    /// Base or tool was not set in this epoch.
    NoBaseOrTool = 6,
    /// An input cannot be written.
    ReadOnly = 7,
    /// Out of reach, or beyond an axis's limit.
    Unreachable = 8,
    /// Mode, drives, e-stop or guard do not let the arm move.
    NoMotion = 9,
    /// The program has stopped this epoch.
    Stopped = 10,
}

/// A command as it was received.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Command {
    pub(super) id: i32,
    pub(super) epoch: i32,
    pub(super) operation: i32,
    pub(super) n: [i32; 2],
    pub(super) r: [f64; 2],
    /// X Y Z A B C, or the axes 1 to 6.
    pub(super) p: [f64; 6],
}

/// A request as it was received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) id: i32,
    pub(super) epoch: i32,
    pub(super) operation: i32,
    pub(super) n1: i32,
}

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

/// Where a command's values stand in a record.
#[derive(Debug, Clone, Copy)]
pub(super) struct CommandPlaces {
    ints: [usize; 5],
    reals: [usize; 2],
    frame: usize,
}

impl CommandPlaces {
    pub(super) fn new(memory: &Memory) -> Result<Self, FileProblem> {
        let ints = ["Cmd/@Id", "Cmd/@Ep", "Cmd/@Op", "Cmd/@N1", "Cmd/@N2"];
        let [id, epoch, operation, n1, n2] = ints.map(|tag| memory.place(tag));
        let (r1, r2) = (memory.place("Cmd/@R1")?, memory.place("Cmd/@R2")?);
        let ints = [id?, epoch?, operation?, n1?, n2?];
        Ok(CommandPlaces { ints, reals: [r1, r2], frame: memory.place("Cmd/P")? })
    }

    pub(super) fn command(&self, record: &Record) -> Result<Command, EkiFault> {
        let [id, epoch, operation, n1, n2] = self.ints.map(|place| int(record, place));
        let [r1, r2] = self.reals.map(|place| real(record, place));
        let (n, r) = ([n1?, n2?], [r1?, r2?]);
        Ok(Command { id: id?, epoch: epoch?, operation: operation?, n, r, p: frame(record, self.frame)? })
    }

    /// Epoch and id, which order the commands.
    pub(super) fn order(&self, record: &Record) -> Result<(i32, i32), EkiFault> {
        Ok((int(record, self.ints[1])?, int(record, self.ints[0])?))
    }
}

/// Where a request's values stand in a record.
#[derive(Debug, Clone, Copy)]
pub(super) struct RequestPlaces([usize; 4]);

impl RequestPlaces {
    pub(super) fn new(memory: &Memory) -> Result<Self, FileProblem> {
        let [id, epoch, operation, n1] = ["Req/@Id", "Req/@Ep", "Req/@Op", "Req/@N1"].map(|tag| memory.place(tag));
        Ok(RequestPlaces([id?, epoch?, operation?, n1?]))
    }

    pub(super) fn request(&self, record: &Record) -> Result<Request, EkiFault> {
        let [id, epoch, operation, n1] = self.0.map(|place| int(record, place));
        Ok(Request { id: id?, epoch: epoch?, operation: operation?, n1: n1? })
    }
}
