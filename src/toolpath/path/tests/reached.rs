//! Tests of the area that a disc reaches and leaves out: coverage, dwell, the outline, holes, every pattern.

use super::super::coverage::{coverage, strokes};
use super::*;

/// Calculated by hand: 20 mm of track and a disc of 5 mm radius cover 20·10 + 25π = 278.54 of 2500 mm².
#[test]
fn a_straight_track_covers_a_stadium() {
    let surface = rectangle(50.0, 50.0);
    let id = GridId { row: 1, column: 1 };
    let track = [Point::at(15.0, 25.0, 0.0), Point::at(35.0, 25.0, 0.0)];
    let found = coverage(&surface, (id, &WHOLE), &strokes(&track, |_| true), 5.0);
    assert!((found.area_mm2 - 2_500.0).abs() < 1e-6);
    assert!((found.covered_mm2 - 278.54).abs() < 3.0, "{found:?}");
    // A single place is not a motion in contact, neither here nor for the dwell.
    assert!(strokes(&track, |index| index == 0).is_empty() && strokes(&track[..1], |_| true).is_empty());
}

/// Calculated by hand: a disc of 60 mm radius in the middle of r1c1, (−112, −56), would reach 11 mm beyond the edge at
/// y = −105. The lines are moved inwards, and the disc still covers the grid.
#[test]
fn a_large_disc_keeps_off_the_outline_where_it_can() {
    let (fit, region, outline, settings) = fitted(
        Shape::Plane,
        ScanDefects::default(),
        "[path]\ndisc_diameter_mm = 120\nstep_over_mm = 12\nmax_dwell_ratio = 9\n",
    );
    let plan =
        plan(&fit.surface, &region, &["r1c1".parse().expect("a grid")], &outline, &settings).expect("a plan");
    assert_eq!(judge(&plan, &settings).verdict, Verdict::Accept, "{:?}", judge(&plan, &settings));
    assert!((1.9..=2.0).contains(&plan.overhang.largest_mm), "{:?}", plan.overhang);
}

/// By hand: the panel ends at the end of its region, and the disc must not reach beyond the edge. So its middle keeps
/// 15 mm from the edge, and at the corner (1 − π/4) · 15² = 48.3 of 56² mm² remain untreated, 1.54 %.
#[test]
fn what_the_outline_forbids_is_left_and_reported() {
    let (surface, region) = (rectangle(280.0, 168.0), region());
    let side = |n: usize| {
        let along = (n % 100) as f64 / 100.0;
        let (x, y) = [(along, 0.0), (1.0, along), (1.0 - along, 1.0), (0.0, 1.0 - along)][n / 100];
        Point::at(280.0 * x, 168.0 * y, 0.0)
    };
    let outline: Vec<Point<Panel>> = (0..400).map(side).collect();
    for pattern in ["raster", "offset", "cross-hatch"] {
        let settings = settings(&format!("edge_overhang_mm = 0\nstep_over_mm = 8\npattern = \"{pattern}\""));
        let plan =
            plan(&surface, &region, &["r1c1".parse().expect("a grid")], &outline, &settings).expect("a plan");
        let judgement = judge(&plan, &settings);
        assert!(plan.overhang.largest_mm <= 0.0, "{pattern}: {:?}", plan.overhang);
        assert_eq!((judgement.verdict, &*judgement.reasons[0].code), (Verdict::Review, "coverage"), "{pattern}");
        assert!((plan.grids[0].share() - 0.9846).abs() < 0.002, "{pattern}: {:?}", plan.grids);
    }
}

/// Every pattern covers every grid completely, on every shape, and keeps the distance between its lines.
#[test]
fn every_pattern_covers_the_region() {
    for (shape, more) in
        SHAPES.into_iter().zip(["feed_angle_deg = 90", "feed_angle_deg = 30", "", "feed_angle_deg = -45"])
    {
        for pattern in ["raster", "cross-hatch", "spiral", "offset", "offset-spiral"] {
            let more = format!("[path]\npattern = \"{pattern}\"\n{more}\n");
            let (fit, region, outline, settings) = fitted(shape, ScanDefects::default(), &more);
            let grids: Vec<GridId> =
                ["r1c1", "r1c2", "r2c1", "r2c2", "r3c4"].map(|id| id.parse().expect("a grid")).into();
            let plan = plan(&fit.surface, &region, &grids, &outline, &settings).unwrap_or_else(|e| panic!("{e}"));
            let judgement = judge(&plan, &settings);
            println!("{shape:?} {pattern}: {:.4}, {:?}", plan.coverage, plan.step_over_mm);
            assert_eq!(judgement.verdict, Verdict::Accept, "{shape:?} {pattern}: {judgement:?}");
            let (checks, _) = super::super::gate::judge_plan(&plan, &settings);
            let broken: Vec<_> = checks.iter().filter(|check| !check.is_met()).collect();
            assert!(broken.is_empty(), "no row of an accepted plan says \"not allowed\": {broken:?}");
            assert_eq!(plan.paths.len(), 2, "{shape:?} {pattern}");
            let step_over = plan.step_over_mm.expect("lines side by side");
            assert!(step_over.max_mm < 12.0 * 1.01, "{shape:?} {pattern}: {step_over:?}");
        }
    }
}

