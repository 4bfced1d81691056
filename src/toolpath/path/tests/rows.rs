//! Tests of rows over patches, on surfaces whose results can be calculated by hand and on surfaces with every
//! curvature.
//!
//! Also tests of the area that a disc covers: coverage, dwell time, the outline, holes, every pattern.

use super::super::coverage::{coverage, strokes};
use super::*;
use proptest::prelude::*;

/// Expected values, calculated by hand for a disc of 30 mm and an inset of 3 mm: 44 mm of 50 mm remain, which a
/// step-over of 12 mm divides into 4 steps of 11 mm. Rows from 3 to 47 mm have 5 steps of 8.8 mm; the second row runs
/// in the opposite direction.
#[test]
fn a_square_of_50_mm_has_five_rows() {
    let (surface, settings) = (rectangle(50.0, 50.0), settings(""));
    let raster = raster(&surface, &WHOLE, &settings).expect("rows");
    assert_eq!(raster.rows.len(), 5);
    for (index, row) in raster.rows.iter().enumerate() {
        let row = points(&surface, row);
        assert_eq!(row.len(), 6);
        let (from, to) = if index % 2 == 0 { (3.0, 47.0) } else { (47.0, 3.0) };
        let y = 3.0 + 11.0 * index as f64;
        assert!(row[0].distance_mm(Point::at(from, y, 0.0)) < 1e-6, "{:?}", row[0]);
        assert!(row[5].distance_mm(Point::at(to, y, 0.0)) < 1e-6);
    }
    // Each connection of 11 mm between two rows has one waypoint in its middle.
    assert_eq!(raster.to_track(&surface, settings.waypoint_spacing_mm()).len(), 5 * 6 + 4);
}

/// Calculated by hand: a side below 6 mm is too short for two insets of 3 mm.
#[test]
fn a_patch_smaller_than_the_disc_gets_one_row_or_one_point() {
    for (width_mm, height_mm, lengths) in
        [(4.0, 4.0, vec![1]), (48.0, 4.0, vec![6]), (4.0, 40.0, vec![1, 1, 1, 1]), (6.0, 6.0, vec![1])]
    {
        let surface = rectangle(width_mm, height_mm);
        let raster = raster(&surface, &WHOLE, &settings("")).expect("rows");
        assert_eq!(raster.rows.iter().map(Vec::len).collect::<Vec<_>>(), lengths, "{width_mm} × {height_mm}");
        let middle = points(&surface, &raster.rows[0])[0];
        if lengths == [1] {
            assert!(middle.distance_mm(Point::at(width_mm / 2.0, height_mm / 2.0, 0.0)) < 1e-6);
        }
    }
}

/// Expected values, calculated by hand: a patch that is 50 mm wide on one side and 60 mm on the other has at most 54 mm
/// between its outer rows, 5 steps. At the narrow side the steps are 8.8 mm, at the wide side 10.8 mm, and the last row
/// stays 3 mm from the slanted border.
#[test]
fn the_last_row_follows_the_far_border() {
    let surface = quad([[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 50.0]]);
    let raster = raster(&surface, &WHOLE, &settings("")).expect("rows");
    assert_eq!(raster.rows.len(), 6);
    for point in points(&surface, &raster.rows[5]) {
        let to_border_mm = (50.0 + point.mm.x / 10.0 - point.mm.y) / 1.01f64.sqrt();
        assert!((to_border_mm - 3.0).abs() < 0.06, "{to_border_mm} mm at {point:?}");
    }
}

