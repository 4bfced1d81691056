//! The planned and the executed removal of a path, with its checks against the limits of the recipe; and the feeds for
//! the removal that the recipe requires.
//!
//! Recipe and controller limit the feed of each move. If these limits change the scheduled feeds, the fractions of the
//! path at each limit explain why the removal is not uniform.

use super::ResultDrawing;
use super::survey::ToolState;
use crate::report::removal_map;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, Limit, LimitSource, Severity};
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::{self, Recipe, RemovalMethod};
use panelprep_cell::record::name;
use panelprep_toolpath::path::dwell::ExecutedPose;
use panelprep_toolpath::path::{Plan, Waypoint, dwell};
use panelprep_toolpath::removal::figures::MapFigures;
use panelprep_toolpath::removal::ground::PanelGround;
use panelprep_toolpath::removal::map::{RemovalMap, removed};
use panelprep_toolpath::removal::model::{FORCE_RANGE, Model, NO_MODEL_MESSAGE};
use panelprep_toolpath::removal::pad::PadWithDisc;
use panelprep_toolpath::removal::schedule::{Move, RemovalTarget, schedule};
use panelprep_toolpath::removal::track::{Disc, IsPanelAt, path_stretches};
use panelprep_toolpath::surface::{Fit, Parameter, Treated};
use serde::{Deserialize, Serialize};

/// Distance between the samples of a map, in radii of the disc.
const SAMPLE_SPACING_RADII: f64 = 0.1;
/// Minimum and maximum distance between the samples of a map, mm.
const SAMPLE_SPACING_LIMITS_MM: [f64; 2] = [0.5, 1.5];

/// Distance by which the lines of a scheduled path extend beyond the area to sand, in radii of the disc.
const OVERRUN_RADII: f64 = 0.4;

/// Maximum fraction of the path at a feed limit; above it, the limit is reported as the cause of a removal that is not
/// uniform.
const MAX_LIMITED_FEED_FRACTION: f64 = 0.1;

/// Maximum relative amount by which the mean removal may be less than the target without a second pass.
const RELATIVE_MEAN_TOLERANCE: f64 = 0.1;

/// Maximum relative difference between two feeds that are treated as equal.
const RELATIVE_FEED_TOLERANCE: f64 = 1e-3;

/// The inputs of a removal computation.
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

/// The removal by a path, and the total with earlier paths on the same part.
#[derive(Debug, Clone)]
pub struct PathRemovalTotal {
    /// Removal at each position, including the earlier paths of this cycle.
    pub map: RemovalMap,
    /// The statistics of the path, and the maximum depths of the part; `None` if the path sands no area.
    pub figures: Option<MapFigures>,
    /// The checks of the removal.
    pub checks: Vec<Check>,
    limits_um: [f64; 2],
}

/// Removal by earlier cycles on the same part.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EarlierRemoval {
    /// Upper 95 % bound of the maximum removal, µm. It is added at every position, because the maps of earlier cycles
    /// are not stored.
    pub bound_um: f64,
    /// Number of earlier cycles that sanded the part to an unknown depth.
    pub unknown: usize,
}

/// Fractions of the path in contact on which the feed is at a limit of the recipe, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct FeedLimitFractions {
    /// Fraction of the path at `min_feed_mm_s`.
    lowest: f64,
    /// Fraction of the path at `feed_mm_s`.
    highest: f64,
}

impl<'a> RemovalInputs<'a> {
    /// Returns the recipe's `[removal]`, its force, N, and the removal model; `None` if one of them is missing.
    fn known_inputs(&self) -> Option<(&'a recipe::Removal, f64, Model)> {
        Some((self.recipe.removal()?, self.recipe.force_n()?, self.tool.removal?))
    }

    /// Returns the result of [`Self::known_inputs`] if the recipe also requires scheduled feeds.
    fn scheduled_inputs(&self) -> Option<(&'a recipe::Removal, f64, Model)> {
        self.known_inputs().filter(|(asked, ..)| asked.method() == RemovalMethod::Scheduled)
    }

