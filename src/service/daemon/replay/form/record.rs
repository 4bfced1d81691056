//! The record's commands and answers in a recording.

use super::recordable::{Recordable, RecordedAnswer, read, to_json, value};
use crate::daemon::ports::{Note, RecordAnswer, RecordCommand, RecordError, StoredPicture};
use crate::daemon::replay::queue::Recorder;
use crate::daemon::replay::switch::RecordingSwitch;
use panelprep_base::phase::Phase;
use panelprep_kuka::eki::Time;
use panelprep_store::tape::Topic;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

/// The question which grids of the panel were abraded in earlier cycles.
const EARLIER_ABRASIONS: &str = "abraded_before";

impl Recordable for RecordCommand {
    fn recorded_command(&self) -> Option<(Topic, Value)> {
        let said = match self {
            RecordCommand::Note(Note::Finding(finding)) => return Some((Topic::Finding, to_json(finding))),
            RecordCommand::Event(event) => return Some((Topic::Event, to_json(event))),
            RecordCommand::Note(note) => note_form(note),
            // The number of permitted waypoints follows from the reports of the robot.
            RecordCommand::OpenIntent(motion) | RecordCommand::OpenContact { motion, .. } => {
                json!({ "open_intent": motion })
            }
            RecordCommand::CloseIntent { motion, outcome, done } => {
                json!({ "close_intent": { "motion": motion, "outcome": outcome, "done": done } })
            }
            RecordCommand::AbradedBefore => json!(EARLIER_ABRASIONS),
            RecordCommand::Conclude { verdict, because } => json!({ "conclude": verdict, "because": because }),
            RecordCommand::Begin(_) => json!("begin"),
            RecordCommand::DiscWorn => json!("disc_worn_mm2"),
            RecordCommand::WearDisc(swept_mm2) => json!({ "wear_disc_mm2": swept_mm2 }),
            RecordCommand::MountDisc => json!("mount_disc"),
            RecordCommand::Check => json!("check"),
            RecordCommand::Filled => Value::Null,
            // The author of a request and the time of the clock are not part of a cycle's decisions.
            RecordCommand::Permit(_)
            | RecordCommand::Asked(_)
            | RecordCommand::Clock(_)
            | RecordCommand::BetweenCycles => return None,
        };
        Some((Topic::Store, said))
    }

    fn recorded_answer(answer: &Self::Answer, _: &Recorder) -> Option<RecordedAnswer> {
        let ok = |heard: Value| value(json!({ "Ok": heard }));
        match answer {
            Ok(RecordAnswer::Done) => ok(Value::Null),
            Ok(RecordAnswer::Cycle(cycle)) => ok(json!(cycle)),
            Ok(RecordAnswer::Concluded(verdict)) => ok(json!(verdict)),
            Ok(RecordAnswer::Worn(worn_mm2)) => ok(json!(worn_mm2)),
            // An empty list is not recorded: a replay then receives none either.
            Ok(RecordAnswer::Earlier(earlier)) => ok(json!(earlier)).filter(|_| !earlier.is_empty()),
            Ok(RecordAnswer::Wrong(reasons)) => value(json!(reasons)),
            Ok(RecordAnswer::Full(why)) => why.as_ref().and_then(|why| value(json!(why))),
            Err(error) => value(json!({ "Err": error.0.to_string() })),
        }
    }

    fn parse_answer(&self, heard: RecordedAnswer) -> Result<Self::Answer, serde_json::Error> {
        fn parse_record_answer<T: DeserializeOwned>(
            heard: RecordedAnswer,
        ) -> Result<Result<T, RecordError>, serde_json::Error> {
            let kept: Result<T, String> = read(heard)?;
            Ok(kept.map_err(|words| RecordError(words.into())))
        }
        Ok(match self {
            RecordCommand::Begin(_) => parse_record_answer(heard)?.map(RecordAnswer::Cycle),
            RecordCommand::Conclude { .. } => parse_record_answer(heard)?.map(RecordAnswer::Concluded),
            RecordCommand::DiscWorn => parse_record_answer(heard)?.map(RecordAnswer::Worn),
            RecordCommand::AbradedBefore => parse_record_answer(heard)?.map(RecordAnswer::Earlier),
            RecordCommand::Check => Ok(RecordAnswer::Wrong(read(heard)?)),
            RecordCommand::Filled => Ok(RecordAnswer::Full(Some(read(heard)?))),
            _ => parse_record_answer::<()>(heard)?.map(|()| RecordAnswer::Done),
        })
    }

    fn default_answer(&self, _: Time, _: bool) -> Self::Answer {
        match self {
            RecordCommand::Permit(_)
            | RecordCommand::Asked(_)
            | RecordCommand::Clock(_)
            | RecordCommand::BetweenCycles => Ok(RecordAnswer::Done),
            RecordCommand::AbradedBefore => Ok(RecordAnswer::Earlier(vec![])),
            RecordCommand::Check => Ok(RecordAnswer::Wrong(vec![])),
            RecordCommand::Filled => Ok(RecordAnswer::Full(None)),
            _ => Err(RecordError("the replay differs from the recording".into())),
        }
    }

    fn is_optional(&self) -> bool {
        matches!(self, RecordCommand::AbradedBefore)
    }

    fn before_command(&self, switch: &RecordingSwitch) {
        if matches!(self, RecordCommand::BetweenCycles) {
            switch.on_cycle_end();
        }
    }
}

/// Returns the recorded form of a phase's result. A picture that is already in the store has the same form as one that
/// is still to be stored.
fn note_form(note: &Note) -> Value {
    let frame = |time_s: f64, phase: Phase| json!({ "frame": { "time_s": time_s, "phase": phase.keyword() } });
    let figure = |name: &str, caption: &str| json!({ "figure": { "name": name, "caption": caption } });
    match note {
        Note::Finding(finding) => to_json(finding),
        Note::Picture(name, _) => json!({ "picture": name }),
        Note::Kept(StoredPicture::Shot(shot)) => json!({ "picture": shot.name }),
        Note::Frame(_, time_s, phase) => frame(*time_s, *phase),
        Note::Kept(StoredPicture::Frame(kept)) => frame(kept.time_s, kept.phase),
        Note::Figure(drawn) => figure(&drawn.name, &drawn.caption),
        Note::Kept(StoredPicture::Figure(drawn)) => figure(&drawn.name, &drawn.caption),
        Note::Budget(measured) => json!({ "budget": measured }),
    }
}
