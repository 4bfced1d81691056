//! The pose of the panel: 3D registration of a scan (thesis 3.8), and correction of the pose by corners (thesis 3.9).
//!
//! The search needs no start value and covers all poses in the search box. The scan is downsampled ([`grid`]) and
//! segmented into connected components in the box ([`pieces`]). The taught panel is aligned with these pieces at every
//! rotation ([`search`]). The best pose hypotheses are fitted to the surface and to the outline's edges in the colour
//! picture together ([`fit`], [`edges`]), with the borders of marks inside it (`print_features`), and compared with
//! each other ([`ConsistencyScore`]). The result is a [`Fit`]: the pose with its covariance, the agreement of
//! independent starts, and the check of the camera's pose by the fixture. [`gate`] judges this evidence. [`explain`]
//! marks the cause of a reason in the scan's picture. [`identify`] compares a scan with several taught panels.
//! [`corner`] finds the panel's corner in a picture of the flange camera, and [`refine`] corrects the pose by it.
//! [`thesis_icp`] is the thesis's own method, for comparison. An error of the camera's calibration moves taught and
//! located panel alike and cannot be detected here.
//!
//! Two pose hypotheses of one panel are compared by the evidence that supports only one of them. Only points at which
//! the two poses disagree contain information. One kind of evidence is a segment of the outline, or the border of a
//! mark, whose edge is measured at only one of the poses. The other kind is a square of surface that is on the scan at
//! only one of the poses. Points that are occluded at either pose are excluded. The evidence is a length; a square of
//! surface is converted to the length of its side.

mod camera_check;
pub mod corner;
mod covariance;
mod deviation;
mod edges;
mod error;
mod evidence;
pub mod explain;
mod fit;
pub mod gate;
mod grid;
pub mod identify;
mod model;
mod pieces;
mod point_to_point;
mod print_features;
pub mod refine;
mod scan_errors;
mod search;
mod solve;
mod taught_outline;

pub use camera_check::CameraCheck;
pub use covariance::WeakestMotion;
use deviation::{BentFit, Deviation};
pub use error::LocateError;
use evidence::FurtherEvidence;
pub use evidence::{CompetingPose, Fit};
use fit::{FitInputs, FitState, Residuals, Samples};
use grid::{Grid, MatrixTransform, spread_indices};
use model::Model;
pub use model::TaughtModel;
use nalgebra::{Rotation3, Vector3, Vector6};
use panelprep_base::geometry::{Base, Camera, OrganizedCloud, Panel, PinholeCamera, Point, Rigid};
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe;
use panelprep_cell::recipe::Registration;
pub use point_to_point::thesis_icp;
use rayon::prelude::*;
pub use refine::refine;
pub use scan_errors::{RangeErrors, ScanErrors};
use search::{PointObservation, PoseHypothesis, observe_point};
pub use taught_outline::OutlineEvidence;

/// A scan and the pose of its camera.
#[derive(Debug, Clone, Copy)]
pub struct ScanView<'a> {
    /// The scan in the camera frame.
    pub scan: &'a OrganizedCloud<Camera>,
    /// The lens model of the camera.
    pub camera: &'a PinholeCamera,
    /// The pose of the camera in the base frame.
    pub base_from_camera: Rigid<Base, Camera>,
    /// The errors of the scans of this camera.
    pub range: RangeErrors,
}

/// Number of samples of a fit that only compares hypotheses, and of a fit from an independent start.
const HYPOTHESIS_SAMPLE_COUNT: usize = 3_000;
/// Offset of the independent starts from the result: a shift as a fraction of the panel's reach
/// (`RELATIVE_START_SHIFT`), and a rotation, rad (`START_ROTATION_RAD`).
const RELATIVE_START_SHIFT: f64 = 0.02;
const START_ROTATION_RAD: f64 = 0.015;

/// Numbers of taught points (`THESIS_TAUGHT_POINT_COUNT`) and scanned points (`THESIS_SCANNED_POINT_COUNT`) for the
/// thesis's method.
const THESIS_TAUGHT_POINT_COUNT: usize = 6_000;
const THESIS_SCANNED_POINT_COUNT: usize = 120_000;

/// A taught panel and a scan, prepared for localization and for explaining its result.
pub struct PreparedScan<'a> {
    taught: &'a TaughtPanel,
    view: ScanView<'a>,
    settings: &'a recipe::Locate,
    taught_model: &'a TaughtModel,
    grid: Grid,
    inside: Vec<bool>,
    pieces: Vec<pieces::Piece>,
}

