//! The simulated cell: the poses of all its objects, and the pictures of its two cameras.
//!
//! Two fixed boards in the cell, one for each camera, serve to verify the cameras' calibrations every day. The poses
//! given for the boards contain the error of touching them with the tool's tip.

#[cfg(test)]
mod tests;

use super::board::BoardPrint;
use super::cast::{CastView, Rays};
use super::film::{Film, PanelCondition};
use super::film_defects::{Grease, GreasySpot};
use super::film_spec::FilmSpec;
use super::noise::{NormalStream, PixelNoise, RandomPurpose, Seed};
use super::real_arm::{RealArm, ReportedFlangePose};
use super::sanding::{Sanding, SandingStrength};
use super::scanner::{Projector, ScannerDistortion};
use super::scene::{CornerView, Scene};
use super::shape::Shape;
use super::truth::CellTruth;
use super::wetting::WET_FROM_S;
use super::{appearance, film_defects, scanner, scene, shape};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{
    Base, Board, Camera, ColorPicture, Drawing, Flange, FlangeCamera, Frame, GrayPicture, KukaPose, Mask,
    OrganizedCloud, Panel, PinholeCamera, Pixel, Point, Rigid, TriangleMesh,
};

/// One of the two poses at which a camera sees the panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PanelPosition {
    /// The taught panel at its nominal pose.
    Nominal,
    /// The panel of the scene at its displaced pose, if there is a panel.
    Displaced,
}

/// A region for the recipe: its corners in the taught scan's picture, and its number of grids.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// The region's corners: top left, top right, bottom right, bottom left.
    pub corners_px: [Pixel; 4],
    /// Number of rows of grids.
    pub rows: usize,
    /// Number of columns of grids.
    pub columns: usize,
}

/// The search box of the panel in the base frame, mm: it contains the panel at all its poses, but no part of the
/// fixture.
pub const SEARCH_BOX_MM: [[f64; 3]; 2] = [[465.0, -240.0, 180.0], [638.0, 240.0, 540.0]];
/// Distance between the region and the outline, mm.
const REGION_INSET_MM: f64 = 15.0;

/// A simulated cell with one scene.
#[derive(Debug, Clone)]
pub struct Cell {
    pub(super) seed: Seed,
    scene: Scene,
    taught: Shape,
    /// The panel of the scene; `None` if the scene has no panel.
    present: Option<Shape>,
    spots: Vec<GreasySpot>,
    film: FilmSpec,
    base_from_panel: Rigid<Base, Panel>,
    pub(super) scanner: (PinholeCamera, Rays),
    pub(super) flange_camera: (PinholeCamera, Rays),
    pub(super) pixels: PixelNoise,
    arm: Option<RealArm>,
    distortion: Option<ScannerDistortion>,
}

impl Cell {
    /// Creates the cell of this seed and scene. The cameras' pictures are smaller than the real ones by the factor
    /// `reduction`.
    ///
    /// # Panics
    /// If `reduction` is not 1…8.
    pub fn new(seed: u64, scene: Scene, reduction: usize) -> Self {
        assert!((1..=8).contains(&reduction), "the reduction of the pictures is {reduction}; valid: 1 to 8");
        let seed = Seed(seed);
        let taught = Shape::taught(seed);
        let present = match scene {
            Scene::Good | Scene::Clean => Some(taught.clone()),
            Scene::WrongPanel => Some(Shape::random_other(seed)),
            Scene::NoPanel => None,
        };
        let spots = if scene == Scene::Good { film_defects::draw(seed, &taught, WET_FROM_S) } else { Vec::new() };
        let with_rays = |camera: PinholeCamera| (camera, Rays::new(&camera));
        Cell {
            seed,
            scene,
            taught,
            present,
            spots,
            film: FilmSpec::TYPICAL_FILM,
            base_from_panel: scene::displaced_pose(seed, 0),
            scanner: with_rays(scene::scanner(reduction)),
            flange_camera: with_rays(scene::flange_camera(reduction)),
            pixels: PixelNoise::new(seed),
            arm: None,
            distortion: None,
        }
    }

    /// Returns the same cell with an arm that differs from the nominal geometry.
    pub fn with_arm(self, arm: Option<RealArm>) -> Self {
        Cell { arm, ..self }
    }

