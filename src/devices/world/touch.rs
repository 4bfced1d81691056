//! The positions of the running disc on the true panel, from the motions that the mock controller executed.
//!
//! A sample is used if both ends of its motion are in contact, the tool is on, and its point is within the pad's reach
//! of the true surface. The disc is assumed to touch the surface with its whole area, as a compliant pad does.

use crate::mock::ContactSample;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use panelprep_base::geometry::{Panel, Point, Rigid, Tool, Vector};
use panelprep_sim::{CellTruth, TrueSpot};
use panelprep_toolpath::path::{StepOver, step_overs_mm};

/// Maximum distance from the surface at which the pad touches it, mm.
const PAD_REACH_MM: f64 = 2.0;
/// Minimum cosine of the angle between a step and the direction of the rows at which the step belongs to a row.
const MIN_ROW_COSINE: f64 = 0.98;

/// The points of the panel that the disc has touched.
#[derive(Debug, Clone)]
pub struct TouchedPoints {
    centres: Vec<Point<Panel>>,
    radius_mm: f64,
}

impl TouchedPoints {
    /// Determines the points that a disc of this diameter has touched during the trace.
    pub fn reached_by_disc(trace: &[ContactSample], truth: &CellTruth, disc_diameter_mm: f64) -> Self {
        let touches = |point: &Point<Panel>| truth.distance_mm(*point).abs() <= PAD_REACH_MM;
        let centres =
            sanding_poses(trace, truth).map(|panel_from_tool| panel_from_tool.origin()).filter(touches).collect();
        TouchedPoints { centres, radius_mm: disc_diameter_mm / 2.0 }
    }

    /// Returns the positions of the disc's centre.
    pub fn centres(&self) -> &[Point<Panel>] {
        &self.centres
    }

    /// Returns whether the disc has touched this point.
    pub fn was_touched(&self, point: Point<Panel>) -> bool {
        self.centres.iter().any(|centre| centre.distance_mm(point) <= self.radius_mm)
    }

    /// Returns the fraction of these points that the disc has touched, 0 to 1. Each point represents the same area. If
    /// there are no points, the fraction is 0.
    pub fn share(&self, points: &[Point<Panel>]) -> f64 {
        let covered = points.iter().filter(|point| self.was_touched(**point)).count();
        covered as f64 / points.len().max(1) as f64
    }

    /// Returns the covered fraction of a spot's area, 0…1.
    pub fn covered_share(&self, spot: &TrueSpot) -> f64 {
        const RINGS: usize = 8;
        let reach_mm = spot.outline.iter().map(|point| point.distance_mm(spot.centre)).fold(0.0, f64::max);
        let near = |centre: &&Point<Panel>| centre.distance_mm(spot.centre) <= reach_mm + self.radius_mm;
        let near = TouchedPoints { centres: self.centres.iter().filter(near).copied().collect(), ..*self };
        let (mut whole_mm2, mut covered_mm2) = (0.0, 0.0);
        // The spot is divided into sectors about its centre, and each sector into rings of equal area.
        for (index, &from) in spot.outline.iter().enumerate() {
            let to = spot.outline[(index + 1) % spot.outline.len()];
            let (from, to) = (from - spot.centre, to - spot.centre);
            let ring_mm2 = from.mm.cross(&to.mm).norm() / 2.0 / RINGS as f64;
            for ring in 0..RINGS {
                let outwards = ((ring as f64 + 0.5) / RINGS as f64).sqrt();
                let place = spot.centre + Vector::new((from.mm + to.mm) / 2.0) * outwards;
                whole_mm2 += ring_mm2;
                covered_mm2 += if near.was_touched(place) { ring_mm2 } else { 0.0 };
            }
        }
        covered_mm2 / whole_mm2
    }
}

/// The deviations of the tool from the true surface while it sanded.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ContactErrors {
    /// Number of ticks of the controller in contact.
    pub samples: usize,
    /// Maximum angle between the tool's axis and the true normal, degrees.
    pub normal_max_deg: f64,
    /// Maximum distance of the TCP from the true surface, mm.
    pub surface_max_mm: f64,
}

