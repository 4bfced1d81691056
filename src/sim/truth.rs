//! The ground truth of a simulated cell: for evaluation and tests, never as input of a stage.

use super::film_defects::GreasySpot;
use super::scene::{CornerView, Scene};
use super::shape::Shape;
use panelprep_base::geometry::{Base, Camera, Flange, FlangeCamera, KukaPose, Panel, Point, Rigid, Vector};
use serde::{Deserialize, Serialize};

/// The ground truth of a cell.
#[derive(Debug, Clone)]
pub struct CellTruth {
    /// The seed of the cell.
    pub seed: u64,
    /// The scene of the cell.
    pub scene: Scene,
    /// The displaced panel's pose; if the scene has no panel, the pose that a panel would have.
    pub base_from_panel: Rigid<Base, Panel>,
    /// The 3D camera's pose.
    pub base_from_camera: Rigid<Base, Camera>,
    /// The true mount of the flange camera.
    pub flange_from_camera: Rigid<Flange, FlangeCamera>,
    /// The corners of the taught views: the intersections of straight edges, on the surface.
    pub corners: Vec<CornerView>,
    /// Greasy spots of the displaced panel.
    pub spots: Vec<TrueSpot>,
    shape: Shape,
}

/// A greasy spot on the panel.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueSpot {
    /// The spot's centre on the surface.
    pub centre: Point<Panel>,
    /// The spot's outline on the surface, closed; the last point is not repeated.
    pub outline: Vec<Point<Panel>>,
    /// The spot's area on the surface, mm².
    pub area_mm2: f64,
    /// Time at which the film breaks at the spot's centre, s from the start of the film.
    pub breaks_at_s: f64,
    /// Time at which the break has reached the spot's outline, s from the start of the film.
    pub grown_at_s: f64,
}

impl CellTruth {
    pub(super) fn new(
        (seed, scene): (u64, Scene),
        base_from_panel: Rigid<Base, Panel>,
        (base_from_camera, flange_from_camera): (Rigid<Base, Camera>, Rigid<Flange, FlangeCamera>),
        corners: Vec<CornerView>,
        shape: Shape,
        spots: &[GreasySpot],
    ) -> Self {
        let spots = spots.iter().map(|spot| true_spot(&shape, spot)).collect();
        CellTruth { seed, scene, base_from_panel, base_from_camera, flange_from_camera, corners, spots, shape }
    }

    /// Returns the signed distance of a point from the displaced panel's surface along the outward normal, mm.
    pub fn distance_mm(&self, point: Point<Panel>) -> f64 {
        self.shape.nearest(point).1
    }

    /// Returns the outward normal of the displaced panel's surface at the point that is nearest to a given point.
    pub fn normal(&self, point: Point<Panel>) -> Vector<Panel> {
        self.shape.normal(self.shape.nearest(point).0)
    }

    /// Returns the signed distance of a point from the panel's outline on the sheet, negative inside, mm.
    pub fn outline_distance_mm(&self, point: Point<Panel>) -> f64 {
        self.shape.outline().distance(self.shape.nearest(point).0.into()).0
    }

    /// Returns the panel's outline on its surface, with one point every 5 mm.
    pub fn outline(&self) -> Vec<Point<Panel>> {
        self.shape.outline().polyline(5.0).into_iter().map(|place| self.shape.point(place.into())).collect()
    }

    /// Returns the points of the surface on a lattice of 10 mm, at which the error of a pose is evaluated.
    pub fn surface_points(&self) -> Vec<Point<Panel>> {
        let lattice = (-20..=20).flat_map(|j| (-20..=20).map(move |i| [f64::from(i) * 10.0, f64::from(j) * 10.0]));
        lattice
            .filter(|&place| self.shape.outline().distance(place.into()).0 < 0.0)
            .map(|place| self.shape.point(place))
            .collect()
    }

    /// Returns the mean and the largest distance between the panel's surface at a found pose and the true surface, mm.
    pub fn placement_error_mm(&self, found: &Rigid<Base, Panel>) -> PlacementError {
        let points = self.surface_points();
        let errors = points.iter().map(|&point| self.base_from_panel.distance_at_mm(*found, point));
        let (sum_mm, max_mm) = errors.fold((0.0, 0.0_f64), |(sum, max), error| (sum + error, max.max(error)));
        PlacementError { mean_mm: sum_mm / points.len() as f64, max_mm }
    }

