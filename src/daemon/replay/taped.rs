//! The ports with a tape beside them: each call goes through as it is, and is written down while there is taping.

use super::super::ports::{
    Eyes, Figure, Finding, Journal, Kept, Picture2d, Record, RecordError, Requests, Robot, SightError,
};
use super::super::request::{Request, What};
use super::{Blind, RecordingSwitch, Seen, told};
use crate::cycle::{self, Event, Id, Motion, Outcome, Refusal, State};
use crate::eki::{Command, CommandId, Epoch, MoveLin, QueueError, Report, Time};
use crate::geometry::{Camera, ColorPicture, OrganizedCloud};
use crate::phase::Phase;
use crate::record::{Asked, Budget, Clock, ContactPath, CycleId, EarlierPass};
use crate::store::CycleStart;
use crate::supervision::ThreadFault;
use crate::tape::{Begin, Entry, Shot, Topic};
use crate::verdict::{Reason, Verdict};
use serde::Serialize;
use serde_json::{Value, json};
use std::ops::DerefMut;
use std::sync::Arc;

/// A port that can be taped.
pub struct Taped<P> {
    port: P,
    taping: RecordingSwitch,
}

impl<P> Taped<P> {
    /// This port, taped while there is taping.
    pub fn new(port: P, taping: RecordingSwitch) -> Self {
        Taped { port, taping }
    }

    /// Writes a line down where one is wanted.
    fn put(&self, topic: Topic, line: impl FnOnce() -> (Value, Value)) {
        if let Some(recorder) = self.taping.recorder() {
            let (said, heard) = line();
            recorder.put(Entry { topic, at_ns: 0, said, heard, shot: None });
        }
    }

    /// What came of keeping something; a failure is written down in words.
    fn noted<T: Serialize>(&self, topic: Topic, said: impl FnOnce() -> Value, came: &Result<T, RecordError>) {
        self.put(topic, || {
            let heard = match came {
                Ok(value) => json!({ "Ok": told(value) }),
                Err(error) => json!({ "Err": error.0.to_string() }),
            };
            (said(), heard)
        });
    }

    /// What a camera gave to this.
    fn saw(&self, said: Value, came: Result<(Shot, Option<f64>), &SightError>) {
        let Some(recorder) = self.taping.recorder() else { return };
        let heard = match &came {
            Ok((shot, time_s)) => json!({ "Ok": Seen { size_px: shot.size_px(), time_s: *time_s } }),
            Err(error) => json!({ "Err": Blind::of(error) }),
        };
        let shot = came.ok().map(|(shot, _)| shot);
        recorder.put(Entry { topic: Topic::Camera, at_ns: 0, said, heard, shot });
    }

    fn is_taped(&self) -> bool {
        self.taping.recorder().is_some()
    }
}

impl<P: DerefMut<Target: Robot>> Robot for Taped<P> {
    fn send(&mut self, command: Command) -> Result<CommandId, QueueError> {
        let sent = self.port.send(command);
        self.put(Topic::Command, || (json!({ "send": command }), told(&sent)));
        sent
    }

    fn send_path(&mut self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        let said = self.is_taped().then(|| json!({ "path": points }));
        let sent = self.port.send_path(points);
        if let Some(said) = said {
            self.put(Topic::Command, || (said, told(&sent)));
        }
        sent
    }

    /// The same path on the tape: how much of it is let go when follows from what the robot tells.
    fn send_path_within(&mut self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError> {
        let said = self.is_taped().then(|| json!({ "path": points }));
        let sent = self.port.send_path_within(points, permitted);
        if let Some(said) = said {
            self.put(Topic::Command, || (said, told(&sent)));
        }
        sent
    }

    fn permit(&mut self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.port.permit(last)
    }

    fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        let opened = self.port.open_epoch(above);
        self.put(Topic::Command, || (json!({ "open_epoch_above": above }), told(&opened)));
        opened
    }

    fn abort(&mut self) -> Result<(), QueueError> {
        let aborted = self.port.abort();
        self.put(Topic::Command, || (json!("abort"), told(&aborted)));
        aborted
    }

    fn next(&mut self) -> Option<Report> {
        let report = self.port.next();
        if let Some(report) = &report {
            self.put(Topic::Report, || (Value::Null, told(report)));
        }
        report
    }

    fn now(&self) -> Time {
        let now = self.port.now();
        if let Some(recorder) = self.taping.recorder() {
            let since = now.since_start();
            let is_new = recorder.clock(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX));
            // By the wall clock each reading counts, also where two are the same: a replay gives one for each.
            if is_new || !self.port.is_lock_step() {
                self.put(Topic::Clock, || (Value::Null, told(&since)));
            }
        }
        now
    }

    fn is_lock_step(&self) -> bool {
        self.port.is_lock_step()
    }
}