/// Returns the deviations of the tool from the true surface; `None` if the tool was never in contact.
pub fn contact_errors(trace: &[ContactSample], truth: &CellTruth) -> Option<ContactErrors> {
    let of = |panel_from_tool: Rigid<Panel, Tool>| {
        let outward = panel_from_tool * Vector::<Tool>::new(-Vector3::z());
        let point = panel_from_tool.origin();
        (outward.angle_between(truth.normal(point)).0, truth.distance_mm(point).abs())
    };
    let none = ContactErrors { samples: 0, normal_max_deg: 0.0, surface_max_mm: 0.0 };
    let errors = sanding_poses(trace, truth).map(of).fold(none, |all, (normal_deg, surface_mm)| ContactErrors {
        samples: all.samples + 1,
        normal_max_deg: all.normal_max_deg.max(normal_deg),
        surface_max_mm: all.surface_max_mm.max(surface_mm),
    });
    (errors.samples > 0).then_some(errors)
}

/// Measures the minimum and maximum distance between neighbouring rows of the executed track; `None` if there are fewer
/// than two rows.
///
/// The rows of a grid are parallel to the main direction of its track; the connections between rows are not.
pub fn measure_step_over(trace: &[ContactSample], truth: &CellTruth) -> Option<StepOver> {
    let mut found: Option<StepOver> = None;
    // Between two grids the tool leaves the panel, so the trace is split at the gaps.
    for grid in trace.chunk_by(|before, after| before.sanding == after.sanding) {
        let track: Vec<Point<Panel>> =
            sanding_poses(grid, truth).map(|panel_from_tool| panel_from_tool.origin()).collect();
        for pair in rows(&track).windows(2) {
            for step_mm in step_overs_mm(&pair[0], &pair[1]) {
                let so_far = found.unwrap_or(StepOver { min_mm: step_mm, max_mm: step_mm });
                found = Some(StepOver { min_mm: so_far.min_mm.min(step_mm), max_mm: so_far.max_mm.max(step_mm) });
            }
        }
    }
    found
}

/// Returns the straight rows of a track over one grid, in order.
fn rows(track: &[Point<Panel>]) -> Vec<Vec<Point<Panel>>> {
    let steps: Vec<Vector3<f64>> = track.windows(2).map(|pair| (pair[1] - pair[0]).mm).collect();
    let way: Matrix3<f64> = steps.iter().map(|step| step * step.transpose() / step.norm().max(f64::EPSILON)).sum();
    let principal = SymmetricEigen::new(way);
    let along: Vector3<f64> = principal.eigenvectors.column(principal.eigenvalues.imax()).into();
    let heading = |step: &Vector3<f64>| {
        let cosine = step.dot(&along) / step.norm().max(f64::EPSILON);
        if cosine.abs() > MIN_ROW_COSINE { cosine.signum() as i32 } else { 0 }
    };
    let headings: Vec<(usize, i32)> = steps.iter().map(heading).enumerate().collect();
    let straight = headings.chunk_by(|before, after| before.1 == after.1).filter(|row| row[0].1 != 0);
    straight.map(|row| track[row[0].0..=row[row.len() - 1].0 + 1].to_vec()).filter(|row| row.len() > 2).collect()
}