    /// Returns the distance by which a plan's lines extend beyond the area to sand, mm: feeds alone cannot make the
    /// removal uniform up to the border of this area.
    pub fn overrun_mm(&self) -> f64 {
        let radius_mm = self.recipe.path().disc_diameter_mm() / 2.0;
        self.scheduled_inputs().map_or(0.0, |_| OVERRUN_RADII * radius_mm)
    }

    /// Returns the plan with the feeds that remove the target depth, if the recipe requires them and the model is
    /// known; otherwise the unchanged plan.
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

    /// Returns the removal by a plan; `None` if the recipe does not require a removal, or if the model is not known.
    pub fn planned_removal(&self, plan: &Plan) -> Option<PathRemovalTotal> {
        let asked = self.recipe.removal()?;
        let bounded = FeedLimitFractions::compute(&waypoints(plan), asked, self.recipe.path());
        self.removed((&plan.treated, &dwell::timed_poses(plan)), bounded)
    }

    /// Returns the removal by these poses on the sanded areas, with the force that the tool measured, or the recipe's
    /// force if there is no measurement.
    pub fn executed_removal(&self, treated: &Treated, poses: &[ExecutedPose]) -> Option<PathRemovalTotal> {
        self.removed((treated, poses), FeedLimitFractions::default())
    }

