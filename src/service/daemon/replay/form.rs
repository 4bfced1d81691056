//! The format of commands and answers in a recording, for each port of the loop. The recorder writes this format and
//! the player reads it, in the same way for all commands.
//!
//! [`Recordable`] converts a command and its answer to and from this format. [`RecordedPort`] is a port whose commands
//! and answers are recorded: each command passes unchanged, and is recorded while the recording switch is on.

use super::queue::Recorder;
use super::switch::RecordingSwitch;
use crate::daemon::ports::{
    CameraAnswer, CameraCommand, CameraFault, Command, LoopEvent, Note, Picture2d, Port, RecordAnswer,
    RecordCommand, RecordError, RequestAnswer, RequestCommand, RobotAnswer, RobotCommand, StoredPicture,
    ToolAnswer, ToolCommand,
};
use crate::daemon::request::{Request, RequestKind};
use panelprep_base::phase::Phase;
use panelprep_cell::cycle;
use panelprep_cell::record::{RequestAuthor, RequestSource, name};
use panelprep_kuka::eki::{QueueError, Time};
use panelprep_store::tape::{Entry, Shot, Topic};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::ops::DerefMut;
use std::sync::Arc;
use std::time::Duration;

/// Returns a finding in the form in which it is compared, without elapsed times, because these depend on the computer.
pub(super) fn without_measured_times(mut finding: Value) -> Value {
    let numbers = finding.get_mut("numbers").and_then(Value::as_array_mut);
    for number in numbers.into_iter().flatten() {
        let stopped = number["name"].as_str().is_some_and(|name| WALL_CLOCK_NUMBERS.contains(&name));
        if stopped {
            number["value"] = Value::Null;
        }
    }
    finding
}

/// Names of the measured times in findings that depend on the wall clock; no decision depends on them.
const WALL_CLOCK_NUMBERS: [&str; 2] = [name::SCAN_TO_VERDICT, name::PER_PICTURE];

/// An answer of a port in its recorded form.
#[derive(Debug, Default)]
pub struct RecordedAnswer {
    pub value: Value,
    pub shot: Option<Shot>,
}

/// A command that a recording can contain.
pub trait Recordable: Command {
    /// Returns the topic and the recorded form of the command; the form is null if the loop only receives data. Returns
    /// `None` if the command is not recorded, because it follows from the data that the loop receives.
    fn recorded_command(&self) -> Option<(Topic, Value)>;

    /// Returns the recorded form of the answer; `None` if this kind of answer is not recorded.
    fn recorded_answer(answer: &Self::Answer, recorder: &Recorder) -> Option<RecordedAnswer>;

    /// Converts the recorded form to the answer to this command.
    fn parse_answer(&self, heard: RecordedAnswer) -> Result<Self::Answer, serde_json::Error>;

    /// Returns the answer if the recording contains none: the command is not recorded, there were no data, or the
    /// replay has diverged from the recording. `now` is the last time that the clock returned.
    fn default_answer(&self, now: Time, has_diverged: bool) -> Self::Answer;

    /// Returns whether a recorded answer is the answer that the loop expects; true if the loop accepts any answer.
    fn is_matching_answer(&self, _heard: &Value) -> bool {
        true
    }

    /// Returns whether the command may be missing in a recording.
    fn is_optional(&self) -> bool {
        false
    }

    /// Informs the recording switch before the command is performed.
    fn before_command(&self, _switch: &RecordingSwitch) {}

    /// Informs the recording switch about the answer.
    fn after_answer(_answer: &mut Self::Answer, _switch: &RecordingSwitch) {}
}

/// Returns the JSON form of a value; null if the value has none.
pub(in crate::daemon::replay) fn to_json(value: &impl Serialize) -> Value {
    serde_json::to_value(value).unwrap_or(Value::Null)
}

fn value(value: Value) -> Option<RecordedAnswer> {
    Some(RecordedAnswer { value, shot: None })
}

fn read<T: DeserializeOwned>(heard: RecordedAnswer) -> Result<T, serde_json::Error> {
    serde_json::from_value(heard.value)
}

