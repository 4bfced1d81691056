//! The uncertainty of a pose, as the uncertainty of the places that it puts in space.

use super::frames::{Camera, Panel};
use super::rigid::{Point, Rigid, Vector};
use nalgebra::{Matrix6, Vector6};

/// The covariance of a pose: a small twist (ω, v) about a centre, in the camera's frame, rad and mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseUncertainty {
    /// The pose.
    pub camera_from_panel: Rigid<Camera, Panel>,
    /// The point about which the twist turns.
    pub centre: Point<Panel>,
    /// The covariance of the twist.
    pub covariance: Matrix6<f64>,
}

impl PoseUncertainty {
    /// Returns one standard deviation of a place along a direction of length 1, mm; NaN if the covariance is not known.
    /// A twist moves the place with the arm r from the centre by ω × r + v, and along n by ω · (r × n) + v · n.
    pub fn along_mm(&self, place: Point<Panel>, direction: Vector<Panel>) -> f64 {
        let arm = (self.camera_from_panel * place - self.camera_from_panel * self.centre).mm;
        let along = (self.camera_from_panel * direction).mm;
        let turning = arm.cross(&along);
        let moves = Vector6::new(turning.x, turning.y, turning.z, along.x, along.y, along.z);
        // Not `max`: it would make 0 of a NaN.
        (self.covariance * moves).dot(&moves).clamp(0.0, f64::INFINITY).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    /// By hand: a tilt of 1 mrad about y moves a place that is 100 mm away along x by 0.1 mm along the normal, which
    /// together with a shift of 0.05 mm is 0.1118 mm. Along x it moves by nothing.
    #[test]
    fn a_tilt_counts_with_its_arm() {
        let turned = Isometry3::rotation(Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
        let mut covariance = Matrix6::zeros();
        // The panel's y is the camera's −x.
        covariance[(0, 0)] = 1e-6;
        covariance[(5, 5)] = 0.0025;
        let camera_from_panel = Rigid::from_isometry_unchecked(turned);
        let pose = PoseUncertainty { camera_from_panel, centre: Point::at(5.0, 0.0, 0.0), covariance };
        let place = Point::at(105.0, 0.0, 0.0);
        let [normal, aside] = [Vector3::z(), Vector3::x()].map(|axis| pose.along_mm(place, Vector::new(axis)));
        assert!((normal - 0.111_803).abs() < 1e-6 && aside < 1e-12, "{normal} {aside}");
    }

    #[test]
    fn an_unknown_covariance_is_no_certainty() {
        let camera_from_panel = Rigid::from_isometry_unchecked(Isometry3::identity());
        let covariance = Matrix6::repeat(f64::NAN);
        let pose = PoseUncertainty { camera_from_panel, centre: Point::at(0.0, 0.0, 0.0), covariance };
        assert!(pose.along_mm(Point::at(1.0, 0.0, 0.0), Vector::new(Vector3::z())).is_nan());
    }
}
