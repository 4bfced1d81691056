//! Tests the loop with a scripted cell: a robot that executes commands immediately, cameras that render pictures, and a
//! record in memory.

mod compliant;
mod contact;
mod fake;
mod paths;
mod recorded;
mod serving;
mod stages;

use super::*;
use fake::{Asks, Cell as Fake};
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle;
use panelprep_cell::cycle::{At, Outcome, Path, Why};
use panelprep_cell::record::{Budget, Kind, name};
use panelprep_sim::Scene;

pub(super) use fake::standing_state;

#[test]
fn a_greasy_panel_is_abraded_once_and_passes() {
    let story = Fake::new(Scene::Good).run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    assert!(matches!(story.outcome.state.at, At::Complete { verdict: Verdict::Pass }), "{story}");
    let stages = {
        use Kind::{Abrade, Inspect, Locate, Plan, Reach, Refine, Verify};
        [Locate, Refine, Refine, Reach, Inspect, Plan, Verify, Verify, Abrade, Inspect]
    };
    assert_eq!(story.stages(), stages, "{story}");
    assert!(!story.outcome.passes.is_empty() && story.outcome.passes.iter().all(|(_, times)| *times == 1));
    // Each waypoint is executed once: the first waypoint of the plan is the air point at which the approach ends.
    let contact = story.motions(Path::Contact);
    assert_eq!(contact.len(), 1);
    let (motion, outcome, done) = contact[0];
    assert_eq!((outcome, done), (Outcome::Done, motion.waypoints));
    assert_eq!(story.contact_points, done as usize);
    let error = story.truth.placement_error_mm(&story.outcome.base_from_panel.expect("found"));
    assert!(error.max_mm < 1.5, "{error:?}");
    // Checks the record: every limit is satisfied, every phase has its measured values, and the measured components of
    // the error budget are present.
    for number in story.findings.iter().flat_map(|finding| &finding.checks) {
        let broken = number.name.starts_with("broken film");
        assert!(broken || number.value.is_none_or(|value| number.limit.is_met_by(value)), "{number:?}");
    }
    check_recorded_limits(&story);
    let watched = story.findings.iter().filter_map(|finding| finding.number(name::WATCHED_TIME_NAME));
    assert!(watched.map(|seconds| seconds >= 38.0).eq([true, true]), "{story}");
    let corners = ["corner_before", "corner_after"];
    let figures = [&["located"], &corners[..], &corners[..], &CHECKS_AFTER_CONTACT[..]].concat();
    assert_eq!(story.figures, figures);
    let Budget { hand_eye_mm, locate_mm, fit_mm, robot_mm, .. } = story.budget;
    assert!(locate_mm.is_some_and(|mm| (0.01..1.0).contains(&mm)), "{:?}", story.budget);
    assert!(fit_mm.is_some_and(|mm| (0.01..0.5).contains(&mm)), "{:?}", story.budget);
    assert_eq!((hand_eye_mm, robot_mm), (None, None), "no person measured or stated them");
}

/// Checks that the record contains every value on which a check decides, with its limit, and each corner separately.
fn check_recorded_limits(story: &fake::Story) {
    let last = |kind: Kind| story.findings.iter().rfind(|finding| finding.kind == kind).expect("found");
    let unlimited = |kind: Kind| -> Vec<&str> {
        let numbers = last(kind).checks.iter();
        numbers
            .filter(|it| it.limit == panelprep_cell::record::Limit::Unlimited)
            .map(|it| it.name.as_str())
            .collect()
    };
    let reported = [
        "camera has moved the panel since teaching, by the fixture",
        "error of that, 95 %",
        "error along the weakest direction, 95 %",
        name::SCAN_TO_VERDICT,
    ];
    assert_eq!(unlimited(Kind::Locate), reported, "{story}");
    for (kind, number) in [
        (Kind::Refine, "corner 1 from where the scan puts it"),
        (Kind::Refine, "corner 2 off after the correction"),
        (Kind::Verify, "corner 1 from where the localization puts it"),
        (Kind::Verify, "corner 2 from where the localization puts it"),
        (Kind::Verify, name::CORNERS),
    ] {
        let found =
            last(kind).checks.iter().find(|it| it.name == number).unwrap_or_else(|| panic!("{number}: {story}"));
        assert!(found.value.is_some() && found.limit.value().is_some(), "{found:?}");
    }
    assert_eq!(last(Kind::Verify).number(name::CORNERS), Some(2.0), "{story}");
}

