//! Tests the record of contact: the permitted waypoints, the effect of a lost connection, the counted sanding passes of
//! earlier cycles, and the authors of requests. Also tests how the execution of a contact path is evaluated: a reject
//! ends the cycle, and a review waits for a person. No reason is reported for an event that did not occur.

use super::fake::{Asks, Cell as Fake};
use super::serving::Script;
use super::*;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Hold, Phase, Refusal, Robot as Condition, State};
use panelprep_cell::record::{Answer, CycleId, EarlierPass, RequestRecord, RequestedAction, conclude};
use panelprep_toolpath::removal::examples::NO_WEAR_MODEL;

fn contact(state: &State) -> bool {
    matches!(state.intent, Some(intent) if intent.motion.path == Path::Contact && intent.done > 2)
}

/// The robot executes no waypoint in contact before the record contains its permission; waypoints are permitted in
/// blocks.
#[test]
fn no_waypoint_in_contact_comes_before_its_permission() {
    let story = Fake::new(Scene::Good).slow().run(Asks::one_cycle());
    assert_eq!((story.outcome.verdict, story.beyond), (Some(Verdict::Pass), 0), "{story}");
    let (path, permitted) = &story.contacts[0];
    let all = story.motions(Path::Contact)[0].0.waypoints;
    assert!(
        permitted.len() > 1 && permitted.is_sorted() && permitted.last() == Some(&all),
        "{permitted:?} of {all}"
    );
    assert!(permitted[0] < all, "the first block is not the whole path: {permitted:?} of {all}");
    // Every planned grid is reached by a waypoint of the path.
    let planned = story.findings.iter().find(|finding| finding.kind == Kind::Plan).expect("planned").names("grids");
    let reached: Vec<&String> = path.grids.iter().map(|reached| &reached.grid).collect();
    assert!(planned.iter().all(|grid| reached.contains(&grid)) && !planned.is_empty(), "{planned:?} {reached:?}");
    assert!(path.grids.iter().all(|reached| (1..=all).contains(&reached.first)), "{path:?}");
    assert_eq!((path.pass, story.clocks.len()), (1, 2));
}

/// After the connection is lost, the executed part of the path is not known: no sanding pass is recorded, and the wear
/// of the disc by the whole path remains recorded, even after a person has cleared the abort.
#[test]
fn a_link_that_is_lost_in_contact_leaves_an_unknown_end() {
    let cell = Fake::new(Scene::Good).slow().whose_link_is_lost_in_contact();
    let aborted = |state: &State| matches!(state.at, At::Aborted { .. }) && state.facts.robot == Condition::Ready;
    let mut script =
        Script::default().reset().start(&cell).when(aborted, RequestKind::Table(cycle::Request::Clear));
    script = script.leave_when(|state| state.at == At::Stopped && state.facts.standing);
    let record = cell.serve(|cameras| cameras, vec![], &mut script);
    assert_eq!(script.verdicts, [Verdict::Aborted]);
    let contact: Vec<_> = record.intents.iter().filter(|(motion, _)| motion.path == Path::Contact).collect();
    assert!(matches!(contact[..], [(_, Some((Outcome::Cleared, _)))]), "{contact:?}");
    let abrasions = record.findings.iter().filter(|finding| finding.kind == Kind::Abrade).count();
    assert_eq!(abrasions, 0, "what no person knows is not found");
    let whole_mm2 = record.contacts[0].0.wears_mm2;
    assert!(whole_mm2 > 1_000.0 && record.worn_mm2 == whole_mm2, "{} of {whole_mm2}", record.worn_mm2);
}

/// If the end of an abort in contact is reported, the executed part of the path is recorded.
#[test]
fn an_abort_in_contact_is_recorded_with_its_motion() {
    let story = Fake::new(Scene::Good).slow().run(Asks::one_cycle().with(contact, cycle::Request::Abort));
    let (motion, outcome, done) = story.motions(Path::Contact)[0];
    assert!(outcome == Outcome::Aborted && done > 2 && done < motion.waypoints, "{story}");
    let found = story.findings.iter().find(|finding| finding.kind == Kind::Abrade).expect("its end was told");
    assert_eq!(found.number(name::EXECUTED_WAYPOINTS_NAME), Some(f64::from(done)));
}

