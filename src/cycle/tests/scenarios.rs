//! Stories: what the cell is asked to do, act by act.

use super::super::*;
use super::healthy::REQUESTS;
use super::story::Story;
use crate::verdict::Verdict;

#[test]
fn a_dirty_panel_is_abraded_once_and_passes() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    assert_eq!(story.until("locate"), "to-park lensclear locate");
    assert_eq!(story.until("corner-0"), "frames-camera to-corner-0 corner-0");
    story.answer(Answer::LookOn);
    assert_eq!(story.until("corner-1"), "to-corner-1 corner-1");
    assert_eq!(story.until("drypicture"), "to-park lighton drypicture");
    assert_eq!(story.until("film"), "lensguard spray wateroff lensclear film");
    assert_eq!(story.until("verify"), "plan-1 lightoff to-corner-0 verify");
    assert_eq!(story.until("to-contact"), "extractionon frames-pad to-approach toolon to-contact");
    assert_eq!(story.until("rinse"), "tooloff to-retract to-park lensguard rinse");
    assert_eq!(story.until("film"), "spray wateroff lighton lensclear film");
    assert_eq!(story.rests(), "extractionoff lightoff");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    assert_eq!(story.cell.state.job.pass, 1);
}

/// Each contact is after a look at both corners; a corner too many is no verification.
#[test]
fn both_corners_are_verified_before_contact() {
    let mut story = Story::started(&[Film::Broken, Film::Broken, Film::Whole]);
    for _ in 0..2 {
        story.until("verify");
        story.answer(Answer::LookOn);
        let acts = story.until("to-contact");
        assert!(
            acts.starts_with("to-corner-1 verify-1 ") && acts.ends_with("to-approach toolon to-contact"),
            "{acts}"
        );
    }
    story.until("film");
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });

    let mut story = Story::started(&[Film::Broken]);
    for corner in ["verify", "verify-1", "verify-2", "verify-3"] {
        story.until(corner);
        story.answer(Answer::LookOn);
    }
    story.rests();
    assert!(matches!(story.at(), At::Held(Hold { why: Why::NotVerified, .. })), "{:?}", story.at());
    story.asked(Request::Unhold { dried: false });
    story.until("verify");
}

#[test]
fn a_clean_panel_passes_without_contact() {
    let mut story = Story::started(&[Film::Whole]);
    let acts = story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    assert!(!acts.contains("toolon") && !acts.contains("to-approach") && !acts.contains("plan"), "{acts}");
}

/// The way that a cycle takes to the panel, without water, tool and contact.
#[test]
fn an_air_run_flies_the_path_and_passes() {
    let mut story = Story::idle(&[]);
    story.asked(Request::AirRun { max_moves: 3 });
    assert_eq!(story.until("corner-0"), "to-park lensclear locate frames-camera to-corner-0 corner-0");
    assert_eq!(story.until("to-air"), "plan-0 verify frames-pad to-approach to-air");
    assert_eq!(story.rests(), "to-retract to-park");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

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

/// Who opened the guard of a held cell may stop it: nothing is asked of a robot that is not ready.
#[test]
fn a_stop_of_a_held_cell_with_an_open_guard_is_at_once() {
    let mut story = Story::started(&[Film::Broken]);
    story.until("film");
    story.asked(Request::Hold);
    story.rests();
    story.told(Report::Robot(Robot::GuardOpen));
    story.asked(Request::Stop);
    assert_eq!((story.at(), story.acts.len()), (At::Stopped, 0));
}

#[test]
fn no_panel_is_a_reject_without_a_move_toward_it() {
    let mut story = Story::started(&[]);
    story.until("locate");
    story.answer(Answer::Graded(Grade::Reject));
    assert_eq!(story.rests(), "");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject });
}