/// Calculated by hand: 20 mm of track at 10 mm/s under a disc of 5 mm radius. A place on the track's line, 10 mm
/// from its ends, lies under the disc for 1 s, a place 4 mm beside the line for 0.6 s. A track there and back
/// counts as two passes.
#[test]
fn dwell_by_hand() {
    let (surface, region) = (rectangle(50.0, 50.0), one_grid());
    let pose = |x: f64| KukaPose { x_mm: x, y_mm: 25.0, c_deg: 180.0, ..KukaPose::default() }.to_rigid();
    let at = |x: f64| dwell::ExecutedPose { panel_from_tool: pose(x), seconds: 2.0, contact: true, force_n: None };
    let grids: Vec<GridId> = region.ids().collect();
    let once = dwell::simulate(&surface, &region, &grids, &[at(15.0), at(35.0)], 5.0);
    let sample = |dwell: &dwell::Dwell, x: usize, y: usize| {
        let grid = &dwell.grids[0];
        (f64::from(grid.dwell_s[y * grid.columns + x]), grid.passes[y * grid.columns + x])
    };
    assert!((sample(&once, 25, 25).0 - 1.0).abs() < 0.11 && (sample(&once, 25, 28).0 - 0.7).abs() < 0.11);
    assert_eq!((sample(&once, 25, 25).1, sample(&once, 25, 31)), (1, (0.0, 0)));
    // A straight track covers a stadium of 20 · 10 + 25π = 278.5 of 2500 mm².
    assert!((once.share() - 0.1114).abs() < 0.003 && (once.grids[0].untreated_mm2() - 2_221.5).abs() < 8.0);
    let back = dwell::ExecutedPose { contact: false, ..at(60.0) };
    let twice = dwell::simulate(&surface, &region, &grids, &[at(15.0), at(35.0), back, at(35.0), at(15.0)], 5.0);
    assert_eq!(sample(&twice, 25, 25).1, 2);
    assert!((twice.grids[0].overlap() - once.share()).abs() < 0.04, "{}", twice.grids[0].overlap());
    assert!((sample(&twice, 25, 25).0 - 2.0).abs() < 0.21);
}

/// A disc that is larger than the grid reaches the whole grid, according to the plan and to the simulation of its
/// poses, with every pattern. If the disc reaches nothing, the result is 0 and not −0.
#[test]
fn a_disc_larger_than_the_grid_covers_it_by_every_count() {
    let region = one_grid();
    let grids: Vec<GridId> = region.ids().collect();
    for pattern in ["raster", "cross-hatch", "spiral", "offset", "offset-spiral"] {
        for side_mm in [2.0, 6.0, 12.0, 20.0] {
            let surface = rectangle(side_mm, side_mm);
            let settings = settings(&format!("disc_diameter_mm = 60\npattern = \"{pattern}\""));
            let plan = plan(&surface, &region, &grids, &[], &settings).expect("a plan");
            let dwell = dwell::simulate(&surface, &region, &grids, &dwell::timed_poses(&plan), 30.0);
            let name = format!("{pattern}, {side_mm} mm");
            assert!(plan.coverage == 1.0 && dwell.share() == 1.0, "{name}: {} {}", plan.coverage, dwell.share());
            assert_eq!(format!("{:.2}", dwell.grids[0].untreated_mm2()), "0.00", "{name}");
            let spread = plan.dwell.expect("treated");
            assert!(spread.low_s > 0.1 && plan.contact_mm >= 15.0 - 1e-9, "{name}: {spread:?} {}", plan.contact_mm);
        }
    }
    let none = dwell::simulate(&rectangle(6.0, 6.0), &region, &grids, &[], 30.0);
    assert_eq!(format!("{:.2} {:.2}", 100.0 * none.share(), none.grids[0].overlap()), "0.00 0.00");
    assert!(none.spread().is_none());
}