/// R21: if a feedback changes to off in contact, the path ends, and the executed part is recorded. The name of the
/// contradicting output is reported.
#[test]
fn a_feedback_that_goes_off_in_contact_holds() {
    for (bit, name) in [(2, "extraction_flow"), (3, "tool_running")] {
        let cell = Fake::new(Scene::Good).slow().whose_feedback_is_dead(bit, 4);
        let held = |state: &State| matches!(state.at, At::Held(_));
        let story = cell.run(Asks::one_cycle().with(held, cycle::Request::Stop));
        let (motion, outcome, done) = story.motions(Path::Contact)[0];
        assert!(outcome == Outcome::Held && done > 2 && done < motion.waypoints, "{name}: {story}");
        let told = story.findings.iter().find(|finding| finding.kind == Kind::Robot).expect("it is reported");
        let Reason { code, message, .. } = &told.judgement.reasons[0];
        assert!(code == "feedback" && message.contains(&format!("the feedback {name} reads off")), "{message}");
        let found = story.findings.iter().find(|finding| finding.kind == Kind::Abrade).expect("what was touched");
        assert_eq!(found.number(name::EXECUTED_WAYPOINTS_NAME), Some(f64::from(done)));
    }
}

/// The cable of a sensor is broken: the cycle is aborted because the feedback is missing at the deadline, and an
/// additional finding names the missing feedback.
#[test]
fn a_missing_feedback_is_named() {
    for (bit, name, asked) in
        [(4, "light_on", "the light is on"), (2, "extraction_flow", "the dust extraction is on")]
    {
        let story = Fake::new(Scene::Good).whose_feedback_is_dead(bit, 0).run(Asks::one_cycle());
        assert_eq!(story.outcome.verdict, Some(Verdict::Aborted), "{story}");
        let told = story.findings.iter().find(|finding| finding.kind == Kind::Robot).expect("it is reported");
        let Reason { code, message, .. } = &told.judgement.reasons[0];
        let names = message.contains(asked) && message.contains(&format!("the feedback {name} reads off"));
        assert!(code == "feedback" && names, "{message}");
    }
}

fn earlier(times: u8, is_sure: bool) -> Vec<EarlierPass> {
    (1..=times).map(|pass| EarlierPass { cycle: CycleId(7), pass, grid: None, is_sure, is_stated: false }).collect()
}

/// The limit is two sanding passes. A grid that an earlier cycle may have sanded is counted as sanded.
#[test]
fn possible_earlier_abrasions_are_counted() {
    let mut once = Fake::new(Scene::Good);
    once.earlier = earlier(1, false);
    let story = once.run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "one more is allowed: {story}");
    let plan = story.findings.iter().find(|finding| finding.kind == Kind::Plan).expect("planned");
    let counted = plan.names("sanded in earlier cycles, counted");
    assert!(counted.iter().all(|words| words.contains("perhaps sanded in cycle 7, pass 1")), "{counted:?}");
    assert_eq!(counted.len(), plan.names("grids").len());

    for is_sure in [false, true] {
        let mut twice = Fake::new(Scene::Good);
        twice.earlier = earlier(2, is_sure);
        let story = twice.run(Asks::one_cycle());
        assert_eq!(story.outcome.verdict, Some(Verdict::Reject), "{story}");
        assert!(story.motions(Path::Contact).is_empty(), "{story}");
        let reason = story.findings.last().expect("a finding").judgement.reasons[0].clone();
        let words = if is_sure { " sanded in cycle 7, pass 2" } else { "perhaps sanded in cycle 7, pass 2" };
        assert!(reason.code == "passes_used" && reason.message.contains(words), "{}", reason.message);
    }
}

