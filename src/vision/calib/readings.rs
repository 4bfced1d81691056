//! Finds the probable intended meaning of poses that match no camera mount.
//!
//! Programs write a pose in many ways: inverted, with other angles, as a rotation vector, one picture late. Each of
//! these interpretations is applied to all poses, and the closed-form mount of `adjust` is calculated with it. With the
//! right interpretation the residual is tenths of a millimetre, with any other one centimetres, so that the matching
//! one can be reported. The file is not changed: a person must correct it.
//!
//! Some errors have the same effect and are reported together. A mount of the other kind has the same equations as
//! inverted poses. Left-handed axes are a point reflection up to a rotation of base and flange: each position is
//! negated. Poses in a base frame or of a tool match as well as correct ones: only the rough mount of the cell's file
//! shows this error.
//!
//! If the ratio k of robot to board lengths is an unknown, the linear part of the closed form also determines k. For
//! stations i, j
//!     (Hᵢ − Hⱼ) x + k (Hᵢ X bᵢ − Hⱼ X bⱼ) = hⱼ − hᵢ,                                                            (1)
//! with the moving factor (H, h) of the chain, the mount (X, x) and the position b of the board.

use super::adjust::{MIN_START_ROTATION_RAD, index_triples, second_axis_deg};
use super::board::Board;
use super::chain::{Arrangement, BoardObservation, BoardPose, Station, board_pose};
use super::error::{PoseInterpretation, PoseReading};
use super::foreign;
use super::tool::tool_point;
use nalgebra::{Isometry3, Matrix4, Point3, Quaternion, Translation3, UnitQuaternion, Vector3, Vector4};
use panelprep_base::geometry::{Base, Degrees, Flange, KukaPose, PinholeCamera, Pixel, Point, Rigid, median};
use rayon::prelude::*;

/// Maximum number of triples of stations that are tried for each interpretation.
const MAX_TRIPLES: usize = 120;
/// Maximum residual of a matching interpretation, mm.
const MAX_FIT_RESIDUAL_MM: f64 = 5.0;
/// Maximum ratio of the residual of a matching interpretation to that of the poses as written.
const MAX_ERROR_RATIO: f64 = 0.2;
/// Maximum ratio of the residual of an interpretation to the smallest one, for both to be reported together.
const MAX_RATIO_TO_BEST: f64 = 3.0;

/// Returns the interpretations that match these stations, the best first; empty if the poses match as written, or if no
/// interpretation matches.
pub(super) fn fitting_readings<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    stations: &[Station<A::From>],
    poses: &[BoardPose<A::From>],
) -> Vec<PoseReading> {
    let flanges: Vec<Isometry3<f64>> =
        stations.iter().map(|station| *station.base_from_flange.isometry()).collect();
    let seen: Vec<Isometry3<f64>> = poses.iter().map(|pose| *pose.camera_from_board.isometry()).collect();
    let rim: Vec<Point3<f64>> =
        board.outer_corners().iter().filter_map(|&(column, row)| Some(board.corner(column, row)?.mm)).collect();
    let leaves = |flanges: &[Isometry3<f64>], seen: &[Isometry3<f64>], free: bool| {
        let moved: Vec<Isometry3<f64>> = flanges
            .iter()
            .map(|pose| *A::to_from_holder(&Rigid::from_isometry_unchecked(pose.inverse())).isometry())
            .collect();
        // `to_from_holder` of the inverse is the inverse of `to_from_holder`: (1) needs holder_from_to.
        closed_form(&moved, seen, &rim, free)
    };
    let Some(as_read) = leaves(&flanges, &seen, false) else { return Vec::new() };
    let mut tried: Vec<(PoseInterpretation, ClosedForm)> = pose_interpretations()
        .into_par_iter()
        .filter_map(|(meaning, way)| {
            let read: Vec<Isometry3<f64>> = flanges.iter().map(&way).collect();
            Some((meaning, leaves(&read, &seen, false)?))
        })
        .collect();
    if let Some((_, found)) =
        tried.iter().find(|(meaning, _)| matches!(meaning, PoseInterpretation::Inverted { .. }))
    {
        // The flange carries either the camera or the board at a small distance; the other one is fixed in the cell.
        let camera_nearer = found.mount.translation.vector.norm() < found.board.translation.vector.norm();
        let other_mount = camera_nearer != A::EYE_IN_HAND;
        if let Some((meaning, _)) =
            tried.iter_mut().find(|(meaning, _)| matches!(meaning, PoseInterpretation::Inverted { .. }))
        {
            *meaning = PoseInterpretation::Inverted { other_mount };
        }
    }
    for late in [true, false] {
        let found = match late {
            true => leaves(&flanges[..flanges.len() - 1], &seen[1..], false),
            false => leaves(&flanges[1..], &seen[..seen.len() - 1], false),
        };
        tried.extend(found.map(|found| (PoseInterpretation::Shifted { late }, found)));
    }
    if let Some(mirrored) = mirrored_board_poses(camera, board, stations) {
        tried.extend(leaves(&flanges, &mirrored, false).map(|found| (PoseInterpretation::Mirrored, found)));
    }
    if let Some(found) = leaves(&flanges, &seen, true) {
        tried.push((PoseInterpretation::Lengths { ratio: found.ratio, square_mm: board.square_mm() }, found));
    }
    let tried: Vec<(PoseInterpretation, f64)> =
        tried.into_iter().map(|(meaning, found)| (meaning, found.median_mm)).collect();
    matching_readings(as_read.median_mm, &tried)
}

