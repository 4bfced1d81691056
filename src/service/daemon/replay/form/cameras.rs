//! The cameras' commands and answers in a recording.

use super::recordable::{Recordable, RecordedAnswer, read, to_json, value};
use crate::daemon::ports::{CameraAnswer, CameraCommand, CameraFault, Picture2d};
use crate::daemon::replay::queue::Recorder;
use panelprep_kuka::eki::Time;
use panelprep_store::tape::{Shot, Topic};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::Arc;

/// The recorded form of a camera's answer: for a picture, only its size and the time of the shot.
#[derive(Debug, Serialize, Deserialize)]
struct ShotForm {
    size_px: [usize; 2],
    /// Time by the camera's own clock; `None` for a shot that is not timed.
    time_s: Option<f64>,
}

/// The recorded form of a camera's fault.
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

/// Returns whether this command begins a film, and whether it fetches a picture of a film or ends one.
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
            // With the wall clock, a film is polled until its next picture is available; the number of polls does not
            // matter.
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
    /// Returns the recorded shot for this command.
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
    CameraFault { camera: "a camera", why: "the recording contains no more pictures".to_owned() }
}
