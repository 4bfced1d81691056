//! Scenarios of a cycle without faults, from the first picture of the panel to the verdict, and of an operator who
//! holds, stops, aborts and clears, and then resumes.

use super::super::*;
use super::healthy::{REQUESTS, Story};
use panelprep_base::verdict::Verdict;

#[test]
fn a_dirty_panel_is_abraded_once_and_passes() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    assert_eq!(story.run_until("locate"), "to-park lensclear locate");
    assert_eq!(story.run_until("corner-0"), "frames-camera to-corner-0 corner-0");
    story.answer(Answer::LookOn);
    assert_eq!(story.run_until("corner-1"), "to-corner-1 corner-1");
    assert_eq!(story.run_until("drypicture"), "to-park lighton drypicture");
    assert_eq!(story.run_until("film"), "lensguard spray wateroff lensclear film");
    assert_eq!(story.run_until("verify"), "plan-1 lightoff to-corner-0 verify");
    assert_eq!(story.run_until("to-contact"), "extractionon frames-pad to-approach toolon to-contact");
    assert_eq!(story.run_until("rinse"), "tooloff to-retract assess to-park lensguard rinse");
    assert_eq!(
        story.run_until("film"),
        "wateroff spray wateroff lighton lensclear film",
        "the rinse's water is no spray"
    );
    assert_eq!(story.run_until_rest(), "extractionoff lightoff");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    assert_eq!(story.cell.state.job.pass, 1);
}

/// Corner pictures of both corners are captured before each contact. If every picture only shows that another one is
/// needed, the pose is not verified.
#[test]
fn both_corners_are_verified_before_contact() {
    let mut story = Story::started(&[Film::Broken, Film::Broken, Film::Whole]);
    for _ in 0..2 {
        story.run_until("verify");
        story.answer(Answer::LookOn);
        let acts = story.run_until("to-contact");
        assert!(
            acts.starts_with("to-corner-1 verify-1 ") && acts.ends_with("to-approach toolon to-contact"),
            "{acts}"
        );
    }
    story.run_until("film");
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });

    let mut story = Story::started(&[Film::Broken]);
    for corner in ["verify", "verify-1", "verify-2", "verify-3"] {
        story.run_until(corner);
        story.answer(Answer::LookOn);
    }
    story.run_until_rest();
    assert!(matches!(story.at(), At::Held(Hold { why: Why::NotVerified, .. })), "{:?}", story.at());
    story.asked(Request::Unhold { dried: false });
    story.run_until("verify");
}

#[test]
fn a_clean_panel_passes_without_contact() {
    let mut story = Story::started(&[Film::Whole]);
    let acts = story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    assert!(!acts.contains("toolon") && !acts.contains("to-approach") && !acts.contains("plan"), "{acts}");
}

/// An air-run moves along the path of a cycle without water, tool and contact.
#[test]
fn an_air_run_follows_the_path_in_the_air_and_passes() {
    let mut story = Story::idle(&[]);
    story.asked(Request::AirRun { max_moves: 3 });
    assert_eq!(story.run_until("corner-0"), "to-park lensclear locate frames-camera to-corner-0 corner-0");
    assert_eq!(story.run_until("to-air"), "plan-0 verify frames-pad to-approach to-air");
    assert_eq!(story.run_until_rest(), "to-retract to-park");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

#[test]
fn no_panel_is_a_reject_without_a_move_toward_it() {
    let mut story = Story::started(&[]);
    story.run_until("locate");
    story.answer(Answer::Graded(Grade::Reject));
    assert_eq!(story.run_until_rest(), "");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject });
}

#[test]
fn breaks_after_the_last_pass_fail_and_a_film_that_shows_nothing_is_invalid() {
    let mut story = Story::started(&[Film::Broken, Film::Broken, Film::Broken]);
    story.run_until_rest();
    assert_eq!((story.at(), story.cell.state.job.pass), (At::Complete { verdict: Verdict::Fail }, 2));
    let mut story = Story::started(&[Film::Broken, Film::Invalid]);
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Invalid });
}

