//! Cameras that replay the files of a folder in the order of their names, one file for each capture. When all files are
//! replayed, a capture fails.
//!
//! In a scanner's folder, the `.pcd` and `.ply` files are the 3D scans. The pictures are those that its `clip.csv`
//! lists, in this order and with these times. In a flange camera's folder, each picture `NAME.png` has its pose in
//! `NAME.json`; a picture without a pose is refused, because a corner is measured in each picture. A capture without a
//! recorded time has the number of earlier captures as its time, in seconds. Only the file names are read in advance,
//! so a folder may contain many files.

use super::{CameraError, CameraRole, FileError, FlangeCamera, FlangePicture, Picture, Scanner, Shot};
use panelprep_base::disk;
use panelprep_base::geometry::{ColorPicture, PinholeCamera};
use panelprep_cell::files::{self, ClipEntry, CloudFileError, PictureError};
use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};

const CLOUD_EXTENSIONS: [&str; 2] = ["pcd", "ply"];
const PICTURE_EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "tif", "tiff"];

/// The files of a folder that are not replayed yet.
#[derive(Debug)]
struct FileSequence<T> {
    folder: PathBuf,
    what: &'static str,
    played: usize,
    read_ahead: VecDeque<T>,
}

impl<T> FileSequence<T> {
    fn new(folder: &Path, what: &'static str, ahead: impl IntoIterator<Item = T>) -> Self {
        FileSequence { folder: folder.to_owned(), what, played: 0, read_ahead: ahead.into_iter().collect() }
    }

    fn next(&mut self) -> Result<T, CameraError> {
        let FileSequence { folder, what, played, .. } = self;
        let out = CameraError::RecordingExhausted { folder: folder.clone(), what, played: *played };
        let next = self.read_ahead.pop_front().ok_or(out)?;
        self.played += 1;
        Ok(next)
    }

    /// Checks that at least one file is not replayed yet.
    fn check_remaining(&self) -> Result<(), CameraError> {
        let FileSequence { folder, what, played, read_ahead: ahead } = self;
        let out = || CameraError::RecordingExhausted { folder: folder.clone(), what, played: *played };
        ahead.front().map(drop).ok_or_else(out)
    }

    /// Returns the time of the last capture, s: the number of captures before it.
    fn count_s(&self) -> f64 {
        self.played.saturating_sub(1) as f64
    }
}

/// A scanner that replays the files of a folder.
#[derive(Debug)]
pub struct RecordedScanner {
    camera: PinholeCamera,
    clouds: FileSequence<PathBuf>,
    pictures: FileSequence<ClipEntry>,
    takes_clip: bool,
}

impl RecordedScanner {
    /// Opens a folder with recorded scans and pictures; `camera` is the calibration that they must match.
    ///
    /// # Errors
    /// If the folder does not exist, or its `clip.csv` is invalid.
    pub fn open(folder: &Path, camera: PinholeCamera) -> Result<Self, CameraError> {
        let clouds = list_files(folder, &CLOUD_EXTENSIONS, CameraRole::Scanner)?;
        let list = folder.join("clip.csv");
        let entries = match list.exists() {
            true => {
                let clip = read(&list).and_then(|bytes| with_file_name(&list, files::read_clip(&bytes)))?;
                clip.entries().to_vec()
            }
            false => Vec::new(),
        };
        let pictures = FileSequence::new(folder, "picture in its clip.csv", entries);
        Ok(RecordedScanner {
            camera,
            clouds: FileSequence::new(folder, "3D shot", clouds),
            pictures,
            takes_clip: false,
        })
    }
}

impl RecordedScanner {
    fn picture(&mut self) -> Result<Picture, CameraError> {
        let entry = self.pictures.next()?;
        let file = self.pictures.folder.join(&entry.file);
        let picture = files::read_color_of(&read(&file)?, &self.camera);
        let picture = check_size(&file, CameraRole::Scanner, picture)?;
        Ok(Picture { picture, time_s: entry.time_s })
    }

    fn clip(&self) -> Result<(), CameraError> {
        if self.takes_clip { Ok(()) } else { Err(CameraError::NoClip { which: CameraRole::Scanner }) }
    }
}

