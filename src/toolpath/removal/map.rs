//! The removal by a path over the grids of a region: a depth with its uncertainty for each sample point.
//!
//! Sample points are uniformly distributed over a grid. For each segment of the path, the points on which the disc
//! presses are selected, and k(w) · p · (rubbed length) is added to their depths. The relative uncertainty of a point
//! is that of the disc at the mean of w weighted by depth, because most material was removed at this wear. If several
//! paths treat the same part, their depths are added. Their errors follow from the same coupons and are fully
//! correlated, so σ is the mean of the paths' σ, weighted by depth.

use super::model::{Model, UM_PER_MM, WornDisc};
use super::track::{DiscStretch, IsPanelAt};
use crate::surface::{BSplineSurface, Field, GridField, Parameter, ParameterPatch, SampleGrid, Treated, sides_mm};
use panelprep_base::geometry::{Panel, Point};
use panelprep_cell::panel::{GridId, Region};
use rayon::prelude::*;

/// Factor by which the search area for points below a disc is enlarged, because parameter lines are not exactly
/// straight within this area.
const SEARCH_MARGIN: f64 = 1.05;

/// The removal on one grid, for each sample point, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct GridRemoval {
    /// The grid to which the values belong.
    pub id: GridId,
    /// Whether each point is in the treated area; the disc only overlaps the other points.
    pub is_treated: Vec<bool>,
    /// Number of sample points along u.
    pub columns: usize,
    /// Expected depth at each point, µm.
    pub depth_um: Vec<f32>,
    /// σ of the logarithm of each point's depth.
    pub deviation: Vec<f32>,
    /// Surface area of each point, mm²; 0 if there is no panel material.
    pub area_mm2: Vec<f32>,
}

/// The removal on all calculated grids.
#[derive(Debug, Clone, PartialEq)]
pub struct RemovalMap {
    /// The removal on each grid.
    pub grids: Vec<GridRemoval>,
    /// Number of σ in the half-width of the 95 % interval.
    pub quantile_95: f64,
    sides_mm: [f64; 2],
}

