//! Tests of paths over areas around breaks. Expected values are calculated by hand on a plane of 280 × 168 mm with 3 ×
//! 5 grids of 56 mm.

use super::super::breaks::{Breaks, Distances, around_breaks, arrange_boxes};
use super::super::gate::judge_plan;
use super::super::plan::plan_beyond_borders;
use super::*;
use crate::surface::{HoleMap, Treated};
use panelprep_base::geometry::{Mask, Pixel};

fn at(x_mm: f64, y_mm: f64) -> Parameter {
    Parameter { u: x_mm / 280.0, v: y_mm / 168.0 }
}

fn area([left, top]: [f64; 2], [right, bottom]: [f64; 2]) -> ParameterPatch {
    ParameterPatch { low: at(left, top), high: at(right, bottom) }
}

fn planned(areas: Vec<ParameterPatch>, broken: Vec<Parameter>, settings: &recipe::Path) -> Plan {
    planned_over(&Treated::from_areas(&region(), areas, broken), settings)
}

fn planned_over(treated: &Treated, settings: &recipe::Path) -> Plan {
    planned_on_panel(treated, 20.0, settings)
}

/// Plans paths on a panel that ends at this distance beyond the region, mm.
fn planned_on_panel(treated: &Treated, beyond_mm: f64, settings: &recipe::Path) -> Plan {
    let region = region();
    let corner = |n: usize| {
        let along = (n % 50) as f64 / 50.0;
        let (x, y) = [(along, 0.0), (1.0, along), (1.0 - along, 1.0), (0.0, 1.0 - along)][n / 50];
        let [width_mm, height_mm] = [280.0, 168.0].map(|side_mm| side_mm + 2.0 * beyond_mm);
        Point::at(width_mm * x - beyond_mm, height_mm * y - beyond_mm, 0.0)
    };
    let outline: Vec<Point<Panel>> = (0..200).map(corner).collect();
    let on = (outline.as_slice(), &HoleMap::empty(&region));
    plan_beyond_borders(&rectangle(280.0, 168.0), &region, treated, on, (settings, 0.0)).expect("a plan")
}

fn id(name: &str) -> GridId {
    name.parse().expect("a grid")
}

/// An area of 44 × 44 mm = 1936 mm² in the middle of r2c3, which has 56 × 56 = 3136 mm². Lines are inset from the
/// area's border by 3 mm, so every contact point lies within 19 mm of the middle, (140, 84).
#[test]
fn an_area_in_a_grid_is_covered_and_nothing_else_is_planned() {
    let settings = settings("");
    let plan = planned(vec![area([118.0, 62.0], [162.0, 106.0])], vec![at(140.0, 84.0)], &settings);
    assert_eq!(plan.grids.iter().map(|grid| grid.id).collect::<Vec<_>>(), [id("r2c3")]);
    assert!((plan.treated_mm2() - 1_936.0).abs() < 1e-6, "{}", plan.treated_mm2());
    assert_eq!((plan.breaks_reached, plan.coverage), (Some(1.0), 1.0));
    let contacts = plan.paths[0].waypoints.iter().filter(|waypoint| waypoint.contact);
    let farthest_mm = contacts
        .map(|waypoint| tool(waypoint).origin().mm)
        .fold(0.0, |most: f64, point| most.max((point.x - 140.0).abs()).max((point.y - 84.0).abs()));
    assert!((farthest_mm - 19.0).abs() < 1e-6, "{farthest_mm}");
    assert_eq!(judge(&plan, &settings).verdict, Verdict::Accept);
    let whole = [id("r2c3")];
    let whole = super::super::plan(&rectangle(280.0, 168.0), &region(), &whole, &[], &settings).expect("a plan");
    assert!(plan.contact_mm < whole.contact_mm && plan.duration_s < whole.duration_s);
    assert!((whole.treated_mm2() - 3_136.0).abs() < 1e-6 && whole.breaks_reached.is_none());
}

/// Two areas of 34 × 34 = 1156 mm² in r1c1, and one area of 44 × 34 mm of which one half, 22 · 34 = 748 mm², is in r1c3
/// and the other half in r1c4.
#[test]
fn areas_are_counted_by_the_grids_in_which_they_lie() {
    let areas =
        vec![area([0.0, 0.0], [34.0, 34.0]), area([22.0, 22.0], [56.0, 56.0]), area([146.0, 10.0], [190.0, 44.0])];
    let plan = planned(areas, vec![], &settings(""));
    let areas_mm2: Vec<(GridId, f64)> =
        plan.grids.iter().map(|grid| (grid.id, (10.0 * grid.area_mm2).round() / 10.0)).collect();
    assert_eq!(areas_mm2, [(id("r1c1"), 2_312.0), (id("r1c3"), 748.0), (id("r1c4"), 748.0)]);
    assert_eq!(plan.grid_dwell.iter().map(|(id, _)| *id).collect::<Vec<_>>(), ["r1c1", "r1c3", "r1c4"].map(id));
    assert_eq!(plan.paths.len(), 3);
}

