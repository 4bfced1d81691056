//! The ports with a tape running: each call goes through as it is, and is written down.

use super::super::ports::{
    Ask, Eyes, Figure, Finding, Journal, Kept, Record, RecordError, Requests, Robot, SightError,
};
use super::{Blind, Recorder, Seen, told};
use crate::cycle::{Event, Motion, Outcome, Refusal, Request, State};
use crate::eki::{Command, CommandId, Epoch, MoveLin, QueueError, Report, Time};
use crate::geometry::{Camera, ColorPicture, OrganizedCloud};
use crate::phase::Phase;
use crate::record::{Budget, CycleId};
use crate::store::CycleStart;
use crate::tape::{Entry, Shot, Topic};
use crate::verdict::{Reason, Verdict};
use serde::Serialize;
use serde_json::{Value, json};
use std::sync::Arc;

/// A port with a tape running.
pub struct Taped<'a, P> {
    port: &'a mut P,
    recorder: Recorder,
}

impl<'a, P> Taped<'a, P> {
    /// This port, taped.
    pub fn new(port: &'a mut P, recorder: Recorder) -> Self {
        Taped { port, recorder }
    }

    fn put(&self, topic: Topic, said: Value, heard: Value) {
        self.recorder.put(Entry { topic, at_ns: 0, said, heard, shot: None });
    }

    fn keep(&self, said: Value) {
        self.put(Topic::Store, said, Value::Null);
    }

    /// What came of keeping something; a failure is written down in words.
    fn noted<T: Serialize>(&self, topic: Topic, said: Value, came: &Result<T, RecordError>) {
        let heard = match came {
            Ok(value) => json!({ "Ok": told(value) }),
            Err(error) => json!({ "Err": error.0.to_string() }),
        };
        self.put(topic, said, heard);
    }

    fn saw(&self, asked: &'static str, came: Result<Shot, &SightError>) {
        let heard = match &came {
            Ok(shot) => json!({ "Ok": Seen { size_px: shot.size_px() } }),
            Err(error) => json!({ "Err": Blind::of(error) }),
        };
        let entry = Entry { topic: Topic::Camera, at_ns: 0, said: json!(asked), heard, shot: came.ok() };
        self.recorder.put(entry);
    }
}

impl<P: Robot> Robot for Taped<'_, P> {
    fn send(&mut self, command: Command) -> Result<CommandId, QueueError> {
        let sent = self.port.send(command);
        self.put(Topic::Command, json!({ "send": command }), told(&sent));
        sent
    }

    fn send_path(&mut self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        let said = json!({ "path": points });
        let sent = self.port.send_path(points);
        self.put(Topic::Command, said, told(&sent));
        sent
    }

    fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        let opened = self.port.open_epoch(above);
        self.put(Topic::Command, json!({ "open_epoch_above": above }), told(&opened));
        opened
    }

    fn abort(&mut self) -> Result<(), QueueError> {
        let aborted = self.port.abort();
        self.put(Topic::Command, json!("abort"), told(&aborted));
        aborted
    }

    fn next(&mut self) -> Option<Report> {
        let report = self.port.next();
        if let Some(report) = &report {
            self.put(Topic::Report, Value::Null, told(report));
        }
        report
    }

    fn now(&self) -> Time {
        let now = self.port.now();
        let since = now.since_start();
        if self.recorder.clock(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)) {
            self.put(Topic::Clock, Value::Null, told(&since));
        }
        now
    }

    fn is_lock_step(&self) -> bool {
        self.port.is_lock_step()
    }
}

impl<P: Eyes> Eyes for Taped<'_, P> {
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError> {
        let scan = self.port.scan();
        let shot = scan.as_ref().map(|scan| Shot::Points(Arc::new(scan.clone())));
        self.saw("scan", shot);
        scan
    }

    fn picture(&mut self) -> Result<ColorPicture, SightError> {
        let picture = self.port.picture();
        let shot = picture.as_ref().map(|picture| Shot::Scanner(Arc::new(picture.clone())));
        self.saw("picture", shot);
        picture
    }

    fn corner_picture(&mut self) -> Result<ColorPicture, SightError> {
        let picture = self.port.corner_picture();
        let shot = picture.as_ref().map(|picture| Shot::Flange(Arc::new(picture.clone())));
        self.saw("corner_picture", shot);
        picture
    }

    fn check(&mut self) -> Vec<SightError> {
        let wrong = self.port.check();
        let heard: Vec<Blind> = wrong.iter().map(Blind::of).collect();
        self.put(Topic::Camera, json!("check"), told(&heard));
        wrong
    }
}

