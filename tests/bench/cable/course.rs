//! Runs a scenario from the service's start to the end of a cycle without a fault: waits for the scenario's moment,
//! injects the fault, and sends the person's request of the scenario.

use super::liar::FaultInjector;
use super::lie::{Kind, Moment, Scenario};
use super::person::{NO_BREAK, ONE_BREAK, POLL_INTERVAL, Person, ServiceState};
use super::proxy::Proxy;
use super::truth::{Truth, WATER};
use std::thread;
use std::time::{Duration, Instant};

/// Time for which a person observes the result before the next request.
const OBSERVATION_TIME: Duration = Duration::from_millis(1_700);
/// Time limit for reaching the scenario's moment.
const MOMENT_TIMEOUT: Duration = Duration::from_secs(90);
const CYCLES_TO_MOMENT: u32 = 3;

pub struct Course<'c> {
    pub person: Person<'c>,
    pub truth: &'c Truth,
    pub liar: &'c FaultInjector,
    pub proxy: &'c Proxy,
    pub scenario: &'c Scenario,
}

impl Course<'_> {
    /// Runs the whole scenario.
    ///
    /// # Errors
    /// If the service does not recover from the fault.
    pub fn run(&mut self) -> Result<(), String> {
        match self.scenario.moment {
            Moment::Connect => self.at_connect()?,
            Moment::Idle => {
                self.person.reach_idle()?;
                self.inject()?;
            }
            Moment::Clear => self.at_clear()?,
            moment => self.within_a_cycle(moment)?,
        }
        self.liar.end();
        self.person.rest()?;
        thread::sleep(OBSERVATION_TIME);
        self.person.honest_cycle()
    }

    /// Waits for the controller's first state. Faults of most kinds begin before the service is started.
    fn at_connect(&mut self) -> Result<(), String> {
        let since = Instant::now();
        while self.truth.last().is_none() && since.elapsed() < Duration::from_secs(3) {
            thread::sleep(POLL_INTERVAL);
        }
        if self.begins_late() {
            return self.inject();
        }
        self.wait_for_end(Instant::now())
    }

    /// Returns whether a fault of this kind needs an existing connection.
    pub fn begins_late(&self) -> bool {
        matches!(self.scenario.lie.kind, Kind::Close | Kind::OldBytes)
    }

    fn at_clear(&mut self) -> Result<(), String> {
        self.person.reach_idle()?;
        self.person.start(NO_BREAK)?;
        let (truth, scenario) = (self.truth, self.scenario);
        self.person.until(MOMENT_TIMEOUT, |look| is_reached(Moment::Free, (truth, scenario), look))?;
        thread::sleep(Duration::from_millis(self.scenario.after_ms));
        self.person.request("abort")?;
        self.person.until_aborted()?;
        self.begin();
        let since = Instant::now();
        while !self.liar.is_over() || since.elapsed() < Duration::from_millis(400) {
            let look = self.person.look()?;
            if look.word != "idle" || self.scenario.lie.of_orders {
                self.person.proceed(&look.word, NO_BREAK)?;
            }
            thread::sleep(POLL_INTERVAL);
        }
        Ok(())
    }

    /// If the cycle ends before the moment, because the machine is busy or because no break is found, another cycle is
    /// started.
    fn within_a_cycle(&mut self, moment: Moment) -> Result<(), String> {
        let film = if self.scenario.needs_contact() { ONE_BREAK } else { NO_BREAK };
        let awaited = if moment == Moment::Stop { self.scenario.amid } else { moment };
        for _ in 0..CYCLES_TO_MOMENT {
            self.person.reach_idle()?;
            self.person.start(film)?;
            if moment == Moment::Start {
                return self.inject();
            }
            let around = (self.truth, self.scenario);
            self.person.until(MOMENT_TIMEOUT, |look| is_reached(awaited, around, look) || look.rests())?;
            if !self.person.look()?.rests() {
                return self.inject();
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

    fn inject(&mut self) -> Result<(), String> {
        thread::sleep(Duration::from_millis(self.scenario.after_ms));
        let since = Instant::now();
        self.begin();
        self.wait_for_end(since)
    }

    /// Waits until the fault is over, and sends the person's request during this time.
    fn wait_for_end(&mut self, since: Instant) -> Result<(), String> {
        if let Some((word, after_ms)) = self.scenario.press {
            thread::sleep(Duration::from_millis(after_ms).saturating_sub(since.elapsed()));
            self.person.request(word)?;
        }
        let lasts = Duration::from_millis(self.scenario.lie.lasts_ms);
        while !self.liar.is_over() && since.elapsed() < lasts {
            thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

fn is_reached(moment: Moment, (truth, scenario): (&Truth, &Scenario), look: &ServiceState) -> bool {
    let moves = truth.last().is_some_and(|state| state.moving());
    let is_wet = truth.last().is_some_and(|state| state.is_on(WATER));
    let wants_water = scenario.number % 2 == 0;
    match moment {
        Moment::Contact => truth.is_in_contact(),
        Moment::Retract => truth.has_left_contact(),
        Moment::Film if wants_water => is_wet,
        Moment::Film => look.phase == "inspect",
        Moment::Free => moves && matches!(&*look.phase, "locate" | "refine"),
        _ => true,
    }
}
