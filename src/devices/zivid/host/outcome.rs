//! How a request to a worker can fail, and how a worker is lost.

use crate::zivid::link::Answer;
use crate::zivid::message::Refusal;
use crate::zivid::wire::WireError;
use std::io::ErrorKind;
use std::time::Duration;

/// Number of attempts for a shot that the camera did not deliver: once and two more.
pub(in crate::zivid) const MAX_ATTEMPTS: u32 = 3;

/// The reason why the worker did not fulfil a request.
pub(super) enum RequestFailure {
    /// The worker is lost.
    Lost(WireError),
    /// The worker states the reason.
    Refused(Refusal),
}

impl From<WireError> for RequestFailure {
    fn from(error: WireError) -> Self {
        RequestFailure::Lost(error)
    }
}

/// How a worker was lost.
pub(super) enum WorkerLoss {
    /// The worker had already ended.
    Ended(String),
    /// The worker closed its end of the socket.
    HungUp,
    /// The worker does not answer.
    Stalled(Duration),
    /// Its data cannot be read.
    Damaged(String),
}

impl WorkerLoss {
    pub(super) fn from_wire_error(error: WireError, waited: Duration) -> Self {
        match error {
            WireError::Ended | WireError::Cut { .. } => WorkerLoss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::BrokenPipe => WorkerLoss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::ConnectionReset => WorkerLoss::HungUp,
            WireError::Io(error) if error.kind() == ErrorKind::TimedOut => WorkerLoss::Stalled(waited),
            WireError::Stalled { .. } => WorkerLoss::Stalled(waited),
            other => WorkerLoss::Damaged(other.to_string()),
        }
    }
}

pub(super) fn name(answer: &Answer) -> String {
    match answer {
        Answer::Words(_) => "the worker responded with another message".to_owned(),
        Answer::Scan(..) => "the worker responded with a 3D shot".to_owned(),
        Answer::Picture(..) => "the worker responded with a picture".to_owned(),
    }
}
