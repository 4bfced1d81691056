//! The cycle as a pure table: `step(State, Event) -> (State, Vec<Effect>)`.
//!
//! An [`Event`] is a person's request or a report of the cell; an [`Effect`] is what the loop then does. `interlocks`
//! states what each action needs and which action satisfies that need, `step` the meaning of each event in each state,
//! `execute` the successor of each phase; `turn` joins them. The sequence of actions that leads to a phase is not
//! written down anywhere: the table performs the first action that is still needed, receives its answer, and checks
//! again.
//!
//! The outer states have their PackML names. Inside Execute, the phases form a loop:
//!
//! ```text
//! Locate → Refine → Dry → Wet → Inspect ─┬─ no break → Complete (pass)
//!  (3D)   (corner)                       └─ breaks → Plan → Verify → Abrade → Retract → Assess → Rinse → Wet → …
//! ```
//!
//! Limits of the table. It has no clock: [`Effect::Arm`] requests a deadline, [`Report::Deadline`] reports that it is
//! over. It reads no files, opens no sockets, draws no random numbers. It assumes nothing that was not reported:
//! [`Facts`] become known by reports alone, and a request for a change makes a fact unknown. It never uses the answer
//! to one action for another: each action has an [`Id`], and a report with another id is dropped and counted. It never
//! ends a motion: the robot reports its standstill. It never resumes automatically: after [`Report::Boot`] it rests,
//! and an interrupted path is planned again.
//!
//! The table also guarantees the following, which the random walks and the search check:
//! - A stop in every state reaches the arm within its time limit: a stop waits only for the water, and an abort for
//!   nothing. The link (`eki`) guarantees the limit itself: a stop is obeyed within the watchdog, or the link is
//!   disconnected.
//! - After any end, no output except the lens shutter stays on for longer than its delay. The end of an epoch makes the
//!   state of the outputs unknown that the controller then switches off; tool and water count as on until they are
//!   proven off, also after the program's end.
//! - The facts equal the link's: [`Report::EpochOver`] closes the epoch here in every state.
//! - After the last fault `clear`, `reset` and `start` lead to a cycle within a limited number of steps.
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
