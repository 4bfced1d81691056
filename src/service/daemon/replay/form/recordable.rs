//! The part of a port's traffic that a recording can contain.

use crate::daemon::ports::Command;
use crate::daemon::replay::queue::Recorder;
use crate::daemon::replay::switch::RecordingSwitch;
use panelprep_kuka::eki::Time;
use panelprep_store::tape::{Shot, Topic};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// An answer of a port.
#[derive(Debug, Default)]
pub struct RecordedAnswer {
    pub value: Value,
    pub shot: Option<Shot>,
}

/// A command that a recording can contain.
pub trait Recordable: Command {
    /// Returns the command's topic, and its form in the recording; null if the loop only listens. `None` if the
    /// command is not recorded, since it follows from the data that the loop receives.
    fn recorded_command(&self) -> Option<(Topic, Value)>;

    /// Returns the answer in the recording; `None` if an answer such as this one is not recorded.
    fn recorded_answer(answer: &Self::Answer, recorder: &Recorder) -> Option<RecordedAnswer>;

    /// Returns the recorded answer to the command.
    fn parse_answer(&self, heard: RecordedAnswer) -> Result<Self::Answer, serde_json::Error>;

    /// Returns the answer if the recording has none: the command is not recorded, there was no data, or the replay has
    /// diverged from the recording. `now` is the clock's last reading.
    fn default_answer(&self, now: Time, has_parted: bool) -> Self::Answer;

    /// Returns whether a recorded answer is the one for which the loop waits; true if the loop accepts any answer.
    fn is_matching_answer(&self, _heard: &Value) -> bool {
        true
    }

    /// Returns whether a recording may leave the command out.
    fn is_optional(&self) -> bool {
        false
    }

    /// Informs the switch before the command is performed.
    fn before_command(&self, _switch: &RecordingSwitch) {}

    /// Informs the switch about the answer.
    fn after_answer(_answer: &mut Self::Answer, _switch: &RecordingSwitch) {}
}

/// Returns a value as it is written down; null if it cannot be written.
pub(in crate::daemon::replay) fn to_json(value: &impl Serialize) -> Value {
    serde_json::to_value(value).unwrap_or(Value::Null)
}

pub(super) fn value(value: Value) -> Option<RecordedAnswer> {
    Some(RecordedAnswer { value, shot: None })
}

pub(super) fn read<T: DeserializeOwned>(heard: RecordedAnswer) -> Result<T, serde_json::Error> {
    serde_json::from_value(heard.value)
}