/// The recorded form of a camera's answer: for a picture, only its size and the time of the shot.
#[derive(Debug, Serialize, Deserialize)]
struct ShotForm {
    size_px: [usize; 2],
    /// Time on the clock of the camera, s; `None` for a shot without a time.
    time_s: Option<f64>,
}

/// The recorded form of a fault of a camera.
#[derive(Debug, Serialize, Deserialize)]
struct FaultForm {
    camera: String,
    why: String,
}

impl From<&CameraFault> for FaultForm {
    fn from(fault: &CameraFault) -> Self {
        FaultForm { camera: fault.camera.to_owned(), why: fault.why.clone() }
    }
}

impl From<FaultForm> for CameraFault {
    fn from(FaultForm { camera, why }: FaultForm) -> Self {
        let known = ["the scanner", "the flange camera"];
        CameraFault { camera: known.into_iter().find(|name| *name == camera).unwrap_or("a camera"), why }
    }
}

/// Returns whether this command begins a film, and whether it fetches a picture of a film or ends a film.
pub fn film_role(said: &Value) -> (bool, bool) {
    (said.get("begin_film").is_some(), said == "next_of_film" || said == "end_film")
}

impl Recordable for CameraCommand {
    fn recorded_command(&self) -> Option<(Topic, Value)> {
        Some((Topic::Camera, to_json(self)))
    }

    fn recorded_answer(answer: &Self::Answer, recorder: &Recorder) -> Option<RecordedAnswer> {
        let ok = |heard: Value| value(json!({ "Ok": heard }));
        let taken = |shot: Shot, time_s| {
            let form = ShotForm { size_px: shot.size_px(), time_s };
            Some(RecordedAnswer { value: json!({ "Ok": form }), shot: Some(shot) })
        };
        match answer {
            Ok(CameraAnswer::Scan(cloud)) => taken(Shot::Points(Arc::new(cloud.clone())), None),
            Ok(CameraAnswer::Picture(taken_now)) => {
                taken(Shot::Scanner(Arc::new(taken_now.picture.clone())), Some(taken_now.time_s))
            }
            Ok(CameraAnswer::Corner(picture)) => taken(Shot::Flange(Arc::new(picture.clone())), None),
            // With the wall clock, the camera is polled until the next picture of the film is available; the number of
            // polls has no effect.
            Ok(CameraAnswer::NoneDue) => ok(Value::Null).filter(|_| recorder.is_lock_step()),
            Ok(CameraAnswer::FilmBegan(time_s)) => ok(json!(time_s)),
            Ok(CameraAnswer::FilmEnded(dropped)) => ok(json!(dropped)),
            Ok(CameraAnswer::Checked(faults)) => {
                value(to_json(&faults.iter().map(FaultForm::from).collect::<Vec<_>>()))
            }
            Err(fault) => value(json!({ "Err": FaultForm::from(fault) })),
        }
    }

    fn parse_answer(&self, mut heard: RecordedAnswer) -> Result<Self::Answer, serde_json::Error> {
        let shot = heard.shot.take();
        let fault = CameraFault::from;
        Ok(match self {
            CameraCommand::Check => {
                let faults: Vec<FaultForm> = read(heard)?;
                Ok(CameraAnswer::Checked(faults.into_iter().map(fault).collect()))
            }
            CameraCommand::BeginFilm(_) => read::<Result<_, _>>(heard)?.map(CameraAnswer::FilmBegan).map_err(fault),
            CameraCommand::EndFilm => read::<Result<_, _>>(heard)?.map(CameraAnswer::FilmEnded).map_err(fault),
            CameraCommand::Scan
            | CameraCommand::Picture
            | CameraCommand::NextOfFilm
            | CameraCommand::CornerPicture => {
                let seen: Result<Option<ShotForm>, FaultForm> = read(heard)?;
                seen.map_err(fault).and_then(|seen| self.recorded_shot(seen, shot))
            }
        })
    }

    fn default_answer(&self, _: Time, _: bool) -> Self::Answer {
        match self {
            CameraCommand::Check => Ok(CameraAnswer::Checked(vec![])),
            _ => Err(missing_shot_fault()),
        }
    }
}

