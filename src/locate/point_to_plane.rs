//! Point-to-plane ICP with the outline: moves the taught panel onto the scan, to the end.
//!
//! Minimises  E(R,t) = Σ wᵢ (nᵢ · (R qᵢ + t − pᵢ))²,  qᵢ taught, pᵢ closest scanned point, nᵢ its normal.          (1)
//! With q' = R q + t, a small twist ξ = (ω, v) applied on the left about the panel's centre c,  r = n·(q' − p)  and
//!     J = [ ((q' − c) × n)ᵀ  nᵀ ],   (Σ w JᵀJ) ξ = −Σ w Jᵀ r.                                              (2)
//! The surface holds the panel along its normal and hardly sideways: a smooth panel slides along itself. Its outline
//! holds it sideways: for a point of the outline n is the direction in the surface that leads across the scan's outline.
//! Both are sums of the same form. A surface pair whose closest point lies at the border of the piece is dropped: the true
//! partner may be hidden. Weights w are 1/σ² of each kind over the number of its points that share one error.
//! In: guess and points in `Panel`, patches and edges in `Base`, mm. Does not decide whether the fit is good: see `gate`.
//! Source: Chen & Medioni, Image Vis. Comput. 10(3), 1992; (2) as in Low, UNC TR04-004, 2004.

use super::LocateError;
use super::correspond::{CHUNK, distance_limit_mm, pairs};
use super::samples::{LINE_HALF_LENGTH_MM, Scanned, Taught};
use crate::geometry::{Base, Panel, Point, Rigid, Vector};
use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

/// Steps that move no point of the panel farther end the iteration, mm.
pub(super) const CONVERGED_MM: f64 = 0.002;
const MAX_STEPS: usize = 60;
/// Pairs of the outline at this distance or less are kept however good the fit is, in pixels' spacing.
const OUTLINE_FLOOR_PX: f64 = 3.0;
/// A point this near to a patch lies on it, in patches' spacing.
pub(super) const NEAR_PATCHES: f64 = 1.5;
/// A surface residual of this size or less is kept however good the fit is, mm.
const SURFACE_FLOOR_MM: f64 = 0.5;
/// What the range noise of two shots makes of a surface residual, mm.
const RANGE_NOISE_MM: f64 = 0.08;
/// A scanner's range noise is alike over about this length, mm: so many points share one error.
const RANGE_CORRELATION_MM: f64 = 65.0;
/// A twist may not be held by less than this share of what holds it best.
const MIN_CONDITION: f64 = 1e-9;

/// One pair as a linear constraint: the normal, and the residual along it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Constraint {
    moved: Point<Base>,
    normal: Vector<Base>,
    /// n·(q' − p), mm.
    pub residual_mm: f64,
}

/// The sums of (2) over one kind of pairs, without their weight; twists about a centre, in rad and mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sums {
    pub count: usize,
    pub information: Matrix6<f64>,
    gradient: Vector6<f64>,
    pub squares_mm2: f64,
}

impl Sums {
    /// Sums in fixed chunks, folded in their order: the same bits for any number of threads.
    pub fn over(constraints: &[Constraint], centre: Point<Base>) -> Sums {
        let chunk = |chunk: &[Constraint]| {
            let mut sums = Sums {
                count: chunk.len(),
                information: Matrix6::zeros(),
                gradient: Vector6::zeros(),
                squares_mm2: 0.0,
            };
            for constraint in chunk {
                let arm = (constraint.moved - centre).mm.cross(&constraint.normal.mm);
                let (n, r) = (constraint.normal.mm, constraint.residual_mm);
                let j = Vector6::new(arm.x, arm.y, arm.z, n.x, n.y, n.z); // (2)
                sums.information += j * j.transpose();
                sums.gradient += j * r;
                sums.squares_mm2 += r * r;
            }
            sums
        };
        let zero = Sums { count: 0, information: Matrix6::zeros(), gradient: Vector6::zeros(), squares_mm2: 0.0 };
        constraints.par_chunks(CHUNK).map(chunk).collect::<Vec<_>>().into_iter().fold(zero, |a, b| Sums {
            count: a.count + b.count,
            information: a.information + b.information,
            gradient: a.gradient + b.gradient,
            squares_mm2: a.squares_mm2 + b.squares_mm2,
        })
    }

    /// Root mean square of the residuals, mm.
    pub fn rms_mm(&self) -> f64 {
        (self.squares_mm2 / self.count.max(1) as f64).sqrt()
    }
}

/// What a guess leaves over: the constraints of both kinds.
pub(super) struct Residuals {
    pub surface: Vec<Constraint>,
    pub outline: Vec<Constraint>,
    /// Taught surface points on the border of the piece, which has no normals: neither found nor missed.
    pub at_border: usize,
}

