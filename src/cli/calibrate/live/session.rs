//! A session of a live calibration: its camera, its pictures in a folder, and the reports about them.
//!
//! The camera is the cell's own camera or, in a simulated cell, a camera in front of a board. Each picture is stored
//! with its pose, if it has one, and with the corners that were detected in it. A report states the result from the
//! pictures so far, and which picture to capture next.

use super::super::args::LiveArgs;
use super::super::boards::BoardImage;
use super::super::pose_keys;
use crate::cli::args::Shot;
use crate::cli::disk;
use crate::cli::fault::{CalibrationFault, Fault};
use crate::cli::output::{Outcome, read_answer_line, write_progress as tell};
use crate::cli::render_boards::ROBOT_NOISE;
use crate::cli::shoot::opening::{self, RequestedShot};
use panelprep_base::geometry::{
    Base, Camera, ColorPicture, Flange, KukaPose, OrganizedCloud, PinholeCamera, Rigid,
};
use panelprep_base::verdict::Verdict;
use panelprep_cell::files::{self, ReportedFlange};
use panelprep_devices::cameras::{BoardView, FlangeCamera, PictureQuality, Scanner, SimulatedBoards};
use panelprep_devices::mock::MockHandle;
use panelprep_service::setup::CellFiles;
use panelprep_sim::{BoardCell, BoardPrint};
use panelprep_vision::calib::intrinsics::coverage;
use panelprep_vision::calib::{Board, detect};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The name of the poses file in the session's folder.
pub const POSES: &str = "poses.toml";

/// Minimum mean grey level of a picture; in a darker picture no board is searched.
const MIN_MEAN_GRAY: f64 = 20.0;

/// File extensions of pictures and of 3D scans.
const FILE_EXTENSIONS: [&str; 2] = ["png", "pcd"];

/// A picture or scan that a camera delivered.
pub enum Capture {
    /// A picture.
    Picture(ColorPicture),
    /// A 3D shot.
    Scan(OrganizedCloud<Camera>),
}

/// The operator's answer to the question for another picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OperatorChoice {
    /// A picture.
    Take,
    /// No further capture.
    Done,
}

/// A session.
pub struct Session<'a> {
    folder: &'a Path,
    /// The total number of pictures that are captured without asking, and the time between them.
    unasked: Option<(usize, Duration)>,
    board: &'a Board,
    window: Option<usize>,
    pictures: Vec<PathBuf>,
    found: usize,
    poses: String,
}

