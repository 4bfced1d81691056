//! Trials of a localization: a panel of any shape, at any pose in a search box, in front of a cluttered fixture. A
//! trial may have one of the defects that such a scene can have. The camera's calibration has no error, so that only
//! the localization is tested.
//!
//! A good trial has the taught panel, dry, in the box, rotated by up to ±180° about its normal and tilted by up to 30°.
//! At most 20 % of the panel has no points: occluded, in shadow, or outside of the field of view of the camera or the
//! projector. Glints remove points and overexpose the picture. A panel may be bent after it was taught, by a known bow
//! and wave.

mod capture;
mod contents;
mod placement;

use super::cast::Rays;
use super::noise::{PixelNoise, Seed};
use super::scene::Slab;
use super::shape::{PanelBend, Shape};
use super::truth::PlacementError;
use super::variety::{PanelVariant, trial_generator};
use super::{scene, shape, variety};
use contents::{PrintedDiscs, SceneContents, sheet_points};
pub use contents::{SceneDefect, TRIAL_BOX_MM};
use panelprep_base::geometry::{
    Base, Camera, Drawing, OrganizedCloud, Panel, PinholeCamera, Pixel, Point, Rigid, TriangleMesh,
    fit_rigid_motion,
};

/// Scale of the panels, compared with other trials, if two panels are in the box.
const REDUCED_PANEL_SCALE: f64 = 0.55;

/// The scene of a trial, with its ground truth.
#[derive(Debug, Clone)]
pub struct TrialScene {
    seed: Seed,
    taught: Shape,
    present: Option<Shape>,
    size_mm: [f64; 2],
    place: Rigid<Base, Panel>,
    slabs: Vec<Slab>,
    /// Glints on the panel: positions on the sheet and radii, mm.
    glints: Vec<([f64; 2], f64)>,
    wet: bool,
    smear_px: usize,
    camera_now: Rigid<Base, Camera>,
    camera: PinholeCamera,
    rays: Rays,
    pixels: PixelNoise,
    hidden_fraction: f64,
    is_held: bool,
    /// Fraction of the panel's points that are missing in patches.
    missing_share: f64,
    /// The marks on the taught panel.
    taught_marks: Option<PrintedDiscs>,
    present_marks: Option<PrintedDiscs>,
    /// The correlation length of the scanner's smooth error, mm; `None` for the usual length.
    correlation_length_mm: Option<f64>,
    /// Relative error of the scanner's distances, at teaching and now: positive if the distances are too long.
    scale: [f64; 2],
    /// The pose of a second panel of the same kind.
    second_panel: Option<Rigid<Base, Panel>>,
    /// Whether the holder is at another side than at teaching.
    is_holder_moved: bool,
}

impl TrialScene {
    /// Creates a good scene. The camera's pictures are smaller than the real ones by the factor `reduction`.
    pub fn good_scene(seed: u64, reduction: usize) -> TrialScene {
        TrialScene::new(Seed(seed), None, reduction)
    }

    /// Creates a good scene with a flat plate, whose sideways position only its outline determines.
    pub fn flat_scene(seed: u64, reduction: usize) -> TrialScene {
        let mut trial = TrialScene::good_scene(seed, reduction);
        let panel = variety::Panel::random(&mut trial_generator(Seed(seed), 0)).flat_copy();
        (trial.taught, trial.present) = (panel.shape(), Some(panel.shape()));
        trial.draw_valid_pose(&mut trial_generator(Seed(seed), 1), None);
        trial
    }

    /// Creates a scene with this defect.
    pub fn defective_scene(seed: u64, wrong: SceneDefect, reduction: usize) -> TrialScene {
        TrialScene::new(Seed(seed), Some(wrong), reduction)
    }

    /// Creates a good scene with this panel of a family; `scene` distinguishes the scenes of one panel.
    pub fn variant_scene((family, variant): (u64, PanelVariant), scene: u64, reduction: usize) -> TrialScene {
        let seed = Seed(1_000_000 * (family + 1) + 10_000 * variant as u64 + scene);
        TrialScene::from_panel(&variant.panel(family), seed, None, reduction)
    }

