//! The configuration of a mock controller: its arm, channels and clock, the meaning of its inputs and outputs, the
//! programs that it executes, and the world around it. Outputs act on the world, and inputs are read from the world.

use super::channel_file::{ChannelFile, MockError};
use super::fault::FaultSpec;
use super::kinematics::Arm;
use super::options::{CHECKSUM, Clock, Rule};
use panelprep_base::config::Problem;
use panelprep_base::geometry::Joints;
use panelprep_cell::controller::is_named;
use panelprep_kuka::krl::{Kss, Program, UndocumentedBehaviour, analyse, parse};
use panelprep_sim::RealArm;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The shipped programs and data lists of the controller.
const SHIPPED_FILES: [(&str, &str); 8] = [
    ("cell_config.dat", include_str!("../../../config/kuka/cell_config.dat")),
    ("cell_data.dat", include_str!("../../../config/kuka/cell_data.dat")),
    ("cell_judge.src", include_str!("../../../config/kuka/cell_judge.src")),
    ("cell_link.src", include_str!("../../../config/kuka/cell_link.src")),
    ("cell_motion.src", include_str!("../../../config/kuka/cell_motion.src")),
    ("cell_submit.src", include_str!("../../../config/kuka/cell_submit.src")),
    ("cell_tell.src", include_str!("../../../config/kuka/cell_tell.src")),
    ("cell_user.src", include_str!("../../../config/kuka/cell_user.src")),
];

/// The configuration of a mock controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// The arm.
    pub arm: Arm,
    /// The real arm, if it differs from the nominal arm; it determines the true flange pose.
    pub real_arm: Option<RealArm>,
    /// The axis angles at the start of the controller.
    pub start: Joints,
    /// CELLCMD.xml.
    pub commands: ChannelFile,
    /// CELLSTAT.xml.
    pub states: ChannelFile,
    /// The source of the controller's time.
    pub clock: Clock,
    /// The boot id, which changes at each start of a controller.
    pub boot: i32,
    /// The checksum of the KRL programs.
    pub checksum: i32,
    /// The `$IN` numbers for the bits of `In` in the state message, lowest bit first; at most 31.
    pub inputs: Vec<u16>,
    /// The `$OUT` numbers for the bits of `Out` in the state message, lowest bit first; at most 31.
    pub outputs: Vec<u16>,
    /// The number of the `$OUT` that drives the tool.
    pub tool_output: Option<u16>,
    /// The outputs that the end of an epoch switches off: the `$OUT` number and the delay, ms. An output with the delay
    /// 0 is switched off immediately, and while it is on, the watchdog for the client is active.
    pub off_delays_ms: BTreeMap<u16, u64>,
    /// The $OUT number of each signal to a production line: ready, cycle done, pass, fail, review, fault; 0 for a
    /// signal that is not used.
    pub line_outputs: [u16; 6],
    /// The inputs that can be set: the `$IN` number, and the number of the `$FLAG` that is read instead.
    pub mapped_inputs: BTreeMap<u16, u16>,
    /// Duration of each user subroutine, ms. The position in the list is the index of the subroutine, from 0.
    pub subroutines_ms: Vec<u64>,
    /// The sequence number of the last state message before the start.
    pub first_state: i32,
    /// The planned faults.
    pub faults: FaultSpec,
    /// The controller's own programs to be executed; `None` for the hand-written model.
    pub programs: Option<Programs>,
    /// A rule that the mock controller ignores, to check that the tests detect this.
    pub omitted_rule: Option<Rule>,
}

impl Setup {
    /// Creates the configuration of a KR 6 R700-2 at its home position with these channels: lock step, inputs and
    /// outputs 1 to 8, the tool on output 5, water on 2, light on 1, extraction on 4, and one subroutine of 100 ms.
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

/// The devices that are connected to the controller's inputs and outputs. Its methods are called while the controller
/// is locked, so they must not call the controller.
pub trait World: Send {
    /// `$OUT[number]` changed.
    fn on_output(&mut self, number: u16, value: bool, time_ms: u64);

