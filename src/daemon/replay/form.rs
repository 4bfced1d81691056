//! The form of commands and answers in a recording. The recorder writes it and the player reads it, both for all commands alike.

use super::queue::Recorder;
use super::switch::RecordingSwitch;
use crate::cycle;
use crate::daemon::ports::{
    CameraAnswer, CameraCommand, CameraFault, Command, Kept, News, Note, Picture2d, RecordAnswer, RecordCommand,
    RecordError, RequestAnswer, RequestCommand, RobotAnswer, RobotCommand,
};
use crate::daemon::request::{Request, What};
use crate::eki::{QueueError, Time};
use crate::phase::Phase;
use crate::record::{Front, Who, name};
use crate::tape::{Shot, Topic};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

/// What came back from a port.
#[derive(Debug, Default)]
pub struct Heard {
    pub value: Value,
    pub shot: Option<Shot>,
}

/// A command that a recording can hold.
pub trait Recordable: Command {
    /// The command's topic, and its words in the recording; null where the loop only listens. `None` where the command is not
    /// recorded, since it follows from what the loop hears.
    fn said(&self) -> Option<(Topic, Value)>;

    /// The answer in the recording; `None` where an answer such as this one is not recorded.
    fn heard(answer: &Self::Answer, recorder: &Recorder) -> Option<Heard>;

    /// The answer that the recording has.
    fn answer(&self, heard: Heard) -> Result<Self::Answer, serde_json::Error>;

    /// The answer where the recording has none: the command is not recorded, nothing came, or the replay has parted from the
    /// recording. `now` is the clock's last reading.
    fn otherwise(&self, now: Time, has_parted: bool) -> Self::Answer;

    /// Whether this is what came, where the loop waits for one particular thing.
    fn fits(&self, _heard: &Value) -> bool {
        true
    }

    /// Whether a recording may leave it out.
    fn is_optional(&self) -> bool {
        false
    }

    /// What the switch has to know before the command is performed.
    fn before(&self, _switch: &RecordingSwitch) {}

    /// What the switch has to know of the answer.
    fn after(_answer: &mut Self::Answer, _switch: &RecordingSwitch) {}
}

/// A value as it is written down; null where it cannot be.
pub(super) fn told(value: &impl Serialize) -> Value {
    serde_json::to_value(value).unwrap_or(Value::Null)
}

fn value(value: Value) -> Option<Heard> {
    Some(Heard { value, shot: None })
}

fn read<T: DeserializeOwned>(heard: Heard) -> Result<T, serde_json::Error> {
    serde_json::from_value(heard.value)
}

impl Recordable for RobotCommand {
    fn said(&self) -> Option<(Topic, Value)> {
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

    fn heard(answer: &RobotAnswer, recorder: &Recorder) -> Option<Heard> {
        match answer {
            RobotAnswer::Queued(queued) => value(told(queued)),
            RobotAnswer::Epoch(opened) => value(told(opened)),
            RobotAnswer::Done(done) => value(told(done)),
            RobotAnswer::Report(Ok(Some(report))) => value(told(report)),
            RobotAnswer::Report(_) => None,
            RobotAnswer::Time(now) => {
                let since = now.since_start();
                let is_new = recorder.clock(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX));
                // By the wall clock each reading counts, also where two are the same: a replay gives one for each.
                if is_new || !recorder.is_lock_step() { value(told(&since)) } else { None }
            }
        }
    }

    fn answer(&self, heard: Heard) -> Result<RobotAnswer, serde_json::Error> {
        Ok(match self {
            RobotCommand::Send(_) | RobotCommand::Path { .. } => RobotAnswer::Queued(read(heard)?),
            RobotCommand::OpenEpoch(_) => RobotAnswer::Epoch(read(heard)?),
            RobotCommand::Abort | RobotCommand::Permit(_) => RobotAnswer::Done(read(heard)?),
            RobotCommand::Next => RobotAnswer::Report(Ok(Some(read(heard)?))),
            RobotCommand::Now => RobotAnswer::Time(Time::after_start(read::<Duration>(heard)?)),
        })
    }