impl Scanner for RecordedScanner {
    fn capture_3d(&mut self) -> Result<Shot, CameraError> {
        self.takes_clip = false;
        let file = self.clouds.next()?;
        // Only the size is checked. The stage that uses the scan compares it with the lens, which may not be calibrated
        // here.
        let size_px = (self.camera.width_px, self.camera.height_px);
        let cloud = match files::read_any_cloud(&read(&file)?, Some(size_px)) {
            Err(CloudFileError::Size { width, height, .. }) => {
                return Err(wrong_size_error(CameraRole::Scanner, [width, height], &self.camera));
            }
            other => with_file_name(&file, other)?,
        };
        if (cloud.width(), cloud.height()) != size_px {
            return Err(wrong_size_error(CameraRole::Scanner, [cloud.width(), cloud.height()], &self.camera));
        }
        Ok(Shot { cloud, time_s: self.clouds.count_s() })
    }

    fn capture_2d(&mut self) -> Result<Picture, CameraError> {
        self.takes_clip = false;
        self.picture()
    }

    /// Each picture is available immediately, with its recorded time.
    fn begin_clip(&mut self, _: f64) -> Result<f64, CameraError> {
        self.takes_clip = true;
        self.pictures.check_remaining()?;
        Ok(self.pictures.read_ahead.front().map_or(0.0, |next| next.time_s))
    }

    fn next_clip_picture(&mut self) -> Result<Option<Picture>, CameraError> {
        self.clip()?;
        self.picture().map(Some)
    }

    fn end_clip(&mut self) -> Result<u64, CameraError> {
        self.clip()?;
        self.takes_clip = false;
        Ok(0)
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        self.clouds.check_remaining().and_then(|()| self.pictures.check_remaining())
    }
}

/// A flange camera that replays the files of a folder.
#[derive(Debug)]
pub struct RecordedFlangeCamera {
    camera: PinholeCamera,
    pictures: FileSequence<PathBuf>,
}

impl RecordedFlangeCamera {
    /// Opens a folder with recorded pictures; `camera` is the calibration that they must match.
    ///
    /// # Errors
    /// If the folder does not exist.
    pub fn open(folder: &Path, camera: PinholeCamera) -> Result<Self, CameraError> {
        let pictures = list_files(folder, &PICTURE_EXTENSIONS, CameraRole::Flange)?;
        Ok(RecordedFlangeCamera { camera, pictures: FileSequence::new(folder, "picture", pictures) })
    }
}

impl FlangeCamera for RecordedFlangeCamera {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        let file = self.pictures.next()?;
        let beside = file.with_extension("json");
        let pose = read(&beside).and_then(|bytes| with_file_name(&beside, files::read_flange(&bytes)))?;
        let picture = check_size(&file, CameraRole::Flange, files::read_measured(&read(&file)?, &self.camera))?;
        Ok(FlangePicture { picture, base_from_flange: Some(pose.to_rigid()), time_s: self.pictures.count_s() })
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        self.pictures.check_remaining()
    }
}

/// A picture of the wrong size is reported as an error of the camera; any other problem is reported as an error of the
/// file.
fn check_size(
    file: &Path,
    which: CameraRole,
    picture: Result<ColorPicture, PictureError>,
) -> Result<ColorPicture, CameraError> {
    match picture {
        Err(PictureError::Size { width, height, width_px, height_px }) => {
            Err(CameraError::WrongSize { which, found_px: [width, height], expected_px: [width_px, height_px] })
        }
        other => with_file_name(file, other),
    }
}

fn wrong_size_error(which: CameraRole, found_px: [usize; 2], camera: &PinholeCamera) -> CameraError {
    CameraError::WrongSize { which, found_px, expected_px: [camera.width_px, camera.height_px] }
}

/// Returns the files of a folder that have one of these extensions, in the order of their names.
fn list_files(folder: &Path, kinds: &[&str], which: CameraRole) -> Result<Vec<PathBuf>, CameraError> {
    let gone = |error: std::io::Error| CameraError::Missing {
        which,
        reason: format!("its recording {}: {error}", folder.display()),
    };
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>).map_err(gone)?;
    let of_kind = |file: &PathBuf| {
        let kind = file.extension().map(|kind| kind.to_string_lossy().to_lowercase());
        kind.is_some_and(|kind| kinds.contains(&kind.as_str()))
    };
    let mut files: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).filter(of_kind).collect();
    files.sort();
    Ok(files)
}

fn read(file: &Path) -> Result<Vec<u8>, CameraError> {
    with_file_name(file, disk::read(file))
}

fn with_file_name<T, E: Into<FileError>>(file: &Path, result: Result<T, E>) -> Result<T, CameraError> {
    result.map_err(|cause| CameraError::File { file: file.to_owned(), cause: cause.into() })
}

