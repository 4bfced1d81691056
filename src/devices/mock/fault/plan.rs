//! Faults, and when they happen.

use super::super::options::Mode;

/// The connections that a fault affects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConnectionSide {
    /// CELLCMD.
    Command,
    /// CELLSTAT.
    State,
    /// Both.
    Both,
}

/// One fault. `for_ms` is its duration; `None` if it lasts for ever.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// `cut`: the controller closes connections.
    Cut(ConnectionSide),
    /// `unplug`: the cable is out. Bytes wait on both sides, nothing is reported.
    Unplug {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `mute`: the controller receives and sends nothing.
    Mute {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `no-acks`: commands are executed and not acknowledged.
    NoAcks {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `stall`: the submit interpreter stalls; the arm continues with the commands that it has.
    Stall {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `garbage`: the controller sends bytes that are not a document.
    Garbage(ConnectionSide),
    /// `skip-state`: the sequence number of the next state is skipped.
    SkipState,
    /// `lose-base`: the next `set_base` is acknowledged and has no effect.
    LoseBase,
    /// `lose-tool`: the next `set_tcp` is acknowledged and has no effect.
    LoseTool,
    /// `wrong-base`: the next `set_base` is set with an error of 1 mm in X.
    WrongBase,
    /// `refuse`: the next command is refused with this `Err`, 1 to 12.
    Refuse(u8),
    /// `override`: a person sets the override to this value, 1 to 100 %, and back to 100 % after a while.
    Override {
        /// Override, %.
        percent: u8,
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `slow`: the arm moves at this percentage of its speed, 1 to 100 %, although the reported override does not
    /// change.
    Slow {
        /// Share of the speed, %.
        percent: u8,
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `measured`: the reported pose of the tool is off by this distance, 1 to 200 mm, along Z of the active base.
    Measured {
        /// Deviation of the measured pose, mm.
        deviation_mm: u8,
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `e-stop`: the emergency stop is pressed, and released after a while; the drives then come on again.
    EStop {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `guard`: the guard is opened, and closed after a while.
    Guard {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `drives`: the drives are switched off, and on after a while.
    Drives {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `mode`: the mode switch is turned, and back to EXT after a while.
    Mode {
        /// The new mode.
        to: Mode,
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `deselect`: the robot program is deselected, and selected again after a while.
    Deselect {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
    /// `reboot`: the controller restarts and listens after a while; 3 s if no time is given.
    Reboot {
        /// Duration, ms; `None` if the fault remains.
        for_ms: Option<u64>,
    },
}

/// The start of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultTime {
    /// At this time, ms since the controller's start.
    AtMs(u64),
    /// When this number of commands has arrived.
    AtCommand(u64),
}

/// A fault and its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedFault {
    /// Start of the fault.
    pub when: FaultTime,
    /// The fault.
    pub fault: Fault,
}

/// All faults that are planned for one mock controller.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FaultSpec {
    /// The seed of delays, pieces and random faults; the same seed gives the same faults.
    pub seed: u64,
    /// Bytes arrive late by this minimum and maximum in ms, in both directions.
    pub delay_ms: Option<(u64, u64)>,
    /// The output is sent in pieces that do not follow the documents' boundaries.
    pub fragment: bool,
    /// The faults, each with its time.
    pub planned: Vec<PlannedFault>,
}