    fn removed(
        &self,
        (treated, poses): (&Treated, &[ExecutedPose]),
        bounded: FeedLimitFractions,
    ) -> Option<PathRemovalTotal> {
        let (asked, force_n, model) = self.known_inputs()?;
        let ground = self.panel_ground();
        let disc = self.disc(&model);
        let all = path_stretches(&self.fit.surface, poses, (&disc, force_n), &ground);
        let spacing_mm = (SAMPLE_SPACING_RADII * disc.pad.radius_mm)
            .clamp(SAMPLE_SPACING_LIMITS_MM[0], SAMPLE_SPACING_LIMITS_MM[1]);
        let force_share = (asked.force_error_percent() / 100.0).hypot(model.relative_force_law_error_95(force_n));
        let on = (&self.fit.surface, &self.panel.region, &ground as IsPanelAt<'_>);
        let own = removed(on, treated, &all, (&model, force_share), spacing_mm);
        // The target applies to one pass; the limit at each position applies to all passes on the part.
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
        let mut checks = removal_checks(figures.as_ref(), (asked, bounded));
        checks.push(force_check(force_n, &model));
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
    /// Draws the map of the removal in µm.
    pub fn draw_map(&self, panel: &TaughtPanel, (name, caption): (&str, &str)) -> ResultDrawing {
        ResultDrawing::new(name, caption, removal_map(&self.map.field(), &panel.region, self.limits_um))
    }

    /// Returns the checks of the executed path. If the path was interrupted, only the depth limit has a consequence,
    /// because the missing removal is not a fault of the executed part.
    pub fn executed_checks(&self, is_whole: bool) -> Vec<Check> {
        let reported = |check: &Check| match is_whole || check.name == name::REMOVED_BOUND {
            true => check.clone(),
            false => check.clone().without_consequence(),
        };
        self.checks.iter().map(reported).collect()
    }

    /// Describes the removal in lines of text for a person.
    pub fn describe(&self) -> Vec<String> {
        let [target_um, max_um] = self.limits_um;
        let Some(found) = &self.figures else {
            return vec!["removal            the path sands no area".to_owned()];
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

impl EarlierRemoval {
    /// Returns the checks of the removal by earlier cycles; empty if no earlier cycle sanded the part.
    fn checks(&self, asked: &recipe::Removal) -> Vec<Check> {
        let before = Check::new("removed in earlier cycles of this part, upper 95 % bound", "µm", self.bound_um);
        let unknown = Check::new("earlier cycles of this part with an unknown depth", "", self.unknown as f64)
            .with_max(0.0, LimitSource::Program)
            .or_review("earlier_unknown", || {
                format!(
                    "{} earlier cycles sanded this part to an unknown depth: measure the remaining thickness; in \
                     total, {} µm may be removed",
                    self.unknown,
                    asked.max_um()
                )
            });
        let is_told = *self != EarlierRemoval::default();
        [before, unknown].into_iter().filter(|_| is_told).collect()
    }
}

fn waypoints(plan: &Plan) -> Vec<Waypoint> {
    plan.paths.iter().flat_map(|path| path.waypoints.iter().copied()).collect()
}

/// Returns a failed check if the recipe requires a removal but the removal model of the disc is not known.
pub fn unknown_removal_check(recipe: &Recipe, tool: ToolState) -> Option<Check> {
    let stated = recipe.removal().filter(|_| tool.removal.is_none())?;
    let check = Check::new(name::REMOVED_BOUND, "µm", None)
        .with_max(stated.max_um(), LimitSource::recipe("removal.max_um"));
    Some(check.with_consequence_if(true, Severity::Reject, "removal_unknown", || NO_MODEL_MESSAGE.to_owned()))
}

/// Returns the checks of the removal by a path.
fn removal_checks(
    figures: Option<&MapFigures>,
    (asked, bounded): (&recipe::Removal, FeedLimitFractions),
) -> Vec<Check> {
    let figure = |number: fn(&MapFigures) -> f64| figures.map(number);
    let (target_um, max_um) = (asked.target_um(), asked.max_um());
    let passes = figure(|found| found.mean_um)
        .map(|mean_um| (target_um / mean_um - RELATIVE_MEAN_TOLERANCE).ceil().max(1.0));
    let (bound_um, within) = (figure(|found| found.largest_bound_um), figure(|found| found.within_percent));
    vec![
        Check::new(name::REMOVED_MEAN, "µm", figure(|found| found.mean_um)),
        Check::new("uncertainty of the removal, 95 %", "%", figure(|found| found.uncertainty_percent)),
        Check::new("expected removal, smallest 5 %", "µm", figure(|found| found.low_um)),
        Check::new("expected removal over all passes, largest", "µm", figure(|found| found.largest_um)),
        Check::new(name::REMOVED_BOUND, "µm", bound_um).with_max(max_um, LimitSource::recipe("removal.max_um")).or_reject(
            "removal_too_deep",
            || {
                let [found, allowed] = distinguishable_texts(bound_um.unwrap_or(f64::NAN), max_um, 1);
                format!(
                    "at the deepest place, all passes together may remove up to {found} µm (upper 95 % bound; \
                     limit {allowed} µm, max_um); choose a lower target_um or force_n or a higher feed_mm_s, or \
                     measure more coupons for a more accurate k"
                )
            },
        ),
        Check::new("passes that the target takes", "", passes).with_max(1.0, LimitSource::Program).or_review("more_passes", || {
            format!(
                "one pass removes {} µm on average, so the target of {} µm needs {} passes (limit 1); lower {} or \
                 raise force_n so that one pass is enough",
                fixed_decimals(figure(|found| found.mean_um).unwrap_or(f64::NAN), 1),
                fixed_decimals(target_um, 1),
                fixed_decimals(passes.unwrap_or(f64::NAN), 0),
                match asked.method() {
                    RemovalMethod::Constant => "feed_mm_s",
                    RemovalMethod::Scheduled => "min_feed_mm_s",
                }
            )
        }),
        Check::new(name::REMOVED_EVEN, "%", within).with_max(asked.even_percent(), LimitSource::recipe("removal.even_percent")).or_review(
            "removal_uneven",
            || {
                let [found, allowed] = distinguishable_texts(within.unwrap_or(f64::NAN), asked.even_percent(), 1);
                format!(
                    "95 % of the treated area is expected within {found} % of the target depth (limit {allowed} %, \
                     even_percent); {}",
                    uniformity_advice(asked, bounded)
                )
            },
        ),
    ]
}

/// Checks whether the force is in the range that the coupons of the removal model cover.
fn force_check(force_n: f64, model: &Model) -> Check {
    let holds = model.valid_force_range_n();
    let is_beyond = holds.is_none_or(|[least_n, most_n]| !(least_n..=most_n).contains(&force_n));
    let limit = match holds {
        Some([least_n, _]) if force_n < least_n => Limit::AtLeast(least_n),
        Some([_, most_n]) => Limit::AtMost(most_n),
        None => Limit::Unlimited,
    };
    let check = Check::new("force of the recipe", "N", force_n).with_limit(limit, LimitSource::Program);
    check.with_consequence_if(is_beyond, Severity::Review, "force_beyond_coupons", || {
        let force = fixed_decimals(force_n, 1);
        match holds {
            Some([least_n, most_n]) => format!(
                "the force of {force} N is outside of the range {} to {} N for which the coupons are valid; \
                 measure coupons with this force, or with forces below and above it that differ by a factor of \
                 {FORCE_RANGE}",
                fixed_decimals(least_n, 1),
                fixed_decimals(most_n, 1)
            ),
            None => format!(
                "the removal model does not state the forces of its coupons, so the recipe's force of {force} N \
                 cannot be checked; calibrate the removal again"
            ),
        }
    })
}

/// Returns advice for a more uniform removal.
fn uniformity_advice(asked: &recipe::Removal, bounded: FeedLimitFractions) -> String {
    let percent = |share: f64| fixed_decimals(100.0 * share, 0);
    match asked.method() {
        RemovalMethod::Constant => "set method = \"scheduled\" for a more uniform removal".to_owned(),
        RemovalMethod::Scheduled if bounded.highest > MAX_LIMITED_FEED_FRACTION => format!(
            "{} % of the path in contact already has the highest feed: raise feed_mm_s or lower force_n for a more \
             uniform removal",
            percent(bounded.highest)
        ),
        RemovalMethod::Scheduled if bounded.lowest > MAX_LIMITED_FEED_FRACTION => format!(
            "{} % of the path in contact already has the lowest feed: lower min_feed_mm_s or raise force_n for a \
             more uniform removal",
            percent(bounded.lowest)
        ),
        RemovalMethod::Scheduled => {
            "use a smaller step_over_mm or a larger disc for a more uniform removal".to_owned()
        }
    }
}

/// Returns the moves in contact, each with the minimum and the maximum feed that recipe and controller permit.
pub fn contact_moves(all: &[Waypoint], asked: &recipe::Removal, settings: &recipe::Path) -> Vec<Move> {
    let planning_s = settings.planning_time_ms() / 1_000.0;
    let pairs = all.windows(2).enumerate().filter(|(_, pair)| pair[0].contact && pair[1].contact);
    pairs
        .map(|(index, pair)| {
            let length_mm = pair[0].panel_from_tool.origin().distance_mm(pair[1].panel_from_tool.origin());
            let high = settings.feed_mm_s().min(length_mm / planning_s);
            Move { pose: index + 1, length_mm, feeds_mm_s: [asked.min_feed_mm_s().min(high), high] }
        })
        .collect()
}

impl FeedLimitFractions {
    /// Computes the fractions from a plan's waypoints. A move that is so short that the controller limits its feed is
    /// counted for neither fraction, because the recipe does not set its maximum feed.
    fn compute(all: &[Waypoint], asked: &recipe::Removal, settings: &recipe::Path) -> Self {
        let moves = contact_moves(all, asked, settings);
        let way_mm: f64 = moves.iter().map(|own| own.length_mm).sum();
        let share = |is_at: &dyn Fn(f64) -> bool| {
            let at = moves.iter().filter(|own| is_at(all[own.pose].feed_mm_s));
            at.map(|own| own.length_mm).sum::<f64>() / way_mm.max(f64::MIN_POSITIVE)
        };
        FeedLimitFractions {
            lowest: share(&|feed_mm_s| feed_mm_s <= asked.min_feed_mm_s() * (1.0 + RELATIVE_FEED_TOLERANCE)),
            highest: share(&|feed_mm_s| feed_mm_s >= settings.feed_mm_s() * (1.0 - RELATIVE_FEED_TOLERANCE)),
        }
    }
}

#[cfg(test)]
mod tests;
