//! Where the scan shows the panel's edge beside a point of its taught outline.
//!
//! The measured depths say roughly: inside of the edge they lie on the panel's surface, outside of it behind. Colour says
//! exactly, where both sides differ in brightness. Where something nearer hides the edge there is none to be found.

use super::grid::{Motion, camera_point};
use super::model::{Model, Scan};
use super::profile::{self, REACH};
use super::search::outward_px;
use crate::geometry::{PinholeCamera, Pixel};
use nalgebra::{Vector2, Vector3};

/// A point this far from the surface's plane is another thing, mm, and this much more for each px from the edge.
const ON_MM: f64 = 1.5;
const ON_MM_PER_PX: f64 = 0.15;
/// A surface more slanted than this is judged as if it were not: cosine of the angle.
const MOST_SLANTED: f64 = 0.3;
/// So many of the last pixels inside of an edge are looked at, and so many of them must be on the surface.
const INSIDE_PX: i32 = 6;
const MIN_INSIDE: usize = 3;
/// Colour and depth may put the edge this far apart, px.
const COLOUR_NEAR_PX: f64 = 2.6;
/// Depths that leave the edge open over more than this say nothing, px.
const MAX_OPEN_PX: i32 = 8;

/// What was found beside a point of the outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Edge {
    /// The edge by colour, so far outside of the point, px; the step is so wide.
    Colour { offset_px: f64, width_px: f64 },
    /// The edge by depth alone.
    Depth { offset_px: f64 },
    /// Something nearer hides it, or the surface looks away.
    Hidden,
    /// It lies outside of the picture.
    OutOfView,
    /// The surface goes on beyond the outline, or is not there.
    Absent,
}

/// A point of the outline in the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Looked {
    pub point: Vector3<f64>,
    /// The residual's growth across the outline in the picture, px per mm.
    pub gradient: Vector3<f64>,
    pub edge: Edge,
}

#[derive(Clone, Copy, PartialEq)]
enum Depth {
    On,
    Farther,
    Nearer,
    Missing,
}

/// Looks for the edge beside a point of the outline.
pub(super) fn look(
    motion: &Motion,
    model: &Model,
    camera: &PinholeCamera,
    scan: &Scan,
    k: usize,
) -> Option<Looked> {
    let sample = &model.outline[k];
    let point = motion.point(&sample.point);
    let (pixel, slope) = camera.project_with_slope(camera_point(&point))?;
    let outward = motion.turn * sample.outward;
    let across = outward_px(&(slope * (motion.turn * sample.along)), &(slope * outward))?;
    let px_per_mm = across.dot(&(slope * outward));
    let gradient = slope.transpose() * across;
    let looks_away = (motion.turn * sample.normal).dot(&point) > -0.1 * point.norm() || px_per_mm < 0.1;
    let edge = if looks_away {
        Edge::Hidden
    } else {
        edge(scan, pixel, across, &Tangent::of(camera, pixel, &point, &(motion.turn * sample.normal)))
    };
    Some(Looked { point, gradient, edge })
}

/// The surface's plane beside a point, as the picture shows it: its inverse depth is linear in the pixels.
struct Tangent {
    at: Pixel,
    inverse: f64,
    /// Growth of the inverse depth, per mm and px.
    slope: Vector2<f64>,
    /// How squarely it is seen, 0…1.
    cos: f64,
}

impl Tangent {
    fn of(camera: &PinholeCamera, at: Pixel, point: &Vector3<f64>, normal: &Vector3<f64>) -> Tangent {
        let distance = normal.dot(point);
        Tangent {
            at,
            inverse: 1.0 / point.z,
            slope: Vector2::new(normal.x / (camera.fx_px * distance), normal.y / (camera.fy_px * distance)),
            cos: (distance.abs() / point.norm()).max(MOST_SLANTED),
        }
    }

    /// How far a depth at a pixel lies behind the plane, along its normal, mm.
    fn behind_mm(&self, column: usize, row: usize, depth_mm: f64) -> f64 {
        let way = Vector2::new(column as f64 - self.at.u, row as f64 - self.at.v);
        let plane_mm = 1.0 / (self.inverse + self.slope.dot(&way));
        self.cos * (depth_mm - plane_mm)
    }
}

