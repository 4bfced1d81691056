//! Geometry: frames, units, transforms, KUKA poses, the camera model, organised clouds, meshes, pictures.
//!
//! The types and their algebra have no side effects; no other module defines a second version. Lengths are in mm,
//! angles in degrees; pixel coordinates are whole numbers at pixel centres.

pub mod basis;
mod camera;
mod cloud;
mod depth_field;
mod kuka_pose;
mod mesh;
mod picture;
mod plane;
pub mod polygon;
mod rigid;
mod smooth_field;
pub mod statistics;

pub use camera::PinholeCamera;
pub use cloud::{CloudError, CloudLens, OrganizedCloud, fit_lens, median_projection_error_px, sample_points};
pub use depth_field::{DepthField, FIELD_COLUMNS, FIELD_ROWS, FIELD_SIZE, FieldRectangle, REFERENCE_DEPTH_MM};
pub use kuka_pose::{Joints, KukaPose};
pub use mesh::{LengthUnit, MeshObject, TriangleMesh};
pub use picture::{ALL_NEIGHBOURS, ColorPicture, DIRECT_NEIGHBOURS, GrayPicture, Mask, RasterSize};
pub use plane::{Plane, PlaneZone, local_plane, local_plane_where};
pub use rigid::{
    Base, Board, Camera, Degrees, Drawing, Flange, FlangeCamera, Frame, Panel, Pixel, Point, PoseUncertainty,
    Rigid, STANDARD_GRAVITY_M_S2, Tool, Vector, fit_rigid_motion,
};
pub use smooth_field::{HeightSample, RobustField, SmoothField};
pub use statistics::{interpolated_median, median};