impl<'a> Session<'a> {
    /// Creates a session, which continues with the pictures in the folder. 3D scans are read with their camera's lens.
    ///
    /// # Errors
    /// If a file in the folder cannot be read.
    pub fn new(
        (folder, args): (&'a Path, &LiveArgs),
        (board, window): (&'a Board, Option<usize>),
        camera: Option<PinholeCamera>,
    ) -> Result<Self, Fault> {
        let file = folder.join(POSES);
        let poses = if file.is_file() { disk::read_text(&file)? } else { String::new() };
        let every = Duration::from_secs(u64::from(args.every_s));
        let unasked = args.count.map(|count| (count as usize, every));
        let mut session = Session { folder, unasked, board, window, pictures: Vec::new(), found: 0, poses };
        let earlier = |number| {
            let named = |ending: &&str| session.numbered_path(number, ending);
            // A 3D scan cannot be read without a lens, so such a file belongs to a session of another command.
            FILE_EXTENSIONS[..if camera.is_some() { 2 } else { 1 }]
                .iter()
                .map(named)
                .find(|picture| picture.is_file())
        };
        session.pictures = (1..).map_while(earlier).collect();
        for picture in &session.pictures {
            let is_found = match camera {
                Some(camera) => BoardImage::read(picture, &camera)?.detect(board, window).is_ok(),
                None => {
                    let gray = files::read_gray(&disk::read(picture)?)
                        .map_err(|error| Fault::file_fault(picture, error))?;
                    detect::detect("picture", &gray, board, window).is_ok()
                }
            };
            session.found += usize::from(is_found);
        }
        if !session.pictures.is_empty() {
            let (taken, found) = (session.pictures.len(), session.found);
            tell(&format!("{}: {taken} pictures already exist, {found} of them show the board", folder.display()));
        }
        Ok(session)
    }

    fn numbered_path(&self, number: usize, ending: &str) -> PathBuf {
        self.folder.join(format!("board_{number:04}.{ending}"))
    }

    /// Returns the maximum number of pictures to capture.
    pub fn max_pictures(&self, usual: usize) -> usize {
        self.unasked.map_or(usual, |(count, _)| count)
    }

    /// Returns the number of pictures in the session.
    pub fn picture_count(&self) -> usize {
        self.pictures.len()
    }

    /// Returns the number of pictures that show the board.
    pub fn board_picture_count(&self) -> usize {
        self.found
    }

    /// Returns the files of all pictures.
    pub fn pictures(&self) -> Vec<PathBuf> {
        self.pictures.clone()
    }

    /// Asks the operator whether to capture another picture.
    ///
    /// # Errors
    /// If the operator's answer cannot be read.
    pub fn ask_for_picture(&self) -> Result<OperatorChoice, Fault> {
        if let Some((count, every)) = self.unasked {
            if self.picture_count() >= count {
                return Ok(OperatorChoice::Done);
            }
            std::thread::sleep(every);
            return Ok(OperatorChoice::Take);
        }
        tell(&format!(
            "Press Enter to take picture {}; type done and press Enter when the pictures are enough.",
            self.picture_count() + 1
        ));
        Ok(match read_answer_line()?.as_deref() {
            None | Some("done") => OperatorChoice::Done,
            Some(_) => OperatorChoice::Take,
        })
    }

    /// Stores a picture, with its pose if it has one, and reports what it shows. Returns whether it shows the board.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn store_picture(&mut self, taken: &Capture, flange: Option<&ReportedFlange>) -> Result<bool, Fault> {
        let of_scan;
        let (ending, bytes, picture) = match taken {
            Capture::Picture(picture) => {
                (FILE_EXTENSIONS[0], files::write_color_png(picture).map_err(Fault::stage)?, picture)
            }
            Capture::Scan(cloud) => {
                of_scan = cloud.picture();
                (FILE_EXTENSIONS[1], files::write_pcd(cloud), &of_scan)
            }
        };
        let file = self.numbered_path(self.picture_count() + 1, ending);
        disk::write(&file, bytes)?;
        let name = file.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        if let Some(flange) = flange {
            self.poses += &format!("[[poses]]\nimage = \"{name}\"\n{}\n", pose_keys(flange));
            disk::write_durable(&self.folder.join(POSES), &self.poses)?;
        }
        self.pictures.push(file);
        match detect::detect(&name, &picture.to_gray(), self.board, self.window) {
            Ok(found) => {
                self.found += 1;
                let share = 100.0 * coverage((picture.width, picture.height), &found.corners);
                tell(&format!(
                    "{name}: board found, {} of {} corners, over {share:.0} % of the picture; pictures with the board so far: {}",
                    found.corners.len(),
                    self.board.count(),
                    self.found
                ));
                Ok(true)
            }
            Err(error) => {
                tell(&format!("{name}: no board found: {error}"));
                let gray = PictureQuality::compute(picture).mean_gray;
                if gray < MIN_MEAN_GRAY {
                    tell(&format!(
                        "  the picture is dark, mean grey level {gray:.0} of 255: switch on the light, or increase the exposure time"
                    ));
                }
                Ok(false)
            }
        }
    }
}

pub(super) fn report_lens(outcome: &Outcome) {
    let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
    let verdict = outcome.json.get("verdict").and_then(serde_json::Value::as_str).unwrap_or_default();
    if let (Some(rms_px), Some(coverage)) = (number("rms_px"), number("coverage")) {
        tell(&format!(
            "so far: {verdict}, residuals {rms_px:.3} px rms, corners cover {:.0} % of the picture",
            100.0 * coverage
        ));
    }
    report_reasons(outcome);
    match outcome.json.get("next_picture").and_then(serde_json::Value::as_str) {
        Some(next) => tell(&format!("next: {next}")),
        None => tell("enough pictures: no further picture reduces the lens's error by 2 % or more"),
    }
}

pub(super) fn report_reasons(outcome: &Outcome) {
    let reasons = outcome.json.get("reasons").and_then(serde_json::Value::as_array);
    for reason in reasons.into_iter().flatten().filter_map(|reason| reason["message"].as_str()) {
        tell(&format!("  {reason}"));
    }
}

/// Reports the mount from the pictures so far; returns whether another pose is useful.
pub(super) fn report_mount(outcome: &Outcome) -> bool {
    let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
    let verdict = outcome.json.get("verdict").and_then(serde_json::Value::as_str).unwrap_or_default();
    let Some(uncertainty_mm) = number("uncertainty_mm") else {
        report_reasons(outcome);
        return true;
    };
    tell(&format!("so far: {verdict}, uncertainty ± {uncertainty_mm:.3} mm at the panel (95 %)"));
    report_reasons(outcome);
    let (Some(pose), Some(next_mm)) = (suggest_next_pose(outcome), number("next_uncertainty_mm")) else {
        tell("enough poses: no further pose reduces the mount's uncertainty");
        return verdict != Verdict::Accept.keyword();
    };
    // The next pose is chosen to improve the mount from the pictures. So its expected error is compared with the error
    // of that mount, not with that of the mount from the points.
    let by_pictures_mm = number("picture_uncertainty_mm").unwrap_or(uncertainty_mm);
    let is_worth = next_mm < MAX_REMAINING_ERROR_RATIO * by_pictures_mm && by_pictures_mm > SUFFICIENT_ERROR_MM;
    let worth = if is_worth { "next" } else { "enough poses; the most useful further pose" };
    tell(&format!("{worth}: flange {pose}, then the uncertainty is ± {next_mm:.3} mm"));
    is_worth || verdict != Verdict::Accept.keyword()
}

/// Returns the flange pose that would improve the result most.
pub(super) fn suggest_next_pose(outcome: &Outcome) -> Option<KukaPose> {
    outcome.json.get("next_pose").and_then(|pose| serde_json::from_value(pose.clone()).ok())
}

/// Maximum ratio of the error after another pose to the present error at which the pose is useful.
const MAX_REMAINING_ERROR_RATIO: f64 = 0.95;

/// Error below which no further pose is useful, mm: the pose repeatability of the arm is about 0.03 mm (data sheet of
/// the KR 6 R700).
const SUFFICIENT_ERROR_MM: f64 = 0.02;

/// The camera.
pub enum CalibrationCamera {
    /// The fixed camera, which captures colour pictures.
    Scanner(Box<dyn Scanner>),
    /// The fixed camera, which captures 3D scans, because its mount is computed from its own points.
    Scans(Box<dyn Scanner>),
    /// The camera on the flange.
    Flange(Box<dyn FlangeCamera>),
    /// A simulated camera.
    Boards(SimulatedBoards),
    /// A simulated camera in front of a board, which captures 3D scans.
    BoardScans(SimulatedBoards),
}

impl CalibrationCamera {
    /// Opens the camera that the cell file names; `lens` is given if its picture size is known.
    ///
    /// # Errors
    /// If the camera cannot be opened.
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

