//! Files as bytes: 3D shots, meshes, pictures, clips and poses, read strictly and written.
//!
//! Bytes in, bytes out: nothing here accesses a disk. Unreadable data are refused with the line or byte, what was
//! found there and what is allowed. Nothing is repaired. Sizes are checked from a file's first bytes, so that a
//! small file never needs much memory.

mod clip;
mod cloud_error;
mod foreign_kind;
mod hash;
mod mesh;
mod mesh_error;
mod pcd;
mod picture;
mod ply;
mod pose;
mod rays;
mod shot;

pub use clip::{Clip, ClipEntry, ClipError, LineProblem, read_clip};
pub use cloud_error::CloudFileError;
pub use hash::{content_hash, hex, is_hex, parse_hex};
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
pub use rays::{check_frame, check_lens, check_rays};
pub use shot::{read_any_cloud, read_cloud};