    fn otherwise(&self, now: Time, _: bool) -> RobotAnswer {
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

/// What a camera answers, as it is written down: of a picture its size, and when it was taken.
#[derive(Debug, Serialize, Deserialize)]
struct ShotForm {
    size_px: [usize; 2],
    /// By the camera's own clock; none of a shot that is not timed.
    time_s: Option<f64>,
}

/// A camera's fault, as it is written down.
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

/// Whether these words begin a film, and whether they watch it or end it.
pub(super) fn of_film(said: &Value) -> (bool, bool) {
    (said.get("begin_film").is_some(), said == "next_of_film" || said == "end_film")
}

impl Recordable for CameraCommand {
    fn said(&self) -> Option<(Topic, Value)> {
        Some((Topic::Camera, told(self)))
    }

    fn heard(answer: &Self::Answer, recorder: &Recorder) -> Option<Heard> {
        let ok = |heard: Value| value(json!({ "Ok": heard }));
        let taken = |shot: Shot, time_s| {
            let form = ShotForm { size_px: shot.size_px(), time_s };
            Some(Heard { value: json!({ "Ok": form }), shot: Some(shot) })
        };
        match answer {
            Ok(CameraAnswer::Scan(cloud)) => taken(Shot::Points(Arc::new(cloud.clone())), None),
            Ok(CameraAnswer::Picture(taken_now)) => {
                taken(Shot::Scanner(Arc::new(taken_now.picture.clone())), Some(taken_now.time_s))
            }
            Ok(CameraAnswer::Corner(picture)) => taken(Shot::Flange(Arc::new(picture.clone())), None),
            // By the wall clock a film is watched until its next picture is there; how often it was looked for does not matter.
            Ok(CameraAnswer::NoneDue) => ok(Value::Null).filter(|_| recorder.is_lock_step()),
            Ok(CameraAnswer::FilmBegan(time_s)) => ok(json!(time_s)),
            Ok(CameraAnswer::FilmEnded(dropped)) => ok(json!(dropped)),
            Ok(CameraAnswer::Checked(faults)) => {
                value(told(&faults.iter().map(FaultForm::from).collect::<Vec<_>>()))
            }
            Err(fault) => value(json!({ "Err": FaultForm::from(fault) })),
        }
    }

    fn answer(&self, mut heard: Heard) -> Result<Self::Answer, serde_json::Error> {
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
                seen.map_err(fault).and_then(|seen| self.taken(seen, shot))
            }
        })
    }

    fn otherwise(&self, _: Time, _: bool) -> Self::Answer {
        match self {
            CameraCommand::Check => Ok(CameraAnswer::Checked(vec![])),
            _ => Err(missing()),
        }
    }
}

impl CameraCommand {
    /// The shot that the recording has for this.
    fn taken(&self, seen: Option<ShotForm>, shot: Option<Shot>) -> Result<CameraAnswer, CameraFault> {
        let time_s = seen.as_ref().and_then(|seen| seen.time_s);
        Ok(match (self, shot) {
            (CameraCommand::NextOfFilm, _) if seen.is_none() => CameraAnswer::NoneDue,
            (CameraCommand::Scan, Some(Shot::Points(cloud))) => CameraAnswer::Scan(Arc::unwrap_or_clone(cloud)),
            (CameraCommand::CornerPicture, Some(Shot::Flange(picture))) => {
                CameraAnswer::Corner(Arc::unwrap_or_clone(picture))
            }
            (CameraCommand::Picture | CameraCommand::NextOfFilm, Some(Shot::Scanner(picture))) => {
                let picture = Arc::unwrap_or_clone(picture);
                CameraAnswer::Picture(Picture2d { picture, time_s: time_s.ok_or_else(missing)? })
            }
            (_, None) => return Err(missing()),
            (_, Some(_)) => {
                let why = "the recording has something else where another picture was due".to_owned();
                return Err(CameraFault { camera: "a camera", why });
            }
        })
    }
}

fn missing() -> CameraFault {
    CameraFault { camera: "a camera", why: "the recording has no more pictures".to_owned() }
}

/// The question what of the panel was abraded in earlier cycles.
const ABRADED_BEFORE: &str = "abraded_before";

