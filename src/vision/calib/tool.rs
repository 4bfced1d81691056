//! The tool: its point from poses that hold it at one spot, its axis from a second touch.
//!
//! Point: for every pose i, R_i t + p_i = s, with the tip t in the flange frame and the spot s in the base frame
//! unknown; least squares over n ≥ 4 poses. Axis: a second point of the tool's axis, behind the tip, held at the same
//! spot; or the pad pressed flat on a plate that was touched in three or more points. Z points out of the pad, into the
//! work; X is the flange's X, made perpendicular to Z. A tool without a measured axis has a point but no frame: it is
//! refused for sanding.

use super::error::CalibError;
use super::quantile::radius_95;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use panelprep_base::geometry::{Base, Flange, Point, Rigid, Tool, Vector};
use panelprep_base::number_text::distinguishable_texts;

/// The calibrated point of a tool with its evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolPoint {
    /// Position of the tip in the flange frame, mm.
    pub tip: Point<Flange>,
    /// The spot at which the tip was held.
    pub spot: Point<Base>,
    /// For each pose, the distance of the tip from the spot, mm.
    pub residuals_mm: Vec<f64>,
    /// Root mean square of the residuals, mm.
    pub rms_mm: f64,
    /// Radius that contains the error of the tip with 95 % probability, mm.
    pub uncertainty_mm: f64,
}

/// The touches that determine the direction of the tool's axis.
#[derive(Debug, Clone, PartialEq)]
pub enum AxisTouch {
    /// Flange poses in which a point of the axis behind the tip is at the spot.
    Behind(Vec<Rigid<Base, Flange>>),
    /// Touched points of a plate, and flange poses in which the pad is flat on the plate.
    Plate {
        /// Points of the plate, touched with the tip of the tool or a pointer.
        touched_points: Vec<Point<Base>>,
        /// Flange poses with the pad flat on the plate.
        flat_poses: Vec<Rigid<Base, Flange>>,
    },
}

/// The calibrated axis of a tool with its evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolAxis {
    /// The direction out of the pad.
    pub axis: Vector<Flange>,
    /// The deviation of each touch from the mean, degrees; empty for one touch.
    pub residuals_deg: Vec<f64>,
    /// The rms deviation of the plate's points from a plane, mm; `None` without a plate or with three points.
    pub plate_rms_mm: Option<f64>,
}

/// Minimum number of poses for the point of a tool.
pub const MIN_POSES: usize = 4;
/// Minimum rms sine of the rotations, for the direction in which they determine the tip least.
const MIN_RMS_SINE: f64 = 0.12;
/// Minimum value of the largest distance of the flange from the origin of the base, mm. If all positions are nearer,
/// they are in metres: no arm brings its flange this near in every pose, but in metres its whole reach is below this
/// number.
const MIN_FLANGE_DISTANCE_MM: f64 = 10.0;
/// Minimum distance of the second point from the tip, mm.
const MIN_AXIS_POINT_DISTANCE_MM: f64 = 20.0;

