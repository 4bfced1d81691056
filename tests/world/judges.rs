//! The requirements at every moment of a world, in addition to the oracles of the connection for client and arm. They
//! are checked on the controller's outputs and axes, not on the data of the program.

use super::fixture::CellContents;
use super::inside::Inside;
use panelprep::cycle::{self, At, Epoch, Lens, Light, Path, Robot, State, Tool};
use panelprep::verdict::Verdict;

/// Maximum time for a stop, ms: it ends within `[limits] stop_deadline_s`, and a following abort ends within the time
/// of the watchdog and a retract.
const STOP_MS: u64 = 10_000 + MAX_ABORT_MS;
const MAX_ABORT_MS: u64 = 3_000;
/// Maximum age of a fact that is compared with the controller's outputs, ms: the delay of a state in transit, and the
/// time of the controller's own program.
const MAX_FACT_AGE_MS: u64 = 300;
/// Maximum time for a reaction to a contradicting feedback, ms: half a second of waiting, and the delay of messages.
const MAX_CONTRARY_FEEDBACK_MS: u64 = 500 + 2 * MAX_FACT_AGE_MS;
const PARKED_DEG: f64 = 0.2;

/// Checks each state that the loop reports.
pub fn check_state(world: &mut Inside, state: &State, stopping: &mut Option<(cycle::Request, u64)>) {
    stops(world, state, stopping);
    agrees(world, state);
    leaves_the_panel(world, state);
    keeps_rules(world, state);
    let wrong = world.lock_around().wrong.pop();
    world.counts.judged("interlocks");
    if let Some(what) = wrong.filter(|_| !world.is_strange()) {
        world.wrong("interlocks", what);
    }
}

/// Checks that a stop or an abort ends all motion, in every state.
fn stops(world: &mut Inside, state: &State, stopping: &mut Option<(cycle::Request, u64)>) {
    let Some((request, since_ms)) = *stopping else { return };
    let is_over = state.at.is_at_rest();
    let bound_ms = if request == cycle::Request::Stop { STOP_MS } else { MAX_ABORT_MS };
    // The time for which faults block connection and controller is added to the maximum time of a stop.
    let bound_ms = bound_ms + world.lasts_until_ms.saturating_sub(since_ms).min(20_000);
    world.counts.judged("stop");
    if is_over {
        *stopping = None;
    } else if world.now_ms() > since_ms + bound_ms {
        let at = state.at;
        world.wrong("stop", format!("{request:?} was asked at {since_ms} ms, and the table is still in {at:?}"));
    }
}

/// Checks that the state machine never performs certain actions, whatever the cell reports.
fn keeps_rules(world: &mut Inside, state: &State) {
    let (pass, most) = (state.job.pass, state.job.max_passes);
    if pass > most && state.job.running {
        world.wrong("table", format!("pass {pass} of {most}"));
    }
    if matches!(state.at, At::Held(_)) && state.facts.token.is_some() {
        world.wrong("table", "the cell is held, and the localization is taken for live".to_owned());
    }
}

/// Checks R21: contact ends if the tool or the extraction does not run.
fn leaves_the_panel(world: &mut Inside, state: &State) {
    let in_contact = matches!(state.at, At::Execute(_))
        && state.intent.is_some_and(|intent| intent.motion.path == Path::Contact)
        && state.facts.tool == Tool::Running;
    if !in_contact || !world.is_calm_but_for_feedback() || !world.lock_around().is_dead(world.now_ms()) {
        world.dead_since_ms = None;
        return;
    }
    world.counts.judged("no contact without tool and extraction");
    let (now_ms, since_ms) = (world.now_ms(), *world.dead_since_ms.get_or_insert(world.now_ms()));
    if now_ms > since_ms + MAX_CONTRARY_FEEDBACK_MS {
        let what = format!("the tool or the extraction has stood still since {since_ms} ms, and contact continues");
        world.wrong("no contact without tool and extraction", what);
    }
}

