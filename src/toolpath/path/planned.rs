//! The data of a plan: waypoints, paths, and the results of these paths; and the reasons why a plan is not possible.

use super::coverage::{DiscOverhang, GridCoverage};
use super::orientation::OrientationError;
use super::raster::RasterError;
use crate::surface::dwell::Dwell;
use crate::surface::{DwellSpread, Treated};
use panelprep_base::geometry::{KukaPose, Panel, Rigid, Tool};
use panelprep_cell::panel::GridId;
use panelprep_cell::recipe;

/// A pose that the tool reaches with a linear motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// The tool's pose in the panel's frame.
    pub panel_from_tool: Rigid<Panel, Tool>,
    /// Whether the disc is in contact with the panel at this pose. A motion is in contact if both its ends are.
    pub contact: bool,
    /// Speed of the tool centre point on the motion to this pose, mm/s.
    pub feed_mm_s: f64,
    /// Rounding of the corner at this pose, mm; with 0 the arm stops.
    pub blend_mm: f64,
}

impl Waypoint {
    /// Returns whether pose, feed and rounding are finite numbers, and the feed is above 0.
    pub fn is_finite(&self) -> bool {
        let fed = self.feed_mm_s.is_finite() && self.feed_mm_s > 0.0;
        fed && self.pose().is_finite() && self.blend_mm.is_finite()
    }

    /// Returns the tool's pose in the panel's frame in KUKA's form, for commands, programs and files.
    pub fn pose(&self) -> KukaPose {
        KukaPose::from_rigid(&self.panel_from_tool)
    }

    /// Returns the tool's pose in the panel's frame as the controller reads it. It differs from
    /// [`Waypoint::panel_from_tool`] by the rounding of three angles. Both the checks and the commands to the
    /// controller use this pose.
    pub fn as_sent(&self) -> Rigid<Panel, Tool> {
        self.pose().to_rigid()
    }
}

/// The path over one or more grids; its first and last waypoints are in the air.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolPath {
    /// The grids that the path sands.
    pub grids: Vec<GridId>,
    /// The waypoints of the tool.
    pub waypoints: Vec<Waypoint>,
}

/// Minimum and maximum distance between adjacent rows, on the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepOver {
    /// Minimum distance, mm.
    pub min_mm: f64,
    /// Maximum distance, mm.
    pub max_mm: f64,
}

/// A plan: its paths, and the results that they achieve.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// One path for each area, in the order of motion.
    pub paths: Vec<ToolPath>,
    /// Length of all motions, mm.
    pub length_mm: f64,
    /// Length of the motions in contact, mm.
    pub contact_mm: f64,
    /// Time for all motions, s, including deceleration and acceleration at each stop of the path.
    pub duration_s: f64,
    /// Covered fraction of all grids together, 0…1.
    pub coverage: f64,
    /// Covered fraction of each grid.
    pub grids: Vec<GridCoverage>,
    /// Dwell time over the whole treated area; `None` if no area is treated.
    pub dwell: Option<DwellSpread>,
    /// Dwell time in each grid.
    pub grid_dwell: Vec<(GridId, DwellSpread)>,
    /// Distance between adjacent rows, without the connections between them; `None` if no path has two rows.
    pub step_over_mm: Option<StepOver>,
    /// Overhang of the disc beyond the panel's outline.
    pub overhang: DiscOverhang,
    /// The areas that the plan treats.
    pub treated: Treated,
    /// Fraction of the break points that the disc reaches, 0…1; `None` if no break point is known, or if the recipe
    /// requires that whole grids are treated.
    pub breaks_reached: Option<f64>,
    /// The costs of areas around breaks and of whole grids; `None` if the two were not compared.
    pub costs: Option<TreatmentCosts>,
}

impl Plan {
    /// Returns the largest ratio of the longest to the shortest dwell time, and the grid to which it belongs. The ratio
    /// of all grids together is compared with the ratios of single grids; if the former is the largest, the grid is
    /// `None`. Returns `None` if no area is treated.
    pub fn dwell_ratio(&self) -> Option<(f64, Option<GridId>)> {
        let all = self.dwell.map(|dwell| (dwell.ratio(), None));
        let grids = self.grid_dwell.iter().map(|(id, dwell)| (dwell.ratio(), Some(*id)));
        all.into_iter().chain(grids).max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Returns the treated area on the surface, mm².
    pub fn treated_mm2(&self) -> f64 {
        // The sum starts at 0 explicitly, because an empty sum of floats is −0.
        self.grids.iter().fold(0.0, |sum, grid| sum + grid.area_mm2)
    }

    /// Returns the plan with other feeds, mm/s: one for each waypoint, in the order of the plan.
    #[must_use]
    pub fn with_feeds(mut self, feeds_mm_s: &[f64], settings: &recipe::Path) -> Self {
        let all = self.paths.iter_mut().flat_map(|path| &mut path.waypoints);
        all.zip(feeds_mm_s).for_each(|(waypoint, feed_mm_s)| waypoint.feed_mm_s = *feed_mm_s);
        self.duration_s = extent(&self.paths, settings).duration_s;
        self
    }

    /// Returns the plan with these dwell times, which were calculated for its feeds.
    #[must_use]
    pub fn with_dwell(mut self, dwell: &Dwell) -> Self {
        self.dwell = dwell.spread();
        self.grid_dwell = dwell.grids.iter().filter_map(|grid| Some((grid.id, grid.spread()?))).collect();
        self
    }

    /// Returns whether every pose, feed, rounding, length and time is a finite number, and every feed is above 0.
    pub fn is_finite(&self) -> bool {
        let moves = self.paths.iter().flat_map(|path| &path.waypoints).all(Waypoint::is_finite);
        let dwell = self.dwell_ratio().is_none_or(|(ratio, _)| ratio.is_finite());
        let sums = [self.length_mm, self.contact_mm, self.duration_s, self.coverage];
        // Without an outline, the overhang is infinite, which is a valid value.
        moves && dwell && sums.iter().all(|sum| sum.is_finite()) && !self.overhang.largest_mm.is_nan()
    }
}

/// The cost of a plan: the sanded area and the duration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TreatmentCost {
    /// Area of the region's surface that the disc covers, mm².
    pub under_disc_mm2: f64,
    /// Time for all motions, s.
    pub duration_s: f64,
}