/// Computes the point of the tool.
///
/// # Errors
/// If there are fewer than four poses, or they rotate too little.
pub fn tool_point(poses: &[Rigid<Base, Flange>]) -> Result<ToolPoint, CalibError> {
    let count = poses.len();
    if count < MIN_POSES {
        return Err(CalibError::Tool(format!(
            "{count} poses touch the same spot with the tip; at least {MIN_POSES} are needed"
        )));
    }
    if poses.iter().all(|pose| pose.origin().mm.coords.norm() < MIN_FLANGE_DISTANCE_MM) {
        return Err(CalibError::Tool(format!(
            "each flange lies less than {MIN_FLANGE_DISTANCE_MM} mm from the base's origin, so the positions seem \
             to be in metres; write millimetres"
        )));
    }
    let mut a = DMatrix::zeros(3 * count, 6);
    let mut b = DVector::zeros(3 * count);
    for (index, pose) in poses.iter().enumerate() {
        a.view_mut((3 * index, 0), (3, 3)).copy_from(pose.rotation().matrix());
        a.view_mut((3 * index, 3), (3, 3)).copy_from(&-Matrix3::identity());
        b.rows_mut(3 * index, 3).copy_from(&-pose.origin().mm.coords);
    }
    let normal = a.transpose() * &a;
    let weakest = normal.symmetric_eigenvalues().min().max(0.0);
    // This is checked before the solution: with small rotations the residuals are small for every tip, and would look
    // like evidence.
    let lever = (weakest / count as f64).sqrt();
    if lever < MIN_RMS_SINE {
        let [lever, needed] = distinguishable_texts(lever, MIN_RMS_SINE, 3);
        return Err(CalibError::Tool(format!(
            "the poses rotate too little: the rms sine of their rotations in the weakest direction is {lever}, at \
             least {needed} is needed; rotate the flange by 30° and more about two axes, and check that every angle \
             is in degrees"
        )));
    }
    let singular = || {
        CalibError::Tool(
            "the poses do not determine the tip; rotate the flange about two axes between the poses".to_owned(),
        )
    };
    let inverse = normal.cholesky().ok_or_else(singular)?.inverse();
    let solution = &inverse * (a.transpose() * &b);
    let residuals = &a * &solution - &b;
    let residuals_mm: Vec<f64> = (0..count).map(|index| residuals.rows(3 * index, 3).norm()).collect();
    let redundancy = 3.0 * count as f64 - 6.0;
    let variance = residuals.norm_squared() / redundancy;
    let covariance: Matrix3<f64> = inverse.fixed_view::<3, 3>(0, 0) * variance;
    Ok(ToolPoint {
        tip: Point::at(solution[0], solution[1], solution[2]),
        spot: Point::at(solution[3], solution[4], solution[5]),
        rms_mm: (residuals.norm_squared() / count as f64).sqrt(),
        residuals_mm,
        uncertainty_mm: radius_95(&covariance, redundancy),
    })
}

/// Computes the axis of the tool.
///
/// # Errors
/// If a second point is too near the tip, or a plate is not determined.
pub fn tool_axis(point: &ToolPoint, touch: &AxisTouch) -> Result<ToolAxis, CalibError> {
    let (axes, plate_rms_mm) = match touch {
        AxisTouch::Behind(poses) => (axis_offsets(point, poses)?, None),
        AxisTouch::Plate { touched_points: places, flat_poses: flat } => {
            let (normal, rms_mm) = fit_plate_normal(places)?;
            (flat.iter().map(|pose| orient_normal(pose, &normal)).collect(), rms_mm)
        }
    };
    let sum: Vector3<f64> = axes.iter().sum();
    let none = || {
        CalibError::Tool(
            "the touches do not determine the direction of the tool's axis; check their poses, and touch again"
                .to_owned(),
        )
    };
    let axis = sum.try_normalize(1e-9).ok_or_else(none)?;
    let residuals_deg = axes.iter().map(|each| each.angle(&axis).to_degrees());
    let residuals_deg = if axes.len() > 1 { residuals_deg.collect() } else { Vec::new() };
    Ok(ToolAxis { axis: Vector::new(axis), residuals_deg, plate_rms_mm })
}

fn axis_offsets(point: &ToolPoint, poses: &[Rigid<Base, Flange>]) -> Result<Vec<Vector3<f64>>, CalibError> {
    let axis = |pose: &Rigid<Base, Flange>| {
        let away = (point.tip - pose.inverse() * point.spot).mm;
        let found_mm = away.norm();
        if found_mm < MIN_AXIS_POINT_DISTANCE_MM {
            let [found, needed] = distinguishable_texts(found_mm, MIN_AXIS_POINT_DISTANCE_MM, 1);
            return Err(CalibError::Tool(format!(
                "the second point of the axis is {found} mm from the tip; at least {needed} mm are needed"
            )));
        }
        Ok(away / found_mm)
    };
    poses.iter().map(axis).collect()
}