/// Checks that the loop's facts agree with the controller.
fn agrees(world: &mut Inside, state: &State) {
    let facts = &state.facts;
    let is_calm = world.cell.all_heard()
        && facts.robot == Robot::Ready
        && !world.is_strange()
        && world.now_ms() > world.lasts_until_ms + MAX_FACT_AGE_MS
        && !world.is_troubled();
    if !is_calm {
        world.ended_since_ms = None;
        return;
    }
    world.counts.judged("facts");
    let open = world.open_epoch().map(|epoch| epoch.0);
    if (facts.epoch == Epoch::Open) != open.is_some() && facts.epoch != Epoch::Changing {
        world.wrong("facts", format!("the table's epoch is {:?}, the session's is {open:?}", facts.epoch));
    }
    let has_ended = open.is_some() && world.cell.controller.is_stopped();
    world.ended_since_ms = has_ended.then(|| world.ended_since_ms.unwrap_or(world.now_ms()));
    if world.ended_since_ms.is_some_and(|since_ms| world.now_ms() > since_ms + MAX_FACT_AGE_MS) {
        world.wrong("facts", format!("the session's epoch {open:?} is open, the controller has ended it"));
    }
    let [light_on, water_on, lens_shut, _, tool_on] = [1, 2, 3, 4, 5].map(|output| world.is_on(output));
    if facts.tool == Tool::Off && tool_on {
        world.wrong("facts", "the tool is taken for off, and it is on".to_owned());
    }
    if facts.water_off() && water_on {
        world.wrong("facts", "the water is taken for off, and it is on".to_owned());
    }
    if facts.light == Light::Off && light_on {
        world.wrong("facts", "the light is taken for off, and it is on".to_owned());
    }
    if facts.lens == Lens::Clear && lens_shut {
        world.wrong("facts", "the lens is taken for clear, and it is shut".to_owned());
    }
    if facts.arm == Some(Path::Park) && state.due.is_none() {
        let park = super::fixture::Fixture::shared().setup.park_pose;
        let off_deg = world.cell.controller.joints().max_difference_deg(&park);
        if off_deg > PARKED_DEG {
            world.wrong("facts", format!("the arm is taken for parked, and stands {off_deg:.2}° off"));
        }
    }
    let is_shut = matches!(state.at, At::Held(_) | At::Idle | At::Complete { .. });
    if is_shut && (tool_on || water_on) {
        world.wrong("facts", format!("{:?} with tool on {tool_on}, water on {water_on}", state.at));
    }
}

/// Checks the cell when a 3D shot is about to be captured.
pub fn scans(world: &mut Inside) {
    let park = super::fixture::Fixture::shared().setup.park_pose;
    let is_parked = world.cell.controller.joints().max_difference_deg(&park) <= PARKED_DEG;
    let moves = world.cell.controller.is_moving();
    let is_lit = world.is_on(1);
    // The facts of a program that receives wrong reports, or was just disturbed, may be wrong.
    let is_known = !world.is_strange() && world.now_ms() > world.lasts_until_ms;
    world.counts.judged("interlocks");
    if (!is_parked || moves || is_lit) && is_known {
        world.wrong("interlocks", format!("a 3D shot: parked {is_parked}, moving {moves}, light {is_lit}"));
    }
}

/// Checks the verdict of a cycle.
pub fn concluded(world: &mut Inside, verdict: Verdict) {
    world.counts.judged("verdict");
    let is_untrue = match world.stands {
        CellContents::Nothing => matches!(verdict, Verdict::Pass | Verdict::Fail),
        CellContents::Greasy => false,
        CellContents::Stubborn => verdict == Verdict::Pass,
        CellContents::Clean => verdict == Verdict::Fail && world.lasts_until_ms == 0,
    };
    if is_untrue {
        let stands = world.stands;
        world.wrong("verdict", format!("the verdict is {}, and there stands {stands:?}", verdict.keyword()));
    }
}

/// Checks the verdict of a cycle without faults, and that a person stops it only after repeated holds.
pub fn ends_by_itself(world: &mut Inside, verdict: Verdict) {
    world.counts.judged("a cycle without trouble");
    if verdict == Verdict::Aborted {
        let stands = world.stands;
        world.wrong("a cycle without trouble", format!("it was aborted, and there stands {stands:?}"));
    }
}