    /// Returns the same cell with a 3D camera that has this distortion.
    pub fn with_distortion(self, distortion: Option<ScannerDistortion>) -> Self {
        Cell { distortion, ..self }
    }

    /// Returns the cell's arm, if it differs from the nominal geometry.
    pub fn real_arm(&self) -> Option<&RealArm> {
        self.arm.as_ref()
    }

    /// Returns the pose that the controller reports if the flange is at this true pose; `None` if the arm cannot reach
    /// the pose.
    pub fn reported_pose(&self, base_from_flange: &Rigid<Base, Flange>) -> Option<ReportedFlangePose> {
        match &self.arm {
            None => Some(ReportedFlangePose { base_from_flange: *base_from_flange, joints: None }),
            Some(arm) => arm.reported_pose(base_from_flange),
        }
    }

    /// Returns the same cell with films of this difficulty.
    pub fn with_films(self, spec: FilmSpec) -> Self {
        Cell { film: spec, ..self }
    }

    /// Returns the same cell with a panel that has been bent to a bow of this height, mm, after it was taught: the
    /// panel's middle lies in front of its taught position.
    pub fn with_bow(self, bow_mm: f64) -> Self {
        Cell { present: self.present.map(|panel| panel.with_bow(bow_mm)), ..self }
    }

    /// Returns the same cell with the panel at another displaced pose; number 0 is the pose after [`Cell::new`].
    pub fn with_pose(self, place: u32) -> Self {
        Cell { base_from_panel: scene::displaced_pose(self.seed, place), ..self }
    }

    /// Returns the true intrinsic parameters of the 3D camera, which its calibration estimates.
    pub fn scanner(&self) -> &PinholeCamera {
        &self.scanner.0
    }

    /// Returns the true intrinsic parameters of the colour camera on the flange, which its calibration estimates.
    pub fn flange_camera(&self) -> &PinholeCamera {
        &self.flange_camera.0
    }

    /// Returns the calibrated pose of the 3D camera, with an error of 0.1 mm and 0.01°.
    pub fn calibrated_base_from_camera(&self) -> Rigid<Base, Camera> {
        scene::calibrated_mount(self.seed, 0, &scene::base_from_camera())
    }

    /// Returns the calibrated mount of the flange camera, with an error of 0.1 mm and 0.01°.
    pub fn calibrated_flange_from_camera(&self) -> Rigid<Flange, FlangeCamera> {
        scene::calibrated_mount(self.seed, 1, &scene::flange_from_camera())
    }

    /// Returns the scan of the taught panel at its nominal pose.
    pub fn taught_scan(&self) -> OrganizedCloud<Camera> {
        self.render_scan(Some((&self.taught, &scene::nominal())), 0)
    }

    /// Returns the drawing of the taught panel, and the pose of the drawing's frame while the panel is at its nominal
    /// pose.
    pub fn drawing(&self) -> (TriangleMesh, Rigid<Base, Drawing>) {
        let base_from_drawing = scene::nominal().isometry() * self.taught.panel_from_sheet();
        (shape::drawing_mesh(&self.taught), Rigid::from_isometry_unchecked(base_from_drawing))
    }

    /// Returns the scan of the dry scene, with the panel at its displaced pose.
    pub fn scan(&self) -> OrganizedCloud<Camera> {
        self.render_scan(self.present.as_ref().map(|shape| (shape, &self.base_from_panel)), 1)
    }

    /// Returns a scan with the scene's panel at another pose. Each number `shot` gives another noise.
    pub fn scan_at(&self, base_from_panel: &Rigid<Base, Panel>, shot: u64) -> OrganizedCloud<Camera> {
        self.render_scan(self.present.as_ref().map(|shape| (shape, base_from_panel)), shot + 2)
    }

    fn render_scan(&self, panel: Option<(&Shape, &Rigid<Base, Panel>)>, shot: u64) -> OrganizedCloud<Camera> {
        let projector = Projector::new(&scene::base_from_camera(), panel, &[]);
        let seed = self.seed.child(RandomPurpose::Scan, shot);
        let scan = scanner::capture(&self.scanner_view(panel), &projector, &self.pixels, seed);
        match &self.distortion {
            Some(distortion) => distortion.distort_scan(&scan),
            None => scan,
        }
    }

