//! The values of the system variables.

use super::super::setup::Setup;
use super::robot_state::RobotState;
use panelprep_base::geometry::{Joints, KukaPose};
use panelprep_kuka::krl::Cell;

/// A timer that counts ms.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Timer {
    pub(super) value: i64,
    pub(super) set_ms: u64,
    pub(super) runs: bool,
}

impl Timer {
    pub(super) fn value(&self, now_ms: u64) -> i64 {
        if self.runs { self.value + (now_ms - self.set_ms) as i64 } else { self.value }
    }
}

/// A frame that is written component by component.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WrittenFrame {
    pub(super) now: Option<[f32; 6]>,
    pub(super) parts: [f32; 6],
}

/// The values on which $POS_ACT depends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PoseInputs {
    pub(super) joints: Joints,
    pub(super) base: Option<[f32; 6]>,
    pub(super) tool: Option<[f32; 6]>,
}

/// A channel as the program sees it.
#[derive(Debug, Clone, Default)]
pub(super) struct ChannelState {
    pub(super) initialised: bool,
    pub(super) listens: bool,
    pub(super) cleared_ms: u64,
    pub(super) set: Vec<super::super::codec::Value>,
    /// Index after the element that was set last.
    pub(super) set_next: usize,
}

/// The controller's values in addition to the data lists.
#[derive(Debug, Clone)]
pub(in super::super) struct ControllerValues {
    pub(super) state: RobotState,
    pub(super) stop_message: bool,
    pub(super) advance: i32,
    pub(super) base: WrittenFrame,
    pub(super) tool: WrittenFrame,
    /// $VEL.CP, $ACC.CP, $APO.CDIS.
    pub(super) velocity: f32,
    pub(super) acceleration: f32,
    pub(super) distance: f32,
    pub(super) axis_velocity: [i32; 6],
    pub(super) axis_acceleration: [i32; 6],
    pub(super) timers: [Timer; 65],
    pub(super) words: [u16; 2],
    /// Values that a program writes and that have no effect in this model.
    pub(super) others: std::collections::BTreeMap<(u16, u32), Cell>,
    pub(super) channels: [ChannelState; 2],
    /// EKI_Init and EKI_Open fail until this time.
    pub(super) channels_fail_until_ms: u64,
    /// An interrupt's condition may have changed.
    pub(super) changed: bool,
    /// An approximated motion from standstill does not wait for a next motion.
    pub(super) released: bool,
    /// The reason why the arm abandoned a motion.
    pub(super) abandon_reason: Option<String>,
    /// Whether the next motion will be abandoned.
    pub(super) abandons_next_motion: bool,
    pub(super) reset_asked: bool,
    /// The value of `$ROB_TIMER` at the start.
    pub(super) uptime_ms: u64,
    /// The last requested $POS_ACT.
    pub(super) pose: Option<(PoseInputs, [f64; 6])>,
}

impl ControllerValues {
    pub(super) fn new(setup: &Setup) -> Self {
        let channel = |elements: usize| ChannelState {
            set: vec![super::super::codec::Value::Unset; elements],
            ..ChannelState::default()
        };
        ControllerValues {
            state: RobotState::Reset,
            stop_message: false,
            advance: 3,
            base: WrittenFrame::default(),
            tool: WrittenFrame::default(),
            velocity: 0.1,
            acceleration: 1.0,
            distance: 0.0,
            axis_velocity: [100; 6],
            axis_acceleration: [100; 6],
            timers: [Timer::default(); 65],
            words: [0; 2],
            others: std::collections::BTreeMap::new(),
            channels: [channel(setup.commands.sent.len()), channel(setup.states.sent.len())],
            channels_fail_until_ms: 0,
            changed: true,
            released: false,
            abandon_reason: None,
            abandons_next_motion: false,
            reset_asked: false,
            uptime_ms: setup.programs.as_ref().map_or(0, |programs| programs.uptime_ms),
            pose: None,
        }
    }

    pub(super) fn init_motion(&mut self) {
        (self.velocity, self.acceleration, self.advance) = (0.1, 1.0, 3);
        (self.axis_velocity, self.axis_acceleration) = ([100; 6], [100; 6]);
    }

    /// Returns whether the TCP can be reported, which needs a program that has set base and tool.
    pub(super) fn knows_tcp(&self) -> bool {
        let has_program = matches!(self.state, RobotState::Active | RobotState::Stopped | RobotState::Ended);
        has_program && self.base.now.is_some() && self.tool.now.is_some()
    }
}

/// Creates a pose from the six numbers of a frame.
pub(super) fn frame(numbers: [f32; 6]) -> KukaPose {
    let [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg] = numbers.map(f64::from);
    KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg }
}