/// A stop may be requested at any time. A stop that has no effect is refused each time, and is recorded once a second.
#[test]
fn a_repeatedly_refused_stop_is_recorded_once_a_second() {
    let rests = |state: &State| state.at == At::Stopped;
    let asks = (0..6).fold(Asks::nothing(), |asks, _| asks.with(rests, cycle::Request::Stop));
    let story = Fake::new(Scene::Clean).run(asks);
    assert_eq!(story.refusals.len(), 6, "each is answered");
    assert_eq!(story.asked.len(), 1, "{:?}", story.asked);
}

/// Continuous requests do not delay the robot and the deadlines: the cycle continues to its end.
#[test]
fn continuous_requests_do_not_delay_the_cycle() {
    let story = Fake::new(Scene::Clean).run(Asks::one_cycle().without_end(cycle::Request::Reset));
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    assert!(story.refusals.len() > 100, "{}", story.refusals.len());
}

/// Each request is recorded once with its reply; a refused request is recorded as refused.
#[test]
fn each_request_is_recorded_with_its_answer() {
    let works = |state: &State| matches!(state.at, At::Execute(_));
    let story = Fake::new(Scene::Clean).run(Asks::one_cycle().with(works, cycle::Request::Accept));
    assert_eq!(story.refusals, [(cycle::Request::Accept, Refusal::NotNow)]);
    let kept: Vec<(RequestedAction, Option<Answer>, usize)> = story
        .asked
        .iter()
        .map(|RequestRecord { wanted, answer, reasons, .. }| (wanted.clone(), *answer, reasons.len()))
        .collect();
    let wanted = |request, answer, reasons| (RequestedAction::For(request), Some(answer), reasons);
    let start = cycle::Request::Start { max_passes: 2, max_moves: 3, dries: false };
    assert_eq!(
        kept,
        [
            wanted(cycle::Request::Reset, Answer::Done, 0),
            wanted(start, Answer::Done, 0),
            wanted(cycle::Request::Accept, Answer::Refused, 1)
        ]
    );
    assert!(story.asked[2].reasons[0].message.contains("accept is not possible in state execute"));
}

fn codes(story: &fake::Story, kind: Kind) -> Vec<String> {
    let of_kind = story.findings.iter().filter(|finding| finding.kind == kind);
    of_kind.flat_map(|finding| &finding.judgement.reasons).map(|reason| reason.code.to_string()).collect()
}

fn held_for_review(state: &State) -> bool {
    matches!(state.at, At::Held(Hold { why: Why::Review, .. }))
}

/// The robot reports poses 3.5 mm beside the planned lines; the limit is 3 mm. The cycle is held until a person
/// accepts, and then continues with the rinse and the next film.
#[test]
fn a_path_beside_its_plan_is_held_and_continues_once_accepted() {
    let fake = || Fake::new(Scene::Good).step_by_step().that_is_off_plan(3.5, [20, 30]);
    let story = fake().run(Asks::one_cycle());
    let left = Phase::Assess { left: false };
    assert_eq!(story.outcome.state.at, At::Held(Hold { why: Why::Review, resume: left }), "{story}");
    assert_eq!(codes(&story, Kind::Abrade), ["off_path"], "{story}");
    assert_eq!(story.motions(Path::Retract).len(), 1, "it was held off the panel");

    let story = fake().run(Asks::one_cycle().with(held_for_review, cycle::Request::Accept));
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    assert_eq!(story.motions(Path::Contact).len(), 1, "nothing was abraded again");
    assert_eq!(story.stages().last(), Some(&Kind::Inspect), "{story}");
    // If no person accepts, the cycle can be stopped.
    let story = fake().run(Asks::one_cycle().with(held_for_review, cycle::Request::Stop));
    assert_eq!(story.outcome.verdict, Some(Verdict::Review), "{story}");
}