fn edge(scan: &Scan, pixel: Pixel, across: Vector2<f64>, tangent: &Tangent) -> Edge {
    let reach = REACH as i32;
    let margin = f64::from(reach) + 1.0;
    let (width, height) = (scan.width() as f64, scan.height() as f64);
    let inside = pixel.u >= margin && pixel.v >= margin && pixel.u < width - margin && pixel.v < height - margin;
    if !inside {
        return Edge::OutOfView;
    }
    let depth = |offset: i32| {
        let way = f64::from(offset);
        let (u, v) = (pixel.u + way * across.x, pixel.v + way * across.y);
        let (column, row) = (u.round() as usize, v.round() as usize);
        let [_, _, z] = scan.raw_points_mm()[row * scan.width() + column];
        let away = tangent.behind_mm(column, row, f64::from(z));
        if z.is_nan() {
            Depth::Missing
        } else if away.abs() <= ON_MM + ON_MM_PER_PX * way.abs() {
            Depth::On
        } else if away > 0.0 {
            Depth::Farther
        } else {
            Depth::Nearer
        }
    };
    let depths: Vec<Depth> = (-reach..=reach).map(depth).collect();
    let (last_on, first_off) = match by_depth(&depths) {
        Ok(found) => found,
        Err(edge) => return edge,
    };
    let rough_px = f64::from(last_on + first_off) / 2.0 - f64::from(reach);
    let line = profile::line(scan, pixel, [across.x, across.y]);
    let step = line.and_then(|line| profile::step(&line, rough_px));
    match step.filter(|step| (step.offset_px - rough_px).abs() <= COLOUR_NEAR_PX) {
        Some(step) => Edge::Colour { offset_px: step.offset_px, width_px: step.width_px },
        None => Edge::Depth { offset_px: rough_px },
    }
}

/// The last place on the surface and the first one off it.
fn by_depth(depths: &[Depth]) -> Result<(i32, i32), Edge> {
    let count = depths.len() as i32;
    let at = |i: i32| depths.get(i as usize).copied().unwrap_or(Depth::Missing);
    // A single flying point is no end: two of three beyond it must be off as well.
    let ends = |i: i32, what: Depth| at(i) == what && (i + 1..i + 4).filter(|&j| at(j) == what).count() >= 2;
    let farther = (0..count).find(|&i| ends(i, Depth::Farther));
    let nearer = (0..count).find(|&i| ends(i, Depth::Nearer));
    let first_off = match (farther, nearer) {
        (None, None) => {
            // Nothing was measured beyond: the hall, or black things.
            let last = (0..count).rev().find(|&i| at(i) == Depth::On).ok_or(Edge::Absent)?;
            if last >= count - 4 {
                return Err(Edge::Absent);
            }
            last + 2
        }
        (Some(far), Some(near)) if near < far => return Err(Edge::Hidden),
        (None, Some(_)) => return Err(Edge::Hidden),
        (Some(far), _) => far,
    };
    let last_on = (0..first_off).rev().find(|&i| at(i) == Depth::On).ok_or(Edge::Absent)?;
    let on = (last_on - INSIDE_PX + 1..=last_on).filter(|&i| i >= 0 && at(i) == Depth::On).count();
    if on < MIN_INSIDE || first_off - last_on > MAX_OPEN_PX {
        return Err(Edge::Absent);
    }
    Ok((last_on, first_off))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn depths(text: &str) -> Vec<Depth> {
        text.chars()
            .map(|sign| match sign {
                'o' => Depth::On,
                'f' => Depth::Farther,
                'n' => Depth::Nearer,
                _ => Depth::Missing,
            })
            .collect()
    }

    /// By hand: the surface ends at place 9, the plate begins at 12; one flying point on the way is nothing.
    #[test]
    fn depths_say_where_the_surface_ends() {
        assert_eq!(by_depth(&depths("oooooooooo--ffffff")), Ok((9, 12)));
        assert_eq!(by_depth(&depths("ooooofoooo--ffffff")), Ok((9, 12)), "a flying point");
        assert_eq!(by_depth(&depths("oooooooooo--------")), Ok((9, 11)), "the hall");
        assert_eq!(by_depth(&depths("ooooooo-nnnnnnffff")), Err(Edge::Hidden), "something before it");
        assert_eq!(by_depth(&depths("oooooooooooooooooo")), Err(Edge::Absent), "it goes on");
        assert_eq!(by_depth(&depths("ffffffffffffffffff")), Err(Edge::Absent), "it is not there");
    }
}
