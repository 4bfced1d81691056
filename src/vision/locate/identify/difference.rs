//! The places at which two taught panels differ, and what the scan shows there.
//!
//! Both panels are placed at their own poses in one scan, so that their outlines are curves in one picture. A place of
//! one outline distinguishes the panels if the other outline is farther away than twice the distance within which an
//! edge confirms an outline: the scan's edge can then be at one of the two only. A place of one surface distinguishes
//! them if the other panel has no material there. Such a place supports the first panel, or the second one, or it is
//! not seen. The evidence is a length, as for two poses of one panel.

use super::super::evidence::{CHANCE_MATCH_MM, MAX_FOUND_EDGE_DISTANCE_PX};
use super::super::fit::{FitInputs, observe_edge};
use super::super::grid::{DepthReading, Grid, MatrixTransform, camera_point};
use super::super::model::Model;
use super::super::search::{PointObservation, observe_point};
use super::super::{SURFACE_SQUARE_SIDE_MM, TaughtModel, squares};
use nalgebra::Vector3;
use panelprep_base::geometry::statistics::interpolated_median;
use panelprep_base::geometry::{Camera, Panel, Pixel, Rigid, polygon};
use rayon::prelude::*;

/// Largest distance of an edge from an outline that it confirms, px: two standard deviations of an edge by depth.
const MAX_CONFIRMING_DISTANCE_PX: f64 = 1.0;
/// Smallest distance between two outlines that an edge distinguishes, px: it confirms one of them at most.
const MIN_APART_PX: f64 = 2.0 * MAX_CONFIRMING_DISTANCE_PX;
/// Two neighbouring points of the outline have a gap between them, in which the outline was not seen at teaching, if
/// their distance is larger than the usual one by this factor.
const GAP_RATIO: f64 = 3.0;
/// Smallest depth of a window's background behind the panel, mm.
const MIN_WINDOW_DEPTH_MM: f64 = 3.0;
/// Smallest ratio of the evidence for one panel to the evidence for the other.
pub const MIN_RATIO: f64 = 2.0;
/// Smallest share of the distinguishing places that must be seen, 0…1.
pub const MIN_SEEN_SHARE: f64 = 0.5;

/// The evidence that distinguishes two panels: lengths of outline, and of surface counted as a length, mm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Difference {
    /// Supports only the first panel.
    pub for_first_mm: f64,
    /// Supports only the second panel.
    pub for_second_mm: f64,
    /// Would distinguish the panels, but is not seen.
    pub unseen_mm: f64,
}

impl Difference {
    /// Returns the ratio of the evidence for the first panel to the evidence for the second one.
    pub fn evidence_ratio(&self) -> f64 {
        (self.for_first_mm + CHANCE_MATCH_MM) / (self.for_second_mm + CHANCE_MATCH_MM)
    }

    /// Returns the share of the distinguishing places that is seen, 0…1; 0 if there are none.
    pub fn seen_share(&self) -> f64 {
        let seen_mm = self.for_first_mm + self.for_second_mm;
        seen_mm / (seen_mm + self.unseen_mm).max(f64::MIN_POSITIVE)
    }

    /// Returns whether the scan shows the first panel and not the second one.
    pub fn shows_first(&self) -> bool {
        self.evidence_ratio() >= MIN_RATIO && self.seen_share() >= MIN_SEEN_SHARE
    }
}

/// A place of a panel in the scan.
struct Place {
    pixel: Pixel,
    point: Vector3<f64>,
    /// Whether the scan shows the panel here; `None` if nothing is seen.
    is_confirmed: Option<bool>,
    /// For a place of the outline, whether the localization counts it as found.
    is_found: Option<bool>,
    length_mm: f64,
}

/// The outline that the scan contradicts, mm.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Contradiction {
    /// The length of outline in view.
    pub in_view_mm: f64,
    /// The contradicted part of it.
    pub whole_mm: f64,
    /// The longest contradicted stretch, without a found place in it.
    pub longest_mm: f64,
}