const REMOVAL: &str = "[path]\nfeed_mm_s = 120\n[removal]\nmethod = \"scheduled\"\ntarget_um = 30\nmax_um = 60\n\
                       force_n = 20\neven_percent = 100\n";

/// Because of its override, the robot moves much more slowly than planned, so the disc removes far more material than
/// the limit of the part. The next film would pass, but it is not captured: the part is rejected.
#[test]
fn a_path_that_removed_too_much_rejects_the_part() {
    let mut fake = Fake::new(Scene::Good).whose_contact_takes(700);
    (fake.more_recipe, fake.removal) = (REMOVAL, Some(NO_WEAR_MODEL));
    let story = fake.run(Asks::one_cycle());
    assert!(codes(&story, Kind::Abrade).contains(&"removal_too_deep".to_owned()), "{story}");
    assert_eq!(story.outcome.state.at, At::Complete { verdict: Verdict::Reject }, "{story}");
    assert_eq!(story.motions(Path::Retract).len(), 1, "off the panel first");
    assert_eq!(story.stages().last(), Some(&Kind::Abrade), "no film: {story}");
    let judgement = conclude(Verdict::Reject, &story.findings, &story.asked, &[]);
    assert_eq!(judgement.reasons[0].code, "removal_too_deep", "{judgement:?}");
}

/// A hold in contact remains a hold: the rest of the path is not a reason for a review. The hold itself switched the
/// tool off, so this is not a fault, even if the arm stops late.
#[test]
fn a_hold_in_contact_is_no_fault() {
    let in_contact =
        |state: &State| matches!(state.intent, Some(i) if i.motion.path == Path::Contact && i.done > 20);
    let is_held = |state: &State| matches!(state.at, At::Held(hold) if hold.why == Why::Asked);
    let fake = Fake::new(Scene::Good).slow().that_brakes_for(1_500);
    let unhold = cycle::Request::Unhold { dried: false };
    let story = fake.run(Asks::one_cycle().with(in_contact, cycle::Request::Hold).with(is_held, unhold));
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    assert_eq!(codes(&story, Kind::Robot), [""; 0], "{story}");
    assert_eq!(codes(&story, Kind::Abrade), ["part"], "{story}");
}

/// An air-run needs no disc, removes no material and touches nothing: conditions that forbid contact do not forbid an
/// air-run.
#[test]
fn an_air_run_is_judged_by_its_motion_alone() {
    let worn_out = || {
        let mut fake = Fake::new(Scene::Good);
        // There is no removal model, so the removal of the disc is not known; and the disc has swept ten times the area
        // of its life.
        (fake.more_recipe, fake.worn_mm2) = (REMOVAL, 1e9);
        fake
    };
    let story = worn_out().run(Asks::one_cycle());
    assert_ne!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    assert!(story.motions(Path::Contact).is_empty(), "{story}");

    let story = worn_out().run(Asks::one_air_run());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    let reasons: Vec<_> = story.findings.iter().flat_map(|finding| &finding.judgement.reasons).collect();
    assert!(reasons.is_empty() && !story.motions(Path::Air).is_empty(), "{story}");
    assert!(
        story.findings.iter().flat_map(|finding| &finding.checks).all(panelprep_cell::record::Check::is_met),
        "{story}"
    );
}

/// In contact, each measured pose is compared with the path. A deviation of 20 mm aborts the motion immediately, not
/// only at the end of the path.
#[test]
fn a_large_deviation_aborts_the_path_at_once() {
    let story = Fake::new(Scene::Good).step_by_step().that_is_off_plan(20.0, [20, 30]).run(Asks::one_cycle());
    let (motion, outcome, done) = story.motions(Path::Contact)[0];
    assert!(outcome == Outcome::Aborted && done < 30 && done < motion.waypoints, "{outcome:?} at {done}: {story}");
    assert_eq!(codes(&story, Kind::Robot)[0], "deviation", "{story}");
    assert_eq!(story.outcome.verdict, Some(Verdict::Aborted), "{story}");
}
