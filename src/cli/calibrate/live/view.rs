//! The camera of a session: the cell's own camera, or in a simulated cell a camera that looks at a board.

use super::super::super::args::Shot;
use super::super::super::fault::{CalibrationFault, Fault};
use super::super::super::load::CellFiles;
use super::super::super::render_boards::ROBOT;
use super::super::super::shoot::opening::{self, RequestedShot};
use super::super::args::LiveArgs;
use super::session::Capture;
use panelprep_base::geometry::{Base, Flange, PinholeCamera, Rigid};
use panelprep_devices::cameras::{BoardView, FlangeCamera, Scanner, SimulatedBoards};
use panelprep_devices::mock::MockHandle;
use panelprep_sim::{BoardCell, BoardPrint};
use panelprep_vision::calib::Board;

/// The camera.
pub enum CalibrationCamera {
    /// The fixed camera, with its colour picture.
    Scanner(Box<dyn Scanner>),
    /// The fixed camera, with its 3D shot: its mount is computed from its own points.
    Scans(Box<dyn Scanner>),
    /// The camera on the flange.
    Flange(Box<dyn FlangeCamera>),
    /// A simulated camera.
    Boards(SimulatedBoards),
    /// A simulated one, with its 3D shot.
    BoardScans(SimulatedBoards),
}

impl CalibrationCamera {
    /// Opens the camera that the cell's file names; `lens` is given if the camera's size is known.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open(
        cell: &CellFiles,
        (view, board): (BoardView, &Board),
        (args, lens): (&LiveArgs, Option<PinholeCamera>),
        progress: &(dyn Fn(&str) + Sync),
    ) -> Result<Self, Fault> {
        if is_simulated(cell, view) {
            return CalibrationCamera::simulated((view, board), (args, lens), None);
        }
        let wanted = |shot| RequestedShot { shot, simulation: args.simulation };
        Ok(match view {
            BoardView::Fixed => {
                CalibrationCamera::Scans(opening::scanner(cell, &wanted(Shot::Scan), progress)?.camera)
            }
            BoardView::HandHeldForFixed => {
                CalibrationCamera::Scanner(opening::scanner(cell, &wanted(Shot::Picture), progress)?.camera)
            }
            BoardView::Flange | BoardView::HandHeldForFlange => {
                CalibrationCamera::Flange(opening::flange_camera(cell, &wanted(Shot::Corner), progress)?.camera)
            }
        })
    }

    /// The simulated cell's camera, in front of a board.
    ///
    /// # Errors
    /// If the board is not a chessboard: no other one is simulated here.
    pub fn simulated(
        (view, board): (BoardView, &Board),
        (args, lens): (&LiveArgs, Option<PinholeCamera>),
        arm: Option<MockHandle>,
    ) -> Result<Self, Fault> {
        let boards = SimulatedBoards::new(board_cell((view, board), (args, lens))?, view, arm);
        Ok(if view == BoardView::Fixed {
            CalibrationCamera::BoardScans(boards)
        } else {
            CalibrationCamera::Boards(boards)
        })
    }

    /// Takes a picture or a 3D shot; returns it with the flange's pose if the camera's source knows it.
    ///
    /// # Errors
    /// If the camera does not deliver.
    pub fn capture(&mut self) -> Result<(Capture, Option<Rigid<Base, Flange>>), Fault> {
        Ok(match self {
            CalibrationCamera::Scanner(camera) => {
                (Capture::Picture(camera.capture_2d().map_err(Fault::stage)?.picture), None)
            }
            CalibrationCamera::Scans(camera) => {
                (Capture::Scan(camera.capture_3d().map_err(Fault::stage)?.cloud), None)
            }
            CalibrationCamera::Flange(camera) => {
                let taken = camera.capture().map_err(Fault::stage)?;
                (Capture::Picture(taken.picture), taken.base_from_flange)
            }
            CalibrationCamera::BoardScans(camera) => {
                let (cloud, flange) = camera.scan().map_err(Fault::stage)?;
                (Capture::Scan(cloud), Some(flange))
            }
            CalibrationCamera::Boards(camera) => {
                let (picture, flange) = camera.capture().map_err(Fault::stage)?;
                (Capture::Picture(picture), flange)
            }
        })
    }
}

/// Whether the camera of this view is simulated.
pub fn is_simulated(cell: &CellFiles, view: BoardView) -> bool {
    match view.is_fixed() {
        true => cell.cell.scanner().is_simulated(),
        false => cell.cell.flange_camera().is_simulated(),
    }
}

/// Returns the simulated cell's board in the form that the renderer needs.
///
/// # Errors
/// As [`CalibrationCamera::simulated`].
pub fn board_cell(
    (view, board): (BoardView, &Board),
    (args, lens): (&LiveArgs, Option<PinholeCamera>),
) -> Result<BoardCell, Fault> {
    if !board.is_chessboard() {
        return Err(CalibrationFault::NoSimulatedBoard.into());
    }
    let print = BoardPrint::chessboard(board.columns(), board.rows(), board.square_mm());
    let cell = BoardCell::new(args.simulation.seed, print, ROBOT);
    let full = if view.is_fixed() { cell.scanner() } else { cell.flange_camera() };
    let reduction = lens.map_or(1, |lens| full.width_px.checked_div(lens.width_px).unwrap_or(1).max(1));
    Ok(cell.with_reduction(reduction))
}
