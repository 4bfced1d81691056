//! Tests the removal by the plan of a taught panel, computed with the functions that commands and the live loop use.

use super::*;
use crate::stages::plan::{self, ReachStart};
use panelprep_base::geometry::KukaPose;
use panelprep_base::verdict::Verdict;
use panelprep_cell::panel::GridId;
use panelprep_cell::record::name;
use panelprep_toolpath::removal::examples::NO_WEAR_MODEL;
use panelprep_toolpath::surface::scene::{ScanDefects, Shape, recipe, taught};
use panelprep_toolpath::surface::{Treated, examine_fit};

fn tool(removal: Option<Model>) -> ToolState {
    ToolState { error_mm: None, worn_mm2: 0.0, removal, stroke_mm: None, in_air: false }
}

/// Returns the verdict, the codes of its reasons, and the checks, for a plan over the middle grid of a panel that is
/// the inside of a sphere.
fn planned(removal: &str, known: Option<Model>, before: EarlierRemoval) -> (Verdict, Vec<String>, Vec<Check>) {
    let recipe = recipe(Shape::Sphere, &format!("[path]\nfeed_mm_s = 120\n{removal}"));
    let panel = taught(Shape::Sphere, ScanDefects::default(), &recipe);
    let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
    let (on, tool) = ((&panel, &fit), tool(known));
    let grids = [GridId { row: 2, column: 3 }];
    let plan = plan::lay_paths(on, &Treated::from_grids(&grids), (&recipe, tool)).expect("a path");
    let found = plan::judge(plan, on, ReachStart::Unknown, (&recipe, tool), (None, before));
    let codes = found.judgement.reasons.iter().map(|reason| reason.code.to_string()).collect();
    (found.judgement.verdict, codes, found.checks)
}

fn value(checks: &[Check], name: &str) -> f64 {
    checks.iter().find(|check| check.name == name).and_then(|check| check.value).expect("it was measured")
}

const TABLE: &str = "[removal]\ntarget_um = 30\nmax_um = 50\nforce_n = 20\n";

#[test]
fn scheduled_feeds_remove_the_target() {
    let (verdict, codes, checks) =
        planned(&format!("{TABLE}method = \"scheduled\"\n"), Some(NO_WEAR_MODEL), EarlierRemoval::default());
    assert_eq!((verdict, codes), (Verdict::Accept, vec![]));
    assert!((value(&checks, name::REMOVED_MEAN) / 30.0 - 1.0).abs() < 0.03);
    assert!(value(&checks, name::REMOVED_EVEN) < 20.0 && value(&checks, name::REMOVED_BOUND) < 50.0);
}

/// If the maximum feed alone removes more than the target, the message names this feed as the one to change; the same
/// applies to the minimum feed.
#[test]
fn the_message_names_the_feed_to_change() {
    let told = |feed_mm_s: f64, lowest_mm_s: f64| {
        let table = format!("{TABLE}method = \"scheduled\"\nmin_feed_mm_s = {lowest_mm_s}\n");
        let recipe = recipe(Shape::Sphere, &format!("[path]\nfeed_mm_s = {feed_mm_s}\n{table}"));
        let panel = taught(Shape::Sphere, ScanDefects::default(), &recipe);
        let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
        let (on, tool) = ((&panel, &fit), tool(Some(NO_WEAR_MODEL)));
        let plan = plan::lay_paths(on, &Treated::from_grids(&[GridId { row: 2, column: 3 }]), (&recipe, tool))
            .expect("a path");
        let found = plan::judge(plan, on, ReachStart::Unknown, (&recipe, tool), (None, EarlierRemoval::default()));
        let uneven = found.judgement.reasons.into_iter().find(|reason| reason.code == "removal_uneven");
        uneven.map(|reason| reason.message).unwrap_or_default()
    };
    let [fast, slow] = [told(30.0, 5.0), told(120.0, 100.0)];
    assert!(fast.contains("the highest feed: raise feed_mm_s or lower force_n"), "{fast}");
    assert!(slow.contains("the lowest feed: lower min_feed_mm_s or raise force_n"), "{slow}");
}

/// Expected values, calculated by hand: the bound is e^(2.228 · √(0.02² + 0.03² + 0.0510²)) = 1.149 times the expected
/// removal; the force is known to 10 %.
#[test]
fn a_removal_that_may_be_too_deep_is_rejected() {
    let (verdict, codes, checks) = planned(
        &format!("{}method = \"scheduled\"\n", TABLE.replace("50", "34")),
        Some(NO_WEAR_MODEL),
        EarlierRemoval::default(),
    );
    assert_eq!((verdict, codes), (Verdict::Reject, vec!["removal_too_deep".to_owned()]));
    let ratio = value(&checks, name::REMOVED_BOUND) / value(&checks, "expected removal over all passes, largest");
    assert!((ratio - 1.149_4).abs() < 0.000_5, "{ratio}");
}

/// The removal by earlier cycles is included in every calculation.
#[test]
fn removal_by_earlier_cycles_is_added() {
    let scheduled = format!("{TABLE}method = \"scheduled\"\n");
    let alone = planned(&scheduled, Some(NO_WEAR_MODEL), EarlierRemoval::default());
    let after = planned(&scheduled, Some(NO_WEAR_MODEL), EarlierRemoval { bound_um: 12.5, unknown: 0 });
    let bounds = [&alone.2, &after.2].map(|checks| value(checks, name::REMOVED_BOUND));
    assert!((bounds[1] - bounds[0] - 12.5).abs() < 1e-9);
    assert_eq!(after.1, ["removal_too_deep"]);
    let unknown = planned(&scheduled, Some(NO_WEAR_MODEL), EarlierRemoval { bound_um: 0.0, unknown: 1 });
    assert_eq!((unknown.0, unknown.1), (Verdict::Review, vec!["earlier_unknown".to_owned()]));
}