/// One of two break points lies 40 mm beside the area: the disc reaches half of the break points, and a person must
/// decide. The area's own coverage does not show this.
#[test]
fn a_plan_that_misses_a_break_is_not_accepted() {
    let settings = settings("");
    let plan =
        planned(vec![area([118.0, 62.0], [162.0, 106.0])], vec![at(140.0, 84.0), at(202.0, 84.0)], &settings);
    assert_eq!((plan.breaks_reached, plan.coverage), (Some(0.5), 1.0));
    let (_, judgement) = judge_plan(&plan, &settings);
    let codes: Vec<&str> = judgement.reasons.iter().map(|reason| reason.code.as_ref()).collect();
    assert_eq!((judgement.verdict, codes), (Verdict::Review, vec!["break_missed"]));
}

/// The panel ends at the region's border, and the disc of 15 mm radius may not reach beyond it: contact points are at
/// least 15 mm from the edge. A break point 1 mm from the edge is 14 mm from the contact points: within the radius, but
/// not if the point has an uncertainty of 2 mm. If the disc may reach 2 mm beyond the edge, the distance is 12 mm.
#[test]
fn a_break_at_the_edge_is_reached_or_needs_a_review() {
    let own = area([0.0, 50.0], [45.0, 95.0]);
    let broken = vec![at(1.0, 72.0)];
    let planned = |uncertainty_mm: f64, overhang_mm: f64| {
        let treated = Treated::from_areas(&region(), vec![own], broken.clone()).with_uncertainty_mm(uncertainty_mm);
        let settings = settings(&format!("edge_overhang_mm = {overhang_mm:?}"));
        let plan = planned_on_panel(&treated, 0.0, &settings);
        let (_, judgement) = judge_plan(&plan, &settings);
        let is_missed = judgement.reasons.iter().any(|reason| reason.code == "break_missed");
        (plan.breaks_reached, is_missed)
    };
    assert_eq!(planned(0.0, 0.0), (Some(1.0), false));
    assert_eq!(planned(2.0, 0.0), (Some(0.0), true));
    assert_eq!(planned(2.0, 2.0), (Some(1.0), false));
}

/// The smallest area for a disc of 30 mm is three radii, 45 mm. It is tested in a grid, in a corner of the region, and
/// with a strip of 2 mm in an adjacent grid. Every pattern covers the area, and the dwell time is uniform within the
/// recipe's limit. Rows in an area of 34 mm are not uniform.
#[test]
fn every_pattern_covers_the_smallest_areas() {
    let smallest =
        [area([117.5, 61.5], [162.5, 106.5]), area([0.0, 0.0], [45.0, 45.0]), area([13.0, 10.0], [58.0, 55.0])];
    for pattern in ["raster", "cross-hatch", "spiral", "offset", "offset-spiral"] {
        let settings = settings(&format!("pattern = \"{pattern}\""));
        for own in smallest {
            let broken = vec![own.parameter_at(Parameter { u: 0.5, v: 0.5 })];
            let plan = planned(vec![own], broken, &settings);
            let is_covered = plan.grids.iter().all(|grid| grid.covered_fraction() >= MIN_COVERAGE);
            assert!(is_covered && plan.breaks_reached == Some(1.0), "{pattern} {own:?}: {:?}", plan.grids);
            let judgement = judge(&plan, &settings);
            assert_eq!(judgement.verdict, Verdict::Accept, "{pattern} {own:?}: {judgement:?}");
        }
    }
    let settings = settings("");
    let narrow = planned(vec![area([123.0, 67.0], [157.0, 101.0])], vec![], &settings);
    let uneven = judge(&narrow, &settings).reasons.into_iter().map(|reason| reason.code);
    assert_eq!(uneven.collect::<Vec<_>>(), ["uneven"]);
}

