//! Computes the effect of the disc on the surface: for each square millimetre, the dwell time and the number of passes,
//! and the uniformity of the dwell times.
//!
//! Every grid has sample points about 1 mm apart, and a path is divided into steps of 1 mm. Each step adds its time to
//! the sample points within the disc's radius. If the previous step did not reach a sample point, another pass begins
//! at this point. The path consists of poses, planned or as the robot reported them, so the executed path is evaluated
//! in the same way. A pose that should be in contact is in contact if its point is not more than a millimetre above the
//! surface. The pad is compliant, so the whole disc is assumed to be in contact. The uniformity is stated by the 5 %
//! and 95 % quantiles of the dwell times over the treated area.

use super::bspline::{BSplineSurface, Parameter};
use super::patch::{ParameterPatch, SampleGrid, Treated, sides_mm};
use panelprep_base::geometry::{Panel, Point, Rigid, Tool};
use panelprep_cell::panel::{GridId, Region};
use rayon::prelude::*;

/// Distance between sample points, and between steps along a path, mm.
const SAMPLE_DISTANCE_MM: f64 = 1.0;
/// Maximum height of the tool's point above the surface at which the disc still touches the surface, mm.
pub const MAX_CONTACT_HEIGHT_MM: f64 = 1.0;
/// Maximum number of iterations in the search for the surface point below a given point.
const MAX_FOOT_STEPS: usize = 12;
/// Step length at which the search for the surface point ends, mm.
const FOOT_TOLERANCE_MM: f64 = 1e-4;

/// Fractions of the treated area for the quantiles of the dwell times.
const QUANTILE_FRACTIONS: [f64; 2] = [0.05, 0.95];

/// A pose of a path that was executed or is planned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExecutedPose {
    /// The tool's pose in the panel's frame.
    pub panel_from_tool: Rigid<Panel, Tool>,
    /// Time since the previous pose, s.
    pub seconds: f64,
    /// Whether the tool should be in contact and running on the motion to this pose.
    pub contact: bool,
    /// The contact force that a compliant tool measured at this pose, N. A pose between two reports has the force of
    /// the later report.
    pub force_n: Option<f64>,
}

/// The dwell times on one grid, for each sample point.
#[derive(Debug, Clone, PartialEq)]
pub struct GridDwell {
    /// The grid to which the values belong.
    pub id: GridId,
    /// Number of sample points along u.
    pub columns: usize,
    /// Dwell time at each sample point, s, row by row.
    pub dwell_s: Vec<f32>,
    /// Number of passes of the disc at each sample point.
    pub passes: Vec<u16>,
    /// Surface area of each sample point, mm²; 0 outside of the treated area.
    pub area_mm2: Vec<f32>,
}

impl Dwell {
    /// Returns an evaluated grid.
    pub fn grid(&self, id: GridId) -> Option<&GridDwell> {
        self.grids.iter().find(|grid| grid.id == id)
    }
}

impl GridDwell {
    /// Returns the fraction of the treated area of the grid that the disc reached, 0…1.
    pub fn covered_fraction(&self) -> f64 {
        self.area_fraction(|passes| passes > 0)
    }

    /// Returns the uniformity of the dwell time; `None` if the disc reached no sample point.
    pub fn spread(&self) -> Option<DwellSpread> {
        DwellSpread::from_times(self.times())
    }

    /// Returns the dwell time, s, and the area, mm², of each sample point in the treated area.
    fn times(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let times = self.dwell_s.iter().zip(&self.area_mm2);
        let treated = times.filter(|(_, area)| **area > 0.0);
        treated.map(|(dwell_s, area)| (f64::from(*dwell_s), f64::from(*area)))
    }

    /// Returns the fraction of the treated area over which the disc passed more than once, 0…1.
    pub fn overlap(&self) -> f64 {
        self.area_fraction(|passes| passes > 1)
    }

    /// Returns the treated area that the disc did not reach, mm².
    pub fn untreated_mm2(&self) -> f64 {
        self.area_where_mm2(|passes| passes == 0)
    }

    /// Returns the mean dwell time of the area that the disc reached, s.
    pub fn mean_dwell_s(&self) -> f64 {
        let reached = self.times().filter(|(dwell_s, _)| *dwell_s > 0.0);
        let (sum, count) = reached.fold((0.0, 0_usize), |(sum, count), (dwell_s, _)| (sum + dwell_s, count + 1));
        sum / count.max(1) as f64
    }

    fn area(&self) -> f64 {
        self.area_mm2.iter().map(|area| f64::from(*area)).sum()
    }

    fn area_fraction(&self, counts: impl Fn(u16) -> bool) -> f64 {
        self.area_where_mm2(counts) / self.area()
    }

    fn area_where_mm2(&self, counts: impl Fn(u16) -> bool) -> f64 {
        let counted = self.passes.iter().zip(&self.area_mm2).filter(|(passes, _)| counts(**passes));
        // The sum starts at 0 explicitly, because an empty sum of floats is −0.
        counted.fold(0.0, |sum, (_, area)| sum + f64::from(*area))
    }
}

