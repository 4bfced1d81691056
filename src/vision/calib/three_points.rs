//! Hand-eye calibration with three touched points (thesis 3.7, Eq. 3.14–3.19), with the checks that are possible.
//!
//! The pointer touches three corners of the board. The frame through them (Eq. 3.14–3.17, Z normalised) is built twice,
//! from the touched points and from the positions of these corners on the board, so that any three corners may be
//! touched:
//!     base_from_board = base_from_frame · frame_from_board,   to_from_camera = to_from_board · board_from_camera.
//! A wrong corner is not visible in the picture, since its error cancels in the chain. Three comparisons reveal it: the
//! distances between the touched points, a rough mount if one is known, and a fourth touched corner, which gives the
//! only true residual. Four corners of a rectangle look the same from its other end: the fourth corner reveals this
//! only if it breaks the symmetry. If a person counts all four corners from the other end, their distances are still
//! right: only a rough mount reveals this error.

use super::chain::{Arrangement, board_pose};
use super::error::CalibError;
use super::{Board, BoardObservation};
use nalgebra::Isometry3;
use panelprep_base::geometry::{Base, Board as BoardFrame, Flange, Frame, PinholeCamera, Point, Rigid, Vector};
use panelprep_base::number_text::distinguishable_texts;

/// A touched corner of the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchedCorner {
    /// Column and row of the corner, from 0.
    pub corner: (usize, usize),
    /// The position of the pointer's tip.
    pub place: Point<Base>,
}

/// A mount from three touched points, with its evidence.
#[derive(Debug, Clone)]
pub struct ThreePoints<A: Arrangement> {
    /// The camera mount.
    pub to_from_camera: Rigid<A::To, A::From>,
    /// The pose of the board when it was touched.
    pub base_from_board: Rigid<Base, BoardFrame>,
    /// Root mean square distance of the board's corners in the picture from their computed pixels, px.
    pub pnp_rms_px: f64,
    /// Touched minus nominal distance between the points 1–2, 2–3 and 1–3, mm.
    pub distance_errors_mm: [f64; 3],
    /// Distance of the fourth touched corner from its position according to the other three, mm.
    pub check_mm: Option<f64>,
    /// Whether the distances would be the same if the corners were touched from another end of the board.
    pub is_symmetric: bool,
}

/// Minimum sine of the three angles; with a smaller one the three points are treated as collinear.
const MIN_SINE: f64 = 0.1;
/// Minimum distance between touched points, in squares.
const MIN_DISTANCE_SQUARES: f64 = 2.5;

