//! Geometry: frames, units, transforms, KUKA poses, the camera model, organised clouds, meshes, pictures.
//!
//! Pure types and their algebra; the rest of the program uses these and adds no second version. Lengths in mm,
//! angles in degrees, pixels with whole numbers at pixel centres.

pub mod basis;
mod camera;
mod cloud;
mod cloud_lens;
mod depth_field;
mod frames;
mod joints;
mod kuka_pose;
mod median;
mod mesh;
mod picture;
mod placement;
mod plane;
mod plane_zone;
pub mod polygon;
mod raster;
mod rigid;
mod smooth_field;
pub mod statistics;
mod units;

pub use camera::PinholeCamera;
pub use cloud::{CloudError, OrganizedCloud};
pub use cloud_lens::{CloudLens, fit_lens, median_projection_error_px, sample_points};
pub use depth_field::{DepthField, FIELD_COLUMNS, FIELD_ROWS, FIELD_SIZE, FieldRectangle, REFERENCE_DEPTH_MM};
pub use frames::{Base, Board, Camera, Drawing, Flange, FlangeCamera, Frame, Panel, Tool};
pub use joints::Joints;
pub use kuka_pose::KukaPose;
pub use median::{median, median_in_place};
pub use mesh::{LengthUnit, MeshObject, TriangleMesh};
pub use picture::{ColorPicture, GrayPicture, Mask};
pub use placement::PoseUncertainty;
pub use plane::{Plane, local_plane, local_plane_where};
pub use plane_zone::PlaneZone;
pub use raster::{ALL_NEIGHBOURS, DIRECT_NEIGHBOURS, RasterSize};
pub use rigid::{Point, Rigid, Vector, fit_rigid_motion};
pub use smooth_field::{HeightSample, RobustField, SmoothField};
pub use units::{Degrees, Pixel, STANDARD_GRAVITY_M_S2};
