//! The areas that are sanded after a film: the failed grids, or areas around their water breaks (`[treat]` in the
//! recipe).

use panelprep_base::geometry::Mask;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource, Severity};
use panelprep_cell::panel::{GridId, TaughtPanel};
use panelprep_cell::recipe::{Recipe, TreatBy};
use panelprep_cell::record::name;
use panelprep_toolpath::path::breaks::{Breaks, Distances, around_breaks};
use panelprep_toolpath::surface::{Fit, Treated};
use panelprep_vision::inspect::{GridInspection, Inspection};

/// Minimum located fraction of a grid's broken surface; if the positions of the breaks are known for less, the whole
/// grid is sanded.
const MIN_LOCATED_FRACTION: f64 = 0.99;
/// Distance by which the disc reaches beyond an area, in radii of the disc.
const REACH_RADII: f64 = 0.8;
/// Maximum gap between two areas that may be joined, in radii of the disc: the disc reaches beyond each area, so that
/// it would sand most of the gap twice.
const MAX_JOINED_GAP_RADII: f64 = 1.0;
/// Minimum side of an area, in radii of the disc. With 2.3 radii, the ratio of the longest to the shortest dwell time
/// is 2.1, more than the default `max_dwell_ratio`; with 2.9 radii it is less than the default.
const MIN_SIDE_RADII: f64 = 3.0;

/// The broken surface of a film, which determines the areas to sand.
#[derive(Debug, Clone)]
pub struct Broken {
    /// Pixels of the taught picture on which the film broke.
    pub places: Mask,
    /// For each grid two areas, mm²: the surface of these pixels, and the broken surface by which the grid was
    /// evaluated.
    pub located_mm2: Vec<(GridId, [f64; 2])>,
}

impl Broken {
    /// Computes the broken surface from the inspection of a film.
    pub fn from_film(film: &Inspection) -> Self {
        let located_mm2 = film.footprint.broken_mm2(&film.mask());
        let of_grid = |(grid, located_mm2): (&GridInspection, f64)| (grid.id, [located_mm2, grid.broken_mm2]);
        Broken {
            places: film.broken_in_taught(),
            located_mm2: film.grids.iter().zip(located_mm2).map(of_grid).collect(),
        }
    }

    /// Returns the failed grids whose break positions are not known well enough to plan areas around them.
    fn not_located(&self, failed: &[GridId]) -> Vec<GridId> {
        let is_located = |id: &GridId| {
            let known = self.located_mm2.iter().find(|(known, _)| known == id);
            known.is_some_and(|(_, [located, broken])| *located > 0.0 && *located >= MIN_LOCATED_FRACTION * broken)
        };
        failed.iter().copied().filter(|id| !is_located(id)).collect()
    }
}

/// Returns the areas to sand on these failed grids. `spared` grids must not be sanded again, so no area extends into
/// them.
pub fn treated(
    (panel, fit): (&TaughtPanel, &Fit),
    broken: &Broken,
    (failed, spared): (&[GridId], &[GridId]),
    recipe: &Recipe,
) -> Treated {
    if recipe.treat().by() == TreatBy::Grid {
        return Treated::from_grids(failed);
    }
    let whole = broken.not_located(failed);
    let join_grids = recipe.path().join_grids();
    let breaks = Breaks { broken: &broken.places, failed, whole: &whole, spared, join_grids };
    let radius_mm = recipe.path().disc_diameter_mm() / 2.0;
    let distances = Distances {
        margin_mm: recipe.treat().widened_mm(recipe.path()),
        join_mm: MAX_JOINED_GAP_RADII * radius_mm,
        least_mm: MIN_SIDE_RADII * radius_mm,
        reach_mm: (REACH_RADII * radius_mm - recipe.treat().uncertainty_mm()).max(0.0),
    };
    let around = around_breaks(&fit.surface, &panel.region, &breaks, distances);
    around.with_uncertainty_mm(recipe.treat().uncertainty_mm())
}

