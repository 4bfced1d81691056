//! The correction of a localization by corners that the flange camera sees (thesis 3.9, Eq. 3.22–3.25).
//!
//! The expected pixel of a corner is the projection of its taught place through the pose to be corrected. The thesis
//! drives the camera to  ᵇT_newCP = ᵇT_w · ʷT_nominalCP  (3.22), where that pixel is the taught reference pixel; from
//! any other pose it is as well known, so the camera may stand near there and need not stand exactly there.
//! The thesis then moves the camera in small amounts until both coincide. With the image Jacobian one computed step is
//! enough: in undistorted image coordinates x, y, at the corner's depth Z,
//!     Δ = Z · (x_found − x_expected,  y_found − y_expected)  along the camera's X and Y.                      (3.23)
//! A corner found to the right of where it is expected asks the camera to move right to see it in its place, and the
//! panel stands to the right by as much:
//!     ᵇT_w' = ᵇT_w · ʷR_newCP · T(Δ) · ʷR_newCPᵀ,   ʷR_newCP the rotation of  ʷT_newCP = ᵇT_w⁻¹ · ᵇT_newCP.  (3.24, 3.25)
//! This shifts the panel by Δ along the camera's axes and turns nothing. Several corners give the shift v that fits all in
//! the sense of least squares, and where they lie apart the turn φ about the direction f in which the cameras look as well:
//! a corner p then moves by  v + φ f × (p − p̄).  A direction along which every camera looks stays as it was.
//! What the corners leave of their own errors says whether they are corners of one rigid panel; what they ask for, whether
//! they agree with the 3D scan. Neither is averaged away: see [`judge`] and [`disagreement`].

use crate::geometry::{Base, Degrees, FlangeCamera, Panel, PinholeCamera, Pixel, Point, Rigid, Vector};
use crate::panel::TaughtCorner;
use crate::recipe;
use crate::verdict::{Judgement, Reason};
use nalgebra::{Isometry3, Matrix4, Translation3, UnitQuaternion, Vector3, Vector4};

/// A direction that the cameras see with less than this weight (1 for each camera that looks across it) is not corrected:
/// two cameras that look almost the same way would turn a pixel's error into millimetres of depth.
const MIN_WEIGHT: f64 = 0.2;

/// Corners nearer to their middle than this turn nothing, mm, root mean square: a pixel would become degrees.
const MIN_APART_MM: f64 = 25.0;
/// After the correction the corners of one rigid panel stand where they are seen within this, mm.
const MAX_LEFT_MM: f64 = 0.3;

/// One corner picture.
#[derive(Debug, Clone, Copy)]
pub struct CornerView<'a> {
    /// The corner as taught.
    pub taught: &'a TaughtCorner,
    /// Where the camera stood at this picture: base_from_flange · flange_from_camera.
    pub base_from_camera: Rigid<Base, FlangeCamera>,
    /// Where the corner was found.
    pub found_px: Pixel,
}

/// Why a correction cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RefineError {
    /// No picture.
    #[error("no corner picture was given; needed is one at least")]
    NoView,
    /// The corner is not before the camera.
    #[error(
        "from the flange pose of picture {picture} the corner would be {depth_mm:.0} mm before the camera; is that pose \
         the picture's?"
    )]
    NotInView {
        /// Which picture, from 1.
        picture: usize,
        /// Depth of the expected corner, mm.
        depth_mm: f64,
    },
}

/// What one corner says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerReport {
    /// Where the corner was expected.
    pub expected_px: Pixel,
    /// Found minus expected, px.
    pub error_px: f64,
    /// The shift that this corner alone asks for, along its camera's X and Y, mm.
    pub shift_mm: [f64; 2],
    /// What is left of it after the common correction, mm.
    pub left_mm: f64,
}

/// A corrected pose with what it rests on.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// Where the panel stands.
    pub base_from_panel: Rigid<Base, Panel>,
    /// The correction along X and Y of the first camera, mm.
    pub shift_mm: [f64; 2],
    /// How far the panel was turned, with corners that lie apart.
    pub turned: Degrees,
    /// The largest distance between found and expected corner, px.
    pub error_px: f64,
    /// Each corner, in the order of the views.
    pub corners: Vec<CornerReport>,
}

