//! The live view for people: the newest picture of the cameras, and the newest cycle in three dimensions (the points
//! that the scan measured, and the planned paths).
//!
//! The computing thread offers a picture; a viewer fetches the newest picture and draws it on a separate thread. No
//! thread waits for a viewer: without a recent viewer no picture is copied, and a picture that was not fetched is
//! replaced by the next one. The scene is kept in memory only, and belongs to the newest cycle.

use super::perception::view;
use crate::setup::CycleSetup;
use panelprep_base::geometry::{Base, Camera, ColorPicture, Mask, OrganizedCloud, Panel, Rigid};
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::{Grid, GridId};
use panelprep_toolpath::path::Plan;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Minimum interval between two pictures that are offered.
const MIN_PICTURE_INTERVAL: Duration = Duration::from_millis(450);
/// Time after the last request for a picture during which a client is treated as a viewer.
const VIEWER_TIMEOUT: Duration = Duration::from_secs(5);

/// The newest picture. Clones share the same picture.
#[derive(Debug, Clone, Default)]
pub struct LiveView(Arc<Mutex<Inside>>, LiveScene);

#[derive(Debug, Default)]
struct Inside {
    number: u64,
    frame: Option<Arc<LiveFrame>>,
    last_offered: Option<Instant>,
    last_viewed: Option<Instant>,
}

/// A picture with the data that are drawn on it.
#[derive(Debug)]
pub struct LiveFrame {
    /// The name of the camera's picture, or of the drawing.
    pub name: String,
    /// The picture.
    pub picture: Arc<ColorPicture>,
    /// The film to which the picture belongs, if any.
    pub film: Option<LiveFilm>,
}

/// The intermediate result of a film in progress.
#[derive(Debug)]
pub struct LiveFilm {
    /// Seconds since the film's first picture.
    pub film_time_s: f64,
    /// The pixels that broke so far. Those of them that are later classified as glints are removed at the end.
    pub broken_so_far: Mask,
    /// The grids that failed so far.
    pub failed_so_far: Vec<GridId>,
    pub(super) setup: Arc<CycleSetup>,
    pub(super) place: Rigid<Base, Panel>,
}

impl LiveFrame {
    /// Returns the picture with the data drawn on it.
    ///
    /// # Errors
    /// If the picture cannot be drawn.
    pub fn draw(&self) -> Result<ColorPicture, ImagingError> {
        let Some(film) = &self.film else { return Ok((*self.picture).clone()) };
        let failed = |grid: &Grid| film.failed_so_far.contains(&grid.id);
        view(&film.setup, &self.picture, film.place).draw_inspection(
            &film.setup.panel,
            &film.broken_so_far,
            None,
            &failed,
        )
    }
}

impl LiveView {
    /// Returns the number of the newest picture, and the picture if there is one. The caller is treated as a viewer.
    pub fn newest_picture(&self) -> (u64, Option<Arc<LiveFrame>>) {
        let mut inside = self.lock();
        inside.last_viewed = Some(Instant::now());
        (inside.number, inside.frame.clone())
    }

    /// Removes the picture, because a new cycle with another part begins.
    pub(super) fn clear(&self) {
        self.lock().frame = None;
    }

    /// Returns the three-dimensional scene of the newest cycle.
    pub(super) fn scene(&self) -> &LiveScene {
        &self.1
    }