/// Checks whether the uncertainty of the panel's pose, `located_mm` (95 %), is within the uncertainty that the margin
/// around breaks includes; `None` if whole grids are sanded.
pub fn checks(treated: &Treated, located_mm: Option<f64>, recipe: &Recipe) -> Option<Check> {
    treated.areas()?;
    let allowed_mm = recipe.treat().uncertainty_mm();
    let check = Check::new(name::BREAKS_UNCERTAIN, "mm", located_mm);
    let check = check.with_max(allowed_mm, LimitSource::recipe("treat.uncertainty_mm"));
    // An unknown uncertainty is treated as larger than the limit.
    let is_kept = located_mm.is_some() && check.is_met();
    Some(check.with_consequence_if(!is_kept, Severity::Review, "breaks_uncertain", || match located_mm {
        Some(found_mm) => {
            let [found, allowed] = distinguishable_texts(found_mm, allowed_mm, 2);
            format!(
                "the panel is located to {found} mm (limit {allowed} mm, treat.uncertainty_mm), so the margin around a break \
                 may be too small: locate the panel again, or increase uncertainty_mm and margin_mm"
            )
        }
        None => {
            let allowed = fixed_decimals(allowed_mm, 2);
            format!(
                "it is not known how well the panel is located (limit {allowed} mm, treat.uncertainty_mm), so the margin \
                 around a break may be too small: locate the panel again"
            )
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_toolpath::surface::scene::{ScanDefects, Shape, recipe, taught};
    use panelprep_toolpath::surface::{examine_fit, sides_mm};

    const BREAK: &str = "[treat]\nby = \"break\"\n";

    fn id(name: &str) -> GridId {
        name.parse().expect("a grid")
    }

    /// Returns a break of ±`half_mm` at (x, y) mm on the scene's panel; each broken pixel is 1.6 mm wide.
    fn broken(panel: &TaughtPanel, [x, y]: [f64; 2], half_mm: f64) -> Broken {
        let mut places = Mask::all_outside(panel.mask.width, panel.mask.height);
        for index in 0..places.inside.len() {
            let point = panel.scan.point(index % places.width, index / places.width);
            places.inside[index] =
                point.is_some_and(|p| (p.mm.x - x).abs() <= half_mm && (p.mm.y - y).abs() <= half_mm);
        }
        let located_mm2 = panel.region.ids().map(|id| (id, [40.0, 40.0])).collect();
        Broken { places, located_mm2 }
    }

    fn sides(fit: &Fit, treated: &Treated) -> Vec<[f64; 2]> {
        let [width_mm, height_mm] = sides_mm(&fit.surface);
        let areas = treated.areas().expect("around breaks").iter();
        areas.map(|area| [width_mm * (area.high.u - area.low.u), height_mm * (area.high.v - area.low.v)]).collect()
    }

    /// Expected area, calculated by hand: grids are 56 mm wide in x, which is 56 · √1.04 = 57 mm on the tilted plane. A
    /// break of 10 mm in the middle of r2c3, with the default margin of 15 + 2 mm on each side, gives an area of 44 mm,
    /// to within a pixel. The side of an area is at least three disc radii, 45 mm, and the area stays in its grid.
    #[test]
    fn a_break_in_a_grid_is_an_area_in_it() {
        let recipe = recipe(Shape::Plane, BREAK);
        let panel = taught(Shape::Plane, ScanDefects::default(), &recipe);
        let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
        let found = treated((&panel, &fit), &broken(&panel, [0.0, 0.0], 5.0), (&[id("r2c3")], &[]), &recipe);
        assert_eq!(found.grids(), [id("r2c3")]);
        let sides = sides(&fit, &found);
        assert!(sides.len() == 1 && sides[0].iter().all(|mm| (44.9..47.0).contains(mm)), "{sides:?}");
        assert!(found.broken().expect("known").iter().all(|at| found.holds(*at)));
        let by_grid = panelprep_toolpath::surface::scene::recipe(Shape::Plane, "");
        let whole = treated((&panel, &fit), &broken(&panel, [0.0, 0.0], 5.0), (&[id("r2c3")], &[]), &by_grid);
        assert_eq!(whole, Treated::from_grids(&[id("r2c3")]));
    }

    /// The border between r2c3 and r2c4 is at x = 28 mm. A break across this border gives one area with the names of
    /// both grids, even if only one of the grids failed. If r2c4 must not be sanded again, the area ends at the border.
    #[test]
    fn a_break_across_two_grids_is_one_area() {
        let recipe = recipe(Shape::Plane, BREAK);
        let panel = taught(Shape::Plane, ScanDefects::default(), &recipe);
        let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
        let broken = broken(&panel, [28.0, 0.0], 5.0);
        let of = |failed: &[GridId], spared: &[GridId]| treated((&panel, &fit), &broken, (failed, spared), &recipe);
        let both = of(&[id("r2c3")], &[]);
        assert_eq!((both.grids(), sides(&fit, &both).len()), (&[id("r2c3"), id("r2c4")][..], 1));
        let spared = of(&[id("r2c3")], &[id("r2c4")]);
        assert_eq!(spared.grids(), [id("r2c3")]);
        let area = spared.areas().expect("around breaks")[0];
        assert!((area.high.u - 0.6).abs() < 1e-12, "{area:?}");
        assert!(spared.broken().expect("known").iter().all(|at| at.u < 0.6), "only what may be abraded counts");
        // No break is in the only failed grid: the whole grid is sanded, and not omitted.
        let elsewhere = of(&[id("r1c1")], &[]);
        assert_eq!((elsewhere.grids(), sides(&fit, &elsewhere)[0][0].round()), (&[id("r1c1")][..], 57.0));
    }

    /// The whole failed grid is sanded if the positions of its breaks are known for less than 0.99 of its broken
    /// surface, or not at all.
    #[test]
    fn a_grid_with_unknown_break_places_is_treated_as_a_whole() {
        let recipe = recipe(Shape::Plane, BREAK);
        let panel = taught(Shape::Plane, ScanDefects::default(), &recipe);
        let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
        for (located_mm2, is_whole) in [([39.7, 40.0], false), ([39.5, 40.0], true), ([0.0, 0.0], true)] {
            let mut broken = broken(&panel, [0.0, 0.0], 5.0);
            broken.located_mm2.iter_mut().for_each(|(_, mm2)| *mm2 = located_mm2);
            let found = treated((&panel, &fit), &broken, (&[id("r2c3")], &[]), &recipe);
            let sides = sides(&fit, &found);
            assert_eq!((sides.len(), sides[0][0] > 55.0), (1, is_whole), "{located_mm2:?} {sides:?}");
        }
        let nowhere = Broken { places: Mask::all_outside(486, 300), located_mm2: vec![] };
        let found = treated((&panel, &fit), &nowhere, (&[id("r3c5")], &[]), &recipe);
        assert_eq!((found.grids(), sides(&fit, &found).len()), (&[id("r3c5")][..], 1));
    }

    /// The default uncertainty is 2 mm: if the panel is located to 2.1 mm, or to an unknown uncertainty, a person must
    /// decide.
    #[test]
    fn an_uncertain_pose_needs_a_review() {
        let recipe = recipe(Shape::Plane, BREAK);
        let around = Treated::from_areas(
            &panelprep_cell::panel::Region::new(recipe.region()).expect("convex"),
            vec![],
            vec![],
        );
        let code =
            |located_mm| checks(&around, located_mm, &recipe).expect("around breaks").reason().map(|r| r.code);
        assert_eq!(code(Some(2.0)), None);
        assert_eq!([code(Some(2.1)), code(None)], [(); 2].map(|()| Some("breaks_uncertain".into())));
        assert_eq!(checks(&Treated::from_grids(&[]), None, &recipe), None);
    }
}
