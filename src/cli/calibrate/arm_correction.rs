//! The inputs that a calibration takes from the cell: a camera's rough mount, the correction of the arm, and the true
//! position of the tool's tip.
//!
//! The arm is corrected with the correction that `--robot` names, otherwise with the cell's. The true position of the
//! tip at a touch is computed from the axes and the cell's own tool, not from the pendant's display:
//!
//!     base_from_tip = base_from_flange(axes) · flange_from_tool
//!
//! The pendant shows the tip of the tool that is selected there, for an arm with its nominal geometry. A touch must
//! show how well the cell's tool and the arm's correction agree with the board. So the pendant's position is used only
//! to check that axes and touch belong together.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use super::super::load::{CellFiles, NO_AXES};
use super::files::Points;
use panelprep_base::geometry::{Base, Camera, Flange, Joints, Point, Rigid, Tool};
use panelprep_base::number_text;
use panelprep_cell::cell::{Cell, CorrectionNumbers, FlangeCameraMount, Intrinsics, RobotCorrection, ScannerMount};
use panelprep_cell::files::content_hash;
use panelprep_toolpath::path::Kinematics;
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

/// Reads the cell's file, if it exists; it only limits the result.
pub fn cell_if_present(common: &Common) -> Result<Option<Cell>, Fault> {
    if !common.cell.is_file() {
        return Ok(None);
    }
    Ok(Some(Cell::check(&common.cell.display().to_string(), &disk::read_text(&common.cell)?)?))
}

/// Reads the intrinsics that `--intrinsics` names.
pub fn read_intrinsics(file: &Path) -> Result<Intrinsics, Fault> {
    Ok(Intrinsics::check(&file.display().to_string(), &disk::read_text(file)?)?)
}

/// The correction of the arm that a command applies.
pub struct CorrectionInUse {
    arm: Kinematics,
    /// The hash of the correction's file.
    pub hash: String,
}

impl CorrectionInUse {
    /// Loads the correction from this file or, if none is given, from the file that the cell names; `None` if neither
    /// is named.
    ///
    /// # Errors
    /// If a file cannot be read or is invalid.
    pub fn load(named: Option<&Path>, common: &Common) -> Result<Option<Self>, Fault> {
        let cell = cell_if_present(common)?;
        let of_cell = cell.as_ref().and_then(|cell| cell.calibration().robot_correction.clone());
        let Some(file) = named.map(Path::to_owned).or(of_cell) else { return Ok(None) };
        let cell = match cell {
            Some(cell) => cell,
            None => Cell::check("", "")?,
        };
        let text = disk::read_text(&file)?;
        let numbers = RobotCorrection::check(&file.display().to_string(), &text)?.numbers;
        Ok(Some(Self::new(cell, numbers, content_hash(text.as_bytes()))))
    }

    fn new(cell: Cell, numbers: CorrectionNumbers, hash: String) -> Self {
        CorrectionInUse { arm: Kinematics::new(cell.with_arm_correction(numbers).arm()), hash }
    }

    /// Returns the correction of a cell that was already read; `None` if the cell has none.
    pub fn from_cell(files: &CellFiles) -> Option<Self> {
        files.correction_hash().map(|hash| CorrectionInUse { arm: Kinematics::new(files.cell.arm()), hash })
    }

    /// Returns the true pose of the flange; `name` is the name of the pose in messages.
    ///
    /// # Errors
    /// If the pose has no axes.
    pub fn flange(
        &self,
        (file, name): (&Path, &str),
        reported: Rigid<Base, Flange>,
        joints: Option<&Joints>,
    ) -> Result<Rigid<Base, Flange>, Fault> {
        self.true_flange(reported, joints).ok_or_else(|| Fault::file_fault(file, format!("{name}: {NO_AXES}")))
    }

    /// Returns the true pose of the flange; `None` if the pose has no axes.
    pub fn true_flange(
        &self,
        reported: Rigid<Base, Flange>,
        joints: Option<&Joints>,
    ) -> Option<Rigid<Base, Flange>> {
        Some(self.arm.true_flange(reported, joints?))
    }

    /// Corrects the positions that the tip touched, and the flange's pose at the picture.
    ///
    /// # Errors
    /// If one of them has no axes.
    pub fn correct_tips(&self, file: &Path, points: &mut Points) -> Result<(), Fault> {
        for (index, (touched, joints)) in points.touched.iter_mut().zip(&points.joints).enumerate() {
            let missing = || {
                let (number, why) = (index + 1, "the arm's correction needs the axis angles at each touch");
                Fault::file_fault(file, format!("p{number}_axes_deg = [A1, …, A6] is missing: {why}"))
            };
            let joints = joints.as_ref().ok_or_else(missing)?;
            touched.place = self.tip(touched.place, joints).ok_or_else(missing)?;
        }
        if let Some(reported) = points.base_from_flange {
            let joints = points.flange_joints.as_ref();
            points.base_from_flange = Some(self.flange((file, "base_from_flange"), reported, joints)?);
        }
        Ok(())
    }

    /// Returns the true position of the tip for the position that the controller reported: the tip moves with the
    /// flange, for any tool.
    fn tip(&self, reported: Point<Base>, joints: &Joints) -> Option<Point<Base>> {
        let drawn = self.arm.nominal_flange(joints)?;
        Some(self.arm.true_flange(drawn, joints) * (drawn.inverse() * reported))
    }
}

/// Maximum difference between the pendant's tool and the cell's tool, mm: a new calibration changes the tool by
/// less.
const MAX_TOOL_DIFFERENCE_MM: f64 = 3.0;

/// Moves the tips to the positions that follow from axes and tool. Without axes, a position stays as the pendant shows
/// it, which is that of an arm with its nominal geometry.
///
/// # Errors
/// If axes are missing although the arm has a correction, or if the pendant shows another tip than these axes and the
/// cell's tool give for an arm with its nominal geometry.
pub fn place_tips_by_axes(
    files: &CellFiles,
    flange_from_tool: &Rigid<Flange, Tool>,
    (file, points): (&Path, &mut Points),
) -> Result<(), Fault> {
    let arm = Kinematics::new(files.cell.arm());
    for (index, (touched, joints)) in points.touched.iter_mut().zip(&points.joints).enumerate() {
        let number = index + 1;
        let Some(joints) = joints else {
            if files.cell.arm().correction().is_none() {
                continue;
            }
            let why = "the arm's correction needs the axis angles at each touch";
            return Err(Fault::file_fault(file, format!("p{number}_axes_deg = [A1, …, A6] is missing: {why}")));
        };
        let drawn = arm.nominal_flange(joints);
        let drawn = drawn.ok_or_else(|| {
            Fault::file_fault(file, format!("p{number}_axes_deg: not valid axis angles of this arm"))
        })?;
        let tip = Point::at(0.0, 0.0, 0.0);
        let apart_mm = touched.place.distance_mm(drawn * *flange_from_tool * tip);
        if apart_mm > MAX_TOOL_DIFFERENCE_MM {
            let [off, allowed] = number_text::distinguishable_texts(apart_mm, MAX_TOOL_DIFFERENCE_MM, 1);
            return Err(Fault::file_fault(
                file,
                format!(
                    "p{number}_mm is {off} mm from the tip of the cell's tool at p{number}_axes_deg (limit {allowed} mm). \
                     Select the cell's own tool on the pendant, and write position and axis angles of the same touch"
                ),
            ));
        }
        touched.place = arm.true_flange(drawn, joints) * *flange_from_tool * tip;
    }
    Ok(())
}