#[test]
fn the_corner_loop_ends_in_reject_when_the_corner_is_not_reached() {
    let mut story = Story::started(&[]);
    for corner in ["corner-0", "corner-1", "corner-2", "corner-3"] {
        story.run_until(corner);
        story.answer(Answer::LookOn);
    }
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject });
}

#[test]
fn a_doubtful_localization_waits_for_a_person() {
    let mut story = Story::started(&[Film::Whole]);
    story.run_until("locate");
    story.answer(Answer::Graded(Grade::Review));
    assert_eq!(story.run_until_rest(), "end-epoch");
    assert!(matches!(story.at(), At::Held(Hold { why: Why::Review, .. })), "{:?}", story.at());
    story.asked(Request::Unhold { dried: false });
    let refusal = Effect::Refuse { request: Request::Unhold { dried: false }, refusal: Refusal::Review };
    assert_eq!(story.cell.effects, [refusal]);
    story.asked(Request::Accept);
    assert_eq!(story.run_until("corner-0"), "epoch frames-camera to-corner-0 corner-0");
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    // If a stop is requested instead of an accept, the verdict is review.
    let mut story = Story::started(&[]);
    story.run_until("locate");
    story.answer(Answer::Graded(Grade::Review));
    story.run_until_rest();
    story.asked(Request::Stop);
    assert!(story.cell.effects.contains(&Effect::Conclude { verdict: Verdict::Review }));
}

#[test]
fn a_doubtful_path_waits_for_a_person_and_is_verified_before_contact() {
    let doubtful = Answer::PlannedForReview { plan: 7, waypoints: 3 };
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.run_until("plan-1");
    story.answer(doubtful);
    assert_eq!(story.run_until_rest(), "end-epoch");
    assert_eq!(story.at(), At::Held(Hold { why: Why::Review, resume: Phase::Verify }));
    story.asked(Request::Accept);
    let acts = story.run_until("to-contact");
    assert!(acts.contains("verify") && !acts.contains("plan"), "the accepted path itself, verified: {acts}");
    assert_eq!((story.cell.state.job.plan, story.cell.state.job.waypoints), (7, 3));
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    // If the panel is dried instead of accepting the result, the panel is located and the path is planned again.
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.run_until("plan-1");
    story.answer(doubtful);
    story.run_until_rest();
    story.asked(Request::Unhold { dried: true });
    let acts = story.run_until("to-contact");
    assert!(acts.contains("locate") && acts.contains("plan-1") && acts.contains("verify"), "{acts}");
}

/// The result of the contact path is graded after the retract, with the tool off. A reject ends the cycle there,
/// without water and film.
#[test]
fn a_contact_that_is_rejected_ends_the_cycle() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    assert!(story.run_until("assess").ends_with("tooloff to-retract assess"));
    story.answer(Answer::Graded(Grade::Reject));
    assert_eq!(story.run_until_rest(), "to-park extractionoff");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject });
    assert_eq!(story.films, [Film::Whole], "no film after it");
}

/// If the recipe requires a new dry picture, a person dries the panel after the rinse. The cycle resumes only after the
/// person's confirmation: the panel is located, the dry picture is captured, and the film follows.
#[test]
fn a_new_dry_picture_waits_for_a_dried_panel() {
    let start = Request::Start { max_passes: 2, max_moves: 3, dries: true };
    let mut story = Story::started_by(start, &[Film::Broken, Film::Whole]);
    story.run_until("rinse");
    story.run_until_rest();
    let held = At::Held(Hold { why: Why::Drying, resume: Phase::Wet });
    assert_eq!(story.at(), held);
    story.asked(Request::Unhold { dried: false });
    let refusal = Effect::Refuse { request: Request::Unhold { dried: false }, refusal: Refusal::Undried };
    assert_eq!((story.at(), &story.cell.effects[..]), (held, &[refusal][..]));
    story.asked(Request::Unhold { dried: true });
    let acts = story.run_until("film");
    let order = ["locate", "corner-0", "dry", "spray", "film"].map(|act| acts.find(act));
    assert!(order.iter().all(Option::is_some) && order.is_sorted(), "{acts}");
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// Only a person can accept the result of a contact path: drying the panel and locating it again does not replace this
/// decision.
#[test]
fn a_doubtful_contact_waits_for_a_person() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.run_until("assess");
    story.answer(Answer::Graded(Grade::Review));
    assert_eq!(story.run_until_rest(), "end-epoch");
    let held = At::Held(Hold { why: Why::Review, resume: Phase::Assess { left: false } });
    assert_eq!(story.at(), held);
    for dried in [false, true] {
        story.asked(Request::Unhold { dried });
        let refusal = Effect::Refuse { request: Request::Unhold { dried }, refusal: Refusal::Review };
        assert_eq!((story.at(), &story.cell.effects[..]), (held, &[refusal][..]));
    }
    story.asked(Request::Accept);
    let acts = story.run_until_rest();
    assert!(acts.contains("rinse") && !acts.contains("plan") && !acts.contains("assess"), "{acts}");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    // If a stop is requested instead of an accept, the verdict is review.
    let mut story = Story::started(&[Film::Broken]);
    story.run_until("assess");
    story.answer(Answer::Graded(Grade::Review));
    story.run_until_rest();
    story.asked(Request::Stop);
    assert!(story.cell.effects.contains(&Effect::Conclude { verdict: Verdict::Review }));
}