/// Expected values, calculated by hand: a disc of 5 mm radius that moves along the middle of an area of 20 × 10 mm
/// covers the area completely. Of the whole grid of 50 × 50 mm it covers 278.5 of 2500 mm², see
/// `dwell_time_agrees_with_hand_calculation`.
#[test]
fn the_executed_path_is_compared_with_the_area() {
    let (surface, region) = (rectangle(50.0, 50.0), one_grid());
    let pose = |x: f64| KukaPose { x_mm: x, y_mm: 25.0, c_deg: 180.0, ..KukaPose::default() }.to_rigid();
    let at = |x: f64| dwell::ExecutedPose { panel_from_tool: pose(x), seconds: 2.0, contact: true, force_n: None };
    let own = ParameterPatch { low: Parameter { u: 0.3, v: 0.4 }, high: Parameter { u: 0.7, v: 0.6 } };
    let treated = Treated::from_areas(&region, vec![own], vec![]);
    let found = dwell::simulate_treated(&surface, &region, &treated, &[at(15.0), at(35.0)], 5.0);
    assert_eq!((found.covered_fraction(), found.grids[0].untreated_mm2()), (1.0, 0.0));
    let half = dwell::simulate_treated(&surface, &region, &treated, &[at(15.0), at(20.0)], 5.0);
    // The disc covers up to x = 25 in the middle, and up to 20 at the sides: 5 · 10 mm² and half of a disc of 5 mm,
    // 39.3 mm²: 89.3 of 200 mm².
    assert!((half.covered_fraction() - 0.446).abs() < 0.02, "{}", half.covered_fraction());
}

/// The distances for a disc of 30 mm and the default uncertainty of 2 mm.
const DISTANCES: Distances = Distances { margin_mm: 17.0, join_mm: 15.0, least_mm: 45.0, reach_mm: 10.0 };

/// Returns the corners of boxes: left, top, right and bottom, mm.
fn corners_mm(boxes: &[ParameterPatch]) -> Vec<[f64; 4]> {
    let corners = |patch: &ParameterPatch| {
        [280.0 * patch.low.u, 168.0 * patch.low.v, 280.0 * patch.high.u, 168.0 * patch.high.v].map(f64::round)
    };
    boxes.iter().map(corners).collect()
}

/// Expected results, calculated by hand. Boxes of 45 mm cost 65² = 4225 mm² each.
/// - Moved by (30, 10), the boxes are merged: (75 + 20) · (55 + 20) = 7125 mm².
/// - Moved by (40, 40), they remain two, since 105² = 11 025 mm² is more than 8450 mm²; the overlap of 5 mm is less
///   than the disc's reach.
/// - Moved by (30, 30), they are merged: this costs 95² = 9025 mm², but a cut would leave a strip of 15 mm beside the
///   overlap of 15 mm, which is too narrow.
/// - A box of 90 mm, 110² = 12 100 mm², and a box of 90 × 45 mm, 110 · 65 = 7150 mm², overlap by 20 mm. Merged they
///   would cost 180 · 110 = 19 800 mm², so the second box is cut to 70 × 45 mm.
#[test]
fn boxes_become_one_only_if_this_costs_no_more() {
    let surface = rectangle(280.0, 168.0);
    let found = |boxes: &[ParameterPatch]| corners_mm(&arrange_boxes(&surface, boxes.to_vec(), DISTANCES));
    let first = area([50.0, 50.0], [95.0, 95.0]);
    assert_eq!(found(&[first, area([80.0, 60.0], [125.0, 105.0])]), [[50.0, 50.0, 125.0, 105.0]]);
    let corner = area([90.0, 90.0], [135.0, 135.0]);
    assert_eq!(found(&[first, corner]), [[50.0, 50.0, 95.0, 95.0], [90.0, 90.0, 135.0, 135.0]]);
    assert_eq!(found(&[first, area([80.0, 80.0], [125.0, 125.0])]), [[50.0, 50.0, 125.0, 125.0]]);
    let large = area([50.0, 40.0], [140.0, 130.0]);
    let cut = [[50.0, 40.0, 140.0, 130.0], [140.0, 60.0, 210.0, 105.0]];
    assert_eq!(found(&[large, area([120.0, 60.0], [210.0, 105.0])]), cut);
    assert_eq!(found(&[large, area([60.0, 50.0], [105.0, 95.0])]), [[50.0, 40.0, 140.0, 130.0]]);
}

