//! The person at the cell, from the service's start to the end of an honest cycle behind the lie: waits for the scenario's moment, lets
//! the lie be told, presses what the scenario says, and afterwards clears, resets and starts as long as it takes.

use super::asking::ask;
use super::cell::Prepared;
use super::liar::Liar;
use super::lie::{Kind, Moment, Scenario};
use super::proxy::Proxy;
use super::truth::{Truth, WATER};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::thread;
use std::time::{Duration, Instant};

/// From one look at the cell to the next.
const LOOKS: Duration = Duration::from_millis(60);
/// So long a person looks what has come of it, before anything else is asked for.
const LOOKS_ON: Duration = Duration::from_millis(1_700);
/// To the moment of the scenario.
const TO_MOMENT: Duration = Duration::from_secs(90);
const CYCLES_TO_MOMENT: u32 = 3;
/// A cycle that goes on after the lie has ended within this.
const TO_REST: Duration = Duration::from_secs(110);
/// After the lie and the cycle that it was told in, a person has the next cycle started within this.
const BACK: Duration = Duration::from_secs(45);
/// An honest cycle.
const CYCLE: Duration = Duration::from_secs(110);
/// As the recipe is rendered: the film's length, and the size from which on a break is looked for.
const RENDERED: [&str; 2] = ["observation_s = 10.0", "min_break_mm2 = 69.0"];
/// A film in which the largest of the rendered panel's breaks is found and abraded, and one that passes.
const ONE_BREAK: [&str; 2] = ["observation_s = 8.0", "min_break_mm2 = 150.0"];
const NO_BREAK: [&str; 2] = ["observation_s = 5.5", "min_break_mm2 = 900.0"];

/// What the person asked for.
#[derive(Debug, Clone)]
pub struct Order {
    pub at_ms: f64,
    pub word: String,
    pub done: bool,
}

/// How a cycle ended, and the epochs in which it moved.
#[derive(Debug, Clone, Default)]
pub struct Cycle {
    pub verdict: Option<String>,
    pub epochs: BTreeSet<i64>,
}

pub struct Course<'c> {
    pub cell: &'c Prepared,
    pub truth: &'c Truth,
    pub liar: &'c Liar,
    pub proxy: &'c Proxy,
    pub scenario: &'c Scenario,
    pub orders: Vec<Order>,
    pub cycles: BTreeMap<i64, Cycle>,
    started: u32,
    refusal: String,
}

/// What the service says of itself.
struct Look {
    word: String,
    phase: String,
    text: String,
}

impl Look {
    fn rests(&self) -> bool {
        matches!(&*self.word, "idle" | "stopped" | "aborted" | "complete" | "held")
    }
}

impl<'c> Course<'c> {
    pub fn new(
        (cell, scenario): (&'c Prepared, &'c Scenario),
        truth: &'c Truth,
        liar: &'c Liar,
        proxy: &'c Proxy,
    ) -> Self {
        let (orders, cycles) = Default::default();
        Course { cell, truth, liar, proxy, scenario, orders, cycles, started: 0, refusal: String::new() }
    }

