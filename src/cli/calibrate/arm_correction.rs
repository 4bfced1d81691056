//! The inputs that a calibration takes from the cell: the rough mount of a camera, the correction of the arm, and the
//! true position of the TCP.
//!
//! The arm is corrected with the correction that `--robot` names, otherwise with the cell's correction. The true
//! position of the TCP at a touch is computed from the axis angles and the cell's own tool, instead of the position
//! that the pendant shows:
//!
//!     base_from_tip = base_from_flange(axes) · flange_from_tool
//!
//! The pendant shows the TCP of the tool that is selected there, for an arm with its nominal geometry. A touch must
//! show how well the cell's tool and the correction of the arm agree with the board. So the pendant's position is used
//! only to check that axis angles and position belong to the same touch.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use super::files::Points;
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid, Tool};
use panelprep_base::number_text;
use panelprep_cell::cell::{Cell, CorrectionNumbers, Intrinsics, RobotCorrection};
use panelprep_cell::files::content_hash;
use panelprep_service::setup::{CellFiles, NO_AXES};
use panelprep_toolpath::path::Kinematics;
use std::path::Path;

/// Reads the cell's file, if it exists; it only limits the result.
pub fn read_cell_if_present(common: &Common) -> Result<Option<Cell>, Fault> {
    if !common.cell.is_file() {
        return Ok(None);
    }
    Ok(Some(Cell::check(&common.cell.display().to_string(), &disk::read_text(&common.cell)?)?))
}

/// Reads the lens file that `--intrinsics` names.
pub fn read_intrinsics(file: &Path) -> Result<Intrinsics, Fault> {
    Ok(Intrinsics::check(&file.display().to_string(), &disk::read_text(file)?)?)
}

/// The correction of the arm that a command applies.
pub struct CorrectionInUse {
    arm: Kinematics,
    /// The hash of the correction file.
    pub hash: String,
}

impl CorrectionInUse {
    /// Loads the correction from this file or, if none is given, from the file that the cell names. Returns `None` if
    /// neither exists.
    ///
    /// # Errors
    /// If a file cannot be read or is invalid.
    pub fn load(named: Option<&Path>, common: &Common) -> Result<Option<Self>, Fault> {
        let cell = read_cell_if_present(common)?;
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

    /// Returns the correction of a cell whose files are already read; `None` if the cell has none.
    pub fn from_cell(files: &CellFiles) -> Option<Self> {
        files.correction_hash().map(|hash| CorrectionInUse { arm: Kinematics::new(files.cell.arm()), hash })
    }

    /// Returns the true pose of the flange; `name` is the name of the pose in messages.
    ///
    /// # Errors
    /// If the pose has no axis angles.
    pub fn flange(
        &self,
        (file, name): (&Path, &str),
        reported: Rigid<Base, Flange>,
        joints: Option<&Joints>,
    ) -> Result<Rigid<Base, Flange>, Fault> {
        self.true_flange(reported, joints).ok_or_else(|| Fault::file_fault(file, format!("{name}: {NO_AXES}")))
    }

    /// Returns the true pose of the flange; `None` if the pose has no axis angles.
    pub fn true_flange(
        &self,
        reported: Rigid<Base, Flange>,
        joints: Option<&Joints>,
    ) -> Option<Rigid<Base, Flange>> {
        Some(self.arm.true_flange(reported, joints?))
    }

    /// Corrects the touched positions, and the flange pose of the picture.
    ///
    /// # Errors
    /// If a position or the pose has no axis angles.
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

    /// Returns the true position of the TCP for the position that the controller reported. The correction moves the TCP
    /// together with the flange, so the tool need not be known.
    fn tip(&self, reported: Point<Base>, joints: &Joints) -> Option<Point<Base>> {
        let drawn = self.arm.nominal_flange(joints)?;
        Some(self.arm.true_flange(drawn, joints) * (drawn.inverse() * reported))
    }
}

/// Maximum difference between the TCP on the pendant and that of the cell, mm; a new calibration changes the TCP by
/// less.
const MAX_TOOL_DIFFERENCE_MM: f64 = 3.0;

/// Replaces touched positions by the positions that follow from axis angles and tool. A touch without axis angles keeps
/// the position of the pendant, which is correct for an arm with its nominal geometry.
///
/// # Errors
/// If axis angles are missing although the arm has a correction, or if the pendant's position does not match the axis
/// angles and the cell's tool.
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
                    "p{number}_mm is {off} mm from the tip of the cell's tool at p{number}_axes_deg (limit {allowed} \
                     mm). Select the cell's own tool on the pendant, and write position and axis angles of the same \
                     touch"
                ),
            ));
        }
        touched.place = arm.true_flange(drawn, joints) * *flange_from_tool * tip;
    }
    Ok(())
}