/// Returns the interpretations with which the poses keep the tip of the tool at one point, the best first; empty if the
/// poses match as written, or if no interpretation matches.
pub fn tip_readings(poses: &[Rigid<Base, Flange>]) -> Vec<PoseReading> {
    let rms_mm = |poses: &[Rigid<Base, Flange>]| Some(tool_point(poses).ok()?.rms_mm);
    let read = |way: &PoseTransform| -> Vec<Rigid<Base, Flange>> {
        poses.iter().map(|pose| Rigid::from_isometry_unchecked(way(pose.isometry()))).collect()
    };
    let Some(as_read_mm) = rms_mm(poses) else { return Vec::new() };
    let tried: Vec<(PoseInterpretation, f64)> = pose_interpretations()
        .into_iter()
        .filter_map(|(meaning, way)| Some((meaning, rms_mm(&read(&way))?)))
        .collect();
    matching_readings(as_read_mm, &tried)
}

/// Returns the matching interpretations of those that were tried, each with its residual, mm.
fn matching_readings(as_read_mm: f64, tried: &[(PoseInterpretation, f64)]) -> Vec<PoseReading> {
    let best = tried.iter().map(|(_, left_mm)| *left_mm).fold(f64::INFINITY, f64::min);
    if !(best <= MAX_FIT_RESIDUAL_MM && best <= MAX_ERROR_RATIO * as_read_mm) {
        return Vec::new();
    }
    let fits = |left_mm: f64| left_mm <= (MAX_RATIO_TO_BEST * best).min(MAX_FIT_RESIDUAL_MM);
    let others = tried.iter().map(|(_, left_mm)| *left_mm).filter(|left_mm| !fits(*left_mm));
    let next_mm = others.fold(as_read_mm, f64::min);
    let fitting = tried.iter().filter(|(_, left_mm)| fits(*left_mm));
    let mut readings: Vec<PoseReading> = fitting
        .map(|(meaning, left_mm)| PoseReading {
            interpretation: *meaning,
            median_mm: *left_mm,
            runner_up_mm: next_mm,
        })
        .collect();
    readings.sort_by(|one, other| one.median_mm.total_cmp(&other.median_mm));
    readings
}

type PoseTransform = Box<dyn Fn(&Isometry3<f64>) -> Isometry3<f64> + Send + Sync>;