/// Calibrates a camera mount. `touched` contains three corners and, as the fourth, an optional check;
/// `base_from_flange` is the flange pose of the picture, used if the camera is on the flange.
///
/// # Errors
/// If a corner is not on the board, the points are collinear or too close, or the picture gives no pose.
pub fn three_points<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    seen: &BoardObservation<A::From>,
    touched: &[TouchedCorner],
    base_from_flange: Option<Rigid<Base, Flange>>,
) -> Result<ThreePoints<A>, CalibError> {
    let [first, second, third, ..] = touched else {
        return Err(CalibError::Points(format!("{} points were touched; at least 3 are needed", touched.len())));
    };
    let on_board = |touched: &TouchedCorner| {
        let (column, row) = touched.corner;
        board.corner(column, row).ok_or_else(|| {
            let (columns, rows) = (board.columns(), board.rows());
            CalibError::Points(format!(
                "corner [{column}, {row}] is not on the board; the limits are [0, 0] to [{}, {}]",
                columns - 1,
                rows - 1
            ))
        })
    };
    let corners = [on_board(first)?, on_board(second)?, on_board(third)?];
    let places = [first.place, second.place, third.place];
    let base_from_frame =
        frame_from_points::<Base>(places, MIN_DISTANCE_SQUARES * board.square_mm(), "touched points")?;
    let board_from_frame =
        frame_from_points::<BoardFrame>(corners, MIN_DISTANCE_SQUARES * board.square_mm(), "named corners")?;
    let base_from_board: Rigid<Base, BoardFrame> =
        Rigid::from_isometry_unchecked(base_from_frame * board_from_frame.inverse());
    let pose = board_pose(camera, seen)?;
    // Eq. 3.18 and 3.19: the camera is on the flange, or fixed in the base.
    let to_from_base: Isometry3<f64> = match (A::EYE_IN_HAND, base_from_flange) {
        (false, _) => Isometry3::identity(),
        (true, Some(base_from_flange)) => *base_from_flange.inverse().isometry(),
        (true, None) => {
            let message = "base_from_flange of the picture is missing; a camera on the flange requires it";
            return Err(CalibError::Points(message.to_owned()));
        }
    };
    let to_from_board = to_from_base * base_from_board.isometry();
    let check_mm = match touched.get(3) {
        Some(check) => Some((base_from_board * on_board(check)?).distance_mm(check.place)),
        None => None,
    };
    let error = |a: usize, b: usize| places[a].distance_mm(places[b]) - corners[a].distance_mm(corners[b]);
    Ok(ThreePoints {
        to_from_camera: Rigid::from_isometry_unchecked(to_from_board * pose.camera_from_board.isometry().inverse()),
        base_from_board,
        pnp_rms_px: pose.rms,
        distance_errors_mm: [error(0, 1), error(1, 2), error(0, 2)],
        check_mm,
        is_symmetric: board.is_symmetric(&touched.iter().map(|touched| touched.corner).collect::<Vec<_>>()),
    })
}

/// Returns the frame with its origin in the first point, X towards the second, and the third point on the side of Y
/// (Eq. 3.14–3.17, Z normalised).
fn frame_from_points<F: Frame>(
    points: [Point<F>; 3],
    apart_mm: f64,
    what: &str,
) -> Result<Isometry3<f64>, CalibError> {
    let sides = [(0, 1), (1, 2), (0, 2)].map(|(a, b)| points[a].distance_mm(points[b]));
    let shortest = sides.iter().copied().fold(f64::INFINITY, f64::min);
    if shortest < apart_mm {
        let [shortest, needed] = distinguishable_texts(shortest, apart_mm, 1);
        let message = format!("two {what} are {shortest} mm apart; at least {needed} mm are needed");
        return Err(CalibError::Points(message));
    }
    let flat = || {
        CalibError::Points(format!(
            "the three {what} lie on one line (sine of the angle below {MIN_SINE}); take corners that span the board"
        ))
    };
    let x = (points[1] - points[0]).mm.normalize(); // Eq. 3.14
    let v = (points[2] - points[0]).mm.normalize();
    let z = x.cross(&v); // Eq. 3.15
    // The smallest of the three sines is used: two points may be close to each other as seen from the third.
    let w = (points[2] - points[1]).mm.normalize();
    if z.norm().min(x.cross(&w).norm()).min(v.cross(&w).norm()) < MIN_SINE {
        return Err(flat());
    }
    let z = z.normalize();
    let y = z.cross(&x); // Eq. 3.16
    let frame: Rigid<F, F> = Rigid::from_axes([x, y, z].map(Vector::new), points[0]); // Eq. 3.17
    Ok(*frame.isometry())
}

#[cfg(test)]
mod tests {
    //! Tests of mounts from three touched points, for both kinds of mount.

    use super::{TouchedCorner, three_points};
    use crate::calib::{Board, BoardObservation, CalibError, gate};
    use panelprep_base::geometry::{Base, Board as BoardFrame, Point, Rigid};
    use panelprep_base::verdict::Verdict;
    use panelprep_cell::cell::{FlangeCameraMount, ScannerMount};
    use panelprep_sim::{BoardCell, BoardPrint, RobotNoise};

    const NO_NOISE: RobotNoise = RobotNoise { shift_mm: 0.0, turn_deg: 0.0 };

    fn board() -> Board {
        Board::parse("9x6", 25.0).expect("a board")
    }

