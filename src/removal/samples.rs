//! Places spread evenly over a grid, and which of them a stretch of path presses on.

use super::track::{Ground, Stretch};
use crate::geometry::{Panel, Point};
use crate::panel::{GridId, Region};
use crate::surface::{BSplineSurface, Parameter, Patch};

/// Parameters are not quite straight below a disc: it is looked this much farther.
const FARTHER: f64 = 1.05;

/// The places of one grid.
#[derive(Debug, Clone)]
pub struct Samples {
    /// The grid.
    pub id: GridId,
    patch: Patch,
    /// Places along u.
    pub columns: usize,
    rows: usize,
    points: Vec<Point<Panel>>,
    /// Surface of each, mm²; 0 where there is no panel.
    pub area_mm2: Vec<f64>,
}

impl Samples {
    /// Places about so far apart, mm; `None` where the region has no such grid.
    pub fn of(
        surface: &BSplineSurface,
        region: &Region,
        (id, spacing_mm): (GridId, f64),
        ground: Ground<'_>,
    ) -> Option<Self> {
        let patch = Patch::of_grid(region, id)?;
        let middle = surface.tangents(patch.at(Parameter { u: 0.5, v: 0.5 }));
        let (size_u, size_v) = (patch.high.u - patch.low.u, patch.high.v - patch.low.v);
        let count = |length_mm: f64| (length_mm / spacing_mm).ceil().max(1.0) as usize;
        let (columns, rows) = (count(middle.s_u.mm.norm() * size_u), count(middle.s_v.mm.norm() * size_v));
        let share = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
        let cell = size_u * size_v / (columns * rows) as f64;
        let place = |index: usize| {
            let at = patch.at(Parameter { u: share(index % columns, columns), v: share(index / columns, rows) });
            let tangents = surface.tangents(at);
            (tangents.point, if ground(at) { tangents.area_mm2() * cell } else { 0.0 })
        };
        let (points, area_mm2) = (0..columns * rows).map(place).unzip();
        Some(Samples { id, patch, columns, rows, points, area_mm2 })
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.points.len()
    }

    /// Tells each place with panel that a stretch presses on, with the mean pressure meanwhile, N/mm².
    pub fn under(&self, stretch: &Stretch, mut tell: impl FnMut(usize, f64)) {
        let reach_mm = FARTHER * stretch.stroke.reach_mm() + 0.5 * stretch.length_mm;
        let [reach_u, reach_v] = stretch.place.reach(reach_mm);
        let (at, low, high) = (stretch.place.at, self.patch.low, self.patch.high);
        let range = |at: f64, reach: f64, [low, high]: [f64; 2], count: usize| {
            let index = |at: f64| ((at - low) / (high - low) * count as f64).clamp(0.0, count as f64) as usize;
            if at + reach < low || at - reach > high {
                0..0
            } else {
                index(at - reach)..(index(at + reach) + 1).min(count)
            }
        };
        let across = range(at.u, reach_u, [low.u, high.u], self.columns);
        for row in range(at.v, reach_v, [low.v, high.v], self.rows) {
            for column in across.clone() {
                let sample = row * self.columns + column;
                if self.area_mm2[sample] > 0.0 {
                    let offset_mm = stretch.place.offset_mm(self.points[sample]);
                    let pressure = stretch.stroke.mean_pressure_n_mm2(offset_mm);
                    if pressure > 0.0 {
                        tell(sample, pressure);
                    }
                }
            }
        }
    }
}