/// A journal of JSON lines that is read back leads to the same state.
#[test]
fn a_journal_folds_to_the_state_that_wrote_it() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.run_until_rest();
    let lines: Vec<String> =
        story.cell.journal.iter().map(|event| serde_json::to_string(event).expect("a line")).collect();
    assert!(lines.iter().all(|line| !line.contains('\n') && line.len() < 120), "{lines:#?}");
    assert_eq!(lines[3], r#"{"told":{"answered":{"id":1,"answer":{"stands":{"done":0}}}}}"#);
    let read = lines.iter().map(|line| serde_json::from_str(line).expect("an event"));
    assert_eq!(fold_journal(read), story.cell.state);
    let kept = serde_json::to_string(&story.cell.state).expect("a state");
    assert_eq!(serde_json::from_str::<State>(&kept).expect("a state"), story.cell.state);
}

#[test]
fn a_held_air_run_is_planned_again() {
    let mut story = Story::idle(&[]);
    story.asked(Request::AirRun { max_moves: 3 });
    story.run_until("to-air");
    story.asked(Request::Hold);
    assert_eq!(story.run_until_rest(), "end-epoch");
    story.asked(Request::Unhold { dried: false });
    let acts = story.run_until_rest();
    assert!(acts.contains("verify") && acts.contains("plan-0") && acts.contains("to-air"), "{acts}");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// A held cycle may be stopped while its guard is open: no command is sent to a robot that is not ready.
#[test]
fn a_stop_of_a_held_cell_with_an_open_guard_is_immediate() {
    let mut story = Story::started(&[Film::Broken]);
    story.run_until("film");
    story.asked(Request::Hold);
    story.run_until_rest();
    story.report(Report::Robot(Robot::GuardOpen));
    story.asked(Request::Stop);
    assert_eq!((story.at(), story.acts.len()), (At::Stopped, 0));
}

/// Reported waypoints stay recorded, even if a later answer contains a smaller count.
#[test]
fn reported_waypoints_are_kept_at_the_end_of_the_epoch() {
    let mut story = Story::in_contact();
    story.asked(Request::Abort);
    let motion = story.cell.state.intent.expect("it is not answered").motion;
    story.answer(Answer::Standstill { done: 0 });
    let closed = Effect::CloseIntent { motion, outcome: Outcome::Aborted, done: 2 };
    assert_eq!(story.cell.effects, [closed, Effect::Conclude { verdict: Verdict::Aborted }]);
}

/// If the robot refuses a command because the emergency stop was pressed, the emergency stop is the cause of the abort.
/// The same is true for an open guard and for drives that are off. An abort that a person requested keeps its cause,
/// unless the emergency stop is pressed.
#[test]
fn an_emergency_stop_outranks_its_consequences() {
    use Robot::{DrivesOff, EmergencyStop, GuardOpen, LinkLost};
    let refused = Report::EpochOver { trouble: Some(Trouble::Refused) };
    let after = |first: Event, robots: &[Robot]| {
        let mut story = Story::in_contact();
        story.event(first);
        robots.iter().for_each(|robot| story.report(Report::Robot(*robot)));
        story.run_until_rest();
        let At::Aborted { cause } = story.at() else { panic!("{:?}", story.at()) };
        cause
    };
    for robot in [EmergencyStop, GuardOpen, DrivesOff, LinkLost] {
        assert_eq!(after(Event::Reported(refused), &[robot]), Cause::Robot(robot), "{robot:?}");
    }
    let abort = Event::Asked(Request::Abort);
    for (robots, cause) in [
        (&[][..], Cause::Asked),
        (&[DrivesOff][..], Cause::Asked),
        (&[EmergencyStop][..], Cause::Robot(EmergencyStop)),
    ] {
        assert_eq!(after(abort, robots), cause, "{robots:?}");
    }
    let stopped_first = after(Event::Reported(Report::Robot(EmergencyStop)), &[DrivesOff]);
    assert_eq!(stopped_first, Cause::Robot(EmergencyStop));
    let first = after(Event::Reported(refused), &[DrivesOff, EmergencyStop, GuardOpen]);
    assert_eq!(first, Cause::Robot(EmergencyStop));
}

/// The end of the epoch switches the tool off before the robot reports standstill. Until then no state of an output is
/// confirmed, so that no feedback can contradict it.
#[test]
fn an_ended_epoch_leaves_no_proven_output() {
    for (request, station) in
        [(Request::Hold, "to-contact"), (Request::Stop, "to-contact"), (Request::Hold, "drypicture")]
    {
        let mut story = Story::started(&[Film::Broken]);
        story.run_until(station);
        story.asked(request);
        assert_eq!(story.acts.last().map(String::as_str), Some("end-epoch"), "{request:?} {station}");
        let is_on = [Switch::ToolOn, Switch::ExtractionOn, Switch::LightOn];
        let believed: Vec<Switch> =
            story.cell.state.facts.proven_switches().filter(|switch| is_on.contains(switch)).collect();
        assert_eq!(believed, [], "{request:?} {station}");
    }
}

#[test]
fn a_hold_in_contact_retracts_and_unhold_verifies_and_plans_the_rest_again() {
    let mut story = Story::in_contact();
    story.asked(Request::Hold);
    assert_eq!(story.acts.join(" "), "end-epoch", "at once, and nothing else");
    let motion = story.cell.state.intent.expect("the robot has not said that it stands").motion;
    assert!(!story.at().is_at_rest());
    story.acts.clear();
    story.answer(Answer::Standstill { done: 2 });
    let closed = Effect::CloseIntent { motion, outcome: Outcome::Held, done: 2 };
    assert_eq!(story.cell.effects, [closed]);
    let left = Phase::Assess { left: true };
    assert_eq!(story.at(), At::Held(Hold { why: Why::Asked, resume: left }), "the hold stays one");
    // A late answer of the ended path is dropped.
    let (id, _) = story.cell.stale[story.cell.stale.len() - 2];
    let before = story.cell.state;
    story.report(Report::Answered { id, answer: Answer::Standstill { done: 3 } });
    assert_eq!(story.cell.state, State { dropped: before.dropped + 1, ..before });

    story.asked(Request::Unhold { dried: false });
    assert_eq!(story.run_until("verify"), "epoch frames-camera to-corner-0 verify");
    assert_eq!(story.run_until("plan-1"), "assess plan-1", "what was done is graded before more is done");
    // The controller may have switched the extraction off during the hold.
    assert_eq!(story.run_until("to-contact"), "verify extractionon frames-pad to-approach toolon to-contact");
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// If the executed part of an interrupted path is rejected, the cycle ends at the next step, without further sanding.
#[test]
fn a_path_that_was_cut_short_and_is_rejected_is_not_planned_again() {
    for dried in [false, true] {
        let mut story = Story::in_contact();
        story.asked(Request::Hold);
        story.run_until_rest();
        story.asked(Request::Unhold { dried });
        story.run_until("assess");
        story.answer(Answer::Graded(Grade::Reject));
        let acts = story.run_until_rest();
        assert!(!acts.contains("plan") && !acts.contains("toolon"), "{acts}");
        assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject }, "dried {dried}");
    }
}

