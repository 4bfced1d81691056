//! The objects around the panel, which do not move with it: the fixture behind it, a light back plate and two posts, and
//! flat slabs beside and in front of it at fixed poses in the cell.
//!
//! Every part of the fixture is an upright rectangle that faces the robot, at a constant X of the base frame.

use nalgebra::{Isometry3, Point3, Vector3};

/// An upright rectangle at one X, mm in the base frame; grey level as lit from the front.
#[derive(Debug, Clone, Copy)]
struct Board {
    x_mm: f64,
    y_mm: [f64; 2],
    z_mm: [f64; 2],
    color: [f64; 3],
}

/// The boards, the nearest first.
const BOARDS: [Board; 3] = [
    Board { x_mm: 650.0, y_mm: [78.0, 112.0], z_mm: [-40.0, 760.0], color: [158.0, 161.0, 166.0] },
    Board { x_mm: 650.0, y_mm: [-118.0, -84.0], z_mm: [-40.0, 760.0], color: [158.0, 161.0, 166.0] },
    Board { x_mm: 665.0, y_mm: [-520.0, 520.0], z_mm: [-20.0, 740.0], color: [186.0, 188.0, 184.0] },
];

/// Returns the fixture's parts as objects that block light.
pub(super) fn occluders() -> [Slab; 3] {
    BOARDS.map(|board| {
        let middle = |[low, high]: [f64; 2]| (low + high) / 2.0;
        let centre = Point3::new(board.x_mm, middle(board.y_mm), middle(board.z_mm));
        let half_mm = [board.y_mm, board.z_mm].map(|[low, high]| (high - low) / 2.0);
        Slab::facing(centre, -Vector3::x(), 0.0, half_mm, board.color)
    })
}

/// Colour of the hall behind the fixture: out of focus, and too far away for points.
const HALL_COLOR: [f64; 3] = [52.0, 55.0, 60.0];

/// The surface that a ray meets if it misses the panel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Background {
    /// Length along the ray in units of its direction; `None` in the hall.
    pub depth_mm: Option<f64>,
    /// Cosine of the angle between ray and the surface's normal.
    pub cos_incidence: f64,
    /// Colour as seen, with edges spread over the pixels they cross, grey levels.
    pub color: [f64; 3],
}

/// Returns the fixture or the hall as a ray of the base frame meets it. `pixel_rad` is the angle of one pixel.
pub(super) fn intersect(origin: &Point3<f64>, ray: &Vector3<f64>, pixel_rad: f64) -> Background {
    let mut color = [0.0; 3];
    let mut open = 1.0;
    let mut depth_mm = None;
    for board in &BOARDS {
        let depth = (board.x_mm - origin.x) / ray.x;
        if depth <= 0.0 || !depth.is_finite() {
            continue;
        }
        let (y, z) = (origin.y + depth * ray.y, origin.z + depth * ray.z);
        let inside_mm = (y - board.y_mm[0]).min(board.y_mm[1] - y).min(z - board.z_mm[0]).min(board.z_mm[1] - z);
        let share = (0.5 + inside_mm / (depth * pixel_rad)).clamp(0.0, 1.0) * open;
        if share > 0.0 {
            let light = lamp_light(y, z);
            color = std::array::from_fn(|channel| color[channel] + share * board.color[channel] * light);
            open -= share;
        }
        if depth_mm.is_none() && inside_mm > 0.0 {
            depth_mm = Some(depth);
        }
        if open <= 0.0 {
            break;
        }
    }
    color = std::array::from_fn(|channel| color[channel] + open * HALL_COLOR[channel]);
    Background { depth_mm, cos_incidence: ray.x.abs() / ray.norm(), color }
}

/// The lamp's light on the fixture, a few percent brighter in the middle.
fn lamp_light(y_mm: f64, z_mm: f64) -> f64 {
    let (across, up) = (y_mm / 500.0, (z_mm - 380.0) / 500.0);
    1.03 - 0.09 * (across * across + up * up)
}

/// A flat rectangle; the z axis of its frame is its normal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slab {
    pub base_from_slab: Isometry3<f64>,
    /// Half the slab's width and height, mm.
    pub half_mm: [f64; 2],
    /// Grey levels.
    pub color: [f64; 3],
}

/// The point where a ray meets a slab.
#[derive(Debug, Clone, Copy)]
pub(super) struct SlabHit {
    /// Length along the ray in units of its direction.
    pub depth_mm: f64,
    pub cos_incidence: f64,
    /// The share of the pixel that the slab fills, 0…1.
    pub share: f64,
    pub color: [f64; 3],
}

