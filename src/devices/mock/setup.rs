//! The setup of a mock controller: its arm, its channels, its clock, the meaning of its inputs and outputs, and the
//! world around it. Outputs act on the world, inputs come from it.

use super::channel_file::ChannelFile;
use super::fault::FaultSpec;
use super::interpreted::Programs;
use super::kinematics::Arm;
use super::options::{CHECKSUM, Clock, Rule};
use panelprep_base::geometry::Joints;
use panelprep_sim::RealArm;
use std::collections::BTreeMap;

/// A mock controller's configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// The arm.
    pub arm: Arm,
    /// The real arm, if it differs from the nominal geometry; the true flange pose is calculated from the real arm.
    pub real_arm: Option<RealArm>,
    /// The axis angles at the start.
    pub start: Joints,
    /// CELLCMD.xml.
    pub commands: ChannelFile,
    /// CELLSTAT.xml.
    pub states: ChannelFile,
    /// The source of the controller's time.
    pub clock: Clock,
    /// The boot number, which changes at each start of a controller.
    pub boot: i32,
    /// The checksum of the KRL programs.
    pub checksum: i32,
    /// The $IN numbers of the bits of `In`, lowest bit first; at most 31.
    pub inputs: Vec<u16>,
    /// The $OUT numbers of the bits of `Out`, lowest bit first; at most 31.
    pub outputs: Vec<u16>,
    /// The $OUT that runs the tool.
    pub tool_output: Option<u16>,
    /// Each $OUT that the end of an epoch switches off, and the delay, ms. With the delay 0, the output is switched
    /// off at once, and the client is watched for silence while the output is on.
    pub off_delays_ms: BTreeMap<u16, u64>,
    /// The $OUT number of each signal to a production line: ready, cycle done, pass, fail, review, fault; 0 for a
    /// signal that is not used.
    pub line_outputs: [u16; 6],
    /// Inputs that can be set, with the $FLAG that is read in place of each input.
    pub mapped_inputs: BTreeMap<u16, u16>,
    /// Duration of each user subroutine, ms; its index is its position here, from 0.
    pub subroutines_ms: Vec<u64>,
    /// The sequence number of the last state before the start.
    pub first_state: i32,
    /// The planned faults.
    pub faults: FaultSpec,
    /// The controller's own programs that are executed; `None` for the model in Rust.
    pub programs: Option<Programs>,
    /// A rule that is not followed; for tests of the tests.
    pub omitted_rule: Option<Rule>,
}

impl Setup {
    /// Creates the setup of a KR 6 R700-2 at home with these channels: lock step, inputs and outputs 1 to 8, the
    /// tool on output 5, water on 2, light on 1 and extraction on 4, one subroutine of 100 ms.
    pub fn new(commands: ChannelFile, states: ChannelFile) -> Self {
        let start = Joints { a1_deg: 0.0, a2_deg: -90.0, a3_deg: 90.0, a4_deg: 0.0, a5_deg: 60.0, a6_deg: 0.0 };
        Setup {
            arm: Arm::kr6_r700_2(),
            real_arm: None,
            start,
            commands,
            states,
            clock: Clock::LockStep,
            boot: 1,
            checksum: CHECKSUM,
            inputs: (1..=8).collect(),
            outputs: (1..=8).collect(),
            tool_output: Some(5),
            off_delays_ms: BTreeMap::from([(1, 60_000), (2, 0), (4, 30_000), (5, 0)]),
            line_outputs: [0; 6],
            mapped_inputs: BTreeMap::new(),
            subroutines_ms: vec![100],
            first_state: 0,
            faults: FaultSpec::default(),
            programs: None,
            omitted_rule: None,
        }
    }
}

/// The world on the other side of the controller's terminals. The world is called while the controller is locked, so
/// it must not request anything from the controller.
pub trait World: Send {
    /// `$OUT[number]` changed.
    fn on_output(&mut self, number: u16, value: bool, time_ms: u64);

    /// Returns the state of `$IN[number]` now; `None` keeps the state that
    /// [`Controller::set_input`](super::Controller::set_input) has set.
    fn input(&self, number: u16, time_ms: u64) -> Option<bool>;
}

/// Nothing is connected.
#[derive(Debug, Clone, Copy, Default)]
pub struct UnconnectedWorld;

impl World for UnconnectedWorld {
    fn on_output(&mut self, _: u16, _: bool, _: u64) {}

    fn input(&self, _: u16, _: u64) -> Option<bool> {
        None
    }
}