/// The time under the disc is even over a single grid, which consists only of border areas. Both the plan and the
/// simulation of its poses show this. At the recipe's feed throughout, the time would not be even.
#[test]
fn the_feed_makes_the_time_under_the_disc_even() {
    let (surface, region, settings) = (rectangle(50.0, 50.0), one_grid(), settings(""));
    let grids: Vec<GridId> = region.ids().collect();
    let plan = plan(&surface, &region, &grids, &[], &settings).expect("a plan");
    let simulated = |plan: &Plan| {
        dwell::simulate(&surface, &region, &grids, &dwell::timed_poses(plan), 15.0).spread().expect("treated")
    };
    let (said, found) = (plan.dwell.expect("treated"), simulated(&plan));
    let mut at_one_feed = plan.clone();
    at_one_feed.paths.iter_mut().flat_map(|path| &mut path.waypoints).for_each(|point| point.feed_mm_s = 60.0);
    let before = simulated(&at_one_feed);
    println!("{said:?} {found:?}, at one feed {before:?}");
    assert!((said.ratio() - found.ratio()).abs() < 0.05, "{said:?} {found:?}");
    assert!(found.ratio() < 1.9 && before.ratio() > 2.1, "{} {}", found.ratio(), before.ratio());
    assert!(judge(&plan, &settings).reasons.iter().all(|reason| reason.code != "uneven"));
    at_one_feed.dwell = Some(before);
    assert!(judge(&at_one_feed, &settings).reasons.iter().any(|reason| reason.code == "uneven"));
}

/// The plan's own coverage and the simulation of its poses agree.
#[test]
fn what_is_planned_is_what_the_simulated_path_covers() {
    let (fit, region, outline, settings) = fitted(Shape::Saddle, ScanDefects::default(), "");
    let grids: Vec<GridId> = region.ids().collect();
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let dwell = dwell::simulate(&fit.surface, &region, &grids, &dwell::timed_poses(&plan), 15.0);
    assert!(
        (dwell.share() - plan.coverage).abs() < 0.002 && dwell.share() > 0.995,
        "{} {}",
        dwell.share(),
        plan.coverage
    );
    // Half of the path: the simulation shows the part that is not covered.
    let mut half = dwell::timed_poses(&plan);
    half.truncate(half.len() / 2);
    let executed = dwell::simulate(&fit.surface, &region, &grids, &half, 15.0);
    assert!((0.4..0.7).contains(&executed.share()), "{}", executed.share());
    let used = disc::DiscWearPlan::compute(&plan, &settings, 0.0);
    assert!((used.swept_mm2 - plan.contact_mm * 30.0).abs() < 1e-6 && !used.is_change_needed());
}

/// A square hole of 44 mm in r2c2's neighbour at (207, 150) px: over the hole the tool is lifted, beside the hole
/// nothing changes, and the part that was not abraded is reported.
#[test]
fn the_tool_is_lifted_over_a_hole() {
    let spoil = ScanDefects { hole_px: 14.0, ..ScanDefects::default() };
    let (fit, region, outline, settings) = fitted(Shape::Plane, spoil, "[surface]\nmax_hole_mm = 60\n");
    let holes = fit.map.holes(&region, settings.lift_hole_mm());
    let grids: Vec<GridId> = region.ids().collect();
    let lifted = plan_over_holes(&fit.surface, &region, &grids, (&outline, &holes), &settings).expect("a plan");
    let whole = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let (mut over, mut beside) = (0, 0);
    for waypoint in &lifted.paths[0].waypoints {
        let pixel = scene::LENS
            .project(Point::<panelprep_base::geometry::Camera>::new(tool(waypoint).origin().mm))
            .expect("in front");
        let off_px = (pixel.u - 207.0).abs().max((pixel.v - 150.0).abs());
        assert!(!(waypoint.contact && off_px < 12.5), "contact at {pixel:?}");
        over += usize::from(off_px < 12.5);
        beside += usize::from(waypoint.contact);
    }
    assert!(over >= 4 && beside > 300, "{over} {beside}");
    assert!(lifted.contact_mm < whole.contact_mm && lifted.coverage < whole.coverage);
    let judgement = judge(&lifted, &settings);
    assert_eq!((judgement.verdict, &*judgement.reasons[0].code), (Verdict::Review, "coverage"));
}