    fn cell() -> BoardCell {
        BoardCell::new(1, BoardPrint::chessboard(9, 6, 25.0), NO_NOISE)
    }

    fn touched(
        cell: &BoardCell,
        base_from_board: &Rigid<Base, BoardFrame>,
        corners: &[(usize, usize)],
        noise_mm: f64,
    ) -> Vec<TouchedCorner> {
        let places: Vec<_> = corners.iter().map(|&(c, r)| board().corner(c, r).expect("on the board")).collect();
        let touched = cell.touch_points(base_from_board, &places, noise_mm);
        corners.iter().zip(touched).map(|(&corner, place)| TouchedCorner { corner, place }).collect()
    }

    fn codes(judgement: &panelprep_base::verdict::Judgement) -> Vec<&str> {
        judgement.reasons.iter().map(|reason| &*reason.code).collect()
    }

    /// Without noise the true mount is found, for both cameras and for corners that are not on the axes of the board.
    #[test]
    fn the_true_mount_is_found() {
        let cell = cell();
        let (camera, shot) = (cell.scanner(), cell.fixed_shots(1)[0]);
        let base_from_board = cell.base_from_camera() * shot.camera_from_board;
        let seen = BoardObservation::Pixels(cell.corners(&camera, &shot, 0.0));
        for corners in [board().corners_to_touch(), board().outer_corners(), [(8, 5), (0, 4), (3, 0), (0, 0)]] {
            let touched = touched(&cell, &base_from_board, &corners, 0.0);
            let found = three_points::<ScannerMount>(&camera, &board(), &seen, &touched, None).expect("calibrated");
            let error = found.to_from_camera.distance_at_mm(cell.base_from_camera(), cell.panel_middle());
            assert!(error < 1e-3 && found.pnp_rms_px < 1e-3, "{error} mm");
            assert!(found.check_mm.is_some_and(|check| check < 1e-6), "{:?}", found.check_mm);
            let expected: &[&str] = if found.is_symmetric { &["no_check_point"] } else { &[] };
            assert_eq!(codes(&gate::three_points(&found, None)), expected);
        }
        let (camera, shot) = (cell.flange_camera(), cell.flange_shots(1)[0]);
        let seen = BoardObservation::Pixels(cell.corners(&camera, &shot, 0.0));
        let touched = touched(&cell, &cell.base_from_board(), &board().corners_to_touch()[..3], 0.0);
        let flange = Some(shot.base_from_flange);
        let found =
            three_points::<FlangeCameraMount>(&camera, &board(), &seen, &touched, flange).expect("calibrated");
        let error = found.to_from_camera.distance_at_mm(cell.flange_from_camera(), Point::at(0.0, 0.0, 500.0));
        assert!(error < 1e-3, "{error} mm");
        let missing = three_points::<FlangeCameraMount>(&camera, &board(), &seen, &touched, None);
        assert!(missing.expect_err("no flange").to_string().contains("base_from_flange"));
    }

    /// A reported case: outer corners that were touched in the order 3, 4, 1, 2 cause no error in the distances.
    /// Without a rough mount the verdict is review, with a rough mount it is reject. With a fourth corner that breaks
    /// the symmetry the error is several squares.
    #[test]
    fn outer_corners_touched_from_the_other_end_are_not_accepted() {
        let cell = cell();
        let (camera, shot) = (cell.scanner(), cell.fixed_shots(1)[0]);
        let base_from_board = cell.base_from_camera() * shot.camera_from_board;
        let seen = BoardObservation::Pixels(cell.corners(&camera, &shot, 0.0));
        let mistaken = |corners: [(usize, usize); 4], for_corners: [(usize, usize); 4]| {
            let mut touched = touched(&cell, &base_from_board, &corners, 0.0);
            touched.iter_mut().zip(for_corners).for_each(|(touched, corner)| touched.corner = corner);
            three_points::<ScannerMount>(&camera, &board(), &seen, &touched, None).expect("calibrated")
        };
        let [first, second, third, fourth] = board().outer_corners();
        let outer = mistaken([third, fourth, first, second], [first, second, third, fourth]);
        assert!(outer.check_mm.is_some_and(|check| check < 1e-6));
        assert_eq!(codes(&gate::three_points(&outer, None)), ["no_check_point"]);
        let rough = Some(cell.base_from_camera());
        assert!(codes(&gate::three_points(&outer, rough.as_ref())).contains(&"rough_mount"));
        let [.., inner] = board().corners_to_touch();
        let inner = mistaken([third, fourth, first, inner], [first, second, third, inner]);
        assert!(inner.check_mm.is_some_and(|check| check > 25.0), "{:?}", inner.check_mm);
        assert_eq!(gate::three_points(&inner, None).verdict, Verdict::Reject);
    }

