//! The simulated person at the cell, who uses only the socket: reads the state of the cell, sends clear, reset, start
//! and stop, and records the time of each request and the end of each cycle.

use super::asking::ask;
use super::cell::Prepared;
use super::truth::Truth;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::thread;
use std::time::{Duration, Instant};

/// Interval between two queries of the cell's state.
pub const POLL_INTERVAL: Duration = Duration::from_millis(60);
/// Time limit for a cycle that continues after the fault.
const REST_TIMEOUT: Duration = Duration::from_secs(110);
/// Time limit for a person to start the next cycle, after the fault and the cycle in which it was injected.
const RECOVERY_TIMEOUT: Duration = Duration::from_secs(45);
/// Time limit for a cycle without a fault.
const CYCLE_TIMEOUT: Duration = Duration::from_secs(110);
/// Keys of the recipe as rendered: the duration of the film, and the smallest area of a break that is reported.
const RENDERED: [&str; 2] = ["observation_s = 10.0", "min_break_mm2 = 69.0"];
/// Keys for a film in which the largest break of the rendered panel is found and sanded.
pub const ONE_BREAK: [&str; 2] = ["observation_s = 8.0", "min_break_mm2 = 150.0"];
/// Keys for a film that passes.
pub const NO_BREAK: [&str; 2] = ["observation_s = 5.5", "min_break_mm2 = 900.0"];

/// A request of the person, with its time.
#[derive(Debug, Clone)]
pub struct Order {
    pub at_ms: f64,
    pub word: String,
    pub done: bool,
}

/// The end of a cycle, and the epochs in which the cycle moved the arm.
#[derive(Debug, Clone, Default)]
pub struct Cycle {
    pub verdict: Option<String>,
    pub epochs: BTreeSet<i64>,
}

pub struct Person<'c> {
    cell: &'c Prepared,
    truth: &'c Truth,
    pub orders: Vec<Order>,
    pub cycles: BTreeMap<i64, Cycle>,
    started: u32,
    /// The reason why the last request was refused.
    refusal: String,
}

/// The state of the cell as the service reports it.
pub struct ServiceState {
    pub word: String,
    pub phase: String,
    step: Option<u64>,
    text: String,
}

impl ServiceState {
    pub fn rests(&self) -> bool {
        matches!(&*self.word, "idle" | "stopped" | "aborted" | "complete" | "held")
    }
}

impl<'c> Person<'c> {
    pub fn new(cell: &'c Prepared, truth: &'c Truth) -> Self {
        let (orders, cycles) = Default::default();
        Person { cell, truth, orders, cycles, started: 0, refusal: String::new() }
    }

    pub fn look(&mut self) -> Result<ServiceState, String> {
        let answer = ask(&self.cell.socket(), "{\"ask\":\"state\"}\n");
        let state = answer.map_err(|error| format!("the socket does not answer: {error}"))?;
        let text = |name: &str| state[name].as_str().unwrap_or_default().to_owned();
        let (word, phase) = (text("state"), text("phase"));
        if let Some(id) = state["cycle_id"].as_i64() {
            let cycle = self.cycles.entry(id).or_default();
            if matches!(&*word, "starting" | "execute") {
                cycle.epochs.extend(state["epoch"].as_i64());
            }
            if let Some(verdict) = state["verdict"].as_str() {
                cycle.verdict = Some(verdict.to_owned());
            }
        }
        Ok(ServiceState { word, phase, step: state["step"].as_u64(), text: state["reasons"].to_string() })
    }

    fn order(&mut self, what: &Value) -> Result<bool, String> {
        let (at_ms, word) = (self.truth.now_ms(), what["ask"].as_str().unwrap_or_default().to_owned());
        let answer = ask(&self.cell.socket(), &format!("{what}\n"));
        let answer = answer.map_err(|error| format!("{word} is not answered: {error}"))?;
        let done = answer["answer"] == "done";
        if !done {
            self.refusal = format!("{word}: {}", answer["reasons"]);
        }
        self.orders.push(Order { at_ms, word, done });
        Ok(done)
    }

