//! The simulated world around a controller in another process, as in a rehearsal. Its only data are the controller's
//! state messages, about ten times a second.
//!
//! Between two messages the arm is assumed to be at the pose of the earlier one, and the time advances with the wall
//! clock. An output acts on the world from the time of the message before the first one that contains its change, so up
//! to 100 ms too early. If it acted too late, a message could report the feedback of a shutter that is not open in this
//! world yet. Messages do not contain contact. If the tool's output is on, the TCP is assumed to move in a straight
//! line between the positions of two messages, and to sand where it is within the pad's reach of the true surface. So
//! corners of the path are cut by at most the distance that the arm moves in 100 ms: a few millimetres, under a disc of
//! 20 mm and more. If messages are late, nothing is interpolated, and only the reported positions are used.

use super::simulated_world::{RobotMoment, SimulatedWorld};
use crate::mock::ContactSample;
use panelprep_base::geometry::{Base, Flange, Rigid, Tool};
use panelprep_cell::cell::{Cell, Output};
use panelprep_kuka::eki::State;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Maximum time between two messages between which the motion is interpolated, ms.
const MAX_INTERPOLATED_MS: u64 = 350;
/// Distance between two interpolated positions, mm.
const STEP_MM: f64 = 1.0;

/// Connects a simulated world to a controller by its state messages. All clones follow the same controller.
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

/// A state message, the time of its arrival, and an offset that is added to its time, so that the time continues after
/// a restart of the controller.
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
    /// Creates a follower, by which this world follows the controller of this cell.
    pub fn new(world: SimulatedWorld, cell: &Cell) -> Self {
        Follower { world, cell: Arc::new(cell.clone()), received_states: Arc::default() }
    }

    /// Returns whether a mock controller sent the state. Simulated cameras must never follow a real arm.
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
            let earliest_ms = heard.time_ms().saturating_sub(MAX_INTERPOLATED_MS);
            let since_ms = received.last.map_or(heard.time_ms(), |last| last.time_ms().max(earliest_ms));
            received.last = Some(heard);
            changed.into_iter().map(|(number, on)| (number, on, since_ms)).collect::<Vec<_>>()
        };
        let mut terminals = self.world.terminals();
        outputs.into_iter().for_each(|(number, on, time_ms)| terminals.on_output(number, on, time_ms));
    }

    /// Returns the outputs that have changed since the previous message.
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

    /// Returns the current state of the arm; `None` before the first message.
    pub fn current_moment(&self) -> Option<RobotMoment> {
        let told = self.lock().last?;
        Some(RobotMoment {
            time_ms: told.now_ms(),
            joints: told.state.joints,
            base_from_flange: told.base_from_flange(),
            moving: told.state.moving,
        })
    }

    /// Returns the positions of the running tool up to this time.
    pub fn trace(&self, until_ms: u64) -> Vec<ContactSample> {
        self.lock().trace.iter().filter(|sample| sample.time_ms <= until_ms).copied().collect()
    }

    fn lock(&self) -> MutexGuard<'_, ReceivedStates> {
        self.received_states.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the interpolated poses of the running tool between two messages.
