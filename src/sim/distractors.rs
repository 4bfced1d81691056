//! Objects beside and in front of the panel: flat slabs at fixed poses in the cell, which do not move with the
//! panel.

use nalgebra::{Isometry3, Point3, Vector3};

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
