//! Computes the figures of a removal map that are compared with limits.

use super::map::{GridRemoval, RemovalMap};
use crate::surface::AreaWeighted;

/// Fractions of the treated area for which the depth quantiles are returned.
const QUANTILE_FRACTIONS: [f64; 2] = [0.05, 0.95];

/// The figures of a removal map. They apply to the treated points, except for the largest depths, which may also lie
/// beside the treated area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapFigures {
    /// Mean expected depth, µm.
    pub mean_um: f64,
    /// The 5 % quantile of the depth over the treated area, µm.
    pub low_um: f64,
    /// The 95 % quantile of the depth over the treated area, µm.
    pub high_um: f64,
    /// The largest expected depth at any point, µm.
    pub largest_um: f64,
    /// The largest upper bound of a depth at any point, 95 %, µm.
    pub largest_bound_um: f64,
    /// Deviation from the target within which 95 % of the treated area lies, percent of the target.
    pub within_percent: f64,
    /// Half-width of the 95 % confidence interval of the mean, percent.
    pub uncertainty_percent: f64,
}

impl MapFigures {
    /// Computes the figures of a map relative to a target depth, µm; `None` if the treated area is empty.
    pub fn compute(map: &RemovalMap, target_um: f64) -> Option<Self> {
        let treated = || map.grids.iter().flat_map(treated_places);
        let area: f64 = treated().map(|(_, _, area)| area).sum();
        if area <= 0.0 {
            return None;
        }
        let mean = |value: &dyn Fn(f64, f64) -> f64| {
            treated().map(|(depth_um, deviation, area)| area * value(depth_um, deviation)).sum::<f64>() / area
        };
        let by_area = |value: &dyn Fn(f64) -> f64| {
            AreaWeighted::from_values(treated().map(|(depth_um, _, area)| (value(depth_um), area)))
        };
        let largest = |value: &dyn Fn(f64, f64) -> f64| {
            let all = map.grids.iter().flat_map(depth_places);
            all.fold(0.0, |largest, (depth_um, deviation, _)| f64::max(largest, value(depth_um, deviation)))
        };
        let upper = |deviation: f64| (map.quantile_95 * deviation).exp();
        let depths = by_area(&|depth_um| depth_um);
        let off = by_area(&|depth_um| (depth_um / target_um - 1.0).abs());
        let [low_um, high_um] = QUANTILE_FRACTIONS.map(|share| depths.quantile_by_area(share));
        Some(MapFigures {
            mean_um: mean(&|depth_um, _| depth_um),
            low_um: low_um?,
            high_um: high_um?,
            largest_um: largest(&|depth_um, _| depth_um),
            largest_bound_um: largest(&|depth_um, deviation| depth_um * upper(deviation)),
            within_percent: 100.0 * off.quantile_by_area(QUANTILE_FRACTIONS[1])?,
            uncertainty_percent: 100.0 * mean(&|_, deviation| upper(deviation) - 1.0),
        })
    }

    /// Returns the fraction of the treated area, 0…1, whose depth differs from the target by at most this percentage.
    pub fn share_within(map: &RemovalMap, target_um: f64, percent: f64) -> f64 {
        let treated = map.grids.iter().flat_map(treated_places);
        let (held, all) = treated.fold((0.0, 0.0), |(held, all), (depth_um, _, area)| {
            let is_held = 100.0 * (depth_um / target_um - 1.0).abs() <= percent;
            (held + if is_held { area } else { 0.0 }, all + area)
        });
        held / all
    }
}

/// Returns depth, µm, σ and area, mm², of each sample point with panel material.
fn depth_places(grid: &GridRemoval) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
    (0..grid.depth_um.len()).filter_map(|sample| place(grid, sample))
}

/// Returns depth, µm, σ and area, mm², of each sample point in the treated area.
fn treated_places(grid: &GridRemoval) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
    (0..grid.depth_um.len()).filter(|sample| grid.is_treated[*sample]).filter_map(|sample| place(grid, sample))
}

fn place(grid: &GridRemoval, sample: usize) -> Option<(f64, f64, f64)> {
    let [depth_um, deviation, area_mm2] =
        [&grid.depth_um, &grid.deviation, &grid.area_mm2].map(|of| f64::from(of[sample]));
    (area_mm2 > 0.0).then_some((depth_um, deviation, area_mm2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::panel::GridId;

    fn grid(column: usize, is_treated: bool, depth_um: Vec<f32>) -> GridRemoval {
        let count = depth_um.len();
        let id = GridId { row: 1, column };
        GridRemoval {
            id,
            is_treated: vec![is_treated; count],
            columns: 10,
            depth_um,
            deviation: vec![0.05; count],
            area_mm2: vec![1.0; count],
        }
    }

    fn map(grids: Vec<GridRemoval>) -> RemovalMap {
        RemovalMap::with(grids, 2.0)
    }

    /// Expected values, calculated by hand for 100 points of 1 to 100 µm, and a point of 120 µm beside them. 95 % of
    /// the points differ from a target of 50 µm by at most 47 µm, which is 94 %. The range of ±10 % contains 45 to 55
    /// µm, eleven points. e^(2 · 0.05) = 1.105 17.
    #[test]
    fn figures_of_a_map_agree_with_hand_calculation() {
        let both = map(vec![grid(1, true, (1..=100u8).map(f32::from).collect()), grid(2, false, vec![120.0])]);
        let found = MapFigures::compute(&both, 50.0).expect("treated");
        assert_eq!((found.mean_um, found.low_um, found.high_um, found.largest_um), (50.5, 5.0, 95.0, 120.0));
        assert!((found.largest_bound_um - 132.620_5).abs() < 1e-3, "{}", found.largest_bound_um);
        // |d − 50| ≤ 45 contains the depths 5 to 95, which are 91 points; ≤ 47 contains 3 to 97, which are 95 points.
        assert!((found.within_percent - 94.0).abs() < 1e-4, "{}", found.within_percent);
        assert!((found.uncertainty_percent - 10.517).abs() < 1e-3);
        assert!((MapFigures::share_within(&both, 50.0, 10.001) - 0.11).abs() < 1e-9);
        assert_eq!(MapFigures::compute(&map(vec![grid(2, false, vec![120.0])]), 50.0), None);
        // If only the first fifty points of the grid are treated, their mean is 25.5 µm; the largest depth is still
        // that of the deepest point beside them.
        let mut part = both;
        part.grids[0].is_treated[50..].fill(false);
        let found = MapFigures::compute(&part, 50.0).expect("treated");
        assert_eq!((found.mean_um, found.high_um, found.largest_um), (25.5, 48.0, 120.0));
    }
}