    fn look(&mut self) -> Result<Look, String> {
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
        Ok(Look { word, phase, text: state["reasons"].to_string() })
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

    fn say(&mut self, word: &str) -> Result<bool, String> {
        self.order(&json!({ "ask": word }))
    }

    fn start(&mut self, film: [&str; 2]) -> Result<bool, String> {
        self.started += 1;
        let recipe = self.cell.recipe();
        let text = fs::read_to_string(&recipe).map_err(|error| error.to_string())?;
        let text = RENDERED.iter().zip(film).fold(text, |text, (from, to)| text.replacen(from, to, 1));
        let part = json!({ "serial": format!("SN-{}", self.started), "operator": "Cable" });
        self.order(&json!({ "ask": "start", "recipe": recipe, "text": text, "part": part }))
    }

    /// Looks until this holds; false where it takes too long.
    fn until(&mut self, patience: Duration, holds: impl Fn(&Self, &Look) -> bool) -> Result<bool, String> {
        let since = Instant::now();
        while since.elapsed() < patience {
            let look = self.look()?;
            if holds(self, &look) {
                return Ok(true);
            }
            thread::sleep(LOOKS);
        }
        Ok(false)
    }

    /// What a person does in a state of rest, to get the next cycle started.
    fn go_on(&mut self, word: &str, film: [&str; 2]) -> Result<(), String> {
        match word {
            "aborted" => self.say("clear").map(drop),
            "stopped" | "complete" => self.say("reset").map(drop),
            "held" => self.say("stop").map(drop),
            "idle" => self.start(film).map(drop),
            _ => Ok(()),
        }
    }

    /// The whole course.
    ///
    /// # Errors
    /// Where the service does not come back.
    pub fn run(&mut self) -> Result<(), String> {
        match self.scenario.moment {
            Moment::Connect => self.at_connect()?,
            Moment::Idle => {
                self.reach_idle()?;
                self.tell()?;
            }
            Moment::Clear => self.at_clear()?,
            moment => self.within_a_cycle(moment)?,
        }
        self.liar.end();
        self.rest()?;
        thread::sleep(LOOKS_ON);
        self.honest_cycle()
    }

    fn reach_idle(&mut self) -> Result<(), String> {
        let since = Instant::now();
        loop {
            let look = self.look()?;
            match &*look.word {
                "idle" => return Ok(()),
                _ if since.elapsed() > BACK => return Err(format!("never idle: {} ({})", look.word, self.refusal)),
                word => self.go_on(&word.to_owned(), NO_BREAK)?,
            }
            thread::sleep(LOOKS);
        }
    }

    /// The lie of most kinds has begun before the service was started.
    fn at_connect(&mut self) -> Result<(), String> {
        let since = Instant::now();
        while self.truth.last().is_none() && since.elapsed() < Duration::from_secs(3) {
            thread::sleep(LOOKS);
        }
        if self.begins_late() {
            return self.tell();
        }
        self.tells(Instant::now())
    }

    /// Whether a lie of this kind needs a connection that is there.
    pub fn begins_late(&self) -> bool {
        matches!(self.scenario.lie.kind, Kind::Close | Kind::OldBytes)
    }

    fn at_clear(&mut self) -> Result<(), String> {
        self.reach_idle()?;
        self.start(NO_BREAK)?;
        self.until(TO_MOMENT, |course, look| is_reached(Moment::Free, course, look))?;
        thread::sleep(Duration::from_millis(self.scenario.after_ms));
        self.say("abort")?;
        self.until(TO_REST, |_, look| look.word == "aborted")?;
        self.begin();
        let since = Instant::now();
        while !self.liar.is_over() || since.elapsed() < Duration::from_millis(400) {
            let look = self.look()?;
            if look.word != "idle" {
                self.go_on(&look.word, NO_BREAK)?;
            }
            thread::sleep(LOOKS);
        }
        Ok(())
    }

    /// Where a busy machine ends the cycle before its moment, or nothing is found to abrade, another one is begun.
    fn within_a_cycle(&mut self, moment: Moment) -> Result<(), String> {
        let film = if self.scenario.needs_contact() { ONE_BREAK } else { NO_BREAK };
        let awaited = if moment == Moment::Stop { self.scenario.amid } else { moment };
        for _ in 0..CYCLES_TO_MOMENT {
            self.reach_idle()?;
            self.start(film)?;
            if moment == Moment::Start {
                return self.tell();
            }
            let is_reached = |course: &Self, look: &Look| is_reached(awaited, course, look);
            self.until(TO_MOMENT, |course, look| is_reached(course, look) || look.rests())?;
            if !self.look()?.rests() {
                return self.tell();
            }
        }
        Ok(())
    }

    fn begin(&mut self) {
        let lie = &self.scenario.lie;
        self.liar.begin(lie);
        if matches!(lie.kind, Kind::Close | Kind::Refuse | Kind::OldBytes) {
            for index in (0..2).filter(|index| lie.both || lie.way.channel() == *index) {
                if self.proxy.close(index) {
                    self.liar.note();
                }
            }
        }
    }

    fn tell(&mut self) -> Result<(), String> {
        thread::sleep(Duration::from_millis(self.scenario.after_ms));
        let since = Instant::now();
        self.begin();
        self.tells(since)
    }

    /// Until the lie is over, and what the person presses meanwhile.
    fn tells(&mut self, since: Instant) -> Result<(), String> {
        if let Some((word, after_ms)) = self.scenario.press {
            thread::sleep(Duration::from_millis(after_ms).saturating_sub(since.elapsed()));
            self.say(word)?;
        }
        let lasts = Duration::from_millis(self.scenario.lie.lasts_ms);
        while !self.liar.is_over() && since.elapsed() < lasts {
            thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }

    /// The cycle goes on to its end, or was ended.
    fn rest(&mut self) -> Result<(), String> {
        if self.until(TO_REST, |_, look| look.rests())? {
            return Ok(());
        }
        let look = self.look()?;
        Err(format!("no rest after {} s: {} {} {}", TO_REST.as_secs(), look.word, look.phase, look.text))
    }

    fn honest_cycle(&mut self) -> Result<(), String> {
        let since = Instant::now();
        loop {
            let look = self.look()?;
            if matches!(&*look.word, "starting" | "execute") {
                break;
            }
            if since.elapsed() > BACK {
                let waited_s = BACK.as_secs();
                return Err(format!("not back after {waited_s} s: {} {} ({})", look.word, look.text, self.refusal));
            }
            self.go_on(&look.word, NO_BREAK)?;
            thread::sleep(LOOKS);
        }
        self.until(CYCLE, |_, look| look.rests())?;
        let look = self.look()?;
        let is_whole = look.word == "complete";
        is_whole
            .then_some(())
            .ok_or_else(|| format!("the honest cycle ends {} {} {}", look.word, look.phase, look.text))
    }
}

fn is_reached(moment: Moment, course: &Course<'_>, look: &Look) -> bool {
    let moves = course.truth.last().is_some_and(|state| state.moving());
    let is_wet = course.truth.last().is_some_and(|state| state.is_on(WATER));
    let wants_water = course.scenario.number % 2 == 0;
    match moment {
        Moment::Contact => course.truth.is_in_contact(),
        Moment::Retract => course.truth.has_left_contact(),
        Moment::Film if wants_water => is_wet,
        Moment::Film => look.phase == "inspect",
        Moment::Free => moves && matches!(&*look.phase, "locate" | "refine"),
        _ => true,
    }
}
