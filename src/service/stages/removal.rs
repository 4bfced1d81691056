//! The removal of a path, as planned and as executed; and the feeds for the removal that the recipe asks for.

mod checks;
mod feeds;
#[cfg(test)]
mod tests;

pub use checks::{EarlierRemoval, unknown};
pub use feeds::contact_moves;

use super::ResultDrawing;
use super::survey::ToolState;
use crate::report::removal_map;
use feeds::BoundShares;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::Check;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::{self, Recipe, RemovalMethod};
use panelprep_cell::record::name;
use panelprep_toolpath::path::dwell::{self, ExecutedPose};
use panelprep_toolpath::path::{Plan, Waypoint};
use panelprep_toolpath::removal::figures::MapFigures;
use panelprep_toolpath::removal::ground::PanelGround;
use panelprep_toolpath::removal::map::{RemovalMap, removed};
use panelprep_toolpath::removal::model::Model;
use panelprep_toolpath::removal::pad::PadWithDisc;
use panelprep_toolpath::removal::schedule::{RemovalTarget, schedule};
use panelprep_toolpath::removal::track::{Disc, IsPanelAt, path_stretches};
use panelprep_toolpath::surface::{Fit, Parameter, Treated};

/// Distance between the samples of a map, in radii of the disc; `SPACING_MM` are its limits, mm.
const SPACING_RADII: f64 = 0.1;
const SPACING_MM: [f64; 2] = [0.5, 1.5];

/// Distance of scheduled lines beyond the treated area, in radii of the disc.
const OVERRUN_RADII: f64 = 0.4;

/// The inputs of a removal calculation.
#[derive(Debug, Clone, Copy)]
pub struct RemovalInputs<'a> {
    /// The taught panel.
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
    pub earlier_removal: EarlierRemoval,
}

/// Removal by a path, and the total with earlier paths on the same part.
#[derive(Debug, Clone)]
pub struct PathRemovalTotal {
    /// Removal by position, including earlier paths.
    pub map: RemovalMap,
    /// The numbers of the path, and the largest depths of the part; `None` if nothing is treated.
    pub figures: Option<MapFigures>,
    /// The judged values of the removal.
    pub checks: Vec<Check>,
    limits_um: [f64; 2],
}

impl<'a> RemovalInputs<'a> {
    /// The recipe's table with its force, N, and the model; `None` if one of them is missing.
    fn known_inputs(&self) -> Option<(&'a recipe::Removal, f64, Model)> {
        Some((self.recipe.removal()?, self.recipe.force_n()?, self.tool.removal?))
    }

    /// Returns the recipe's table with its force and the model, if the recipe also asks for scheduled feeds.
    fn scheduled_inputs(&self) -> Option<(&'a recipe::Removal, f64, Model)> {
        self.known_inputs().filter(|(asked, ..)| asked.method() == RemovalMethod::Scheduled)
    }

    /// Returns the distance of a plan's lines beyond the treated area, mm: feeds alone cannot make the removal uniform
    /// up to the border of this area.
    pub fn overrun_mm(&self) -> f64 {
        let radius_mm = self.recipe.path().disc_diameter_mm() / 2.0;
        self.scheduled_inputs().map_or(0.0, |_| OVERRUN_RADII * radius_mm)
    }

