//! Checks of the removal by a path against the limits of the recipe.

use super::super::survey::ToolState;
use super::feeds::BoundShares;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, Limit, LimitSource, Severity};
use panelprep_cell::recipe::{self, Recipe, RemovalMethod};
use panelprep_cell::record::name;
use panelprep_toolpath::removal::figures::MapFigures;
use panelprep_toolpath::removal::model::{FORCE_RANGE, Model, UNKNOWN};
use serde::{Deserialize, Serialize};

/// Removal by earlier cycles on the same part.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EarlierRemoval {
    /// The upper 95 % bound of the removal anywhere, µm; it counts everywhere, since the maps of earlier cycles are
    /// not kept.
    pub bound_um: f64,
    /// Earlier cycles that abraded the part to an unknown depth.
    pub unknown: usize,
}

impl EarlierRemoval {
    /// Returns the checks of the removal by earlier cycles, if there were any.
    pub(super) fn checks(&self, asked: &recipe::Removal) -> Vec<Check> {
        let before = Check::new("removed in earlier cycles of this part, upper 95 % bound", "µm", self.bound_um);
        let unknown = Check::new("earlier cycles of this part with an unknown depth", "", self.unknown as f64)
            .with_max(0.0, LimitSource::Program)
            .reviews("earlier_unknown", || {
                format!(
                    "{} earlier cycles abraded this part to an unknown depth: measure the remaining thickness; in \
                 total, {} µm may be removed",
                    self.unknown,
                    asked.max_um()
                )
            });
        let is_told = *self != EarlierRemoval::default();
        [before, unknown].into_iter().filter(|_| is_told).collect()
    }
}

/// Returns a failed check if the recipe asks for removal but the disc's removal is not known.
pub fn unknown(recipe: &Recipe, tool: ToolState) -> Option<Check> {
    let stated = recipe.removal().filter(|_| tool.removal.is_none())?;
    let check = Check::new(name::REMOVED_BOUND, "µm", None)
        .with_max(stated.max_um(), LimitSource::recipe("removal.max_um"));
    Some(check.with_consequence_if(true, Severity::Reject, "removal_unknown", || UNKNOWN.to_owned()))
}

/// Returns the checks of the removal by a path.
pub(super) fn checks(
    figures: Option<&MapFigures>,
    (asked, bounded): (&recipe::Removal, BoundShares),
) -> Vec<Check> {
    let figure = |number: fn(&MapFigures) -> f64| figures.map(number);
    let (target_um, max_um) = (asked.target_um(), asked.max_um());
    let passes =
        figure(|found| found.mean_um).map(|mean_um| (target_um / mean_um - MEAN_TOLERANCE).ceil().max(1.0));
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
        Check::new("passes that the target takes", "", passes).with_max(1.0, LimitSource::Program).reviews("more_passes", || {
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
        Check::new(name::REMOVED_EVEN, "%", within).with_max(asked.even_percent(), LimitSource::recipe("removal.even_percent")).reviews(
            "removal_uneven",
            || {
                let [found, allowed] = distinguishable_texts(within.unwrap_or(f64::NAN), asked.even_percent(), 1);
                format!(
                    "95 % of the treated area is expected within {found} % of the target depth (limit {allowed} %, \
                     even_percent); {}",
                    evenness_advice(asked, bounded)
                )
            },
        ),
    ]
}

/// Checks whether the removal model's coupons cover this force.
pub(super) fn force(force_n: f64, model: &Model) -> Check {
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

/// Returns advice for a more even removal.
fn evenness_advice(asked: &recipe::Removal, bounded: BoundShares) -> String {
    let percent = |share: f64| fixed_decimals(100.0 * share, 0);
    match asked.method() {
        RemovalMethod::Constant => "set method = \"scheduled\" for a more even removal".to_owned(),
        RemovalMethod::Scheduled if bounded.highest > LIMITED_FEED_SHARE => format!(
            "{} % of the path in contact already has the highest feed: raise feed_mm_s or lower force_n for a more \
             even removal",
            percent(bounded.highest)
        ),
        RemovalMethod::Scheduled if bounded.lowest > LIMITED_FEED_SHARE => format!(
            "{} % of the path in contact already has the lowest feed: lower min_feed_mm_s or raise force_n for a \
             more even removal",
            percent(bounded.lowest)
        ),
        RemovalMethod::Scheduled => {
            "use a smaller step_over_mm or a larger disc for a more even removal".to_owned()
        }
    }
}

/// Share of the path from which a feed limit counts as the cause of uneven removal.
const LIMITED_FEED_SHARE: f64 = 0.1;

/// A mean that is short of the target by this share needs no second pass.
const MEAN_TOLERANCE: f64 = 0.1;