impl<P: DerefMut<Target: Eyes>> Eyes for Taped<P> {
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError> {
        let scan = self.port.scan();
        if self.is_taped() {
            self.saw(json!("scan"), scan.as_ref().map(|scan| (Shot::Points(Arc::new(scan.clone())), None)));
        }
        scan
    }

    fn picture(&mut self) -> Result<Picture2d, SightError> {
        let taken = self.port.picture();
        if self.is_taped() {
            self.saw(json!("picture"), taken.as_ref().map(scanner_picture));
        }
        taken
    }

    fn begin_film(&mut self, pictures_per_second: f64) -> Result<f64, SightError> {
        let begun = self.port.begin_film(pictures_per_second);
        let heard = || told(&begun.as_ref().map_err(Blind::of));
        self.put(Topic::Camera, || (json!({ "begin_film": pictures_per_second }), heard()));
        begun
    }

    fn next_of_film(&mut self) -> Result<Option<Picture2d>, SightError> {
        let taken = self.port.next_of_film();
        match &taken {
            Ok(None) => self.put(Topic::Camera, || (json!("next_of_film"), json!({ "Ok": null }))),
            _ if !self.is_taped() => {}
            Ok(Some(taken)) => self.saw(json!("next_of_film"), Ok(scanner_picture(taken))),
            Err(error) => self.saw(json!("next_of_film"), Err(error)),
        }
        taken
    }

    fn end_film(&mut self) -> Result<u64, SightError> {
        let ended = self.port.end_film();
        let heard = || told(&ended.as_ref().map_err(Blind::of));
        self.put(Topic::Camera, || (json!("end_film"), heard()));
        ended
    }

    fn corner_picture(&mut self) -> Result<ColorPicture, SightError> {
        let picture = self.port.corner_picture();
        if self.is_taped() {
            let shot = picture.as_ref().map(|picture| (Shot::Flange(Arc::new(picture.clone())), None));
            self.saw(json!("corner_picture"), shot);
        }
        picture
    }

    fn check(&mut self) -> Vec<SightError> {
        let wrong = self.port.check();
        self.put(Topic::Camera, || (json!("check"), told(&wrong.iter().map(Blind::of).collect::<Vec<_>>())));
        wrong
    }
}

fn scanner_picture(taken: &Picture2d) -> (Shot, Option<f64>) {
    (Shot::Scanner(Arc::new(taken.picture.clone())), Some(taken.time_s))
}

impl<P: DerefMut<Target: Record>> Record for Taped<P> {
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
        let kept = self.port.finding(finding);
        self.noted(Topic::Finding, || told(finding), &kept);
        kept
    }

    fn picture(&mut self, name: &str, picture: &ColorPicture) -> Result<(), RecordError> {
        let kept = self.port.picture(name, picture);
        self.noted(Topic::Store, || super::said_picture(name), &kept);
        kept
    }

    fn frame(&mut self, picture: &Arc<ColorPicture>, time_s: f64, phase: Phase) -> Result<(), RecordError> {
        let kept = self.port.frame(picture, time_s, phase);
        self.noted(Topic::Store, || super::said_frame(time_s, phase), &kept);
        kept
    }

    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError> {
        let kept = self.port.figure(figure);
        self.noted(Topic::Store, || super::said_figure(&figure.name, &figure.caption), &kept);
        kept
    }

    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError> {
        let kept = self.port.budget(measured);
        self.noted(Topic::Store, || json!({ "budget": measured }), &kept);
        kept
    }
}

impl<P: DerefMut<Target: Journal>> Journal for Taped<P> {
    fn kept(&mut self, kept: Kept) -> Result<(), RecordError> {
        let said = self.is_taped().then(|| super::said_kept(&kept));
        let came = self.port.kept(kept);
        if let Some(said) = said {
            self.noted(Topic::Store, || said, &came);
        }
        came
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        let kept = self.port.event(event);
        self.noted(Topic::Event, || told(event), &kept);
        kept
    }

    fn open_intent(&mut self, motion: &Motion) -> Result<(), RecordError> {
        let kept = self.port.open_intent(motion);
        self.noted(Topic::Store, || json!({ "open_intent": motion }), &kept);
        kept
    }

    fn open_contact(&mut self, motion: &Motion, path: &ContactPath, permitted: u32) -> Result<(), RecordError> {
        let kept = self.port.open_contact(motion, path, permitted);
        self.noted(Topic::Store, || json!({ "open_intent": motion }), &kept);
        kept
    }