fn swept_poses(from: &ReceivedState, to: &ReceivedState, ran: bool) -> Vec<ContactSample> {
    let sample = |base_from_tool: Rigid<Base, Tool>| ContactSample {
        time_ms: to.time_ms(),
        base_from_flange: base_from_tool * to.state.flange_from_tool.to_rigid::<Flange, Tool>().inverse(),
        base_from_tool,
        sanding: true,
        tool_on: true,
    };
    let (start, end) = (from.base_from_tool(), to.base_from_tool());
    let is_known = ran && to.time_ms().saturating_sub(from.time_ms()) <= MAX_INTERPOLATED_MS;
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
mod tests {
    use super::*;
    use crate::world::{Violation, touch::TouchedPoints};
    use panelprep_base::geometry::{Joints, KukaPose, Panel};
    use panelprep_kuka::eki::{CommandId, Epoch, Mode};
    use panelprep_sim::{self as sim, Scene};

    const CELL: &str = include_str!("../../../config/cell.toml");

    fn cell() -> Cell {
        Cell::check("cell.toml", CELL).unwrap_or_else(|problems| panic!("{problems}"))
    }

    fn follower() -> Follower {
        let world = SimulatedWorld::new(sim::Cell::new(1, Scene::Good, 8), &cell()).expect("a world");
        Follower::new(world, &cell())
    }

    /// Creates a state message; `outputs` are bits in the order of the output numbers, from the light (first) to the
    /// tool (last).
    fn state_message(time_ms: u32, outputs: u32, base_from_tcp: KukaPose) -> State {
        State {
            time_ms,
            sequence: 1,
            answered: 0,
            epoch: Epoch(1),
            boot: 1,
            programs_checksum: 1,
            mode: Mode::External,
            drives_on: true,
            emergency_stop: false,
            guard_closed: true,
            moving: true,
            motion_possible: true,
            base_set: true,
            tool_set: true,
            stopped: false,
            inputs: 0,
            outputs,
            done: CommandId(0),
            underruns: 0,
            override_percent: 100,
            joints: Joints::default(),
            base_from_tcp,
            active_base: KukaPose { x_mm: 100.0, ..KukaPose::default() },
            flange_from_tool: KukaPose { z_mm: 120.0, ..KukaPose::default() },
        }
    }

    fn at(x_mm: f64) -> KukaPose {
        KukaPose { x_mm, ..KukaPose::default() }
    }

    const TOOL: u32 = 0b1_0000;
    const SPRAY: u32 = 0b10;
    const SHUTTER: u32 = 0b100;
    /// The input number of `lens_shut` in the cell file.
    const SHUT_INPUT: u16 = 2;

    /// Expected positions, calculated by hand: the base is at X = 100, the TCP is 10 to 16 mm in front of the base, and
    /// the flange is 120 mm behind the TCP. The distance of 6 mm is covered in steps of 1 mm.
    #[test]
    fn the_tool_moves_straight_from_one_message_to_the_next() {
        let follower = follower();
        follower.process_state(&state_message(1_000, 0, at(0.0)));
        follower.process_state(&state_message(1_100, TOOL, at(10.0)));
        assert_eq!(follower.trace(9_999).len(), 1, "where it was before the tool ran does not count");
        follower.process_state(&state_message(1_200, TOOL, at(16.0)));
        let trace = follower.trace(9_999);
        let places: Vec<f64> = trace.iter().map(|sample| sample.base_from_tool.origin().mm.x).collect();
        assert_eq!(places.len(), 7);
        for (place, expected) in places.iter().zip([110.0, 111.0, 112.0, 113.0, 114.0, 115.0, 116.0]) {
            assert!((place - expected).abs() < 1e-9, "{places:?}");
        }
        assert!((trace[6].base_from_flange.origin().mm.z + 120.0).abs() < 1e-9);
        assert_eq!(follower.trace(1_100).len(), 1, "only up to that moment");
        follower.process_state(&state_message(1_900, TOOL, at(60.0)));
        assert_eq!(follower.trace(9_999).len(), 8, "a way of 700 ms is not known");
        follower.process_state(&state_message(2_000, 0, at(70.0)));
        assert_eq!(follower.trace(9_999).len(), 8, "the tool is off");
    }

    #[test]
    fn outputs_act_on_the_world_and_time_continues() {
        let follower = follower();
        assert!(follower.current_moment().is_none());
        follower.process_state(&state_message(1_000, 0, at(0.0)));
        follower.process_state(&state_message(1_100, SPRAY, at(0.0)));
        assert_eq!(follower.world.violations(), [(1_000, Violation::SprayOnLens)]);
        follower.process_state(&state_message(1_200, SPRAY, at(0.0)));
        assert_eq!(follower.world.violations().len(), 1, "told once");
        std::thread::sleep(std::time::Duration::from_millis(20));
        assert!(follower.current_moment().expect("told").time_ms() >= 1_220);
        // The controller restarts and counts from zero; the time of the world never decreases.
        follower.process_state(&state_message(50, 0, at(0.0)));
        assert!((1_250..2_000).contains(&follower.current_moment().expect("told").time_ms()));
    }

    /// Expected times, calculated by hand: the shutter needs 250 ms. It began to open at 2.050 s, so the controller
    /// reads its feedback at 2.300 s. A scan that is captured because of this feedback sees the panel.
    #[test]
    fn a_lens_whose_feedback_is_reported_is_open() {
        let follower = follower();
        let is_shut = |time_ms: u32| follower.world.terminals().input(SHUT_INPUT, u64::from(time_ms)) == Some(true);
        follower.process_state(&state_message(1_000, 0, at(0.0)));
        follower.process_state(&state_message(1_100, SHUTTER, at(0.0)));
        assert!(is_shut(2_000));
        follower.process_state(&state_message(2_000, SHUTTER, at(0.0)));
        [2_100, 2_200, 2_300]
            .into_iter()
            .for_each(|time_ms| follower.process_state(&state_message(time_ms, 0, at(0.0))));
        assert!(!is_shut(2_300));
        // If messages are late, the time of a change is unknown.
        follower.process_state(&state_message(9_000, SHUTTER, at(0.0)));
        assert!(!is_shut(8_899) && is_shut(8_900));
    }

    /// If messages every 100 ms show a pass over a greasy spot, its grease is removed. A pass 3 mm above the spot does
    /// not remove it.
    #[test]
    fn passes_in_the_messages_remove_grease() {
        let follower = follower();
        let truth = follower.world.truth().clone();
        let spot = &truth.spots[0];
        let along = |height_mm: f64| {
            let normal = truth.normal(spot.centre);
            let turn =
                nalgebra::UnitQuaternion::rotation_between(&nalgebra::Vector3::z(), &-normal.mm).expect("one");
            let place = (spot.centre + normal * height_mm).mm.coords;
            let panel_from_tool =
                Rigid::<Panel, Tool>::from_isometry_unchecked(nalgebra::Isometry3::from_parts(place.into(), turn));
            KukaPose::from_rigid(&(truth.base_from_panel * panel_from_tool))
        };
        let share = |height_mm: f64| {
            let follower = Follower { received_states: Arc::default(), ..follower.clone() };
            let state = |time_ms| State {
                active_base: KukaPose::default(),
                ..state_message(time_ms, TOOL, along(height_mm))
            };
            [0, 100, 200].into_iter().for_each(|time_ms| follower.process_state(&state(time_ms)));
            TouchedPoints::reached_by_disc(&follower.trace(9_999), &truth, 200.0).covered_share(spot)
        };
        assert!((share(0.0) - 1.0).abs() < 1e-12);
        assert_eq!(share(3.0), 0.0);
    }

    #[test]
    fn a_controller_that_is_no_mock_is_not_followed() {
        assert!(Follower::is_simulated_controller(&state_message(0, 0, at(0.0))));
        assert!(!Follower::is_simulated_controller(&State { boot: 813_715_200, ..state_message(0, 0, at(0.0)) }));
    }
}
