//! `--points` and `--poses`: TOML files that a person writes from the values on the teach pendant.

mod camera;
mod pose;
mod robot;
mod tool;

pub use camera::{PicturePose, Points, picture_poses, points};
pub use pose::pose_keys;
pub use robot::{NamedPose, StatedPose, StatedTouch, arm_poses, arm_touches};
pub use tool::{force_readings, tool_poses};

#[cfg(test)]
mod tests {
    use panelprep_base::config::Problems;

    pub const POSE: &str =
        "base_from_flange = { x_mm = 1, y_mm = 2, z_mm = 3, a_deg = 90, b_deg = 0, c_deg = 180 }\n";

    pub fn problems<T: std::fmt::Debug>(found: Result<T, Problems>) -> String {
        found.expect_err("a problem").to_string()
    }
}
