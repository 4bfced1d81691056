//! The places where the film breaks first: statistics of every grid of a panel over many parts of the same kind, from
//! the first valid film of each cycle.

use super::grid::grid_row_and_column;
use super::past_cycle::PastCycle;
use panelprep_base::geometry::median_in_place;
use serde::Serialize;
use std::collections::BTreeMap;

/// Every grid of a panel, with statistics over its cycles.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct HeatMap {
    /// Cycles with a valid film.
    pub films: usize,
    /// The grids, row by row.
    pub grids: Vec<HeatCell>,
}

/// A grid's statistics over all cycles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeatCell {
    /// The grid.
    pub grid: String,
    /// The grid's row, from 1.
    pub row: u32,
    /// The grid's column, from 1.
    pub column: u32,
    /// Number of first films that report the grid.
    pub films: usize,
    /// Number of parts on which the film broke on the grid.
    pub breaks: usize,
    /// The median of the times to the break, s; `None` if the film never broke there.
    pub median_s: Option<f64>,
}

/// Counts the breaks of each grid. Cycles that ran in the air have no film. Only cycles with the taught panel of the
/// newest cycle count: in another one a grid of the same name may be another place.
pub fn heat_map(cycles: &[PastCycle]) -> HeatMap {
    let newest = cycles.iter().max_by_key(|past| past.record.id).map(|past| &past.record.taught_version);
    let cycles = cycles.iter().filter(|past| Some(&past.record.taught_version) == newest);
    let mut films = 0;
    let mut all: BTreeMap<(u32, u32), (String, usize, usize, Vec<f64>)> = BTreeMap::new();
    for past in cycles.filter(|past| past.films().next().is_some()) {
        films += 1;
        for (grid, result) in past.grids() {
            let (Some(at), Some(failed)) = (grid_row_and_column(&grid), result.failed_first) else { continue };
            let (_, seen, breaks, times_s) = all.entry(at).or_insert((grid, 0, 0, Vec::new()));
            *seen += 1;
            *breaks += usize::from(failed);
            times_s.extend(result.time_to_break_s.filter(|_| failed));
        }
    }
    let cell =
        |((row, column), (grid, films, breaks, mut times_s)): ((u32, u32), (String, usize, usize, Vec<f64>))| {
            HeatCell { grid, row, column, films, breaks, median_s: median_in_place(&mut times_s) }
        };
    HeatMap { films, grids: all.into_iter().map(cell).collect() }
}