/// Corrects a pose by one or more corner pictures.
///
/// # Errors
/// Where there is no view, or a corner is not before its camera.
pub fn refine(
    located: Rigid<Base, Panel>,
    camera: &PinholeCamera,
    views: &[CornerView<'_>],
) -> Result<Refined, RefineError> {
    let seen = views
        .iter()
        .enumerate()
        .map(|(index, view)| {
            look(located, camera, view).map_err(|depth_mm| RefineError::NotInView { picture: index + 1, depth_mm })
        })
        .collect::<Result<Vec<_>, _>>()?;
    let first = seen.first().ok_or(RefineError::NoView)?;
    let base_from_base = common_motion(&seen);
    let moved = |seen: &Seen| (base_from_base * seen.point - seen.point).mm;
    let along = |seen: &Seen| [moved(seen).dot(&seen.right.mm), moved(seen).dot(&seen.down.mm)];
    let report = |seen: &Seen| {
        let [right, down] = along(seen);
        CornerReport {
            expected_px: seen.expected_px,
            error_px: seen.error_px,
            shift_mm: seen.shift_mm,
            left_mm: (seen.shift_mm[0] - right).hypot(seen.shift_mm[1] - down),
        }
    };
    Ok(Refined {
        base_from_panel: base_from_base * located,
        shift_mm: along(first),
        turned: base_from_base.turn(),
        error_px: seen.iter().map(|seen| seen.error_px).fold(0.0, f64::max),
        corners: seen.iter().map(report).collect(),
    })
}

struct Seen {
    point: Point<Base>,
    forward: Vector<Base>,
    expected_px: Pixel,
    error_px: f64,
    shift_mm: [f64; 2],
    right: Vector<Base>,
    down: Vector<Base>,
}

/// One corner by itself; the depth where that is not in view.
fn look(located: Rigid<Base, Panel>, camera: &PinholeCamera, view: &CornerView<'_>) -> Result<Seen, f64> {
    let expected: Point<FlangeCamera> = view.base_from_camera.inverse() * (located * view.taught.point);
    let depth_mm = expected.mm.z;
    let expected_px = camera.project(expected).ok_or(depth_mm)?;
    let found: Vector<FlangeCamera> = camera.unproject(view.found_px).ok_or(depth_mm)?;
    let shift_mm = [depth_mm * found.mm.x - expected.mm.x, depth_mm * found.mm.y - expected.mm.y]; // Eq. 3.23
    let axis = |axis: Vector3<f64>| view.base_from_camera * Vector::new(axis);
    Ok(Seen {
        point: located * view.taught.point,
        forward: axis(Vector3::z()),
        expected_px,
        error_px: view.found_px.distance_px(expected_px),
        shift_mm,
        right: axis(Vector3::x()),
        down: axis(Vector3::y()),
    })
}

/// The motion that fits all corners best; for one corner, the shift by Δ along its camera's axes (Eq. 3.24, seen from the
/// base).
fn common_motion(seen: &[Seen]) -> Rigid<Base, Base> {
    let count = seen.len().max(1) as f64;
    let middle = seen.iter().map(|view| view.point.mm.coords).sum::<Vector3<f64>>() / count;
    let about = seen.iter().map(|view| view.forward.mm).sum::<Vector3<f64>>().try_normalize(1e-6);
    let apart_mm =
        (seen.iter().map(|view| (view.point.mm.coords - middle).norm_squared()).sum::<f64>() / count).sqrt();
    let about = about.filter(|_| apart_mm >= MIN_APART_MM).unwrap_or_else(Vector3::zeros);
    let radius_mm = apart_mm.max(MIN_APART_MM);
    let (mut weight, mut wanted) = (Matrix4::zeros(), Vector4::zeros());
    for view in seen {
        let turned = about.cross(&(view.point.mm.coords - middle)) / radius_mm;
        for (axis, shift_mm) in [(view.right.mm, view.shift_mm[0]), (view.down.mm, view.shift_mm[1])] {
            let row = Vector4::new(axis.x, axis.y, axis.z, axis.dot(&turned));
            weight += row * row.transpose();
            wanted += row * shift_mm;
        }
    }
    let eigen = weight.symmetric_eigen();
    let part = |i: usize| {
        let direction = eigen.eigenvectors.column(i).into_owned();
        let seen = eigen.eigenvalues[i] >= MIN_WEIGHT;
        if seen { direction * (direction.dot(&wanted) / eigen.eigenvalues[i]) } else { Vector4::zeros() }
    };
    let motion: Vector4<f64> = (0..4).map(part).sum();
    let turn = UnitQuaternion::from_scaled_axis(about * (motion.w / radius_mm));
    Rigid::claim(Isometry3::from_parts(Translation3::from(middle + motion.xyz() - turn * middle), turn))
}

/// Judges a correction by the recipe's limit.
pub fn judge(refined: &Refined, limits: &recipe::Corner) -> Judgement {
    let allowed = limits.max_correction_mm();
    let too_far = |(index, corner): (usize, &CornerReport)| {
        let asked_mm = corner.shift_mm[0].hypot(corner.shift_mm[1]);
        (asked_mm.is_nan() || asked_mm > allowed).then(|| {
            Reason::new(
                "correction_limit",
                format!(
                    "corner {} stands {asked_mm:.2} mm ({:.1} px) from where the 3D scan puts it, allowed are \
                     {allowed:.2} mm; has the panel moved since the scan, is the flange pose the picture's?",
                    index + 1,
                    corner.error_px
                ),
            )
        })
    };
    let left_mm = refined.corners.iter().map(|corner| corner.left_mm).fold(0.0, f64::max);
    let unlike = (left_mm.is_nan() || left_mm > MAX_LEFT_MM).then(|| {
        Reason::new(
            "corners_disagree",
            format!(
                "with the best correction a corner still stands {left_mm:.2} mm from where it is seen, allowed are \
                 {MAX_LEFT_MM} mm; is each picture of its own corner, are the flange poses theirs?"
            ),
        )
    });
    Judgement::of(refined.corners.iter().enumerate().filter_map(too_far).collect(), unlike.into_iter().collect())
}

/// A corner's own error in the plane of its camera, 95 %: edges to a tenth of a pixel, taught and found, mm.
const CORNER_CLAIM_MM: f64 = 0.05;

/// Where a corner stands farther from where the 3D scan puts it than both claim, that is a finding and not a mean.
/// `claims_mm` are what else is claimed, 95 % each: the localization's and both calibrations'.
pub fn disagreement(refined: &Refined, claims_mm: &[f64]) -> Option<Reason> {
    let claimed_mm = claims_mm.iter().map(|mm| mm * mm).sum::<f64>().sqrt().hypot(CORNER_CLAIM_MM);
    let asked = refined.corners.iter().map(|corner| corner.shift_mm[0].hypot(corner.shift_mm[1]));
    let (index, asked_mm) = asked.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    // Twice what 95 % stay below: one in ten thousand is beyond it by chance.
    (asked_mm > 2.0 * claimed_mm).then(|| {
        Reason::new(
            "corner_disagrees",
            format!(
                "corner {} stands {asked_mm:.2} mm from where the 3D scan puts it; scan, corner and calibrations together \
                 claim {claimed_mm:.2} mm (95 %): one of them is wrong, verify the calibrations",
                index + 1
            ),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panel::CornerTeaching;
    use crate::verdict::Verdict;
    use nalgebra::Isometry3;
    use proptest::prelude::*;

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

    /// Looks along the base's X with its Y down: its X is the base's −Y, its Y the base's −Z.
    fn looks_along_x(at: Point<Base>) -> Rigid<Base, FlangeCamera> {
        Rigid::from_axes([-Vector3::y(), -Vector3::z(), Vector3::x()].map(Vector::new), at)
    }

    fn taught(
        point: Point<Panel>,
        base_from_camera: Rigid<Base, FlangeCamera>,
        camera: &PinholeCamera,
    ) -> TaughtCorner {
        let panel_from_camera = crate::panel::panel_from_base_at_teaching() * base_from_camera;
        let reference_px = camera.project(panel_from_camera.inverse() * point).expect("in front");
        TaughtCorner {
            teaching: CornerTeaching { reference_px, panel_from_camera },
            point,
            normal: Vector::new(-Vector3::x()),
        }
    }

    /// By hand: camera at (320, 0, 360) looks along the base's X at a corner 240 mm away, f = 2400 px: 10 px are 1 mm. Found
    /// 24 px to the right and 10 px up, the panel stands 2.4 mm to the right, base −Y, and 1 mm up, base +Z.
    #[test]
    fn a_corner_to_the_right_moves_the_panel_to_the_right() {
        let base_from_camera = looks_along_x(Point::at(320.0, 0.0, 360.0));
        let corner = taught(Point::at(560.0, 0.0, 360.0), base_from_camera, &CAMERA);
        let nominal = crate::panel::panel_from_base_at_teaching().inverse();
        let view = CornerView { taught: &corner, base_from_camera, found_px: Pixel::at(1048.0, 758.0) };
        let refined = refine(nominal, &CAMERA, &[view]).expect("in view");
        assert!((refined.base_from_panel.origin().mm.coords - Vector3::new(0.0, -2.4, 1.0)).norm() < 1e-9);
        assert!((refined.shift_mm[0] - 2.4).abs() < 1e-9 && (refined.shift_mm[1] + 1.0).abs() < 1e-9);
        assert!((refined.error_px - 26.0).abs() < 1e-9, "√(24² + 10²) = 26 px: {}", refined.error_px);
        assert!(refined.corners[0].left_mm < 1e-9);
    }

    /// By hand: cameras along X and along −Y, both 240 mm away. The first asks for 1 mm in −Y and 1 mm up, the second for
    /// 2 mm in −X and 2 mm up: together (−2, −1, 1.5), with 0.5 mm left of each.
    #[test]
    fn two_corners_share_the_difference() {
        let along_x = looks_along_x(Point::at(320.0, 0.0, 360.0));
        let along_minus_y: Rigid<Base, FlangeCamera> = Rigid::from_axes(
            [-Vector3::x(), -Vector3::z(), -Vector3::y()].map(Vector::new),
            Point::at(560.0, 240.0, 360.0),
        );
        let corner = Point::at(560.0, 0.0, 360.0);
        let (first, second) = (taught(corner, along_x, &CAMERA), taught(corner, along_minus_y, &CAMERA));
        let views = [
            CornerView { taught: &first, base_from_camera: along_x, found_px: Pixel::at(1034.0, 758.0) },
            CornerView { taught: &second, base_from_camera: along_minus_y, found_px: Pixel::at(1044.0, 748.0) },
        ];
        let nominal = crate::panel::panel_from_base_at_teaching().inverse();
        let refined = refine(nominal, &CAMERA, &views).expect("in view");
        let shift = refined.base_from_panel.origin().mm.coords;
        assert!((shift - Vector3::new(-2.0, -1.0, 1.5)).norm() < 1e-9, "{shift}");
        assert!(refined.corners.iter().all(|corner| (corner.left_mm - 0.5).abs() < 1e-9), "{:?}", refined.corners);
    }

    /// By hand: a camera 100 mm before the surface and 100 mm aside sees sin 45° of a move along the normal.
    #[test]
    fn a_slanted_view_sees_a_part_of_a_move_along_the_normal() {
        let corner =
            |y: f64| taught(Point::at(560.0, 0.0, 360.0), looks_along_x(Point::at(460.0, y, 360.0)), &CAMERA);
        assert!((corner(100.0).normal_seen() - 0.5f64.sqrt()).abs() < 1e-9);
        assert!(corner(0.0).normal_seen() < 1e-9);
    }

    /// By hand: corners 200 mm apart, both cameras look along X. Turned by 0.01 rad about X the one goes 1 mm up, the other
    /// 1 mm down; both go 0.5 mm to the right.
    #[test]
    fn two_corners_apart_turn_the_panel() {
        let nominal = crate::panel::panel_from_base_at_teaching().inverse();
        let at = |y: f64| looks_along_x(Point::at(320.0, y, 360.0));
        let corners = [100.0, -100.0].map(|y| taught(Point::at(560.0, y, 360.0), at(y), &CAMERA));
        let seen = |index: usize, y: f64, up_px: f64| CornerView {
            taught: &corners[index],
            base_from_camera: at(y),
            found_px: Pixel::at(1024.0 + 5.0, 768.0 - up_px),
        };
        let refined = refine(nominal, &CAMERA, &[seen(0, 100.0, 10.0), seen(1, -100.0, -10.0)]).expect("in view");
        assert!((refined.turned.rad() - 0.01).abs() < 1e-6, "{refined:?}");
        let first = (refined.base_from_panel * corners[0].point).mm;
        assert!((first.y - 99.5).abs() < 0.01 && (first.z - 361.0).abs() < 0.01, "{first}");
        assert!(refined.corners.iter().all(|corner| corner.left_mm < 0.01), "{refined:?}");
        // 1 mm and 0.2 mm claimed together are 1.02 mm; √(1² + 0.5²) = 1.118 mm is not twice that, of 0.3 mm it is.
        assert_eq!(disagreement(&refined, &[1.0, 0.2]), None);
        assert_eq!(disagreement(&refined, &[0.3]).expect("a finding").code, "corner_disagrees");
    }

    /// By hand: the same two corners, each seen 1 mm towards the other: no rigid panel does that.
    #[test]
    fn corners_that_no_rigid_panel_has_are_a_finding() {
        let nominal = crate::panel::panel_from_base_at_teaching().inverse();
        let at = |y: f64| looks_along_x(Point::at(320.0, y, 360.0));
        let corners = [100.0, -100.0].map(|y| taught(Point::at(560.0, y, 360.0), at(y), &CAMERA));
        let seen = |index: usize, y: f64, right_px: f64| CornerView {
            taught: &corners[index],
            base_from_camera: at(y),
            found_px: Pixel::at(1024.0 + right_px, 768.0),
        };
        let refined = refine(nominal, &CAMERA, &[seen(0, 100.0, 10.0), seen(1, -100.0, -10.0)]).expect("in view");
        assert!(refined.corners.iter().all(|corner| (corner.left_mm - 1.0).abs() < 1e-6), "{refined:?}");
        let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
                    [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n";
        let recipe = recipe::Recipe::check("test.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
        let judgement = judge(&refined, recipe.corner());
        assert_eq!((judgement.verdict, judgement.reasons[0].code.as_ref()), (Verdict::Review, "corners_disagree"));
    }

    #[test]
    fn a_wrong_flange_pose_is_an_error_and_a_large_correction_a_reject() {
        let base_from_camera = looks_along_x(Point::at(320.0, 0.0, 360.0));
        let corner = taught(Point::at(560.0, 0.0, 360.0), base_from_camera, &CAMERA);
        let nominal = crate::panel::panel_from_base_at_teaching().inverse();
        let beyond = looks_along_x(Point::at(900.0, 0.0, 360.0));
        let view =
            |base_from_camera, u| CornerView { taught: &corner, base_from_camera, found_px: Pixel::at(u, 768.0) };
        let error = refine(nominal, &CAMERA, &[view(beyond, 1024.0)]).expect_err("behind");
        assert_eq!(error, RefineError::NotInView { picture: 1, depth_mm: -340.0 });
        assert_eq!(refine(nominal, &CAMERA, &[]), Err(RefineError::NoView));

        let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
                    [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n[corner]\nmax_correction_mm = 8.0\n";
        let recipe = recipe::Recipe::check("test.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
        let verdict = |u| {
            let refined = refine(nominal, &CAMERA, &[view(base_from_camera, u)]).expect("in view");
            judge(&refined, recipe.corner())
        };
        assert_eq!(verdict(1024.0 + 79.0).reasons, []);
        assert_eq!(verdict(1024.0 + 81.0).reasons[0].code, "correction_limit");
    }

    proptest! {
        /// From any camera pose near the taught one: after the correction the corner projects to where it was found; the
        /// expected pixel at newCP (Eq. 3.22) is the taught reference pixel; and the shift is Eq. 3.24 as printed.
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
            let nominal_camera = looks_along_x(Point::at(325.0, -140.0, 455.0));
            let corner = taught(Point::at(560.0, -150.0, 460.0), nominal_camera, &camera);
            let located: Rigid<Base, Panel> = Rigid::claim(small(moved, 20.0, 0.1));
            let new_pose = located * corner.teaching.panel_from_camera; // Eq. 3.22
            let at_new_pose = CornerView { taught: &corner, base_from_camera: new_pose, found_px: Pixel::at(u, v) };
            let refined = refine(located, &camera, &[at_new_pose]).expect("in view");
            let expected = refined.corners[0].expected_px;
            prop_assert!(expected.distance_px(corner.teaching.reference_px) < 1e-6);

            let [x, y] = refined.shift_mm;
            let new_from_refined = Isometry3::translation(x, y, 0.0);
            let turn = (located.inverse() * new_pose).isometry().rotation; // Eq. 3.25
            let printed = located.isometry() * turn * new_from_refined * turn.inverse(); // Eq. 3.24
            let printed: Rigid<Base, Panel> = Rigid::claim(printed);
            prop_assert!(printed.distance_at_mm(refined.base_from_panel, corner.point) < 1e-9);

            let base_from_camera = new_pose * Rigid::<FlangeCamera, FlangeCamera>::claim(small(off, 5.0, 0.017));
            let view = CornerView { base_from_camera, ..at_new_pose };
            let refined = refine(located, &camera, &[view]).expect("in view");
            let seen = camera.project(base_from_camera.inverse() * (refined.base_from_panel * corner.point));
            prop_assert!(seen.expect("in front").distance_px(Pixel::at(u, v)) < 1e-6);
        }

        /// The largest turn found by the corner alone is none.
        #[test]
        fn nothing_is_turned(u in 700.0..1300.0f64, moved in prop::array::uniform3(-0.2..0.2f64)) {
            let base_from_camera = looks_along_x(Point::at(320.0, 0.0, 360.0));
            let corner = taught(Point::at(560.0, 0.0, 360.0), base_from_camera, &CAMERA);
            let located: Rigid<Base, Panel> = Rigid::claim(Isometry3::new(Vector3::zeros(), moved.into()));
            let view = CornerView { taught: &corner, base_from_camera, found_px: Pixel::at(u, 700.0) };
            if let Ok(refined) = refine(located, &CAMERA, &[view]) {
                let turned: Rigid<Panel, Panel> = located.inverse() * refined.base_from_panel;
                prop_assert!(turned.turn().0 < 1e-6);
            }
        }
    }
}