/// Returns the normal of the plate, and the rms deviation of its points from a plane, mm.
fn fit_plate_normal(places: &[Point<Base>]) -> Result<(Vector3<f64>, Option<f64>), CalibError> {
    let few = |why: &str| CalibError::Tool(format!("the {} touched points of the plate {why}", places.len()));
    if places.len() < 3 {
        return Err(few("do not determine it; at least 3 are needed"));
    }
    let mean: Vector3<f64> = places.iter().map(|place| place.mm.coords).sum::<Vector3<f64>>() / places.len() as f64;
    let spread: Matrix3<f64> =
        places.iter().map(|place| (place.mm.coords - mean) * (place.mm.coords - mean).transpose()).sum();
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    // Points on a line do not determine the rotation of the plate about the line, although the residuals of the fit
    // would be zero.
    if eigen.eigenvalues[order[1]] < 1e-2 * eigen.eigenvalues[order[2]] {
        return Err(few("lie on one line; touch points that are far apart in two directions"));
    }
    let rms_mm = (eigen.eigenvalues[order[0]].max(0.0) / places.len() as f64).sqrt();
    let normal = eigen.eigenvectors.column(order[0]).into_owned();
    // Three points are always on a plane: a residual of zero is then no evidence.
    Ok((normal, (places.len() > 3).then_some(rms_mm)))
}

/// Returns the normal of the plate in the flange frame, on the side to which the flange's Z axis points: a pad faces
/// away from the arm.
fn orient_normal(pose: &Rigid<Base, Flange>, normal: &Vector3<f64>) -> Vector3<f64> {
    let in_flange = pose.inverse().rotation() * normal;
    if in_flange.z < 0.0 { -in_flange } else { in_flange }
}

/// Returns the frame of the tool: its origin is the tip, Z is along the axis, and X is the flange's X, made
/// perpendicular to Z.
pub fn flange_from_tool(tip: Point<Flange>, axis: Vector<Flange>) -> Rigid<Flange, Tool> {
    let z = axis.mm;
    let along = if z.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let x = (along - z * z.dot(&along)).normalize();
    Rigid::from_axes([x, z.cross(&x), z].map(Vector::new), tip)
}

#[cfg(test)]
mod tests {
    use super::super::{gate, readings};
    use super::*;
    use panelprep_base::geometry::KukaPose;
    use panelprep_base::verdict::Verdict;

    /// Returns poses with these angles that hold the tip (10, −5, 180) at the spot (600, 50, 200).
    fn poses(tip: Point<Flange>, angles: &[[f64; 3]]) -> Vec<Rigid<Base, Flange>> {
        let spot = Vector3::new(600.0, 50.0, 200.0);
        let pose = |&[a_deg, b_deg, c_deg]: &[f64; 3]| {
            let turned: Rigid<Base, Flange> = KukaPose { a_deg, b_deg, c_deg, ..KukaPose::default() }.to_rigid();
            turned.followed_by_displacement(Vector::new(spot - (turned * tip).mm.coords))
        };
        angles.iter().map(pose).collect()
    }

    const TIP: [f64; 3] = [10.0, -5.0, 180.0];
    const ANGLES: [[f64; 3]; 5] =
        [[0.0, 0.0, 180.0], [0.0, 35.0, 180.0], [40.0, 0.0, 145.0], [-30.0, -30.0, 200.0], [80.0, 10.0, 170.0]];

    fn tip() -> Point<Flange> {
        Point::at(TIP[0], TIP[1], TIP[2])
    }

    /// Poses with A and C exchanged, and poses in metres, are recognised; correct poses have no other interpretation.
    #[test]
    fn other_readings_of_the_angles_and_metres_are_named() {
        let right = poses(tip(), &ANGLES);
        assert_eq!(readings::tip_readings(&right), []);
        let exchanged = |pose: &Rigid<Base, Flange>| -> Rigid<Base, Flange> {
            let written: KukaPose = KukaPose::from_rigid(pose);
            KukaPose { a_deg: written.c_deg, c_deg: written.a_deg, ..written }.to_rigid()
        };
        let exchanged: Vec<Rigid<Base, Flange>> = right.iter().map(exchanged).collect();
        let named = readings::tip_readings(&exchanged);
        assert!(
            named.first().is_some_and(|first| first.to_string().contains("A and C are exchanged")),
            "{named:?}"
        );
        let judgement = gate::tool(&tool_point(&exchanged).expect("a point"), None, &named);
        assert_eq!(judgement.verdict, Verdict::Reject);
        assert!(judgement.reasons[0].message.contains("A and C are exchanged"), "{judgement:?}");
        let in_metres: Vec<Rigid<Base, Flange>> = right
            .iter()
            .map(|pose| {
                let written: KukaPose = KukaPose::from_rigid(pose);
                let [x_mm, y_mm, z_mm] = [written.x_mm, written.y_mm, written.z_mm].map(|mm| mm / 1000.0);
                KukaPose { x_mm, y_mm, z_mm, ..written }.to_rigid()
            })
            .collect();
        let refused = tool_point(&in_metres).expect_err("metres").to_string();
        assert!(refused.contains("in metres"), "{refused}");
    }

