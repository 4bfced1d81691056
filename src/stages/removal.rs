//! The removal of a path, as planned and as executed; and the feeds for the removal that the recipe asks for.

mod checks;
mod feeds;
#[cfg(test)]
mod tests;

pub use checks::{RemovedBefore, unknown};
pub use feeds::moves;

use super::Drawing;
use super::survey::ToolState;
use crate::number_text::{apart, fixed};
use crate::panel::{GridId, TaughtPanel};
use crate::path::dwell::{self, Executed};
use crate::path::{Plan, Waypoint};
use crate::recipe::{self, Recipe, RemovalMethod};
use crate::record::name;
use crate::removal::figures::Figures;
use crate::removal::ground::PanelGround;
use crate::removal::map::{RemovalMap, removed};
use crate::removal::model::Model;
use crate::removal::pad::Pad;
use crate::removal::schedule::{RemovalTarget, schedule};
use crate::removal::track::{Disc, Ground, stretches};
use crate::report::removal_map;
use crate::surface::{Fit, Parameter};
use crate::verdict::Check;
use feeds::AtBounds;

/// Distance between the samples of a map, in radii of the disc; `SPACING_MM` are its limits, mm.
const SPACING_RADII: f64 = 0.1;
const SPACING_MM: [f64; 2] = [0.5, 1.5];

/// Distance of scheduled lines beyond the treated area, in radii of the disc.
const BEYOND_RADII: f64 = 0.4;

/// The inputs of a removal calculation.
#[derive(Debug, Clone, Copy)]
pub struct Abrasive<'a> {
    /// What was taught.
    pub panel: &'a TaughtPanel,
    /// Its surface.
    pub fit: &'a Fit,
    /// The recipe.
    pub recipe: &'a Recipe,
    /// The tool, with its removal model.
    pub tool: ToolState,
    /// Removal by earlier paths of this cycle.
    pub earlier: Option<&'a RemovalMap>,
    /// Removal by earlier cycles on the same part.
    pub before: RemovedBefore,
}

/// Removal by a path, and the total with earlier paths on the same part.
#[derive(Debug, Clone)]
pub struct Removed {
    /// Removal by position, including earlier paths.
    pub map: RemovalMap,
    /// The numbers of the path, and the largest depths of the part; `None` if nothing is treated.
    pub figures: Option<Figures>,
    /// The same, judged.
    pub checks: Vec<Check>,
    limits_um: [f64; 2],
}

impl<'a> Abrasive<'a> {
    /// The recipe's table with its force, N, and the model; `None` if one of them is missing.
    fn known(&self) -> Option<(&'a recipe::Removal, f64, Model)> {
        Some((self.recipe.removal()?, self.recipe.force_n()?, self.tool.removal?))
    }

    /// Returns the recipe's table with its force and the model, if the recipe also asks for scheduled feeds.
    fn wanted(&self) -> Option<(&'a recipe::Removal, f64, Model)> {
        self.known().filter(|(asked, ..)| asked.method() == RemovalMethod::Scheduled)
    }

    /// Returns the distance of a plan's lines beyond the treated area, mm: feeds alone cannot make the removal uniform
    /// up to the border of this area.
    pub fn beyond_mm(&self) -> f64 {
        let radius_mm = self.recipe.path().disc_diameter_mm() / 2.0;
        self.wanted().map_or(0.0, |_| BEYOND_RADII * radius_mm)
    }

