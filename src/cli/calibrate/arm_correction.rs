//! The correction of the arm with which a calibration corrects the robot's poses: the correction that `--robot`
//! names, otherwise the cell's.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use super::super::load::{CellFiles, NO_AXES};
use super::files::Points;
use super::mounted;
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid};
use panelprep_cell::cell::{Cell, CorrectionNumbers, RobotCorrection};
use panelprep_cell::files::content_hash;
use panelprep_toolpath::path::Kinematics;
use std::path::Path;

/// The correction in use.
pub struct CorrectionInUse {
    arm: Kinematics,
    /// The hash of the correction's file.
    pub hash: String,
}

impl CorrectionInUse {
    /// Loads the correction of this file, else the one of the cell's file; `None` if neither is named.
    ///
    /// # Errors
    /// If a file cannot be read or is invalid.
    pub fn load(named: Option<&Path>, common: &Common) -> Result<Option<Self>, Fault> {
        let cell = mounted::cell(common)?;
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

    /// The correction of a cell that was already read; `None` if it has none.
    pub fn from_cell(files: &CellFiles) -> Option<Self> {
        files.correction_hash().map(|hash| CorrectionInUse { arm: Kinematics::new(files.cell.arm()), hash })
    }

    /// The true pose of the flange; `name` is the name of the pose in messages.
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
