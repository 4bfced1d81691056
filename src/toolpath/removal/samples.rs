//! Places spread evenly over a grid, and the selection of those on which a segment of path presses.

use super::track::{DiscStretch, IsPanelAt};
use crate::surface::{BSplineSurface, Parameter, ParameterPatch, SampleGrid};
use panelprep_base::geometry::{Panel, Point};
use panelprep_cell::panel::{GridId, Region};

/// Parameter lines are not quite straight below a disc, so the search extends farther by this factor.
const SEARCH_MARGIN: f64 = 1.05;

/// The places of one grid.
#[derive(Debug, Clone)]
pub struct Samples {
    /// The grid.
    pub id: GridId,
    net: SampleGrid,
    points: Vec<Point<Panel>>,
    /// Surface of each, mm²; 0 if there is no panel.
    pub area_mm2: Vec<f64>,
}

impl Samples {
    /// Returns places about this distance apart, mm; `None` if the region has no such grid.
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

    /// Places along u.
    pub fn columns(&self) -> usize {
        self.net.columns
    }

    /// Returns the number of samples.
    pub fn count(&self) -> usize {
        self.points.len()
    }

    /// The parameters of a place.
    pub fn at(&self, place: usize) -> Parameter {
        self.net.parameter_at(place)
    }

    /// Calls `tell` for each place with panel on which a stretch presses, with the mean pressure during the stretch,
    /// N/mm².
    pub fn for_places_under(&self, stretch: &DiscStretch, mut tell: impl FnMut(usize, f64)) {
        let reach_mm = SEARCH_MARGIN * stretch.stroke.reach_mm() + 0.5 * stretch.length_mm;
        let [reach_u, reach_v] = stretch.frame.reach(reach_mm);
        let at = stretch.frame.at;
        let least = Parameter { u: at.u - reach_u, v: at.v - reach_v };
        let most = Parameter { u: at.u + reach_u, v: at.v + reach_v };
        for sample in self.net.points_around(least, most).filter(|sample| self.area_mm2[*sample] > 0.0) {
            let offset_mm = stretch.frame.offset_mm(self.points[sample]);
            let pressure = stretch.stroke.mean_pressure_n_mm2(offset_mm);
            if pressure > 0.0 {
                tell(sample, pressure);
            }
        }
    }
}