    /// The plan with the feeds that remove the target, if the recipe asks for that and the model is known.
    #[must_use]
    pub fn scheduled(&self, plan: Plan) -> Plan {
        let Some((asked, force_n, model)) = self.wanted() else { return plan };
        let (settings, all) = (self.recipe.path(), waypoints(&plan));
        let moves = moves(&all, asked, settings);
        let ground = self.ground();
        let surface = (&self.fit.surface, &self.panel.region, &ground as Ground<'_>);
        let all_stretches = stretches(surface.0, &dwell::planned(&plan), (&self.disc(&model), force_n), &ground);
        let wanted =
            RemovalTarget { target_um: asked.target_um(), acceleration_mm_s2: settings.acceleration_mm_s2() };
        let found = schedule(surface, &treated(&plan), (&all_stretches, &moves), &model, &wanted);
        let mut feeds_mm_s: Vec<f64> = all.iter().map(|waypoint| waypoint.feed_mm_s).collect();
        for (own, feed_mm_s) in moves.iter().zip(&found) {
            feeds_mm_s[own.pose] = *feed_mm_s;
        }
        let fed = plan.fed(&feeds_mm_s, settings);
        let radius_mm = settings.disc_diameter_mm() / 2.0;
        let times = dwell::simulate(surface.0, surface.1, &treated(&fed), &dwell::planned(&fed), radius_mm);
        fed.timed(&times)
    }

    /// The removal of a plan; `None` if the recipe does not ask for it, or if the model is not known.
    pub fn planned(&self, plan: &Plan) -> Option<Removed> {
        let asked = self.recipe.removal()?;
        let bounded = AtBounds::compute(&waypoints(plan), asked, self.recipe.path());
        self.removed((&treated(plan), &dwell::planned(plan)), bounded)
    }

    /// The removal by these poses on those grids, with the force that the tool measured; without a measurement,
    /// with the recipe's force.
    pub fn executed(&self, grids: &[GridId], poses: &[Executed]) -> Option<Removed> {
        self.removed((grids, poses), AtBounds::default())
    }

    fn removed(&self, (grids, poses): (&[GridId], &[Executed]), bounded: AtBounds) -> Option<Removed> {
        let (asked, force_n, model) = self.known()?;
        let ground = self.ground();
        let disc = self.disc(&model);
        let all = stretches(&self.fit.surface, poses, (&disc, force_n), &ground);
        let spacing_mm = (SPACING_RADII * disc.pad.radius_mm).clamp(SPACING_MM[0], SPACING_MM[1]);
        let force_share = (asked.force_error_percent() / 100.0).hypot(model.force_law_share_95(force_n));
        let on = (&self.fit.surface, &self.panel.region, &ground as Ground<'_>);
        let own = removed(on, grids, &all, (&model, force_share), spacing_mm);
        // The target applies to a pass; the limit at each position applies to the part.
        let of_pass = Figures::compute(&own, asked.target_um());
        let map = match self.earlier {
            Some(earlier) => own.and(earlier),
            None => own,
        };
        let of_part = Figures::compute(&map, asked.target_um());
        let figures = of_pass.zip(of_part).map(|(of_pass, of_part)| Figures {
            largest_um: of_part.largest_um + self.before.bound_um,
            largest_bound_um: of_part.largest_bound_um + self.before.bound_um,
            ..of_pass
        });
        let mut checks = checks::checks(figures.as_ref(), (asked, bounded));
        checks.push(checks::force(force_n, &model));
        checks.extend(self.before.checks(asked));
        Some(Removed { map, figures, checks, limits_um: [asked.target_um(), asked.max_um()] })
    }

    fn disc(&self, model: &Model) -> Disc {
        let radius_mm = self.recipe.path().disc_diameter_mm() / 2.0;
        let pad = Pad { radius_mm, stiffness_n_mm3: model.pad_n_mm3 };
        Disc { pad, orbit: model.orbit, rim_orbits: true, swept_mm2: self.tool.worn_mm2 }
    }

    /// Returns a function that states whether the panel has material at a position.
    fn ground(&self) -> impl Fn(Parameter) -> bool + Sync + use<> {
        let outline = PanelGround::new(&self.panel.region, &self.panel.outline_px);
        let holes = self.fit.map.holes(&self.panel.region, self.recipe.path().lift_hole_mm());
        move |at| outline.holds(at) && !holes.holds(at)
    }
}

impl Removed {
    /// Draws the map in µm.
    pub fn drawn(&self, panel: &TaughtPanel, (name, caption): (&str, &str)) -> Drawing {
        Drawing::new(name, caption, removal_map(&self.map.field(), &panel.region, self.limits_um))
    }

    /// The checks of the executed path. If the path was cut short, the work that remains is not counted as an error
    /// of the path.
    pub fn told_after(&self, is_whole: bool) -> Vec<Check> {
        let told = |check: &Check| match is_whole || check.name == name::REMOVED_BOUND {
            true => check.clone(),
            false => check.clone().without_consequence(),
        };
        self.checks.iter().map(told).collect()
    }

    /// Returns lines of text for a person.
    pub fn words(&self) -> Vec<String> {
        let [target_um, max_um] = self.limits_um;
        let Some(found) = &self.figures else {
            return vec!["removal            the path treats no area".to_owned()];
        };
        let [largest, most] = apart(found.largest_bound_um, max_um, 1);
        vec![
            format!(
                "removal            {:8} µm on average (target {} µm), ± {} % (95 %); 5th percentile of the \
                 treated area {} µm, 95th percentile {} µm",
                fixed(found.mean_um, 1),
                fixed(target_um, 1),
                fixed(found.uncertainty_percent, 0),
                fixed(found.low_um, 1),
                fixed(found.high_um, 1)
            ),
            format!(
                "                   {:8} µm at the deepest place, upper 95 % bound {largest} µm (limit {most} µm); \
                 95 % of the area within {} % of the target",
                fixed(found.largest_um, 1),
                fixed(found.within_percent, 1)
            ),
        ]
    }
}

fn treated(plan: &Plan) -> Vec<GridId> {
    plan.grids.iter().map(|grid| grid.id).collect()
}

fn waypoints(plan: &Plan) -> Vec<Waypoint> {
    plan.paths.iter().flat_map(|path| path.waypoints.iter().copied()).collect()
}
