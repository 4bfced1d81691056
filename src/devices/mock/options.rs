//! Options of a mock controller: its clock, its mode and the rules that it follows.

/// The source of the controller's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// Time passes only by [`Controller::advance_ms`](super::Controller::advance_ms), which the server calls by the
    /// wall clock.
    Free,
    /// Time passes only by the client's heartbeats: each heartbeat grants 100 ms, after every command up to the one
    /// that it names has arrived.
    LockStep,
}

/// The mode switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Manual mode, at most 250 mm/s; the arm moves only while the start key is pressed.
    T1 = 1,
    /// Manual mode at full speed; the arm moves only while the start key is pressed.
    T2 = 2,
    /// Automatic.
    Aut = 3,
    /// Automatic External: a higher-level controller (PLC) starts the program.
    Ext = 4,
}

/// A rule that the controller's programs follow. One rule can be left out, to check that the tests notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Commands of ended epochs are dropped.
    EpochCheck,
    /// If the client is silent, the queued commands are stopped and the channels closed.
    Watchdog,
    /// A lost connection ends the epoch.
    LinkLoss,
    /// A stop discards the queued commands.
    Discard,
    /// A stop in contact is followed by a retract.
    Retract,
    /// The end of an epoch switches outputs off.
    OutputsOff,
    /// One request raises the epoch by at most one step.
    EpochStep,
}

/// The checksum that the hand-written model reports; controllers that execute programs report theirs.
pub const CHECKSUM: i32 = 1;
