//! The newest cycle in three dimensions, for people who watch: the points that the scan measured, and the planned
//! paths.
//!
//! The scene is stored in the service's memory only, and belongs to the newest cycle. Nothing waits for a viewer.

use super::setup::CycleSetup;
use panelprep_base::geometry::{Camera, OrganizedCloud, Panel, Rigid};
use panelprep_toolpath::path::Plan;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Maximum number of points of a scan that are shown.
const MAX_POINTS: usize = 150_000;

/// The newest cycle's scene. Clones share the same scene.
#[derive(Debug, Clone, Default)]
pub(super) struct LiveScene(Arc<Mutex<Inside>>);

#[derive(Debug, Default)]
struct Inside {
    /// The cycle to which the scene belongs: each cycle has its own scene.
    cycle: Weak<CycleSetup>,
    points: Option<Arc<Vec<u8>>>,
    paths: Vec<ScenePath>,
}

/// A planned path.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ScenePath {
    /// The plan's number.
    pub plan: u64,
    /// The number of the pass, from 1; 0 for an air-run.
    pub pass: u8,
    /// The TCP at each waypoint in the panel's frame, mm, and whether the disc is in contact with the panel there.
    pub waypoints: Vec<([f32; 3], bool)>,
    /// The overall direction in which the panel's face points, in the panel's frame: opposite to the tool's axis.
    pub facing: [f64; 3],
}

impl LiveScene {
    /// Returns the points of the scan as packed by `points`, if there was a scan, and the paths in the order in
    /// which they were planned.
    pub fn newest_scan(&self) -> (Option<Arc<Vec<u8>>>, Vec<ScenePath>) {
        let inside = self.lock();
        (inside.points.clone(), inside.paths.clone())
    }

    /// Shows a scan of this cycle's panel; the scene of another cycle is removed.
    pub(super) fn show_scan(
        &self,
        cycle: &Arc<CycleSetup>,
        scan: &OrganizedCloud<Camera>,
        panel_from_camera: &Rigid<Panel, Camera>,
    ) {
        let packed = Arc::new(points(scan, panel_from_camera));
        self.lock_cycle(cycle).points = Some(packed);
    }

    /// Shows a path over this cycle's panel; the same plan is shown only once.
    pub(super) fn show_plan(&self, cycle: &Arc<CycleSetup>, (number, pass): (u64, u8), plan: &Plan) {
        let waypoints = plan.paths.iter().flat_map(|path| &path.waypoints).map(|waypoint| {
            let at = waypoint.panel_from_tool.origin().mm;
            ([at.x as f32, at.y as f32, at.z as f32], waypoint.contact)
        });
        let axes = plan
            .paths
            .iter()
            .flat_map(|path| &path.waypoints)
            .map(|waypoint| waypoint.panel_from_tool.isometry().rotation * nalgebra::Vector3::z());
        let mean = -axes.sum::<nalgebra::Vector3<f64>>();
        let facing = mean.try_normalize(1e-9).unwrap_or(nalgebra::Vector3::z());
        let path = ScenePath { plan: number, pass, waypoints: waypoints.collect(), facing: facing.into() };
        let mut inside = self.lock_cycle(cycle);
        inside.paths.retain(|known| known.plan != number);
        inside.paths.push(path);
    }

    /// Returns the scene of this cycle; replaces it by a new one if it belonged to another cycle.
    fn lock_cycle(&self, cycle: &Arc<CycleSetup>) -> MutexGuard<'_, Inside> {
        let mut inside = self.lock();
        if !std::ptr::eq(inside.cycle.as_ptr(), Arc::as_ptr(cycle)) {
            *inside = Inside { cycle: Arc::downgrade(cycle), ..Inside::default() };
        }
        inside
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the points of a scan in the panel's frame, every nth of each row and column. A point has three
/// little-endian 32-bit floats, mm, then red, green, blue and an unused byte. A graphics processor can read this
/// format directly.
fn points(scan: &OrganizedCloud<Camera>, panel_from_camera: &Rigid<Panel, Camera>) -> Vec<u8> {
    let (width, height) = (scan.width(), scan.height());
    let step =
        (1..=width.max(height).max(1)).find(|step| width.div_ceil(*step) * height.div_ceil(*step) <= MAX_POINTS);
    let step = step.unwrap_or(1);
    let picture = scan.picture();
    let mut packed = Vec::new();
    for row in (0..height).step_by(step) {
        for column in (0..width).step_by(step) {
            let Some(point) = scan.point(column, row) else { continue };
            let at = (*panel_from_camera * point).mm;
            for length in [at.x, at.y, at.z] {
                packed.extend((length as f32).to_le_bytes());
            }
            let [red, green, blue] = picture.rgb[row * width + column];
            packed.extend([red, green, blue, 0]);
        }
    }
    packed
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Translation3};

    fn moved() -> Rigid<Panel, Camera> {
        let shift = Translation3::new(10.0, 20.0, 30.0);
        Rigid::from_isometry_unchecked(Isometry3::from_parts(shift, nalgebra::UnitQuaternion::identity()))
    }

    #[test]
    fn a_scan_is_packed_in_the_panels_frame_without_what_is_missing() {
        let points_mm = vec![[1.0, 2.0, 3.0], [f32::NAN; 3], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]];
        let colors = vec![[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]];
        let scan = OrganizedCloud::new(2, 2, points_mm, colors).expect("counts agree");
        let packed = points(&scan, &moved());
        assert_eq!(packed.len(), 3 * 16);
        let float = |at: usize| f32::from_le_bytes(packed[at..at + 4].try_into().expect("four"));
        assert_eq!([float(0), float(4), float(8)], [11.0, 22.0, 33.0]);
        assert_eq!(packed[12..16], [1, 2, 3, 0]);
        assert_eq!((float(16), packed[28]), (14.0, 7));
    }

    #[test]
    fn a_large_scan_is_thinned_evenly() {
        let count = 600 * 500;
        let scan = OrganizedCloud::new(600, 500, vec![[1.0; 3]; count], vec![[0; 3]; count]).expect("counts agree");
        // Calculated by hand: every second point of each row and column.
        assert_eq!(points(&scan, &moved()).len(), 16 * 300 * 250);
    }
}