/// Finds the taught panel in a scan.
///
/// # Errors
/// The errors of [`TaughtModel::from_panel`] and [`PreparedScan::locate`].
pub fn locate(taught: &TaughtPanel, view: &ScanView<'_>, settings: &recipe::Locate) -> Result<Fit, LocateError> {
    let model = TaughtModel::from_panel(taught, view.range)?;
    PreparedScan::new((taught, &model), view, settings).locate()
}

impl<'a> PreparedScan<'a> {
    /// Prepares a scan for the localization of a taught panel.
    pub fn new(
        (taught, taught_model): (&'a TaughtPanel, &'a TaughtModel),
        view: &ScanView<'a>,
        settings: &'a recipe::Locate,
    ) -> Self {
        let grid = Grid::from_scan(view.scan, view.camera);
        let inside =
            grid::blocks_in_box(&grid, &view.base_from_camera, settings.box_min_mm(), settings.box_max_mm());
        let pieces = pieces::find_pieces(&grid, &inside);
        PreparedScan { taught, view: *view, settings, taught_model, grid, inside, pieces }
    }

    /// Returns the fractions of the panel's outline that the taught scan shows.
    pub fn outline_seen(&self) -> OutlineEvidence {
        self.taught_model.model.outline_evidence
    }

    /// Returns the length of the mark borders inside of the outline in the taught picture, mm: they also constrain the
    /// panel sideways.
    pub fn marks_mm(&self) -> f64 {
        self.taught_model.model.marks.points.iter().map(|mark| mark.length_mm).sum()
    }

    fn inputs(&self) -> FitInputs<'_> {
        FitInputs { model: &self.taught_model.model, grid: &self.grid, scan: self.view.scan }
    }

    /// Finds the panel in the scan.
    ///
    /// # Errors
    /// If no object of the size and shape of the panel is in the search box; [`gate::refusal`] converts this error into
    /// a verdict.
    pub fn locate(&self) -> Result<Fit, LocateError> {
        let PreparedScan { taught, view, grid, inside, pieces, .. } = self;
        let model = &self.taught_model.model;
        let candidates = search::candidates(model, grid, pieces);
        if candidates.is_empty() {
            return Err(no_fit_error(model, pieces, inside.iter().filter(|inside| **inside).count()));
        }
        // Every localization searches completely, without a start value: with a start at the last pose, a panel that is
        // rotated by 180° would not be found.
        let hypotheses = search::search(model, (grid, view.scan), &candidates);
        let inputs = self.inputs();
        let hypotheses = (hypotheses.as_slice(), view.base_from_camera);
        let (best, rival) = choose(hypotheses, inputs, PanelForm::AsTaught)
            .filter(|(best, _)| !is_bent(best, inputs))
            .or_else(|| choose(hypotheses, inputs, PanelForm::AsBent))
            .ok_or(LocateError::Degenerate { surface: model.points.len(), outline: model.outline.len() })?;
        let fitted = fit::fit(&best, inputs, &Samples::all_of_model(model))
            .ok_or(LocateError::Degenerate { surface: model.points.len(), outline: model.outline.len() })?;
        let BentFit { fitted, deviation, model: bent } =
            deviation::estimate_deviation(fitted, inputs, &Samples::all_of_model(model));
        let inputs = FitInputs { model: bent.as_ref().unwrap_or(model), ..inputs };
        let (agreement_mm, camera) = rayon::join(
            || agreement_mm(&fitted, inputs),
            || {
                camera_check::check_camera(
                    taught,
                    self.taught_model,
                    (grid, view.scan),
                    inside,
                    &fitted.camera_from_panel,
                )
            },
        );
        let is_watched = gate::can_detect_motion(camera.map(|camera| camera.uncertainty_mm));
        // Computed only if the present scan cannot show a motion of the camera: the fixture may be hidden now although
        // the taught scan showed it.
        let asked =
            (!is_watched).then(|| camera_check::teaching_uncertainty_mm(taught, self.taught_model, self.settings));
        let beside =
            FurtherEvidence { agreement_mm, rival, camera, camera_at_teaching_mm: asked.flatten(), deviation };
        match self.settings.method() {
            Registration::PointToPlane => {
                evidence::compute_evidence(&fitted, inputs, pieces, view.base_from_camera, beside)
            }
            Registration::Thesis => {
                let camera_from_panel = self.locate_by_thesis(&best);
                // The thesis's method states no error of its own; its distance from the pose of the other method, which
                // has a stated error, is an upper limit of it.
                let off_mm = inputs.model.largest_distance_mm(&camera_from_panel, &fitted.camera_from_panel);
                let placed = FitState { camera_from_panel, ..fitted };
                let fit = evidence::compute_evidence(&placed, inputs, pieces, view.base_from_camera, beside)?;
                Ok(fit.with_additional_error(off_mm))
            }
        }
    }

    /// Returns the pose by the thesis's method from a start pose.
    fn locate_by_thesis(&self, start: &Rigid<Camera, Panel>) -> Rigid<Camera, Panel> {
        let PreparedScan { view, grid, inside, .. } = self;
        let points = &self.taught_model.model.points;
        let taught: Vec<Point<Panel>> = grid::spread_indices(points.len(), THESIS_TAUGHT_POINT_COUNT)
            .into_iter()
            .map(|index| Point::new(points[index].into()))
            .collect();
        let in_box: Vec<usize> = (0..inside.len()).filter(|&index| inside[index]).collect();
        let scanned: Vec<Point<Base>> = grid::spread_indices(in_box.len(), THESIS_SCANNED_POINT_COUNT)
            .into_iter()
            .filter_map(|place| grid.point(in_box[place] % grid.columns, in_box[place] / grid.columns))
            .map(|point| view.base_from_camera * grid::camera_point(&point))
            .collect();
        view.base_from_camera.inverse() * thesis_icp(&taught, &scanned, view.base_from_camera * *start)
    }
}

