//! Tests that additional good data never make a verdict worse: random subsets of pictures with the noise of real ones;
//! each subset is contained in the next.

use super::hand_eye::{GOOD_ROBOT, board, cell};
use super::lenses::{LENS, pictures, size};
use crate::calib::gate::{self, PoseSource};
use crate::calib::hand_eye::hand_eye;
use crate::calib::health::{BoardMeasurement, distance_mm, uninformative_measurement};
use crate::calib::intrinsics::{Options, calibrate};
use crate::calib::{Arrangement, BoardObservation, Station, board_pose};
use panelprep_base::geometry::{Frame, PinholeCamera, Rigid};
use panelprep_base::verdict::Verdict;
use panelprep_cell::cell::{FlangeCameraMount, ScannerMount};
use panelprep_sim::{BoardCell, BoardShot, RobotNoise};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Numbers of pictures in the subsets.
const SUBSET_SIZES: [usize; 4] = [10, 14, 20, 28];

/// Returns the rank of a verdict, from the best to the worst.
fn rank(verdict: Verdict) -> usize {
    [Verdict::Accept, Verdict::Review, Verdict::Reject].iter().position(|one| *one == verdict).unwrap_or(3)
}

/// Asserts that the verdicts of growing subsets never become worse; returns the number of accepted largest subsets.
fn assert_never_worse(what: &str, judged: &[(Verdict, String)]) -> usize {
    for pair in judged.windows(2) {
        assert!(rank(pair[1].0) <= rank(pair[0].0), "{what}: {judged:?}");
    }
    usize::from(judged.last().is_some_and(|last| last.0 == Verdict::Accept))
}

/// Returns stations whose noise differs from picture to picture by up to a factor of 4, as in real pictures.
fn stations<C: Frame>(
    (cell, camera): (&BoardCell, &PinholeCamera),
    shots: &[BoardShot<C>],
    random: &mut Pcg64,
) -> Vec<Station<C>> {
    let station = |shot: &BoardShot<C>| Station {
        name: format!("{:02}.png", shot.index + 1),
        base_from_flange: shot.base_from_flange,
        observation: BoardObservation::Pixels(cell.corners(camera, shot, 0.02 * 4.0_f64.powf(random.random()))),
    };
    let mut all: Vec<Station<C>> = shots.iter().map(station).collect();
    all.shuffle(random);
    all
}

fn mounts<A: Arrangement>(
    (camera, truth): (&PinholeCamera, &Rigid<A::To, A::From>),
    stations: &[Station<A::From>],
) -> Vec<(Verdict, String)> {
    let judge = |count: usize| match hand_eye::<A>(camera, &board(), &stations[..count], None) {
        Ok(found) => {
            let square_mm = board().square_mm();
            let judged = gate::judge_hand_eye((&found, square_mm), None, Some(truth), PoseSource::File);
            let words: Vec<String> = judged.reasons.iter().map(|reason| reason.message.to_string()).collect();
            (judged.verdict, words.join("; "))
        }
        Err(error) => (Verdict::Reject, error.to_string()),
    };
    SUBSET_SIZES.map(judge).to_vec()
}

#[test]
fn more_poses_never_make_a_mount_worse() {
    let middling = RobotNoise { shift_mm: 0.1, turn_deg: 0.02 };
    let mut accepted = 0;
    for seed in 1..=4 {
        for robot in [GOOD_ROBOT, middling] {
            let (cell, mut random) = (cell(seed, robot), Pcg64::seed_from_u64(seed));
            let (scanner, flange) = (cell.scanner(), cell.flange_camera());
            let fixed = stations((&cell, &scanner), &cell.fixed_shots(SUBSET_SIZES[3]), &mut random);
            let moving = stations((&cell, &flange), &cell.flange_shots(SUBSET_SIZES[3]), &mut random);
            let of_fixed = mounts::<ScannerMount>((&scanner, &cell.base_from_camera()), &fixed);
            let of_moving = mounts::<FlangeCameraMount>((&flange, &cell.flange_from_camera()), &moving);
            accepted += assert_never_worse(&format!("seed {seed}, fixed camera"), &of_fixed);
            accepted += assert_never_worse(&format!("seed {seed}, flange camera"), &of_moving);
        }
    }
    assert!(accepted >= 15, "{accepted} of 16 mounts are accepted in the end");
}

#[test]
fn more_pictures_never_make_a_lens_worse() {
    let lens = PinholeCamera { k1: -0.12, k2: 0.1, ..LENS };
    let (mut accepted, mut words) = (0, None);
    for seed in 1..=6 {
        let mut views = pictures(&lens, seed, SUBSET_SIZES[3], 0.9, 700.0);
        views.shuffle(&mut Pcg64::seed_from_u64(seed));
        let judge = |count: usize| match calibrate(size(&lens), &views[..count], Options::default()) {
            Ok(found) => {
                let judged = gate::intrinsics(&found);
                let words: Vec<String> = judged.reasons.iter().map(|reason| reason.message.to_string()).collect();
                (judged.verdict, words.join("; "))
            }
            Err(error) => (Verdict::Reject, error.to_string()),
        };
        let judged = SUBSET_SIZES.map(judge);
        accepted += assert_never_worse(&format!("seed {seed}"), &judged);
        words = judged.last().map(|last| last.1.clone());
    }
    assert!(accepted >= 4, "{accepted} of 6 lenses are accepted in the end: {words:?}");
}

/// The error of a verification over the volume is the error of its worst picture. No good picture is excluded or judged
/// to show another board, and no error exceeds the default limit.
#[test]
fn more_pictures_never_make_a_verification_worse() {
    // The default of `verify_limit_mm`.
    let limit_mm = 0.5;
    for seed in 1..=10 {
        let (cell, mut random) = (cell(seed, GOOD_ROBOT), Pcg64::seed_from_u64(seed));
        let (camera, known) = (cell.flange_camera(), cell.base_from_board());
        for station in stations((&cell, &camera), &cell.flange_shots(SUBSET_SIZES[3]), &mut random) {
            let pose = board_pose(&camera, &station.observation).expect("a board");
            let base_from_board = station.base_from_flange * cell.flange_from_camera() * pose.camera_from_board;
            let look = BoardMeasurement { base_from_board, pnp_rms_px: pose.rms, measured_square_mm: None };
            assert_eq!(uninformative_measurement(&known, &look, &board()), None, "seed {seed}, {}", station.name);
            let error_mm = distance_mm(&known, &base_from_board, &board().corners());
            assert!(error_mm < limit_mm, "seed {seed}, {}: {error_mm} mm of {limit_mm} mm", station.name);
        }
    }
}
