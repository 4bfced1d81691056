//! The robot's commands and answers in a recording.

use super::recordable::{Recordable, RecordedAnswer, read, to_json, value};
use crate::daemon::ports::{RobotAnswer, RobotCommand};
use crate::daemon::replay::queue::Recorder;
use panelprep_kuka::eki::{QueueError, Time};
use panelprep_store::tape::Topic;
use serde_json::{Value, json};
use std::time::Duration;

impl Recordable for RobotCommand {
    fn recorded_command(&self) -> Option<(Topic, Value)> {
        Some(match self {
            RobotCommand::Send(command) => (Topic::Command, json!({ "send": command })),
            RobotCommand::Path { points, .. } => (Topic::Command, json!({ "path": points })),
            RobotCommand::OpenEpoch(above) => (Topic::Command, json!({ "open_epoch_above": above })),
            RobotCommand::Abort => (Topic::Command, json!("abort")),
            RobotCommand::Next => (Topic::Report, Value::Null),
            RobotCommand::Now => (Topic::Clock, Value::Null),
            RobotCommand::Permit(_) => return None,
        })
    }

    fn recorded_answer(answer: &RobotAnswer, recorder: &Recorder) -> Option<RecordedAnswer> {
        match answer {
            RobotAnswer::Queued(queued) => value(to_json(queued)),
            RobotAnswer::Epoch(opened) => value(to_json(opened)),
            RobotAnswer::Done(done) => value(to_json(done)),
            RobotAnswer::Report(Ok(Some(report))) => value(to_json(report)),
            RobotAnswer::Report(_) => None,
            RobotAnswer::Time(now) => {
                let since = now.since_start();
                let is_new = recorder.clock(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX));
                // With the wall clock every reading is recorded, even if two are equal: a replay needs each of them.
                if is_new || !recorder.is_lock_step() { value(to_json(&since)) } else { None }
            }
        }
    }

    fn parse_answer(&self, heard: RecordedAnswer) -> Result<RobotAnswer, serde_json::Error> {
        Ok(match self {
            RobotCommand::Send(_) | RobotCommand::Path { .. } => RobotAnswer::Queued(read(heard)?),
            RobotCommand::OpenEpoch(_) => RobotAnswer::Epoch(read(heard)?),
            RobotCommand::Abort | RobotCommand::Permit(_) => RobotAnswer::Done(read(heard)?),
            RobotCommand::Next => RobotAnswer::Report(Ok(Some(read(heard)?))),
            RobotCommand::Now => RobotAnswer::Time(Time::from_start(read::<Duration>(heard)?)),
        })
    }

    fn default_answer(&self, now: Time, _: bool) -> RobotAnswer {
        match self {
            RobotCommand::Send(_) | RobotCommand::Path { .. } => RobotAnswer::Queued(Err(QueueError::NotConnected)),
            RobotCommand::OpenEpoch(_) => RobotAnswer::Epoch(Err(QueueError::NotConnected)),
            RobotCommand::Abort => RobotAnswer::Done(Err(QueueError::NotConnected)),
            RobotCommand::Permit(_) => RobotAnswer::Done(Ok(())),
            RobotCommand::Next => RobotAnswer::Report(Ok(None)),
            RobotCommand::Now => RobotAnswer::Time(now),
        }
    }
}
