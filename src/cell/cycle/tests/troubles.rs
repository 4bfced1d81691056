//! Scenarios with faults of the link, the robot or the program, in every phase of a cycle.

use super::super::*;
use super::healthy::Story;
use panelprep_base::verdict::Verdict;

/// After a fault during Clear or Reset, the link has ended the epoch, and the next attempt succeeds.
#[test]
fn clear_and_reset_succeed_after_a_fault_within_them() {
    for trouble in [Trouble::Refused, Trouble::Sequence, Trouble::Late, Trouble::Starved, Trouble::Protocol] {
        for station in ["checkstandstill", "end-epoch"] {
            let mut story = Story::started(&[Film::Broken]);
            story.run_until("spray");
            story.report(Report::Robot(Robot::LinkLost));
            story.answer(Answer::Failed(Trouble::Refused));
            story.report(Report::Robot(Robot::Ready));
            story.asked(Request::Clear);
            story.run_until(station);
            story.report(Report::EpochOver { trouble: Some(trouble) });
            assert!(matches!(story.at(), At::Aborted { .. }), "{trouble:?}");
            story.acts.clear();
            story.asked(Request::Clear);
            // The end of the epoch confirms that tool and water are off.
            assert_eq!(story.run_until_rest(), "checkstandstill end-epoch", "{trouble:?}");
            assert_eq!(story.at(), At::Stopped);

            story.asked(Request::Reset);
            story.run_until("lightoff");
            story.report(Report::EpochOver { trouble: Some(trouble) });
            assert_eq!(story.at(), At::Stopped, "{trouble:?}");
            story.asked(Request::Reset);
            story.run_until_rest();
            story.asked(Request::Start { max_passes: 1, max_moves: 1, dries: false });
            story.run_until("locate");
        }
    }
}

/// If the link ends the epoch while the cell is at rest, the cell opens a new epoch at the next start.
#[test]
fn an_epoch_that_the_link_ended_at_rest_is_not_used() {
    let mut story = Story::idle(&[]);
    story.report(Report::EpochOver { trouble: Some(Trouble::Starved) });
    assert_eq!(story.at(), At::Idle);
    story.asked(Request::Start { max_passes: 1, max_moves: 1, dries: false });
    assert_eq!(story.run_until("locate"), "end-epoch epoch to-park lensclear locate");
}