    fn abraded_before(&mut self) -> Result<Vec<EarlierPass>, RecordError> {
        let earlier = self.port.abraded_before();
        // Where nothing was, nothing is written down: a replay then hears of nothing.
        if !earlier.as_ref().is_ok_and(Vec::is_empty) {
            self.noted(Topic::Store, || json!(super::ABRADED_BEFORE), &earlier);
        }
        earlier
    }

    fn permit(&mut self, waypoints: u32) -> Result<(), RecordError> {
        self.port.permit(waypoints)
    }

    // Who asked and what the clock says is no part of what a cycle decides; permits follow from what it heard.

    fn asked(&mut self, asked: &Asked) -> Result<(), RecordError> {
        self.port.asked(asked)
    }

    fn clock(&mut self, clock: Clock) -> Result<(), RecordError> {
        self.port.clock(clock)
    }

    fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), RecordError> {
        let kept = self.port.close_intent(motion, outcome, done);
        self.noted(Topic::Store, || super::said_closed(motion, outcome, done), &kept);
        kept
    }

    fn conclude(&mut self, verdict: Verdict) -> Result<(), RecordError> {
        let kept = self.port.conclude(verdict);
        self.noted(Topic::Store, || json!({ "conclude": verdict }), &kept);
        kept
    }

    fn begin(&mut self, start: &CycleStart) -> Result<CycleId, RecordError> {
        let begun = self.port.begin(start);
        self.noted(Topic::Store, || json!("begin"), &begun);
        begun
    }

    fn between_cycles(&mut self) {
        self.port.between_cycles();
        self.taping.is_over();
    }

    fn disc_worn_mm2(&mut self) -> Result<f64, RecordError> {
        let worn = self.port.disc_worn_mm2();
        self.noted(Topic::Store, || json!("disc_worn_mm2"), &worn);
        worn
    }

    fn wear_disc(&mut self, swept_mm2: f64) -> Result<(), RecordError> {
        let kept = self.port.wear_disc(swept_mm2);
        self.noted(Topic::Store, || json!({ "wear_disc_mm2": swept_mm2 }), &kept);
        kept
    }

    fn mount_disc(&mut self) -> Result<(), RecordError> {
        let kept = self.port.mount_disc();
        self.noted(Topic::Store, || json!("mount_disc"), &kept);
        kept
    }

    fn check(&mut self) -> Vec<Reason> {
        let wrong = self.port.check();
        self.put(Topic::Store, || (json!("check"), told(&wrong)));
        wrong
    }

    fn filled(&mut self) -> Option<Reason> {
        let why = self.port.filled()?;
        self.put(Topic::Store, || (Value::Null, told(&why)));
        Some(why)
    }
}

impl<P: DerefMut<Target: Requests>> Requests for Taped<P> {
    fn next(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        self.taping.listens();
        let mut request = self.port.next(state)?;
        let heard = match request.as_mut().map(|request| &mut request.what) {
            Some(What::Table(request)) => json!({ "for": request }),
            // What the table refuses is a request like any other; what it takes begins a recording of its own.
            Some(What::Begin(prepared)) => {
                self.taping.wants(prepared.recording.take(), prepared.request, state);
                json!({ "for": prepared.request })
            }
            Some(What::NewDisc) => json!("new_disc"),
            Some(What::Leave) => json!("leave"),
            Some(What::Unprepared { .. } | What::State | What::Start(_) | What::Shoot(_)) | None => {
                return Ok(request);
            }
        };
        self.put(Topic::Request, || (Value::Null, heard));
        Ok(request)
    }

    fn refused(&mut self, request: cycle::Request, refusal: Refusal) {
        self.put(Topic::Request, || (json!({ "refused": [told(&request), told(&refusal)] }), Value::Null));
        self.port.refused(request, refusal);
    }

    fn unable(&mut self, reasons: Vec<Reason>) {
        self.put(Topic::Request, || (json!({ "unable": reasons }), Value::Null));
        self.port.unable(reasons);
    }

    fn begun(&mut self, cycle: CycleId, before: Begin) {
        self.taping.begins(cycle, before.clone());
        self.port.begun(cycle, before);
    }

    fn lets_in(&mut self, result: Id) -> bool {
        let lets_in = self.port.lets_in(result);
        if lets_in {
            self.put(Topic::Result, || (Value::Null, json!(result)));
        }
        lets_in
    }

    fn concluded(&mut self, verdict: Verdict) {
        self.port.concluded(verdict);
    }

    fn filmed(&mut self, seconds: f64) {
        self.port.filmed(seconds);
    }

    fn disc_mounted(&mut self) {
        self.port.disc_mounted();
    }

    fn noted(&mut self, reasons: &[Reason]) {
        self.port.noted(reasons);
    }
}