#[cfg(test)]
mod tests {
    //! Tests of recorded cameras with folders in the form in which users have them.

    use crate::cameras::*;
    use panelprep_base::geometry::{ColorPicture, KukaPose, OrganizedCloud, PinholeCamera};
    use panelprep_cell::files;
    use std::fs;
    use std::path::Path;

    fn camera(width_px: usize, height_px: usize) -> PinholeCamera {
        let (fx_px, fy_px, cx_px, cy_px) = (2.0, 2.0, 1.0, 1.0);
        let (k1, k2, p1, p2, k3) = (0.0, 0.0, 0.0, 0.0, 0.0);
        PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 }
    }

    fn png(gray: u8) -> Vec<u8> {
        files::write_color_png(&ColorPicture::uniform(3, 2, [gray; 3])).expect("a picture")
    }

    fn pcd(gray: u8) -> Vec<u8> {
        files::write_pcd(&OrganizedCloud::new(3, 2, vec![[1.0; 3]; 6], vec![[gray; 3]; 6]).expect("counts agree"))
    }

    fn folder(files: &[(&str, Vec<u8>)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, bytes) in files {
            fs::write(folder.path().join(name), bytes).expect("written");
        }
        folder
    }

    #[test]
    fn a_recorded_scanner_replays_in_order_and_then_fails() {
        let clip = b"file,time_s,phase\na2.png,-0.5,dry\na1.png,0.25,wet\n".to_vec();
        let files =
            [("b.pcd", pcd(2)), ("a.pcd", pcd(1)), ("a1.png", png(21)), ("a2.png", png(22)), ("clip.csv", clip)];
        let folder = folder(&files);
        let mut scanner = RecordedScanner::open(folder.path(), camera(3, 2)).expect("there");
        for (gray, time_s) in [(1, 0.0), (2, 1.0)] {
            let shot = scanner.capture_3d().expect("recorded");
            assert_eq!((shot.cloud.color_at(5), shot.time_s), ([gray; 3], time_s));
        }
        let out = scanner.capture_3d().expect_err("two were recorded").to_string();
        assert!(out.ends_with("contains no further 3D shot: all 2 were replayed; name another recording"), "{out}");
        for (gray, time_s) in [(22, -0.5), (21, 0.25)] {
            let taken = scanner.capture_2d().expect("recorded");
            assert_eq!((taken.picture.rgb[0], taken.time_s), ([gray; 3], time_s));
        }
        let out = scanner.capture_2d().expect_err("two were recorded").to_string();
        assert!(
            out.ends_with(
                "contains no further picture in its clip.csv: all 2 were replayed; name another recording"
            ),
            "{out}"
        );
    }

    #[test]
    fn a_recorded_flange_camera_has_a_pose_beside_each_picture() {
        let pose = KukaPose { x_mm: 1.0, y_mm: 2.0, z_mm: 3.0, a_deg: 4.0, b_deg: 5.0, c_deg: 6.0 };
        let beside = files::write_pose(&pose).into_bytes();
        let folder = folder(&[("1.png", png(1)), ("1.json", beside), ("2.png", png(2))]);
        let mut flange = RecordedFlangeCamera::open(folder.path(), camera(3, 2)).expect("there");
        let taken = flange.capture().expect("recorded");
        assert_eq!((taken.picture.rgb[0], taken.base_from_flange), ([1; 3], Some(pose.to_rigid())));
        let refused = flange.capture().expect_err("no pose");
        assert!(
            matches!(&refused, CameraError::File { file, cause: FileError::Disk(_) } if file.ends_with("2.json"))
        );
        assert!(matches!(flange.capture(), Err(CameraError::RecordingExhausted { played: 2, .. })));
    }

    #[test]
    fn unsuitable_recordings_are_reported() {
        let gone = RecordedScanner::open(Path::new("/nowhere"), camera(3, 2)).expect_err("gone");
        assert!(matches!(gone, CameraError::Missing { which: CameraRole::Scanner, .. }), "{gone}");
        let folder = folder(&[("a.pcd", pcd(1)), ("b.pcd", b"pcd".to_vec())]);
        let mut turned = RecordedScanner::open(folder.path(), camera(2, 3)).expect("there");
        let told = turned.capture_3d().expect_err("turned").to_string();
        assert_eq!(told, "a shot of the scanner is 3×2 px, but its calibration is for 2×3 px");
        let bad = turned.capture_3d().expect_err("no cloud");
        assert!(matches!(bad, CameraError::File { cause: FileError::Cloud(_), .. }), "{bad}");
    }
}
