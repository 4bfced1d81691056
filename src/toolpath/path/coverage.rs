//! Calculates the part of a grid that the disc covers, and the disc's overhang beyond the panel's outline.
//!
//! Coverage is the fraction of a grid that the disc reaches. A sample point of the surface is covered if its distance
//! to the contact track is at most the disc's radius. Sample points are about 1 mm apart and have the weight |S_u ×
//! S_v|. The pad is compliant, so the whole disc is assumed to be in contact. The distance between adjacent rows is
//! calculated from the same track.
//!
//! The overhang at a contact point is R − d inside of the outline and R + d outside, where d is the distance to the
//! nearest outline point. Inside or outside is determined in the outline's mean plane, so a panel must not bend by
//! 180°.

use crate::surface::{BSplineSurface, Parameter, ParameterPatch};
use nalgebra::Vector3;
use panelprep_base::geometry::{Panel, Pixel, Point, polygon};
use panelprep_cell::panel::GridId;
use rayon::prelude::*;

/// Minimum covered fraction of each grid, 0…1.
pub const MIN_COVERAGE: f64 = 0.995;
/// Approximate distance between sample points, mm.
const SAMPLE_DISTANCE_MM: f64 = 1.0;

/// Number of outline points in one bounding sphere.
const OUTLINE_BLOCK_SIZE: usize = 32;

/// The coverage of a grid, or of the treated part of a grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridCoverage {
    /// The grid to which the coverage belongs.
    pub id: GridId,
    /// The area of the grid or part on the surface, mm².
    pub area_mm2: f64,
    /// The part of this area that the disc covers, mm².
    pub covered_mm2: f64,
}

impl GridCoverage {
    /// Returns the covered fraction of the area, 0…1.
    pub fn covered_fraction(&self) -> f64 {
        self.covered_mm2 / self.area_mm2
    }
}

/// A straight segment of a track in contact.
pub(super) type ContactSegment = (Point<Panel>, Point<Panel>);

/// Returns the straight segments between successive points of the track that are both in contact. A single point is not
/// a segment: the disc sands only while it moves, and the dwell time counts only motion.
pub(super) fn strokes(track: &[Point<Panel>], contact: impl Fn(usize) -> bool) -> Vec<ContactSegment> {
    let pairs = track.windows(2).enumerate().filter(|(index, _)| contact(*index) && contact(index + 1));
    pairs.map(|(_, pair)| (pair[0], pair[1])).collect()
}

/// Calculates the part of a grid that these strokes of the disc cover.
pub(super) fn coverage(
    surface: &BSplineSurface,
    (id, patch): (GridId, &ParameterPatch),
    strokes: &[ContactSegment],
    radius_mm: f64,
) -> GridCoverage {
    let middle = surface.tangents(patch.parameter_at(Parameter { u: 0.5, v: 0.5 }));
    let samples = |length_mm: f64| (length_mm / SAMPLE_DISTANCE_MM).ceil().max(1.0) as usize;
    let across = samples(middle.s_u.mm.norm() * (patch.high.u - patch.low.u));
    let down = samples(middle.s_v.mm.norm() * (patch.high.v - patch.low.v));
    // Only the segments near the grid are used, because the track may be long.
    let corners = [0.0, 1.0].map(|u| [0.0, 1.0].map(|v| surface.point(patch.parameter_at(Parameter { u, v }))));
    let reach_mm = corners.iter().flatten().map(|corner| corner.distance_mm(middle.point)).fold(0.0, f64::max);
    let near = |piece: &&ContactSegment| {
        foot_fraction(middle.point, piece.0, piece.1).1 <= 1.1 * reach_mm + radius_mm + SAMPLE_DISTANCE_MM
    };
    let track: Vec<&ContactSegment> = strokes.iter().filter(near).collect();
    let cell = (patch.high.u - patch.low.u) * (patch.high.v - patch.low.v) / (across * down) as f64;
    let mut found = GridCoverage { id, area_mm2: 0.0, covered_mm2: 0.0 };
    // Adjacent sample points are usually covered by the same segment of the track, so the last segment is tried first.
    let mut last = 0;
    for sample in 0..across * down {
        let share = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
        let at =
            patch.parameter_at(Parameter { u: share(sample % across, across), v: share(sample / across, down) });
        let tangents = surface.tangents(at);
        let area_mm2 = tangents.area_mm2() * cell;
        let covers = |piece: usize| foot_fraction(tangents.point, track[piece].0, track[piece].1).1 <= radius_mm;
        let pieces = track.len();
        let hit = (0..pieces).map(|step| (last + step) % pieces).find(|piece| covers(*piece));
        found.area_mm2 += area_mm2;
        if let Some(piece) = hit {
            last = piece;
            found.covered_mm2 += area_mm2;
        }
    }
    found
}

