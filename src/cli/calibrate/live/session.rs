//! The data of one session: pictures in a folder, each with its pose if it has one, and what was seen in them.

use super::super::super::disk;
use super::super::super::fault::Fault;
use super::super::super::output::{read_answer_line, write_progress as tell};
use super::super::args::LiveArgs;
use super::super::board_image::BoardImage;
use super::super::pose_keys;
use panelprep_base::geometry::{Camera, ColorPicture, OrganizedCloud, PinholeCamera};
use panelprep_cell::files::{self, ReportedFlange};
use panelprep_devices::cameras::PictureQuality;
use panelprep_vision::calib::Board;
use panelprep_vision::calib::detect;
use panelprep_vision::calib::intrinsics::coverage;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The file of the poses in the session's folder.
pub const POSES: &str = "poses.toml";

/// A picture with a mean grey level below this is too dark to show anything.
const DARK: f64 = 20.0;

/// File endings of pictures and of 3D shots.
const FILE_EXTENSIONS: [&str; 2] = ["png", "pcd"];

/// A capture that a camera delivered.
pub enum Capture {
    /// A picture.
    Picture(ColorPicture),
    /// A 3D shot.
    Scan(OrganizedCloud<Camera>),
}

/// The choice of a person.
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
    /// The number of pictures that are taken without asking, in all, and the time between them.
    unasked: Option<(usize, Duration)>,
    board: &'a Board,
    window: Option<usize>,
    pictures: Vec<PathBuf>,
    found: usize,
    poses: String,
}

impl<'a> Session<'a> {
    /// Continues with the contents of the folder. 3D shots are read with their camera's lens.
    ///
    /// # Errors
    /// If a file in it cannot be read.
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
            // Without a lens there is no reading of a 3D shot: it belongs to a session of another command.
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

    /// The largest number of pictures to take.
    pub fn max_pictures(&self, usual: usize) -> usize {
        self.unasked.map_or(usual, |(count, _)| count)
    }

    /// Returns the number of pictures.
    pub fn picture_count(&self) -> usize {
        self.pictures.len()
    }

    /// Returns the number of pictures that show the board.
    pub fn board_picture_count(&self) -> usize {
        self.found
    }

    /// The pictures.
    pub fn pictures(&self) -> Vec<PathBuf> {
        self.pictures.clone()
    }

    /// Asks whether to take another picture.
    ///
    /// # Errors
    /// If the person cannot be asked.
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
                if gray < DARK {
                    tell(&format!(
                        "  the picture is dark, mean grey level {gray:.0} of 255: switch on the light, or increase the exposure time"
                    ));
                }
                Ok(false)
            }
        }
    }
}