    fn new(seed: Seed, wrong: Option<SceneDefect>, reduction: usize) -> TrialScene {
        let mut random = trial_generator(seed, 0);
        let panel = match wrong {
            Some(SceneDefect::Symmetric) => variety::Panel::random_symmetric(&mut random),
            Some(SceneDefect::MirroredMarks) => variety::Panel::random_symmetric(&mut random).flat_copy(),
            Some(SceneDefect::HolderMoved) => variety::Panel::random(&mut random).flat_copy(),
            // The box is too small for two panels of full size.
            Some(SceneDefect::TwoPanels) => variety::Panel::random(&mut random).scaled_copy(REDUCED_PANEL_SCALE),
            _ => variety::Panel::random(&mut random),
        };
        let mut trial = TrialScene::from_panel(&panel, seed, wrong, reduction);
        if let Some(wrong) = wrong {
            trial.add_defect(&panel, wrong, &mut trial_generator(seed, 2));
        }
        if wrong == Some(SceneDefect::MirroredMarks) { trial.with_mirrored_marks() } else { trial }
    }

    /// Puts a panel into a scene that is prepared for this defect.
    fn from_panel(panel: &variety::Panel, seed: Seed, wrong: Option<SceneDefect>, reduction: usize) -> TrialScene {
        let camera = scene::scanner(reduction);
        let mut trial = TrialScene {
            seed,
            taught: panel.shape(),
            present: Some(panel.shape()),
            size_mm: panel.size_mm,
            place: scene::nominal(),
            slabs: Vec::new(),
            glints: Vec::new(),
            wet: wrong == Some(SceneDefect::Wet),
            smear_px: if wrong == Some(SceneDefect::Smeared) { (13 / reduction).max(5) } else { 0 },
            camera_now: scene::base_from_camera(),
            camera,
            rays: Rays::new(&camera),
            pixels: PixelNoise::new(seed),
            hidden_fraction: 0.0,
            is_held: false,
            missing_share: 0.0,
            taught_marks: None,
            present_marks: None,
            correlation_length_mm: None,
            scale: [0.0; 2],
            second_panel: None,
            is_holder_moved: false,
        };
        trial.draw_valid_pose(&mut trial_generator(seed, 1), wrong);
        trial
    }

    /// Returns the 3D camera.
    pub fn camera(&self) -> &PinholeCamera {
        &self.camera
    }

    /// Returns the camera's pose according to its calibration.
    pub fn base_from_camera(&self) -> Rigid<Base, Camera> {
        scene::base_from_camera()
    }

    /// Returns the length and width of the rectangle from which the taught panel was cut, mm.
    pub fn size_mm(&self) -> [f64; 2] {
        self.size_mm
    }

    /// Returns the fraction of the panel that the 3D camera does not see: hidden, in shadow, or outside of the picture.
    pub fn hidden_fraction(&self) -> f64 {
        self.hidden_fraction
    }

    /// Returns the true pose of the panel.
    pub fn base_from_panel(&self) -> Rigid<Base, Panel> {
        self.place
    }

    /// Returns a region in the middle of the panel in the taught scan's picture, px: top left, top right, bottom right,
    /// bottom left.
    pub fn region_px(&self) -> [Pixel; 4] {
        self.middle_px(0.4)
    }

    /// Returns the distance between the panel's surface at a found pose and the true surface.
    pub fn error_mm(&self, found: &Rigid<Base, Panel>) -> PlacementError {
        let points = sheet_points(&self.taught);
        let errors = points.iter().map(|&at| self.place.distance_at_mm(*found, self.taught.point(at)));
        let (sum_mm, max_mm) = errors.fold((0.0, 0.0_f64), |(sum, max), error| (sum + error, max.max(error)));
        PlacementError { mean_mm: sum_mm / points.len() as f64, max_mm }
    }

    /// Returns the scan with which the panel is taught, at its nominal pose and without other objects.
    pub fn taught_scan(&self) -> OrganizedCloud<Camera> {
        let taught = Some((&self.taught, &scene::nominal()));
        let holder: Vec<Slab> = self.holder_of(&scene::nominal(), false).into_iter().collect();
        let patches = self.missing_patches(0);
        let marks = self.taught_marks.as_ref();
        let contents =
            SceneContents { slabs: &holder, patches: patches.as_ref(), marks, ..SceneContents::default() };
        self.capture(taught, &scene::base_from_camera(), contents, 0)
    }

