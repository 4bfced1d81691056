//! Recorded cameras, from folders as a user has them.

use super::*;
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
fn a_recorded_scanner_plays_in_order_and_runs_out() {
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
    assert!(out.ends_with("contains no further 3D shot: all 2 were used"), "{out}");
    for (gray, time_s) in [(22, -0.5), (21, 0.25)] {
        let taken = scanner.capture_2d().expect("recorded");
        assert_eq!((taken.picture.rgb[0], taken.time_s), ([gray; 3], time_s));
    }
    let out = scanner.capture_2d().expect_err("two were recorded").to_string();
    assert!(out.ends_with("contains no further picture in its clip.csv: all 2 were used"), "{out}");
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
    assert!(matches!(&refused, CameraError::File { file, cause: FileError::Disk(_) } if file.ends_with("2.json")));
    assert!(matches!(flange.capture(), Err(CameraError::RecordingExhausted { played: 2, .. })));
}

#[test]
fn what_does_not_fit_is_reported() {
    let gone = RecordedScanner::open(Path::new("/nowhere"), camera(3, 2)).expect_err("gone");
    assert!(matches!(gone, CameraError::Missing { which: CameraRole::Scanner, .. }), "{gone}");
    let folder = folder(&[("a.pcd", pcd(1)), ("b.pcd", b"pcd".to_vec())]);
    let mut turned = RecordedScanner::open(folder.path(), camera(2, 3)).expect("there");
    let told = turned.capture_3d().expect_err("turned").to_string();
    assert_eq!(told, "a shot of the scanner is 3×2 px, but its calibration is for 2×3 px");
    let bad = turned.capture_3d().expect_err("no cloud");
    assert!(matches!(bad, CameraError::File { cause: FileError::Cloud(_), .. }), "{bad}");
}
