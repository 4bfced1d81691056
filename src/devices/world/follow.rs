//! The simulated world around a controller in another process, as in a rehearsal. The only data are its state
//! messages, about ten times a second.
//!
//! The arm is taken to be at the pose of the last message until the next one; in between, time passes by the wall
//! clock. Outputs act on the world from the time of the message before the first one that shows them, so up to 100 ms
//! early. If they acted later, a message could already show the feedback of a shutter that is not open in this world
//! yet. Messages do not state contact. If the tool's output is on, the TCP is assumed to move in a straight line from
//! one message's position to the next, and to sand wherever it is within a pad's reach of the true surface. Corners of
//! the path are therefore cut by at most the distance that the arm moves in 100 ms, a few millimetres under a disc of
//! 20 mm and more. If messages were late, nothing is interpolated: only the reported positions count.

use super::simulated_world::{RobotMoment, SimulatedWorld};
use crate::mock::ContactSample;
use panelprep_base::geometry::{Base, Flange, Rigid, Tool};
use panelprep_cell::cell::{Cell, Output};
use panelprep_kuka::eki::State;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Longest time between two messages for which the motion between them is interpolated, ms.
const STRAIGHT_MS: u64 = 350;
/// Distance of the interpolated positions between two messages, mm.
const STEP_MM: f64 = 1.0;

/// Lets the world follow a controller by its messages; all clones follow the same controller.
#[derive(Clone)]
pub struct Follower {
    world: SimulatedWorld,
    cell: Arc<Cell>,
    received_states: Arc<Mutex<ReceivedStates>>,
}

/// The received states.
#[derive(Default)]
struct ReceivedStates {
    last: Option<ReceivedState>,
    outputs: Vec<(u16, bool)>,
    trace: Vec<ContactSample>,
}

/// A message, its time of arrival, and an offset that makes its time count from the start of the first controller: a
/// controller that restarts counts from zero.
#[derive(Clone, Copy)]
struct ReceivedState {
    state: State,
    at: Instant,
    before_ms: u64,
}

impl ReceivedState {
    fn time_ms(&self) -> u64 {
        self.before_ms + u64::from(self.state.time_ms)
    }

    fn now_ms(&self) -> u64 {
        self.time_ms() + u64::try_from(self.at.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    fn base_from_tool(&self) -> Rigid<Base, Tool> {
        self.state.active_base.to_rigid::<Base, Base>() * self.state.base_from_tcp.to_rigid::<Base, Tool>()
    }

    fn base_from_flange(&self) -> Rigid<Base, Flange> {
        self.base_from_tool() * self.state.flange_from_tool.to_rigid::<Flange, Tool>().inverse()
    }
}

impl Follower {
    /// Creates a follower: this world then follows the controller of this cell.
    pub fn new(world: SimulatedWorld, cell: &Cell) -> Self {
        Follower { world, cell: Arc::new(cell.clone()), received_states: Arc::default() }
    }

    /// Returns whether the state is from a mock controller. A simulated camera must never follow a real arm.
    pub fn is_simulated_controller(state: &State) -> bool {
        state.is_simulated()
    }

    /// Processes a state message of the controller.
    pub fn process_state(&self, state: &State) {
        let outputs = {
            let mut received = self.lock();
            let before_ms = match received.last {
                Some(last) if state.time_ms < last.state.time_ms => last.time_ms(),
                Some(last) => last.before_ms,
                None => 0,
            };
            let heard = ReceivedState { state: *state, at: Instant::now(), before_ms };
            let changed = self.changed(&mut received.outputs, state);
            if self.tool_is_on(state) {
                let way =
                    received.last.map_or(vec![], |last| swept_poses(&last, &heard, self.tool_is_on(&last.state)));
                received.trace.extend(way);
            }
            let earliest_ms = heard.time_ms().saturating_sub(STRAIGHT_MS);
            let since_ms = received.last.map_or(heard.time_ms(), |last| last.time_ms().max(earliest_ms));
            received.last = Some(heard);
            changed.into_iter().map(|(number, on)| (number, on, since_ms)).collect::<Vec<_>>()
        };
        let mut terminals = self.world.terminals();
        outputs.into_iter().for_each(|(number, on, time_ms)| terminals.on_output(number, on, time_ms));
    }

    /// Returns the outputs that differ from the previous report.
    fn changed(&self, known: &mut Vec<(u16, bool)>, state: &State) -> Vec<(u16, bool)> {
        let io = self.cell.inputs_outputs();
        let numbers = io.decode_outputs(state.outputs);
        let now: Vec<(u16, bool)> =
            numbers.into_iter().filter_map(|(name, on)| Some((*io.outputs().get(name)?, on))).collect();
        let before = std::mem::replace(known, now.clone());
        let was_on = |number: u16| before.iter().any(|(other, on)| *other == number && *on);
        now.into_iter().filter(|(number, on)| was_on(*number) != *on).collect()
    }

    fn tool_is_on(&self, state: &State) -> bool {
        let name = Output::Tool.name();
        self.cell
            .inputs_outputs()
            .decode_outputs(state.outputs)
            .into_iter()
            .any(|(output, on)| output == name && on)
    }

    /// Returns the present state of the arm; `None` before the first message.
    pub fn current_moment(&self) -> Option<RobotMoment> {
        let told = self.lock().last?;
        Some(RobotMoment {
            time_ms: told.now_ms(),
            joints: told.state.joints,
            base_from_flange: told.base_from_flange(),
            moving: told.state.moving,
        })
    }

    /// Returns the tool's positions while it ran, up to that moment.
    pub fn trace(&self, until_ms: u64) -> Vec<ContactSample> {
        self.lock().trace.iter().filter(|sample| sample.time_ms <= until_ms).copied().collect()
    }

    fn lock(&self) -> MutexGuard<'_, ReceivedStates> {
        self.received_states.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the tool poses between two messages, if the tool ran.
fn swept_poses(from: &ReceivedState, to: &ReceivedState, ran: bool) -> Vec<ContactSample> {
    let sample = |base_from_tool: Rigid<Base, Tool>| ContactSample {
        time_ms: to.time_ms(),
        base_from_flange: base_from_tool * to.state.flange_from_tool.to_rigid::<Flange, Tool>().inverse(),
        base_from_tool,
        sanding: true,
        tool_on: true,
    };
    let (start, end) = (from.base_from_tool(), to.base_from_tool());
    let is_known = ran && to.time_ms().saturating_sub(from.time_ms()) <= STRAIGHT_MS;
    let length_mm = start.origin().distance_mm(end.origin());
    let steps = if is_known { (length_mm / STEP_MM).ceil().max(1.0) as usize } else { 1 };
    (1..=steps)
        .map(|step| {
            let back = (start.origin() - end.origin()) * (1.0 - step as f64 / steps as f64);
            sample(end.followed_by_displacement(back))
        })
        .collect()
}

#[cfg(test)]
mod tests;
