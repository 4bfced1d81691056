//! A camera's mount, and the previous knowledge of it in the cell's files.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use panelprep_base::geometry::{Base, Camera, Point, Rigid};
use panelprep_cell::cell::{Cell, FlangeCameraMount, Intrinsics, ScannerMount};
use panelprep_vision::calib::{Arrangement, BoardObservation};
use std::path::Path;

/// The functions of a mount that the command needs in addition to those of its arrangement.
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

/// Reads the cell's file, if it exists: it is only used to limit the result.
pub fn cell(common: &Common) -> Result<Option<Cell>, Fault> {
    if !common.cell.is_file() {
        return Ok(None);
    }
    Ok(Some(Cell::check(&common.cell.display().to_string(), &disk::read_text(&common.cell)?)?))
}

/// Reads the intrinsics that `--intrinsics` names.
pub fn intrinsics(file: &Path) -> Result<Intrinsics, Fault> {
    Ok(Intrinsics::check(&file.display().to_string(), &disk::read_text(file)?)?)
}