    /// Creates the camera of the simulated cell, in front of a board.
    ///
    /// # Errors
    /// If the board is not a chessboard, because other boards are not simulated.
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

    /// Captures a picture or a 3D scan. Also returns the flange pose if the source of the picture knows it.
    ///
    /// # Errors
    /// If the camera delivers no picture or scan.
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

/// Returns whether the camera of this view is simulated.
pub fn is_simulated(cell: &CellFiles, view: BoardView) -> bool {
    match view.is_fixed() {
        true => cell.cell.scanner().is_simulated(),
        false => cell.cell.flange_camera().is_simulated(),
    }
}

/// Returns the board of the simulated cell in the form that the renderer needs.
///
/// # Errors
/// The errors of [`CalibrationCamera::simulated`].
pub fn board_cell(
    (view, board): (BoardView, &Board),
    (args, lens): (&LiveArgs, Option<PinholeCamera>),
) -> Result<BoardCell, Fault> {
    if !board.is_chessboard() {
        return Err(CalibrationFault::NoSimulatedBoard.into());
    }
    let print = BoardPrint::chessboard(board.columns(), board.rows(), board.square_mm());
    let cell = BoardCell::new(args.simulation.seed, print, ROBOT_NOISE);
    let full = if view.is_fixed() { cell.scanner() } else { cell.flange_camera() };
    let reduction = lens.map_or(1, |lens| full.width_px.checked_div(lens.width_px).unwrap_or(1).max(1));
    Ok(cell.with_reduction(reduction))
}
