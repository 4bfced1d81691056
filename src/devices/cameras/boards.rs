//! The simulated cell's cameras in front of calibration boards: held by hand, on the flange, or fixed.
//!
//! If the arm moves, it is the mock controller's arm; without an arm, a simulated person moves the board or the camera
//! to a new pose for each picture. The true poses of the boards do not leave this module.

use super::CameraError;
use crate::mock::MockHandle;
use panelprep_base::geometry::{Base, Camera, ColorPicture, Flange, OrganizedCloud, Rigid};
use panelprep_sim::{BoardCell, BoardShot, ScannerDistortion};

/// The camera that is used, and how the board is mounted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoardView {
    /// The fixed camera; a person holds the board in front of it.
    HandHeldForFixed,
    /// The camera on the flange; a person holds the board in front of it.
    HandHeldForFlange,
    /// The fixed camera; the board is on the flange.
    Fixed,
    /// The camera on the flange; the board is fixed.
    Flange,
}

impl BoardView {
    /// Returns whether the fixed camera looks at the board.
    pub fn is_fixed(self) -> bool {
        matches!(self, BoardView::Fixed | BoardView::HandHeldForFixed)
    }
}

/// A simulated camera that looks at a board.
pub struct SimulatedBoards {
    cell: BoardCell,
    view: BoardView,
    arm: Option<MockHandle>,
    taken: usize,
}

impl SimulatedBoards {
    /// Creates a camera of this cell. If there is an arm, its pose decides the view.
    pub fn new(cell: BoardCell, view: BoardView, arm: Option<MockHandle>) -> Self {
        SimulatedBoards { cell, view, arm, taken: 0 }
    }

    /// Returns the next picture, and the flange pose that the controller reports if the board or the camera is on
    /// the flange.
    ///
    /// # Errors
    /// If the arm moves.
    pub fn capture(&mut self) -> Result<(ColorPicture, Option<Rigid<Base, Flange>>), CameraError> {
        let (number, stood) = self.next()?;
        let (scanner, flange_camera) = (self.cell.scanner(), self.cell.flange_camera());
        let (picture, flange) = match self.view {
            BoardView::HandHeldForFixed => {
                let shots = self.cell.lens_shots::<panelprep_base::geometry::Camera>(&scanner, number + 1);
                (self.cell.picture(&scanner, &shots[number]), None)
            }
            BoardView::HandHeldForFlange => {
                let shots =
                    self.cell.lens_shots::<panelprep_base::geometry::FlangeCamera>(&flange_camera, number + 1);
                (self.cell.picture(&flange_camera, &shots[number]), None)
            }
            BoardView::Fixed => {
                let shot = self.view_of_flange_board(number, stood);
                (self.cell.picture(&scanner, &shot), Some(shot.base_from_flange))
            }
            BoardView::Flange => {
                let shot = match stood {
                    Some(flange) => self.cell.flange_view(number as u64, flange),
                    None => self.cell.flange_shots(number + 1)[number],
                };
                (self.cell.picture(&flange_camera, &shot), Some(shot.base_from_flange))
            }
        };
        Ok((picture.to_color(), flange))
    }

    /// Returns the next 3D shot of the board on the flange by the fixed camera, and the flange pose that the
    /// controller reports.
    ///
    /// # Errors
    /// If the arm moves.
    pub fn scan(&mut self) -> Result<(OrganizedCloud<Camera>, Rigid<Base, Flange>), CameraError> {
        let (number, stood) = self.next()?;
        let shot = self.view_of_flange_board(number, stood);
        let exact = ScannerDistortion::new(0, 0.0);
        Ok((self.cell.real_scan(&shot, &exact), shot.base_from_flange))
    }

    /// Returns the number of the next shot, and the flange's pose if there is an arm.
    fn next(&mut self) -> Result<(usize, Option<Rigid<Base, Flange>>), CameraError> {
        let number = self.taken;
        self.taken += 1;
        match self.arm.as_ref().map(|arm| arm.with_controller(|arm| (arm.is_moving(), arm.flange_pose()))) {
            Some((true, _)) => Err(CameraError::ArmMoves),
            stood => Ok((number, stood.map(|(_, flange)| flange))),
        }
    }

    /// The fixed camera's view of the board on the flange.
    fn view_of_flange_board(&self, number: usize, stood: Option<Rigid<Base, Flange>>) -> BoardShot<Camera> {
        match stood {
            Some(flange) => self.cell.fixed_view(number as u64, flange),
            None => self.cell.fixed_shots(number + 1)[number],
        }
    }
}