    /// Returns the scan of the scene.
    pub fn scan(&self) -> OrganizedCloud<Camera> {
        let present = self.present.as_ref().map(|shape| (shape, &self.place));
        let slabs: Vec<Slab> =
            self.slabs.iter().copied().chain(self.holder_of(&self.place, self.is_holder_moved)).collect();
        let patches = self.missing_patches(1);
        let contents = SceneContents {
            slabs: &slabs,
            glints: &self.glints,
            wet: self.wet,
            smear_px: self.smear_px,
            patches: patches.as_ref(),
            marks: self.present_marks.as_ref(),
        };
        let scan = self.capture(present, &self.camera_now, contents, 1);
        match (&self.present, &self.second_panel) {
            (Some(shape), Some(place)) => {
                combine_nearer(scan, self.capture(Some((shape, place)), &self.camera_now, contents, 2))
            }
            _ => scan,
        }
    }
}

/// Combines two scans of one view. Each pixel has the nearer of the two points; if one of the scans has no point there,
/// the point of the other scan.
fn combine_nearer(scan: OrganizedCloud<Camera>, other: OrganizedCloud<Camera>) -> OrganizedCloud<Camera> {
    let count = scan.width() * scan.height();
    let depth = |cloud: &OrganizedCloud<Camera>, index: usize| {
        let [_, _, z] = cloud.raw_points_mm()[index];
        if z.is_nan() { f32::INFINITY } else { z }
    };
    let of = |index: usize| if depth(&other, index) < depth(&scan, index) - 1.0 { &other } else { &scan };
    let points = (0..count).map(|index| of(index).raw_points_mm()[index]).collect();
    let colors = (0..count).map(|index| of(index).color_at(index)).collect();
    match OrganizedCloud::new(scan.width(), scan.height(), points, colors) {
        Ok(cloud) => cloud,
        Err(error) => unreachable!("the cloud must have one point and one colour per pixel: {error}"),
    }
}

impl TrialScene {
    /// Returns the same trial with the panel bent after it was taught.
    pub fn with_bend(self, bend: PanelBend) -> TrialScene {
        TrialScene { present: self.present.map(|shape| shape.with_bend(bend)), ..self }
    }

    /// Returns the drawing of the taught panel, and the pose of the drawing's frame while the panel is at its nominal
    /// pose.
    pub fn drawing(&self) -> (TriangleMesh, Rigid<Base, Drawing>) {
        let base_from_drawing = scene::nominal().isometry() * self.taught.panel_from_sheet();
        (shape::drawing_mesh(&self.taught), Rigid::from_isometry_unchecked(base_from_drawing))
    }

    /// Returns a region in the middle of the taught scan's picture that covers the fraction `share` of the panel's
    /// length and width: top left, top right, bottom right, bottom left.
    pub fn middle_px(&self, share: f64) -> [Pixel; 4] {
        let [s, t] = self.size_mm.map(|mm| share / 2.0 * mm);
        [[-s, t], [s, t], [s, -t], [-s, -t]].map(|at| {
            let seen = scene::base_from_camera().inverse() * (scene::nominal() * self.taught.point(at));
            self.camera.project(seen).unwrap_or_default()
        })
    }

    /// Returns the height of a point above the surface of the present panel, along the surface's normal, mm; `None`
    /// without a panel.
    pub fn height_over_surface_mm(&self, point: Point<Base>) -> Option<f64> {
        Some(self.present.as_ref()?.nearest(self.place.inverse() * point).1)
    }

    /// Returns the pose at which the taught panel fits the present panel best, by corresponding points. For a panel
    /// that was not bent this is the panel's pose; for a bent panel it is the correct result of a localization. `None`
    /// without a panel.
    pub fn best_fit_pose(&self) -> Option<Rigid<Base, Panel>> {
        let present = self.present.as_ref()?;
        let pair = |at: [f64; 2]| (self.taught.point(at), self.place * present.point(at));
        fit_rigid_motion(&sheet_points(&self.taught).into_iter().map(pair).collect::<Vec<_>>())
    }