#[test]
fn breaks_after_the_last_pass_fail_and_a_film_that_says_nothing_is_invalid() {
    let mut story = Story::started(&[Film::Broken, Film::Broken, Film::Broken]);
    story.rests();
    assert_eq!((story.at(), story.cell.state.job.pass), (At::Complete { verdict: Verdict::Fail }, 2));
    let mut story = Story::started(&[Film::Broken, Film::Invalid]);
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Invalid });
}

#[test]
fn the_corner_loop_ends_in_reject_when_the_corner_is_not_reached() {
    let mut story = Story::started(&[]);
    for corner in ["corner-0", "corner-1", "corner-2", "corner-3"] {
        story.until(corner);
        story.answer(Answer::LookOn);
    }
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject });
}

#[test]
fn a_doubtful_localization_waits_for_a_person() {
    let mut story = Story::started(&[Film::Whole]);
    story.until("locate");
    story.answer(Answer::Graded(Grade::Review));
    assert_eq!(story.rests(), "end-epoch");
    assert!(matches!(story.at(), At::Held(Hold { why: Why::Review, .. })), "{:?}", story.at());
    story.asked(Request::Unhold { dried: false });
    let refusal = Effect::Refuse { request: Request::Unhold { dried: false }, refusal: Refusal::Review };
    assert_eq!(story.cell.effects, [refusal]);
    story.asked(Request::Accept);
    assert_eq!(story.until("corner-0"), "epoch frames-camera to-corner-0 corner-0");
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    // Nobody accepts: the verdict stays review.
    let mut story = Story::started(&[]);
    story.until("locate");
    story.answer(Answer::Graded(Grade::Review));
    story.rests();
    story.asked(Request::Stop);
    assert!(story.cell.effects.contains(&Effect::Conclude { verdict: Verdict::Review }));
}

#[test]
fn a_doubtful_path_waits_for_a_person_and_is_verified_before_contact() {
    let doubtful = Answer::PlannedForReview { plan: 7, waypoints: 3 };
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.until("plan-1");
    story.answer(doubtful);
    assert_eq!(story.rests(), "end-epoch");
    assert_eq!(story.at(), At::Held(Hold { why: Why::Review, resume: Phase::Verify }));
    story.asked(Request::Accept);
    let acts = story.until("to-contact");
    assert!(acts.contains("verify") && !acts.contains("plan"), "the accepted path itself, verified: {acts}");
    assert_eq!((story.cell.state.job.plan, story.cell.state.job.waypoints), (7, 3));
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    // Dried instead of accepted: located and planned anew.
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.until("plan-1");
    story.answer(doubtful);
    story.rests();
    story.asked(Request::Unhold { dried: true });
    let acts = story.until("to-contact");
    assert!(acts.contains("locate") && acts.contains("plan-1") && acts.contains("verify"), "{acts}");
}