impl Slab {
    /// Creates a slab that faces a direction.
    pub fn facing(
        centre: Point3<f64>,
        normal: Vector3<f64>,
        spin_rad: f64,
        half_mm: [f64; 2],
        color: [f64; 3],
    ) -> Slab {
        let upright = Isometry3::face_towards(&centre, &(centre + normal), &up_direction(&normal));
        let spin = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), spin_rad);
        Slab { base_from_slab: upright * spin, half_mm, color }
    }

    /// Intersects a ray of the base frame with the slab. `pixel_rad` is the angle of one pixel.
    pub fn intersect(&self, origin: &Point3<f64>, ray: &Vector3<f64>, pixel_rad: f64) -> Option<SlabHit> {
        let from = self.base_from_slab.inverse_transform_point(origin);
        let along = self.base_from_slab.inverse_transform_vector(ray);
        let depth_mm = -from.z / along.z;
        if !(depth_mm.is_finite() && depth_mm > 1.0) {
            return None;
        }
        let (x, y) = (from.x + depth_mm * along.x, from.y + depth_mm * along.y);
        let inside_mm = (self.half_mm[0] - x.abs()).min(self.half_mm[1] - y.abs());
        let share = (0.5 + inside_mm / (depth_mm * pixel_rad)).clamp(0.0, 1.0);
        let cos_incidence = (along.z / along.norm()).abs();
        (share > 0.0 && cos_incidence > 0.05).then_some(SlabHit {
            depth_mm,
            cos_incidence,
            share,
            color: self.color,
        })
    }
}

fn up_direction(normal: &Vector3<f64>) -> Vector3<f64> {
    if normal.z.abs() < 0.9 * normal.norm() { Vector3::z() } else { Vector3::y() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: from (0, 0, 360) straight ahead the plate is 665 mm away; at Y = 95 a post, 650 mm away.
    #[test]
    fn the_plate_and_a_post() {
        let from = |y: f64| Point3::new(0.0, y, 360.0);
        let plate = intersect(&from(0.0), &Vector3::x(), 1e-3);
        assert!((plate.depth_mm.expect("a plate") - 665.0).abs() < 1e-9 && plate.color[0] > 170.0);
        let post = intersect(&from(95.0), &Vector3::x(), 1e-3);
        assert!((post.depth_mm.expect("a post") - 650.0).abs() < 1e-9 && post.color[0] < 170.0);
    }

    /// The x of a slab's frame is the base's Y, and its y points upwards: corners of a part are corners of its
    /// slab.
    #[test]
    fn parts_are_slabs_of_their_size() {
        for (board, slab) in BOARDS.iter().zip(occluders()) {
            let corner = Point3::new(board.x_mm, board.y_mm[1], board.z_mm[1]);
            let at = slab.base_from_slab.inverse_transform_point(&corner);
            assert!((at.x.abs() - slab.half_mm[0]).abs() < 1e-9 && (at.y - slab.half_mm[1]).abs() < 1e-9, "{at}");
            assert!(at.z.abs() < 1e-9, "{at}");
        }
    }

    #[test]
    fn beyond_the_plate_is_the_hall() {
        let hall = intersect(&Point3::new(0.0, 0.0, 900.0), &Vector3::x(), 1e-3);
        assert_eq!((hall.depth_mm, hall.color), (None, HALL_COLOR));
        assert_eq!(intersect(&Point3::new(0.0, 0.0, 360.0), &-Vector3::x(), 1e-3).depth_mm, None);
    }

    /// Calculated by hand: a slab of 40 × 20 mm, 500 mm ahead along X and square to it. Its edge is 20 mm aside;
    /// there it fills half a pixel.
    #[test]
    fn a_slab_ahead_is_met_up_to_its_edge() {
        let slab = Slab::facing(Point3::new(500.0, 0.0, 0.0), -Vector3::x(), 0.0, [20.0, 10.0], [100.0; 3]);
        let look =
            |y: f64, z: f64| slab.intersect(&Point3::origin(), &Vector3::new(1.0, y / 500.0, z / 500.0), 1e-3);
        let middle = look(0.0, 0.0).expect("met");
        assert!((middle.depth_mm - 500.0).abs() < 1e-9 && (middle.cos_incidence - 1.0).abs() < 1e-9);
        assert!((look(20.0, 0.0).expect("met").share - 0.5).abs() < 1e-9);
        assert!(look(0.0, 11.0).is_none());
    }
}