/// Returns the treatment of failed grids for breaks in these rectangles: left, top, right and bottom, mm.
fn around(rectangles_mm: &[[f64; 4]], failed: &[&str]) -> Treated {
    let region = region();
    let mut broken = Mask::all_outside(486, 300);
    for index in 0..broken.inside.len() {
        let unit = region.unit(Pixel::at((index % 486) as f64, (index / 486) as f64));
        let (x, y) = (280.0 * unit.x, 168.0 * unit.y);
        let holds =
            |[left, top, right, bottom]: &[f64; 4]| (left..=right).contains(&&x) && (top..=bottom).contains(&&y);
        broken.inside[index] = rectangles_mm.iter().any(holds);
    }
    let failed: Vec<GridId> = failed.iter().map(|name| id(name)).collect();
    let breaks = Breaks { broken: &broken, failed: &failed, whole: &[], spared: &[], join_grids: true };
    let treated = around_breaks(&rectangle(280.0, 168.0), &region, &breaks, DISTANCES);
    assert!(treated.broken().is_some_and(|broken| !broken.is_empty()), "{rectangles_mm:?}");
    treated
}

fn area_mm2(treated: &Treated) -> f64 {
    let areas = treated.areas().expect("around breaks").iter();
    areas.map(|area| 280.0 * 168.0 * (area.high.u - area.low.u) * (area.high.v - area.low.v)).sum()
}

/// Expected results, calculated by hand with 34 mm for the margins and grids of 3136 mm². The box of a break of 30 mm
/// in r2c3 would have 64² = 4096 mm², so the grid is treated. The box of a break of 10 mm where four failed grids meet
/// has 45² = 2025 mm², to within a pixel, instead of 12 544 mm². The boxes of breaks of 12 mm in r1c1 and r2c2 have 46
/// mm and lie 10 mm apart: they remain two areas, because a merged box would have 102² = 10 404 mm², more than both
/// grids.
#[test]
fn areas_are_never_larger_than_the_grids_that_they_replace() {
    let large = around(&[[125.0, 69.0, 155.0, 99.0]], &["r2c3"]);
    assert_eq!(corners_mm(large.areas().expect("areas")), [[112.0, 56.0, 168.0, 112.0]]);
    assert_eq!(large.grids(), [id("r2c3")]);
    let corner = around(&[[107.0, 51.0, 117.0, 61.0]], &["r1c2", "r1c3", "r2c2", "r2c3"]);
    assert_eq!((corner.grids().len(), corner.areas().map(<[ParameterPatch]>::len)), (4, Some(1)));
    assert!((2_020.0..2_200.0).contains(&area_mm2(&corner)), "{:?}", corner.areas());
    let diagonal = around(&[[22.0, 22.0, 34.0, 34.0], [78.0, 78.0, 90.0, 90.0]], &["r1c1", "r2c2"]);
    assert_eq!(
        (diagonal.grids(), diagonal.areas().map(<[ParameterPatch]>::len)),
        (&[id("r1c1"), id("r2c2")][..], Some(2))
    );
    assert!((3_900.0..4_700.0).contains(&area_mm2(&diagonal)), "{:?}", diagonal.areas());
    for treated in [&corner, &diagonal] {
        assert!(treated.broken().expect("known").iter().all(|at| treated.holds(*at)));
    }
}

/// Only r2c2, up to x = 112 mm, failed. A break of 35 × 20 mm extends 5 mm into r2c3, which the disc reaches from r2c2:
/// the box would have 69 · 54 = 3726 mm², so the grid is treated. A break of 45 × 20 mm extends 15 mm into r2c3: the
/// box of 79 · 54 = 4266 mm² is treated, because the treatment of r2c2 alone would not reach a part of the break.
#[test]
fn a_grid_replaces_areas_only_if_the_disc_reaches_every_break() {
    let near = around(&[[82.0, 74.0, 117.0, 94.0]], &["r2c2"]);
    assert_eq!(corners_mm(near.areas().expect("areas")), [[56.0, 56.0, 112.0, 112.0]]);
    assert!(near.broken().expect("known").iter().any(|at| at.u > 0.4));
    let settings = settings("");
    let plan = planned_over(&near, &settings);
    assert_eq!((plan.breaks_reached, judge(&plan, &settings).verdict), (Some(1.0), Verdict::Accept));
    let far = around(&[[82.0, 74.0, 127.0, 94.0]], &["r2c2"]);
    assert_eq!((far.grids(), far.areas().map(<[ParameterPatch]>::len)), (&[id("r2c2"), id("r2c3")][..], Some(1)));
    assert!((4_000.0..4_500.0).contains(&area_mm2(&far)), "{:?}", far.areas());
    assert_eq!(planned_over(&far, &settings).breaks_reached, Some(1.0));
}