/// The costs of the two ways to treat the same breaks; each is `None` if it has no path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TreatmentCosts {
    /// The cost of treating areas around the breaks.
    pub around_breaks: Option<TreatmentCost>,
    /// The cost of treating the failed grids completely.
    pub whole_grids: Option<TreatmentCost>,
}

impl TreatmentCosts {
    /// Returns whether areas around the breaks sand less surface in less time than whole grids. Also true if a path
    /// exists only for the areas around the breaks.
    pub fn is_less_around_breaks(&self) -> bool {
        match (self.around_breaks, self.whole_grids) {
            (Some(around), Some(whole)) => {
                around.under_disc_mm2 < whole.under_disc_mm2 && around.duration_s < whole.duration_s
            }
            (around, _) => around.is_some(),
        }
    }
}

/// Length, mm, and duration, s, of paths.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct PathExtent {
    pub length_mm: f64,
    pub contact_mm: f64,
    pub duration_s: f64,
}

/// Calculates the length and duration of paths.
pub(super) fn extent(paths: &[ToolPath], settings: &recipe::Path) -> PathExtent {
    let all: Vec<&Waypoint> = paths.iter().flat_map(|path| &path.waypoints).collect();
    let mut sum = PathExtent::default();
    for pair in all.windows(2) {
        let step_mm = pair[0].panel_from_tool.origin().distance_mm(pair[1].panel_from_tool.origin());
        sum.length_mm += step_mm;
        sum.contact_mm += if pair[0].contact && pair[1].contact { step_mm } else { 0.0 };
        sum.duration_s += step_mm / pair[1].feed_mm_s;
        // Each stop takes additional time: half of feed / acceleration for the deceleration, and the same for the
        // acceleration.
        let stops = [pair[0], pair[1]].iter().filter(|waypoint| waypoint.blend_mm == 0.0).count();
        sum.duration_s += stops as f64 * pair[1].feed_mm_s / settings.acceleration_mm_s2() / 2.0;
    }
    sum
}

/// The reasons why a plan is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The list of requested grids is empty.
    #[error("no grid was requested; name at least one grid")]
    NoGrids,
    /// The region does not have the requested grid.
    #[error("the region has no grid {grid}; its grids are r1c1 to r{rows}c{columns}")]
    UnknownGrid {
        /// The grid that was requested.
        grid: GridId,
        /// Number of rows of the region.
        rows: usize,
        /// Number of columns of the region.
        columns: usize,
    },
    /// A grid was requested twice and would be sanded twice.
    #[error("grid {grid} was requested twice; name each grid once")]
    Repeated {
        /// The grid that was requested twice.
        grid: GridId,
    },
    /// No rows can be laid over the grid.
    #[error("grid {grid}: {cause}")]
    Raster {
        /// The grid over which no rows can be laid.
        grid: GridId,
        /// The reason of the raster.
        cause: RasterError,
    },
    /// The tool has no pose at a point of the grid.
    #[error("grid {grid}: {cause}")]
    Orientation {
        /// The grid on which the tool has no pose.
        grid: GridId,
        /// The reason of the orientation.
        cause: OrientationError,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smaller area in more time, and a larger area in less time, are not lower costs.
    #[test]
    fn areas_around_breaks_must_cost_less_area_and_time() {
        let cost = |under_disc_mm2: f64, duration_s: f64| Some(TreatmentCost { under_disc_mm2, duration_s });
        let is_less =
            |around_breaks, whole_grids| TreatmentCosts { around_breaks, whole_grids }.is_less_around_breaks();
        let whole = cost(100.0, 10.0);
        assert!(is_less(cost(99.0, 9.0), whole) && is_less(cost(99.0, 9.0), None));
        let no_saving = [cost(99.0, 11.0), cost(101.0, 9.0), whole, None];
        assert!(no_saving.into_iter().all(|around| !is_less(around, whole)));
    }
}
