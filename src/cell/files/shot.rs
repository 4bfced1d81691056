//! Reads a 3D shot from a PCD or PLY file.

use super::cloud_error::CloudFileError;
use super::foreign_kind::check_kind;
use super::pcd::{read_any_pcd, read_pcd};
use super::ply::{read_any_ply, read_ply};
use super::rays::check_rays;
use panelprep_base::geometry::{Camera, OrganizedCloud, PinholeCamera};

/// Reads a PCD or PLY file, distinguished by its first line, of the camera with this calibration.
///
/// # Errors
/// If the bytes are not an organised cloud with colours, its size is not the camera's, or points do not lie on the
/// rays of their pixels.
pub fn read_cloud(bytes: &[u8], camera: &PinholeCamera) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    check_kind(bytes)?;
    let is_ply = bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r\n");
    let cloud = if is_ply { read_ply(bytes, camera) } else { read_pcd(bytes, camera) }?;
    check_rays(&cloud, camera)?;
    Ok(cloud)
}

/// Reads an organised cloud of any camera, by the size that it states; `size_px` is the size of a PLY file that does
/// not state its own.
///
/// # Errors
/// If the bytes are not an organised cloud with colours, or its width is not stated.
pub fn read_any_cloud(
    bytes: &[u8],
    size_px: Option<(usize, usize)>,
) -> Result<OrganizedCloud<Camera>, CloudFileError> {
    check_kind(bytes)?;
    let is_ply = bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r\n");
    if is_ply { read_any_ply(bytes, size_px) } else { read_any_pcd(bytes) }
}

#[cfg(test)]
mod tests {
    use super::super::{write_pcd, write_ply};
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
}