    pub fn request(&mut self, word: &str) -> Result<bool, String> {
        self.order(&json!({ "ask": word }))
    }

    /// Reads the state, as a person does, and sends `clear`.
    fn clear(&mut self) -> Result<bool, String> {
        let step = self.look()?.step;
        self.order(&json!({ "ask": "clear", "step": step }))
    }

    pub fn start(&mut self, film: [&str; 2]) -> Result<bool, String> {
        self.started += 1;
        let recipe = self.cell.recipe();
        let text = fs::read_to_string(&recipe).map_err(|error| error.to_string())?;
        let text = RENDERED.iter().zip(film).fold(text, |text, (from, to)| text.replacen(from, to, 1));
        let part = json!({ "serial": format!("SN-{}", self.started), "operator": "Cable" });
        self.order(&json!({ "ask": "start", "recipe": recipe, "text": text, "part": part }))
    }

    /// Queries the state until it meets this condition; returns false after the time limit.
    pub fn until(&mut self, patience: Duration, holds: impl Fn(&ServiceState) -> bool) -> Result<bool, String> {
        let since = Instant::now();
        while since.elapsed() < patience {
            let look = self.look()?;
            if holds(&look) {
                return Ok(true);
            }
            thread::sleep(POLL_INTERVAL);
        }
        Ok(false)
    }

    /// Sends the request with which a person continues from a state of rest to the next cycle.
    pub fn proceed(&mut self, word: &str, film: [&str; 2]) -> Result<(), String> {
        match word {
            "aborted" => self.clear().map(drop),
            "stopped" | "complete" => self.request("reset").map(drop),
            "held" => self.request("stop").map(drop),
            "idle" => self.start(film).map(drop),
            _ => Ok(()),
        }
    }

    pub fn reach_idle(&mut self) -> Result<(), String> {
        let since = Instant::now();
        loop {
            let look = self.look()?;
            match &*look.word {
                "idle" => return Ok(()),
                _ if since.elapsed() > RECOVERY_TIMEOUT => {
                    return Err(format!("never idle: {} ({})", look.word, self.refusal));
                }
                word => self.proceed(word, NO_BREAK)?,
            }
            thread::sleep(POLL_INTERVAL);
        }
    }

    /// Waits until the requested abort is complete.
    pub fn until_aborted(&mut self) -> Result<(), String> {
        self.until(REST_TIMEOUT, |look| look.word == "aborted").map(drop)
    }

    /// Waits until the cell is in a state of rest, because the cycle is complete or was ended.
    pub fn rest(&mut self) -> Result<(), String> {
        if self.until(REST_TIMEOUT, |look| look.rests())? {
            return Ok(());
        }
        let look = self.look()?;
        Err(format!("no rest after {} s: {} {} {}", REST_TIMEOUT.as_secs(), look.word, look.phase, look.text))
    }

    pub fn honest_cycle(&mut self) -> Result<(), String> {
        let since = Instant::now();
        loop {
            let look = self.look()?;
            if matches!(&*look.word, "starting" | "execute") {
                break;
            }
            if since.elapsed() > RECOVERY_TIMEOUT {
                let waited_s = RECOVERY_TIMEOUT.as_secs();
                return Err(format!("not back after {waited_s} s: {} {} ({})", look.word, look.text, self.refusal));
            }
            self.proceed(&look.word, NO_BREAK)?;
            thread::sleep(POLL_INTERVAL);
        }
        self.until(CYCLE_TIMEOUT, |look| look.rests())?;
        let look = self.look()?;
        let is_whole = look.word == "complete";
        is_whole
            .then_some(())
            .ok_or_else(|| format!("the cycle without a lie ends: {} {} {}", look.word, look.phase, look.text))
    }
}
