//! Requirements that must be satisfied at every moment of every run, whatever fault occurs. They are checked on the arm
//! and on the sent messages, not on the state that either program reports about itself.

use super::cell::{BASE, Insides, TICK_MS, TOOL, TOOL_OUTPUT, Watch, height_mm};
use panelprep::devices::mock::{Controller, ExecutedMotion, ProgramStop};
use panelprep::eki::{CommandId, Epoch, MoveLin, Refusal, Report};
use panelprep::geometry::{Base, Joints, Panel, Rigid, Tool};
use std::collections::BTreeMap;

/// Maximum time from full speed to standstill, ms.
const MAX_BRAKING_MS: u64 = 260;
/// Time limits for the retract by 50 mm from the panel after braking, ms: at 0.2 m/s, and below it for an arm that is
/// slowed to a fifth of this speed.
const RETRACT_MS: u64 = 800;
const MAX_SLOW_RETRACT_MS: u64 = 1_600;
/// Maximum time from the client's end of an epoch to the arm's standstill, ms: the watchdog, the commands in transit,
/// and braking.
const MAX_EPOCH_END_MS: u64 = 400 + 400 + MAX_BRAKING_MS;
/// Maximum time after which the connection of a client that sends nothing is closed and its epoch ends, ms.
const MAX_SILENCE_MS: u64 = 3_000 + 400;
/// Maximum time until the pad is off the surface after a stop in contact, ms.
const MAX_LEAVE_MS: u64 = 100;
/// Contact without motion.
const DWELL_MS: u64 = 200;
const MAX_WINDOW_MS: f64 = 1_000.0;
/// Outputs that the end of an epoch switches off, and the time after the end, ms.
const OFF_AFTER_MS: [(u16, u64); 4] = [(1, 60_000), (2, 0), (4, 30_000), (TOOL_OUTPUT, 0)];

/// Additional time that the programs may need compared with the model, which stops in one step, ms: cycles of an
/// overloaded scheduler.
const PROGRAMS_MS: u64 = 300;
/// Additional delay before the robot interpreter begins to brake if the scheduler is overloaded, ms.
const STARVED_MS: u64 = 60;
/// Maximum time for which the arm continues without its connection, if the programs are executed, ms.
const MAX_UNLINKED_MS: u64 = 400 + MAX_BRAKING_MS;

/// Description of the first violated requirement, if any.
pub type Violation = Option<String>;

#[derive(Default)]
pub struct Oracles {
    pub violation: Violation,
    /// Time until which the arm is slowed, ms.
    pub slowed_until_ms: u64,
    /// The speed until that time, percent of the full speed.
    pub slowed_to_percent: u8,
    /// The highest epoch in which another client has sent commands.
    pub strange_epoch: i32,
    /// Time until the next abort is sent, ms, if aborts are treated as heartbeats: the controller's watchdog accepts
    /// aborts as signs of life.
    pub unheeded_ms: u64,
    /// Maximum delay of a byte, ms.
    pub delay_ms: u64,
    /// Returns whether the tool is on the panel, if the panel differs from the one of these tests.
    pub is_low: Option<fn(&Controller) -> bool>,
    /// Bits of the harmful outputs: while one of them is on, silence is checked as if a command were queued.
    pub harmful_outputs: u32,
    /// Whether one of the harmful outputs was on at the last report to the client.
    is_harmful: bool,
    points: BTreeMap<(u32, u32), MoveLin>,
    /// Duration of the motion to each point, ms.
    lasts_ms: BTreeMap<(u32, u32), f64>,
    /// Whether the controller was restarted while another client process was running.
    begins_anew: bool,
    /// The last epoch, and the highest number of executed commands that the controller counted in this epoch.
    most_done: (u32, i32),
    sent: BTreeMap<u32, u32>,
    first_sent_ms: BTreeMap<u32, u64>,
    ended_ms: BTreeMap<u32, u64>,
    open: Option<Epoch>,
    /// Time since which the client has had no epoch; `unable_ms` is the last time at which no robot program was able to
    /// react.
    closed_ms: Option<u64>,
    unable_ms: u64,
    told_done: CommandId,
    joints: Option<Joints>,
    moved_ms: u64,
    /// Time at which the connection was last established on both channels.
    linked_ms: u64,
    /// Whether the arm could not move for some time during this contact; a person then jogs the arm off the panel.
    left_there: bool,
    executed: usize,
    last_executed: BTreeMap<i32, i32>,
    traced: usize,
}

