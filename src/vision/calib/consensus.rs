//! The start value of the adjustment, robust against a few wrong poses.
//!
//! Three stations at a time give the mount in closed form (Park & Martin). With this mount every station predicts
//! the board's pose on its holder, and correct stations agree. The best mount has the least median of these
//! distances (Rousseeuw, J. Am. Stat. Assoc. 79, 1984), which tolerates almost half of all poses being wrong.

use super::arrangement::Arrangement;
use super::error::CalibError;
use super::foreign;
use nalgebra::{Isometry3, Matrix3};
use panelprep_base::geometry::{Board, Point, Rigid};

/// Maximum number of triples that are tried; if there are more, they are sampled at equal steps.
const MAX_TRIPLES: usize = 800;
/// Minimum rotation between three stations that can give a start, rad.
pub(super) const MIN_TURN_RAD: f64 = 0.05;
/// Maximum median distance of a consensus, mm.
const MAX_MEDIAN_MM: f64 = 15.0;
/// Minimum spread of the rotations about the second axis that determines a mount, degrees.
pub(super) const MIN_SPREAD_DEG: f64 = 4.0;

pub(super) struct Start<A: Arrangement> {
    pub to_from_camera: Rigid<A::To, A::From>,
    pub holder_from_board: Rigid<A::Holder, Board>,
    /// Distance of each station's board from the best station's board, mm.
    pub distances_mm: Vec<f64>,
    pub median_mm: f64,
}

/// Returns the spread of the rotations between stations about the second of their axes, degrees (root mean square
/// over all pairs).
pub(super) fn second_axis_deg(turns: &[Isometry3<f64>]) -> f64 {
    let (mut spread, mut pairs) = (Matrix3::zeros(), 0.0);
    for (index, first) in turns.iter().enumerate() {
        for second in &turns[index + 1..] {
            let axis = (first.rotation.inverse() * second.rotation).scaled_axis();
            spread += axis * axis.transpose();
            pairs += 1.0;
        }
    }
    let mut eigen: [f64; 3] = spread.symmetric_eigenvalues().into();
    eigen.sort_by(f64::total_cmp);
    (eigen[1].max(0.0) / f64::max(pairs, 1.0)).sqrt().to_degrees()
}

pub(super) fn start<A: Arrangement>(
    to_from_holder: &[Rigid<A::To, A::Holder>],
    camera_from_board: &[Rigid<A::From, Board>],
    places: &[Point<Board>],
) -> Result<Start<A>, CalibError> {
    let moved: Vec<Isometry3<f64>> = to_from_holder.iter().map(|pose| pose.isometry().inverse()).collect();
    let seen: Vec<Isometry3<f64>> = camera_from_board.iter().map(|pose| *pose.isometry()).collect();
    let mut best: Option<Start<A>> = None;
    for triple in index_triples(seen.len()) {
        let pick = |poses: &[Isometry3<f64>]| triple.map(|index| poses[index]);
        if second_axis_deg(&pick(&moved)).to_radians() < MIN_TURN_RAD {
            continue;
        }
        let Some(mount) = foreign::solve_hand_eye_park(&pick(&moved), &pick(&seen)) else { continue };
        let mount: Rigid<A::To, A::From> = Rigid::from_isometry_unchecked(mount);
        let boards: Vec<Rigid<A::Holder, Board>> = to_from_holder
            .iter()
            .zip(camera_from_board)
            .map(|(moved, seen)| moved.inverse() * mount * *seen)
            .collect();
        let found = medoid(mount, &boards, places);
        if best.as_ref().is_none_or(|best| found.median_mm < best.median_mm) {
            best = Some(found);
        }
    }
    let none = CalibError::TooLittleRotation {
        about_second_axis_deg: second_axis_deg(&moved),
        needed_deg: MIN_SPREAD_DEG,
    };
    let best = best.ok_or(none)?;
    if best.median_mm > MAX_MEDIAN_MM {
        return Err(CalibError::NoConsensus { poses: seen.len(), median_mm: best.median_mm, readings: vec![] });
    }
    Ok(best)
}

/// Returns the station with the board pose that agrees best with the others'.
fn medoid<A: Arrangement>(
    to_from_camera: Rigid<A::To, A::From>,
    boards: &[Rigid<A::Holder, Board>],
    places: &[Point<Board>],
) -> Start<A> {
    let distances = |board: &Rigid<A::Holder, Board>| -> (f64, Vec<f64>) {
        let apart = |other: &Rigid<A::Holder, Board>| {
            places.iter().map(|&place| board.distance_at_mm(*other, place)).sum::<f64>() / places.len() as f64
        };
        let distances: Vec<f64> = boards.iter().map(apart).collect();
        let mut sorted = distances.clone();
        sorted.sort_by(f64::total_cmp);
        // The first value is the station's own distance of zero: the median is that of the others.
        (sorted[(sorted.len()) / 2], distances)
    };
    let mut all = boards.iter().map(|board| (*board, distances(board)));
    let first =
        all.next().unwrap_or((Rigid::from_isometry_unchecked(Isometry3::identity()), (f64::INFINITY, vec![])));
    let (holder_from_board, (median_mm, distances_mm)) =
        all.fold(first, |best, next| if next.1.0 < best.1.0 { next } else { best });
    Start { to_from_camera, holder_from_board, distances_mm, median_mm }
}

pub(super) fn index_triples(count: usize) -> impl Iterator<Item = [usize; 3]> {
    let all = count * count.saturating_sub(1) * count.saturating_sub(2) / 6;
    let stride = all.div_ceil(MAX_TRIPLES).max(1);
    (0..count)
        .flat_map(move |a| (a + 1..count).flat_map(move |b| (b + 1..count).map(move |c| [a, b, c])))
        .step_by(stride)
}