/// The shape in which the panel is compared with the scan at the poses of two hypotheses.
#[derive(Clone, Copy, PartialEq)]
enum PanelForm {
    /// The taught shape.
    AsTaught,
    /// The shape bent as required at each of the two poses, and fitted again. For a bent panel, the taught surface
    /// gives little information on the pose and displaces the fit. The evidence for one of the poses is then what no
    /// bend explains, mainly the outline.
    AsBent,
}

/// Returns whether the panel at this pose is bent by more than the tolerance of the taught surface.
fn is_bent(placed: &Rigid<Camera, Panel>, inputs: FitInputs<'_>) -> bool {
    let residuals =
        Residuals::at_pose(placed, inputs, &Samples::subset(inputs.model, HYPOTHESIS_SAMPLE_COUNT).surface_only());
    let deviation = Deviation::from_residuals(&residuals, inputs.model, None);
    deviation.is_some_and(|deviation| deviation.largest_mm > MAX_SURFACE_DISTANCE_MM)
}

/// Fits the hypotheses and returns the pose with the most evidence, with its closest rival.
fn choose(
    (hypotheses, base_from_camera): (&[PoseHypothesis], Rigid<Base, Camera>),
    inputs: FitInputs<'_>,
    panels: PanelForm,
) -> Option<(Rigid<Camera, Panel>, Option<CompetingPose>)> {
    let samples = Samples::subset(inputs.model, HYPOTHESIS_SAMPLE_COUNT);
    let fitted: Vec<Option<(Rigid<Camera, Panel>, ConsistencyScore)>> = hypotheses
        .par_iter()
        .take(search::fitted_hypotheses(inputs.model) - 1)
        .map(|hypothesis| {
            let fitted = fit::fit(&hypothesis.camera_from_panel, inputs, &samples)?;
            let taught = BentFit { fitted, deviation: None, model: None };
            let bent = if panels == PanelForm::AsBent {
                deviation::estimate_deviation(fitted, inputs, &samples)
            } else {
                taught
            };
            let end = bent.fitted.camera_from_panel;
            let inputs = FitInputs { model: bent.model.as_ref().unwrap_or(inputs.model), ..inputs };
            Some((end, ConsistencyScore::compute(&end, inputs)))
        })
        .collect();
    let mut fitted: Vec<(Rigid<Camera, Panel>, ConsistencyScore)> = fitted.into_iter().flatten().collect();
    let beats = |a: &ConsistencyScore, b: &ConsistencyScore| {
        let [for_a, for_b] = a.exclusive_support_mm(b);
        for_a > for_b
    };
    let mut best = 0;
    // The poses are compared in pairs and not by a sum: only points at which two poses differ can decide between them.
    // A sum would favour the pose at which fewer points are hidden.
    for other in 1..fitted.len() {
        if beats(&fitted[other].1, &fitted[best].1) {
            best = other;
        }
    }
    if fitted.is_empty() {
        return None;
    }
    let (first, score) = fitted.swap_remove(best);
    // The results of starts that converge to one pose differ by much less than this; another matching pose, rotated or
    // shifted, differs by more.
    let same_mm = 0.05 * search::reach_mm(inputs.model);
    let rivals = fitted.iter().filter(|(other, _)| inputs.model.largest_distance_mm(&first, other) > same_mm);
    let rival = rivals.map(|(other, against)| {
        let [for_first_mm, for_rival_mm] = score.exclusive_support_mm(against);
        let turned = (first.inverse() * *other).rotation_angle();
        CompetingPose { base_from_panel: base_from_camera * *other, rotation: turned, for_first_mm, for_rival_mm }
    });
    Some((first, rival.min_by(|a, b| a.evidence_ratio().total_cmp(&b.evidence_ratio()))))
}