/// Expected value, calculated by hand: at 120 mm/s and with a step-over of 12 mm, about 4·10⁻⁴ · 20 · 2618 / (120 · 12)
/// = 14.5 µm.
#[test]
fn a_constant_feed_is_kept_and_its_removal_is_reported() {
    let (_, codes, checks) = planned(TABLE, Some(NO_WEAR_MODEL), EarlierRemoval::default());
    assert!(codes.contains(&"more_passes".to_owned()), "{codes:?}");
    assert!(value(&checks, name::REMOVED_MEAN) < 25.0 && value(&checks, "passes that the target takes") == 2.0);
    let (verdict, codes, _) = planned(TABLE, None, EarlierRemoval::default());
    assert_eq!((verdict, codes), (Verdict::Reject, vec!["removal_unknown".to_owned()]));
    let (verdict, _, checks) = planned("", Some(NO_WEAR_MODEL), EarlierRemoval::default());
    assert!(verdict == Verdict::Accept && !checks.iter().any(|check| check.name.contains("remov")));
}

/// An air-run removes no material: no limit of the part is a reason of its verdict, and no row shows a violated limit.
#[test]
fn removal_is_no_reason_of_an_air_run() {
    let recipe = recipe(Shape::Sphere, &format!("[path]\nfeed_mm_s = 120\n{TABLE}"));
    let panel = taught(Shape::Sphere, ScanDefects::default(), &recipe);
    let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
    let (on, grids) = ((&panel, &fit), [GridId { row: 2, column: 3 }]);
    for (known, before) in [(None, 0.0), (Some(NO_WEAR_MODEL), 1_000.0)] {
        let judged = |in_air: bool| {
            let tool = ToolState { in_air, ..tool(known) };
            let plan = plan::lay_paths(on, &Treated::from_grids(&grids), (&recipe, tool)).expect("a path");
            let before = EarlierRemoval { bound_um: before, unknown: 1 };
            plan::judge(plan, on, ReachStart::Unknown, (&recipe, tool), (None, before))
        };
        let (contact, air) = (judged(false), judged(true));
        assert_eq!(contact.judgement.verdict, Verdict::Reject);
        let of_removal = |check: &&Check| check.name.contains("remov") || check.name.contains("passes");
        assert!(air.checks.iter().filter(of_removal).all(|check| check.reason().is_none() && check.is_met()));
        assert!(
            air.judgement.reasons.iter().all(|reason| !reason.code.starts_with("remov")),
            "{:?}",
            air.judgement
        );
    }
}

/// Expected value, by hand: k·p is proportional to the force, so half of the force along the path removes half of the
/// depth. Without a measurement, the recipe's force is used.
#[test]
fn the_measured_force_determines_the_removal() {
    let recipe = recipe(Shape::Sphere, &format!("[path]\nfeed_mm_s = 120\n{TABLE}"));
    let panel = taught(Shape::Sphere, ScanDefects::default(), &recipe);
    let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
    let tool = tool(Some(NO_WEAR_MODEL));
    let treated = Treated::from_grids(&[GridId { row: 2, column: 3 }]);
    let plan = plan::lay_paths((&panel, &fit), &treated, (&recipe, tool)).expect("a path");
    let before = EarlierRemoval::default();
    let abrasive =
        RemovalInputs { panel: &panel, fit: &fit, recipe: &recipe, tool, earlier: None, earlier_removal: before };
    let mean_um = |force_n: Option<f64>| {
        let poses: Vec<ExecutedPose> =
            dwell::timed_poses(&plan).into_iter().map(|pose| ExecutedPose { force_n, ..pose }).collect();
        value(&abrasive.executed_removal(&treated, &poses).expect("known").checks, name::REMOVED_MEAN)
    };
    let [unmeasured, as_asked, half] = [None, Some(20.0), Some(10.0)].map(mean_um);
    assert!((unmeasured - as_asked).abs() < 1e-9, "{unmeasured} {as_asked}");
    assert!((half / as_asked - 0.5).abs() < 0.02, "{half} of {as_asked}");
}

fn waypoint(x_mm: f64) -> Waypoint {
    let pose = KukaPose { x_mm, y_mm: 0.0, z_mm: 0.0, a_deg: 0.0, b_deg: 0.0, c_deg: 0.0 };
    Waypoint { panel_from_tool: pose.to_rigid(), contact: true, feed_mm_s: 60.0, blend_mm: 2.0 }
}

/// Expected fractions, calculated by hand: of four moves of 10 mm, the first has the minimum feed of 5 mm/s, and the
/// last two have the maximum feed of 60 mm/s.
#[test]
fn shares_of_the_path_at_each_feed_limit() {
    let recipe = recipe(
        Shape::Sphere,
        "[path]\nfeed_mm_s = 60\n[removal]\ntarget_um = 30\nmax_um = 50\nforce_n = 20\nmin_feed_mm_s = 5\n",
    );
    let asked = recipe.removal().expect("stated");
    let feeds = [30.0, 5.0, 30.0, 60.0, 60.0];
    let at = |index: usize| Waypoint { feed_mm_s: feeds[index], ..waypoint(10.0 * index as f64) };
    let all: Vec<Waypoint> = (0..5).map(at).collect();
    let found = FeedLimitFractions::compute(&all, asked, recipe.path());
    assert_eq!(found, FeedLimitFractions { lowest: 0.25, highest: 0.5 });
    assert_eq!(FeedLimitFractions::compute(&[], asked, recipe.path()), FeedLimitFractions::default());
}
