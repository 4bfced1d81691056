//! Scenarios of a person who holds, stops, aborts and clears, and of how the cell continues after that.

use super::super::*;
use super::healthy::REQUESTS;
use super::script::Story;
use panelprep_base::verdict::Verdict;

#[test]
fn a_held_air_run_is_planned_again() {
    let mut story = Story::idle(&[]);
    story.asked(Request::AirRun { max_moves: 3 });
    story.until("to-air");
    story.asked(Request::Hold);
    assert_eq!(story.rests(), "end-epoch");
    story.asked(Request::Unhold { dried: false });
    let acts = story.rests();
    assert!(acts.contains("verify") && acts.contains("plan-0") && acts.contains("to-air"), "{acts}");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// A person who opened the guard of a held cell may stop it: nothing is requested from a robot that is not ready.
#[test]
fn a_stop_of_a_held_cell_with_an_open_guard_is_at_once() {
    let mut story = Story::started(&[Film::Broken]);
    story.until("film");
    story.asked(Request::Hold);
    story.rests();
    story.report(Report::Robot(Robot::GuardOpen));
    story.asked(Request::Stop);
    assert_eq!((story.at(), story.acts.len()), (At::Stopped, 0));
}

/// Reported waypoints were executed and are recorded, even if a later answer does not contain them.
#[test]
fn waypoints_that_were_reported_are_not_forgotten_at_the_end_of_the_epoch() {
    let mut story = Story::in_contact();
    story.asked(Request::Abort);
    let motion = story.cell.state.intent.expect("it is not answered").motion;
    story.answer(Answer::Standstill { done: 0 });
    let closed = Effect::CloseIntent { motion, outcome: Outcome::Aborted, done: 2 };
    assert_eq!(story.cell.effects, [closed, Effect::Conclude { verdict: Verdict::Aborted }]);
}

/// The robot refuses a command because a person pressed the emergency stop: that is why the cycle was aborted. The
/// same applies to a guard that opens and to drives that go off. An abort that a person requested stays one, unless
/// the emergency stop is pressed.
#[test]
fn an_emergency_stop_outranks_what_it_brought_about() {
    use Robot::{DrivesOff, EmergencyStop, GuardOpen, LinkLost};
    let refused = Report::EpochOver { trouble: Some(Trouble::Refused) };
    let after = |first: Event, robots: &[Robot]| {
        let mut story = Story::in_contact();
        story.event(first);
        robots.iter().for_each(|robot| story.report(Report::Robot(*robot)));
        story.rests();
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

/// The end of the epoch switches the tool off before the robot reports standstill: until then no output counts as
/// proven that a feedback could contradict.
#[test]
fn an_epoch_that_is_ended_leaves_no_output_to_contradict() {
    for (request, station) in
        [(Request::Hold, "to-contact"), (Request::Stop, "to-contact"), (Request::Hold, "drypicture")]
    {
        let mut story = Story::started(&[Film::Broken]);
        story.until(station);
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
    assert_eq!(story.until("verify"), "epoch frames-camera to-corner-0 verify");
    assert_eq!(story.until("plan-1"), "assess plan-1", "what was done is graded before more is done");
    // The controller may have switched the extraction off in the meantime.
    assert_eq!(story.until("to-contact"), "verify extractionon frames-pad to-approach toolon to-contact");
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// If the executed part of a path is rejected, the cycle ends at the next step, and nothing more is abraded.
#[test]
fn a_path_that_was_cut_short_and_is_rejected_is_not_planned_again() {
    for dried in [false, true] {
        let mut story = Story::in_contact();
        story.asked(Request::Hold);
        story.rests();
        story.asked(Request::Unhold { dried });
        story.until("assess");
        story.answer(Answer::Graded(Grade::Reject));
        let acts = story.rests();
        assert!(!acts.contains("plan") && !acts.contains("toolon"), "{acts}");
        assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject }, "dried {dried}");
    }
}

/// A hold during the retract from the panel, and a hold during the grading: the grade is still requested.
#[test]
fn a_hold_after_contact_does_not_lose_the_grade() {
    for station in ["to-retract", "assess"] {
        let mut story = Story::started(&[Film::Broken, Film::Whole]);
        story.until(station);
        story.asked(Request::Hold);
        story.rests();
        let left = Phase::Assess { left: false };
        assert_eq!(story.at(), At::Held(Hold { why: Why::Asked, resume: left }), "{station}");
        story.asked(Request::Unhold { dried: false });
        let acts = story.until("rinse");
        assert!(acts.contains("assess") && !acts.contains("plan"), "{acts}");
        story.rests();
        assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass }, "{station}");
    }
}

#[test]
fn where_verify_fails_the_panel_is_dried_and_located_again() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.until("verify");
    story.answer(Answer::Graded(Grade::Reject));
    story.rests();
    assert_eq!(story.at(), At::Held(Hold { why: Why::NotVerified, resume: Phase::Plan }));
    // The guard is opened to dry the panel.
    story.report(Report::Robot(Robot::GuardOpen));
    story.asked(Request::Unhold { dried: true });
    let refusal = Refusal::Robot(Robot::GuardOpen);
    assert_eq!(story.cell.effects, [Effect::Refuse { request: Request::Unhold { dried: true }, refusal }]);
    story.report(Report::Robot(Robot::Ready));
    story.asked(Request::Unhold { dried: true });
    let acts = story.until("to-contact");
    let order = ["locate", "corner-0", "drypicture", "plan-1", "verify", "to-contact"];
    let found = order.map(|act| acts.split(' ').position(|done| done == act));
    assert!(found.is_sorted() && found[0].is_some(), "{acts}");
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// In this hold no result waits to be accepted, even if the robot is ready.
#[test]
fn accept_is_not_possible_where_no_result_waits() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.until("verify");
    story.answer(Answer::Graded(Grade::Reject));
    story.rests();
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
    assert_eq!(story.rests(), "end-epoch");
    assert_eq!(story.at(), At::Stopped);
    let mut story = Story::in_contact();
    story.asked(Request::Stop);
    let At::Stopping { until } = story.at() else { panic!("{:?}", story.at()) };
    story.report(Report::Deadline { id: until, which: Deadline::Stop });
    assert_eq!(story.rests(), "end-epoch end-epoch");
    assert_eq!(story.at(), At::Aborted { cause: Cause::StopTimedOut });
}

#[test]
fn from_aborted_only_clear_leads_out() {
    let mut story = Story::in_contact();
    story.asked(Request::Abort);
    assert_eq!(story.rests(), "end-epoch");
    assert_eq!(story.at(), At::Aborted { cause: Cause::Asked });
    for request in REQUESTS.into_iter().filter(|request| *request != Request::Clear) {
        story.asked(request);
        assert!(matches!(story.cell.effects[..], [Effect::Refuse { .. }]), "{request:?}");
    }
    story.asked(Request::Clear);
    assert_eq!(story.rests(), "checkstandstill");
    assert_eq!(story.at(), At::Stopped);
    // An abort during the spray: the abort frame shuts the water, without waiting for anything.
    let mut story = Story::started(&[]);
    story.until("spray");
    story.asked(Request::Abort);
    assert!(story.cell.state.facts.water_may_run);
    assert_eq!(story.rests(), "end-epoch");
    assert!(!story.cell.state.facts.water_may_run && story.cell.state.facts.water_off());
}