impl CameraCommand {
    /// Returns the answer to this command from the recorded shot.
    fn recorded_shot(&self, seen: Option<ShotForm>, shot: Option<Shot>) -> Result<CameraAnswer, CameraFault> {
        let time_s = seen.as_ref().and_then(|seen| seen.time_s);
        Ok(match (self, shot) {
            (CameraCommand::NextOfFilm, _) if seen.is_none() => CameraAnswer::NoneDue,
            (CameraCommand::Scan, Some(Shot::Points(cloud))) => CameraAnswer::Scan(Arc::unwrap_or_clone(cloud)),
            (CameraCommand::CornerPicture, Some(Shot::Flange(picture))) => {
                CameraAnswer::Corner(Arc::unwrap_or_clone(picture))
            }
            (CameraCommand::Picture | CameraCommand::NextOfFilm, Some(Shot::Scanner(picture))) => {
                let picture = Arc::unwrap_or_clone(picture);
                CameraAnswer::Picture(Picture2d { picture, time_s: time_s.ok_or_else(missing_shot_fault)? })
            }
            (_, None) => return Err(missing_shot_fault()),
            (_, Some(_)) => {
                let why = "a picture was expected, but the recording contains another response".to_owned();
                return Err(CameraFault { camera: "a camera", why });
            }
        })
    }
}

fn missing_shot_fault() -> CameraFault {
    CameraFault { camera: "a camera", why: "the recording contains no further picture".to_owned() }
}

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
                // With the wall clock every time that the clock returns is recorded, even if two are equal: a replay
                // needs all of them.
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
                // The start itself is recorded only if the state table refuses it. A start that is accepted begins a
                // new recording.
                RequestKind::Begin(prepared) => json!({ "for": prepared.request }),
                // The reason of a hold has no effect on the cell, so it is not recorded.
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

    fn default_answer(&self, _: Time, has_diverged: bool) -> RequestAnswer {
        match self {
            // This request ends the loop, because the record of the player returns an error for every write.
            RequestCommand::Next(_) if has_diverged => next(RequestKind::Table(cycle::Request::Abort)),
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

/// Name of the recorded question which grids of the panel were sanded in earlier cycles.
const EARLIER_ABRASIONS: &str = "abraded_before";

impl Recordable for RecordCommand {
    fn recorded_command(&self) -> Option<(Topic, Value)> {
        let said = match self {
            RecordCommand::Note(Note::Finding(finding)) => return Some((Topic::Finding, to_json(finding))),
            RecordCommand::Event(event) => return Some((Topic::Event, to_json(event))),
            RecordCommand::Note(note) => note_form(note),
            // The number of permitted waypoints is not recorded, because it follows from the reports of the robot.
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
            // The author of a request and the time of the clock have no influence on the decisions of a cycle.
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
            // An empty list is not recorded; the default answer in a replay is also empty.
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

/// Returns the recorded form of the result of a phase. The form is the same for a picture that is already in the store
/// and for a picture that is not stored yet.
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

/// A port whose commands and answers can be recorded.
pub struct RecordedPort<P> {
    port: P,
    switch: RecordingSwitch,
}

impl<P> RecordedPort<P> {
    /// Wraps this port; its commands are recorded while the recording switch is on.
    pub fn new(port: P, switch: RecordingSwitch) -> Self {
        RecordedPort { port, switch }
    }
}

impl<C: Recordable, P: DerefMut<Target: Port<C>>> Port<C> for RecordedPort<P> {
    fn perform(&mut self, command: C) -> C::Answer {
        command.before_command(&self.switch);
        let recorder = self.switch.recorder();
        let said = recorder.as_ref().and_then(|_| command.recorded_command());
        let mut answer = self.port.perform(command);
        C::after_answer(&mut answer, &self.switch);
        if let (Some(recorder), Some((topic, said))) = (recorder, said)
            && let Some(RecordedAnswer { value: heard, shot }) = C::recorded_answer(&answer, &recorder)
        {
            recorder.record_entry(Entry { topic, at_ns: 0, action: said, reply: heard, shot });
        }
        answer
    }
}
