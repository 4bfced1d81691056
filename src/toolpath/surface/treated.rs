//! The places that a path treats: whole grids, or boxes of the surface around broken places.

use super::derivatives::Parameter;
use super::patch::ParameterPatch;
use panelprep_cell::panel::{GridId, Region};

/// The places that a path treats, with the grids in which they lie: a grid is the address under which the record
/// names a place and counts its abrasions.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Treated {
    grids: Vec<GridId>,
    areas: Option<Vec<ParameterPatch>>,
    broken: Option<Vec<Parameter>>,
    uncertainty_mm: f64,
}

impl Treated {
    /// Treats whole grids.
    pub fn from_grids(grids: &[GridId]) -> Self {
        Treated { grids: grids.to_vec(), ..Treated::default() }
    }

    /// Returns whole grids in place of these areas. The broken places in these grids remain known.
    #[must_use]
    pub fn as_whole_grids(&self, region: &Region, grids: &[GridId]) -> Self {
        let patches: Vec<ParameterPatch> =
            grids.iter().filter_map(|id| ParameterPatch::for_grid(region, *id)).collect();
        let in_grids = |at: &&Parameter| patches.iter().any(|patch| patch.holds(**at));
        let broken = self.broken.as_ref().map(|broken| broken.iter().filter(in_grids).copied().collect());
        Treated { broken, uncertainty_mm: self.uncertainty_mm, ..Treated::from_grids(grids) }
    }

    /// Treats these areas, and names the broken places that lie in them. The grids are those into which an area
    /// extends, row by row.
    pub fn from_areas(region: &Region, areas: Vec<ParameterPatch>, broken: Vec<Parameter>) -> Self {
        let extends_into = |id: &GridId| areas.iter().any(|area| area.part_in(region, *id).is_some());
        let grids = region.ids().filter(extends_into).collect();
        Treated { grids, areas: Some(areas), broken: Some(broken), uncertainty_mm: 0.0 }
    }

    /// With this uncertainty of the broken places on the panel, mm.
    #[must_use]
    pub fn with_uncertainty_mm(self, uncertainty_mm: f64) -> Self {
        Treated { uncertainty_mm, ..self }
    }

    /// The uncertainty of the broken places on the panel, mm.
    pub fn uncertainty_mm(&self) -> f64 {
        self.uncertainty_mm
    }

    /// The grids in which the places lie.
    pub fn grids(&self) -> &[GridId] {
        &self.grids
    }

    /// The areas that are treated; `None` if whole grids are treated.
    pub fn areas(&self) -> Option<&[ParameterPatch]> {
        self.areas.as_deref()
    }

    /// The broken places that are to be reached; `None` if the recipe asks for whole grids.
    pub fn broken(&self) -> Option<&[Parameter]> {
        self.broken.as_deref()
    }

    /// Returns whether a place of one of the grids is treated.
    pub fn holds(&self, at: Parameter) -> bool {
        self.areas().is_none_or(|areas| areas.iter().any(|area| area.holds(at)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::recipe::Recipe;

    /// By hand: 2 × 5 grids are 0.2 wide and 0.5 high. An area from 0.15 to 0.25 along u and 0.1 to 0.5 along v
    /// extends into r1c1 and r1c2; it ends at the border of the second row. 0.3 is beside it.
    #[test]
    fn an_area_has_the_grids_into_which_it_extends() {
        let text = "panel = \"p\"\nregion = { corners_px = [[0, 0], [500, 0], [500, 200], [0, 200]], rows = 2, \
                    columns = 5 }\nlocate.box_min_mm = [0, 0, 0]\nlocate.box_max_mm = [1, 1, 1]\n";
        let recipe = Recipe::check("f", text).unwrap_or_else(|problems| panic!("{problems}"));
        let region = Region::new(recipe.region()).expect("convex");
        let area = ParameterPatch { low: Parameter { u: 0.15, v: 0.1 }, high: Parameter { u: 0.25, v: 0.5 } };
        let broken = vec![Parameter { u: 0.16, v: 0.2 }, Parameter { u: 0.21, v: 0.2 }];
        let treated = Treated::from_areas(&region, vec![area], broken.clone());
        assert_eq!(treated.grids(), [GridId { row: 1, column: 1 }, GridId { row: 1, column: 2 }]);
        assert!(treated.holds(Parameter { u: 0.2, v: 0.3 }) && !treated.holds(Parameter { u: 0.3, v: 0.3 }));
        let whole = Treated::from_grids(treated.grids());
        assert!(whole.areas().is_none() && whole.holds(Parameter { u: 0.3, v: 0.3 }));
        let second = treated.as_whole_grids(&region, &[GridId { row: 1, column: 2 }]);
        assert!(second.areas().is_none() && second.holds(Parameter { u: 0.3, v: 0.3 }));
        assert_eq!((second.grids().len(), second.broken()), (1, Some(&broken[1..])), "0.16 lies in r1c1");
        let part = area.part_in(&region, GridId { row: 1, column: 2 }).expect("it extends into it");
        assert_eq!((part.low, part.high), (Parameter { u: 0.2, v: 0.1 }, Parameter { u: 0.25, v: 0.5 }));
    }
}