/// If water or the tool in the air is on when a program ends, the state is Aborted, until a feedback or a person
/// confirms that both are off.
#[test]
fn outputs_that_were_on_outlive_the_program_and_the_link() {
    type Ends = [(&'static str, Report); 2];
    let ends: Ends = [("the program", Report::Boot), ("the link", Report::Robot(Robot::LinkLost))];
    for (name, end) in ends {
        for (station, water, tool) in [("spray", true, false), ("rinse", true, false), ("toolon", false, true)] {
            let mut story = Story::started(&[Film::Broken]);
            story.run_until(station);
            story.report(end);
            if end != Report::Boot {
                story.answer(Answer::Failed(Trouble::Refused));
            }
            let facts = |story: &Story| (story.cell.state.facts.water_may_run, story.cell.state.facts.tool_may_run);
            assert!(matches!(story.at(), At::Aborted { .. }), "{name}, {station}: {:?}", story.at());
            assert_eq!(facts(&story), (water, tool), "{name}, {station}");
            // A second start leads to the same state.
            story.report(Report::Boot);
            assert_eq!(facts(&story), (water, tool), "{name}, {station}");
            story.report(Report::Robot(Robot::Ready));
            let mut proven = Story { cell: story.cell, acts: vec![], films: vec![] };
            proven.report(Report::OutputsOff);
            assert_eq!(facts(&proven), (false, false));
            assert!(matches!(proven.at(), At::Aborted { .. }), "a person clears it all the same");
            proven.asked(Request::Clear);
            proven.run_until_rest();
            assert_eq!(proven.at(), At::Stopped);
        }
    }
    // Without a feedback, a person's Clear confirms that both are off.
    let mut story = Story::started(&[]);
    story.run_until("spray");
    story.report(Report::Boot);
    assert_eq!(story.at(), At::Aborted { cause: Cause::OutputsOn });
    story.report(Report::Robot(Robot::Ready));
    story.asked(Request::Clear);
    story.run_until_rest();
    assert_eq!((story.at(), story.cell.state.facts.water_may_run), (At::Stopped, false));
}

/// All phases of a cycle, each represented by one of its actions.
const PHASE_ACTIONS: [&str; 15] = [
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
    "assess",
    "rinse",
];

#[test]
fn a_link_that_is_lost_aborts_every_phase() {
    for station in PHASE_ACTIONS {
        let mut story = Story::started(&[Film::Broken]);
        story.run_until(station);
        story.report(Report::Robot(Robot::LinkLost));
        let open = story.cell.state.intent.is_some();
        assert_eq!(open, station.starts_with("to-"), "{station}");
        story.answer(Answer::Failed(Trouble::Protocol));
        assert_eq!(story.at(), At::Aborted { cause: Cause::Robot(Robot::LinkLost) }, "{station}");
        assert_eq!(story.cell.state.intent.is_some(), open, "{station}: the robot has not said that it stands");
        // When the link is connected again, nothing moves. After Clear, the robot's standstill is queried.
        story.acts.clear();
        story.report(Report::Robot(Robot::Ready));
        assert_eq!((story.acts.len(), story.cell.state.facts.token), (0, None));
        story.asked(Request::Clear);
        story.run_until_rest();
        assert_eq!((story.at(), story.cell.state.intent), (At::Stopped, None), "{station}");
    }
}

#[test]
fn an_emergency_stop_voids_the_localization_and_its_release_moves_nothing() {
    for station in PHASE_ACTIONS {
        let mut story = Story::started(&[Film::Broken]);
        story.run_until(station);
        story.report(Report::Robot(Robot::EmergencyStop));
        assert_eq!(story.cell.state.facts.token, None, "{station}");
        story.run_until_rest();
        assert_eq!(story.at(), At::Aborted { cause: Cause::Robot(Robot::EmergencyStop) }, "{station}");
        assert_eq!(
            story.cell.state.facts.touching,
            station == "to-contact",
            "{station}: drives off, nothing retracts"
        );
        for robot in [Robot::DrivesOff, Robot::Ready] {
            story.report(Report::Robot(robot));
            assert_eq!(story.acts, [""; 0], "{station}");
        }
        story.asked(Request::Clear);
        story.run_until_rest();
        assert_eq!((story.at(), story.cell.state.facts.touching), (At::Stopped, false), "{station}");
    }
}

#[test]
fn a_restart_leads_to_aborted_after_an_open_motion_and_else_to_stopped() {
    for station in PHASE_ACTIONS {
        let mut story = Story::started(&[Film::Broken]);
        story.run_until(station);
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
        // The event Boot leads to the same state as `recover`, and a second start changes nothing.
        story.report(Report::Boot);
        assert_eq!(story.cell.state, recovered);
        assert_eq!(recover(story.cell.journal.iter().copied()), recovered);
    }
}

#[test]
fn a_link_that_is_lost_while_aborting_leaves_no_client_waiting() {
    let mut story = Story::in_contact();
    story.asked(Request::Abort);
    story.report(Report::Robot(Robot::LinkLost));
    assert_eq!(story.at(), At::Aborted { cause: Cause::Asked });
}

#[test]
fn a_slow_robot_is_ignored_in_air_and_held_in_contact() {
    let mut story = Story::started(&[Film::Broken]);
    story.run_until("to-approach");
    story.report(Report::Trouble(Trouble::Slow));
    assert_eq!(story.at(), At::Execute(Phase::Abrade));
    let mut story = Story::in_contact();
    story.report(Report::Trouble(Trouble::Slow));
    assert!(matches!(story.at(), At::Holding(Hold { why: Why::Trouble(Trouble::Slow), .. })));
}

#[test]
fn trouble_before_the_panel_is_found_is_held_and_the_panel_is_located() {
    let mut story = Story::started(&[Film::Whole]);
    story.report(Report::Trouble(Trouble::Feedback));
    story.run_until_rest();
    assert_eq!(story.at(), At::Held(Hold { why: Why::Trouble(Trouble::Feedback), resume: Phase::Locate }));
    story.acts.clear();
    story.asked(Request::Unhold { dried: false });
    assert_eq!(story.run_until("locate"), "epoch to-park lensclear locate");
    story.run_until_rest();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// At an override of 50 %, the cycle is held before the tool starts. It resumes after a person has set 100 %.
#[test]
fn contact_waits_for_the_override_that_it_is_planned_for() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.run_until("verify");
    story.report(Report::FullOverride(false));
    let acts = story.run_until_rest();
    assert!(!acts.contains("toolon") && !acts.contains("contact"), "{acts}");
    assert_eq!(story.at(), At::Held(Hold { why: Why::Trouble(Trouble::Override), resume: Phase::Plan }));
    story.report(Report::FullOverride(true));
    story.asked(Request::Unhold { dried: false });
    story.run_until("to-contact");
}

/// If the override is changed at the pendant during contact, the path is interrupted, the result is graded, and the
/// cycle is held.
#[test]
fn a_changed_override_ends_the_contact() {
    let mut story = Story::in_contact();
    story.report(Report::FullOverride(false));
    let acts = story.run_until_rest();
    assert_eq!(acts.split(' ').next(), Some("end-epoch"), "{acts}");
    let resume = Phase::Assess { left: true };
    assert_eq!(story.at(), At::Held(Hold { why: Why::Trouble(Trouble::Override), resume }));
}