/// Returns the map of the depth that these segments remove on the grids of the region. Grids that are not treated are
/// included if the disc reaches them.
pub fn removed(
    (surface, region, ground): (&BSplineSurface, &Region, IsPanelAt<'_>),
    treated: &Treated,
    stretches: &[DiscStretch],
    (model, force_share_95): (&Model, f64),
    spacing_mm: f64,
) -> RemovalMap {
    let ids: Vec<GridId> = region.ids().collect();
    let of_grid = |id: &GridId| {
        let samples = Samples::for_grid(surface, region, (*id, spacing_mm), ground)?;
        let is_named = treated.grids().contains(id);
        let is_treated = (0..samples.count()).map(|sample| is_named && treated.holds(samples.at(sample)));
        let grid = grid(&samples, is_treated.collect(), stretches, (model, force_share_95));
        // The disc also reaches adjacent grids, for which the limit of the depth applies as well.
        (is_named || grid.depth_um.iter().any(|depth_um| *depth_um > 0.0)).then_some(grid)
    };
    let grids = ids.par_iter().filter_map(of_grid).collect();
    RemovalMap { grids, quantile_95: model.quantile_95(), sides_mm: sides_mm(surface) }
}

fn grid(
    samples: &Samples,
    is_treated: Vec<bool>,
    stretches: &[DiscStretch],
    (model, force_share_95): (&Model, f64),
) -> GridRemoval {
    let mut depth_mm = vec![0.0; samples.count()];
    let mut swept = vec![0.0; samples.count()];
    for stretch in stretches {
        let per_pressure = model.preston_at_wear(stretch.swept_mm2) * stretch.rubbed_mm;
        samples.for_each_point_under(stretch, |sample, pressure| {
            depth_mm[sample] += per_pressure * pressure;
            // The mean wear, weighted by depth: a point that is sanded twice has a single uncertainty of k, at the wear
            // at which most material was removed.
            swept[sample] += per_pressure * pressure * stretch.swept_mm2;
        });
    }
    let deviation = |(depth_mm, swept): (&f64, &f64)| {
        let swept_mm2 = if *depth_mm > 0.0 { swept / depth_mm } else { 0.0 };
        model.deviation(WornDisc { swept_mm2, force_share_95 }) as f32
    };
    GridRemoval {
        id: samples.id,
        is_treated,
        columns: samples.columns(),
        deviation: depth_mm.iter().zip(&swept).map(deviation).collect(),
        depth_um: depth_mm.iter().map(|depth_mm| (depth_mm * UM_PER_MM) as f32).collect(),
        area_mm2: samples.area_mm2.iter().map(|area| *area as f32).collect(),
    }
}

impl RemovalMap {
    /// Creates a map of these grids alone.
    #[cfg(test)]
    pub(super) fn with(grids: Vec<GridRemoval>, quantile_95: f64) -> Self {
        RemovalMap { grids, quantile_95, sides_mm: [100.0, 100.0] }
    }

    /// Returns the sum of this map and the map of an earlier path over the same part, with the same sample points.
    /// Grids that only one of the maps contains are copied.
    #[must_use]
    pub fn plus(mut self, earlier: &RemovalMap) -> Self {
        for before in &earlier.grids {
            match self.grids.iter_mut().find(|grid| grid.id == before.id) {
                Some(grid) if grid.depth_um.len() == before.depth_um.len() => grid.add(before),
                _ => self.grids.push(before.clone()),
            }
        }
        self.grids.sort_by_key(|grid| grid.id);
        self
    }

    /// Returns the total removed volume, mm³.
    pub fn volume_mm3(&self) -> f64 {
        let places = self.grids.iter().flat_map(|grid| grid.depth_um.iter().zip(&grid.area_mm2));
        places.map(|(depth_um, area)| f64::from(*depth_um) / UM_PER_MM * f64::from(*area)).sum()
    }

    /// Returns the depth as a field for drawing, µm.
    pub fn field(&self) -> Field {
        let value = |(depth_um, area): (&f32, &f32)| (*area > 0.0).then_some(*depth_um);
        let grid = |grid: &GridRemoval| GridField {
            id: grid.id,
            columns: grid.columns,
            values: grid.depth_um.iter().zip(&grid.area_mm2).map(value).collect(),
        };
        Field { grids: self.grids.iter().map(grid).collect(), sides_mm: self.sides_mm }
    }
}

impl GridRemoval {
    fn add(&mut self, before: &GridRemoval) {
        for (index, (depth_um, deviation)) in self.depth_um.iter_mut().zip(&mut self.deviation).enumerate() {
            let sum_um = *depth_um + before.depth_um[index];
            if sum_um > 0.0 {
                // The errors are added linearly and not as a root sum of squares, because both paths have the same
                // error of k and of the force.
                *deviation = (*deviation * *depth_um + before.deviation[index] * before.depth_um[index]) / sum_um;
            }
            *depth_um = sum_um;
        }
        self.is_treated.iter_mut().zip(&before.is_treated).for_each(|(own, before)| *own |= before);
    }
}

/// The sample points of one grid.
#[derive(Debug, Clone)]
pub struct Samples {
    /// The grid of the sample points.
    pub id: GridId,
    net: SampleGrid,
    points: Vec<Point<Panel>>,
    /// Surface area of each point, mm²; 0 if there is no panel material.
    pub area_mm2: Vec<f64>,
}

impl Samples {
    /// Creates the sample points of a grid, about this distance apart, mm; `None` if the region has no such grid.
    pub fn for_grid(
        surface: &BSplineSurface,
        region: &Region,
        (id, spacing_mm): (GridId, f64),
        ground: IsPanelAt<'_>,
    ) -> Option<Self> {
        let net = SampleGrid::from_patch(surface, ParameterPatch::for_grid(region, id)?, spacing_mm);
        let place = |index: usize| {
            let at = net.parameter_at(index);
            let tangents = surface.tangents(at);
            (tangents.point, if ground(at) { tangents.area_mm2() * net.cell() } else { 0.0 })
        };
        let (points, area_mm2) = (0..net.count()).map(place).unzip();
        Some(Samples { id, net, points, area_mm2 })
    }

    /// Returns the number of sample points along u.
    pub fn columns(&self) -> usize {
        self.net.columns
    }

    /// Returns the number of sample points.
    pub fn count(&self) -> usize {
        self.points.len()
    }

    /// Returns the parameters of a sample point.
    pub fn at(&self, place: usize) -> Parameter {
        self.net.parameter_at(place)
    }

    /// Calls `add` for each point with material on which the disc presses during the segment, with the mean pressure
    /// during the segment, N/mm².
    pub fn for_each_point_under(&self, stretch: &DiscStretch, mut add: impl FnMut(usize, f64)) {
        let reach_mm = SEARCH_MARGIN * stretch.stroke.reach_mm() + 0.5 * stretch.length_mm;
        let [reach_u, reach_v] = stretch.frame.reach(reach_mm);
        let at = stretch.frame.at;
        let least = Parameter { u: at.u - reach_u, v: at.v - reach_v };
        let most = Parameter { u: at.u + reach_u, v: at.v + reach_v };
        for sample in self.net.points_around(least, most).filter(|sample| self.area_mm2[*sample] > 0.0) {
            let offset_mm = stretch.frame.offset_mm(self.points[sample]);
            let pressure = stretch.stroke.mean_pressure_n_mm2(offset_mm);
            if pressure > 0.0 {
                add(sample, pressure);
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::examples::MODEL;
    use super::super::track::tests::{DISC, level, pose};
    use super::super::track::{Disc, path_stretches};
    use super::*;
    use crate::surface::Parameter;
    use panelprep_cell::recipe::Recipe;

    /// Creates a region of one or more grids.
    pub(in crate::removal) fn region(rows: usize, columns: usize) -> Region {
        let text = format!(
            "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [60, 0], [60, 60], [0, 60]]\nrows = {rows}\ncolumns = {columns}\n\
             [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n"
        );
        let recipe = Recipe::check("test.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
        Region::new(recipe.region()).expect("convex")
    }

    fn line(swept_mm2: f64) -> RemovalMap {
        let surface = level(100.0);
        let path = [pose([-30.0, 50.0, 0.0], 0.0), pose([130.0, 50.0, 0.0], 160.0 / 60.0)];
        let all = path_stretches(&surface, &path, (&Disc { swept_mm2, ..DISC }, 20.0), &|_| true);
        let on = (&surface, &region(1, 1), &(|_| true) as IsPanelAt<'_>);
        let first = Model { decay_per_mm2: 0.0, ..MODEL };
        let model = if swept_mm2 > 0.0 { MODEL } else { first };
        removed(on, &Treated::from_grids(&[GridId { row: 1, column: 1 }]), &all, (&model, 0.0), 1.0)
    }

    /// Expected values, calculated by hand: in the middle of the lane k p v t = 4·10⁻⁴ · 0.028 294 2 · 2618.34 mm/s ·
    /// (30 mm / 60 mm/s) = 14.817 µm; 9 mm beside the middle four fifths of this depth; beside the disc 0.
    #[test]
    fn a_line_removes_its_chord() {
        let map = line(0.0);
        let grid = &map.grids[0];
        assert_eq!((grid.columns, grid.depth_um.len()), (100, 10_000));
        // Expected value, calculated by hand: k F v t over the 100 mm of the square at 60 mm/s: 4e-4 · 20 · 2618.34 ·
        // 100/60 = 34.91 mm³.
        assert!((map.volume_mm3() / 34.911 - 1.0).abs() < 0.002, "{}", map.volume_mm3());
        let at = |x: usize, y: f64| {
            // The sample points are at half millimetres.
            let row = (y - 0.5).round() as usize;
            f64::from(grid.depth_um[row * 100 + x])
        };
        let chord_um = |away: f64| 14.816_6 * (225.0 - away * away).sqrt() / 15.0;
        assert!((at(50, 50.5) / chord_um(0.5) - 1.0).abs() < 1e-4, "{}", at(50, 50.5));
        assert!((at(20, 58.5) / chord_um(8.5) - 1.0).abs() < 1e-4 && at(20, 66.5) == 0.0);
        assert!((f64::from(grid.deviation[5_050]) - (4e-4f64 + 9e-4).sqrt()).abs() < 1e-4);
    }

    /// Expected value, calculated by hand: after half a square metre the removal is multiplied by e^(−0.4), and further
    /// reduced by the wear on the path itself.
    #[test]
    fn a_worn_disc_removes_less() {
        let ratio = line(500_000.0).grids[0].depth_um[5_050] / line(0.0).grids[0].depth_um[5_050];
        assert!((f64::from(ratio) / 0.669 - 1.0).abs() < 0.002, "{ratio}");
    }

    #[test]
    fn two_paths_add_up() {
        let (one, two) = (line(0.0), line(0.0).plus(&line(0.0)));
        let (one, two) = (&one.grids[0], &two.grids[0]);
        assert!((two.depth_um[5_050] / one.depth_um[5_050] - 2.0).abs() < 1e-6);
        assert!((two.deviation[5_050] / one.deviation[5_050] - 1.0).abs() < 1e-5, "one error, not two");
    }

    #[test]
    fn where_there_is_no_panel_there_is_no_value() {
        let surface = level(100.0);
        let path = [pose([10.0, 50.0, 0.0], 0.0), pose([90.0, 50.0, 0.0], 1.0)];
        let ground: IsPanelAt<'_> = &|at: Parameter| at.v < 0.55;
        let all = path_stretches(&surface, &path, (&DISC, 20.0), ground);
        let map = removed((&surface, &region(2, 2), ground), &Treated::default(), &all, (&MODEL, 0.1), 2.0);
        assert_eq!(map.grids.len(), 4, "the disc laps over all of them");
        assert!(map.grids.iter().all(|grid| !grid.is_treated.contains(&true)));
        let last = map.field().grids.swap_remove(3);
        assert!(last.values.iter().any(Option::is_none) && last.values.iter().flatten().any(|depth| *depth > 0.0));
    }
}