/// A taught panel at its pose in a scan.
pub(super) struct PlacedPanel<'a> {
    model: Model,
    motion: MatrixTransform,
    /// The other surfaces in the taught scan: the background of windows.
    fixture: &'a Grid,
    outline: Vec<Place>,
    /// Whether the outline was not seen at teaching between a place and the next one.
    has_gap: Vec<bool>,
    surface: Vec<Place>,
}

impl<'a> PlacedPanel<'a> {
    /// Compares a panel with the scan at its pose; the model in the inputs is the panel as it is bent there.
    pub fn new(taught: &'a TaughtModel, placed: &Rigid<Camera, Panel>, inputs: FitInputs<'_>) -> Self {
        let (motion, model) = (MatrixTransform::from_rigid(placed), inputs.model);
        let outline = (0..model.outline.len()).into_par_iter().with_min_len(64);
        let outline: Vec<Place> = outline.filter_map(|k| outline_place(&motion, inputs, k)).collect();
        let surface = squares(model).into_par_iter().with_min_len(256);
        let surface = surface.filter_map(|sample| surface_place(&motion, inputs, sample)).collect();
        let step_mm = |k: usize| (outline[(k + 1) % outline.len()].point - outline[k].point).norm();
        let steps_mm: Vec<f64> = (0..outline.len()).map(step_mm).collect();
        let usual_mm = interpolated_median(&mut steps_mm.clone()).unwrap_or(f64::INFINITY);
        let has_gap = steps_mm.iter().map(|mm| *mm > GAP_RATIO * usual_mm).collect();
        PlacedPanel { model: model.clone(), motion, fixture: &taught.fixture, outline, has_gap, surface }
    }

    /// Returns how much of the outline the scan contradicts.
    pub fn contradiction(&self) -> Contradiction {
        let start = self.outline.iter().position(|place| place.is_found == Some(true)).unwrap_or(0);
        let (mut contradiction, mut here_mm) = (Contradiction::default(), 0.0);
        for place in self.outline.iter().cycle().skip(start).take(self.outline.len()) {
            let Some(is_found) = place.is_found else { continue };
            contradiction.in_view_mm += place.length_mm;
            if is_found {
                here_mm = 0.0;
                continue;
            }
            here_mm += place.length_mm;
            contradiction.whole_mm += place.length_mm;
            contradiction.longest_mm = contradiction.longest_mm.max(here_mm);
        }
        contradiction
    }

    /// Returns whether another panel's edge at this pixel cannot be this panel's edge; a stretch of the outline that is
    /// unknown does not distinguish.
    fn has_edge_elsewhere(&self, pixel: Pixel) -> bool {
        let count = self.outline.len();
        let side = |k: usize| {
            let ends = [self.outline[k].pixel, self.outline[(k + 1) % count].pixel];
            (polygon::distance_to_side_px(&ends, pixel), self.has_gap[k])
        };
        let nearest = (0..count).map(side).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.is_some_and(|(distance_px, is_gap)| !is_gap && distance_px > MIN_APART_PX)
    }

    /// Returns whether this panel has no material at a place of another panel's surface.
    fn is_absent_at(&self, place: &Place, outline_px: &[Pixel]) -> bool {
        if polygon::contains(outline_px, place.pixel) {
            return self.has_window_at(&place.point);
        }
        self.has_edge_elsewhere(place.pixel)
    }

    /// Returns whether the taught scan shows a window here and beside: the background, and no panel. Points that are
    /// only missing are no window.
    fn has_window_at(&self, point: &Vector3<f64>) -> bool {
        let taught = MatrixTransform::from_rigid(&self.model.camera_from_panel);
        let there = taught.point(&self.motion.inverse().point(point));
        let Some(pixel) = self.model.grid.camera.project(camera_point(&there)) else { return false };
        let beside = [[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]];
        beside.iter().all(|[u, v]| {
            let pixel = Pixel::at(pixel.u + u * MIN_APART_PX, pixel.v + v * MIN_APART_PX);
            let is_open = self.model.grid.reading_at_pixel(pixel) == DepthReading::Nothing;
            let behind_mm = match self.fixture.reading_at_pixel(pixel) {
                DepthReading::Smooth(depth_mm) | DepthReading::Rough(depth_mm) => depth_mm - there.z,
                DepthReading::Nothing | DepthReading::OutOfView => 0.0,
            };
            is_open && behind_mm > MIN_WINDOW_DEPTH_MM
        })
    }