/// Returns the fraction of these points that the disc reaches, 0…1; `None` without points.
pub(super) fn reached_fraction(places: &[Point<Panel>], strokes: &[ContactSegment], radius_mm: f64) -> Option<f64> {
    let is_reached =
        |place: &&Point<Panel>| strokes.iter().any(|(from, to)| foot_fraction(**place, *from, *to).1 <= radius_mm);
    let reached = places.par_iter().filter(is_reached).count();
    (!places.is_empty()).then(|| reached as f64 / places.len() as f64)
}

/// Returns the point of a segment that is nearest to a given point, as a fraction 0…1 of the segment, and the distance
/// between the two points, mm.
fn foot_fraction(point: Point<Panel>, from: Point<Panel>, to: Point<Panel>) -> (f64, f64) {
    let (piece, offset) = ((to - from).mm, (point - from).mm);
    let length2 = piece.norm_squared();
    let share = if length2 > 0.0 { (offset.dot(&piece) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (share, (offset - piece * share).norm())
}

/// Returns the distances, mm, from the waypoints of a row to the next row. Waypoints beside which the next row does not
/// run, and the connections between rows, are excluded.
pub fn step_overs_mm(row: &[Point<Panel>], next: &[Point<Panel>]) -> Vec<f64> {
    if let ([point], [other]) = (row, next) {
        return vec![point.distance_mm(*other)];
    }
    let beside = |point: &Point<Panel>| {
        let feet =
            next.windows(2).enumerate().map(|(index, piece)| (index, foot_fraction(*point, piece[0], piece[1])));
        let (index, (share, distance_mm)) = feet.min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
        let beyond = (index == 0 && share <= 0.0) || (index + 2 == next.len() && share >= 1.0);
        (!beyond).then_some(distance_mm)
    };
    row.iter().filter_map(beside).collect()
}

/// The disc's overhang beyond the outline along a plan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DiscOverhang {
    /// The largest overhang, mm; 0 if the disc stays on the panel.
    pub largest_mm: f64,
    /// Fraction of the waypoints in contact whose overhang exceeds the limit, 0…1.
    pub share_beyond: f64,
}

/// The panel's outline with data for fast distance calculations.
#[derive(Debug, Clone)]
pub struct Outline {
    points: Vec<Point<Panel>>,
    // Bounding sphere of each block of outline points: centre, and radius in mm.
    blocks: Vec<(Point<Panel>, f64)>,
    // Two directions that span the outline's mean plane.
    plane_axes: [Vector3<f64>; 2],
    plane_outline: Vec<Pixel>,
}

impl Outline {
    /// Creates the closed outline from its points in order.
    pub fn new(points: &[Point<Panel>]) -> Self {
        let block = |block: &[Point<Panel>]| {
            let sum = block.iter().fold(Vector3::zeros(), |sum, point| sum + point.mm.coords);
            let centre = Point::new((sum / block.len() as f64).into());
            (centre, block.iter().map(|point| point.distance_mm(centre)).fold(0.0, f64::max))
        };
        let across = mean_plane(points);
        Outline {
            points: points.to_vec(),
            blocks: points.chunks(OUTLINE_BLOCK_SIZE).map(block).collect(),
            plane_axes: across,
            plane_outline: points.iter().map(|point| to_plane(across, *point)).collect(),
        }
    }

    /// Returns whether the outline is known.
    pub(super) fn is_present(&self) -> bool {
        !self.points.is_empty()
    }

    /// Returns the overhang beyond the outline of a disc of this radius around a contact point, mm; 0 if there is no
    /// overhang.
    pub fn overhang_mm(&self, contact: Point<Panel>, radius_mm: f64) -> f64 {
        let (_, distance_mm) = self.nearest(contact);
        if self.contains(contact) { (radius_mm - distance_mm).max(0.0) } else { radius_mm + distance_mm }
    }

    /// Returns the direction from a contact point that leads out of the panel at the nearest outline point; `None`
    /// without an outline.
    pub(super) fn outward_direction(&self, contact: Point<Panel>) -> Option<Vector3<f64>> {
        let towards = (self.nearest(contact).0? - contact).mm;
        Some(if self.contains(contact) { towards } else { -towards })
    }

    fn contains(&self, contact: Point<Panel>) -> bool {
        polygon::contains(&self.plane_outline, to_plane(self.plane_axes, contact))
    }

    fn nearest(&self, point: Point<Panel>) -> (Option<Point<Panel>>, f64) {
        let mut nearest = (None, f64::INFINITY);
        for ((centre, radius_mm), block) in self.blocks.iter().zip(self.points.chunks(OUTLINE_BLOCK_SIZE)) {
            if point.distance_mm(*centre) - radius_mm < nearest.1 {
                let closer = |best: (Option<Point<Panel>>, f64), other: &Point<Panel>| {
                    let away = point.distance_mm(*other);
                    if away < best.1 { (Some(*other), away) } else { best }
                };
                nearest = block.iter().fold(nearest, closer);
            }
        }
        nearest
    }
}

/// Returns two directions that span the polygon's mean plane: both are perpendicular to its area vector.
fn mean_plane(points: &[Point<Panel>]) -> [Vector3<f64>; 2] {
    let Some(first) = points.first() else { return [Vector3::x(), Vector3::y()] };
    let cross = |pair: &[Point<Panel>]| (pair[0] - *first).mm.cross(&(pair[1] - *first).mm);
    let area = points.windows(2).fold(Vector3::zeros(), |sum, pair| sum + cross(pair));
    let normal = area.try_normalize(1e-9).unwrap_or(Vector3::z());
    let mut least_along = Vector3::zeros();
    least_along[normal.iamin()] = 1.0;
    let x = normal.cross(&least_along).normalize();
    [x, normal.cross(&x)]
}

fn to_plane([x, y]: [Vector3<f64>; 2], point: Point<Panel>) -> Pixel {
    Pixel::at(point.mm.coords.dot(&x), point.mm.coords.dot(&y))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: in a vertical square of ±50 mm, a disc of 15 mm radius at 40 mm has an
    /// overhang of 5 mm. In the middle it has none, and at 10 mm outside of the edge it has 25 mm.
    #[test]
    fn a_disc_at_the_edge_of_an_upright_square() {
        let corner = |n: usize| {
            let (side, along) = (n / 100, (n % 100) as f64 - 50.0);
            [
                Point::at(along, 7.0, -50.0),
                Point::at(50.0, 7.0, along),
                Point::at(-along, 7.0, 50.0),
                Point::at(-50.0, 7.0, -along),
            ][side]
        };
        let outline = Outline::new(&(0..400).map(corner).collect::<Vec<_>>());
        for (x, overhang_mm) in [(40.0, 5.0), (0.0, 0.0), (60.0, 25.0), (-41.5, 6.5)] {
            assert!((outline.overhang_mm(Point::at(x, 7.0, 0.0), 15.0) - overhang_mm).abs() < 1e-9);
        }
    }
}
