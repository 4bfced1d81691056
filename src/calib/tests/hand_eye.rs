//! Many poses, both mounts, on synthetic corners.

use crate::calib::{Arrangement, Board, Fault, HandEye, Seen, Station, hand_eye::hand_eye};
use crate::cell::{FlangeCameraMount, ScannerMount};
use crate::geometry::{Camera, FlangeCamera, KukaPose, PinholeCamera, Rigid};
use crate::sim::{BoardCell, BoardPrint, BoardShot, RobotNoise};

const GOOD_ROBOT: RobotNoise = RobotNoise { shift_mm: 0.02, turn_deg: 0.005 };
const NOISE_PX: f64 = 0.05;

fn board() -> Board {
    Board::parse("9x6", 25.0).expect("a board")
}

fn cell(seed: u64, robot: RobotNoise) -> BoardCell {
    BoardCell::new(seed, BoardPrint::chessboard(9, 6, 25.0), robot)
}

fn stations<C: crate::geometry::Frame>(
    cell: &BoardCell,
    camera: &PinholeCamera,
    shots: &[BoardShot<C>],
) -> Vec<Station<C>> {
    shots
        .iter()
        .map(|shot| Station {
            name: format!("{:02}.png", shot.index + 1),
            base_from_flange: shot.base_from_flange,
            seen: Seen::Pixels(cell.corners(camera, shot, NOISE_PX)),
        })
        .collect()
}

fn fixed(cell: &BoardCell, count: usize) -> Vec<Station<Camera>> {
    stations(cell, &cell.scanner(), &cell.fixed_shots(count))
}

fn on_flange(cell: &BoardCell, count: usize) -> Vec<Station<FlangeCamera>> {
    stations(cell, &cell.flange_camera(), &cell.flange_shots(count))
}

/// Error at the stated point, mm, and of the turn, degrees; and the error's square in its own covariance, by 3.
fn error<A: Arrangement>(found: &HandEye<A>, truth: Rigid<A::To, A::From>) -> (f64, f64, f64) {
    let pose = found.adjusted.to_from_camera;
    let off = ((pose * found.at) - (truth * found.at)).mm;
    let inverse = found.covariance_mm2().try_inverse().expect("regular");
    (off.norm(), (truth.inverse() * pose).turn().0, off.dot(&(inverse * off)) / 3.0)
}

#[test]
fn both_mounts_come_back_within_the_robots_noise() {
    for seed in [1, 2] {
        let cell = cell(seed, GOOD_ROBOT);
        let found =
            hand_eye::<ScannerMount>(&cell.scanner(), &board(), &fixed(&cell, 15), Some(cell.panel_middle()))
                .expect("calibrated");
        let (mm, deg, _) = error(&found, cell.base_from_camera());
        eprintln!("{mm} {deg} {} {:?}", found.uncertainty_mm, found.adjusted.noise);
        assert!(mm < 0.06 && deg < 0.015, "seed {seed}: {mm} mm, {deg}°");
        assert!(found.suspects.is_empty() && found.uncertainty_mm < 0.1, "{:?}", found.suspects);
        let found = hand_eye::<FlangeCameraMount>(&cell.flange_camera(), &board(), &on_flange(&cell, 15), None)
            .expect("calibrated");
        let (mm, deg, _) = error(&found, cell.flange_from_camera());
        eprintln!("{mm} {deg} {} {:?}", found.uncertainty_mm, found.adjusted.noise);
        assert!(mm < 0.06 && deg < 0.015, "seed {seed}: {mm} mm, {deg}°");
        assert!(found.suspects.is_empty() && found.uncertainty_mm < 0.1, "{:?}", found.suspects);
    }
}