    /// The plan with the feeds that remove the target, if the recipe asks for that and the model is known.
    #[must_use]
    pub fn schedule_feeds(&self, plan: Plan) -> Plan {
        let Some((asked, force_n, model)) = self.scheduled_inputs() else { return plan };
        let (settings, all) = (self.recipe.path(), waypoints(&plan));
        let moves = contact_moves(&all, asked, settings);
        let ground = self.panel_ground();
        let surface = (&self.fit.surface, &self.panel.region, &ground as IsPanelAt<'_>);
        let all_stretches =
            path_stretches(surface.0, &dwell::timed_poses(&plan), (&self.disc(&model), force_n), &ground);
        let wanted =
            RemovalTarget { target_um: asked.target_um(), acceleration_mm_s2: settings.acceleration_mm_s2() };
        let found = schedule(surface, &plan.treated, (&all_stretches, &moves), &model, &wanted);
        let mut feeds_mm_s: Vec<f64> = all.iter().map(|waypoint| waypoint.feed_mm_s).collect();
        for (own, feed_mm_s) in moves.iter().zip(&found) {
            feeds_mm_s[own.pose] = *feed_mm_s;
        }
        let fed = plan.with_feeds(&feeds_mm_s, settings);
        let radius_mm = settings.disc_diameter_mm() / 2.0;
        let times =
            dwell::simulate_treated(surface.0, surface.1, &fed.treated, &dwell::timed_poses(&fed), radius_mm);
        fed.with_dwell(&times)
    }

    /// The removal of a plan; `None` if the recipe does not ask for it, or if the model is not known.
    pub fn planned_removal(&self, plan: &Plan) -> Option<PathRemovalTotal> {
        let asked = self.recipe.removal()?;
        let bounded = BoundShares::compute(&waypoints(plan), asked, self.recipe.path());
        self.removed((&plan.treated, &dwell::timed_poses(plan)), bounded)
    }

    /// The removal by these poses on those places, with the force that the tool measured; without a measurement,
    /// with the recipe's force.
    pub fn executed_removal(&self, treated: &Treated, poses: &[ExecutedPose]) -> Option<PathRemovalTotal> {
        self.removed((treated, poses), BoundShares::default())
    }

    fn removed(
        &self,
        (treated, poses): (&Treated, &[ExecutedPose]),
        bounded: BoundShares,
    ) -> Option<PathRemovalTotal> {
        let (asked, force_n, model) = self.known_inputs()?;
        let ground = self.panel_ground();
        let disc = self.disc(&model);
        let all = path_stretches(&self.fit.surface, poses, (&disc, force_n), &ground);
        let spacing_mm = (SPACING_RADII * disc.pad.radius_mm).clamp(SPACING_MM[0], SPACING_MM[1]);
        let force_share = (asked.force_error_percent() / 100.0).hypot(model.force_law_share_95(force_n));
        let on = (&self.fit.surface, &self.panel.region, &ground as IsPanelAt<'_>);
        let own = removed(on, treated, &all, (&model, force_share), spacing_mm);
        // The target applies to a pass; the limit at each position applies to the part.
        let of_pass = MapFigures::compute(&own, asked.target_um());
        let map = match self.earlier {
            Some(earlier) => own.plus(earlier),
            None => own,
        };
        let of_part = MapFigures::compute(&map, asked.target_um());
        let figures = of_pass.zip(of_part).map(|(of_pass, of_part)| MapFigures {
            largest_um: of_part.largest_um + self.earlier_removal.bound_um,
            largest_bound_um: of_part.largest_bound_um + self.earlier_removal.bound_um,
            ..of_pass
        });
        let mut checks = checks::checks(figures.as_ref(), (asked, bounded));
        checks.push(checks::force(force_n, &model));
        checks.extend(self.earlier_removal.checks(asked));
        Some(PathRemovalTotal { map, figures, checks, limits_um: [asked.target_um(), asked.max_um()] })
    }

    fn disc(&self, model: &Model) -> Disc {
        let radius_mm = self.recipe.path().disc_diameter_mm() / 2.0;
        let pad = PadWithDisc { radius_mm, stiffness_n_mm3: model.pad_n_mm3 };
        Disc { pad, orbit: model.orbit, rim_orbits: true, swept_mm2: self.tool.worn_mm2 }
    }

    /// Returns a function that states whether the panel has material at a position.
    fn panel_ground(&self) -> impl Fn(Parameter) -> bool + Sync + use<> {
        let outline = PanelGround::new(&self.panel.region, &self.panel.outline_px);
        let holes = self.fit.map.holes(&self.panel.region, self.recipe.path().lift_hole_mm());
        move |at| outline.is_panel(at) && !holes.is_hole(at)
    }
}

impl PathRemovalTotal {
    /// Draws the map in µm.
    pub fn draw_map(&self, panel: &TaughtPanel, (name, caption): (&str, &str)) -> ResultDrawing {
        ResultDrawing::new(name, caption, removal_map(&self.map.field(), &panel.region, self.limits_um))
    }

    /// The checks of the executed path. If the path was cut short, the work that remains is not counted as an error
    /// of the path.
    pub fn executed_checks(&self, is_whole: bool) -> Vec<Check> {
        let reported = |check: &Check| match is_whole || check.name == name::REMOVED_BOUND {
            true => check.clone(),
            false => check.clone().without_consequence(),
        };
        self.checks.iter().map(reported).collect()
    }

    /// Returns lines of text for a person.
    pub fn describe(&self) -> Vec<String> {
        let [target_um, max_um] = self.limits_um;
        let Some(found) = &self.figures else {
            return vec!["removal            the path treats no area".to_owned()];
        };
        let [largest, most] = distinguishable_texts(found.largest_bound_um, max_um, 1);
        vec![
            format!(
                "removal            {:8} µm on average (target {} µm), ± {} % (95 %); 5th percentile of the \
                 treated area {} µm, 95th percentile {} µm",
                fixed_decimals(found.mean_um, 1),
                fixed_decimals(target_um, 1),
                fixed_decimals(found.uncertainty_percent, 0),
                fixed_decimals(found.low_um, 1),
                fixed_decimals(found.high_um, 1)
            ),
            format!(
                "                   {:8} µm at the deepest place, upper 95 % bound {largest} µm (limit {most} µm); \
                 95 % of the area within {} % of the target",
                fixed_decimals(found.largest_um, 1),
                fixed_decimals(found.within_percent, 1)
            ),
        ]
    }
}

fn waypoints(plan: &Plan) -> Vec<Waypoint> {
    plan.paths.iter().flat_map(|path| path.waypoints.iter().copied()).collect()
}