impl Oracles {
    /// Starts without any observation; `delay_ms` is the maximum delay of bytes.
    pub fn new(delay_ms: u64) -> Self {
        Oracles { delay_ms, ..Oracles::default() }
    }

    /// Starts the observation in this epoch, after this command.
    pub fn before(&mut self, epoch: Epoch, last: CommandId) {
        self.open = Some(epoch);
        self.sent.insert(epoch.0, last.0);
        self.told_done = last;
    }

    /// Adds a queued path: its points, the ID of the last point, and the duration of each point.
    pub fn queued(&mut self, epoch: Epoch, last: CommandId, points: &[MoveLin], speed_m_s: f64) {
        self.lasts(epoch, last, points, speed_m_s);
        let first = last.0 + 1 - points.len() as u32;
        self.points.extend(points.iter().zip(first..).map(|(point, id)| ((epoch.0, id), *point)));
    }

    /// Adds a queued path of which only the duration is checked.
    pub fn lasts(&mut self, epoch: Epoch, last: CommandId, points: &[MoveLin], speed_m_s: f64) {
        let first = last.0 + 1 - points.len() as u32;
        let mut before = points[0].pose;
        for (point, id) in points.iter().zip(first..) {
            let way =
                before.to_rigid::<Base, Tool>().origin().distance_mm(point.pose.to_rigid::<Base, Tool>().origin());
            self.lasts_ms.insert((epoch.0, id), way / point.speed_m_s.unwrap_or(speed_m_s));
            before = point.pose;
        }
    }

    /// Records that the controller counts its epochs from the beginning again, and that the present process may know
    /// none of them.
    pub fn epochs_begin_anew(&mut self) {
        self.begins_anew = true;
    }

    /// Records that a person has jogged the arm to these axis positions.
    pub fn jogged(&mut self, joints: Joints) {
        self.joints = Some(joints);
    }

    /// Returns the last command that was sent in an epoch.
    pub fn last_sent(&self, epoch: Epoch) -> u32 {
        self.sent.get(&epoch.0).copied().unwrap_or(0)
    }

    fn is_strange(&self, cell: &Insides<'_>) -> bool {
        cell.controller.epoch() <= self.strange_epoch
    }

    /// Returns the maximum duration of a retract that begins at this time, ms.
    fn retract_ms(&self, from_ms: u64) -> u64 {
        match self.slowed_until_ms.saturating_sub(from_ms) {
            0 => RETRACT_MS,
            // At the lowest speed the retract has hardly begun when the arm reaches its previous speed again.
            slowed_ms => MAX_SLOW_RETRACT_MS.max(slowed_ms + RETRACT_MS),
        }
    }

    /// Returns the maximum time from a stop until the disc, which is switched off, has left the surface, ms. The
    /// override scales the retract: 1 mm at 0.2 m/s takes 5 ms, and 500 ms at 1 %.
    fn leave_ms(&self, from_ms: u64) -> u64 {
        match self.slowed_until_ms > from_ms {
            true => MAX_LEAVE_MS.max(500 / u64::from(self.slowed_to_percent.max(1))),
            false => MAX_LEAVE_MS,
        }
    }

    fn wrong(&mut self, now_ms: u64, what: String) {
        self.violation.get_or_insert_with(|| format!("{now_ms} ms: {what}"));
    }

    /// Checks that a command is executed once, in order, as it was sent, to the target that was sent, and not after the
    /// end of its epoch.
    fn judge_executed(&mut self, step: &ExecutedMotion, stops: &[ProgramStop]) {
        let (epoch, id) = (step.epoch.cast_unsigned(), step.id.cast_unsigned());
        let now_ms = step.time_ms;
        if self.sent.get(&epoch).is_none_or(|last| *last < id) {
            self.wrong(now_ms, format!("command {id} of epoch {epoch} was executed and never sent"));
        }
        let before = self.last_executed.insert(step.epoch, step.id).unwrap_or(0);
        if step.id <= before {
            self.wrong(now_ms, format!("command {id} of epoch {epoch} was executed after command {before}"));
        }
        // Another client may have used this number before, on a controller that has restarted since.
        let began_ms = self.first_sent_ms.get(&epoch).copied().unwrap_or(0);
        if let Some(stop) = stops.iter().find(|stop| stop.epoch == step.epoch && stop.time_ms >= began_ms)
            && now_ms > stop.time_ms + MAX_BRAKING_MS + STARVED_MS
        {
            self.wrong(now_ms, format!("an ended epoch moved the arm: command {id} of epoch {epoch}, {stop:?}"));
        }
        if let Some(ended_ms) = self.ended_ms.get(&epoch).copied()
            && now_ms > ended_ms + MAX_EPOCH_END_MS + self.delay_ms
        {
            self.wrong(
                now_ms,
                format!("command {id} of epoch {epoch} was executed, which the client ended at {ended_ms}"),
            );
        }
        if let Some(point) = self.points.get(&(epoch, id)) {
            let base_from_tool: Rigid<Base, Tool> = step.base_from_flange * TOOL.to_rigid();
            let target: Rigid<Base, Tool> = BASE.to_rigid::<Base, Panel>() * point.pose.to_rigid::<Panel, Tool>();
            let off_mm = base_from_tool.origin().distance_mm(target.origin());
            if off_mm > point.blend_mm + 0.01 {
                self.wrong(now_ms, format!("command {id} of epoch {epoch} ended {off_mm:.3} mm off its point"));
            }
        }
    }