    /// A board touched from its far corner has the same reprojection error as a correct one: only a rough mount reveals
    /// the error.
    #[test]
    fn a_wrong_origin_is_found_by_the_rough_mount_and_a_wrong_corner_by_the_distances() {
        let cell = cell();
        let (camera, shot) = (cell.scanner(), cell.fixed_shots(1)[0]);
        let base_from_board = cell.base_from_camera() * shot.camera_from_board;
        let seen = BoardObservation::Pixels(cell.corners(&camera, &shot, 0.0));
        let mut turned = touched(&cell, &base_from_board, &[(8, 5), (0, 5), (0, 0)], 0.0);
        for (touched, corner) in turned.iter_mut().zip([(0, 0), (8, 0), (8, 5)]) {
            touched.corner = corner;
        }
        let found = three_points::<ScannerMount>(&camera, &board(), &seen, &turned, None).expect("calibrated");
        assert!(found.pnp_rms_px < 1e-3 && found.distance_errors_mm.iter().all(|error| error.abs() < 1e-6));
        let off_mm = found.to_from_camera.distance_at_mm(cell.base_from_camera(), Point::at(0.0, 0.0, 0.0));
        assert!(off_mm > 200.0, "{off_mm}");
        assert_eq!(codes(&gate::three_points(&found, None)), ["no_check_point"]);
        assert_eq!(codes(&gate::three_points(&found, Some(&cell.base_from_camera()))), ["rough_mount"]);

        let mut wrong = touched(&cell, &base_from_board, &[(0, 0), (7, 0), (8, 5), (0, 5)], 0.0);
        wrong[1].corner = (8, 0);
        let found = three_points::<ScannerMount>(&camera, &board(), &seen, &wrong, None).expect("calibrated");
        assert!((found.distance_errors_mm[0] + 25.0).abs() < 1e-6, "{:?}", found.distance_errors_mm);
        assert_eq!(gate::three_points(&found, None).verdict, Verdict::Reject);
    }

    #[test]
    fn points_that_determine_no_frame_are_refused() {
        let cell = cell();
        let (camera, shot) = (cell.scanner(), cell.fixed_shots(1)[0]);
        let base_from_board = cell.base_from_camera() * shot.camera_from_board;
        let seen = BoardObservation::Pixels(cell.corners(&camera, &shot, 0.0));
        let refused = |corners: &[(usize, usize)]| {
            let touched = touched(&cell, &base_from_board, corners, 0.0);
            let error =
                three_points::<ScannerMount>(&camera, &board(), &seen, &touched, None).expect_err("refused");
            assert!(matches!(error, CalibError::Points(_)));
            error.to_string()
        };
        assert!(refused(&[(0, 0), (4, 0), (8, 0)]).contains("on one line"));
        assert!(refused(&[(0, 0), (1, 0), (8, 5)]).contains("apart"));
        assert!(refused(&[(0, 0), (8, 0)]).contains("3 are needed"));
        let off = vec![TouchedCorner { corner: (9, 0), place: Point::at(0.0, 0.0, 0.0) }; 3];
        let error = three_points::<ScannerMount>(&camera, &board(), &seen, &off, None).expect_err("no such corner");
        assert!(error.to_string().contains("[0, 0] to [8, 5]"), "{error}");
    }
}