#[test]
fn a_hold_in_contact_retracts_and_unhold_verifies_and_plans_the_rest_again() {
    let mut story = Story::in_contact();
    story.asked(Request::Hold);
    assert_eq!(story.acts.join(" "), "end-epoch", "at once, and nothing else");
    let motion = story.cell.state.intent.expect("the robot has not said that it stands").motion;
    assert!(!story.at().rests());
    story.acts.clear();
    story.answer(Answer::Stands { done: 2 });
    let closed = Effect::CloseIntent { motion, outcome: Outcome::Held, done: 2 };
    assert_eq!(story.cell.effects, [closed]);
    assert!(matches!(story.at(), At::Held(Hold { why: Why::Asked, resume: Phase::Plan })));
    // A late word of the ended path is dropped.
    let (id, _) = story.cell.stale[story.cell.stale.len() - 2];
    let before = story.cell.state;
    story.told(Report::Answered { id, answer: Answer::Stands { done: 3 } });
    assert_eq!(story.cell.state, State { dropped: before.dropped + 1, ..before });

    story.asked(Request::Unhold { dried: false });
    assert_eq!(story.until("verify"), "epoch frames-camera to-corner-0 verify");
    assert_eq!(story.until("plan-1"), "plan-1");
    // The controller may have switched the extraction off since.
    assert_eq!(story.until("to-contact"), "verify extractionon frames-pad to-approach toolon to-contact");
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

#[test]
fn where_verify_fails_the_panel_is_dried_and_located_again() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.until("verify");
    story.answer(Answer::Graded(Grade::Reject));
    story.rests();
    assert_eq!(story.at(), At::Held(Hold { why: Why::NotVerified, resume: Phase::Plan }));
    // The guard is opened to dry it.
    story.told(Report::Robot(Robot::GuardOpen));
    story.asked(Request::Unhold { dried: true });
    let refusal = Refusal::Robot(Robot::GuardOpen);
    assert_eq!(story.cell.effects, [Effect::Refuse { request: Request::Unhold { dried: true }, refusal }]);
    story.told(Report::Robot(Robot::Ready));
    story.asked(Request::Unhold { dried: true });
    let acts = story.until("to-contact");
    let order = ["locate", "corner-0", "drypicture", "plan-1", "verify", "to-contact"];
    let found = order.map(|act| acts.split(' ').position(|done| done == act));
    assert!(found.is_sorted() && found[0].is_some(), "{acts}");
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// Nothing waits to be accepted there, however ready the robot is.
#[test]
fn accept_is_not_possible_where_no_result_waits() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.until("verify");
    story.answer(Answer::Graded(Grade::Reject));
    story.rests();
    for robot in [Robot::Ready, Robot::GuardOpen] {
        story.told(Report::Robot(robot));
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
    story.told(Report::Deadline { id: until, which: Deadline::Stop });
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
    assert_eq!(story.rests(), "stand");
    assert_eq!(story.at(), At::Stopped);
    // Aborted in the spray: the abort frame shuts the water, and waits for nothing.
    let mut story = Story::started(&[]);
    story.until("spray");
    story.asked(Request::Abort);
    assert!(story.cell.state.facts.water_may_run);
    assert_eq!(story.rests(), "end-epoch");
    assert!(!story.cell.state.facts.water_may_run && story.cell.state.facts.water_off());
}

/// A fault while the cell is cleared or reset: the link's epoch is gone, and the next try succeeds.
#[test]
fn clear_and_reset_succeed_after_a_fault_within_them() {
    for trouble in [Trouble::Refused, Trouble::Sequence, Trouble::Late, Trouble::Starved, Trouble::Protocol] {
        for station in ["stand", "end-epoch"] {
            let mut story = Story::started(&[Film::Broken]);
            story.until("spray");
            story.told(Report::Robot(Robot::LinkLost));
            story.answer(Answer::Failed(Trouble::Refused));
            story.told(Report::Robot(Robot::Ready));
            story.asked(Request::Clear);
            story.until(station);
            story.told(Report::EpochOver { trouble: Some(trouble) });
            assert!(matches!(story.at(), At::Aborted { .. }), "{trouble:?}");
            story.acts.clear();
            story.asked(Request::Clear);
            // The end of the epoch proves tool and water off.
            assert_eq!(story.rests(), "stand end-epoch", "{trouble:?}");
            assert_eq!(story.at(), At::Stopped);

            story.asked(Request::Reset);
            story.until("lightoff");
            story.told(Report::EpochOver { trouble: Some(trouble) });
            assert_eq!(story.at(), At::Stopped, "{trouble:?}");
            story.asked(Request::Reset);
            story.rests();
            story.asked(Request::Start { max_passes: 1, max_moves: 1 });
            story.until("locate");
        }
    }
}

/// A resting cell whose link loses the epoch has none, and opens one when it starts.
#[test]
fn an_epoch_that_the_link_ended_at_rest_is_not_used() {
    let mut story = Story::idle(&[]);
    story.told(Report::EpochOver { trouble: Some(Trouble::Starved) });
    assert_eq!(story.at(), At::Idle);
    story.asked(Request::Start { max_passes: 1, max_moves: 1 });
    assert_eq!(story.until("locate"), "end-epoch epoch to-park lensclear locate");
}

/// Water, or the tool in air, on at the end of a program: Aborted, and told until a feedback or a person says otherwise.
#[test]
fn outputs_that_were_on_outlive_the_program_and_the_link() {
    type Ends = [(&'static str, Report); 2];
    let ends: Ends = [("the program", Report::Boot), ("the link", Report::Robot(Robot::LinkLost))];
    for (name, end) in ends {
        for (station, water, tool) in [("spray", true, false), ("rinse", true, false), ("toolon", false, true)] {
            let mut story = Story::started(&[Film::Broken]);
            story.until(station);
            story.told(end);
            if end != Report::Boot {
                story.answer(Answer::Failed(Trouble::Refused));
            }
            let facts = |story: &Story| (story.cell.state.facts.water_may_run, story.cell.state.facts.tool_may_run);
            assert!(matches!(story.at(), At::Aborted { .. }), "{name}, {station}: {:?}", story.at());
            assert_eq!(facts(&story), (water, tool), "{name}, {station}");
            // Once more: still.
            story.told(Report::Boot);
            assert_eq!(facts(&story), (water, tool), "{name}, {station}");
            story.told(Report::Robot(Robot::Ready));
            let mut proven = Story { cell: story.cell, acts: vec![], films: vec![] };
            proven.told(Report::OutputsOff);
            assert_eq!(facts(&proven), (false, false));
            assert!(matches!(proven.at(), At::Aborted { .. }), "a person clears it all the same");
            proven.asked(Request::Clear);
            proven.rests();
            assert_eq!(proven.at(), At::Stopped);
        }
    }
    // Without a feedback a person's word counts: Clear proves both off.
    let mut story = Story::started(&[]);
    story.until("spray");
    story.told(Report::Boot);
    assert_eq!(story.at(), At::Aborted { cause: Cause::OutputsOn });
    story.told(Report::Robot(Robot::Ready));
    story.asked(Request::Clear);
    story.rests();
    assert_eq!((story.at(), story.cell.state.facts.water_may_run), (At::Stopped, false));
}

/// The stations of a cycle, and one act of each.
const STATIONS: [&str; 14] = [
    "to-park",
    "locate",
    "to-corner-0",
    "corner-0",
    "drypicture",
    "spray",
    "film",
    "plan-1",
    "verify",
    "to-approach",
    "toolon",
    "to-contact",
    "to-retract",
    "rinse",
];

#[test]
fn a_link_that_is_lost_aborts_every_phase() {
    for station in STATIONS {
        let mut story = Story::started(&[Film::Broken]);
        story.until(station);
        story.told(Report::Robot(Robot::LinkLost));
        let open = story.cell.state.intent.is_some();
        assert_eq!(open, station.starts_with("to-"), "{station}");
        story.answer(Answer::Failed(Trouble::Protocol));
        assert_eq!(story.at(), At::Aborted { cause: Cause::Robot(Robot::LinkLost) }, "{station}");
        assert_eq!(story.cell.state.intent.is_some(), open, "{station}: the robot has not said that it stands");
        // It is back: nothing moves. Cleared: the robot is asked where it stood.
        story.acts.clear();
        story.told(Report::Robot(Robot::Ready));
        assert_eq!((story.acts.len(), story.cell.state.facts.token), (0, None));
        story.asked(Request::Clear);
        story.rests();
        assert_eq!((story.at(), story.cell.state.intent), (At::Stopped, None), "{station}");
    }
}

#[test]
fn an_emergency_stop_voids_the_localization_and_its_release_moves_nothing() {
    for station in STATIONS {
        let mut story = Story::started(&[Film::Broken]);
        story.until(station);
        story.told(Report::Robot(Robot::EmergencyStop));
        assert_eq!(story.cell.state.facts.token, None, "{station}");
        story.rests();
        assert_eq!(story.at(), At::Aborted { cause: Cause::Robot(Robot::EmergencyStop) }, "{station}");
        assert_eq!(
            story.cell.state.facts.touching,
            station == "to-contact",
            "{station}: drives off, nothing retracts"
        );
        for robot in [Robot::DrivesOff, Robot::Ready] {
            story.told(Report::Robot(robot));
            assert_eq!(story.acts, [""; 0], "{station}");
        }
        story.asked(Request::Clear);
        story.rests();
        assert_eq!((story.at(), story.cell.state.facts.touching), (At::Stopped, false), "{station}");
    }
}

#[test]
fn a_new_program_is_aborted_where_a_motion_was_open_and_stopped_elsewhere() {
    for station in STATIONS {
        let mut story = Story::started(&[Film::Broken]);
        story.until(station);
        let recovered = recover(story.cell.journal.iter().copied());
        let interrupted = At::Aborted { cause: Cause::Interrupted };
        let on = At::Aborted { cause: Cause::OutputsOn };
        let expected = match station {
            _ if station.starts_with("to-") => interrupted,
            "spray" | "toolon" | "rinse" => on,
            _ => At::Stopped,
        };
        assert_eq!(recovered.at, expected, "{station}");
        assert_eq!((recovered.due, recovered.facts.arm), (None, None), "{station}");
        assert_eq!(recovered.facts.touching, station == "to-contact", "{station}");
        // The same by the event, and a second start changes nothing.
        story.told(Report::Boot);
        assert_eq!(story.cell.state, recovered);
        assert_eq!(recover(story.cell.journal.iter().copied()), recovered);
    }
}

#[test]
fn a_link_that_is_lost_while_aborting_leaves_nobody_to_wait_for() {
    let mut story = Story::in_contact();
    story.asked(Request::Abort);
    story.told(Report::Robot(Robot::LinkLost));
    assert_eq!(story.at(), At::Aborted { cause: Cause::Asked });
}

#[test]
fn a_slow_robot_is_left_alone_in_air_and_held_in_contact() {
    let mut story = Story::started(&[Film::Broken]);
    story.until("to-approach");
    story.told(Report::Trouble(Trouble::Slow));
    assert_eq!(story.at(), At::Execute(Phase::Abrade));
    let mut story = Story::in_contact();
    story.told(Report::Trouble(Trouble::Slow));
    assert!(matches!(story.at(), At::Holding(Hold { why: Why::Trouble(Trouble::Slow), .. })));
}

#[test]
fn trouble_before_the_panel_is_found_is_held_and_the_panel_is_located() {
    let mut story = Story::started(&[Film::Whole]);
    story.told(Report::Trouble(Trouble::Feedback));
    story.rests();
    assert_eq!(story.at(), At::Held(Hold { why: Why::Trouble(Trouble::Feedback), resume: Phase::Locate }));
    story.acts.clear();
    story.asked(Request::Unhold { dried: false });
    assert_eq!(story.until("locate"), "epoch to-park lensclear locate");
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// A journal is lines of JSON; read back it leads to the same state.
#[test]
fn a_journal_folds_to_the_state_that_wrote_it() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.rests();
    let lines: Vec<String> =
        story.cell.journal.iter().map(|event| serde_json::to_string(event).expect("a line")).collect();
    assert!(lines.iter().all(|line| !line.contains('\n') && line.len() < 120), "{lines:#?}");
    assert_eq!(lines[2], r#"{"told":{"answered":{"id":1,"answer":{"stands":{"done":0}}}}}"#);
    let read = lines.iter().map(|line| serde_json::from_str(line).expect("an event"));
    assert_eq!(fold(read), story.cell.state);
    let kept = serde_json::to_string(&story.cell.state).expect("a state");
    assert_eq!(serde_json::from_str::<State>(&kept).expect("a state"), story.cell.state);
}
