//! The compliant tool's commands and answers in a recording.

use super::recordable::{Heard, Recordable, read, told, value};
use crate::daemon::ports::{ToolAnswer, ToolCommand};
use crate::daemon::replay::queue::Recorder;
use crate::eki::Time;
use crate::tape::Topic;
use serde_json::Value;

impl Recordable for ToolCommand {
    fn said(&self) -> Option<(Topic, Value)> {
        Some(match self {
            ToolCommand::Press(_) => (Topic::Tool, told(self)),
            ToolCommand::News => (Topic::Tool, Value::Null),
        })
    }

    fn heard(answer: &ToolAnswer, _: &Recorder) -> Option<Heard> {
        match answer {
            ToolAnswer::Told => value(Value::Null),
            ToolAnswer::News(news) => news.as_ref().and_then(|news| value(told(news))),
        }
    }

    fn answer(&self, heard: Heard) -> Result<ToolAnswer, serde_json::Error> {
        Ok(match self {
            ToolCommand::Press(_) => ToolAnswer::Told,
            ToolCommand::News => ToolAnswer::News(Some(read(heard)?)),
        })
    }

    fn otherwise(&self, _: Time, _: bool) -> ToolAnswer {
        match self {
            ToolCommand::Press(_) => ToolAnswer::Told,
            ToolCommand::News => ToolAnswer::News(None),
        }
    }
}
