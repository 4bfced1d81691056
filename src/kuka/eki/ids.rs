//! Small values that all messages share: the numbers of commands and of the epochs in which they are sent, the time
//! of the session's clock, and fixed keywords that are read from a recording.

use serde::de::Error;
use serde::{Deserialize, Deserializer};
use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// A command's number, contiguous from 1 in each epoch; 0 means no command.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(transparent)]
pub struct CommandId(pub u32);

/// A sequence of commands that begins with a reset and ends with an abort, a stop or the loss of the link. An ended
/// epoch never moves the robot.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(transparent)]
pub struct Epoch(pub u32);

impl std::fmt::Display for CommandId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

impl std::fmt::Display for Epoch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// The maximum by which one request may raise the controller's epoch, and by which one message may be ahead of the
/// known epoch. A cell opens a few thousand epochs a day, so no real epoch is farther away. Two thousand wrong
/// messages would be needed to exhaust the counter.
pub const MAX_EPOCH_STEP: u32 = 1_000_000;
/// A controller that begins a connection with a higher epoch is refused, since hardly any numbers would be left.
pub(super) const MAX_EPOCH: u32 = 2_000_000_000;

/// The largest number: numbers on the wire are signed 32-bit integers.
pub(super) const LAST_NUMBER: u32 = i32::MAX.cast_unsigned();

/// A moment, counted from any fixed start: that of the link on a real robot, that of the controller in lock step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Time(Duration);

impl Time {
    /// Returns the moment at this time after the start.
    pub fn from_start(since: Duration) -> Self {
        Time(since)
    }

    /// Returns the moment at this count of milliseconds.
    pub fn from_ms(ms: u64) -> Self {
        Time(Duration::from_millis(ms))
    }

    /// Returns the time since the start.
    pub fn since_start(self) -> Duration {
        self.0
    }

    /// Returns the time since `earlier`; zero if `earlier` is not in the past.
    pub fn since(self, earlier: Time) -> Duration {
        self.0.saturating_sub(earlier.0)
    }
}

impl std::ops::Add<Duration> for Time {
    type Output = Time;
    fn add(self, span: Duration) -> Time {
        Time(self.0.saturating_add(span))
    }
}

/// A keyword from this program's own text.
pub(super) type Keyword = &'static str;

/// Length of the longest keyword.
const MAX_KEYWORD_BYTES: usize = 100;

/// Reads a keyword from a recording. Each keyword is stored once until the program ends: there are some tens.
pub(super) fn intern_keyword<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Keyword, D::Error> {
    static KNOWN_KEYWORDS: Mutex<BTreeSet<Keyword>> = Mutex::new(BTreeSet::new());
    let text = String::deserialize(deserializer)?;
    if text.len() > MAX_KEYWORD_BYTES {
        return Err(D::Error::custom(format!(
            "the text has {} bytes (limit {MAX_KEYWORD_BYTES} bytes)",
            text.len()
        )));
    }
    let mut known = KNOWN_KEYWORDS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(word) = known.get(text.as_str()) {
        return Ok(word);
    }
    let word: Keyword = text.leak();
    known.insert(word);
    Ok(word)
}