impl Residuals {
    /// Pairs and trims at this guess.
    pub fn at(base_from_panel: Rigid<Base, Panel>, taught: &Taught, scanned: &Scanned) -> Residuals {
        let on_surface = pairs(&scanned.surface_tree, &taught.surface, base_from_panel);
        let near_mm = NEAR_PATCHES * scanned.patch_spacing_mm;
        let limit_mm = distance_limit_mm(&on_surface, near_mm);
        let mut at_border = 0;
        let mut surface = Vec::with_capacity(on_surface.len());
        for pair in on_surface.iter().filter(|pair| pair.distance_mm <= limit_mm) {
            let patch = scanned.surface[pair.closest];
            let Some(normal) = patch.normal else {
                at_border += usize::from(pair.distance_mm <= near_mm);
                continue;
            };
            let residual_mm = normal.mm.dot(&(pair.moved - patch.point).mm);
            surface.push(Constraint { moved: pair.moved, normal, residual_mm });
        }
        trim(&mut surface, SURFACE_FLOOR_MM);
        let on_outline = pairs(&scanned.outline_tree, &taught.outline, base_from_panel);
        let limit_mm = distance_limit_mm(&on_outline, OUTLINE_FLOOR_PX * scanned.spacing_mm);
        let outline = on_outline.iter().filter(|pair| pair.distance_mm <= limit_mm).map(|pair| {
            let edge = scanned.outline[pair.closest];
            let residual_mm = edge.across.mm.dot(&(pair.moved - edge.point).mm);
            Constraint { moved: pair.moved, normal: edge.across, residual_mm }
        });
        let outline = outline.collect();
        Residuals { surface, outline, at_border }
    }
}

/// Drops residuals beyond three medians, but none below the floor.
fn trim(constraints: &mut Vec<Constraint>, floor_mm: f64) {
    let mut sizes: Vec<f64> = constraints.iter().map(|constraint| constraint.residual_mm.abs()).collect();
    if sizes.is_empty() {
        return;
    }
    let middle = sizes.len() / 2;
    let limit_mm = (3.0 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1).max(floor_mm);
    constraints.retain(|constraint| constraint.residual_mm.abs() <= limit_mm);
}

/// How many errors of its own each kind of pairs has: far fewer than points, which share them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Samples {
    pub surface: f64,
    pub outline: f64,
}

impl Samples {
    /// Independent samples in an area and along an outline.
    pub fn of(sums: &[Sums; 2], taught: &Taught, scanned: &Scanned, area_mm2: f64) -> Samples {
        let [surface, outline] = sums;
        let area_found_mm2 = area_mm2 * surface.count as f64 / taught.surface.len() as f64;
        let outline_found_mm = outline.count as f64 * scanned.spacing_mm;
        Samples {
            surface: (area_found_mm2 / RANGE_CORRELATION_MM.powi(2)).max(1.0),
            outline: (outline_found_mm / (2.0 * LINE_HALF_LENGTH_MM)).max(1.0),
        }
    }
}

/// Where the iteration ended.
pub(super) struct Aligned {
    pub base_from_panel: Rigid<Base, Panel>,
    pub iterations: usize,
    pub last_step_mm: f64,
}

/// Moves the guess until no point of the panel moves any more.
pub(super) fn align(
    guess: Rigid<Base, Panel>,
    taught: &Taught,
    scanned: &Scanned,
    area_mm2: f64,
) -> Result<Aligned, LocateError> {
    let mut aligned = Aligned { base_from_panel: guess, iterations: 0, last_step_mm: f64::INFINITY };
    while aligned.iterations < MAX_STEPS && aligned.last_step_mm > CONVERGED_MM {
        let residuals = Residuals::at(aligned.base_from_panel, taught, scanned);
        let centre = aligned.base_from_panel * taught.centre;
        let sums = [Sums::over(&residuals.surface, centre), Sums::over(&residuals.outline, centre)];
        let samples = Samples::of(&sums, taught, scanned, area_mm2);
        let twist = step(&sums, samples, outline_noise_mm(scanned)).ok_or(LocateError::Degenerate {
            surface: residuals.surface.len(),
            outline: residuals.outline.len(),
        })?;
        let next = twisted(aligned.base_from_panel, centre, twist);
        aligned.last_step_mm = taught.largest_distance_mm(aligned.base_from_panel, next);
        aligned.base_from_panel = next;
        aligned.iterations += 1;
    }
    Ok(aligned)
}

/// An edge lies anywhere within its pixel: the standard deviation of a uniform distribution.
fn outline_noise_mm(scanned: &Scanned) -> f64 {
    scanned.spacing_mm / 12.0_f64.sqrt()
}