    fn scanner_view<'a>(&'a self, panel: Option<(&'a Shape, &Rigid<Base, Panel>)>) -> CastView<'a> {
        CastView::new(&self.scanner.0, &self.scanner.1, &scene::base_from_camera(), panel)
    }

    /// Returns the corners of the taught panel with the flange poses from which they are taught.
    pub fn corner_views(&self) -> Vec<CornerView> {
        scene::corner_views(&self.taught)
    }

    /// Returns the taught flange pose, moved with the panel to its displaced pose and changed by up to 5 mm and 1°. A
    /// robot reaches such a pose after a rough localization.
    pub fn displaced_corner_pose(&self, view: &CornerView) -> Rigid<Base, Flange> {
        let moved: Rigid<Base, Base> = Rigid::from_isometry_unchecked(*self.base_from_panel.isometry());
        scene::perturbed_flange_pose(
            self.seed,
            Seed::index_of(view.corner.mm.coords.as_slice()),
            &(moved * view.base_from_flange),
        )
    }

    /// Returns the flange camera's picture of the dry panel from this pose. The noise depends only on the pose.
    pub fn flange_picture(&self, base_from_flange: &Rigid<Base, Flange>, place: PanelPosition) -> ColorPicture {
        match place {
            PanelPosition::Nominal => self.flange_shot(base_from_flange, Some((&self.taught, &scene::nominal()))),
            PanelPosition::Displaced => self.flange_picture_at(base_from_flange, &self.base_from_panel),
        }
    }

    /// Returns the flange camera's picture of the dry panel at another pose of the panel.
    pub fn flange_picture_at(
        &self,
        base_from_flange: &Rigid<Base, Flange>,
        base_from_panel: &Rigid<Base, Panel>,
    ) -> ColorPicture {
        self.flange_shot(base_from_flange, self.present.as_ref().map(|shape| (shape, base_from_panel)))
    }

    /// Returns the flange camera's picture of the wet panel, with drops, at another pose of the panel.
    pub fn wet_flange_picture_at(
        &self,
        base_from_flange: &Rigid<Base, Flange>,
        base_from_panel: &Rigid<Base, Panel>,
    ) -> ColorPicture {
        let base_from_camera = *base_from_flange * scene::flange_from_camera();
        let panel = self.present.as_ref().map(|shape| (shape, base_from_panel));
        let view = CastView::new(&self.flange_camera.0, &self.flange_camera.1, &base_from_camera, panel);
        let place = KukaPose::from_rigid(base_from_panel);
        appearance::capture_wet(
            &view,
            &self.pixels,
            self.seed.child(RandomPurpose::FlangePicture, Seed::index_of(&[place.x_mm, place.y_mm])),
        )
    }

    fn flange_shot(
        &self,
        base_from_flange: &Rigid<Base, Flange>,
        panel: Option<(&Shape, &Rigid<Base, Panel>)>,
    ) -> ColorPicture {
        let base_from_camera = *base_from_flange * scene::flange_from_camera();
        let view = CastView::new(&self.flange_camera.0, &self.flange_camera.1, &base_from_camera, panel);
        let pose = KukaPose::from_rigid(base_from_flange);
        let numbers = [pose.x_mm, pose.y_mm, pose.z_mm, pose.a_deg, pose.b_deg, pose.c_deg];
        appearance::capture_dry(
            &view,
            &self.pixels,
            self.seed.child(RandomPurpose::FlangePicture, Seed::index_of(&numbers)),
        )
    }

    /// Returns the film of the water-break test of the panel in the cell.
    pub fn film(&self) -> Film {
        self.film_with_spots(&self.spots)
    }

    /// Returns the film of a panel with other greasy spots, for example without a spot that was sanded.
    pub fn film_with_spots(&self, spots: &[GreasySpot]) -> Film {
        self.film_with_spec(spots, &self.film, 0)
    }

    /// Returns the film of a panel with these greasy spots and this difficulty. Each number `index` gives another film.
    pub fn film_with_spec(&self, spots: &[GreasySpot], spec: &FilmSpec, index: u64) -> Film {
        let view = self.scanner_view(self.present.as_ref().map(|shape| (shape, &self.base_from_panel)));
        let seed = self.seed.child(RandomPurpose::Film, spots.len() as u64 + (index << 8));
        Film::new(&view, PanelCondition { spots, stained: spots, washed: false }, spec, &self.pixels, seed)
    }

    /// Returns the film after sanding: with the grease that remains, and with the stains of all earlier grease.
    pub fn sanded_film(&self, left: &[GreasySpot], sanding: &Sanding, index: u64) -> Film {
        self.sanded_film_with_spec((left, &self.spots), sanding, &self.film, index)
    }

    /// Returns the film after sanding, with this difficulty; `stained` is the grease before sanding.
    pub fn sanded_film_with_spec(
        &self,
        (left, stained): (&[GreasySpot], &[GreasySpot]),
        sanding: &Sanding,
        spec: &FilmSpec,
        index: u64,
    ) -> Film {
        let view = self.scanner_view(self.present.as_ref().map(|shape| (shape, &self.base_from_panel)));
        let seed = self.seed.child(RandomPurpose::Film, left.len() as u64 + (index << 8));
        let on_panel = PanelCondition { spots: left, stained, washed: !sanding.is_empty() };
        Film::new(&view.with_sanding(sanding), on_panel, spec, &self.pixels, seed)
    }

    /// Adds a sanding pass of a disc of this radius whose centre moves through these points of the panel.
    pub fn sand(&self, sanding: &mut Sanding, centres: &[Point<Panel>], radius_mm: f64, strength: SandingStrength) {
        let shape = self.present.as_ref().unwrap_or(&self.taught);
        let places: Vec<[f64; 2]> = centres.iter().map(|centre| shape.nearest(*centre).0).collect();
        sanding.add_track(&places, radius_mm, (self.seed, strength));
    }

    /// Adds a sanding pass over these areas of the panel, each given by the corners of a quadrilateral.
    pub fn sand_areas(&self, sanding: &mut Sanding, areas: &[[Point<Panel>; 4]], strength: SandingStrength) {
        let shape = self.present.as_ref().unwrap_or(&self.taught);
        let quads: Vec<_> = areas.iter().map(|area| area.map(|corner| shape.nearest(corner).0)).collect();
        sanding.add_quads(&quads, (self.seed, strength));
    }

    /// Returns the ground truth: the pixels of the taught scan that show a sanded point, or a point within `margin_mm`
    /// of a sanded point.
    pub fn sanded_taught_pixels(&self, sanding: &Sanding, margin_mm: f64) -> Mask {
        let view = self.scanner_view(Some((&self.taught, &scene::nominal())));
        let mut mask = Mask::all_outside(view.width(), view.height());
        for row in 0..view.height() {
            view.cast_row(row, |column, sight| {
                let touched = sight.panel.is_some_and(|panel| sanding.was_touched(panel.place, margin_mm));
                mask.inside[row * mask.width + column] = touched;
            });
        }
        mask
    }

    /// Draws greasy spots on this panel that differ from those of its scene. Each number `index` gives other spots.
    pub fn with_other_grease(&self, grease: &Grease, index: u64) -> Vec<GreasySpot> {
        let shape = self.present.as_ref().unwrap_or(&self.taught);
        film_defects::draw_spots(self.seed.child(RandomPurpose::Grease, index), shape, WET_FROM_S, grease)
    }

    /// Returns the greasy spots of the scene.
    pub fn spots(&self) -> &[GreasySpot] {
        &self.spots
    }

    /// Returns a region with grids of 42 to 50 mm, 15 mm inside of the taught panel's outline.
    pub fn region(&self) -> Region {
        let inner = self.taught.outline().inset_corners(REGION_INSET_MM);
        // The outline's corners are numbered from the bottom left; number 4 is the top left, number 3 the end of the
        // right side.
        let corners_px = [4, 3, 1, 0].map(|index: usize| {
            let seen =
                scene::base_from_camera().inverse() * (scene::nominal() * self.taught.point(inner[index].into()));
            match self.scanner.0.project(seen) {
                Some(pixel) => pixel,
                None => unreachable!("the nominal panel must be in front of the camera"),
            }
        });
        Region { corners_px, rows: 4, columns: 6 }
    }

    /// Returns the ground truth of this cell.
    pub fn truth(&self) -> CellTruth {
        CellTruth::new(
            (self.seed.0, self.scene),
            self.base_from_panel,
            (scene::base_from_camera(), scene::flange_from_camera()),
            self.corner_views(),
            self.present.as_ref().unwrap_or(&self.taught).clone(),
            &self.spots,
        )
    }
}

/// Standard deviation of a touched point of a board along each axis, mm.
const TOUCH_NOISE_MM: f64 = 0.03;

/// A fixed board in the cell, as one of the cameras sees it.
#[derive(Debug, Clone)]
pub struct Target {
    /// The true pose of the board.
    pub base_from_board: Rigid<Base, Board>,
    /// The pose of the board as measured by touching it.
    pub known_base_from_board: Rigid<Base, Board>,
    /// The flange's pose at which the flange camera captures its picture; not used for the fixed camera.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The camera's picture of the board.
    pub picture: GrayPicture,
}

impl Target {
    /// Returns the print of these boards: 5 × 4 inner corners, squares of 40 mm.
    pub fn target_print() -> BoardPrint {
        BoardPrint::chessboard(5, 4, 40.0)
    }
}

impl Cell {
    /// Returns the board of the fixed camera, beside the middle of its picture and within the reach of the arm that
    /// touches the board.
    pub fn scanner_target(&self) -> Target {
        let camera_from_board = board_pose_at([120.0, 90.0, 690.0], [0.15, -0.2, 0.05]);
        let base_from_board = scene::base_from_camera() * camera_from_board;
        self.target(
            0,
            &self.scanner.0,
            &camera_from_board,
            (base_from_board, Rigid::from_isometry_unchecked(Isometry3::identity())),
        )
    }

