//! Hand-eye calibration by three touched points (thesis 3.7, Eq. 3.14–3.19), with the checks that are possible.
//!
//! The pointer touches three corners of the board. The frame through them (Eq. 3.14–3.17, Z normalised) is built
//! twice, from the touched points and from the positions of these corners on the board, so that any three corners may
//! be touched:
//!     base_from_board = base_from_frame · frame_from_board,   to_from_camera = to_from_board · board_from_camera.
//! A wrong corner cannot be noticed in the picture, since its error cancels in the chain. It shows in the distances
//! between the touched points, in a rough mount if one is known, and in a fourth touched corner, which gives the only
//! true residual. Four corners of a rectangle look the same from its other end: the fourth shows this only if it
//! breaks the symmetry. If a person counts all four corners from the other end, their distances are still right: only
//! a rough mount shows that.

use super::arrangement::Arrangement;
use super::error::CalibError;
use super::pose::board_pose;
use super::{Board, BoardObservation};
use nalgebra::Isometry3;
use panelprep_base::geometry::{Base, Board as BoardFrame, Flange, Frame, PinholeCamera, Point, Rigid, Vector};
use panelprep_base::number_text::distinguishable_texts;

/// A corner of the board that was touched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchedCorner {
    /// The corner's column and row, from 0.
    pub corner: (usize, usize),
    /// The position of the pointer's tip.
    pub place: Point<Base>,
}

/// A mount from three touched points, with its evidence.
#[derive(Debug, Clone)]
pub struct ThreePoints<A: Arrangement> {
    /// The camera's mount.
    pub to_from_camera: Rigid<A::To, A::From>,
    /// The board's pose when it was touched.
    pub base_from_board: Rigid<Base, BoardFrame>,
    /// Root mean square of the board's corners in the picture, px.
    pub pnp_rms_px: f64,
    /// Touched distance minus the board's nominal one: 1–2, 2–3, 1–3, mm.
    pub distance_errors_mm: [f64; 3],
    /// Distance of the fourth touched corner from its position by the result, mm.
    pub check_mm: Option<f64>,
    /// Whether the same corners, touched from another end of the board, would have the same distances.
    pub is_symmetric: bool,
}

/// If the sine of the angle at the first point is smaller than this, three points count as collinear.
const MIN_SINE: f64 = 0.1;
/// Minimum distance between touched points, in squares.
const MIN_SQUARES: f64 = 2.5;

/// Calibrates a camera mount. `touched` are three corners and, as the fourth, an optional check; `base_from_flange` is
/// the flange at the picture, used if the camera is on the flange.
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
    let base_from_frame = frame_from_points::<Base>(places, MIN_SQUARES * board.square_mm(), "touched points")?;
    let board_from_frame =
        frame_from_points::<BoardFrame>(corners, MIN_SQUARES * board.square_mm(), "named corners")?;
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

/// Returns the frame with its origin in the first point, X towards the second, and the third on the side of Y (Eq.
/// 3.14–3.17, Z normalised).
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
    // The flattest angle counts: two of the three may be close to each other seen from the third.
    let w = (points[2] - points[1]).mm.normalize();
    if z.norm().min(x.cross(&w).norm()).min(v.cross(&w).norm()) < MIN_SINE {
        return Err(flat());
    }
    let z = z.normalize();
    let y = z.cross(&x); // Eq. 3.16
    let frame: Rigid<F, F> = Rigid::from_axes([x, y, z].map(Vector::new), points[0]); // Eq. 3.17
    Ok(*frame.isometry())
}