    #[test]
    fn the_tip_is_found_and_a_wrong_pose_has_a_residual() {
        let mut held = poses(tip(), &ANGLES);
        let point = tool_point(&held).expect("a tip");
        assert!(point.tip.distance_mm(tip()) < 1e-9 && point.rms_mm < 1e-9, "{point:?}");
        assert!(point.spot.distance_mm(Point::at(600.0, 50.0, 200.0)) < 1e-9);
        held[2] = held[2].followed_by_displacement(Vector::new(Vector3::new(0.0, 3.0, 0.0)));
        let point = tool_point(&held).expect("a tip");
        let worst = point.residuals_mm.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        assert_eq!(worst.map(|(index, _)| index), Some(2), "{:?}", point.residuals_mm);
        assert!(point.uncertainty_mm > point.tip.distance_mm(tip()), "{point:?}");
    }

    #[test]
    fn poses_with_little_rotation_are_refused() {
        let alike = [[0.0, 0.0, 180.0], [2.0, 1.0, 179.0], [1.0, 2.0, 181.0], [3.0, 0.0, 182.0]];
        let error = tool_point(&poses(tip(), &alike)).expect_err("alike").to_string();
        assert!(error.contains("rotate too little"), "{error}");
        assert!(tool_point(&poses(tip(), &ANGLES[..3])).expect_err("three").to_string().contains("4 are needed"));
    }

    /// Expected value, calculated by hand: the second point is 60 mm behind the tip along (0, 0.6, 0.8) in the flange
    /// frame, so this direction is the axis.
    #[test]
    fn a_second_point_gives_the_axis() {
        let point = tool_point(&poses(tip(), &ANGLES)).expect("a tip");
        let axis = Vector3::new(0.0, 0.6, 0.8);
        let second = Point::<Flange>::new(tip().mm - axis * 60.0);
        let found = tool_axis(&point, &AxisTouch::Behind(poses(second, &ANGLES[1..3]))).expect("an axis");
        assert!((found.axis.mm - axis).norm() < 1e-9 && found.residuals_deg.iter().all(|deg| *deg < 1e-6));
        let tool = flange_from_tool(point.tip, found.axis);
        assert!((tool.rotation() * Vector3::z() - axis).norm() < 1e-12);
        assert!((tool.rotation() * Vector3::x() - Vector3::x()).norm() < 1e-12, "X stays the flange's");
        let near = Point::<Flange>::new(tip().mm - axis * 5.0);
        assert!(tool_axis(&point, &AxisTouch::Behind(poses(near, &ANGLES[1..2]))).is_err());
    }

    /// Expected value, calculated by hand: on a level plate, a flange rotated by C = 180° has the normal along its own
    /// +Z.
    #[test]
    fn a_plate_gives_the_axis() {
        let point = tool_point(&poses(tip(), &ANGLES)).expect("a tip");
        let places = [[0.0, 0.0], [100.0, 0.0], [0.0, 80.0], [90.0, 70.0]];
        let places: Vec<Point<Base>> = places.iter().map(|&[x, y]| Point::at(500.0 + x, y, 150.0)).collect();
        let flat = poses(tip(), &[[0.0, 0.0, 180.0], [70.0, 0.0, 180.0]]);
        let touch = AxisTouch::Plate { touched_points: places.clone(), flat_poses: flat.clone() };
        let found = tool_axis(&point, &touch).expect("an axis");
        assert!((found.axis.mm - Vector3::z()).norm() < 1e-9 && found.plate_rms_mm.is_some_and(|rms| rms < 1e-9));
        let line = AxisTouch::Plate { touched_points: vec![places[0], places[1], places[1]], flat_poses: flat };
        assert!(tool_axis(&point, &line).expect_err("a line").to_string().contains("one line"));
    }
}
