//! What one session takes: pictures in a folder, each with its pose where it has one, and what was seen in them.

use super::super::super::disk;
use super::super::super::fault::Fault;
use super::super::super::output;
use super::super::args::LiveArgs;
use crate::calib::Board;
use crate::calib::detect;
use crate::devices::cameras::PictureQuality;
use crate::files;
use crate::geometry::{Base, ColorPicture, Flange, Joints, KukaPose, Pixel, Rigid};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The poses, in the session's folder.
pub const POSES: &str = "poses.toml";

/// A picture whose mean grey level is below this is too dark to show anything.
const DARK: f64 = 20.0;
/// The picture is divided into so many parts for the share that corners cover.
const PARTS: [usize; 2] = [8, 6];

/// What a person answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// A picture.
    Take,
    /// That is all.
    Done,
}

/// Where the flange was at a picture.
#[derive(Debug, Clone, Copy)]
pub struct Pose {
    /// As the controller computes it.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The axes, where they are known.
    pub joints: Option<Joints>,
}

/// A session.
pub struct Session<'a> {
    folder: &'a Path,
    /// So many pictures are taken without asking, in all, with this time between them.
    unasked: Option<(usize, Duration)>,
    board: &'a Board,
    window: Option<usize>,
    pictures: Vec<PathBuf>,
    found: usize,
    poses: String,
}

/// Says a line to the person at the terminal.
pub fn tell(line: &str) {
    output::tell_line(line);
}

/// A line that the person writes; none where nobody writes any more.
///
/// # Errors
/// Where standard input cannot be read.
pub fn answer() -> Result<Option<String>, Fault> {
    let mut line = String::new();
    let read =
        std::io::stdin().read_line(&mut line).map_err(|error| Fault::file(Path::new("standard input"), error))?;
    Ok((read > 0).then(|| line.trim().to_owned()))
}