/// The joint information matrix of both kinds with these standard deviations.
pub(super) fn information([surface, outline]: &[Sums; 2], samples: Samples, sigma_mm: [f64; 2]) -> Matrix6<f64> {
    let [surface_weight, outline_weight] = weights(surface, outline, samples, sigma_mm);
    surface.information * surface_weight + outline.information * outline_weight
}

fn weights(surface: &Sums, outline: &Sums, samples: Samples, sigma_mm: [f64; 2]) -> [f64; 2] {
    let weight = |sums: &Sums, samples: f64, sigma_mm: f64| samples / (sums.count.max(1) as f64 * sigma_mm.powi(2));
    [weight(surface, samples.surface, sigma_mm[0]), weight(outline, samples.outline, sigma_mm[1])]
}

/// The twist of (2); `None` where a direction is free.
fn step(sums: &[Sums; 2], samples: Samples, outline_noise_mm: f64) -> Option<Vector6<f64>> {
    let sigma_mm = [RANGE_NOISE_MM, outline_noise_mm];
    let [surface, outline] = sums;
    let [surface_weight, outline_weight] = weights(surface, outline, samples, sigma_mm);
    let gradient = surface.gradient * surface_weight + outline.gradient * outline_weight;
    let information = information(sums, samples, sigma_mm);
    held(&information).then(|| information.cholesky().map(|cholesky| -cholesky.solve(&gradient))).flatten()
}

/// Is every twist held? Each diagonal is compared with what is left of it when the other five are free.
fn held(information: &Matrix6<f64>) -> bool {
    let Some(inverse) = information.try_inverse() else { return false };
    (0..6).all(|i| 1.0 / inverse[(i, i)] > MIN_CONDITION * information[(i, i)])
}

/// The transform followed by a small turn about a point and a small shift, both in the base frame.
fn twisted(base_from_panel: Rigid<Base, Panel>, centre: Point<Base>, twist: Vector6<f64>) -> Rigid<Base, Panel> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(twist[0], twist[1], twist[2]));
    let shift = Vector3::new(twist[3], twist[4], twist[5]);
    let about = centre.mm.coords;
    let base_from_base: Rigid<Base, Base> =
        Rigid::claim(Isometry3::from_parts(Translation3::from(about + shift - turn * about), turn));
    base_from_base * base_from_panel
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// By hand: turned by 0.001 rad about Z at (560, 0, 0), a point 100 mm beside it in Y moves by −0.1 mm in X.
    #[test]
    fn a_twist_turns_about_the_centre() {
        let twist = Vector6::new(0.0, 0.0, 0.001, 0.0, 0.0, 0.5);
        let start: Rigid<Base, Panel> = Rigid::claim(Isometry3::identity());
        let moved = twisted(start, Point::at(560.0, 0.0, 0.0), twist) * Point::at(560.0, 100.0, 360.0);
        assert!((moved.mm - Point3::new(559.9, 100.0, 360.5)).norm() < 1e-4, "{moved:?}");
    }

    /// A plane patch of 5 × 5 points, moved by a known twist: (2) undoes it in one step where the outline holds the
    /// plane sideways, and says that it is free where there is none.
    #[test]
    fn one_step_undoes_a_small_twist() {
        let centre = Point::<Base>::at(560.0, 0.0, 360.0);
        let places: Vec<Point<Base>> = (0..25)
            .map(|i| Point::at(560.0, f64::from(i % 5 - 2) * 40.0, 360.0 + f64::from(i / 5 - 2) * 30.0))
            .collect();
        let twist = Vector6::new(2e-4, -1e-4, 3e-4, 0.3, -0.2, 0.1);
        let identity: Rigid<Base, Panel> = Rigid::claim(Isometry3::identity());
        let off = twisted(identity, centre, twist);
        let constraint = |place: &Point<Base>, normal: Vector3<f64>| {
            let moved = off * Point::<Panel>::new(place.mm);
            Constraint { moved, normal: Vector::new(normal), residual_mm: normal.dot(&(moved - *place).mm) }
        };
        let surface: Vec<_> = places.iter().map(|place| constraint(place, Vector3::x())).collect();
        let side = |place: &Point<Base>| if place.mm.y.abs() > 70.0 { Vector3::y() } else { Vector3::z() };
        let border = places.iter().filter(|place| place.mm.y.abs() > 70.0 || (place.mm.z - 360.0).abs() > 50.0);
        let outline: Vec<_> = border.map(|place| constraint(place, side(place))).collect();
        let samples = Samples { surface: 17.0, outline: 100.0 };
        let sums = [Sums::over(&surface, centre), Sums::over(&outline, centre)];
        let back = step(&sums, samples, 0.1).expect("held");
        assert!((back + twist).norm() < 1e-3 * twist.norm(), "{back}");
        let slides = [Sums::over(&surface, centre), Sums::over(&[], centre)];
        assert_eq!(step(&slides, samples, 0.1), None);
    }
}