/// The dwell times on all evaluated grids.
#[derive(Debug, Clone, PartialEq)]
pub struct Dwell {
    /// The dwell times on each grid.
    pub grids: Vec<GridDwell>,
    sides_mm: [f64; 2],
}

/// One step of the disc along the path.
struct Step {
    at: Parameter,
    point: Point<Panel>,
    /// Reach of the disc along u and v, in units of the parameters, with a margin of 10 %.
    reach: [f64; 2],
    seconds: f64,
}

/// Computes the dwell times of a path on these grids.
pub fn simulate(
    surface: &BSplineSurface,
    region: &Region,
    grids: &[GridId],
    executed: &[ExecutedPose],
    radius_mm: f64,
) -> Dwell {
    simulate_treated(surface, region, &Treated::from_grids(grids), executed, radius_mm)
}

/// Computes the dwell times of a path on these areas. Covered fractions, untreated areas and spreads apply to the
/// areas; times and passes are computed for the whole grids in which the areas lie.
pub fn simulate_treated(
    surface: &BSplineSurface,
    region: &Region,
    treated: &Treated,
    executed: &[ExecutedPose],
    radius_mm: f64,
) -> Dwell {
    let steps = steps(surface, executed, radius_mm);
    let known =
        treated.grids().iter().filter_map(|id| ParameterPatch::for_grid(region, *id).map(|patch| (*id, patch)));
    let known: Vec<(GridId, ParameterPatch)> = known.collect();
    let of_grid =
        |(id, patch): &(GridId, ParameterPatch)| grid_dwell(surface, (*id, patch), treated, (&steps, radius_mm));
    Dwell { grids: known.par_iter().map(of_grid).collect(), sides_mm: sides_mm(surface) }
}

/// Returns the steps of the path in contact, each projected onto the surface.
fn steps(surface: &BSplineSurface, executed: &[ExecutedPose], radius_mm: f64) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut guess = Parameter { u: 0.5, v: 0.5 };
    for pair in executed.windows(2).filter(|pair| pair[1].contact) {
        let (from, to) = (pair[0].panel_from_tool.origin(), pair[1].panel_from_tool.origin());
        let count = (from.distance_mm(to) / SAMPLE_DISTANCE_MM).ceil().max(1.0) as usize;
        for step in 0..=count {
            let point = from + (to - from) * (step as f64 / count as f64);
            let Some(at) = surface_foot(surface, guess, point) else { continue };
            guess = at;
            let tangents = surface.tangents(at);
            let off = surface.unit_normal(&tangents).map(|normal| normal.mm.dot(&(point - tangents.point).mm));
            if off.is_none_or(|height_mm| height_mm > MAX_CONTACT_HEIGHT_MM) {
                continue;
            }
            // The first and the last step have half of the time.
            let share = if step == 0 || step == count { 0.5 } else { 1.0 } / count as f64;
            // With slanted parameter lines the disc extends over more than its radius: the height of a rhombus is its
            // side times the sine of its angle.
            let lengths = [tangents.s_u.mm.norm(), tangents.s_v.mm.norm()];
            let sine = tangents.area_mm2() / (lengths[0] * lengths[1]);
            let reach = lengths.map(|per_unit| 1.1 * radius_mm / (per_unit * sine));
            steps.push(Step { at, point: tangents.point, reach, seconds: pair[1].seconds * share });
        }
    }
    steps
}

/// Returns the parameters of the surface point below or above a point, by the Gauss–Newton method; `None` if no surface
/// point is near.
pub fn surface_foot(surface: &BSplineSurface, guess: Parameter, point: Point<Panel>) -> Option<Parameter> {
    let mut at = guess;
    for _ in 0..MAX_FOOT_STEPS {
        let tangents = surface.tangents(at);
        let (s_u, s_v, off) = (tangents.s_u.mm, tangents.s_v.mm, (point - tangents.point).mm);
        let (e, f, g) = (s_u.dot(&s_u), s_u.dot(&s_v), s_v.dot(&s_v));
        let area2 = e * g - f * f;
        let (a, b) = (off.dot(&s_u), off.dot(&s_v));
        let (du, dv) = ((g * a - f * b) / area2, (e * b - f * a) / area2);
        if !(du.is_finite() && dv.is_finite()) {
            return None;
        }
        // The parameters are limited, because far outside of the domain the border polynomials can have any value.
        at = Parameter { u: (at.u + du).clamp(-0.2, 1.2), v: (at.v + dv).clamp(-0.2, 1.2) };
        if (s_u * du + s_v * dv).norm() < FOOT_TOLERANCE_MM {
            return Some(at);
        }
    }
    None
}