    /// Offers a picture. It is created only if there is a viewer and the last picture is old enough.
    pub(super) fn offer_picture(&self, frame: impl FnOnce() -> Option<LiveFrame>) {
        let is_recent = |at: Option<Instant>, span| at.is_some_and(|at| at.elapsed() < span);
        {
            let inside = self.lock();
            if !is_recent(inside.last_viewed, VIEWER_TIMEOUT)
                || is_recent(inside.last_offered, MIN_PICTURE_INTERVAL)
            {
                return;
            }
        }
        // The picture is created without the lock, so that no viewer waits while it is copied.
        if let Some(frame) = frame() {
            let mut inside = self.lock();
            inside.number += 1;
            (inside.frame, inside.last_offered) = (Some(Arc::new(frame)), Some(Instant::now()));
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Maximum number of points of a scan in the scene.
const MAX_POINTS: usize = 150_000;

/// The scene of the newest cycle. Clones share the same scene.
#[derive(Debug, Clone, Default)]
pub(super) struct LiveScene(Arc<Mutex<SceneContent>>);

#[derive(Debug, Default)]
struct SceneContent {
    /// The cycle to which the scene belongs; for a new cycle the scene is replaced.
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
    /// The direction in which the panel's front points on average, in the panel's frame: opposite to the tool's axis.
    pub facing: [f64; 3],
}

impl LiveScene {
    /// Returns the points of the scan in the format of `points`, if there was a scan, and the paths in the order in
    /// which they were planned.
    pub fn newest_scan(&self) -> (Option<Arc<Vec<u8>>>, Vec<ScenePath>) {
        let inside = self.lock();
        (inside.points.clone(), inside.paths.clone())
    }

    /// Adds a scan of this cycle's panel; a scene of another cycle is removed.
    pub(super) fn show_scan(
        &self,
        cycle: &Arc<CycleSetup>,
        scan: &OrganizedCloud<Camera>,
        panel_from_camera: &Rigid<Panel, Camera>,
    ) {
        let packed = Arc::new(points(scan, panel_from_camera));
        self.lock_cycle(cycle).points = Some(packed);
    }

    /// Adds a path over this cycle's panel; a plan that was already added is ignored.
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

    /// Returns the scene of this cycle. If the scene belongs to another cycle, it is replaced by an empty one.
    fn lock_cycle(&self, cycle: &Arc<CycleSetup>) -> MutexGuard<'_, SceneContent> {
        let mut inside = self.lock();
        if !std::ptr::eq(inside.cycle.as_ptr(), Arc::as_ptr(cycle)) {
            *inside = SceneContent { cycle: Arc::downgrade(cycle), ..SceneContent::default() };
        }
        inside
    }

    fn lock(&self) -> MutexGuard<'_, SceneContent> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the points of a scan in the panel's frame, every n-th point of each row and column. A point consists of
/// three little-endian 32-bit floats, mm, then red, green, blue and an unused byte. A graphics processor can read this
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

    fn frame() -> LiveFrame {
        let picture = Arc::new(ColorPicture::uniform(2, 1, [7, 8, 9]));
        LiveFrame { name: "scan".to_owned(), picture, film: None }
    }

    #[test]
    fn a_picture_is_made_only_if_a_client_watches() {
        let view = LiveView::default();
        view.offer_picture(|| panic!("no person has looked"));
        assert_eq!(view.newest_picture().0, 0);
        view.offer_picture(|| None);
        assert!(view.newest_picture().1.is_none());
        view.offer_picture(|| Some(frame()));
        view.offer_picture(|| panic!("twice within half a second"));
        let (number, shown) = view.newest_picture();
        let drawn = shown.expect("a picture").draw().expect("as it is");
        assert_eq!((number, drawn.rgb), (1, vec![[7, 8, 9]; 2]));
        view.lock().last_viewed = Instant::now().checked_sub(VIEWER_TIMEOUT);
        view.lock().last_offered = None;
        view.offer_picture(|| panic!("they went away"));
    }

    fn moved() -> Rigid<Panel, Camera> {
        let shift = Translation3::new(10.0, 20.0, 30.0);
        Rigid::from_isometry_unchecked(Isometry3::from_parts(shift, nalgebra::UnitQuaternion::identity()))
    }

    #[test]
    fn a_scan_is_packed_in_the_panels_frame_without_missing_points() {
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
        // Expected value, calculated by hand: every second point of each row and column remains.
        assert_eq!(points(&scan, &moved()).len(), 16 * 300 * 250);
    }
}
