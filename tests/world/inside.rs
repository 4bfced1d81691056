//! The inside of a world: client, controller, arm and terminals in one virtual time, and the injected faults.
//!
//! The ports of the loop share this state. Time passes only while the loop waits for the robot. `counts`: the findings
//! · `striking`: the faults · `places`: where the arm may be, and at which override · `truth`: what the controller
//! does, independent of what it and the client report.

mod counts;
mod places;
mod striking;
mod truth;

pub use counts::{Counts, Violation};

use places::Places;
use truth::Truth;

use super::aims::Aims;
use super::disk;
use super::fixture::{CellContents, Fixture};
use super::link_cell::{Cell, TICK_MS, setup, wire};
use super::oracles::Oracles;
use super::restoring::Backup;
use super::sabotage::Sabotage;
use super::script::{self, CameraHarm, Entry, Power, Press};
use super::tamper::Tampering;
use super::terminals::{Around, Terminals};
use panelprep::cycle::At;
use panelprep::devices::mock::{Clock, ContactSample, Controller, ExecutedMotion, Programs, Setup};
use panelprep::devices::robot::link_limits;
use panelprep::eki::{ClockMode, CommandId, Epoch, LinkLimits, MoveLin, Session};
use panelprep::geometry::{Base, Joints, Panel, Rigid, Tool};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The axis positions of the arm before the first cycle: `[poses] ready`.
const START: Joints =
    Joints { a1_deg: 0.0, a2_deg: -120.0, a3_deg: 145.0, a4_deg: 0.0, a5_deg: -25.0, a6_deg: 90.0 };
/// Maximum height of the tip above the surface at which the tool is treated as being on the panel, mm.
const MAX_CONTACT_HEIGHT_MM: f64 = 1.0;
/// Sum of the times of the controller's watchdog, of a message in transit, and of the controller's program, ms.
const WATCHDOG_DELAY_MS: u64 = 400 + 300;

/// The waypoints of a contact path that the record permits.
#[derive(Debug, Clone, Copy)]
pub enum Permit {
    /// The path begins, with this number of waypoints.
    Begins(u32),
    /// The path continues to this number of waypoints.
    Continues(u32),
    /// The permission ends.
    Ends,
}

/// An entry of the script that has not occurred yet.
struct Pending {
    entry: Entry,
    due_ms: Option<u64>,
}

/// Client, controller, arm and their environment.
pub struct Inside {
    pub cell: Cell,
    pub oracles: Oracles,
    pub around: Arc<Mutex<Around>>,
    tampering: Arc<Mutex<Tampering>>,
    pub stands: CellContents,
    script: Vec<Pending>,
    /// Time since which the controller has ended an epoch that the session still treats as open, ms.
    pub ended_since_ms: Option<u64>,
    /// Time since which the tool or the extraction is reported as stopped while the pad is on its path, ms.
    pub dead_since_ms: Option<u64>,
    /// Time until which the effects of all faults last, ms.
    pub lasts_until_ms: u64,
    /// Time until which the effects of all faults last, except feedbacks that do not follow their outputs, ms.
    pub others_last_until_ms: u64,
    /// Whether a fault has occurred whose effect may come later: half a message in a buffer, or a base that will be
    /// wrong when it is set next.
    pub lingers: bool,
    /// Whether the reported pose of the arm may be wrong.
    pub places_lie: bool,
    place: &'static str,
    visits: BTreeMap<&'static str, u32>,
    /// Requests of people that are not processed yet.
    pub pressed: VecDeque<Press>,
    /// The faults of the scanner and of the flange camera, and the times until which they last.
    pub cameras: [Option<(CameraHarm, u64)>; 2],
    home_at_ms: Option<u64>,
    /// The additional time of each write, and the time until which it applies, ms.
    slow_disk: Option<(u64, u64)>,
    /// Total time by which slow writes have delayed the loop, ms.
    pub written_ms: u64,
    /// Time after the last fault in which no person ends the present work, ms, and below it the time of this fault.
    pub aftermath_ms: u64,
    pub struck_ms: u64,
    /// Time until which the people who run the cell request nothing, ms.
    pub away_until_ms: u64,
    pub truth: Truth,
    pub places: Places,
    /// Decisions of a second screen: the request, and the number of steps by which the screen is outdated.
    pub screens: VecDeque<(Press, u32)>,
    /// Whether the store must be backed up; `restores` states whether the last backup must replace the store.
    pub backs_up: bool,
    pub restores: bool,
    pub backup: Option<Backup>,
    /// Whether the next cycle is for another part.
    pub is_another_part: bool,
    /// Number of passes over the present part that are missing in a restored store, and whether the next start states
    /// them.
    pub lost_passes: usize,
    pub states_lost_passes: bool,
    /// The planned end of the process at one of its writes.
    pub power: Option<Power>,
    pub counts: Counts,
    pub violation: Option<Violation>,
    /// Number of motions that were executed before the present contact path, and the number of its motions that the
    /// record permits.
    permitted: Option<(usize, u32)>,
    /// The epoch and the first command of the present contact path.
    contact: Option<(Epoch, CommandId)>,
    /// The required ends of lines.
    pub aims: Aims,
    /// Time since which no bytes of the client arrive, ms.
    deaf_since_ms: u64,
    /// The error that is injected into the program, if any.
    pub sabotage: Option<Sabotage>,
}

