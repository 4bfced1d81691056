//! How far the disc reaches beyond the panel's outline.
//!
//! The overhang at a contact point is R − d inside the outline and R + d outside the outline, d being the distance
//! to the nearest outline point. Inside or outside is determined in the outline's mean plane, so a panel must not
//! bend by 180°.

use nalgebra::Vector3;
use panelprep_base::geometry::{Panel, Pixel, Point, polygon};

/// Outline points that share one bounding sphere.
const BLOCK: usize = 32;

/// How far a disc reaches beyond the outline along a plan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DiscOverhang {
    /// The largest overhang, mm; 0 if the disc stays on the panel.
    pub largest_mm: f64,
    /// Fraction of contact waypoints with a larger overhang than allowed, 0…1.
    pub share_beyond: f64,
}

/// The panel's outline, prepared for many distance calculations.
#[derive(Debug, Clone)]
pub struct Outline {
    points: Vec<Point<Panel>>,
    // Bounding sphere of each block of outline points: centre, and radius, mm.
    blocks: Vec<(Point<Panel>, f64)>,
    // Directions that span the mean plane, and the outline in it, mm.
    plane_axes: [Vector3<f64>; 2],
    plane_outline: Vec<Pixel>,
}

impl Outline {
    /// Creates the outline from its points in order, closed.
    pub fn new(points: &[Point<Panel>]) -> Self {
        let block = |block: &[Point<Panel>]| {
            let sum = block.iter().fold(Vector3::zeros(), |sum, point| sum + point.mm.coords);
            let centre = Point::new((sum / block.len() as f64).into());
            (centre, block.iter().map(|point| point.distance_mm(centre)).fold(0.0, f64::max))
        };
        let across = mean_plane(points);
        Outline {
            points: points.to_vec(),
            blocks: points.chunks(BLOCK).map(block).collect(),
            plane_axes: across,
            plane_outline: points.iter().map(|point| to_plane(across, *point)).collect(),
        }
    }

    /// Returns whether there is an outline at all.
    pub(super) fn is_present(&self) -> bool {
        !self.points.is_empty()
    }

    /// Returns how far a disc of this radius around a contact point reaches beyond the outline, mm; 0 if it does not.
    pub fn overhang_mm(&self, contact: Point<Panel>, radius_mm: f64) -> f64 {
        let (_, distance_mm) = self.nearest(contact);
        if self.contains(contact) { (radius_mm - distance_mm).max(0.0) } else { radius_mm + distance_mm }
    }

    /// Returns the direction from a contact point that leads out of the outline at its nearest point; `None` without
    /// an outline.
    pub(super) fn outward_direction(&self, contact: Point<Panel>) -> Option<Vector3<f64>> {
        let towards = (self.nearest(contact).0? - contact).mm;
        Some(if self.contains(contact) { towards } else { -towards })
    }

    fn contains(&self, contact: Point<Panel>) -> bool {
        polygon::contains(&self.plane_outline, to_plane(self.plane_axes, contact))
    }

    fn nearest(&self, point: Point<Panel>) -> (Option<Point<Panel>>, f64) {
        let mut nearest = (None, f64::INFINITY);
        for ((centre, radius_mm), block) in self.blocks.iter().zip(self.points.chunks(BLOCK)) {
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

/// Returns two directions perpendicular to the polygon's area vector.
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

    /// By hand: in an upright square of ±50 mm, a disc of 15 mm at 40 mm reaches 5 mm over the edge. In the middle
    /// it does not reach over the edge, and 10 mm beyond the edge it reaches 25.
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