/// Returns each interpretation that changes every pose separately.
fn pose_interpretations() -> Vec<(PoseInterpretation, PoseTransform)> {
    let angles =
        |words: &'static str, turn: fn([f64; 3]) -> UnitQuaternion<f64>| -> (PoseInterpretation, PoseTransform) {
            (PoseInterpretation::Angles(words), angle_convention_change(turn))
        };
    let quaternion =
        |words: &'static str, order: fn([f64; 4]) -> [f64; 4]| -> (PoseInterpretation, PoseTransform) {
            let way = move |pose: &Isometry3<f64>| {
                let [x, y, z, w] = order(pose.rotation.coords.into());
                let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
                Isometry3::from_parts(pose.translation, rotation)
            };
            (PoseInterpretation::Quaternion(words), Box::new(way))
        };
    vec![
        (PoseInterpretation::Inverted { other_mount: false }, Box::new(|pose: &Isometry3<f64>| pose.inverse())),
        (
            PoseInterpretation::Transposed,
            Box::new(|pose: &Isometry3<f64>| Isometry3::from_parts(pose.translation, pose.rotation.inverse())),
        ),
        (
            PoseInterpretation::LeftHanded,
            Box::new(|pose: &Isometry3<f64>| {
                Isometry3::from_parts(Translation3::from(-pose.translation.vector), pose.rotation)
            }),
        ),
        angles(
            "A and C are exchanged, or they are roll, pitch, yaw (about fixed X, Y, Z in this order): KUKA's A \
             rotates about Z, C about X",
            |[a, b, c]| axis_rotation('z', c) * axis_rotation('y', b) * axis_rotation('x', a),
        ),
        angles(
            "the angles rotate about X, then the new Y, then the new Z: KUKA's A, B, C rotate about Z, the new Y, \
             the new X",
            |[a, b, c]| axis_rotation('x', a) * axis_rotation('y', b) * axis_rotation('z', c),
        ),
        angles(NEW_Z, |[a, b, c]| axis_rotation('z', a) * axis_rotation('y', b) * axis_rotation('z', c)),
        angles(NEW_X_NEW_Z, |[a, b, c]| axis_rotation('z', a) * axis_rotation('x', b) * axis_rotation('z', c)),
        // In these interpretations the second angle may be up to 180°. The rotation determines only the triple with the
        // smaller second angle.
        angles(NEW_Z, |angles| {
            let [a, b, c] = equivalent_angles_rad(angles);
            axis_rotation('z', a) * axis_rotation('y', b) * axis_rotation('z', c)
        }),
        angles(NEW_X_NEW_Z, |angles| {
            let [a, b, c] = equivalent_angles_rad(angles);
            axis_rotation('z', a) * axis_rotation('x', b) * axis_rotation('z', c)
        }),
        angles("the sign of A is wrong", |[a, b, c]| kuka([-a, b, c])),
        angles("the sign of B is wrong", |[a, b, c]| kuka([a, -b, c])),
        angles("the sign of C is wrong", |[a, b, c]| kuka([a, b, -c])),
        angles("A and B are exchanged", |[a, b, c]| kuka([b, a, c])),
        angles("B and C are exchanged", |[a, b, c]| kuka([a, c, b])),
        (
            PoseInterpretation::RotationVector { radians: false },
            angle_convention_change(|angles| {
                // The rotation determines A, B, C only up to a second triple. The shorter of the two is used, since the
                // length of a rotation vector is at most 180°.
                let [written, other] = [angles, equivalent_angles_rad(angles)].map(Vector3::from);
                UnitQuaternion::from_scaled_axis(if other.norm() < written.norm() { other } else { written })
            }),
        ),
        (
            PoseInterpretation::RotationVector { radians: true },
            angle_convention_change(|angles| {
                UnitQuaternion::from_scaled_axis(Vector3::from(angles).map(f64::to_degrees))
            }),
        ),
        (PoseInterpretation::Radians, angle_convention_change(|angles| kuka(angles.map(f64::to_degrees)))),
        // A library that expects x, y, z, w received w, x, y, z, or the reverse.
        quaternion("w, x, y, z were read as x, y, z, w", |[x, y, z, w]| [y, z, w, x]),
        quaternion("x, y, z, w were read as w, x, y, z", |[x, y, z, w]| [w, x, y, z]),
    ]
}

const NEW_Z: &str =
    "the angles rotate about Z, the new Y and the new Z: KUKA's A, B, C rotate about Z, the new Y, the new X";
const NEW_X_NEW_Z: &str =
    "the angles rotate about Z, the new X and the new Z: KUKA's A, B, C rotate about Z, the new Y, the new X";

/// Returns the other A, B, C of the same rotation, rad, each from −180° to 180°.
fn equivalent_angles_rad([a, b, c]: [f64; 3]) -> [f64; 3] {
    let half = |angle: f64| if angle > 0.0 { angle - std::f64::consts::PI } else { angle + std::f64::consts::PI };
    [half(a), -half(b), half(c)]
}

fn axis_rotation(axis: char, angle: f64) -> UnitQuaternion<f64> {
    let axis = match axis {
        'x' => Vector3::x_axis(),
        'y' => Vector3::y_axis(),
        _ => Vector3::z_axis(),
    };
    UnitQuaternion::from_axis_angle(&axis, angle)
}

fn kuka([a, b, c]: [f64; 3]) -> UnitQuaternion<f64> {
    axis_rotation('z', a) * axis_rotation('y', b) * axis_rotation('x', c)
}

/// Returns the change of a pose if `turn` converts its angles A, B, C, in rad, to a rotation.
fn angle_convention_change(turn: fn([f64; 3]) -> UnitQuaternion<f64>) -> PoseTransform {
    Box::new(move |pose: &Isometry3<f64>| {
        let written: KukaPose = KukaPose::from_rigid(&Rigid::<Base, Flange>::from_isometry_unchecked(*pose));
        let angles = [written.a_deg, written.b_deg, written.c_deg].map(|angle| Degrees(angle).to_rad());
        Isometry3::from_parts(pose.translation, turn(angles))
    })
}