/// On a cylinder, rows along the axis are r' apart around the circumference, on which a distance is 400 mm times the
/// angle.
#[test]
fn the_step_over_holds_around_a_cylinder() {
    let (fit, _, _, settings) = fitted(Shape::Cylinder, ScanDefects::default(), "[path]\nstep_over_mm = 12\n");
    // In the region, u runs around the cylinder; with u and v exchanged, rows run along the cylinder's axis.
    let surface = transposed(&fit.surface);
    let raster = raster(&surface, &WHOLE, &settings).expect("rows");
    let around_mm = |point: &Point<Panel>| 400.0 * (point.mm.x / (1_100.0 - point.mm.z)).atan();
    let ends = |v: f64| around_mm(&surface.point(Parameter { u: 0.5, v }));
    let width_mm = (ends(1.0) - ends(0.0)).abs() - 6.0;
    let step_mm = width_mm / (width_mm / 12.0).ceil();
    let rows: Vec<_> = raster.rows.iter().map(|row| points(&surface, row)).collect();
    println!("width {width_mm:.3} mm, {} rows, r' {step_mm:.4} mm", rows.len());
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for pair in rows.windows(2) {
        // On the unrolled cylinder: the distance of a point from the chord between the nearest points of the next row.
        for point in &pair[0][1..pair[0].len() - 1] {
            let flat = |p: &Point<Panel>| nalgebra::Vector2::new(around_mm(p), p.mm.y);
            let here = flat(point);
            let distance = |piece: &[Point<Panel>]| {
                let (a, b) = (flat(&piece[0]), flat(&piece[1]));
                let share = ((here - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
                (here - a - (b - a) * share).norm()
            };
            let nearest = pair[1].windows(2).map(distance).fold(f64::INFINITY, f64::min);
            (least, most) = (least.min(nearest), most.max(nearest));
        }
    }
    println!("around the cylinder {least:.4} to {most:.4} mm");
    assert!(most <= 12.0 && (most / step_mm - 1.0).abs() < 0.01 && (least / step_mm - 1.0).abs() < 0.01);
}

fn transposed(surface: &BSplineSurface) -> BSplineSurface {
    let (rows, columns) = (surface.knots_u().controls(), surface.knots_v().controls());
    let controls = (0..rows * columns).map(|n| surface.controls()[(n % rows) * columns + n / rows]).collect();
    let knots = [surface.knots_v().clone(), surface.knots_u().clone()];
    BSplineSurface::new(knots, controls, Point::at(0.0, 0.0, 0.0)).expect("a surface")
}

/// Compares the distances between successive rows with the r' of each column, on surfaces with every curvature.
#[test]
fn rows_lie_at_the_equal_distance_of_their_column() {
    for shape in SHAPES {
        for angle_deg in [0.0, 90.0] {
            let more = format!("[path]\nfeed_angle_deg = {angle_deg}\nwaypoint_spacing_mm = 4\n");
            let (fit, region, ..) = fitted(shape, ScanDefects::default(), &more);
            let settings = scene::recipe(shape, &more).path().clone();
            let grids: Vec<GridId> = region.ids().collect();
            let plan = plan(&fit.surface, &region, &grids, &[], &settings).expect("a plan");
            let step_over = plan.step_over_mm.expect("rows");
            // The scene's region is a rectangle in x and y. On a plane all columns are equally wide, on other shapes
            // approximately.
            let spread = (step_over.max_mm - step_over.min_mm) / step_over.max_mm;
            println!("{shape:?} {angle_deg}: {step_over:?}");
            assert!(
                step_over.max_mm <= 12.0 * 1.002
                    && spread < if matches!(shape, Shape::Plane) { 0.01 } else { 0.12 }
            );
        }
    }
}

/// A slanted grid with shifted corners, and the settings with which it is treated.
#[derive(Debug, Clone, Copy)]
struct Slanted {
    shift_mm: [f64; 8],
    size_mm: [f64; 2],
    disc_mm: f64,
    /// The step-over as a fraction of the disc's diameter.
    share: f64,
    spacing_mm: f64,
}

impl Slanted {
    /// Checks that rows and waypoints are no farther apart than requested, and that the whole grid is covered.
    fn rows_meet_their_limits(self) -> Result<(), TestCaseError> {
        let Slanted { shift_mm: shift, size_mm: [w, h], disc_mm, share, spacing_mm } = self;
        let surface = quad([
            [shift[0], shift[1]],
            [w + shift[2], shift[3]],
            [w + shift[4], h + shift[5]],
            [shift[6], h + shift[7]],
        ]);
        let step_over_mm = disc_mm * share;
        let settings = settings(&format!(
            "disc_diameter_mm = {disc_mm}\nstep_over_mm = {step_over_mm}\nwaypoint_spacing_mm = {spacing_mm}"
        ));
        let one = one_grid();
        let plan = plan(&surface, &one, &[GridId { row: 1, column: 1 }], &[], &settings).expect("a plan");
        prop_assert!(plan.coverage > 0.999, "{}", plan.coverage);
        if let Some(step_over) = plan.step_over_mm {
            prop_assert!(step_over.max_mm <= 1.01 * step_over_mm, "{:?} of {}", step_over, step_over_mm);
        }
        for pair in plan.paths[0].waypoints.windows(2).filter(|pair| pair[0].contact && pair[1].contact) {
            let step_mm = tool(&pair[0]).origin().distance_mm(tool(&pair[1]).origin());
            prop_assert!(step_mm <= 1.01 * spacing_mm && step_mm > 1e-6, "{}", step_mm);
        }
        Ok(())
    }
}

/// The smallest grid, disc, step-over and distance between waypoints: this case failed in an earlier version.
#[test]
fn the_smallest_rows_meet_their_limits() {
    let smallest =
        Slanted { shift_mm: [0.0; 8], size_mm: [45.0, 45.0], disc_mm: 12.0, share: 0.3, spacing_mm: 3.0 };
    smallest.rows_meet_their_limits().expect("as promised");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn rows_of_slanted_grids_meet_their_limits(
        shift_mm in prop::array::uniform8(-2.5..2.5f64), size_mm in prop::array::uniform2(45.0..90.0f64),
        disc_mm in 12.0..40.0f64, share in 0.3..0.7f64, spacing_mm in 3.0..15.0f64,
    ) {
        Slanted { shift_mm, size_mm, disc_mm, share, spacing_mm }.rows_meet_their_limits()?;
    }
}

/// Expected values, calculated by hand for a patch that is 56 mm wide on one side and 64 mm on the other, with insets
/// of 3 mm. In the middle half of 54 mm remains. With 2 steps of 10.8 mm the innermost ring would end 24.6 mm before
/// the wide side. At that end the patch is 62.0 mm wide, and the sides of the ring are 62.0 − 6 − 43.2 = 12.8 mm apart.
/// With 3 steps of 7.71 mm they are 61.9 − 6 − 46.3 = 9.6 mm apart.
#[test]
fn the_innermost_ring_s_sides_keep_the_step_over_where_the_patch_is_widest() {
    let surface = quad([[0.0, 0.0], [100.0, 0.0], [100.0, 64.0], [0.0, 56.0]]);
    let insets = crate::path::raster::Insets::for_disc(&settings(""));
    let rings = crate::path::lines::PatchRings::new(&surface, &WHOLE, insets, 12.0);
    let [low, high] = rings.innermost_sides();
    let closed = rings.closed().expect("rings");
    assert_eq!(closed.len(), 4);
    let innermost = closed.last().expect("one");
    let sides = [points(&surface, &innermost[low]), points(&surface, &innermost[high])];
    let widest_mm = step_overs_mm(&sides[0], &sides[1]).into_iter().fold(0.0, f64::max);
    assert!((9.0..10.5).contains(&widest_mm), "{widest_mm}");
}

/// Expected value, calculated by hand: a disc of 5 mm radius on a track of 20 mm covers 20·10 + 25π = 278.54 of 2500
/// mm².
#[test]
fn a_straight_track_covers_a_stadium() {
    let surface = rectangle(50.0, 50.0);
    let id = GridId { row: 1, column: 1 };
    let track = [Point::at(15.0, 25.0, 0.0), Point::at(35.0, 25.0, 0.0)];
    let found = coverage(&surface, (id, &WHOLE), &strokes(&track, |_| true), 5.0);
    assert!((found.area_mm2 - 2_500.0).abs() < 1e-6);
    assert!((found.covered_mm2 - 278.54).abs() < 3.0, "{found:?}");
    // A single point is not a motion in contact, neither for the coverage nor for the dwell time.
    assert!(strokes(&track, |index| index == 0).is_empty() && strokes(&track[..1], |_| true).is_empty());
}

/// Expected value, calculated by hand: a disc of 60 mm radius in the middle of r1c1, (−112, −56), would reach 11 mm
/// beyond the edge at y = −105. The lines are moved inwards, and the disc still covers the grid.
#[test]
fn a_large_disc_keeps_inside_the_outline() {
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

/// Expected values, calculated by hand: the panel ends at the border of its region, and the disc must not reach beyond
/// the edge. Therefore the disc's centre stays 15 mm from the edge, and at the corner (1 − π/4) · 15² = 48.3 of 56² mm²
/// remain untreated, 1.54 %.
#[test]
fn places_that_the_outline_excludes_are_reported_as_untreated() {
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
        assert!((plan.grids[0].covered_fraction() - 0.9846).abs() < 0.002, "{pattern}: {:?}", plan.grids);
    }
}

/// Every pattern covers every grid completely, on every shape, and keeps the maximum distance between its lines.
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

/// Expected values, calculated by hand for a disc of 5 mm radius on a track of 20 mm at 10 mm/s. On the track's line,
/// 10 mm from its ends, the dwell time is 1 s; 4 mm beside the line it is 0.6 s. A track there and back has two passes.
#[test]
fn dwell_time_agrees_with_hand_calculation() {
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
    assert!(
        (once.covered_fraction() - 0.1114).abs() < 0.003 && (once.grids[0].untreated_mm2() - 2_221.5).abs() < 8.0
    );
    let back = dwell::ExecutedPose { contact: false, ..at(60.0) };
    let twice = dwell::simulate(&surface, &region, &grids, &[at(15.0), at(35.0), back, at(35.0), at(15.0)], 5.0);
    assert_eq!(sample(&twice, 25, 25).1, 2);
    assert!((twice.grids[0].overlap() - once.covered_fraction()).abs() < 0.04, "{}", twice.grids[0].overlap());
    assert!((sample(&twice, 25, 25).0 - 2.0).abs() < 0.21);
}

/// With every pattern, a disc that is larger than the grid covers the whole grid, in the plan and in the simulation of
/// its poses. If the disc reaches no part of the grid, the result is 0 and not −0.
#[test]
fn a_disc_larger_than_the_grid_covers_it() {
    let region = one_grid();
    let grids: Vec<GridId> = region.ids().collect();
    for pattern in ["raster", "cross-hatch", "spiral", "offset", "offset-spiral"] {
        for side_mm in [2.0, 6.0, 12.0, 20.0] {
            let surface = rectangle(side_mm, side_mm);
            let settings = settings(&format!("disc_diameter_mm = 60\npattern = \"{pattern}\""));
            let plan = plan(&surface, &region, &grids, &[], &settings).expect("a plan");
            let dwell = dwell::simulate(&surface, &region, &grids, &dwell::timed_poses(&plan), 30.0);
            let name = format!("{pattern}, {side_mm} mm");
            assert!(
                plan.coverage == 1.0 && dwell.covered_fraction() == 1.0,
                "{name}: {} {}",
                plan.coverage,
                dwell.covered_fraction()
            );
            assert_eq!(format!("{:.2}", dwell.grids[0].untreated_mm2()), "0.00", "{name}");
            let spread = plan.dwell.expect("treated");
            assert!(spread.low_s > 0.1 && plan.contact_mm >= 15.0 - 1e-9, "{name}: {spread:?} {}", plan.contact_mm);
        }
    }
    let none = dwell::simulate(&rectangle(6.0, 6.0), &region, &grids, &[], 30.0);
    assert_eq!(format!("{:.2} {:.2}", 100.0 * none.covered_fraction(), none.grids[0].overlap()), "0.00 0.00");
    assert!(none.spread().is_none());
}

/// The dwell time of the disc is uniform over a single grid that consists only of border areas, in the plan and in the
/// simulation of its poses. At a constant feed, the recipe's, it would not be uniform.
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

/// The coverage that the plan states agrees with the simulation of its poses.
#[test]
fn the_planned_coverage_agrees_with_the_simulated_path() {
    let (fit, region, outline, settings) = fitted(Shape::Saddle, ScanDefects::default(), "");
    let grids: Vec<GridId> = region.ids().collect();
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let dwell = dwell::simulate(&fit.surface, &region, &grids, &dwell::timed_poses(&plan), 15.0);
    assert!(
        (dwell.covered_fraction() - plan.coverage).abs() < 0.002 && dwell.covered_fraction() > 0.995,
        "{} {}",
        dwell.covered_fraction(),
        plan.coverage
    );
    // With half of the path, the simulation shows the part that is not covered.
    let mut half = dwell::timed_poses(&plan);
    half.truncate(half.len() / 2);
    let executed = dwell::simulate(&fit.surface, &region, &grids, &half, 15.0);
    assert!((0.4..0.7).contains(&executed.covered_fraction()), "{}", executed.covered_fraction());
    let used = disc::DiscWearPlan::compute(&plan, &settings, 0.0);
    assert!((used.swept_mm2 - plan.contact_mm * 30.0).abs() < 1e-6 && !used.is_change_needed());
}

/// A square hole of 44 mm is in the grid beside r2c2, at (207, 150) px. Over the hole the tool is lifted, beside the
/// hole the path does not change, and the part that was not sanded is reported.
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