impl Recordable for RecordCommand {
    fn said(&self) -> Option<(Topic, Value)> {
        let said = match self {
            RecordCommand::Note(Note::Finding(finding)) => return Some((Topic::Finding, told(finding))),
            RecordCommand::Event(event) => return Some((Topic::Event, told(event))),
            RecordCommand::Note(note) => note_form(note),
            // How many waypoints are permitted follows from what the robot reports.
            RecordCommand::OpenIntent(motion) | RecordCommand::OpenContact { motion, .. } => {
                json!({ "open_intent": motion })
            }
            RecordCommand::CloseIntent { motion, outcome, done } => {
                json!({ "close_intent": { "motion": motion, "outcome": outcome, "done": done } })
            }
            RecordCommand::AbradedBefore => json!(ABRADED_BEFORE),
            RecordCommand::Conclude(verdict) => json!({ "conclude": verdict }),
            RecordCommand::Begin(_) => json!("begin"),
            RecordCommand::DiscWorn => json!("disc_worn_mm2"),
            RecordCommand::WearDisc(swept_mm2) => json!({ "wear_disc_mm2": swept_mm2 }),
            RecordCommand::MountDisc => json!("mount_disc"),
            RecordCommand::Check => json!("check"),
            RecordCommand::Filled => Value::Null,
            // Who requested something and what the clock says is no part of what a cycle decides.
            RecordCommand::Permit(_)
            | RecordCommand::Asked(_)
            | RecordCommand::Clock(_)
            | RecordCommand::BetweenCycles => return None,
        };
        Some((Topic::Store, said))
    }

    fn heard(answer: &Self::Answer, _: &Recorder) -> Option<Heard> {
        let ok = |heard: Value| value(json!({ "Ok": heard }));
        match answer {
            Ok(RecordAnswer::Done) => ok(Value::Null),
            Ok(RecordAnswer::Cycle(cycle)) => ok(json!(cycle)),
            Ok(RecordAnswer::Worn(worn_mm2)) => ok(json!(worn_mm2)),
            // Where nothing was, nothing is written down: a replay then hears of nothing.
            Ok(RecordAnswer::Earlier(earlier)) => ok(json!(earlier)).filter(|_| !earlier.is_empty()),
            Ok(RecordAnswer::Wrong(reasons)) => value(json!(reasons)),
            Ok(RecordAnswer::Full(why)) => why.as_ref().and_then(|why| value(json!(why))),
            Err(error) => value(json!({ "Err": error.0.to_string() })),
        }
    }

    fn answer(&self, heard: Heard) -> Result<Self::Answer, serde_json::Error> {
        fn kept<T: DeserializeOwned>(heard: Heard) -> Result<Result<T, RecordError>, serde_json::Error> {
            let kept: Result<T, String> = read(heard)?;
            Ok(kept.map_err(|words| RecordError(words.into())))
        }
        Ok(match self {
            RecordCommand::Begin(_) => kept(heard)?.map(RecordAnswer::Cycle),
            RecordCommand::DiscWorn => kept(heard)?.map(RecordAnswer::Worn),
            RecordCommand::AbradedBefore => kept(heard)?.map(RecordAnswer::Earlier),
            RecordCommand::Check => Ok(RecordAnswer::Wrong(read(heard)?)),
            RecordCommand::Filled => Ok(RecordAnswer::Full(Some(read(heard)?))),
            _ => kept::<()>(heard)?.map(|()| RecordAnswer::Done),
        })
    }

    fn otherwise(&self, _: Time, _: bool) -> Self::Answer {
        match self {
            RecordCommand::Permit(_)
            | RecordCommand::Asked(_)
            | RecordCommand::Clock(_)
            | RecordCommand::BetweenCycles => Ok(RecordAnswer::Done),
            RecordCommand::AbradedBefore => Ok(RecordAnswer::Earlier(vec![])),
            RecordCommand::Check => Ok(RecordAnswer::Wrong(vec![])),
            RecordCommand::Filled => Ok(RecordAnswer::Full(None)),
            _ => Err(RecordError("the replay has parted from the recording".into())),
        }
    }

    fn is_optional(&self) -> bool {
        matches!(self, RecordCommand::AbradedBefore)
    }

    fn before(&self, switch: &RecordingSwitch) {
        if matches!(self, RecordCommand::BetweenCycles) {
            switch.is_over();
        }
    }
}

/// What a phase leaves, as it is written down. A picture that is in the store already has the form of one that is put there
/// now.
fn note_form(note: &Note) -> Value {
    let frame = |time_s: f64, phase: Phase| json!({ "frame": { "time_s": time_s, "phase": phase.word() } });
    let figure = |name: &str, caption: &str| json!({ "figure": { "name": name, "caption": caption } });
    match note {
        Note::Finding(finding) => told(finding),
        Note::Picture(name, _) => json!({ "picture": name }),
        Note::Kept(Kept::Shot(shot)) => json!({ "picture": shot.name }),
        Note::Frame(_, time_s, phase) => frame(*time_s, *phase),
        Note::Kept(Kept::Frame(kept)) => frame(kept.time_s, kept.phase),
        Note::Figure(drawn) => figure(&drawn.name, &drawn.caption),
        Note::Kept(Kept::Figure(drawn)) => figure(&drawn.name, &drawn.caption),
        Note::Budget(measured) => json!({ "budget": measured }),
    }
}