const CHECKS_AFTER_CONTACT: [&str; 14] = [
    "surface",
    "deviation",
    "film",
    "inspected",
    "break_times",
    "failed_grids",
    "planned",
    "verify",
    "verify",
    "executed",
    "overlap",
    "film",
    "inspected",
    "break_times",
];

#[test]
fn a_clean_panel_passes_without_contact() {
    let story = Fake::new(Scene::Clean).run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    assert!(story.motions(Path::Contact).is_empty() && story.motions(Path::Approach).is_empty());
}

#[test]
fn no_panel_ends_in_reject_without_a_move_to_it() {
    let story = Fake::new(Scene::NoPanel).run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Reject), "{story}");
    assert!(story.intents.iter().all(|(motion, ..)| motion.path == Path::Park), "{story}");
}

/// The cell's box ends in front of the panel: the whole motion to the corner is refused, and the cycle is aborted.
#[test]
fn a_refused_path_aborts_and_sends_nothing() {
    let story = Fake::new(Scene::Good).with_box_to(300.0).run(Asks::one_cycle());
    assert!(matches!(story.outcome.state.at, At::Aborted { .. }), "{story}");
    assert_eq!(story.outcome.verdict, Some(Verdict::Aborted));
    assert_eq!(story.lines, 0, "no line was sent");
    assert!(
        story.findings.iter().any(|finding| finding.judgement.reasons[..].iter().any(|r| r.code == "outside_box"))
    );
}

#[test]
fn after_a_hold_in_contact_come_verify_and_a_new_plan() {
    let held = |state: &panelprep_cell::cycle::State| matches!(state.intent, Some(i) if i.motion.path == Path::Contact && i.done > 20);
    let story = Fake::new(Scene::Good).slow().run(Asks::one_cycle().with(held, cycle::Request::Hold).with(
        |state| matches!(state.at, At::Held(hold) if hold.why == Why::Asked),
        cycle::Request::Unhold { dried: false },
    ));
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    let contact = story.motions(Path::Contact);
    assert_eq!(contact.len(), 2, "{story}");
    assert_eq!(contact[0].1, Outcome::Held);
    assert!(contact[0].2 > 20 && contact[0].2 < contact[0].0.waypoints, "{story}");
    assert!(contact[1].0.waypoints < contact[0].0.waypoints, "what is done is not planned again");
    assert_eq!(contact[1].1, Outcome::Done);
}

/// With the recipe's reference `wet`, the second film evaluates the sanded areas by their wet appearance only. With
/// `dry`, a person dries the panel after the rinse, and the whole panel has a dry reference again.
#[test]
fn a_new_dry_picture_is_the_reference_of_sanded_areas() {
    let wet = Fake::new(Scene::Good).run(Asks::one_cycle());
    let alone = |story: &fake::Story| -> Vec<bool> {
        let films = story.findings.iter().filter(|finding| finding.kind == Kind::Inspect);
        films.map(|film| film.details.keys().any(|key| key.contains("wet look alone"))).collect()
    };
    assert_eq!((wet.outcome.verdict, alone(&wet)), (Some(Verdict::Pass), vec![false, true]), "{wet}");

    let mut fake = Fake::new(Scene::Good);
    fake.more_recipe = "reference = \"dry\"\n";
    let dries = fake.dries();
    let is_held =
        move |state: &cycle::State| matches!(state.at, At::Held(hold) if hold.why == Why::Drying) && dries();
    let start = cycle::Request::Start { max_passes: 2, max_moves: 3, dries: true };
    let asks = Asks::one_cycle_by(start).with(is_held, cycle::Request::Unhold { dried: true });
    let dry = fake.run(asks);
    assert_eq!((dry.outcome.verdict, alone(&dry)), (Some(Verdict::Pass), vec![false, false]), "{dry}");
    let located = dry.findings.iter().filter(|finding| finding.kind == Kind::Locate);
    assert_eq!(located.count(), 2, "{dry}");
}