    fn judge_motion(&mut self, cell: &Insides<'_>) {
        let controller = cell.controller;
        let (now_ms, joints) = (cell.now_ms, controller.joints());
        let before = *self.joints.get_or_insert(joints);
        // Such a small change is caused by the block coincidence at the arm's present position, because $AXIS_ACT_MEAS
        // is rounded to 32 bits.
        if before == joints || (is_program(cell) && max_axis_difference_deg(&before, &joints) < 1e-3) {
            return;
        }
        self.joints = Some(joints);
        self.moved_ms = now_ms;
        let (received, done) = controller.counts();
        let last_stop = controller.program_stops().last();
        let after_ms = last_stop.map_or(u64::MAX, |stop| now_ms - stop.time_ms);
        let retract_ms = last_stop.map_or(0, |stop| self.retract_ms(stop.time_ms));
        let brake_ms = if is_program(cell) { MAX_BRAKING_MS + STARVED_MS } else { MAX_BRAKING_MS };
        // While the arm retracts after a stop in contact, another stop may follow.
        let retracts = controller
            .program_stops()
            .iter()
            .rev()
            .take(3)
            .any(|stop| stop.contact && now_ms - stop.time_ms <= brake_ms + self.retract_ms(stop.time_ms));
        let ends = after_ms <= brake_ms || retracts;
        let epoch = controller.epoch();
        if is_program(cell)
            && now_ms > self.linked_ms + MAX_UNLINKED_MS + retract_ms
            && controller.counts().0 > 0
            && !controller.is_stopped()
        {
            self.wrong(now_ms, format!("the arm moves {} ms after its link was lost", now_ms - self.linked_ms));
        }
        let just = controller
            .executed_motions()
            .last()
            .is_some_and(|step| step.epoch == epoch && now_ms - step.time_ms <= TICK_MS);
        let has_work = !controller.is_stopped() && (received > done || just);
        if !has_work && !ends {
            self.wrong(now_ms, format!("the arm moves {after_ms} ms after its last stop with nothing to do"));
        }
        if let Some(ended_ms) = self.ended_ms.get(&epoch.cast_unsigned())
            && has_work
            && now_ms > ended_ms + MAX_EPOCH_END_MS + self.delay_ms
        {
            self.wrong(now_ms, format!("the arm moves in epoch {epoch}, which the client ended at {ended_ms} ms"));
        }
    }

    /// Checks that the tool never stays on the panel: not during a path, and not after a stop with the drives on.
    fn judge_contact(&mut self, cell: &Insides<'_>) {
        let trace = cell.controller.trace();
        let fresh = &trace[self.traced..];
        self.traced = trace.len();
        let Some(sample) = fresh.last() else { return };
        let now_ms = sample.time_ms;
        let last_stop = cell.controller.program_stops().last();
        let stopped = cell.controller.is_stopped();
        let low = self.is_low.map_or_else(|| height_mm(cell.controller) < 1.0, |is_low| is_low(cell.controller));
        if (stopped && last_stop.is_some_and(|stop| stop.cause.is_immediate())) || !cell.controller.can_move() {
            self.left_there = true;
        } else if !stopped && !low {
            // A person jogs the arm off the panel, or the next path moves it away; opening an epoch alone moves
            // nothing.
            self.left_there = false;
        }
        if self.left_there {
            return;
        }
        let more_ms = if is_program(cell) { PROGRAMS_MS } else { 0 };
        if low && now_ms > self.moved_ms + DWELL_MS + more_ms {
            self.wrong(now_ms, "the tool stands on the panel".to_owned());
        }
        if let Some(stop) = last_stop.filter(|stop| stop.contact && cell.controller.is_stopped())
            && low
            // The override also scales the retract. The disc is switched off by then, and leaves the panel as soon as
            // the arm is faster.
            && now_ms > stop.time_ms.max(self.slowed_until_ms) + MAX_LEAVE_MS + more_ms
        {
            self.wrong(now_ms, format!("on the panel {} ms after {stop:?}", self.leave_ms(stop.time_ms)));
        }
    }

