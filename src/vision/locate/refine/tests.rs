use super::*;
use nalgebra::Isometry3;
use panelprep_base::geometry::Degrees;
use panelprep_base::verdict::Verdict;
use panelprep_cell::panel::CornerTeaching;
use panelprep_cell::recipe;
use proptest::prelude::*;

fn found(check: Option<panelprep_base::verdict::Check>) -> panelprep_base::verdict::Reason {
    check.and_then(|check| check.reason()).expect("a finding")
}

const CAMERA: PinholeCamera = PinholeCamera {
    width_px: 2048,
    height_px: 1536,
    fx_px: 2400.0,
    fy_px: 2400.0,
    cx_px: 1024.0,
    cy_px: 768.0,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

/// Returns the pose of a camera that looks along the base's X with its Y down: the camera's X is the base's −Y, its Y
/// the base's −Z.
fn camera_along_x(at: Point<Base>) -> Rigid<Base, FlangeCamera> {
    Rigid::from_axes([-Vector3::y(), -Vector3::z(), Vector3::x()].map(Vector::new), at)
}

fn taught(
    point: Point<Panel>,
    base_from_camera: Rigid<Base, FlangeCamera>,
    camera: &PinholeCamera,
) -> TaughtCorner {
    let panel_from_camera = panelprep_cell::panel::panel_from_base_at_teaching() * base_from_camera;
    let reference_px = camera.project(panel_from_camera.inverse() * point).expect("in front");
    TaughtCorner {
        teaching_data: CornerTeaching { reference_px, panel_from_camera },
        point,
        normal: Vector::new(-Vector3::x()),
    }
}

/// Expected values, calculated by hand: a camera at (320, 0, 360) looks along the base's X at a corner 240 mm away, f =
/// 2400 px: 10 px are 1 mm. The corner is found 24 px to the right and 10 px up. So the panel is 2.4 mm to the right,
/// base −Y, and 1 mm up, base +Z.
#[test]
fn a_corner_to_the_right_moves_the_panel_to_the_right() {
    let base_from_camera = camera_along_x(Point::at(320.0, 0.0, 360.0));
    let corner = taught(Point::at(560.0, 0.0, 360.0), base_from_camera, &CAMERA);
    let nominal = panelprep_cell::panel::panel_from_base_at_teaching().inverse();
    let view = CornerView { corner: 0, taught: &corner, base_from_camera, found_px: Pixel::at(1048.0, 758.0) };
    let refined = refine(nominal, &CAMERA, &[view]).expect("in view");
    assert!((refined.base_from_panel.origin().mm.coords - Vector3::new(0.0, -2.4, 1.0)).norm() < 1e-9);
    assert!((refined.shift_mm[0] - 2.4).abs() < 1e-9 && (refined.shift_mm[1] + 1.0).abs() < 1e-9);
    assert!((refined.error_px - 26.0).abs() < 1e-9, "√(24² + 10²) = 26 px: {}", refined.error_px);
    assert!(refined.corners[0].remaining_shift_mm < 1e-9);
}

/// Expected values, calculated by hand: the cameras look along X and along −Y, both 240 mm away. The first corner
/// indicates 1 mm in −Y and 1 mm up, the second 2 mm in −X and 2 mm up. The common result is (−2, −1, 1.5), and 0.5 mm
/// remains for each corner.
#[test]
fn two_corners_share_the_difference() {
    let along_x = camera_along_x(Point::at(320.0, 0.0, 360.0));
    let along_minus_y: Rigid<Base, FlangeCamera> = Rigid::from_axes(
        [-Vector3::x(), -Vector3::z(), -Vector3::y()].map(Vector::new),
        Point::at(560.0, 240.0, 360.0),
    );
    let corner = Point::at(560.0, 0.0, 360.0);
    let (first, second) = (taught(corner, along_x, &CAMERA), taught(corner, along_minus_y, &CAMERA));
    let views = [
        CornerView { corner: 0, taught: &first, base_from_camera: along_x, found_px: Pixel::at(1034.0, 758.0) },
        CornerView {
            corner: 1,
            taught: &second,
            base_from_camera: along_minus_y,
            found_px: Pixel::at(1044.0, 748.0),
        },
    ];
    let nominal = panelprep_cell::panel::panel_from_base_at_teaching().inverse();
    let refined = refine(nominal, &CAMERA, &views).expect("in view");
    let shift = refined.base_from_panel.origin().mm.coords;
    assert!((shift - Vector3::new(-2.0, -1.0, 1.5)).norm() < 1e-9, "{shift}");
    assert!(
        refined.corners.iter().all(|corner| (corner.remaining_shift_mm - 0.5).abs() < 1e-9),
        "{:?}",
        refined.corners
    );
}

/// Expected value, calculated by hand: a camera 100 mm in front of the surface and 100 mm beside the corner sees a
/// motion along the normal with a factor of sin 45°.
#[test]
fn a_slanted_view_shows_a_part_of_a_motion_along_the_normal() {
    let corner = |y: f64| taught(Point::at(560.0, 0.0, 360.0), camera_along_x(Point::at(460.0, y, 360.0)), &CAMERA);
    assert!((corner(100.0).visible_normal_fraction() - 0.5f64.sqrt()).abs() < 1e-9);
    assert!(corner(0.0).visible_normal_fraction() < 1e-9);
}

/// Expected values, calculated by hand: two corners are 200 mm apart, and both cameras look along X. After a rotation
/// by 0.01 rad about X, one corner is 1 mm higher, the other 1 mm lower; both are 0.5 mm farther to the right.
#[test]
fn two_separate_corners_rotate_the_panel() {
    let nominal = panelprep_cell::panel::panel_from_base_at_teaching().inverse();
    let at = |y: f64| camera_along_x(Point::at(320.0, y, 360.0));
    let corners = [100.0, -100.0].map(|y| taught(Point::at(560.0, y, 360.0), at(y), &CAMERA));
    let seen = |index: usize, y: f64, up_px: f64| CornerView {
        corner: index,
        taught: &corners[index],
        base_from_camera: at(y),
        found_px: Pixel::at(1024.0 + 5.0, 768.0 - up_px),
    };
    let refined = refine(nominal, &CAMERA, &[seen(0, 100.0, 10.0), seen(1, -100.0, -10.0)]).expect("in view");
    assert!((refined.rotation.to_rad() - 0.01).abs() < 1e-6, "{refined:?}");
    let first = (refined.base_from_panel * corners[0].point).mm;
    assert!((first.y - 99.5).abs() < 0.01 && (first.z - 361.0).abs() < 0.01, "{first}");
    assert!(refined.corners.iter().all(|corner| corner.remaining_shift_mm < 0.01), "{refined:?}");
    // Stated errors of 1 mm and 0.2 mm are 1.02 mm together. The distance √(1² + 0.5²) = 1.118 mm is less than twice
    // 1.02 mm, but more than twice 0.3 mm.
    assert_eq!(worst_disagreement(&refined, &[1.0, 0.2]).expect("a corner").reason(), None);
    assert_eq!(found(worst_disagreement(&refined, &[0.3])).code, "corner_disagrees");
}

/// Only the second taught corner is viewed, 12 px away from its expected position at 10 px/mm. Each check names the
/// corner by its taught number.
#[test]
fn a_corner_is_named_by_its_taught_number() {
    let base_from_camera = camera_along_x(Point::at(320.0, 0.0, 360.0));
    let corner = taught(Point::at(560.0, 0.0, 360.0), base_from_camera, &CAMERA);
    let view = CornerView { corner: 1, taught: &corner, base_from_camera, found_px: Pixel::at(1036.0, 768.0) };
    let nominal = panelprep_cell::panel::panel_from_base_at_teaching().inverse();
    let refined = refine(nominal, &CAMERA, &[view]).expect("in view");
    let recipe = limits("max_correction_mm = 1.0\n");
    let reasons =
        [judge(&refined, recipe.corner()).reasons, judge_corner_positions(&refined, recipe.corner()).reasons]
            .concat();
    let reasons = reasons.into_iter().chain(worst_disagreement(&refined, &[0.1]).and_then(|check| check.reason()));
    let said: Vec<(String, bool)> =
        reasons.map(|it| (it.code.to_string(), it.message.contains("corner 2"))).collect();
    let codes = ["correction_limit", "moved", "corner_disagrees"];
    assert_eq!(said, codes.map(|code| (code.to_owned(), true)));
}

/// A NaN violates every limit, for each corner.
#[test]
fn a_nan_is_never_accepted() {
    let report = |corner, shift_mm, left_mm| CornerReport {
        corner,
        expected_px: Pixel::at(0.0, 0.0),
        error_px: 0.0,
        shift_mm: [shift_mm, 0.0],
        remaining_shift_mm: left_mm,
    };
    let refined = |corners| RefinedPose {
        base_from_panel: panelprep_cell::panel::panel_from_base_at_teaching().inverse(),
        shift_mm: [0.0; 2],
        rotation: Degrees(0.0),
        error_px: 0.0,
        corners,
    };
    let recipe = limits("");
    for nan in [f64::NAN, -f64::NAN] {
        let left = refined(vec![report(0, 0.0, nan), report(1, 0.0, 0.1)]);
        let judgement = judge(&left, recipe.corner());
        assert_eq!((judgement.verdict, &*judgement.reasons[0].code), (Verdict::Review, "corners_disagree"));
        let asked = refined(vec![report(0, nan, 0.0), report(1, 0.1, 0.0)]);
        assert_eq!(judge(&asked, recipe.corner()).reasons[0].code, "correction_limit");
        assert_eq!(judge_corner_positions(&asked, recipe.corner()).reasons[0].code, "moved");
        assert_eq!(found(worst_disagreement(&asked, &[0.3])).code, "corner_disagrees");
    }
}

fn limits(of_corner: &str) -> recipe::Recipe {
    let text = format!(
        "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
         [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n[corner]\n{of_corner}"
    );
    recipe::Recipe::check("test.toml", &text).unwrap_or_else(|problems| panic!("{problems}"))
}

/// The same two corners, each seen 1 mm nearer to the other. No rigid panel can explain this.
#[test]
fn corners_that_do_not_fit_a_rigid_panel_are_a_finding() {
    let nominal = panelprep_cell::panel::panel_from_base_at_teaching().inverse();
    let at = |y: f64| camera_along_x(Point::at(320.0, y, 360.0));
    let corners = [100.0, -100.0].map(|y| taught(Point::at(560.0, y, 360.0), at(y), &CAMERA));
    let seen = |index: usize, y: f64, right_px: f64| CornerView {
        corner: index,
        taught: &corners[index],
        base_from_camera: at(y),
        found_px: Pixel::at(1024.0 + right_px, 768.0),
    };
    let refined = refine(nominal, &CAMERA, &[seen(0, 100.0, 10.0), seen(1, -100.0, -10.0)]).expect("in view");
    assert!(refined.corners.iter().all(|corner| (corner.remaining_shift_mm - 1.0).abs() < 1e-6), "{refined:?}");
    let recipe = limits("");
    let judgement = judge(&refined, recipe.corner());
    assert_eq!((judgement.verdict, judgement.reasons[0].code.as_ref()), (Verdict::Review, "corners_disagree"));
}

#[test]
fn a_wrong_flange_pose_is_an_error_and_a_large_correction_a_reject() {
    let base_from_camera = camera_along_x(Point::at(320.0, 0.0, 360.0));
    let corner = taught(Point::at(560.0, 0.0, 360.0), base_from_camera, &CAMERA);
    let nominal = panelprep_cell::panel::panel_from_base_at_teaching().inverse();
    let beyond = camera_along_x(Point::at(900.0, 0.0, 360.0));
    let view = |base_from_camera, u| CornerView {
        corner: 0,
        taught: &corner,
        base_from_camera,
        found_px: Pixel::at(u, 768.0),
    };
    let error = refine(nominal, &CAMERA, &[view(beyond, 1024.0)]).expect_err("behind");
    assert_eq!(error, RefineError::NotInView { corner: 1, depth_mm: -340.0 });
    assert_eq!(refine(nominal, &CAMERA, &[]), Err(RefineError::NoView));

    let recipe = limits("max_correction_mm = 8.0\n");
    let verdict = |u| {
        let refined = refine(nominal, &CAMERA, &[view(base_from_camera, u)]).expect("in view");
        judge(&refined, recipe.corner())
    };
    assert_eq!(verdict(1024.0 + 79.0).reasons, []);
    assert_eq!(verdict(1024.0 + 81.0).reasons[0].code, "correction_limit");
}

proptest! {
    /// One step is enough from any camera pose near the taught one. After the correction the corner projects to the
    /// pixel at which it was found. The expected pixel at newCP (Eq. 3.22) is the taught reference pixel, and the shift
    /// is Eq. 3.24 as printed.
    #[test]
    fn one_step_is_enough(
        moved in prop::array::uniform6(-1.0..1.0f64),
        off in prop::array::uniform6(-1.0..1.0f64),
        u in 700.0..1300.0f64,
        v in 500.0..1000.0f64,
    ) {
        let camera = PinholeCamera { k1: -0.11, k2: 0.09, p1: -0.0005, p2: 0.0003, ..CAMERA };
        let small = |n: [f64; 6], mm: f64, rad: f64| {
            Isometry3::new(Vector3::new(n[0], n[1], n[2]) * mm, Vector3::new(n[3], n[4], n[5]) * rad)
        };
        let nominal_camera = camera_along_x(Point::at(325.0, -140.0, 455.0));
        let corner = taught(Point::at(560.0, -150.0, 460.0), nominal_camera, &camera);
        let located: Rigid<Base, Panel> = Rigid::from_isometry_unchecked(small(moved, 20.0, 0.1));
        let new_pose = located * corner.teaching_data.panel_from_camera; // Eq. 3.22
        let at_new_pose = CornerView { corner: 0, taught: &corner, base_from_camera: new_pose, found_px: Pixel::at(u, v) };
        let refined = refine(located, &camera, &[at_new_pose]).expect("in view");
        let expected = refined.corners[0].expected_px;
        prop_assert!(expected.distance_px(corner.teaching_data.reference_px) < 1e-6);

        let [x, y] = refined.shift_mm;
        let new_from_refined = Isometry3::translation(x, y, 0.0);
        let turn = (located.inverse() * new_pose).isometry().rotation; // Eq. 3.25
        let printed = located.isometry() * turn * new_from_refined * turn.inverse(); // Eq. 3.24
        let printed: Rigid<Base, Panel> = Rigid::from_isometry_unchecked(printed);
        prop_assert!(printed.distance_at_mm(refined.base_from_panel, corner.point) < 1e-9);

        let base_from_camera = new_pose * Rigid::<FlangeCamera, FlangeCamera>::from_isometry_unchecked(small(off, 5.0, 0.017));
        let view = CornerView { base_from_camera, ..at_new_pose };
        let refined = refine(located, &camera, &[view]).expect("in view");
        let seen = camera.project(base_from_camera.inverse() * (refined.base_from_panel * corner.point));
        prop_assert!(seen.expect("in front").distance_px(Pixel::at(u, v)) < 1e-6);
    }

    /// A single corner gives no rotation.
    #[test]
    fn a_single_corner_gives_no_rotation(u in 700.0..1300.0f64, moved in prop::array::uniform3(-0.2..0.2f64)) {
        let base_from_camera = camera_along_x(Point::at(320.0, 0.0, 360.0));
        let corner = taught(Point::at(560.0, 0.0, 360.0), base_from_camera, &CAMERA);
        let located: Rigid<Base, Panel> = Rigid::from_isometry_unchecked(Isometry3::new(Vector3::zeros(), moved.into()));
        let view = CornerView { corner: 0, taught: &corner, base_from_camera, found_px: Pixel::at(u, 700.0) };
        if let Ok(refined) = refine(located, &CAMERA, &[view]) {
            let turned: Rigid<Panel, Panel> = located.inverse() * refined.base_from_panel;
            prop_assert!(turned.rotation_angle().0 < 1e-6);
        }
    }
}