/// After a hold during the retract, or during the assessment, the result is still graded.
#[test]
fn a_hold_after_contact_does_not_lose_the_grade() {
    for station in ["to-retract", "assess"] {
        let mut story = Story::started(&[Film::Broken, Film::Whole]);
        story.run_until(station);
        story.asked(Request::Hold);
        story.run_until_rest();
        let left = Phase::Assess { left: false };
        assert_eq!(story.at(), At::Held(Hold { why: Why::Asked, resume: left }), "{station}");
        story.asked(Request::Unhold { dried: false });
        let acts = story.run_until("rinse");
        assert!(acts.contains("assess") && !acts.contains("plan"), "{acts}");
        story.run_until_rest();
        assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass }, "{station}");
    }
}

#[test]
fn if_verify_fails_the_panel_is_dried_and_located_again() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.run_until("verify");
    story.answer(Answer::Graded(Grade::Reject));
    story.run_until_rest();
    assert_eq!(story.at(), At::Held(Hold { why: Why::NotVerified, resume: Phase::Plan }));
    // A person opens the guard to dry the panel.
    story.report(Report::Robot(Robot::GuardOpen));
    story.asked(Request::Unhold { dried: true });
    let refusal = Refusal::Robot(Robot::GuardOpen);
    assert_eq!(story.cell.effects, [Effect::Refuse { request: Request::Unhold { dried: true }, refusal }]);
    story.report(Report::Robot(Robot::Ready));
    story.asked(Request::Unhold { dried: true });
    let acts = story.run_until("to-contact");
    let order = ["locate", "corner-0", "drypicture", "plan-1", "verify", "to-contact"];
    let found = order.map(|act| acts.split(' ').position(|done| done == act));
    assert!(found.is_sorted() && found[0].is_some(), "{acts}");
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// There is no result to accept in this hold, even if the robot is ready.
#[test]
fn accept_is_refused_if_no_result_waits() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.run_until("verify");
    story.answer(Answer::Graded(Grade::Reject));
    story.run_until_rest();
    for robot in [Robot::Ready, Robot::GuardOpen] {
        story.report(Report::Robot(robot));
        story.asked(Request::Accept);
        let refused = [Effect::Refuse { request: Request::Accept, refusal: Refusal::NotNow }];
        assert_eq!(story.cell.effects, refused, "{robot:?}");
    }
}

