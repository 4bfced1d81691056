//! How a mock controller's clock, mode and rules can be set.

/// What makes the controller's time pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// The caller of [`Controller::advance_ms`](super::Controller::advance_ms), as the server does by the wall
    /// clock.
    Free,
    /// The client: each heartbeat grants 100 ms, once every command up to the one that it names has arrived.
    LockStep,
}

/// The mode switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Manual, at most 250 mm/s; moves only while the start key is held.
    T1 = 1,
    /// Manual at full speed; moves only while the start key is held.
    T2 = 2,
    /// Automatic.
    Aut = 3,
    /// Automatic, started from outside.
    Ext = 4,
}

/// A rule that the controller's programs keep. One can be left out, to see that the tests notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Commands of ended epochs are dropped.
    EpochCheck,
    /// Silence stops what is queued, and closes the channels.
    Watchdog,
    /// A lost connection ends the epoch.
    LinkLoss,
    /// A stop discards what is queued.
    Discard,
    /// A stop in contact retracts.
    Retract,
    /// The end of an epoch switches outputs off.
    OutputsOff,
    /// The epoch is raised by a step at most.
    EpochStep,
}

/// The checksum that the hand-written model reports; controllers that execute programs report theirs.
pub const CHECKSUM: i32 = 1;
