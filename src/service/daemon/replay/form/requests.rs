//! Requests, and the reports about them, in a recording.

use super::recordable::{Recordable, RecordedAnswer, value};
use crate::daemon::ports::{LoopEvent, RequestAnswer, RequestCommand};
use crate::daemon::replay::queue::Recorder;
use crate::daemon::replay::switch::RecordingSwitch;
use crate::daemon::request::{Request, RequestKind};
use panelprep_cell::cycle;
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_kuka::eki::Time;
use panelprep_store::tape::Topic;
use serde_json::{Value, json};

impl Recordable for RequestCommand {
    fn recorded_command(&self) -> Option<(Topic, Value)> {
        Some(match self {
            RequestCommand::Next(_) => (Topic::Request, Value::Null),
            RequestCommand::LetsIn(_) => (Topic::Result, Value::Null),
            RequestCommand::Publish(LoopEvent::Refused(request, refusal)) => {
                (Topic::Request, json!({ "refused": [request, refusal] }))
            }
            RequestCommand::Publish(LoopEvent::Unable(reasons)) => (Topic::Request, json!({ "unable": reasons })),
            RequestCommand::Publish(LoopEvent::NotPermitted(reasons)) => {
                (Topic::Request, json!({ "not_permitted": reasons }))
            }
            RequestCommand::Publish(_) => return None,
        })
    }

    fn recorded_answer(answer: &RequestAnswer, _: &Recorder) -> Option<RecordedAnswer> {
        match answer {
            RequestAnswer::Next(Ok(Some(Request { what, .. }))) => value(match what {
                RequestKind::Table(request) => json!({ "for": request }),
                // The start itself is recorded only if the state table refuses it; a start that is accepted begins a
                // recording of its own.
                RequestKind::Begin(prepared) => json!({ "for": prepared.request }),
                // The reason changes nothing of what the cell does.
                RequestKind::Hold { .. } => json!({ "for": cycle::Request::Hold }),
                RequestKind::NewDisc => json!("new_disc"),
                RequestKind::Leave => json!("leave"),
                RequestKind::Refused { .. }
                | RequestKind::Outdated { .. }
                | RequestKind::Decided { .. }
                | RequestKind::State
                | RequestKind::Start(_)
                | RequestKind::Shoot(_) => return None,
            }),
            RequestAnswer::Next(_) | RequestAnswer::LetsIn(None) => None,
            RequestAnswer::LetsIn(Some(result)) => value(json!(result)),
            RequestAnswer::Done => value(Value::Null),
        }
    }

    fn parse_answer(&self, heard: RecordedAnswer) -> Result<RequestAnswer, serde_json::Error> {
        Ok(match self {
            RequestCommand::LetsIn(result) => RequestAnswer::LetsIn(Some(*result)),
            RequestCommand::Publish(_) => RequestAnswer::Done,
            RequestCommand::Next(_) => {
                let what = match heard.value {
                    Value::String(word) if word == "leave" => RequestKind::Leave,
                    Value::String(word) if word == "new_disc" => RequestKind::NewDisc,
                    mut asked => {
                        let request = asked.get_mut("for").map(Value::take).unwrap_or_default();
                        RequestKind::Table(serde_json::from_value(request)?)
                    }
                };
                next(what)
            }
        })
    }

    fn default_answer(&self, _: Time, has_parted: bool) -> RequestAnswer {
        match self {
            // This request ends the loop, because the player's record refuses it.
            RequestCommand::Next(_) if has_parted => next(RequestKind::Table(cycle::Request::Abort)),
            RequestCommand::Next(_) => RequestAnswer::Next(Ok(None)),
            RequestCommand::LetsIn(_) => RequestAnswer::LetsIn(None),
            RequestCommand::Publish(_) => RequestAnswer::Done,
        }
    }

    fn is_matching_answer(&self, heard: &Value) -> bool {
        match self {
            RequestCommand::LetsIn(result) => *heard == json!(result),
            _ => true,
        }
    }

    fn before_command(&self, switch: &RecordingSwitch) {
        match self {
            RequestCommand::Next(state) => switch.on_request_poll(state),
            RequestCommand::Publish(LoopEvent::Begun(cycle, before)) => {
                switch.on_cycle_start(*cycle, before.clone())
            }
            _ => {}
        }
    }

    fn after_answer(answer: &mut RequestAnswer, switch: &RecordingSwitch) {
        if let RequestAnswer::Next(Ok(Some(Request { what: RequestKind::Begin(prepared), .. }))) = answer {
            switch.on_order(prepared.recording.take(), prepared.request);
        }
    }
}

fn next(what: RequestKind) -> RequestAnswer {
    RequestAnswer::Next(Ok(Some(Request::new(what, RequestAuthor::from_source(RequestSource::Program)))))
}
