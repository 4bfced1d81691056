//! Determines from the robot poses in which rotation a symmetric board was detected.
//!
//! A grid of circles looks the same rotated by 180°, a square one by 90°; a detector then starts with the uppermost
//! corner, which is not always the same corner of the board. Between two stations i, j the flange and the board rotate
//! by the same angle,
//!     ∠(Aᵢ⁻¹ Aⱼ) = ∠((Bᵢ Tᵢ⁻¹)(Bⱼ Tⱼ⁻¹)⁻¹),                                                                       (1)
//! with flange poses A, board poses B and rotations T of the board. The rotations of three stations that satisfy (1)
//! give a mount in closed form. With this mount, each other station gets the rotation that brings its board nearest to
//! the boards of the three stations. The best solution has the least median of the distances, as in `adjust`.
//!
//! Nothing is judged here: stations without a matching rotation are not changed, and the adjustment reports them.

use super::adjust::index_triples;
use super::board::Board;
use super::chain::{Arrangement, BoardObservation, board_pose};
use super::detect::Corners;
use super::error::CalibError;
use super::foreign;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Board as BoardFrame, Flange, PinholeCamera, Point, Rigid, median};

/// Maximum difference between the angles of (1), rad. It allows for an arm that differs from its nominal geometry, and
/// for corners in a small picture.
const MAX_ANGLE_DIFFERENCE_RAD: f64 = 0.05;

/// Returns the rotations that map the board onto itself; the first one is the identity.
fn symmetry_rotations(board: &Board) -> Vec<Isometry3<f64>> {
    let far =
        board.corners().into_iter().fold([0.0, 0.0], |far: [f64; 2], q| [far[0].max(q.mm.x), far[1].max(q.mm.y)]);
    let quarter = |count: u32, to: [f64; 2]| {
        let turn =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(count) * std::f64::consts::FRAC_PI_2);
        Isometry3::from_parts(Translation3::new(to[0], to[1], 0.0), turn)
    };
    let half = quarter(2, far);
    match (board.is_unique(), board.columns() == board.rows() && far[0] == far[1]) {
        (true, _) => vec![Isometry3::identity()],
        (false, false) => vec![Isometry3::identity(), half],
        (false, true) => vec![Isometry3::identity(), quarter(1, [far[0], 0.0]), half, quarter(3, [0.0, far[1]])],
    }
}

/// Returns the corners with their positions on the board after this rotation.
fn rotate_corners(corners: &Corners, turn: &Isometry3<f64>) -> Corners {
    corners.iter().map(|(q, pixel)| (Point::<BoardFrame>::new(turn * q.mm), *pixel)).collect()
}

/// Assigns the corners of each picture to the board as if every board had been detected in the same rotation. The
/// flange pose of each picture is given with it.
///
/// # Errors
/// If the corners of a picture determine no pose of the board.
pub fn resolve_symmetry<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    pictures: &mut [(Rigid<Base, Flange>, &mut Corners)],
) -> Result<(), CalibError> {
    let turns = symmetry_rotations(board);
    if turns.len() < 2 {
        return Ok(());
    }
    let mut poses: Vec<Isometry3<f64>> = Vec::with_capacity(pictures.len());
    for (_, corners) in pictures.iter() {
        let found = board_pose::<A::From>(camera, &BoardObservation::Pixels((*corners).clone()))?;
        poses.push(*found.camera_from_board.isometry());
    }
    let moved = |flange: &Rigid<Base, Flange>| A::to_from_holder(flange).isometry().inverse();
    let stations = Stations {
        holder_from_to: pictures.iter().map(|(flange, _)| moved(flange)).collect(),
        rotated_poses: poses.iter().map(|pose| turns.iter().map(|turn| pose * turn.inverse()).collect()).collect(),
        centre: board.centre().mm,
    };
    let found =
        index_triples(poses.len()).flat_map(|triple| stations.solve_triple(triple)).fold(None, closer_solution);
    for ((_, corners), way) in pictures.iter_mut().zip(found.map(|(_, ways)| ways).unwrap_or_default()) {
        **corners = rotate_corners(corners, &turns[way]);
    }
    Ok(())
}

/// Median distance of the boards from the board of the first station, mm, and the rotation of each station.
type OrientationSolution = (f64, Vec<usize>);

fn closer_solution(best: Option<OrientationSolution>, next: OrientationSolution) -> Option<OrientationSolution> {
    match best {
        Some(best) if best.0 <= next.0 => Some(best),
        _ => Some(next),
    }
}

struct Stations {
    holder_from_to: Vec<Isometry3<f64>>,
    /// For each station and each rotation, the pose of the board in the camera frame.
    rotated_poses: Vec<Vec<Isometry3<f64>>>,
    centre: Point3<f64>,
}