    /// Returns the current value of `$IN[number]`. `None` keeps the value that was set with
    /// [`Controller::set_input`](super::Controller::set_input).
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

/// The programs that a mock controller executes, and options of their execution.
#[derive(Debug, Clone, PartialEq)]
pub struct Programs {
    pub(super) program: Arc<Program>,
    /// The behaviour that public documents do not specify.
    pub meaning: UndocumentedBehaviour,
    /// The random seed of the scheduler.
    pub seed: u64,
    /// Whether the scheduler chooses random numbers of statements; otherwise each interpreter runs until it waits.
    pub is_adverse_scheduling: bool,
    /// Whether the controller starts with the initial values of the data lists (cold start); otherwise it starts with
    /// the values at its last shutdown.
    pub cold_start: bool,
    /// The value of `$ROB_TIMER` at the start, ms.
    pub uptime_ms: u64,
    /// Whether the submit interpreter starts its next cycle immediately if a cycle ends without waiting; otherwise it
    /// starts with the next tick.
    pub busy_submit: bool,
    /// Whether the inputs and outputs of `cell_config.dat` are used; otherwise those of this configuration replace
    /// them.
    pub uses_config_io: bool,
    /// Remarks about the programs for a person: file, line, and the part that is not executed or not known.
    pub remarks: Vec<String>,
}

impl Programs {
    /// Compiles programs and data lists, each given by its name and text. Statements that are not executed or that
    /// caused a warning are listed in the remarks.
    ///
    /// # Errors
    /// If a file has an error; the message contains file and line.
    pub fn load(files: &[(&str, &str)]) -> Result<Self, MockError> {
        let read: Vec<_> = files.iter().map(|(name, text)| parse(name, text)).collect();
        // Functions that are missing in an older version of KSS are reported by `panelprep check`, so the newest
        // version is used here.
        let analysis = analyse(&read, Some(Kss { major: 8, minor: 7 }));
        let place =
            |name: &str, Problem { line, key, message }: &Problem| format!("{name}:{line}: {key}: {message}");
        for ((name, _), problems) in files.iter().zip(&analysis.problems) {
            if let Some(problem) = problems.first() {
                return Err(MockError::Program(place(name, problem)));
            }
        }
        if analysis.program.is_too_large {
            return Err(MockError::Program("the programs are too large for the mock controller".to_owned()));
        }
        for name in ["CELL_INIT", "CELL_CYCLE", "CELL_MOTION"] {
            if analysis.program.routine(name).is_none() {
                return Err(MockError::Program(format!("the programs do not define the routine {name}")));
            }
        }
        let remarks = files.iter().zip(analysis.warnings.iter().zip(&analysis.unexecuted));
        let remarks = remarks.flat_map(|((name, _), (warnings, unexecuted))| {
            warnings.iter().chain(unexecuted).map(|problem| place(name, problem))
        });
        Ok(Programs {
            remarks: remarks.collect(),
            program: Arc::new(analysis.program),
            meaning: UndocumentedBehaviour::default(),
            seed: 0,
            is_adverse_scheduling: false,
            cold_start: false,
            uptime_ms: 0,
            busy_submit: false,
            uses_config_io: false,
        })
    }

    /// Compiles the shipped programs together with the user's own files. A user's file replaces the shipped file with
    /// the same name.
    ///
    /// # Errors
    /// If a file has an error; the message contains file and line.
    pub fn with_user_files(own: &[(&str, &str)]) -> Result<Self, MockError> {
        let is_own = |name: &str| own.iter().any(|(of, _)| is_named(of, name));
        let shipped = SHIPPED_FILES.iter().copied().filter(|(name, _)| !is_own(name));
        let files: Vec<_> = own.iter().copied().chain(shipped).collect();
        let keeps_config = is_own("cell_config.dat");
        Ok(Programs { uses_config_io: keeps_config, ..Programs::load(&files)? })
    }

    /// Compiles the shipped programs.
    ///
    /// # Errors
    /// Never with the files that are part of this build; they are checked like all others.
    pub fn shipped() -> Result<Self, MockError> {
        Programs::load(&SHIPPED_FILES)
    }

    /// Returns the compiled program, for tests that refer to its statements.
    pub fn program(&self) -> &Program {
        &self.program
    }
}
