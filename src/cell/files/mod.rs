//! Parsers and writers of file contents: 3D shots, meshes, pictures, clips and poses.
//!
//! All functions work on bytes and do not access a disk. Invalid data are refused with the line or byte, the value
//! found and the valid values; nothing is repaired. Sizes are checked in the first bytes of a file, so that a small
//! file cannot cause a large allocation.
//!
//! This file reads a 3D shot from a PCD or PLY file, and contains the SHA-256 hash that identifies contents, and
//! hexadecimal digits.

mod clip;
mod error;
mod mesh;
mod pcd;
mod picture;
mod ply;
mod pose;
mod rays;

pub use clip::{Clip, ClipEntry, ClipError, LineProblem, read_clip};
pub use error::CloudFileError;
pub use mesh::{MeshFileError, read_mesh, write_stl};
pub use pcd::{read_pcd, write_pcd, write_pcd_from};
pub use picture::{
    PictureError, read_color, read_color_of, read_gray, read_measured, read_measured_gray, write_color_jpeg,
    write_color_png, write_gray_png,
};
pub use ply::{read_ply, write_ply};
pub use pose::{
    PoseError, ReportedFlange, read_flange, read_located, read_located_mm, read_reported_flange, write_pose,
    write_reported_flange,
};
pub use rays::{check_camera_frame, check_lens, check_rays};

use error::check_kind;
use panelprep_base::geometry::{Camera, OrganizedCloud, PinholeCamera};
use pcd::read_any_pcd;
use ply::read_any_ply;
use sha2::{Digest, Sha256};

/// Reads a PCD or PLY file from the camera with this calibration. The format is recognised by the first line.
///
/// # Errors
/// If the file is not an organised cloud with colours, its size is not that of the camera, or points do not lie on the
/// rays of their pixels.
pub fn read_cloud(bytes: &[u8], camera: &PinholeCamera) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    check_kind(bytes)?;
    let is_ply = bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r\n");
    let cloud = if is_ply { read_ply(bytes, camera) } else { read_pcd(bytes, camera) }?;
    check_rays(&cloud, camera)?;
    Ok(cloud)
}

/// Reads an organised cloud of any size. `size_px` is the size of a PLY file that does not state its size.
///
/// # Errors
/// If the file is not an organised cloud with colours, or its size is not known.
pub fn read_any_cloud(
    bytes: &[u8],
    size_px: Option<(usize, usize)>,
) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    check_kind(bytes)?;
    let is_ply = bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r\n");
    if is_ply { read_any_ply(bytes, size_px) } else { read_any_pcd(bytes) }
}

const DIGITS: &[u8; 16] = b"0123456789abcdef";

/// Returns the SHA-256 hash of the bytes as 64 lower-case hexadecimal digits.
pub fn content_hash(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Returns the bytes as lower-case hexadecimal digits, two for each byte.
pub fn hex(bytes: &[u8]) -> String {
    let digit = |value: u8| char::from(DIGITS[usize::from(value)]);
    bytes.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]).collect()
}

/// Parses lower-case hexadecimal digits, two for each byte; `None` if the text contains other characters.
pub fn parse_hex(text: &str) -> Option<Vec<u8>> {
    if !is_hex(text, text.len()) || !text.len().is_multiple_of(2) {
        return None;
    }
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(text.get(at..at + 2)?, 16).ok()).collect()
}

/// Returns whether a text consists of exactly this number of lower-case hexadecimal digits. Such a file name cannot
/// lead out of its folder.
pub fn is_hex(text: &str, digits: usize) -> bool {
    text.len() == digits && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(width_px: usize, height_px: usize) -> PinholeCamera {
        let (fx_px, fy_px, cx_px, cy_px) = (2.0, 2.0, 1.0, 1.0);
        let (k1, k2, p1, p2, k3) = (0.0, 0.0, 0.0, 0.0, 0.0);
        PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 }
    }

    #[test]
    fn both_forms_read_and_both_must_fit_the_calibration() {
        let cloud = OrganizedCloud::new(3, 2, vec![[1.0; 3]; 6], vec![[9; 3]; 6]).expect("counts agree");
        for file in [write_pcd(&cloud), write_ply(&cloud)] {
            assert_eq!(read_cloud(&file, &camera(3, 2)).expect("good").color_at(5), [9; 3]);
            let error = read_cloud(&file, &camera(2, 3)).expect_err("turned").to_string();
            assert_eq!(error, "the cloud is 3×2 px, but the camera's calibration is for 2×3 px");
        }
    }

    /// Expected value: the example of FIPS 180-2, appendix B.1.
    #[test]
    fn the_example_of_the_standard_is_reproduced() {
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(content_hash(b"abc"), expected);
    }

    #[test]
    fn hex_digits_are_read_back_and_other_text_is_refused() {
        assert_eq!((hex(&[0, 0x9f, 255]), parse_hex("009fff")), ("009fff".to_owned(), Some(vec![0, 0x9f, 255])));
        for wrong in ["0", "0g", "0G", "9F", "+1", "é"] {
            assert_eq!(parse_hex(wrong), None, "{wrong}");
        }
        assert!(is_hex("00ff", 4) && !is_hex("00ff", 6) && !is_hex("../a", 4));
    }
}
