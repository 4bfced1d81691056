//! The simulated operator: starts cycles, answers questions, and sometimes holds, stops or aborts a cycle.

use super::asking::ask;
use super::cell::{Pace, Prepared};
use super::clients::{Counts, count};
use serde_json::{Value, json};
use std::fs;
use std::thread::Scope;
use std::time::{Duration, Instant};

/// Interval between two queries of the cell's state.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Time after which the operator resets a complete cell; a production line resets the cell earlier by itself.
const LINE_RESET_TIMEOUT: Duration = Duration::from_secs(10);
/// Time for which a cell is held. Without holds, the simulated line's cycles would take no real time.
const HOLD_TIME: Duration = Duration::from_secs(3);

/// Disturbances of cycles: divisor and remainder of the cycle's number, and the request.
const DISTURBANCES: [(i64, i64, &str); 3] = [(7, 3, "stop"), (11, 5, "abort"), (3, 1, "hold")];

pub fn spawn<'s>(scope: &'s Scope<'s, '_>, cell: &'s Prepared, counts: &'s Counts) {
    scope.spawn(move || {
        let mut operator = Operator { cell, counts, started: 0, ended: 0, disturbed: 0, since: Instant::now() };
        while counts.goes_on() {
            if let Some(state) = operator.order(&json!({ "ask": "state" })) {
                operator.act(&state);
            }
            counts.rest(POLL_INTERVAL);
        }
    });
}

struct Operator<'s> {
    cell: &'s Prepared,
    counts: &'s Counts,
    started: u64,
    /// Number of the last cycle whose end was observed.
    ended: i64,
    /// Number of the last cycle that was disturbed.
    disturbed: i64,
    /// Time at which the cell entered its current state.
    since: Instant,
}

impl Operator<'_> {
    /// Sends the request; returns the reply, also if the request is refused.
    fn order(&self, what: &Value) -> Option<Value> {
        let word = what["ask"].as_str().unwrap_or_default();
        match ask(&self.cell.socket(), &format!("{what}\n")) {
            Ok(answer) => {
                match word {
                    "state" => count(&self.counts.states),
                    word => self.counts.ordered(word),
                }
                Some(answer)
            }
            Err(error) => {
                self.counts.failed(word, &error);
                None
            }
        }
    }

    fn request(&self, word: &str) -> bool {
        self.order(&json!({ "ask": word })).is_some_and(|answer| answer["answer"] == "done")
    }

    fn act(&mut self, state: &Value) {
        let cycle = state["cycle_id"].as_i64().unwrap_or(0);
        let word = state["state"].as_str().unwrap_or_default();
        if word != "complete" {
            self.since = Instant::now();
        }
        if matches!(word, "complete" | "stopped" | "aborted" | "idle") && cycle > self.ended {
            if state["recording"]["is"] == "under_way" {
                return;
            }
            self.end(cycle, state);
        }
        let is_line = self.cell.pace == Pace::Line;
        match word {
            "idle" if !is_line => self.start(),
            "complete" if is_line && self.since.elapsed() < LINE_RESET_TIMEOUT => {}
            "complete" | "stopped" => {
                self.request("reset");
            }
            "aborted" => {
                self.order(&json!({ "ask": "clear", "step": state["step"] }));
            }
            "held" => self.answer(state),
            "execute" if cycle > self.disturbed => self.disturb(cycle, state),
            _ => {}
        }
    }

    fn start(&mut self) {
        self.started += 1;
        let recipe = self.cell.recipe();
        let text = fs::read_to_string(&recipe).expect("the recipe");
        let part = json!({ "serial": format!("SN-{:05}", self.started), "operator": "Soak" });
        let start = json!({ "ask": "start", "recipe": recipe, "text": text, "record": "store", "part": part });
        self.order(&start);
    }

    /// Counts the cycle, and removes its recording, because the service never removes recordings.
    fn end(&mut self, cycle: i64, state: &Value) {
        self.ended = cycle;
        let verdict = state["verdict"].as_str().unwrap_or("none");
        self.counts.ended(verdict);
        if verdict != "pass" {
            println!("cycle {cycle}: {verdict}: {}; {}", state["reasons"], state["recording"]);
        }
        let file = state["recording"]["file"].as_str().map(|file| self.cell.in_folder(file));
        if file.is_some_and(|file| fs::remove_file(file).is_ok()) && state["recording"]["is"] == "whole" {
            count(&self.counts.recordings);
        }
    }

    /// Answers a result that needs a person's decision, or ends a hold that the operator requested.
    fn answer(&self, state: &Value) {
        if state["reasons"].to_string().contains("disc") {
            self.request("new-disc");
        }
        let step = &state["step"];
        let accepted = self.order(&json!({ "ask": "accept", "step": step }));
        if accepted.is_none_or(|answer| answer["answer"] != "done") {
            self.counts.rest(HOLD_TIME);
            self.order(&json!({ "ask": "unhold", "dried": true, "step": step }));
        }
    }

    /// Disturbs the cycle in the middle of the film or of the sanding, depending on the cycle's number.
    fn disturb(&mut self, cycle: i64, state: &Value) {
        let phase = if cycle % 2 == 0 { "inspect" } else { "abrade" };
        let is_line = self.cell.pace == Pace::Line;
        let wanted = DISTURBANCES.iter().find(|(every, left, _)| cycle % every == *left);
        let wanted = wanted.map(|(.., word)| *word).or(is_line.then_some("hold"));
        if state["phase"] == phase || (state["phase"] == "inspect" && !is_line) {
            self.disturbed = cycle;
            if let Some(word) = wanted {
                self.request(word);
            }
        }
    }
}