    /// Returns the board of the flange camera: it lies in the cell below the camera.
    pub fn flange_target(&self) -> Target {
        let base_from_board: Rigid<Base, Board> =
            board_pose_at([540.0, 60.0, 200.0], [std::f64::consts::PI, 0.02, 0.0]);
        let camera_from_board = board_pose_at([10.0, -8.0, 470.0], [0.2, 0.15, 0.1]);
        let base_from_flange =
            base_from_board * camera_from_board.inverse() * scene::flange_from_camera().inverse();
        self.target(1, &self.flange_camera.0, &camera_from_board, (base_from_board, base_from_flange))
    }

    /// Returns points of a fixed board in the base frame, as measured by touching them with the tool's tip.
    pub fn touched_target(&self, target: &Target, places: &[Point<Board>]) -> Vec<Point<Base>> {
        let mut normal = NormalStream::new(self.seed.stream(RandomPurpose::Touch, 2));
        let mut touch = |&place: &Point<Board>| {
            let noise = Vector3::from_fn(|_, _| normal.next()) * TOUCH_NOISE_MM;
            Point::new((target.base_from_board * place).mm + noise)
        };
        places.iter().map(&mut touch).collect()
    }

    fn target<C: Frame>(
        &self,
        index: u64,
        camera: &PinholeCamera,
        camera_from_board: &Rigid<C, Board>,
        (base_from_board, base_from_flange): (Rigid<Base, Board>, Rigid<Base, Flange>),
    ) -> Target {
        let mut normal = NormalStream::new(self.seed.stream(RandomPurpose::Touch, index));
        let off = Vector3::from_fn(|_, _| normal.next()) * TOUCH_NOISE_MM;
        let shot = self.seed.child(RandomPurpose::Touch, index);
        Target {
            base_from_board,
            known_base_from_board: Rigid::from_isometry_unchecked(
                Translation3::from(off) * base_from_board.isometry(),
            ),
            base_from_flange,
            picture: Target::target_print().picture(camera, camera_from_board, (&self.pixels, shot)),
        }
    }
}

/// Returns the pose of a board whose centre is at a position, rotated by a rotation vector, rad.
fn board_pose_at<To: Frame>(middle_mm: [f64; 3], turn: [f64; 3]) -> Rigid<To, Board> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
    let shift = Vector3::from(middle_mm) - turn * Target::target_print().centre().mm.coords;
    Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::from(shift), turn))
}
