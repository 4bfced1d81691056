//! The data of one session: pictures in a folder, each with its pose if it has one, and what was seen in them.

use super::super::super::disk;
use super::super::super::fault::Fault;
use super::super::super::output::{answer, tell_line as tell};
use super::super::args::LiveArgs;
use super::super::board_image::BoardImage;
use super::super::pose_keys;
use crate::calib::Board;
use crate::calib::detect;
use crate::calib::intrinsics::coverage;
use crate::devices::cameras::PictureQuality;
use crate::files::{self, ReportedFlange};
use crate::geometry::{Camera, ColorPicture, OrganizedCloud, PinholeCamera};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The file of the poses in the session's folder.
pub const POSES: &str = "poses.toml";

/// A picture with a mean grey level below this is too dark to show anything.
const DARK: f64 = 20.0;

/// File endings of pictures and of 3D shots.
const ENDINGS: [&str; 2] = ["png", "pcd"];

/// What a camera delivered.
pub enum Taken {
    /// A picture.
    Picture(ColorPicture),
    /// A 3D shot.
    Scan(OrganizedCloud<Camera>),
}

/// The choice of a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// A picture.
    Take,
    /// That is all.
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
            let named = |ending: &&str| session.named(number, ending);
            // Without a lens there is no reading of a 3D shot: it belongs to a session of another command.
            ENDINGS[..if camera.is_some() { 2 } else { 1 }].iter().map(named).find(|picture| picture.is_file())
        };
        session.pictures = (1..).map_while(earlier).collect();
        for picture in &session.pictures {
            let is_found = match camera {
                Some(camera) => BoardImage::read(picture, &camera)?.detect(board, window).is_ok(),
                None => {
                    let gray =
                        files::read_gray(&disk::read(picture)?).map_err(|error| Fault::file(picture, error))?;
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

    fn named(&self, number: usize, ending: &str) -> PathBuf {
        self.folder.join(format!("board_{number:04}.{ending}"))
    }

    /// The largest number of pictures to take.
    pub fn most(&self, usual: usize) -> usize {
        self.unasked.map_or(usual, |(count, _)| count)
    }

    /// Returns the number of pictures.
    pub fn taken(&self) -> usize {
        self.pictures.len()
    }

    /// Returns the number of pictures that show the board.
    pub fn found(&self) -> usize {
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
    pub fn ask(&self) -> Result<Choice, Fault> {
        if let Some((count, every)) = self.unasked {
            if self.taken() >= count {
                return Ok(Choice::Done);
            }
            std::thread::sleep(every);
            return Ok(Choice::Take);
        }
        tell(&format!(
            "Press Enter to take picture {}; type done and press Enter when the pictures are enough.",
            self.taken() + 1
        ));
        Ok(match answer()?.as_deref() {
            None | Some("done") => Choice::Done,
            Some(_) => Choice::Take,
        })
    }

    /// Stores a picture, with its pose if it has one, and reports what it shows. Returns whether it shows the board.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn keep(&mut self, taken: &Taken, flange: Option<&ReportedFlange>) -> Result<bool, Fault> {
        let of_scan;
        let (ending, bytes, picture) = match taken {
            Taken::Picture(picture) => {
                (ENDINGS[0], files::write_color_png(picture).map_err(Fault::stage)?, picture)
            }
            Taken::Scan(cloud) => {
                of_scan = cloud.picture();
                (ENDINGS[1], files::write_pcd(cloud), &of_scan)
            }
        };
        let file = self.named(self.taken() + 1, ending);
        disk::write(&file, bytes)?;
        let name = file.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        if let Some(flange) = flange {
            self.poses += &format!("[[poses]]\nimage = \"{name}\"\n{}\n", pose_keys(flange));
            disk::write_through(&self.folder.join(POSES), &self.poses)?;
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
