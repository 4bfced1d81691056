//! `[rough]`: the poses of the cameras, measured by hand with a tape. The result of a calibration must be near them.

use panelprep_base::config::Section;
use panelprep_base::geometry::{Base, Camera, Flange, FlangeCamera, KukaPose, Rigid};

/// Rough mounts; each may be absent.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RoughMounts {
    /// The pose of the fixed camera.
    pub base_from_camera: Option<Rigid<Base, Camera>>,
    /// The pose of the flange camera on the flange.
    pub flange_from_camera: Option<Rigid<Flange, FlangeCamera>>,
}

pub(super) fn parse_rough(section: &Section<'_, '_>) -> Option<RoughMounts> {
    let [base_from_camera, flange_from_camera] =
        ["base_from_camera", "flange_from_camera"].map(|key| parse_pose(&section.section(key)));
    section.finish();
    let rough = RoughMounts {
        base_from_camera: base_from_camera?.map(|pose| pose.to_rigid()),
        flange_from_camera: flange_from_camera?.map(|pose| pose.to_rigid()),
    };
    Some(rough)
}

/// Returns `Some(None)` if the table is absent.
fn parse_pose(section: &Section<'_, '_>) -> Option<Option<KukaPose>> {
    if !section.is_present() {
        return Some(None);
    }
    let number = |key, limit: f64| section.parse::<f64>(key, -limit..=limit, None);
    let [x_mm, y_mm, z_mm] = ["x_mm", "y_mm", "z_mm"].map(|key| number(key, 20_000.0));
    let [a_deg, b_deg, c_deg] = ["a_deg", "b_deg", "c_deg"].map(|key| number(key, 360.0));
    section.finish();
    Some(Some(KukaPose { x_mm: x_mm?, y_mm: y_mm?, z_mm: z_mm?, a_deg: a_deg?, b_deg: b_deg?, c_deg: c_deg? }))
}