impl Recordable for RequestCommand {
    fn said(&self) -> Option<(Topic, Value)> {
        Some(match self {
            RequestCommand::Next(_) => (Topic::Request, Value::Null),
            RequestCommand::LetsIn(_) => (Topic::Result, Value::Null),
            RequestCommand::Tell(News::Refused(request, refusal)) => {
                (Topic::Request, json!({ "refused": [request, refusal] }))
            }
            RequestCommand::Tell(News::Unable(reasons)) => (Topic::Request, json!({ "unable": reasons })),
            RequestCommand::Tell(_) => return None,
        })
    }

    fn heard(answer: &RequestAnswer, _: &Recorder) -> Option<Heard> {
        match answer {
            RequestAnswer::Next(Ok(Some(Request { what, .. }))) => value(match what {
                What::Table(request) => json!({ "for": request }),
                // What the table refuses is a request like any other; what it takes begins a recording of its own.
                What::Begin(prepared) => json!({ "for": prepared.request }),
                What::NewDisc => json!("new_disc"),
                What::Leave => json!("leave"),
                What::Unprepared { .. } | What::State | What::Start(_) | What::Shoot(_) => return None,
            }),
            RequestAnswer::Next(_) | RequestAnswer::LetsIn(None) => None,
            RequestAnswer::LetsIn(Some(result)) => value(json!(result)),
            RequestAnswer::Told => value(Value::Null),
        }
    }

    fn answer(&self, heard: Heard) -> Result<RequestAnswer, serde_json::Error> {
        Ok(match self {
            RequestCommand::LetsIn(result) => RequestAnswer::LetsIn(Some(*result)),
            RequestCommand::Tell(_) => RequestAnswer::Told,
            RequestCommand::Next(_) => {
                let what = match heard.value {
                    Value::String(word) if word == "leave" => What::Leave,
                    Value::String(word) if word == "new_disc" => What::NewDisc,
                    mut asked => {
                        let request = asked.get_mut("for").map(Value::take).unwrap_or_default();
                        What::Table(serde_json::from_value(request)?)
                    }
                };
                next(what)
            }
        })
    }

    fn otherwise(&self, _: Time, has_parted: bool) -> RequestAnswer {
        match self {
            // The player's record refuses it, and so ends the loop.
            RequestCommand::Next(_) if has_parted => next(What::Table(cycle::Request::Abort)),
            RequestCommand::Next(_) => RequestAnswer::Next(Ok(None)),
            RequestCommand::LetsIn(_) => RequestAnswer::LetsIn(None),
            RequestCommand::Tell(_) => RequestAnswer::Told,
        }
    }

    fn fits(&self, heard: &Value) -> bool {
        match self {
            RequestCommand::LetsIn(result) => *heard == json!(result),
            _ => true,
        }
    }

    fn before(&self, switch: &RecordingSwitch) {
        match self {
            RequestCommand::Next(state) => switch.listens(state),
            RequestCommand::Tell(News::Begun(cycle, before)) => switch.begins(*cycle, before.clone()),
            _ => {}
        }
    }

    fn after(answer: &mut RequestAnswer, switch: &RecordingSwitch) {
        if let RequestAnswer::Next(Ok(Some(Request { what: What::Begin(prepared), .. }))) = answer {
            switch.wants(prepared.recording.take(), prepared.request);
        }
    }
}

fn next(what: What) -> RequestAnswer {
    RequestAnswer::Next(Ok(Some(Request::new(what, Who::by(Front::Program)))))
}

/// A finding as it is compared, without what a stop-watch said: that is the machine's doing.
pub(super) fn timeless(mut finding: Value) -> Value {
    let numbers = finding.get_mut("numbers").and_then(Value::as_array_mut);
    for number in numbers.into_iter().flatten() {
        let stopped = number["name"].as_str().is_some_and(|name| STOPPED.contains(&name));
        if stopped {
            number["value"] = Value::Null;
        }
    }
    finding
}

/// Numbers by the wall clock, which no decision uses.
const STOPPED: [&str; 2] = [name::SCAN_TO_VERDICT, name::PER_PICTURE];
