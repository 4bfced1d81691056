//! Basic types that all messages share: command numbers, epoch numbers, the time of the session's clock, and keywords
//! that are read from a recording.

use serde::de::Error;
use serde::{Deserialize, Deserializer};
use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// The number of a command. In each epoch the numbers are contiguous from 1; 0 means no command.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(transparent)]
pub struct CommandId(pub u32);

/// The number of an epoch: a sequence of commands that begins with a reset and ends with an abort, a stop or the loss
/// of the link. An ended epoch never moves the robot.
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

/// Maximum step by which one request may raise the controller's epoch, and by which one message may be ahead of the
/// known epoch. A cell opens a few thousand epochs a day, so a larger step is an error. Two thousand wrong messages
/// would be needed to exhaust the counter.
pub const MAX_EPOCH_STEP: u32 = 1_000_000;
/// Maximum epoch of a controller at the begin of a connection. A controller with a higher epoch is refused, because too
/// few epoch numbers would remain.
pub(super) const MAX_EPOCH: u32 = 2_000_000_000;

/// The maximum number of an epoch or a command: numbers in messages are signed 32-bit integers.
pub(super) const LAST_NUMBER: u32 = i32::MAX.cast_unsigned();

/// A point in time, counted from a fixed start: the start of the link for a real robot, the start of the controller in
/// lock step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Time(Duration);

impl Time {
    /// Returns the point in time at this duration after the start.
    pub fn from_start(since: Duration) -> Self {
        Time(since)
    }

    /// Returns the point in time at this number of milliseconds after the start.
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

/// A keyword that is defined in this program's source.
pub(super) type Keyword = &'static str;

/// Maximum length of a keyword, bytes.
const MAX_KEYWORD_BYTES: usize = 100;

/// Reads a keyword from a recording. Each different keyword is allocated once and never freed; there are fewer than a
/// hundred.
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