    /// Returns the ground truth in the form in which it is written to a file.
    pub fn numbers(&self) -> TruthNumbers {
        let point = |point: Point<Panel>| point.mm.coords.into();
        TruthNumbers {
            seed: self.seed,
            scene: self.scene.keyword().to_owned(),
            base_from_panel: KukaPose::from_rigid(&self.base_from_panel),
            base_from_camera: KukaPose::from_rigid(&self.base_from_camera),
            flange_from_camera: KukaPose::from_rigid(&self.flange_from_camera),
            corners: self
                .corners
                .iter()
                .map(|view| CornerNumbers { name: view.name.to_owned(), corner_mm: point(view.corner) })
                .collect(),
            outline_mm: self.outline().into_iter().map(point).collect(),
            spots: self
                .spots
                .iter()
                .map(|spot| SpotNumbers {
                    centre_mm: point(spot.centre),
                    outline_mm: spot.outline.iter().copied().map(point).collect(),
                    area_mm2: spot.area_mm2,
                    breaks_at_s: spot.breaks_at_s,
                    grown_at_s: spot.grown_at_s,
                })
                .collect(),
        }
    }
}

/// The error of a found pose: distances over the panel's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacementError {
    /// Mean distance, mm.
    pub mean_mm: f64,
    /// Largest distance, mm.
    pub max_mm: f64,
}

/// The ground truth in the form in which it is written to a file; coordinates are in the panel's frame unless the name
/// states another frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthNumbers {
    /// The seed of the cell.
    pub seed: u64,
    /// The keyword of the cell's scene.
    pub scene: String,
    /// The displaced panel's pose.
    pub base_from_panel: KukaPose,
    /// The 3D camera's pose.
    pub base_from_camera: KukaPose,
    /// The true mount of the flange camera.
    pub flange_from_camera: KukaPose,
    /// The taught corners.
    pub corners: Vec<CornerNumbers>,
    /// The panel's outline on its surface.
    pub outline_mm: Vec<[f64; 3]>,
    /// The greasy spots of the displaced panel.
    pub spots: Vec<SpotNumbers>,
}

/// A corner in the form in which it is written to a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CornerNumbers {
    /// Name of the corner.
    pub name: String,
    /// The intersection of the corner's straight edges, mm.
    pub corner_mm: [f64; 3],
}

/// A greasy spot in the form in which it is written to a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpotNumbers {
    /// The spot's centre on the surface, mm.
    pub centre_mm: [f64; 3],
    /// Corners of the spot's outline, mm.
    pub outline_mm: Vec<[f64; 3]>,
    /// The spot's area on the surface, mm².
    pub area_mm2: f64,
    /// Time at which the film breaks at the spot's centre, s from the start of the film.
    pub breaks_at_s: f64,
    /// Time at which the break has reached the spot's outline, s from the start of the film.
    pub grown_at_s: f64,
}

fn true_spot(shape: &Shape, spot: &GreasySpot) -> TrueSpot {
    let outline: Vec<Point<Panel>> = spot.outline_mm().into_iter().map(|place| shape.point(place)).collect();
    let centre = shape.point(spot.centre_mm());
    // The area is the sum of a fan of triangles about the centre, because the surface is nearly flat within a spot.
    let next = outline.iter().cycle().skip(1);
    let area_mm2 =
        outline.iter().zip(next).map(|(&a, &b)| (a - centre).mm.cross(&(b - centre).mm).norm() / 2.0).sum();
    let (breaks_at_s, grown_at_s) = (spot.opening_time_s(0.0), spot.opening_time_s(1.0));
    TrueSpot { centre, outline, area_mm2, breaks_at_s, grown_at_s }
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    /// Expected value, calculated by hand: shifting the found pose by 0.3 mm shifts every point by 0.3 mm.
    #[test]
    fn the_error_of_a_pose_is_measured_over_the_surface() {
        let truth = Cell::new(1, Scene::Good, 8).truth();
        let found =
            truth.base_from_panel.followed_by_displacement(Vector::new(nalgebra::Vector3::new(0.0, 0.3, 0.0)));
        let error = truth.placement_error_mm(&found);
        assert!((error.mean_mm - 0.3).abs() < 1e-9 && (error.max_mm - 0.3).abs() < 1e-9, "{error:?}");
        assert!(truth.surface_points().len() > 600);
        for point in truth.surface_points() {
            assert!(truth.distance_mm(point).abs() < 1e-9 && truth.outline_distance_mm(point) < 0.0);
        }
    }

    #[test]
    fn the_ground_truth_is_read_back_unchanged() {
        let numbers = Cell::new(3, Scene::Good, 8).truth().numbers();
        let text = serde_json::to_string(&numbers).expect("plain numbers");
        let back: TruthNumbers = serde_json::from_str(&text).expect("the same form");
        assert_eq!(back.spots.len(), numbers.spots.len());
        assert!((back.base_from_panel.a_deg - numbers.base_from_panel.a_deg).abs() < 1e-12);
    }
}
