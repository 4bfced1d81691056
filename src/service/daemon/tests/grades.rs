//! Tests of how the execution of a contact path is judged: a reject ends the cycle, a review waits for a person. No
//! reason is reported for something that did not happen.

use super::fake::{Asks, Cell as Fake};
use super::*;
use panelprep_cell::cycle::{Hold, Phase, State};
use panelprep_cell::record::conclude;
use panelprep_toolpath::removal::examples::EVEN_MODEL;

fn codes(story: &fake::Story, kind: Kind) -> Vec<String> {
    let of_kind = story.findings.iter().filter(|finding| finding.kind == kind);
    of_kind.flat_map(|finding| &finding.judgement.reasons).map(|reason| reason.code.to_string()).collect()
}

fn held_for_review(state: &State) -> bool {
    matches!(state.at, At::Held(Hold { why: Why::Review, .. }))
}

/// The robot reports poses 3.5 mm beside the planned lines; the limit is 3 mm. The cycle is held, and nothing more
/// happens until a person accepts. Then the cycle continues with the rinse and the next film, as usual.
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

/// The robot moves much slower than planned (its override), so that the disc removes far more than the part may
/// lose. The next film would pass, but it is never watched: the part is rejected.
#[test]
fn a_path_that_removed_too_much_rejects_the_part() {
    let mut fake = Fake::new(Scene::Good).whose_contact_takes(700);
    (fake.more_recipe, fake.removal) = (REMOVAL, Some(EVEN_MODEL));
    let story = fake.run(Asks::one_cycle());
    assert!(codes(&story, Kind::Abrade).contains(&"removal_too_deep".to_owned()), "{story}");
    assert_eq!(story.outcome.state.at, At::Complete { verdict: Verdict::Reject }, "{story}");
    assert_eq!(story.motions(Path::Retract).len(), 1, "off the panel first");
    assert_eq!(story.stages().last(), Some(&Kind::Abrade), "no film: {story}");
    let judgement = conclude(Verdict::Reject, &story.findings, &story.asked, &[]);
    assert_eq!(judgement.reasons[0].code, "removal_too_deep", "{judgement:?}");
}

/// A hold in contact remains a hold. The rest of the path is not a reason for a review. The hold itself switched the
/// tool off, so this is not a fault, however long the arm needs to come to rest.
#[test]
fn a_hold_in_contact_finds_nothing_wrong() {
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

/// An air-run needs no disc, removes nothing and presses on nothing: conditions that forbid contact do not forbid an
/// air-run.
#[test]
fn an_air_run_is_judged_by_its_motion_alone() {
    let worn_out = || {
        let mut fake = Fake::new(Scene::Good);
        // No model: the removal by the disc is not known. And the disc has done ten times its life.
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

/// In contact, each measured pose is compared with the path. With a deviation of 20 mm the motion is aborted at
/// once; the deviation is not only graded when the path has ended.
#[test]
fn an_arm_far_off_its_path_leaves_it_at_once() {
    let story = Fake::new(Scene::Good).step_by_step().that_is_off_plan(20.0, [20, 30]).run(Asks::one_cycle());
    let (motion, outcome, done) = story.motions(Path::Contact)[0];
    assert!(outcome == Outcome::Aborted && done < 30 && done < motion.waypoints, "{outcome:?} at {done}: {story}");
    assert_eq!(codes(&story, Kind::Robot)[0], "deviation", "{story}");
    assert_eq!(story.outcome.verdict, Some(Verdict::Aborted), "{story}");
}