/// Returns the maximum distance between the results of independent starts, mm; infinite if a start does not converge.
fn agreement_mm(fitted: &FitState, inputs: FitInputs<'_>) -> f64 {
    let shift_mm = RELATIVE_START_SHIFT * search::reach_mm(inputs.model);
    let centre = MatrixTransform::from_rigid(&fitted.camera_from_panel).point(&inputs.model.centre);
    // Three starts around the result, each shifted sideways and rotated about another axis.
    let starts = [0.0, 120.0, 240.0f64].map(|turn_deg| {
        let around = Rotation3::from_axis_angle(&Vector3::z_axis(), turn_deg.to_radians());
        let shift = around * Vector3::new(shift_mm, 0.0, 0.5 * shift_mm);
        let turn = around * Vector3::new(0.0, START_ROTATION_RAD, START_ROTATION_RAD);
        let twist = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        solve::apply_twist(&fitted.camera_from_panel, &centre, &twist)
    });
    let samples = Samples::subset(inputs.model, HYPOTHESIS_SAMPLE_COUNT);
    let ends: Vec<Option<FitState>> = starts.par_iter().map(|start| fit::fit(start, inputs, &samples)).collect();
    // A start that does not converge is evidence against the pose, not a missing value.
    let Some(ends) = ends.into_iter().collect::<Option<Vec<FitState>>>() else { return f64::INFINITY };
    let apart =
        |a: &FitState, b: &FitState| inputs.model.largest_distance_mm(&a.camera_from_panel, &b.camera_from_panel);
    let pairs = (0..ends.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    pairs.map(|(i, j)| apart(&ends[i], &ends[j])).fold(0.0, f64::max)
}

fn no_fit_error(model: &Model, pieces: &[pieces::Piece], found: usize) -> LocateError {
    let alike = |piece: &&pieces::Piece| (piece.area_mm2 / model.area_mm2).ln().abs();
    match pieces.iter().min_by(|a, b| alike(a).total_cmp(&alike(b))) {
        None => LocateError::EmptyBox { found, needed: pieces::MIN_BLOCKS },
        Some(piece) => LocateError::NoPieceFits {
            pieces: pieces.len(),
            area_mm2: piece.area_mm2,
            taught_area_mm2: model.area_mm2,
        },
    }
}

/// Maximum distance between an edge and the point of the outline that it supports, px.
const MAX_EDGE_DISTANCE_PX: f64 = 1.2;
/// Maximum distance between the scanned and the taught surface with which the scan supports the pose, mm.
const MAX_SURFACE_DISTANCE_MM: f64 = 0.35;
/// Side of the square that a point of the surface represents, mm.
const SURFACE_SQUARE_SIDE_MM: f64 = 8.0;

/// For each point of the panel at a pose, the comparison with the scan: consistent, contradicted, or unknown.
struct ConsistencyScore {
    agreements: Vec<Option<bool>>,
    lengths_mm: Vec<f64>,
}

impl ConsistencyScore {
    /// Compares the panel at this pose with the scan.
    pub fn compute(placed: &Rigid<Camera, Panel>, inputs: FitInputs<'_>) -> ConsistencyScore {
        let motion = MatrixTransform::from_rigid(placed);
        let FitInputs { model, grid, scan } = inputs;
        let outline = (0..model.outline.len()).into_par_iter().with_min_len(64).map(|k| {
            fit::observe_edge(&motion, model, &grid.camera, scan, k)?.edge.is_within_distance(MAX_EDGE_DISTANCE_PX)
        });
        let chosen = squares(model);
        let surface = chosen.par_iter().with_min_len(512).map(|&i| match observe_point(&motion, model, grid, i) {
            PointObservation::On(residual_mm) => Some(residual_mm.abs() <= MAX_SURFACE_DISTANCE_MM),
            PointObservation::Through => Some(false),
            // An object in front of the panel hides it and is no evidence against the pose; only a ray that passes
            // through the panel is.
            PointObservation::Near | PointObservation::Hidden | PointObservation::Unknown => None,
        });
        let marks = model.marks.points.par_iter().with_min_len(64).map(|mark| {
            fit::observe_mark(&motion, mark, &grid.camera, scan)?.edge.is_within_distance(MAX_EDGE_DISTANCE_PX)
        });
        let mut agreement: Vec<Option<bool>> = outline.collect();
        agreement.extend(surface.collect::<Vec<_>>());
        let mut lengths_mm: Vec<f64> = model.outline.iter().map(|sample| sample.length_mm).collect();
        lengths_mm.resize(agreement.len(), SURFACE_SQUARE_SIDE_MM);
        agreement.extend(marks.collect::<Vec<_>>());
        lengths_mm.extend(model.marks.points.iter().map(|mark| mark.length_mm));
        ConsistencyScore { agreements: agreement, lengths_mm }
    }

    /// Returns the lengths that support only this pose and only the other pose, mm.
    pub fn exclusive_support_mm(&self, other: &ConsistencyScore) -> [f64; 2] {
        let mut alone_mm = [0.0; 2];
        for ((a, b), length_mm) in self.agreements.iter().zip(&other.agreements).zip(&self.lengths_mm) {
            match (a, b) {
                // A point that is unknown at one of the two poses contains no information about their difference.
                (Some(true), Some(false)) => alone_mm[0] += length_mm,
                (Some(false), Some(true)) => alone_mm[1] += length_mm,
                _ => {}
            }
        }
        alone_mm
    }
}

fn squares(model: &Model) -> Vec<usize> {
    spread_indices(
        model.points.len(),
        ((model.area_mm2 / (SURFACE_SQUARE_SIDE_MM * SURFACE_SQUARE_SIDE_MM)) as usize).clamp(100, 4_000),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::Verdict;
    use panelprep_cell::panel::TaughtPanel;
    use panelprep_cell::recipe::Recipe;
    use panelprep_sim::{Cell, SEARCH_BOX_MM, Scene};

    fn recipe_text(cell: &Cell) -> String {
        let (region, [low, high]) = (cell.region(), SEARCH_BOX_MM);
        format!(
            "panel = \"p\"\n[region]\ncorners_px = {:?}\nrows = {}\ncolumns = {}\n\
             [locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n",
            region.corners_px.map(|px| [px.u, px.v]),
            region.rows,
            region.columns
        )
    }

    /// Returns the panel of a simulated cell, with its recipe.
    pub fn taught(cell: &Cell) -> (TaughtPanel, Recipe) {
        let text = recipe_text(cell);
        let recipe = Recipe::check("simulated.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let base_from_camera = cell.calibrated_base_from_camera();
        let panel = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), base_from_camera, &recipe);
        (panel.unwrap_or_else(|error| panic!("{error}")), recipe)
    }

    /// With point-to-point costs a smooth panel slides along itself: the pose of the thesis's method is wrong by tenths
    /// of a millimetre, which are added to its error. Its stated uncertainty is never smaller than that of the other
    /// method.
    #[test]
    fn the_distance_between_both_methods_is_added_to_the_error_of_the_thesis_method() {
        let cell = Cell::new(4, Scene::Good, 4);
        let (panel, recipe) = taught(&cell);
        let by_thesis = recipe_text(&cell).replace("[locate]\n", "[locate]\nmethod = \"thesis\"\n");
        let by_thesis = Recipe::check("simulated.toml", &by_thesis).expect("a recipe");
        let scan = cell.scan();
        let (camera, base_from_camera) = (cell.scanner(), cell.calibrated_base_from_camera());
        let view = ScanView { scan: &scan, camera, base_from_camera, range: RangeErrors::default() };
        let [ours, thesis] =
            [&recipe, &by_thesis].map(|recipe| locate(&panel, &view, recipe.locate()).expect("found"));
        let apart_mm =
            ours.base_from_panel.distance_at_mm(thesis.base_from_panel, panel.points().next().expect("a point").1);
        assert!(apart_mm > 0.05 && apart_mm < 5.0, "{apart_mm}");
        assert!(thesis.uncertainty_mm >= ours.uncertainty_mm.max(apart_mm), "{thesis:?}");
        assert!(apart_mm < 0.3 || gate::judge(&thesis, &by_thesis).verdict != Verdict::Accept, "{apart_mm}");
    }

    /// Expected values, calculated by hand: 3 mm support only the first pose, 5 mm only the second; points that are not
    /// visible at one of the poses are excluded.
    #[test]
    fn only_points_where_the_poses_differ_are_evidence() {
        let votes = |said: [Option<bool>; 4]| ConsistencyScore {
            agreements: said.to_vec(),
            lengths_mm: vec![3.0, 5.0, 7.0, 9.0],
        };
        let first = votes([Some(true), Some(false), Some(true), Some(true)]);
        let second = votes([Some(false), Some(true), None, Some(true)]);
        assert_eq!(first.exclusive_support_mm(&second), [3.0, 5.0]);
    }
}