/// The world that the ports of a loop share.
#[derive(Clone)]
pub struct Shared(Arc<Mutex<Inside>>);

impl Shared {
    /// Returns a world in which the faults of this script will occur.
    pub fn new(
        stands: CellContents,
        link: ((u64, u64), Option<Programs>),
        script: Vec<Entry>,
        sabotage: Option<Sabotage>,
    ) -> Self {
        Shared(Arc::new(Mutex::new(Inside::new(stands, link, script, sabotage))))
    }

    /// Locks the world for one call.
    pub fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn is_low(controller: &Controller) -> bool {
    height_mm(controller) < MAX_CONTACT_HEIGHT_MM
}

/// Returns the height of the tool's tip above the panel, mm.
fn height_mm(controller: &Controller) -> f64 {
    let fixture = Fixture::shared();
    let calibrations = fixture.cycle.calibrations;
    let base_from_tool: Rigid<Base, Tool> = controller.flange_pose() * calibrations.flange_from_tool;
    let panel_from_tool: Rigid<Panel, Tool> = fixture.truth().base_from_panel.inverse() * base_from_tool;
    fixture.truth().distance_mm(panel_from_tool.origin()).abs()
}

/// Returns the limits of the connection from the cell's file, with those that an injected error changes.
fn limits(sabotage: Option<Sabotage>) -> LinkLimits {
    let limits = link_limits(&Fixture::shared().cell);
    sabotage.map_or(limits, |sabotage| sabotage.limits(limits))
}

/// Returns a client's session that is not connected.
pub fn session(sabotage: Option<Sabotage>) -> Session {
    Session::new(wire(), limits(sabotage), ClockMode::Wall)
}

impl Inside {
    /// Jogs the arm to its park pose, as a person does, if the arm is stationary.
    pub fn jogs_to_park(&mut self) {
        if self.cell.controller.jog_to(super::fixture::Fixture::shared().setup.park_pose) {
            self.oracles.jogged(self.cell.controller.joints());
            self.counts.jogs += 1;
        }
    }

    fn new(
        stands: CellContents,
        (delay_ms, programs): ((u64, u64), Option<Programs>),
        script: Vec<Entry>,
        sabotage: Option<Sabotage>,
    ) -> Self {
        let around = Arc::new(Mutex::new(Around::default()));
        let left_out = match sabotage {
            Some(Sabotage::Controller(rule)) => Some(rule),
            _ => None,
        };
        let (inputs, outputs) = ((1..=5).collect(), (1..=5).collect());
        let setup = Setup { start: START, inputs, outputs, programs, omitted_rule: left_out, ..setup(Clock::Free) };
        let mut cell = Cell::within(setup, limits(sabotage), 1, Box::new(Terminals(around.clone())));
        cell.delay_ms = delay_ms;
        let tampering = Arc::new(Mutex::new(Tampering::default()));
        cell.tamper = Some(Tampering::port(tampering.clone()));
        let mut oracles = Oracles::new(delay_ms.1);
        oracles.is_low = Some(is_low);
        oracles.harmful_outputs = limits(sabotage).harmful_outputs;
        Inside {
            cell,
            oracles,
            around,
            tampering,
            stands,
            script: script.into_iter().map(|entry| Pending { entry, due_ms: None }).collect(),
            ended_since_ms: None,
            dead_since_ms: None,
            lasts_until_ms: 0,
            others_last_until_ms: 0,
            lingers: false,
            places_lie: false,
            place: "",
            visits: BTreeMap::new(),
            pressed: VecDeque::new(),
            cameras: [None; 2],
            home_at_ms: None,
            slow_disk: None,
            written_ms: 0,
            aftermath_ms: 0,
            struck_ms: 0,
            away_until_ms: 0,
            truth: Truth::default(),
            places: Places::default(),
            screens: VecDeque::new(),
            backs_up: false,
            restores: false,
            backup: None,
            is_another_part: false,
            lost_passes: 0,
            states_lost_passes: false,
            power: None,
            counts: Counts::default(),
            violation: None,
            permitted: None,
            contact: None,
            aims: Aims::default(),
            deaf_since_ms: 0,
            sabotage,
        }
    }

