//! The cycle as a pure state table: `step(State, Event) -> (State, Vec<Effect>)`.
//!
//! An [`Event`] is a request of a person or a report of the cell; an [`Effect`] is what the control loop then does.
//! `interlocks` defines the conditions of each action and the action that satisfies each condition, `step` the meaning
//! of each event in each state, and `execute` the phase after each phase; `turn` combines them. The sequence of actions
//! within a phase is not programmed: the table performs the first action that is still needed, receives its answer, and
//! checks the conditions again.
//!
//! The outer states have their PackML names. Inside Execute, the phases form a loop:
//!
//! ```text
//! Locate → Refine → Dry → Wet → Inspect ─┬─ no break → Complete (pass)
//!  (3D)   (corner)                       └─ breaks → Plan → Verify → Abrade → Retract → Assess → Rinse → Wet → …
//! ```
//!
//! The table has no clock: [`Effect::Arm`] starts a deadline, and [`Report::Deadline`] reports its end. It reads no
//! files, opens no sockets and uses no random numbers. [`Facts`] become known only by reports, and a command that
//! changes a fact makes the fact unknown. An answer is never used for another action: each action has an [`Id`], and a
//! report with any other id is counted and dropped. A motion ends only when the robot reports its standstill. Nothing
//! is resumed automatically: after [`Report::Boot`] the state is at rest, and an interrupted path is planned again.
//!
//! The table also guarantees the following properties, which the random walks and the exhaustive search check:
//! - A stop in any state reaches the arm within its time limit: a stop waits only until the water is switched off, and
//!   an abort waits for nothing. The link (`eki`) guarantees the limit itself: either the controller stops within the
//!   watchdog time, or the link is disconnected.
//! - After any end, no output except the lens shutter stays on for longer than its delay. After the end of an epoch,
//!   the outputs that the controller then switches off are unknown; tool and water are treated as on until they are
//!   confirmed to be off, even after a restart of the program.
//! - The facts agree with the link: [`Report::EpochOver`] closes the epoch here in every state.
//! - After the last fault, the requests `clear`, `reset` and `start` lead to a cycle within a limited number of steps.
//!
//! Sources: `ANSI/ISA-TR88.00.02` for the names of the outer states; thesis Fig. 4.30 for the order.

mod event;
mod execute;
mod facts;
mod interlocks;
mod state;
mod step;
mod turn;

#[cfg(test)]
mod tests;

pub use event::{
    Action, Answer, Deadline, Effect, Event, Film, Frames, Grade, Id, Motion, Outcome, Path, Refusal, Report,
    Request, Robot, Switch, Trouble,
};
pub use facts::{Epoch, Extraction, Facts, Lens, Light, Tool, Water};
pub use interlocks::open_interlocks;
pub use state::{At, Cause, Due, Hold, Intent, Job, Phase, State, Why};
pub use step::{fold_journal, recover, step};
