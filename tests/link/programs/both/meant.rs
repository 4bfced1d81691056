//! The limits of differences between the model and the programs, and the intended differences.

use super::EpochTrace;
use super::script::{Disturbance, Part, STEP_MM};
use panelprep::devices::mock::{ExecutedMotion, Fault};

/// Maximum difference in the number of motions that were executed before a stop. The watchdogs of the model and of the
/// programs may have received different last messages, so that the two stops are up to 0.3 s apart.
const MAX_COUNT_DIFFERENCE: usize = 8;
/// Number of motions that the client sends ahead.
const WINDOW: usize = 50;
/// Maximum difference at a rounded corner, mm. A corner that was not planned in time is passed exactly, so that one
/// path is rounded there and the other is not.
const MAX_CORNER_DIFFERENCE_MM: f64 = 0.4 * STEP_MM + 0.01;

/// The kinds of differences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    Opened,
    Finished,
    Why,
    HarmfulOutput,
    OnPanel,
    Connected,
    /// The order of the motions that both have executed.
    Order,
    /// The number of executed motions.
    Executed,
    Outputs,
    /// The position at which a motion ended.
    Place,
}

/// One epoch of a script, on the model and on the programs.
pub struct Both<'a> {
    pub part: &'a Part,
    /// Whether the scheduler delays the interpreters.
    pub adverse: bool,
    pub model: EpochTrace,
    pub programs: EpochTrace,
}

impl Both<'_> {
    pub fn differences(&self) -> Vec<Kind> {
        let Both { model, programs, .. } = self;
        let mut found = Vec::new();
        let mut differ = |kind: Kind, differs: bool| found.extend(differs.then_some(kind));
        differ(Kind::Opened, model.opened != programs.opened);
        differ(Kind::Finished, model.finished != programs.finished);
        differ(Kind::Why, model.why != programs.why);
        differ(Kind::HarmfulOutput, model.harmful != programs.harmful);
        differ(Kind::OnPanel, model.on_panel != programs.on_panel);
        differ(Kind::Connected, model.connected != programs.connected);
        let (one, other) = (&model.executed, &programs.executed);
        differ(Kind::Order, one.iter().zip(other).any(|(one, other)| one.id != other.id));
        let apart = one.len().abs_diff(other.len());
        let both_finished = model.finished && programs.finished;
        differ(Kind::Executed, apart > if both_finished { 0 } else { MAX_COUNT_DIFFERENCE });
        differ(
            Kind::Outputs,
            both_finished && model.before == programs.before && model.outputs != programs.outputs,
        );
        let off_mm = |(one, other): (&ExecutedMotion, &ExecutedMotion)| {
            one.base_from_flange.origin().distance_mm(other.base_from_flange.origin())
        };
        differ(Kind::Place, one.iter().zip(other).map(off_mm).fold(0.0, f64::max) > MAX_CORNER_DIFFERENCE_MM);
        found
    }

    fn is_wrong(&self, which: impl Fn(Disturbance) -> bool) -> bool {
        self.part.wrong.is_some_and(|(_, disturbance)| which(disturbance))
    }

    /// Returns whether one side receives nothing from the other side for some time.
    fn is_silent(&self) -> bool {
        use Fault::{Mute, NoAcks, Stall, Unplug};
        self.is_wrong(|disturbance| match disturbance {
            Disturbance::Deaf(_) | Disturbance::Stalls(_) => true,
            Disturbance::Happens(fault) => {
                matches!(fault, Mute { .. } | NoAcks { .. } | Stall { .. } | Unplug { .. })
            }
            _ => false,
        })
    }

    fn whys(&self, allowed: &[&str]) -> bool {
        let is_allowed = |why: Option<&str>| why.is_some_and(|why| allowed.contains(&why));
        is_allowed(self.model.why) && is_allowed(self.programs.why)
    }
}

/// An intended difference between model and programs.
pub struct IntendedDifference {
    pub name: &'static str,
    /// The number of a script that shows the difference.
    pub shown_by: u64,
    pub reason: &'static str,
    pub kinds: &'static [Kind],
    pub is_it: fn(&Both<'_>) -> bool,
}

/// All intended differences, apart from the time at which events occur.
pub const INTENDED_DIFFERENCES: [IntendedDifference; 4] = [
    IntendedDifference {
        name: "which message tells of a stop first",
        shown_by: 3,
        reason: "one stop is reported by an acknowledgement that refuses and by a state; the model sends both in one act, the \
                 programs by two statements of a cycle, and the client gives the reason that reaches it first",
        kinds: &[Kind::Why],
        is_it: |both| {
            both.whys(&["refused: stopped", "refused: no motion", "safety", "by the program"])
                && both.is_wrong(|disturbance| {
                    use Fault::{Deselect, Drives, EStop, Guard, Mode};
                    matches!(
                        disturbance,
                        Disturbance::Happens(
                            EStop { .. } | Guard { .. } | Drives { .. } | Mode { .. } | Deselect { .. }
                        )
                    )
                })
        },
    },
    IntendedDifference {
        name: "whose watchdog ends the epoch",
        shown_by: 26,
        reason: "client and controller both count 400 ms of silence, each from the last message that it has heard",
        kinds: &[Kind::Why],
        is_it: |both| both.whys(&["watchdog", "by the program"]) && both.is_silent(),
    },
    IntendedDifference {
        name: "what was sent before the silence",
        shown_by: 464,
        reason: "the client sends a second of motion ahead by what it was told last; in a silence the robot executes what it has",
        kinds: &[Kind::Executed],
        is_it: |both| {
            both.is_silent() && both.model.executed.len().abs_diff(both.programs.executed.len()) <= WINDOW
        },
    },
    IntendedDifference {
        name: "a starved interpreter comes too late",
        shown_by: 715,
        reason: "the scheduler gives it a few statements a tick for up to 1.5 s: the client's watchdog misses an answer, or \
                 the programs miss the next point in contact. The model always has the time for its cycle",
        kinds: &[Kind::Finished, Kind::Why, Kind::Executed],
        is_it: |both| {
            let in_contact = both.part.contact && both.programs.why == Some("by the program");
            both.adverse && (in_contact || both.programs.why == Some("watchdog"))
        },
    },
];