impl Stations {
    /// Returns the solutions for all stations that follow from three stations: one for each combination of their
    /// rotations that satisfies (1). The first of the three stations is not rotated.
    fn solve_triple(&self, [a, b, c]: [usize; 3]) -> Vec<OrientationSolution> {
        let mut all = Vec::new();
        for way_b in (0..self.rotated_poses[b].len()).filter(|way| self.have_equal_rotations((a, 0), (b, *way))) {
            for way_c in 0..self.rotated_poses[c].len() {
                if self.have_equal_rotations((a, 0), (c, way_c))
                    && self.have_equal_rotations((b, way_b), (c, way_c))
                {
                    all.extend(self.solve_mount([(a, 0), (b, way_b), (c, way_c)]));
                }
            }
        }
        all
    }

    fn have_equal_rotations(&self, one: (usize, usize), other: (usize, usize)) -> bool {
        let flange = self.holder_from_to[one.0].rotation.angle_to(&self.holder_from_to[other.0].rotation);
        let board = (
            self.rotated_poses[one.0][one.1].rotation.inverse(),
            self.rotated_poses[other.0][other.1].rotation.inverse(),
        );
        (flange - board.0.angle_to(&board.1)).abs() < MAX_ANGLE_DIFFERENCE_RAD
    }

    fn solve_mount(&self, three: [(usize, usize); 3]) -> Option<OrientationSolution> {
        let mount = foreign::solve_hand_eye_park(
            &three.map(|(index, _)| self.holder_from_to[index]),
            &three.map(|(index, way)| self.rotated_poses[index][way]),
        )?;
        let held = |index: usize, way: usize| self.holder_from_to[index] * mount * self.rotated_poses[index][way];
        let first = held(three[0].0, 0);
        let apart_mm = |index: usize, way: usize| {
            // The rotations do not move the centre of the board: a second point beside the centre distinguishes them.
            let beside = self.centre + Vector3::x() * self.centre.coords.norm();
            let board = held(index, way);
            (first * self.centre - board * self.centre).norm() + (first * beside - board * beside).norm()
        };
        let nearest = |index: usize| {
            let ways = (0..self.rotated_poses[index].len()).map(|way| (apart_mm(index, way), way));
            ways.min_by(|one, other| one.0.total_cmp(&other.0)).unwrap_or((f64::INFINITY, 0))
        };
        let (mut apart, ways): (Vec<f64>, Vec<usize>) = (0..self.rotated_poses.len()).map(nearest).unzip();
        Some((median(&mut apart)?, ways))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calib::chain::Station;
    use crate::calib::hand_eye::hand_eye;
    use panelprep_cell::cell::ScannerMount;
    use panelprep_sim::{BoardCell, BoardPrint, RobotNoise};

    /// In each picture the numbering starts at another corner that looks like the first one. The mount is as accurate
    /// as if the numbering always started at the first corner.
    #[test]
    fn symmetric_boards_give_a_mount() {
        for (columns, rows, ways) in [(7, 7, 4), (8, 6, 2), (9, 6, 1)] {
            let board = Board::parse(&format!("{columns}x{rows}"), 20.0).expect("a board");
            let all = symmetry_rotations(&board);
            assert_eq!(all.len(), ways);
            for turn in &all {
                let there = turn * board.corner(1, 0).expect("a corner").mm;
                assert!(
                    board.corners().iter().any(|q| (q.mm - there).norm() < 1e-9),
                    "{turn} maps corners onto corners"
                );
            }
            let robot = RobotNoise { shift_mm: 0.3, turn_deg: 0.1 };
            let cell = BoardCell::new(3, BoardPrint::chessboard(columns, rows, 20.0), robot).with_reduction(4);
            let camera = cell.scanner();
            let shots = cell.fixed_shots(10);
            let corners: Vec<Corners> = (shots.iter().enumerate())
                .map(|(index, shot)| rotate_corners(&cell.corners(&camera, shot, 0.02), &all[index * index % ways]))
                .collect();
            let stations = |corners: &[Corners]| -> Vec<Station<panelprep_base::geometry::Camera>> {
                let all = shots.iter().zip(corners).map(|(shot, corners)| Station {
                    name: format!("{}.png", shot.index),
                    base_from_flange: shot.base_from_flange,
                    observation: BoardObservation::Pixels(corners.clone()),
                });
                all.collect()
            };
            let mut round = corners.clone();
            let flanges = shots.iter().map(|shot| shot.base_from_flange);
            let mut pictures: Vec<_> = flanges.zip(&mut round).collect();
            resolve_symmetry::<ScannerMount>(&camera, &board, &mut pictures).expect("poses");
            let found = hand_eye::<ScannerMount>(&camera, &board, &stations(&round), None).expect("a mount");
            let off_mm =
                found.adjustment.to_from_camera.distance_at_mm(cell.base_from_camera(), found.stated_point);
            assert!(
                off_mm < 1.0 && found.suspects.is_empty(),
                "{columns}×{rows}: {off_mm} mm, {:?}",
                found.suspects
            );
            if ways > 1 {
                let as_they_were = hand_eye::<ScannerMount>(&camera, &board, &stations(&corners), None);
                assert!(
                    as_they_were.is_err_and(|error| error.to_string().contains("mount")),
                    "without it there is none"
                );
            }
        }
    }
}