    /// Now, ms.
    pub fn now_ms(&self) -> u64 {
        self.cell.now_ms
    }

    /// Stores a violation, if it is the first one.
    pub fn wrong(&mut self, judge: &'static str, what: String) {
        let now_ms = self.now_ms();
        self.violation.get_or_insert_with(|| Violation { judge, what: format!("{now_ms} ms: {what}") });
    }

    /// Records that the cycle's state machine has reached this state.
    pub fn comes_to(&mut self, at: At) {
        let place = script::place(at);
        if place == self.place {
            return;
        }
        self.place = place;
        let now_ms = self.now_ms();
        let visit = self.visits.entry(place).or_default();
        *visit += 1;
        *self.counts.places.entry(place).or_default() += 1;
        for pending in &mut self.script {
            if pending.entry.place == place && pending.entry.visit == *visit {
                pending.due_ms.get_or_insert(now_ms + pending.entry.after_ms);
            }
        }
    }

    /// Returns whether a fault is due but has not occurred yet, or lasts.
    pub fn is_troubled(&self) -> bool {
        self.script.iter().any(|pending| pending.due_ms.is_some())
            || self.now_ms() < self.lasts_until_ms
            || self.home_at_ms.is_some()
            || self.places.jog.is_some()
            || disk::is_armed()
    }

    /// Returns whether no fault is due or lasts, except a feedback that does not follow its output, and messages arrive
    /// as they were sent.
    pub fn is_calm_but_for_feedback(&self) -> bool {
        let tampering = self.tampering.lock().unwrap_or_else(PoisonError::into_inner);
        self.cell.all_heard()
            && !self.is_strange()
            && self.now_ms() > self.others_last_until_ms
            && self.home_at_ms.is_none()
            && !disk::is_armed()
            && tampering.harms.is_empty()
            && tampering.lies.is_empty()
    }

    /// Returns whether a fault may still occur, or an earlier fault may still have an effect.
    pub fn may_strike(&self) -> bool {
        !self.script.is_empty()
            || self.is_troubled()
            || (self.struck_ms > 0 && self.now_ms() < self.struck_ms + self.aftermath_ms)
    }

    /// Ends all faults.
    pub fn mend(&mut self) {
        self.script.clear();
        (self.slow_disk, self.away_until_ms) = (None, 0);
        (self.places.jog, self.backs_up) = (None, false);
        disk::mend();
        *self.tampering.lock().unwrap_or_else(PoisonError::into_inner) = Tampering::default();
    }

    /// Performs the next event of the cell, if it is due until this time.
    pub fn step(&mut self, end_ms: u64) {
        let next_ms = self.script.iter().filter_map(|pending| pending.due_ms).min().unwrap_or(u64::MAX);
        let soon_ms = end_ms.min(next_ms.max(self.now_ms() + 1));
        let Inside { cell, oracles, tampering, .. } = self;
        let applied =
            |tampering: &Mutex<Tampering>| tampering.lock().unwrap_or_else(PoisonError::into_inner).applied;
        let before = applied(tampering);
        cell.step(soon_ms, oracles);
        if applied(tampering) > before {
            self.mark_reports_unreliable();
        }
        self.strike_due();
        self.work_with_another_program();
        self.jogs();
        self.judge_watchdog();
        self.judge_truth();
        self.judge_where();
        self.take_violation();
    }

    /// Records a permission that the store has acknowledged.
    pub fn permits(&mut self, permit: Permit) {
        self.permitted = match (permit, self.permitted) {
            (Permit::Begins(count), _) => Some((self.cell.controller.executed_motions().len(), count)),
            (Permit::Continues(count), Some((before, _))) => Some((before, count)),
            (Permit::Continues(_), None) | (Permit::Ends, _) => None,
        };
        if !matches!(permit, Permit::Continues(_)) {
            self.contact = None;
        }
    }

    /// Records that the client accepts a path to send: these points, the last of which has this ID.
    pub fn queued(&mut self, points: &[MoveLin], last: CommandId, speed_m_s: f64) {
        let Some(epoch) = self.open_epoch() else { return };
        self.oracles.lasts(epoch, last, points, speed_m_s);
        self.aims.queued(epoch, last, points);
        self.truth.lines(epoch, CommandId(last.0 + 1 - points.len() as u32));
        if self.permitted.is_some() && self.contact.is_none() {
            self.contact = Some((epoch, CommandId(last.0 + 1 - points.len() as u32)));
        }
    }

    /// Advances the time by the duration of a write to the disk, while client and controller continue.
    pub fn writes(&mut self) {
        let Some((late_ms, until_ms)) = self.slow_disk else { return };
        if self.now_ms() >= until_ms {
            self.slow_disk = None;
            return;
        }
        let end_ms = self.now_ms() + late_ms;
        while self.now_ms() < end_ms {
            self.step(end_ms);
        }
        self.written_ms += late_ms;
        self.lasts_until_ms = self.lasts_until_ms.max(end_ms);
        self.others_last_until_ms = self.others_last_until_ms.max(end_ms);
    }

