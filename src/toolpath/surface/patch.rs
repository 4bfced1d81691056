//! A grid as a patch of the region's single surface: a box of parameters. Neighbouring grids join as smoothly as
//! the surface itself. A separate surface for each grid, as in the thesis's Fig. 4.22, would not achieve this.

use super::derivatives::Parameter;
use panelprep_cell::panel::{GridId, Region};

/// A box of parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterPatch {
    /// Lowest u and v.
    pub low: Parameter,
    /// Highest u and v.
    pub high: Parameter,
}

impl ParameterPatch {
    /// The patch of one grid; `None` if the region has no such grid.
    pub fn for_grid(region: &Region, id: GridId) -> Option<Self> {
        let known = (1..=region.rows).contains(&id.row) && (1..=region.columns).contains(&id.column);
        known.then(|| {
            let [low, high] = region.unit_box(id);
            ParameterPatch { low: Parameter { u: low.x, v: low.y }, high: Parameter { u: high.x, v: high.y } }
        })
    }

    /// Returns the part of this patch in a grid; `None` if it has no area there, or the region has no such grid.
    pub fn part_in(&self, region: &Region, id: GridId) -> Option<Self> {
        let grid = ParameterPatch::for_grid(region, id)?;
        let low = Parameter { u: self.low.u.max(grid.low.u), v: self.low.v.max(grid.low.v) };
        let high = Parameter { u: self.high.u.min(grid.high.u), v: self.high.v.min(grid.high.v) };
        (low.u < high.u && low.v < high.v).then_some(ParameterPatch { low, high })
    }

    /// Returns whether these parameters lie in the patch or on its border.
    pub fn holds(&self, at: Parameter) -> bool {
        (self.low.u..=self.high.u).contains(&at.u) && (self.low.v..=self.high.v).contains(&at.v)
    }

    /// Returns the parameters at these fractions of the patch's sides.
    pub fn parameter_at(&self, share: Parameter) -> Parameter {
        Parameter {
            u: self.low.u + (self.high.u - self.low.u) * share.u,
            v: self.low.v + (self.high.v - self.low.v) * share.v,
        }
    }
}
