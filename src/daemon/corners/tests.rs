use super::*;
use crate::geometry::{Degrees, Pixel};
use crate::locate::refine::CornerReport;
use crate::panel::panel_from_base_at_teaching;
use crate::recipe::Recipe;
use crate::verdict::Verdict;

fn recipe() -> Recipe {
    let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
                [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n";
    Recipe::check("test.toml", text).unwrap_or_else(|problems| panic!("{problems}"))
}

/// Two corners, each asking for 1 mm, of which 0.4 mm are left: more than the 0.3 mm of one rigid panel.
fn unlike() -> Refined {
    let expected_px = Pixel::at(0.0, 0.0);
    let report = |corner| CornerReport { corner, expected_px, error_px: 10.0, shift_mm: [1.0, 0.0], left_mm: 0.4 };
    let base_from_panel = panel_from_base_at_teaching().inverse();
    let corners = vec![report(0), report(1)];
    Refined { base_from_panel, shift_mm: [1.0, 0.0], turned: Degrees(0.0), error_px: 10.0, corners }
}

fn codes(judgement: &Judgement) -> Vec<&str> {
    judgement.reasons.iter().map(|reason| &*reason.code).collect()
}

/// A doubt beside a place that does not come to rest: no person may accept that one away.
#[test]
fn a_doubt_hides_no_rejection() {
    let (recipe, whole) = (recipe(), unlike());
    let last = Loop { is_missing: false, is_last: true, step_mm: 0.9 };
    let judgement = last.judged(&whole, Some([0.1; 2]), recipe.corner());
    assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Reject, vec!["not_settled", "corners_disagree"]));
    let settled = Loop { step_mm: 0.1, ..last };
    let judgement = settled.judged(&whole, Some([0.1; 2]), recipe.corner());
    let both = vec!["corners_disagree", "corner_disagrees"];
    assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Review, both));
    for wrong in [Loop { step_mm: f64::NAN, ..last }, Loop { is_missing: true, ..settled }] {
        assert_eq!(wrong.judged(&whole, None, recipe.corner()).verdict, Verdict::Reject, "{wrong:?}");
    }
}

/// From afar a corner is read worse: what is doubtful then is looked at from near, what is rejected is not.
#[test]
fn a_doubt_from_afar_is_looked_at_from_near() {
    let recipe = recipe();
    let afar = Loop { is_missing: false, is_last: false, step_mm: 2.0 };
    let answers = [Grade::Accept, Grade::Review, Grade::Reject].map(|grade| afar.answer(grade, recipe.corner()));
    assert_eq!(answers, [Answer::LookOn, Answer::LookOn, Answer::Graded(Grade::Reject)]);
    let near = Loop { step_mm: 0.1, ..afar };
    assert_eq!(near.answer(Grade::Review, recipe.corner()), Answer::Graded(Grade::Review));
    assert_eq!(
        Loop { is_last: true, ..afar }.answer(Grade::Review, recipe.corner()),
        Answer::Graded(Grade::Review)
    );
}

/// Corners 2 and 1 hold the place; before contact no move leads to the first: the second alone is not enough.
#[test]
fn what_held_the_place_must_be_seen_again() {
    let place = panel_from_base_at_teaching().inverse();
    let sighting = Sighting {
        base_from_camera: Rigid::claim(*place.isometry()),
        found_px: Pixel::at(0.0, 0.0),
        corner: crate::geometry::Point::at(0.0, 0.0, 0.0),
    };
    let mut corners = Corners::default();
    let look = |corners: &mut Corners, view: u8, corner: usize| {
        corners.choose(view, corner);
        corners.see(view, Seen { corner, sighting, looked_for: place });
    };
    look(&mut corners, 0, 1);
    look(&mut corners, 1, 0);
    assert!(corners.unseen().is_none() && corners.held().is_empty());
    corners.hold();
    assert_eq!(corners.held(), [1, 0]);
    corners.begin_choice(0);
    look(&mut corners, 0, 1);
    corners.choose(1, 0);
    corners.leave_out(0, "a post is in the way");
    corners.end_choice(1);
    corners.go_round(1);
    assert_eq!(corners.aimed(), 1);
    let unseen = corners.unseen().expect("a reason");
    assert_eq!(unseen.code, "corner_unseen");
    assert!(unseen.message.starts_with("corner 1 ") && unseen.message.contains("a post"), "{}", unseen.message);
    // With all of them seen nothing is missing.
    look(&mut corners, 1, 0);
    assert!(corners.unseen().is_none());
}
