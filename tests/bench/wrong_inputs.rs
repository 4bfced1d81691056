//! Calibrates with wrong inputs: every mistake, many seeds, both mounts. Each wrong input must be refused and its
//! mistake named, and the correct input must be accepted. `cargo bench --bench wrong_inputs -- seeds=20 from=1`.

mod arguments;
#[path = "../boards.rs"]
mod boards;
mod goal;

use boards::{GOOD_ROBOT, POSES, Side};
use goal::Figure;
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use panelprep::calib::gate::PoseSource;
use panelprep::calib::hand_eye::hand_eye;
use panelprep::calib::{Board, BoardObservation, Station, gate};
use panelprep::cell::{FlangeCameraMount, ScannerMount};
use panelprep::geometry::{Base, Board as BoardFrame, Flange, Frame, KukaPose, PinholeCamera, Pixel, Point, Rigid};
use panelprep::verdict::Verdict;
use rayon::prelude::*;
use std::ops::RangeInclusive;
use std::process::ExitCode;

/// Minimum fraction of the refused inputs whose message names the actual mistake.
const MIN_NAMED_FRACTION: f64 = 0.95;

/// A mistake by a person, and words of the message that names it.
struct Mistake {
    name: &'static str,
    named: &'static str,
    kind: Kind,
}

#[derive(Clone, Copy)]
enum Kind {
    Pose(fn(&Isometry3<f64>) -> Isometry3<f64>),
    Square(f64),
    Late,
    Early,
    Mirrored,
    Lens(f64),
    /// A base frame or a tool is set in the controller, and the approximate mount is not given.
    Unseen(fn(&Isometry3<f64>) -> Isometry3<f64>),
    Right,
}

fn kuka(pose: &Isometry3<f64>) -> [f64; 3] {
    let KukaPose { a_deg, b_deg, c_deg, .. } =
        KukaPose::from_rigid(&Rigid::<Base, Flange>::from_isometry_unchecked(*pose));
    [a_deg, b_deg, c_deg]
}

fn written(pose: &Isometry3<f64>, [a_deg, b_deg, c_deg]: [f64; 3]) -> Isometry3<f64> {
    let at = KukaPose::from_rigid(&Rigid::<Base, Flange>::from_isometry_unchecked(*pose));
    *KukaPose { a_deg, b_deg, c_deg, ..at }.to_rigid::<Base, Flange>().isometry()
}

fn turned(pose: &Isometry3<f64>, rotation: UnitQuaternion<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(pose.translation, rotation)
}

fn scaled(pose: &Isometry3<f64>, factor: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(pose.translation.vector * factor), pose.rotation)
}