/// Returns the board poses for pictures that are mirrored left to right; `None` for points of a 3D camera, or if a
/// picture gives no pose.
fn mirrored_board_poses<C: panelprep_base::geometry::Frame>(
    camera: &PinholeCamera,
    board: &Board,
    stations: &[Station<C>],
) -> Option<Vec<Isometry3<f64>>> {
    let far = board.corners().iter().fold(0.0, |far: f64, q| far.max(q.mm.x));
    let pose = |station: &Station<C>| {
        let BoardObservation::Pixels(corners) = &station.observation else { return None };
        let last = camera.width_px as f64 - 1.0;
        let turned = corners
            .iter()
            .map(|(q, pixel)| (Point::at(far - q.mm.x, q.mm.y, q.mm.z), Pixel::at(last - pixel.u, pixel.v)));
        let seen = BoardObservation::<C>::Pixels(turned.collect());
        Some(*board_pose(camera, &seen).ok()?.camera_from_board.isometry())
    };
    stations.iter().map(pose).collect()
}

/// A mount from three stations, compared with all stations.
struct ClosedForm {
    median_mm: f64,
    ratio: f64,
    mount: Isometry3<f64>,
    board: Isometry3<f64>,
}

/// Returns the closed-form mount from three stations that agrees best with all stations; with `free`, the lengths of
/// board and robot may differ by a factor.
fn closed_form(
    holder_from_to: &[Isometry3<f64>],
    camera_from_board: &[Isometry3<f64>],
    rim: &[Point3<f64>],
    free: bool,
) -> Option<ClosedForm> {
    let all: Vec<[usize; 3]> = index_triples(holder_from_to.len()).collect();
    let stride = all.len().div_ceil(MAX_TRIPLES).max(1);
    let tried = all.into_iter().step_by(stride).filter_map(|triple| {
        let moved = triple.map(|index| holder_from_to[index]);
        if second_axis_deg(&moved).to_radians() < MIN_START_ROTATION_RAD {
            return None;
        }
        let seen = triple.map(|index| camera_from_board[index]);
        let mount = foreign::solve_hand_eye_park(&moved, &seen)?;
        let (ratio, mount) = if free { scaled_mount(&moved, &seen, mount)? } else { (1.0, mount) };
        let held =
            |index: usize| holder_from_to[index] * mount * scale_translation(&camera_from_board[index], ratio);
        let boards: Vec<Isometry3<f64>> = (0..holder_from_to.len()).map(held).collect();
        let rim: Vec<Point3<f64>> = rim.iter().map(|place| place * ratio).collect();
        let (board, median_mm) = medoid(&boards, &rim)?;
        Some(ClosedForm { median_mm: median_mm / ratio, ratio, mount, board })
    });
    tried.fold(None, |best: Option<ClosedForm>, next| match best {
        Some(best) if best.median_mm <= next.median_mm => Some(best),
        _ => Some(next),
    })
}

fn scale_translation(pose: &Isometry3<f64>, ratio: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(pose.translation.vector * ratio), pose.rotation)
}

/// Returns the board pose that agrees best with the others, and its median distance from them.
fn medoid(boards: &[Isometry3<f64>], rim: &[Point3<f64>]) -> Option<(Isometry3<f64>, f64)> {
    let distance = |one: &Isometry3<f64>, other: &Isometry3<f64>| {
        rim.iter().map(|place| (one * place - other * place).norm()).sum::<f64>() / rim.len() as f64
    };
    let of = |(index, board): (usize, &Isometry3<f64>)| {
        let others = boards.iter().enumerate().filter(|(other, _)| *other != index);
        let mut distances: Vec<f64> = others.map(|(_, other)| distance(board, other)).collect();
        Some((*board, median(&mut distances)?))
    };
    boards.iter().enumerate().filter_map(of).min_by(|one, other| one.1.total_cmp(&other.1))
}

/// Returns the factor k and the mount by (1); the rotation of the mount does not change.
fn scaled_mount(
    moved: &[Isometry3<f64>; 3],
    seen: &[Isometry3<f64>; 3],
    mount: Isometry3<f64>,
) -> Option<(f64, Isometry3<f64>)> {
    let (mut normal, mut pull) = (Matrix4::<f64>::zeros(), Vector4::<f64>::zeros());
    for (i, j) in [(0, 1), (1, 2), (0, 2)] {
        let [turn_i, turn_j] = [i, j].map(|at| moved[at].rotation.to_rotation_matrix().into_inner());
        let place = |at: usize| moved[at].rotation * (mount.rotation * seen[at].translation.vector);
        let mut rows = nalgebra::Matrix3x4::<f64>::zeros();
        rows.fixed_columns_mut::<3>(0).copy_from(&(turn_i - turn_j));
        rows.set_column(3, &(place(i) - place(j)));
        normal += rows.transpose() * rows;
        pull += rows.transpose() * (moved[j].translation.vector - moved[i].translation.vector);
    }
    let solved = super::adjust::scaled_inverse(&normal)? * pull;
    let ratio = solved[3];
    let mount = Isometry3::from_parts(Translation3::new(solved[0], solved[1], solved[2]), mount.rotation);
    (ratio.is_finite() && (1e-5..1e5).contains(&ratio)).then_some((ratio, mount))
}
