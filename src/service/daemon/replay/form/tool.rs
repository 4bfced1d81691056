//! The compliant tool's commands and answers in a recording.

use super::recordable::{Recordable, RecordedAnswer, read, to_json, value};
use crate::daemon::ports::{ToolAnswer, ToolCommand};
use crate::daemon::replay::queue::Recorder;
use panelprep_kuka::eki::Time;
use panelprep_store::tape::Topic;
use serde_json::Value;

impl Recordable for ToolCommand {
    fn recorded_command(&self) -> Option<(Topic, Value)> {
        Some(match self {
            ToolCommand::Press(_) => (Topic::Tool, to_json(self)),
            ToolCommand::Report => (Topic::Tool, Value::Null),
        })
    }

    fn recorded_answer(answer: &ToolAnswer, _: &Recorder) -> Option<RecordedAnswer> {
        match answer {
            ToolAnswer::Done => value(Value::Null),
            ToolAnswer::Report(news) => news.as_ref().and_then(|news| value(to_json(news))),
        }
    }

    fn parse_answer(&self, heard: RecordedAnswer) -> Result<ToolAnswer, serde_json::Error> {
        Ok(match self {
            ToolCommand::Press(_) => ToolAnswer::Done,
            ToolCommand::Report => ToolAnswer::Report(Some(read(heard)?)),
        })
    }

    fn default_answer(&self, _: Time, _: bool) -> ToolAnswer {
        match self {
            ToolCommand::Press(_) => ToolAnswer::Done,
            ToolCommand::Report => ToolAnswer::Report(None),
        }
    }
}
