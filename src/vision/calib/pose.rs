//! The pose of the board from one picture, or from one 3D shot: perspective-n-point (thesis 3.7) and Kabsch.

use super::chain::BoardObservation;
use super::error::CalibError;
use super::foreign;
use panelprep_base::geometry::{Board, Frame, PinholeCamera, Pixel, Point, Rigid, fit_rigid_motion};

/// A board's pose with the residual of its corners: px for pixels, mm for points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardPose<C: Frame> {
    /// The board's pose.
    pub camera_from_board: Rigid<C, Board>,
    /// Root mean square of the distances between measured and computed corners.
    pub rms: f64,
}

/// Computes the board's pose from the observation.
///
/// # Errors
/// If fewer than four corners were seen, or OpenCV finds no pose.
pub fn board_pose<C: Frame>(
    camera: &PinholeCamera,
    seen: &BoardObservation<C>,
) -> Result<BoardPose<C>, CalibError> {
    match seen {
        BoardObservation::Pixels(corners) => {
            let camera_from_board: Rigid<C, Board> =
                Rigid::from_isometry_unchecked(foreign::solve_pnp(camera, corners)?);
            let error = |&(q, found): &(Point<Board>, Pixel)| {
                camera.project(camera_from_board * q).map_or(f64::INFINITY, |pixel| pixel.distance_px(found))
            };
            let rms =
                (corners.iter().map(|corner| error(corner).powi(2)).sum::<f64>() / corners.len() as f64).sqrt();
            Ok(BoardPose { camera_from_board, rms })
        }
        BoardObservation::Points(corners) => kabsch(corners),
    }
}

/// Returns the pose that maps the board's points best onto the measured ones.
fn kabsch<C: Frame>(corners: &[(Point<Board>, Point<C>)]) -> Result<BoardPose<C>, CalibError> {
    if corners.len() < 4 {
        let words = format!("{} points of the board were measured; at least 4 are needed", corners.len());
        return Err(CalibError::Points(words));
    }
    let on_a_line =
        || CalibError::Points("the measured points of the board lie on a line; show more of the board".to_owned());
    let camera_from_board = fit_rigid_motion(corners).ok_or_else(on_a_line)?;
    let square: f64 = corners.iter().map(|(q, p)| (camera_from_board * *q).distance_mm(*p).powi(2)).sum();
    Ok(BoardPose { camera_from_board, rms: (square / corners.len() as f64).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Camera;

    /// Calculated by hand: a quarter turn about Z, then a shift of 100 mm along Z. The mirror image of the plane is
    /// not a solution.
    #[test]
    fn measured_points_give_the_pose() {
        let places = [[0.0, 0.0], [200.0, 0.0], [200.0, 125.0], [0.0, 125.0], [75.0, 50.0]];
        let corners: Vec<_> = places
            .iter()
            .map(|&[x, y]| (Point::<Board>::at(x, y, 0.0), Point::<Camera>::at(-y, x, 100.0)))
            .collect();
        let pose = kabsch(&corners).expect("a pose");
        assert!(pose.rms < 1e-9);
        let ahead = pose.camera_from_board * Point::<Board>::at(1.0, 2.0, 3.0);
        assert!(ahead.distance_mm(Point::at(-2.0, 1.0, 103.0)) < 1e-9, "{ahead:?}");
        assert!(kabsch(&corners[..3]).expect_err("three").to_string().contains("4 are needed"));
    }
}