#[test]
fn a_journal_that_cannot_be_written_stops_the_robot() {
    let error = Fake::new(Scene::Clean).with_record_that_fails_at(30).fails(Asks::one_cycle());
    assert!(matches!(error, DaemonError::Record(_)), "{error}");
}

/// Expected values, calculated by hand: the panel is rotated by 0.2° about its first corner. This corner does not move;
/// a corner 250 mm away moves by 0.9 mm. If only the first corner were checked, the pad would be lowered onto the panel
/// at the wrong place.
#[test]
fn a_rotated_panel_is_detected_at_its_second_corner() {
    let story = Fake::new(Scene::Good).whose_panel_turns_when_wet(0.2).run(Asks::one_cycle());
    assert!(matches!(story.outcome.state.at, At::Held(hold) if hold.why == Why::NotVerified), "{story}");
    let verified: Vec<Verdict> = story
        .findings
        .iter()
        .filter(|finding| finding.kind == Kind::Verify)
        .map(|finding| finding.judgement.verdict)
        .collect();
    assert_eq!(verified, [Verdict::Accept, Verdict::Review], "{story}");
    assert!(story.motions(Path::Contact).is_empty() && story.motions(Path::Approach).is_empty(), "{story}");
}

/// An obstacle is in front of the second corner. The first corner is viewed again instead, and the correction uses only
/// this corner.
#[test]
fn a_corner_without_a_permitted_move_is_excluded() {
    let mut fake = Fake::new(Scene::Clean);
    fake.more_cell = "[[keep_out]]\nname = \"post\"\nmin_mm = [300, -220, 150]\nmax_mm = [360, -120, 300]\n";
    let story = fake.run(Asks::one_cycle());
    let refined = story.findings.iter().filter(|finding| finding.kind == Kind::Refine);
    let seen: Vec<Option<f64>> = refined.map(|finding| finding.number("corners seen")).collect();
    assert!(seen.len() == 2 && seen.iter().all(|count| *count == Some(1.0)), "{seen:?} {story}");
    let last = story.findings.iter().rfind(|finding| finding.kind == Kind::Refine).expect("refined");
    let why = last.details["corners_left_out"].to_string();
    assert!(why.contains("corner 2: ") && why.contains("post"), "{why}");
}

/// The planned path of the disc extends beyond the panel by more than the recipe allows. The cycle waits for a person's
/// review, which does not come in this test.
#[test]
fn a_doubtful_plan_is_held_for_review_without_contact() {
    let mut fake = Fake::new(Scene::Good);
    fake.more_recipe = "[path]\nedge_overhang_mm = 0\ndisc_diameter_mm = 60\n";
    let story = fake.run(Asks::one_cycle());
    let held = |at| matches!(at, At::Held(hold) if hold.why == Why::Review);
    assert!(held(story.outcome.state.at), "{story}");
    let plan = story.findings.iter().rfind(|finding| finding.kind == Kind::Plan).expect("planned");
    assert_eq!(plan.judgement.verdict, Verdict::Review, "{story}");
    assert!(story.motions(Path::Contact).is_empty() && story.motions(Path::Approach).is_empty(), "{story}");
}

/// For every motion, an intent was recorded before the motion began, in the open epoch.
#[test]
fn intents_are_recorded_before_their_motions() {
    let story = Fake::new(Scene::Clean).run(Asks::one_cycle());
    assert!(story.intents.len() >= 3 && story.moved_without_intent == 0, "{story}");
}