#[test]
fn a_stop_ends_in_stopped_or_by_its_deadline_in_aborted() {
    let mut story = Story::in_contact();
    story.asked(Request::Stop);
    assert_eq!(story.run_until_rest(), "end-epoch");
    assert_eq!(story.at(), At::Stopped);
    let mut story = Story::in_contact();
    story.asked(Request::Stop);
    let At::Stopping { until } = story.at() else { panic!("{:?}", story.at()) };
    story.report(Report::Deadline { id: until, which: Deadline::Stop });
    assert_eq!(story.run_until_rest(), "end-epoch end-epoch");
    assert_eq!(story.at(), At::Aborted { cause: Cause::StopTimedOut });
}

#[test]
fn from_aborted_only_clear_leads_out() {
    let mut story = Story::in_contact();
    story.asked(Request::Abort);
    assert_eq!(story.run_until_rest(), "end-epoch");
    assert_eq!(story.at(), At::Aborted { cause: Cause::Asked });
    for request in REQUESTS.into_iter().filter(|request| *request != Request::Clear) {
        story.asked(request);
        assert!(matches!(story.cell.effects[..], [Effect::Refuse { .. }]), "{request:?}");
    }
    story.asked(Request::Clear);
    assert_eq!(story.run_until_rest(), "checkstandstill");
    assert_eq!(story.at(), At::Stopped);
    // An abort during the spray: the abort frame switches the water off without waiting.
    let mut story = Story::started(&[]);
    story.run_until("spray");
    story.asked(Request::Abort);
    assert!(story.cell.state.facts.water_may_run);
    assert_eq!(story.run_until_rest(), "end-epoch");
    assert!(!story.cell.state.facts.water_may_run && story.cell.state.facts.water_off());
}