    /// Returns the largest distance in the panel's plane, over all points of the panel, between a found pose and
    /// [`TrialScene::best_fit_pose`], mm.
    pub fn max_point_distance_mm(&self, found: &Rigid<Base, Panel>) -> Option<f64> {
        let right = self.best_fit_pose()?;
        let aside = |at: [f64; 2]| {
            let (point, normal) = (self.taught.point(at), right * self.taught.normal(at));
            let off = (*found * point - right * point).mm;
            (off - normal.mm * normal.mm.dot(&off)).norm()
        };
        Some(sheet_points(&self.taught).into_iter().map(aside).fold(0.0, f64::max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    /// A good panel is in the box, in front of the fixture, and most of its surface is seen. The scan has points at its
    /// position.
    #[test]
    fn good_trials_meet_their_conditions() {
        for seed in 0..6 {
            let trial = TrialScene::good_scene(seed, 4);
            assert!(trial.hidden_fraction() < 0.2, "{}", trial.hidden_fraction());
            let scan = trial.scan();
            let camera_from_base = trial.base_from_camera().inverse();
            let (mut near, mut seen) = (0, 0);
            for at in sheet_points(&trial.taught) {
                let point = camera_from_base * (trial.base_from_panel() * trial.taught.point(at));
                let Some(pixel) = trial.camera().project_inside(point) else { continue };
                let Some((column, row)) = pixel.nearest_whole(scan.width(), scan.height()) else { continue };
                seen += 1;
                near += usize::from(scan.point(column, row).is_some_and(|p| (p.mm.z - point.mm.z).abs() < 2.0));
            }
            assert!(near as f64 > 0.7 * f64::from(seen), "seed {seed}: {near} of {seen}");
        }
    }

    #[test]
    fn defective_trials_have_their_defect() {
        assert!(TrialScene::defective_scene(1, SceneDefect::Hidden, 8).hidden_fraction() > 0.4);
        assert!(TrialScene::defective_scene(1, SceneDefect::OutOfView, 8).hidden_fraction() > 0.35);
        let wet = TrialScene::defective_scene(1, SceneDefect::Wet, 8).scan().valid_points().count();
        assert!(wet < TrialScene::good_scene(1, 8).scan().valid_points().count());
        let moved = TrialScene::defective_scene(1, SceneDefect::CameraMoved, 8);
        assert!((moved.camera_now.origin() - moved.base_from_camera().origin()).mm.norm() > 0.9);
        let twins = (1..=12)
            .filter(|&seed| TrialScene::defective_scene(seed, SceneDefect::TwoPanels, 8).second_panel.is_some());
        assert_eq!(twins.count(), 12, "both panels have room");
    }

    /// The best-fit pose of a panel that was not bent is its true pose. The middle of a bowed panel lies in front of
    /// its ends by the height of the bow.
    #[test]
    fn a_bend_has_its_ground_truth() {
        let trial = TrialScene::good_scene(3, 8);
        let place = trial.base_from_panel();
        assert!(trial.error_mm(&trial.best_fit_pose().expect("a panel")).max_mm < 1e-9);
        let bow = PanelBend { bow_mm: 2.0, half_mm: 100.0, ..PanelBend::default() };
        let middle = place * trial.taught.point([0.0, 0.0]);
        let end = place * trial.taught.point([100.0, 0.0]);
        let bent = trial.clone().with_bend(bow);
        let before = |point| bent.height_over_surface_mm(point).expect("a panel");
        assert!(
            (before(middle) + 2.0).abs() < 0.25 && before(end).abs() < 1e-6,
            "{} {}",
            before(middle),
            before(end)
        );
        let right = bent.best_fit_pose().expect("a panel");
        let aside =
            right.followed_by_displacement(panelprep_base::geometry::Vector::new(Vector3::new(0.0, 0.3, 0.0)));
        let aside_mm = [right, aside].map(|found| bent.max_point_distance_mm(&found).expect("a panel"));
        assert!(aside_mm[0] < 1e-9 && (0.28..0.301).contains(&aside_mm[1]), "{aside_mm:?}");
    }
}