/// Returns the tool's pose in the frame of the true panel, at each tick in which it sanded.
fn sanding_poses<'a>(
    trace: &'a [ContactSample],
    truth: &CellTruth,
) -> impl Iterator<Item = Rigid<Panel, Tool>> + 'a {
    let panel_from_base = truth.base_from_panel.inverse();
    trace
        .iter()
        .filter(|sample| sample.sanding && sample.tool_on)
        .map(move |sample| panel_from_base * sample.base_from_tool)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use panelprep_base::geometry::Base;
    use panelprep_sim::{Cell, Scene};

    fn sample(base_from_tool: Rigid<Base, Tool>) -> ContactSample {
        let base_from_flange = Rigid::from_isometry_unchecked(Isometry3::identity());
        ContactSample { time_ms: 0, base_from_flange, base_from_tool, sanding: true, tool_on: true }
    }

    /// Returns a sample with the tool at this height above a point of the true surface, along the normal.
    fn standing(truth: &CellTruth, point: Point<Panel>, height_mm: f64) -> ContactSample {
        let normal = truth.normal(point);
        let turn = nalgebra::UnitQuaternion::rotation_between(&Vector3::z(), &-normal.mm).expect("not opposite");
        let origin = (point + normal * height_mm).mm.coords;
        let panel_from_tool =
            Rigid::<Panel, Tool>::from_isometry_unchecked(Isometry3::from_parts(origin.into(), turn));
        sample(truth.base_from_panel * panel_from_tool)
    }

    /// Expected values, calculated by hand: a disc of 200 mm at the centre of a spot covers the whole spot. A disc of 8
    /// mm covers a circle of π·4² mm².
    #[test]
    fn a_disc_covers_its_own_area_of_a_spot() {
        let truth = Cell::new(1, Scene::Good, 8).truth();
        let spot = &truth.spots[0];
        let on = [standing(&truth, spot.centre, 0.0)];
        assert!((TouchedPoints::reached_by_disc(&on, &truth, 200.0).covered_share(spot) - 1.0).abs() < 1e-12);
        let share = TouchedPoints::reached_by_disc(&on, &truth, 8.0).covered_share(spot);
        assert!((share - std::f64::consts::PI * 16.0 / spot.area_mm2).abs() < 0.02, "{share}");
        let above = [standing(&truth, spot.centre, 2.1)];
        assert_eq!(
            TouchedPoints::reached_by_disc(&above, &truth, 200.0).covered_share(spot),
            0.0,
            "the pad does not reach"
        );
        let off = [ContactSample { tool_on: false, ..on[0] }];
        assert_eq!(
            TouchedPoints::reached_by_disc(&off, &truth, 200.0).share(&[spot.centre]),
            0.0,
            "it does not turn"
        );
        let lands = [ContactSample { sanding: false, ..on[0] }];
        assert_eq!(TouchedPoints::reached_by_disc(&lands, &truth, 200.0).share(&[spot.centre]), 0.0);
    }

    /// Expected values, calculated by hand: rows of 60 mm on a flat panel at distances of 10, 10 and 12 mm, with
    /// connecting motions between neighbouring rows.
    #[test]
    fn rows_are_distinguished_from_their_connections() {
        let at = |x_mm: f64, y_mm: f64| Point::<Panel>::at(0.0, x_mm, y_mm);
        let mut track = Vec::new();
        for (row, y_mm) in [0.0, 10.0, 20.0, 32.0].into_iter().enumerate() {
            let forth = (0..=30).map(|step| f64::from(step) * 2.0);
            let xs: Vec<f64> = if row % 2 == 0 { forth.collect() } else { forth.rev().collect() };
            track.extend(xs.into_iter().map(|x_mm| at(x_mm, y_mm)));
            // A point of the connecting motion, half-way to the next row.
            let end_mm = if row % 2 == 0 { 60.0 } else { 0.0 };
            track.push(at(end_mm, y_mm + 5.0));
        }
        let rows = rows(&track);
        assert_eq!(rows.iter().map(Vec::len).collect::<Vec<_>>(), [31; 4]);
        let steps: Vec<f64> = rows.windows(2).flat_map(|pair| step_overs_mm(&pair[0], &pair[1])).collect();
        let (min_mm, max_mm) =
            steps.iter().fold((f64::MAX, 0.0_f64), |(min, max), step| (min.min(*step), max.max(*step)));
        assert!((min_mm - 10.0).abs() < 1e-9 && (max_mm - 12.0).abs() < 1e-9, "{steps:?}");
    }

    #[test]
    fn contact_is_measured_along_the_true_normal() {
        let truth = Cell::new(1, Scene::Good, 8).truth();
        let point = truth.spots[0].centre;
        let turned = standing(&truth, point, 0.0);
        let by_half_a_degree: Rigid<Tool, Tool> =
            Rigid::from_isometry_unchecked(Isometry3::rotation(Vector3::x() * 0.5_f64.to_radians()));
        let turned = sample(turned.base_from_tool * by_half_a_degree);
        let errors = contact_errors(&[standing(&truth, point, -0.3), turned], &truth).expect("contact");
        assert_eq!(errors.samples, 2);
        assert!((errors.surface_max_mm - 0.3).abs() < 1e-6, "{errors:?}");
        assert!((errors.normal_max_deg - 0.5).abs() < 1e-6, "{errors:?}");
        assert_eq!(contact_errors(&[], &truth), None);
    }
}
