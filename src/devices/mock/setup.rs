//! The setup of a mock controller: its arm, its channels, its clock, the meaning of its inputs and outputs, the
//! programs that it executes, and the world around it. Outputs act on the world, inputs come from it.

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

/// The shipped programs and data lists.
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
    /// A rule that the mock controller does not follow, to check that the tests detect this.
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

/// The programs that a mock controller executes, and the options of their execution.
#[derive(Debug, Clone, PartialEq)]
pub struct Programs {
    pub(super) program: Arc<Program>,
    /// The behaviour that public documents do not define.
    pub meaning: UndocumentedBehaviour,
    /// Seed of the scheduler.
    pub seed: u64,
    /// The scheduler chooses random numbers of statements; otherwise each interpreter runs until it waits.
    pub is_adverse_scheduling: bool,
    /// A start of the controller uses the values of the data lists; otherwise it uses the values at the last end.
    pub cold_start: bool,
    /// The value of `$ROB_TIMER` at the start, ms.
    pub uptime_ms: u64,
    /// The submit interpreter begins its next cycle at once if one ends without waiting; otherwise with the next
    /// tick.
    pub busy_submit: bool,
    /// Inputs and outputs are those of `cell_config.dat`; otherwise those of the mock controller's setup replace
    /// them.
    pub uses_config_io: bool,
    /// Remarks for a person about these programs: file, line, and what is not executed or not known.
    pub remarks: Vec<String>,
}

impl Programs {
    /// Reads programs and data lists, each given as a name and a text. Statements that are not executed, or are
    /// doubtful, are listed in the remarks.
    ///
    /// # Errors
    /// If a file is not correct, with file and line.
    pub fn load(files: &[(&str, &str)]) -> Result<Self, MockError> {
        let read: Vec<_> = files.iter().map(|(name, text)| parse(name, text)).collect();
        // Each version of KSS lacks some functions; `panelprep check` reports what a version lacks, so the newest
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

    /// Returns the shipped programs together with the user's own files. A file replaces the shipped one of the same
    /// name.
    ///
    /// # Errors
    /// If a file is not correct, with file and line.
    pub fn with_user_files(own: &[(&str, &str)]) -> Result<Self, MockError> {
        let is_own = |name: &str| own.iter().any(|(of, _)| is_named(of, name));
        let shipped = SHIPPED_FILES.iter().copied().filter(|(name, _)| !is_own(name));
        let files: Vec<_> = own.iter().copied().chain(shipped).collect();
        let keeps_config = is_own("cell_config.dat");
        Ok(Programs { uses_config_io: keeps_config, ..Programs::load(&files)? })
    }

    /// Returns the shipped programs, as a mock controller executes them.
    ///
    /// # Errors
    /// Never for the files with which this program was built; they are read like all others.
    pub fn shipped() -> Result<Self, MockError> {
        Programs::load(&SHIPPED_FILES)
    }

    /// Returns the program, for tests that refer to its statements.
    pub fn program(&self) -> &Program {
        &self.program
    }
}
