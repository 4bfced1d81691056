//! What a calibration takes from the cell's file and from a 3D camera for each kind of mount.

use super::chain::{Arrangement, BoardObservation};
use panelprep_base::geometry::{Base, Camera, Point, Rigid};
use panelprep_cell::cell::{Cell, FlangeCameraMount, ScannerMount};

/// The functions of a mount in addition to those of its arrangement.
pub trait Mounted: Arrangement {
    /// Returns the mount's rough pose from the cell's file.
    fn rough_pose(cell: &Cell) -> Option<Rigid<Self::To, Self::From>>;

    /// Converts points of a 3D camera to points in the frame of this mount's camera.
    fn points(seen: BoardObservation<Camera>) -> Option<BoardObservation<Self::From>>;

    /// Returns a point of the base as the camera sees it, if the camera is fixed.
    fn point_in_camera(mount: &Rigid<Self::To, Self::From>, point: Point<Base>) -> Option<Point<Self::From>>;
}

impl Mounted for ScannerMount {
    fn rough_pose(cell: &Cell) -> Option<Rigid<Base, Camera>> {
        cell.rough_mounts().base_from_camera
    }

    fn points(seen: BoardObservation<Camera>) -> Option<BoardObservation<Camera>> {
        Some(seen)
    }

    fn point_in_camera(mount: &Rigid<Base, Camera>, point: Point<Base>) -> Option<Point<Camera>> {
        Some(mount.inverse() * point)
    }
}

impl Mounted for FlangeCameraMount {
    fn rough_pose(cell: &Cell) -> Option<Rigid<Self::To, Self::From>> {
        cell.rough_mounts().flange_from_camera
    }

    fn points(_: BoardObservation<Camera>) -> Option<BoardObservation<Self::From>> {
        None
    }

    fn point_in_camera(_: &Rigid<Self::To, Self::From>, _: Point<Base>) -> Option<Point<Self::From>> {
        None
    }
}

/// Returns the points of a board that a 3D camera measured, in the frame of this mount's camera; `None` if it measured
/// less than half of the `detected` corners.
pub fn points_of_most<A: Mounted>(
    seen: BoardObservation<Camera>,
    detected: usize,
) -> Option<BoardObservation<A::From>> {
    let BoardObservation::Points(points) = &seen else { return None };
    if 2 * points.len() < detected {
        return None;
    }
    A::points(seen)
}
