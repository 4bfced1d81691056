use super::*;
use panelprep_base::geometry::Rigid;
use panelprep_base::geometry::{Pixel, Point, Vector};
use panelprep_cell::panel::{CornerTeaching, TaughtCorner, panel_from_base_at_teaching};

/// Corners 2 and 1 determine the pose of the panel. Before contact, no motion leads to the first corner: the second
/// corner alone is not enough.
#[test]
fn what_held_the_place_must_be_seen_again() {
    let place = panel_from_base_at_teaching().inverse();
    let (reference_px, panel_from_camera) =
        (Pixel::at(0.0, 0.0), Rigid::from_isometry_unchecked(*place.isometry()));
    let taught = TaughtCorner {
        teaching_data: CornerTeaching { reference_px, panel_from_camera },
        point: Point::at(0.0, 0.0, 0.0),
        normal: Vector::new(nalgebra::Vector3::z()),
    };
    let sighting = |corner: usize| Sighting {
        corner,
        taught,
        base_from_camera: Rigid::from_isometry_unchecked(*place.isometry()),
        found_px: reference_px,
        search_pose: place,
    };
    let mut corners = CornerLoop::default();
    let look = |corners: &mut CornerLoop, view: u8, corner: usize| {
        corners.choose(view, corner);
        corners.record_sighting(view, sighting(corner));
    };
    look(&mut corners, 0, 1);
    look(&mut corners, 1, 0);
    assert!(corners.missing_corner_reason().is_none() && corners.correction_corners().is_empty());
    corners.hold();
    assert_eq!(corners.correction_corners(), [1, 0]);
    corners.begin_selection(0);
    look(&mut corners, 0, 1);
    corners.choose(1, 0);
    corners.exclude_corner(0, "a post is in the way");
    corners.end_selection(1);
    corners.advance_to_view(1);
    assert_eq!(corners.aimed_corner(), 1);
    let unseen = corners.missing_corner_reason().expect("a reason");
    assert_eq!(unseen.code, "corner_unseen");
    assert!(unseen.message.starts_with("corner 1 ") && unseen.message.contains("a post"), "{}", unseen.message);
    // When all corners were seen, nothing is missing.
    look(&mut corners, 1, 0);
    assert!(corners.missing_corner_reason().is_none());
}