impl<'a> Session<'a> {
    /// Goes on with what is in the folder.
    ///
    /// # Errors
    /// Where a file in it cannot be read.
    pub fn new(
        (folder, args): (&'a Path, &LiveArgs),
        board: &'a Board,
        window: Option<usize>,
    ) -> Result<Self, Fault> {
        let file = folder.join(POSES);
        let poses = if file.is_file() { disk::read_text(&file)? } else { String::new() };
        let every = Duration::from_secs(u64::from(args.every_s));
        let unasked = args.count.map(|count| (count as usize, every));
        let mut session = Session { folder, unasked, board, window, pictures: Vec::new(), found: 0, poses };
        let earlier = (1..).map(|number| session.named(number)).take_while(|picture| picture.is_file());
        session.pictures = earlier.collect();
        for picture in &session.pictures {
            let gray = files::read_gray(&disk::read(picture)?).map_err(|error| Fault::file(picture, error))?;
            session.found += usize::from(detect::detect("picture", &gray, board, window).is_ok());
        }
        if !session.pictures.is_empty() {
            let (taken, found) = (session.pictures.len(), session.found);
            tell(&format!(
                "{}: {taken} pictures are there already, {found} of them show the board",
                folder.display()
            ));
        }
        Ok(session)
    }

    fn named(&self, number: usize) -> PathBuf {
        self.folder.join(format!("board_{number:04}.png"))
    }

    /// So many pictures are taken at most.
    pub fn most(&self, usual: usize) -> usize {
        self.unasked.map_or(usual, |(count, _)| count)
    }

    /// How many pictures there are.
    pub fn taken(&self) -> usize {
        self.pictures.len()
    }

    /// How many of them show the board.
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
    /// Where nobody can be asked.
    pub fn ask(&self) -> Result<Asked, Fault> {
        if let Some((count, every)) = self.unasked {
            if self.taken() >= count {
                return Ok(Asked::Done);
            }
            std::thread::sleep(every);
            return Ok(Asked::Take);
        }
        tell(&format!(
            "Press Enter to take picture {}; write done and press Enter when these are enough.",
            self.taken() + 1
        ));
        Ok(match answer()?.as_deref() {
            None | Some("done") => Asked::Done,
            Some(_) => Asked::Take,
        })
    }

    /// Keeps a picture, with its pose where it has one, and says what it shows; whether that is the board.
    ///
    /// # Errors
    /// Where the disk refuses.
    pub fn keep(&mut self, picture: &ColorPicture, pose: Option<&Pose>) -> Result<bool, Fault> {
        let file = self.named(self.taken() + 1);
        disk::write(&file, files::write_color_png(picture).map_err(Fault::stage)?)?;
        let name = file.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        if let Some(pose) = pose {
            self.poses += &text(&name, pose);
            disk::write_through(&self.folder.join(POSES), &self.poses)?;
        }
        self.pictures.push(file);
        match detect::detect(&name, &picture.to_gray(), self.board, self.window) {
            Ok(found) => {
                self.found += 1;
                let pixels: Vec<Pixel> = found.corners.iter().map(|(_, pixel)| *pixel).collect();
                let share = 100.0 * covered(&pixels, [picture.width, picture.height]);
                tell(&format!(
                    "{name}: the board is found, {} of {} corners, over {share:.0} % of the picture; pictures that show it: {}",
                    found.corners.len(),
                    self.board.count(),
                    self.found
                ));
                Ok(true)
            }
            Err(error) => {
                tell(&format!("{name}: no board: {error}"));
                let gray = PictureQuality::of(picture).mean_gray;
                if gray < DARK {
                    tell(&format!(
                        "  the picture is dark, mean grey level {gray:.0} of 255: switch on the light, or expose for longer"
                    ));
                }
                Ok(false)
            }
        }
    }
}

/// The share of the picture's parts that hold a corner.
fn covered(corners: &[Pixel], [width, height]: [usize; 2]) -> f64 {
    let mut parts = [[false; PARTS[0]]; PARTS[1]];
    for pixel in corners {
        let at = |place: f64, size: usize, parts: usize| (place / size as f64 * parts as f64) as usize;
        let (column, row) = (at(pixel.u, width, PARTS[0]), at(pixel.v, height, PARTS[1]));
        parts[row.min(PARTS[1] - 1)][column.min(PARTS[0] - 1)] = true;
    }
    parts.as_flattened().iter().filter(|part| **part).count() as f64 / (PARTS[0] * PARTS[1]) as f64
}

/// A pose as a poses file has it.
fn text(image: &str, pose: &Pose) -> String {
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&pose.base_from_flange);
    let mut text = format!(
        "[[poses]]\nimage = \"{image}\"\nbase_from_flange = {{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, z_mm = {z_mm:?}, \
         a_deg = {a_deg:?}, b_deg = {b_deg:?}, c_deg = {c_deg:?} }}\n"
    );
    if let Some(joints) = pose.joints {
        // Writing to a `String` cannot fail.
        let _ = writeln!(text, "axes_deg = {:?}", joints.degrees());
    }
    text + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_cover_the_parts_that_they_are_in() {
        // Of 8 × 6 parts of 100 × 100 px: the first, and twice the last.
        let corners = [Pixel::at(99.0, 99.0), Pixel::at(799.9, 599.9), Pixel::at(710.0, 510.0)];
        assert_eq!(covered(&corners, [800, 600]), 2.0 / 48.0);
        assert_eq!(covered(&[], [800, 600]), 0.0);
    }

    #[test]
    fn a_pose_is_written_as_it_is_read() {
        let at = KukaPose { x_mm: 1.5, y_mm: -2.0, z_mm: 3.0, a_deg: 10.0, b_deg: 20.0, c_deg: 30.0 };
        let joints = Joints::from([1.0, -90.0, 90.0, 0.0, 5.0, 6.5]);
        let pose = Pose { base_from_flange: at.to_rigid(), joints: Some(joints) };
        let text = text("a.png", &pose);
        let read = super::super::super::files::picture_poses("poses.toml", &text, &|image| image == "a.png");
        let read = read.unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!((read.len(), read[0].joints), (1, Some(joints)));
        assert!(
            read[0]
                .base_from_flange
                .distance_at_mm(pose.base_from_flange, crate::geometry::Point::at(0.0, 0.0, 0.0))
                < 1e-9
        );
    }
}
