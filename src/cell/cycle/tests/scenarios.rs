//! Scenarios of a cycle without faults: from the first picture of the panel to its verdict.

use super::super::*;
use super::script::Story;
use panelprep_base::verdict::Verdict;

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
    assert_eq!(story.until("rinse"), "tooloff to-retract assess to-park lensguard rinse");
    assert_eq!(
        story.until("film"),
        "wateroff spray wateroff lighton lensclear film",
        "the rinse's water is no spray"
    );
    assert_eq!(story.rests(), "extractionoff lightoff");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    assert_eq!(story.cell.state.job.pass, 1);
}

/// Each contact follows a picture of both corners; a picture of one corner more does not count as a verification.
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

/// The path of a cycle to the panel, without water, tool and contact.
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
fn no_panel_is_a_reject_without_a_move_toward_it() {
    let mut story = Story::started(&[]);
    story.until("locate");
    story.answer(Answer::Graded(Grade::Reject));
    assert_eq!(story.rests(), "");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject });
}

#[test]
fn breaks_after_the_last_pass_fail_and_a_film_that_shows_nothing_is_invalid() {
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
    // The result is not accepted: the verdict stays review.
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
    // The panel is dried instead of accepted: it is located and planned again.
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.until("plan-1");
    story.answer(doubtful);
    story.rests();
    story.asked(Request::Unhold { dried: true });
    let acts = story.until("to-contact");
    assert!(acts.contains("locate") && acts.contains("plan-1") && acts.contains("verify"), "{acts}");
}

/// The result of the tool is graded with the tool off and clear of the panel. A reject ends the cycle there: no
/// water, no film.
#[test]
fn a_contact_that_is_rejected_ends_the_cycle() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    assert!(story.until("assess").ends_with("tooloff to-retract assess"));
    story.answer(Answer::Graded(Grade::Reject));
    assert_eq!(story.rests(), "to-park extractionoff");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Reject });
    assert_eq!(story.films, [Film::Whole], "no film after it");
}

/// If the recipe requires a new dry picture, a person dries the panel after the rinse: it is located, its dry
/// picture is taken, and the film follows. Nothing continues before that is confirmed.
#[test]
fn a_new_dry_picture_waits_for_a_dried_panel() {
    let start = Request::Start { max_passes: 2, max_moves: 3, dries: true };
    let mut story = Story::started_by(start, &[Film::Broken, Film::Whole]);
    story.until("rinse");
    story.rests();
    let held = At::Held(Hold { why: Why::Drying, resume: Phase::Wet });
    assert_eq!(story.at(), held);
    story.asked(Request::Unhold { dried: false });
    let refusal = Effect::Refuse { request: Request::Unhold { dried: false }, refusal: Refusal::Undried };
    assert_eq!((story.at(), &story.cell.effects[..]), (held, &[refusal][..]));
    story.asked(Request::Unhold { dried: true });
    let acts = story.until("film");
    let order = ["locate", "corner-0", "dry", "spray", "film"].map(|act| acts.find(act));
    assert!(order.iter().all(Option::is_some) && order.is_sorted(), "{acts}");
    story.rests();
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
}

/// Only the person decides: drying the panel and locating it again does not measure the result of the tool.
#[test]
fn a_doubtful_contact_waits_for_a_person() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.until("assess");
    story.answer(Answer::Graded(Grade::Review));
    assert_eq!(story.rests(), "end-epoch");
    let held = At::Held(Hold { why: Why::Review, resume: Phase::Assess { left: false } });
    assert_eq!(story.at(), held);
    for dried in [false, true] {
        story.asked(Request::Unhold { dried });
        let refusal = Effect::Refuse { request: Request::Unhold { dried }, refusal: Refusal::Review };
        assert_eq!((story.at(), &story.cell.effects[..]), (held, &[refusal][..]));
    }
    story.asked(Request::Accept);
    let acts = story.rests();
    assert!(acts.contains("rinse") && !acts.contains("plan") && !acts.contains("assess"), "{acts}");
    assert_eq!(story.at(), At::Complete { verdict: Verdict::Pass });
    // The result is not accepted: the verdict stays review.
    let mut story = Story::started(&[Film::Broken]);
    story.until("assess");
    story.answer(Answer::Graded(Grade::Review));
    story.rests();
    story.asked(Request::Stop);
    assert!(story.cell.effects.contains(&Effect::Conclude { verdict: Verdict::Review }));
}

/// A journal consists of lines of JSON; when it is read back, it leads to the same state.
#[test]
fn a_journal_folds_to_the_state_that_wrote_it() {
    let mut story = Story::started(&[Film::Broken, Film::Whole]);
    story.rests();
    let lines: Vec<String> =
        story.cell.journal.iter().map(|event| serde_json::to_string(event).expect("a line")).collect();
    assert!(lines.iter().all(|line| !line.contains('\n') && line.len() < 120), "{lines:#?}");
    assert_eq!(lines[3], r#"{"told":{"answered":{"id":1,"answer":{"stands":{"done":0}}}}}"#);
    let read = lines.iter().map(|line| serde_json::from_str(line).expect("an event"));
    assert_eq!(fold_journal(read), story.cell.state);
    let kept = serde_json::to_string(&story.cell.state).expect("a state");
    assert_eq!(serde_json::from_str::<State>(&kept).expect("a state"), story.cell.state);
}