    /// Checks that the arm is never farther along a contact path than the record permits.
    fn judge_permits(&mut self) {
        let Some((before, permitted)) = self.permitted.filter(|_| !self.is_strange()) else { return };
        self.counts.judged("permits");
        let executed = self.executed_since(before);
        if executed > permitted as usize {
            self.wrong(
                "permits",
                format!("{executed} waypoints of a contact path were executed, permitted are {permitted}"),
            );
        }
        let sent =
            self.contact.map_or(0, |(epoch, first)| (self.oracles.last_sent(epoch) + 1).saturating_sub(first.0));
        if sent > permitted {
            self.wrong(
                "permits",
                format!("{sent} waypoints of a contact path were sent, permitted are {permitted}"),
            );
        }
    }

    /// Returns the number of motions that were executed since the present contact path was opened; `None` if another
    /// client has sent commands.
    pub fn executed_on_path(&self) -> Option<usize> {
        let (before, _) = self.permitted.filter(|_| !self.is_strange())?;
        Some(self.executed_since(before))
    }

    /// Returns the number of executed commands of the present contact path after the first `before` executed ones. If
    /// the disk refused the end of the path, the path may still be open in the record while later motions are executed.
    fn executed_since(&self, before: usize) -> usize {
        let Some((epoch, first)) = self.contact else { return 0 };
        let is_on_path =
            |step: &&ExecutedMotion| step.epoch.cast_unsigned() == epoch.0 && step.id.cast_unsigned() >= first.0;
        self.cell.controller.executed_motions().iter().skip(before).filter(is_on_path).count()
    }

    /// Checks that tool and water are switched off when the controller has received nothing from its client for the
    /// watchdog's time.
    fn judge_watchdog(&mut self) {
        let now_ms = self.now_ms();
        let is_silent = now_ms < self.cell.deaf_until_ms && now_ms > self.deaf_since_ms + WATCHDOG_DELAY_MS;
        if is_silent && !self.is_strange() {
            self.counts.judged("watchdog");
            if self.is_on(2) || self.is_on(5) {
                let since_ms = self.deaf_since_ms;
                self.wrong("watchdog", format!("tool or water is on, nothing was heard since {since_ms} ms"));
            }
        }
    }

    fn take_violation(&mut self) {
        self.judge_permits();
        let [off, hole] = self.aims.look(self.cell.controller.executed_motions());
        if let Some(what) = off.filter(|_| !self.is_strange()).or(hole) {
            self.wrong("aim", what);
        }
        if let Some(what) = self.oracles.violation.take() {
            self.violation.get_or_insert(Violation { judge: "link and arm", what });
        }
    }

    /// Advances the time in which no process of the program runs.
    pub fn without_process(&mut self, ms: u64) {
        let end_ms = self.now_ms() + ms;
        let mut tool_ms = 0;
        while self.now_ms() < end_ms {
            let Inside { cell, oracles, .. } = self;
            cell.without_client(TICK_MS, oracles);
            tool_ms = if self.is_on(5) || self.is_on(2) { tool_ms + TICK_MS } else { 0 };
            self.judge_places();
            self.jogs();
            self.judge_where();
        }
        self.take_violation();
        self.counts.judged("off without a client");
        if tool_ms > 1_500 {
            self.wrong("off without a client", format!("tool or water is on {tool_ms} ms after the process ended"));
        }
    }

    /// The terminals.
    pub fn lock_around(&self) -> MutexGuard<'_, Around> {
        self.around.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns whether this output is on.
    pub fn is_on(&self, output: u16) -> bool {
        self.lock_around().is_on(output)
    }

    /// Returns whether pictures of the process are black, because of the light or the lens shutter.
    pub fn is_dark(&self) -> bool {
        let around = self.lock_around();
        !around.is_lit(self.now_ms()) || around.is_lens_shut(self.now_ms())
    }

    /// Returns the positions of the tool up to this time.
    pub fn trace(&self, until_ms: u64) -> Vec<ContactSample> {
        self.cell.controller.trace().iter().filter(|sample| sample.time_ms <= until_ms).copied().collect()
    }

    /// Returns the open epoch of the session.
    pub fn open_epoch(&self) -> Option<Epoch> {
        self.cell.session.epoch()
    }

    /// Returns the height of the tool's tip above the panel, mm.
    pub fn height_mm(&self) -> f64 {
        height_mm(&self.cell.controller)
    }

    /// Returns whether another client has sent commands in the present epoch.
    pub fn is_strange(&self) -> bool {
        self.cell.controller.epoch() <= self.oracles.strange_epoch
    }
}