fn mistakes() -> Vec<Mistake> {
    let pose = |name, named, change| Mistake { name, named, kind: Kind::Pose(change) };
    let square = |name, ratio, named| Mistake { name, named, kind: Kind::Square(ratio) };
    vec![
        Mistake { name: "right", named: "", kind: Kind::Right },
        pose("inverted", "flange_from_base", Isometry3::inverse),
        pose("A and C exchanged", "A and C are exchanged", |pose| {
            let [a, b, c] = kuka(pose);
            written(pose, [c, b, a])
        }),
        pose("A negated", "the sign of A is wrong", |pose| {
            let [a, b, c] = kuka(pose);
            written(pose, [-a, b, c])
        }),
        pose("X, new Y, new Z", "about X, then the new Y", |pose| {
            let [a, b, c] = kuka(&turned(pose, pose.rotation.inverse()));
            written(pose, [-c, -b, -a])
        }),
        pose("rotation vector, degrees", "rotation vector in degrees", |pose| {
            written(pose, pose.rotation.scaled_axis().map(f64::to_degrees).into())
        }),
        pose("quaternion order", "w, x, y, z were read as x, y, z, w", |pose| {
            let q = pose.rotation.coords;
            turned(pose, UnitQuaternion::from_quaternion(Quaternion::new(q.z, q.w, q.x, q.y)))
        }),
        pose("rotation transposed", "rotations are transposed", |pose| turned(pose, pose.rotation.inverse())),
        pose("left-handed", "left-handed", |pose| {
            let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
            let turn = mirror * pose.rotation.to_rotation_matrix().into_inner() * mirror;
            let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
            Isometry3::from_parts(Translation3::from(mirror * pose.translation.vector), rotation)
        }),
        pose("radians", "radians", |pose| written(pose, kuka(pose).map(f64::to_radians))),
        pose("metres", "in metres", |pose| scaled(pose, 1e-3)),
        pose("centimetres", "in centimetres", |pose| scaled(pose, 0.1)),
        pose("inches", "in inches", |pose| scaled(pose, 1.0 / 25.4)),
        Mistake { name: "a picture late", named: "shifted by one picture", kind: Kind::Late },
        Mistake { name: "a picture early", named: "shifted by one picture", kind: Kind::Early },
        Mistake { name: "pictures mirrored", named: "mirrored", kind: Kind::Mirrored },
        square("square 24.9 for 25", 24.9 / 25.0, "squares measure 2"),
        square("square 25.1 for 25", 25.1 / 25.0, "squares measure 2"),
        square("square 24.5 for 25", 24.5 / 25.0, "squares measure 2"),
        square("square 29 for 25", 29.0 / 25.0, "squares measure 2"),
        square("square 2.5 for 25", 0.1, "squares measure 2"),
        Mistake { name: "lens of 1 % more", named: "focal length", kind: Kind::Lens(1.01) },
        Mistake {
            name: "base frame set",
            named: "no_rough",
            kind: Kind::Unseen(|pose| {
                Isometry3::new(Vector3::new(400.0, 200.0, 0.0), Vector3::new(0.0, 0.0, 0.5)).inverse() * pose
            }),
        },
        Mistake {
            name: "tool set",
            named: "no_rough",
            kind: Kind::Unseen(|pose| pose * Isometry3::new(Vector3::new(10.0, 0.0, 180.0), Vector3::zeros())),
        },
    ]
}

fn reads<C: Frame>(stations: &[Station<C>], change: impl Fn(&Isometry3<f64>) -> Isometry3<f64>) -> Vec<Station<C>> {
    let changed = |station: &Station<C>| Station {
        base_from_flange: Rigid::from_isometry_unchecked(change(station.base_from_flange.isometry())),
        ..station.clone()
    };
    stations.iter().map(changed).collect()
}

fn corners<C: Frame>(
    stations: &[Station<C>],
    change: impl Fn(&Point<BoardFrame>, Pixel) -> (Point<BoardFrame>, Pixel),
) -> Vec<Station<C>> {
    let changed = |station: &Station<C>| {
        let BoardObservation::Pixels(corners) = &station.observation else { unreachable!("pictures") };
        let seen = corners.iter().map(|(q, pixel)| change(q, *pixel)).collect();
        Station { observation: BoardObservation::Pixels(seen), ..station.clone() }
    };
    stations.iter().map(changed).collect()
}