    /// Checks that the motions that the robot can still execute without the client take at most a second, or are at
    /// most five points.
    fn judge_window(&mut self, cell: &Insides<'_>) {
        // The commands that an ended epoch has received are not executed.
        if is_program(cell) && (cell.controller.is_stopped() || self.is_strange(cell)) {
            return;
        }
        let (received, done) = cell.controller.counts();
        let epoch = cell.controller.epoch().cast_unsigned();
        let (of, most_done) = self.most_done;
        // A robot program that was selected again has left the epoch, and counts from zero until the other interpreter
        // detects this.
        if is_program(cell) && of == epoch && done < most_done {
            return;
        }
        self.most_done = (epoch, done);
        let ahead = (received - done).max(0);
        if ahead > 50 && !has_left(cell) {
            self.wrong(cell.now_ms, format!("{ahead} commands wait at the robot"));
        }
        let keys = (epoch, done.cast_unsigned() + 1)..=(epoch, received.cast_unsigned());
        if ahead > 6 {
            let motion_ms: f64 = self.lasts_ms.range(keys).map(|(_, ms)| ms).sum();
            if motion_ms > MAX_WINDOW_MS + 100.0 {
                let what = format!(
                    "{motion_ms:.0} ms of motion wait at the robot, commands {done} to {received} of epoch {epoch}"
                );
                self.wrong(cell.now_ms, what);
            }
        }
    }

    /// Checks that, after any end of an epoch, each output is switched off within its time, except outputs that may
    /// stay on.
    fn judge_outputs(&mut self, cell: &Insides<'_>) {
        if cell.session.epoch().is_some() {
            self.closed_ms = None;
            return;
        }
        let closed_ms = *self.closed_ms.get_or_insert(cell.now_ms);
        let is_strangers = is_program(cell) && self.is_strange(cell) && !cell.controller.is_stopped();
        if !cell.controller.can_move() || is_strangers {
            self.unable_ms = cell.now_ms;
        }
        let since_ms = closed_ms.max(self.unable_ms) + MAX_EPOCH_END_MS + self.delay_ms + self.unheeded_ms;
        let late_ms = self.late_end_ms(cell, closed_ms);
        for (output, after_ms) in OFF_AFTER_MS {
            // If nothing is queued, and neither tool nor water is on, silence ends the epoch only when the connection
            // is lost.
            let since_ms = if after_ms > 0 { since_ms.max(late_ms) } else { since_ms };
            if cell.controller.outputs().get(&output) == Some(&true) && cell.now_ms > since_ms + after_ms {
                self.wrong(
                    cell.now_ms,
                    format!("output {output} is on, the client ended its epoch at {closed_ms}"),
                );
            }
        }
    }

    /// Returns the time at which the controller ended an epoch that the client had ended at the given time, plus the
    /// time that the controller's program may need.
    fn late_end_ms(&self, cell: &Insides<'_>, closed_ms: u64) -> u64 {
        let latest_ms = closed_ms + MAX_SILENCE_MS + self.delay_ms;
        let stop = cell.controller.program_stops().last().filter(|stop| stop.time_ms <= latest_ms);
        stop.map_or(0, |stop| stop.time_ms + PROGRAMS_MS)
    }

    /// Checks that silence during work has ended the client's epoch.
    fn judge_client(&mut self, cell: &Insides<'_>) {
        let open = cell.session.epoch();
        if let Some(ended) = self.open.filter(|ended| Some(*ended) != open) {
            self.ended_ms.insert(ended.0, cell.now_ms);
            self.told_done = CommandId(0);
        }
        self.open = open;
        let Some(epoch) = open else { return };
        let sent = self.sent.get(&epoch.0).copied().unwrap_or(0);
        let silence_ms = cell.now_ms - cell.heard_ms;
        if (sent > self.told_done.0 || self.is_harmful) && silence_ms > 405 && !cell.stalled {
            self.wrong(cell.now_ms, format!("nothing was heard for {silence_ms} ms and the epoch is open"));
        }
    }
}