fn grid_dwell(
    surface: &BSplineSurface,
    (id, patch): (GridId, &ParameterPatch),
    treated: &Treated,
    (steps, radius_mm): (&[Step], f64),
) -> GridDwell {
    let net = SampleGrid::from_patch(surface, *patch, SAMPLE_DISTANCE_MM);
    let mut points = Vec::with_capacity(net.count());
    let mut found = GridDwell {
        id,
        columns: net.columns,
        dwell_s: vec![0.0; net.count()],
        passes: vec![0; net.count()],
        area_mm2: Vec::with_capacity(net.count()),
    };
    for sample in 0..net.count() {
        let at = net.parameter_at(sample);
        let tangents = surface.tangents(at);
        points.push(tangents.point);
        let area_mm2 = if treated.holds(at) { tangents.area_mm2() * net.cell() } else { 0.0 };
        found.area_mm2.push(area_mm2 as f32);
    }
    let mut last_step = vec![usize::MAX - 1; net.count()];
    for (index, Step { at, point, reach: [reach_u, reach_v], seconds }) in steps.iter().enumerate() {
        let low = Parameter { u: at.u - reach_u, v: at.v - reach_v };
        let high = Parameter { u: at.u + reach_u, v: at.v + reach_v };
        for sample in net.points_around(low, high) {
            if points[sample].distance_mm(*point) <= radius_mm {
                found.dwell_s[sample] += *seconds as f32;
                found.passes[sample] += u16::from(last_step[sample].wrapping_add(1) != index);
                last_step[sample] = index;
            }
        }
    }
    found
}

impl Dwell {
    /// Returns the area of all grids that the disc reached, mm².
    pub fn under_disc_mm2(&self) -> f64 {
        self.grids.iter().fold(0.0, |sum, grid| sum + grid.area_where_mm2(|passes| passes > 0))
    }

    /// Returns the covered fraction of all grids together, 0…1.
    pub fn covered_fraction(&self) -> f64 {
        let (covered, all) = self.grids.iter().fold((0.0, 0.0), |(covered, all), grid| {
            (covered + grid.area_where_mm2(|passes| passes > 0), all + grid.area())
        });
        covered / all
    }

    /// Returns the uniformity of the dwell time over all grids; `None` if the disc reached no sample point.
    pub fn spread(&self) -> Option<DwellSpread> {
        DwellSpread::from_times(self.grids.iter().flat_map(GridDwell::times))
    }

    /// Returns the longest dwell time of a sample point, s.
    pub fn longest_s(&self) -> f64 {
        self.grids.iter().flat_map(|grid| &grid.dwell_s).fold(0.0, |most, dwell| f64::max(most, f64::from(*dwell)))
    }

    /// Returns the lengths of the region along u and along v, through its middle, mm.
    pub fn sides_mm(&self) -> [f64; 2] {
        self.sides_mm
    }
}

/// Values in ascending order, each with the area to which it applies.
#[derive(Debug, Clone, PartialEq)]
pub struct AreaWeighted(Vec<(f64, f64)>);

impl AreaWeighted {
    /// Sorts values with their areas.
    pub fn from_values(numbers: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut sorted: Vec<(f64, f64)> = numbers.collect();
        sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        AreaWeighted(sorted)
    }

    /// Returns the quantile of the values for this fraction of the area; `None` without values.
    pub fn quantile_by_area(&self, share: f64) -> Option<f64> {
        let mut left = share * self.0.iter().map(|(_, area)| area).sum::<f64>();
        let found = self.0.iter().find(|(_, area)| {
            left -= area;
            left <= 0.0
        });
        // If rounding leaves a remainder of the area, the largest value is returned.
        found.or(self.0.last()).map(|(number, _)| *number)
    }
}

/// The 5 % and 95 % quantiles of the dwell time over the area that the disc reaches. The remaining area is reported by
/// the coverage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DwellSpread {
    /// The 5 % quantile of the dwell time, s.
    pub low_s: f64,
    /// The 95 % quantile of the dwell time, s.
    pub high_s: f64,
}

impl DwellSpread {
    /// Computes the quantiles from times in s, each with its area; `None` if the disc reached no sample point.
    pub fn from_times(times: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        let treated = AreaWeighted::from_values(times.filter(|(time_s, _)| *time_s > 0.0));
        let [low_s, high_s] = QUANTILE_FRACTIONS.map(|share| treated.quantile_by_area(share));
        Some(DwellSpread { low_s: low_s?, high_s: high_s? })
    }

    /// Returns the 95 % quantile divided by the 5 % quantile.
    pub fn ratio(&self) -> f64 {
        self.high_s / self.low_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: of 100 points of 1 mm² with 0.01 to 1.00 s the fifth has 0.05 s and the
    /// 95th 0.95 s. A point that the disc did not reach is excluded, and a point of twice the area has twice the
    /// weight.
    #[test]
    fn five_and_ninety_five_percent_of_the_area() {
        let even = |n: usize| (n as f64 / 100.0, 1.0);
        let spread = DwellSpread::from_times((0..=100).map(even)).expect("treated");
        assert!((spread.low_s - 0.05).abs() < 1e-12 && (spread.high_s - 0.95).abs() < 1e-12, "{spread:?}");
        assert!((spread.ratio() - 19.0).abs() < 1e-9);
        let doubled = DwellSpread::from_times([(1.0, 2.0), (2.0, 17.0), (5.0, 1.0)].into_iter()).expect("treated");
        assert_eq!((doubled.low_s, doubled.high_s), (1.0, 2.0));
        assert_eq!(DwellSpread::from_times([(0.0, 1.0)].into_iter()), None);
    }
}