    /// Returns the lengths of this panel that the other one does not have, mm: confirmed, contradicted and not seen.
    fn own_lengths_mm(&self, other: &PlacedPanel<'_>) -> [f64; 3] {
        let other_px: Vec<Pixel> = other.outline.iter().map(|place| place.pixel).collect();
        let of_outline = self.outline.par_iter().filter(|place| other.has_edge_elsewhere(place.pixel));
        let of_surface = self.surface.par_iter().filter(|place| other.is_absent_at(place, &other_px));
        let places: Vec<&Place> = of_outline.chain(of_surface).collect();
        [Some(true), Some(false), None].map(|observed| {
            let seen = places.iter().filter(|place| place.is_confirmed == observed);
            seen.map(|place| place.length_mm).sum()
        })
    }

    /// Compares this panel with another one at the places at which they differ.
    pub fn difference_from(&self, other: &PlacedPanel<'_>) -> Difference {
        let [own, others] = [self.own_lengths_mm(other), other.own_lengths_mm(self)];
        Difference {
            for_first_mm: own[0] + others[1],
            for_second_mm: own[1] + others[0],
            unseen_mm: own[2] + others[2],
        }
    }

    /// Returns the places of both outlines that distinguish the panels.
    #[cfg(test)]
    pub fn pixels_apart_from(&self, other: &PlacedPanel<'_>) -> Vec<Pixel> {
        let of = |a: &PlacedPanel<'_>, b: &PlacedPanel<'_>| -> Vec<Pixel> {
            a.outline.iter().map(|place| place.pixel).filter(|pixel| b.has_edge_elsewhere(*pixel)).collect()
        };
        [of(self, other), of(other, self)].concat()
    }
}

fn outline_place(motion: &MatrixTransform, inputs: FitInputs<'_>, k: usize) -> Option<Place> {
    let FitInputs { model, grid, scan } = inputs;
    let seen = observe_edge(motion, model, &grid.camera, scan, k)?;
    let pixel = grid.camera.project(camera_point(&seen.point))?;
    Some(Place {
        pixel,
        point: seen.point,
        is_confirmed: seen.edge.is_within_distance(MAX_CONFIRMING_DISTANCE_PX),
        is_found: seen.edge.is_within_distance(MAX_FOUND_EDGE_DISTANCE_PX),
        length_mm: model.outline[k].length_mm,
    })
}

fn surface_place(motion: &MatrixTransform, inputs: FitInputs<'_>, sample: usize) -> Option<Place> {
    let FitInputs { model, grid, .. } = inputs;
    let point = motion.point(&model.points[sample]);
    let pixel = grid.camera.project(camera_point(&point))?;
    let is_confirmed = match observe_point(motion, model, grid, sample) {
        PointObservation::On(_) => Some(true),
        PointObservation::Through => Some(false),
        PointObservation::Hidden | PointObservation::Unknown => None,
        // Beside an edge the depth of a block does not show where the material ends: the outline does.
        PointObservation::Near => return None,
    };
    Some(Place { pixel, point, is_confirmed, is_found: None, length_mm: SURFACE_SQUARE_SIDE_MM })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 16 mm for the first panel alone are (16 + 8) / 8 = 3 times the evidence for the second one; with 12 mm
    /// for the second one the ratio is 24 / 20 = 1.2. Of 40 mm, 16 mm are 40 %.
    #[test]
    fn a_place_that_is_not_seen_is_no_evidence() {
        let shown = Difference { for_first_mm: 16.0, for_second_mm: 0.0, unseen_mm: 0.0 };
        assert!((shown.evidence_ratio() - 3.0).abs() < 1e-12 && shown.shows_first());
        let contested = Difference { for_second_mm: 12.0, ..shown };
        assert!((contested.evidence_ratio() - 1.2).abs() < 1e-12 && !contested.shows_first());
        let hidden = Difference { unseen_mm: 24.0, ..shown };
        assert!((hidden.seen_share() - 0.4).abs() < 1e-12 && !hidden.shows_first());
        assert!(!Difference::default().shows_first(), "equal panels");
    }
}