/// Returns the maximum difference of an axis, degrees.
fn max_axis_difference_deg(one: &Joints, other: &Joints) -> f64 {
    let axes = |joints: &Joints| {
        [joints.a1_deg, joints.a2_deg, joints.a3_deg, joints.a4_deg, joints.a5_deg, joints.a6_deg]
    };
    axes(one).into_iter().zip(axes(other)).fold(0.0, |most, (one, other)| most.max((one - other).abs()))
}

/// Returns whether the robot program of a controller that executes the shipped programs was restarted. It then executes
/// nothing more of the epoch, which the submit interpreter is about to end.
fn has_left(cell: &Insides<'_>) -> bool {
    let ended = cell.controller.shared("CELL_DEAD_EP");
    ended.is_some() && ended == cell.controller.shared("CELL_EP")
}

fn is_program(cell: &Insides<'_>) -> bool {
    cell.controller.robot_state().is_some()
}

impl Watch for Oracles {
    fn sent(&mut self, epoch: u32, id: u32, now_ms: u64) {
        let before = self.sent.insert(epoch, id).unwrap_or(0);
        self.first_sent_ms.entry(epoch).or_insert(now_ms);
        if id != before + 1 {
            self.wrong(now_ms, format!("command {id} of epoch {epoch} was sent after command {before}"));
        }
        if self.ended_ms.contains_key(&epoch) {
            self.wrong(now_ms, format!("command {id} of the ended epoch {epoch} was sent"));
        }
    }

    fn on_report(&mut self, report: &Report, cell: &Insides<'_>) {
        match report {
            Report::EpochOpened { epoch } => {
                self.told_done = CommandId(0);
                if self.begins_anew {
                    self.ended_ms.remove(&epoch.0);
                    self.sent.remove(&epoch.0);
                    self.first_sent_ms.remove(&epoch.0);
                    self.last_executed.remove(&epoch.0.cast_signed());
                }
            }
            Report::Connected { state } | Report::State(state) => {
                self.is_harmful = state.outputs & self.harmful_outputs != 0;
            }
            Report::Progress { done } => {
                if *done < self.told_done {
                    self.wrong(cell.now_ms, format!("progress went back from {} to {done}", self.told_done));
                }
                self.told_done = *done;
            }
            Report::PathDone { last } => {
                let epoch = self.open.map_or(0, |open| open.0);
                let is_it = |step: &ExecutedMotion| {
                    (step.epoch.cast_unsigned(), step.id.cast_unsigned()) == (epoch, last.0)
                };
                if !self.is_strange(cell) && !cell.controller.executed_motions().iter().rev().any(is_it) {
                    self.wrong(
                        cell.now_ms,
                        format!("a path was told done, its last command {last} was not executed"),
                    );
                }
            }
            Report::Refused { refusal, id } if !self.is_strange(cell) && !MAY_BE_REFUSED.contains(refusal) => {
                self.wrong(cell.now_ms, format!("the controller refused command {id}: {refusal}"));
            }
            _ => {}
        }
    }

    fn look(&mut self, cell: &Insides<'_>) {
        let controller = cell.controller;
        self.judge_client(cell);
        let fresh = self.executed..controller.executed_motions().len();
        for index in fresh {
            self.judge_executed(&controller.executed_motions()[index], controller.program_stops());
        }
        self.executed = controller.executed_motions().len();
        self.judge_motion(cell);
        self.judge_contact(cell);
        self.judge_window(cell);
        self.judge_outputs(cell);
        let ends = [panelprep::devices::mock::Channel::Command, panelprep::devices::mock::Channel::State];
        let has_link = ends.iter().all(|&end| controller.is_connected(end));
        if has_link {
            self.linked_ms = cell.now_ms;
        }
        if !is_program(cell) && controller.counts().0 > 0 && !controller.is_stopped() && !has_link {
            self.wrong(cell.now_ms, format!("epoch {} continues without its link", controller.epoch()));
        }
        let stopped_ms = controller.program_stops().last().map_or(0, |stop| stop.time_ms);
        let goes_off = is_program(cell) && cell.now_ms <= stopped_ms + PROGRAMS_MS;
        if controller.is_stopped() && controller.outputs().get(&TOOL_OUTPUT) == Some(&true) && !goes_off {
            self.wrong(cell.now_ms, "the tool runs after a stop".to_owned());
        }
    }
}

/// Reasons for which the commands of a correct client may be refused: the robot cannot move, it has stopped, it was set
/// to refuse, or its override has changed.
const MAY_BE_REFUSED: [Refusal; 5] = [
    Refusal::NoMotionMode,
    Refusal::Stopped,
    Refusal::WrongEpoch,
    Refusal::NotReachable,
    // The override was changed.
    Refusal::Override,
];