/// Calibrates with an input; returns the verdict and the words of all messages.
fn judged<A: Side>(seed: u64, mistake: &Mistake) -> (Verdict, String) {
    let cell = boards::cell(seed, GOOD_ROBOT);
    let shots = A::shots(&cell, POSES);
    let right = boards::stations::<A>(&shots, &boards::synthetic::<A>(&cell, &shots));
    let mut camera = A::camera(&cell);
    let mut board = boards::board();
    let mut rough = Some(A::truth(&cell));
    let last = camera.width_px as f64 - 1.0;
    let stations = match mistake.kind {
        Kind::Right => right,
        Kind::Pose(change) => reads(&right, change),
        Kind::Unseen(change) => {
            rough = None;
            reads(&right, change)
        }
        Kind::Square(ratio) => {
            board = Board::parse("9x6", 25.0 * ratio).expect("a board");
            corners(&right, |q, pixel| (Point::new(q.mm * ratio), pixel))
        }
        Kind::Late | Kind::Early => {
            let late = matches!(mistake.kind, Kind::Late);
            let [seen, said] =
                if late { [&right[1..], &right[..POSES - 1]] } else { [&right[..POSES - 1], &right[1..]] };
            let pair = |(seen, said): (&Station<A::From>, &Station<A::From>)| Station {
                observation: seen.observation.clone(),
                ..said.clone()
            };
            seen.iter().zip(said).map(pair).collect()
        }
        Kind::Mirrored => {
            corners(&right, |q, pixel| (Point::at(200.0 - q.mm.x, q.mm.y, 0.0), Pixel::at(last - pixel.u, pixel.v)))
        }
        Kind::Lens(factor) => {
            camera = PinholeCamera { fx_px: camera.fx_px * factor, fy_px: camera.fy_px * factor, ..camera };
            right
        }
    };
    match hand_eye::<A>(&camera, &board, &stations, None) {
        Err(error) => (Verdict::Reject, error.to_string()),
        Ok(found) => {
            let judgement =
                gate::judge_hand_eye((&found, board.square_mm()), None, rough.as_ref(), PoseSource::File);
            let words = judgement.reasons.iter().map(|reason| format!("{}: {}; ", reason.code, reason.message));
            (judgement.verdict, words.collect())
        }
    }
}

/// Returns a row of the table: the number of seeds that were accepted, and the number of those whose mistake was named.
fn row<A: Side>(seeds: &RangeInclusive<u64>, mistake: &Mistake) -> [usize; 2] {
    let all: Vec<(Verdict, String)> =
        seeds.clone().into_par_iter().map(|seed| judged::<A>(seed, mistake)).collect();
    let accepted = all.iter().filter(|(verdict, _)| *verdict == Verdict::Accept).count();
    let named = all.iter().filter(|(_, words)| words.contains(mistake.named)).count();
    if named < all.len() || (mistake.named.is_empty() && accepted < all.len()) {
        let other = all.iter().find(|(verdict, words)| {
            !words.contains(mistake.named) || (mistake.named.is_empty() && *verdict != Verdict::Accept)
        });
        if let Some((verdict, words)) = other {
            println!("       {}, {}: {} {words}", A::NAME, mistake.name, verdict.keyword());
        }
    }
    [accepted, named]
}

fn main() -> ExitCode {
    let (seeds, from) = (arguments::number("seeds").unwrap_or(20), arguments::number("from").unwrap_or(1));
    let range = from..=from + seeds - 1;
    println!(
        "mistake                     fixed camera: accepted, named   camera on the flange: accepted, named   of {seeds}, from seed {from}"
    );
    let (mut missed, mut named, mut wrong, mut accepted) = (0, 0, 0, 0);
    for mistake in mistakes() {
        let rows = [row::<ScannerMount>(&range, &mistake), row::<FlangeCameraMount>(&range, &mistake)];
        let [[fixed, fixed_named], [moving, moving_named]] = rows;
        println!("{:26}  {fixed:8} {fixed_named:6}  {moving:30} {moving_named:6}", mistake.name);
        if mistake.named.is_empty() {
            missed += rows.iter().filter(|[accepted, _]| *accepted < seeds as usize).count();
        } else {
            missed += rows.iter().filter(|[accepted, _]| *accepted > 0).count();
            wrong += 2 * seeds as usize;
            accepted += fixed + moving;
            named += fixed_named + moving_named;
        }
    }
    let share = named as f64 / wrong.max(1) as f64;
    println!("{:.1} % of the wrong inputs are named (target {:.0} %)", 100.0 * share, 100.0 * MIN_NAMED_FRACTION);
    let found = format!("{accepted} of {wrong}");
    Figure("calib: wrong inputs accepted").report("0", &found, accepted == 0 && wrong > 0);
    let found = format!("{:.1} %", 100.0 * share);
    Figure("calib: wrong inputs named").report(
        &format!("{} %", 100.0 * MIN_NAMED_FRACTION),
        &found,
        share >= MIN_NAMED_FRACTION,
    );
    missed += usize::from(share < MIN_NAMED_FRACTION);
    println!("{missed} floors were missed");
    if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