impl<P: Record> Record for Taped<'_, P> {
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
        let kept = self.port.finding(finding);
        self.noted(Topic::Finding, told(finding), &kept);
        kept
    }

    fn picture(&mut self, name: &str, picture: &ColorPicture) -> Result<(), RecordError> {
        let kept = self.port.picture(name, picture);
        self.noted(Topic::Store, super::said_picture(name), &kept);
        kept
    }

    fn frame(&mut self, picture: &Arc<ColorPicture>, time_s: f64, phase: Phase) -> Result<(), RecordError> {
        let kept = self.port.frame(picture, time_s, phase);
        self.noted(Topic::Store, super::said_frame(time_s, phase), &kept);
        kept
    }

    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError> {
        let kept = self.port.figure(figure);
        self.noted(Topic::Store, super::said_figure(&figure.name, &figure.caption), &kept);
        kept
    }

    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError> {
        let kept = self.port.budget(measured);
        self.noted(Topic::Store, json!({ "budget": measured }), &kept);
        kept
    }
}

impl<P: Journal> Journal for Taped<'_, P> {
    fn kept(&mut self, kept: Kept) -> Result<(), RecordError> {
        let said = super::said_kept(&kept);
        let came = self.port.kept(kept);
        self.noted(Topic::Store, said, &came);
        came
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        let kept = self.port.event(event);
        self.noted(Topic::Event, told(event), &kept);
        kept
    }

    fn open_intent(&mut self, motion: &Motion) -> Result<(), RecordError> {
        let kept = self.port.open_intent(motion);
        self.noted(Topic::Store, json!({ "open_intent": motion }), &kept);
        kept
    }

    fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), RecordError> {
        let kept = self.port.close_intent(motion, outcome, done);
        self.noted(Topic::Store, super::said_closed(motion, outcome, done), &kept);
        kept
    }

    fn conclude(&mut self, verdict: Verdict) -> Result<(), RecordError> {
        let kept = self.port.conclude(verdict);
        self.noted(Topic::Store, json!({ "conclude": verdict }), &kept);
        kept
    }

    fn begin(&mut self, start: &CycleStart) -> Result<CycleId, RecordError> {
        let begun = self.port.begin(start);
        self.noted(Topic::Store, json!("begin"), &begun);
        begun
    }

    fn between_cycles(&mut self) {
        self.port.between_cycles();
        self.keep(json!("between_cycles"));
    }

    fn disc_worn_mm2(&mut self) -> Result<f64, RecordError> {
        let worn = self.port.disc_worn_mm2();
        self.noted(Topic::Store, json!("disc_worn_mm2"), &worn);
        worn
    }

    fn wear_disc(&mut self, swept_mm2: f64) -> Result<(), RecordError> {
        let kept = self.port.wear_disc(swept_mm2);
        self.noted(Topic::Store, json!({ "wear_disc_mm2": swept_mm2 }), &kept);
        kept
    }

    fn mount_disc(&mut self) -> Result<(), RecordError> {
        let kept = self.port.mount_disc();
        self.noted(Topic::Store, json!("mount_disc"), &kept);
        kept
    }

    fn check(&mut self) -> Vec<Reason> {
        let wrong = self.port.check();
        self.put(Topic::Store, json!("check"), told(&wrong));
        wrong
    }
}

impl<P: Requests> Requests for Taped<'_, P> {
    fn next(&mut self, state: &State) -> Ask {
        let ask = self.port.next(state);
        match &ask {
            Ask::Nothing => {}
            Ask::For(request) => self.put(Topic::Request, Value::Null, json!({ "for": request })),
            Ask::Begin(order) => self.put(Topic::Request, Value::Null, json!({ "begin": order.request })),
            Ask::NewDisc => self.put(Topic::Request, Value::Null, json!("new_disc")),
            Ask::Leave => self.put(Topic::Request, Value::Null, json!("leave")),
        }
        ask
    }

    fn refused(&mut self, request: Request, refusal: Refusal) {
        self.put(Topic::Request, json!({ "refused": [told(&request), told(&refusal)] }), Value::Null);
        self.port.refused(request, refusal);
    }

    fn unable(&mut self, reasons: Vec<Reason>) {
        self.put(Topic::Request, json!({ "unable": reasons }), Value::Null);
        self.port.unable(reasons);
    }

    fn begun(&mut self, cycle: CycleId) {
        self.port.begun(cycle);
    }

    fn concluded(&mut self, verdict: Verdict) {
        self.port.concluded(verdict);
    }

    fn noted(&mut self, reasons: &[Reason]) {
        self.port.noted(reasons);
    }
}
