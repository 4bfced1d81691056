//! Rasters, poses and plans on surfaces that can be checked by hand, and on fitted ones.

use super::coverage::{coverage, strokes};
use super::*;
use crate::geometry::{Degrees, KukaPose, Panel, Point, Rigid, Tool};
use crate::panel::{GridId, Region};
use crate::recipe;
use crate::surface::scene::{self, SHAPES, Shape, Spoil, taught};
use crate::surface::{BSplineSurface, Fit, KnotVector, Parameter, Patch, fit};
use crate::verdict::Verdict;
use nalgebra::Vector3;
use proptest::prelude::*;

const WHOLE: Patch = Patch { low: Parameter { u: 0.0, v: 0.0 }, high: Parameter { u: 1.0, v: 1.0 } };

/// The bilinear surface between four corners in the plane z = 0, from the first to the second along u, seen from +z.
fn quad(corners_mm: [[f64; 2]; 4]) -> BSplineSurface {
    let knots = || KnotVector::uniform(1, 1, 0.0..=1.0).expect("open");
    let [a, b, c, d] = corners_mm.map(|[x, y]| Point::at(x, y, 0.0));
    BSplineSurface::new([knots(), knots()], vec![a, d, b, c], Point::at(0.0, 0.0, 500.0)).expect("a surface")
}

fn rectangle(width_mm: f64, height_mm: f64) -> BSplineSurface {
    quad([[0.0, 0.0], [width_mm, 0.0], [width_mm, height_mm], [0.0, height_mm]])
}

fn settings(more: &str) -> recipe::Path {
    scene::recipe(Shape::Plane, &format!("[path]\n{more}\n")).path().clone()
}

fn region() -> Region {
    Region::new(scene::recipe(Shape::Plane, "").region()).expect("convex")
}

fn one_grid() -> Region {
    let mut region = region();
    (region.rows, region.columns) = (1, 1);
    region
}

fn points(surface: &BSplineSurface, places: &[Parameter]) -> Vec<Point<Panel>> {
    places.iter().map(|at| surface.point(*at)).collect()
}

fn tool(waypoint: &Waypoint) -> Rigid<Panel, Tool> {
    waypoint.pose.to_rigid()
}

fn fitted(shape: Shape, spoil: Spoil, more: &str) -> (Fit, Region, Vec<Point<Panel>>, recipe::Path) {
    let recipe = scene::recipe(shape, more);
    let panel = taught(shape, spoil, &recipe);
    let fit = fit(&panel, recipe.surface()).unwrap_or_else(|e| panic!("{e}"));
    (fit, panel.region, panel.outline, recipe.path().clone())
}

/// By hand: disc 30 mm, inset 9 mm; 32 mm are left of 50, at 12 mm in 3 steps of 10.667 mm; rows from 9 to 41 mm in
/// 4 steps of 8 mm; the second row runs back.
#[test]
fn a_square_of_50_mm_has_four_rows() {
    let (surface, settings) = (rectangle(50.0, 50.0), settings(""));
    let raster = raster(&surface, &WHOLE, &settings).expect("rows");
    assert_eq!(raster.rows.len(), 4);
    for (index, row) in raster.rows.iter().enumerate() {
        let row = points(&surface, row);
        assert_eq!(row.len(), 5);
        let (from, to) = if index % 2 == 0 { (9.0, 41.0) } else { (41.0, 9.0) };
        let y = 9.0 + 32.0 / 3.0 * index as f64;
        assert!(row[0].distance_mm(Point::at(from, y, 0.0)) < 1e-6, "{:?}", row[0]);
        assert!(row[4].distance_mm(Point::at(to, y, 0.0)) < 1e-6);
    }
    // Each turn of 10.667 mm gets one waypoint in its middle.
    assert_eq!(raster.track(&surface, settings.waypoint_spacing_mm()).len(), 4 * 5 + 3);
}

/// By hand: below 18 mm there is no room for two insets of 9 mm.
#[test]
fn a_patch_smaller_than_the_disc_gets_one_row_or_one_point() {
    for (width_mm, height_mm, lengths) in
        [(10.0, 10.0, vec![1]), (48.0, 10.0, vec![4]), (10.0, 42.0, vec![1, 1, 1]), (18.0, 18.0, vec![1])]
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

/// By hand: a patch 50 mm wide on one side and 60 on the other has 42 mm at most between its outer rows, 4 steps; at
/// the narrow side they are 8 mm, at the wide one 10.5, and the last row stays 9 mm from the slanted border.
#[test]
fn the_last_row_follows_the_far_border() {
    let surface = quad([[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 50.0]]);
    let raster = raster(&surface, &WHOLE, &settings("")).expect("rows");
    assert_eq!(raster.rows.len(), 5);
    for point in points(&surface, &raster.rows[4]) {
        let to_border_mm = (50.0 + point.mm.x / 10.0 - point.mm.y) / 1.01f64.sqrt();
        assert!((to_border_mm - 9.0).abs() < 0.06, "{to_border_mm} mm at {point:?}");
    }
}

/// By hand: 20 mm of track and a disc of 5 mm radius cover 20·10 + 25π = 278.54 of 2500 mm².
#[test]
fn a_straight_track_covers_a_stadium() {
    let surface = rectangle(50.0, 50.0);
    let id = GridId { row: 1, column: 1 };
    let track = [Point::at(15.0, 25.0, 0.0), Point::at(35.0, 25.0, 0.0)];
    let found = coverage(&surface, (id, &WHOLE), &strokes(&track, |_| true), 5.0);
    assert!((found.area_mm2 - 2_500.0).abs() < 1e-6);
    assert!((found.covered_mm2 - 278.54).abs() < 3.0, "{found:?}");
    let dot = coverage(&surface, (id, &WHOLE), &strokes(&track[..1], |_| true), 5.0);
    assert!(strokes(&track, |index| index == 0).is_empty());
    assert!((dot.covered_mm2 - 78.54).abs() < 2.0, "{dot:?}");
}

/// The cylinder unrolled: rows that run along its axis stand r' apart around it, which is 400 mm times the angle.
#[test]
fn the_step_over_holds_around_a_cylinder() {
    let (fit, _, _, settings) = fitted(Shape::Cylinder, Spoil::default(), "[path]\nstep_over_mm = 12\n");
    // The region's u runs around the cylinder; swapped, rows run along its axis.
    let surface = transposed(&fit.surface);
    let raster = raster(&surface, &WHOLE, &settings).expect("rows");
    let around_mm = |point: &Point<Panel>| 400.0 * (point.mm.x / (1_100.0 - point.mm.z)).atan();
    let ends = |v: f64| around_mm(&surface.point(Parameter { u: 0.5, v }));
    let width_mm = (ends(1.0) - ends(0.0)).abs() - 18.0;
    let step_mm = width_mm / (width_mm / 12.0).ceil();
    let rows: Vec<_> = raster.rows.iter().map(|row| points(&surface, row)).collect();
    println!("width {width_mm:.3} mm, {} rows, r' {step_mm:.4} mm", rows.len());
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for pair in rows.windows(2) {
        // On a developed cylinder: distance of a point to the chord between its neighbours in the next row.
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

#[test]
fn the_tool_stands_on_the_normal_and_turns_gently() {
    let spoil = Spoil { noise_mm: 0.03, flying: 0.01, ..Spoil::default() };
    for (shape, axis) in SHAPES.into_iter().zip(["[0, 0, 0]", "[1, 0, 0]", "[0, 1, 0]", "[0.6, -0.8, 0.1]"]) {
        let (fit, region, outline, settings) = fitted(shape, spoil, &format!("[path]\nreference_axis = {axis}\n"));
        let grids: Vec<GridId> = region.ids().collect();
        let plan = plan(&fit.surface, &region, &grids, &outline, &settings).unwrap_or_else(|e| panic!("{e}"));
        let judgement = judge(&plan, &settings);
        assert_eq!(judgement.verdict, Verdict::Accept, "{shape:?}: {judgement:?}");
        assert!(plan.grids.iter().all(|grid| grid.share() > 0.995), "{shape:?}: {:?}", plan.grids);
        let reference = Vector3::from(settings.reference_axis());
        let (mut angle, mut spin, mut turn) = (0.0f64, 0.0f64, 0.0f64);
        for path in &plan.paths {
            for waypoint in path.waypoints.iter().filter(|waypoint| waypoint.contact) {
                let rotation = tool(waypoint).rotation();
                let normal = shape.normal(tool(waypoint).origin());
                angle = angle.max((-(rotation * Vector3::z())).angle(&normal).to_degrees());
                assert!(shape.distance_mm(tool(waypoint).origin()).abs() < 0.05);
                // X is the reference as seen along the tool: Y has nothing of it.
                spin = spin.max((rotation * Vector3::y()).dot(&reference).abs());
                assert!(reference.norm() == 0.0 || (rotation * Vector3::x()).dot(&reference) > 0.5);
            }
            for pair in path.waypoints.windows(2) {
                turn = turn.max((tool(&pair[0]).inverse() * tool(&pair[1])).turn().0);
            }
        }
        println!("{shape:?}: normals {angle:.3}°, largest turn {turn:.2}°, step-over {:?}", plan.step_over_mm);
        assert!(angle < 0.25 && spin < 1e-9 && turn < 5.0, "{shape:?}: {angle}° {spin} {turn}°");
    }
}

/// By hand: on a plane seen from +z with feed along x, Z = (0, 0, −1), X = (1, 0, 0), Y = Z × X = (0, −1, 0), which is
/// C = 180°; approach and retract stand 40 mm above; 160 mm of contact and 2 · 40 mm of air take 4 s at 60 mm/s, and
/// the six starts and stops at the four ends of the air moves 0.06 s / 2 each at 1000 mm/s².
#[test]
fn a_plan_over_a_plane_by_hand() {
    let (surface, settings) = (rectangle(50.0, 50.0), settings("landing_mm = 0"));
    let one = one_grid();
    let plan = plan(&surface, &one, &[GridId { row: 1, column: 1 }], &[], &settings).expect("a plan");
    let waypoints = &plan.paths[0].waypoints;
    assert_eq!(waypoints.iter().filter(|waypoint| waypoint.contact).count(), 23);
    let first = KukaPose { x_mm: 9.0, y_mm: 9.0, z_mm: 40.0, c_deg: 180.0, ..KukaPose::default() };
    let apart = tool(&waypoints[0]).inverse() * first.to_rigid::<Panel, Tool>();
    assert!(apart.turn() < Degrees(1e-6) && apart.origin().mm.coords.norm() < 1e-6, "{}", waypoints[0].pose);
    assert!(!waypoints[0].contact && waypoints[1].contact && !waypoints[24].contact);
    assert!(
        (plan.length_mm - 240.0).abs() < 1e-6
            && (plan.duration_s - 4.18).abs() < 1e-7
            && (plan.contact_mm - 160.0).abs() < 1e-6
    );
    let step_over = plan.step_over_mm.expect("four rows");
    assert!((step_over.min_mm - 32.0 / 3.0).abs() < 1e-6 && (step_over.max_mm - 32.0 / 3.0).abs() < 1e-6);
    assert!((plan.coverage - 1.0).abs() < 1e-12);
}

#[test]
fn a_reference_along_the_normal_is_refused() {
    let surface = rectangle(50.0, 50.0);
    let place = Parameter { u: 0.5, v: 0.5 };
    let refused = panel_from_tool(&surface, place, 0.0, Stance::of(&settings("reference_axis = [0.05, 0, -1]")));
    assert!(
        matches!(refused, Err(OrientationError::ReferenceAlongNormal { angle }) if (angle.0 - 2.862).abs() < 0.01)
    );
    assert!(panel_from_tool(&surface, place, 0.0, Stance::of(&settings("reference_axis = [0.2, 0, -1]"))).is_ok());
}

#[test]
fn grids_that_are_not_there_or_twice_are_refused() {
    let region = region();
    let surface = rectangle(280.0, 168.0);
    let asked = |grids: &[&str]| {
        let grids: Vec<GridId> = grids.iter().map(|id| id.parse().expect("a grid")).collect();
        plan(&surface, &region, &grids, &[], &settings("")).map(|_| ())
    };
    assert_eq!(asked(&[]), Err(PlanError::NoGrids));
    assert!(matches!(asked(&["r1c1", "r4c1"]), Err(PlanError::UnknownGrid { rows: 3, columns: 5, .. })));
    assert!(matches!(asked(&["r1c1", "r2c1", "r1c1"]), Err(PlanError::Repeated { .. })));
}

fn good_plan() -> (Plan, recipe::Path) {
    let (surface, settings) = (rectangle(280.0, 168.0), settings(""));
    let region = region();
    let corner = |n: usize| {
        let along = (n % 50) as f64 / 50.0;
        let (x, y) = [(along, 0.0), (1.0, along), (1.0 - along, 1.0), (0.0, 1.0 - along)][n / 50];
        Point::at(-20.0 + 320.0 * x, -20.0 + 208.0 * y, 0.0)
    };
    let outline: Vec<Point<Panel>> = (0..200).map(corner).collect();
    let grids = ["r1c1", "r1c4", "r3c2"].map(|id| id.parse().expect("a grid"));
    (plan(&surface, &region, &grids, &outline, &settings).expect("a plan"), settings)
}

/// One planted defect each; the plan without one is accepted.
#[test]
fn every_planted_defect_has_its_reason() {
    let (good, settings) = good_plan();
    assert_eq!(judge(&good, &settings).verdict, Verdict::Accept, "{:?}", judge(&good, &settings));
    let planted = |spoil: fn(&mut Plan)| {
        let mut plan = good.clone();
        spoil(&mut plan);
        let judgement = judge(&plan, &settings);
        (judgement.verdict, judgement.reasons.first().map(|reason| reason.code.clone()))
    };
    let reject = |code: &'static str| (Verdict::Reject, Some(code.into()));
    assert_eq!(planted(|plan| plan.paths[1].waypoints[7].pose.b_deg = f64::NAN), reject("not_finite"));
    assert_eq!(planted(|plan| plan.paths[1].waypoints[20].pose.x_mm += 9.0), reject("large_step"));
    assert_eq!(planted(|plan| plan.paths[2].waypoints[30].pose.a_deg += 16.0), reject("large_turn"));
    assert_eq!(planted(|plan| plan.paths[0].waypoints[0].contact = true), reject("no_air"));
    let review = |code: &'static str| (Verdict::Review, Some(code.into()));
    assert_eq!(planted(|plan| plan.grids[1].covered_mm2 *= 0.94), review("coverage"));
    assert_eq!(planted(|plan| plan.overhang.largest_mm = 2.1), review("edge_overhang"));
}

/// By hand: a pad of 6 mm takes up 2 mm of error.
#[test]
fn a_press_in_needs_a_pad_that_takes_up_the_error() {
    let pressed = settings("press_in_mm = 2\npad_stroke_mm = 6");
    assert_eq!(judge_pad(&pressed, Some(2.0)).verdict, Verdict::Accept);
    assert_eq!(judge_pad(&pressed, Some(2.01)).reasons[0].code, "pad_stroke");
    assert_eq!(judge_pad(&pressed, None).verdict, Verdict::Reject);
    assert_eq!(judge_pad(&settings(""), None).verdict, Verdict::Accept, "nothing is pressed");
}

/// From one grid to another the tool flies at 40 mm, on a cylinder as well.
#[test]
fn between_grids_the_tool_stays_above_the_surface() {
    let (fit, region, outline, settings) = fitted(Shape::Cylinder, Spoil::default(), "[path]\nlanding_mm = 0\n");
    let grids = ["r1c1", "r3c5"].map(|id| id.parse().expect("a grid"));
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let flown: Vec<_> = plan.paths[1].waypoints.iter().take_while(|waypoint| !waypoint.contact).collect();
    assert!(flown.len() > 15);
    for waypoint in flown {
        assert!((Shape::Cylinder.distance_mm(tool(waypoint).origin()) - 40.0).abs() < 0.3);
    }
}

/// By hand: a disc of 60 mm radius in the middle of r1c1, (−112, −56), would reach 11 mm over the edge at y = −105; it
/// moves inwards and still covers the grid.
#[test]
fn a_large_disc_keeps_off_the_outline_where_it_can() {
    let (fit, region, outline, settings) =
        fitted(Shape::Plane, Spoil::default(), "[path]\ndisc_diameter_mm = 120\nstep_over_mm = 12\n");
    let plan =
        plan(&fit.surface, &region, &["r1c1".parse().expect("a grid")], &outline, &settings).expect("a plan");
    assert_eq!(judge(&plan, &settings).verdict, Verdict::Accept, "{:?}", judge(&plan, &settings));
    assert!((1.9..2.02).contains(&plan.overhang.largest_mm), "{:?}", plan.overhang);
}

/// By hand: the panel ends where its region does and the disc may not reach over the edge: its middle keeps 15 mm off,
/// and of the corner (1 − π/4) · 15² = 48.3 of 56² mm² stay, 1.54 %.
#[test]
fn what_the_outline_forbids_is_left_and_said() {
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
        assert!(plan.overhang.largest_mm < 0.02, "{pattern}: {:?}", plan.overhang);
        assert_eq!((judgement.verdict, &*judgement.reasons[0].code), (Verdict::Review, "coverage"), "{pattern}");
        assert!((plan.grids[0].share() - 0.9846).abs() < 0.002, "{pattern}: {:?}", plan.grids);
    }
}

/// Every pattern reaches all of every grid, on every shape, and keeps its distance.
#[test]
fn every_pattern_covers_the_region() {
    for (shape, more) in
        SHAPES.into_iter().zip(["feed_angle_deg = 90", "feed_angle_deg = 30", "", "feed_angle_deg = -45"])
    {
        for pattern in ["raster", "cross-hatch", "spiral", "offset", "offset-spiral"] {
            let more = format!("[path]\npattern = \"{pattern}\"\n{more}\n");
            let (fit, region, outline, settings) = fitted(shape, Spoil::default(), &more);
            let grids: Vec<GridId> =
                ["r1c1", "r1c2", "r2c1", "r2c2", "r3c4"].map(|id| id.parse().expect("a grid")).into();
            let plan = plan(&fit.surface, &region, &grids, &outline, &settings).unwrap_or_else(|e| panic!("{e}"));
            let judgement = judge(&plan, &settings);
            println!("{shape:?} {pattern}: {:.4}, {:?}", plan.coverage, plan.step_over_mm);
            assert_eq!(judgement.verdict, Verdict::Accept, "{shape:?} {pattern}: {judgement:?}");
            assert_eq!(plan.paths.len(), 2, "{shape:?} {pattern}");
            let step_over = plan.step_over_mm.expect("lines side by side");
            assert!(step_over.max_mm < 12.0 * 1.01, "{shape:?} {pattern}: {step_over:?}");
        }
    }
}

/// Distances between neighbouring rows, each beside the r' of its own column, on surfaces with every curvature.
#[test]
fn rows_stand_at_the_equal_distance_of_their_column() {
    for shape in SHAPES {
        for angle_deg in [0.0, 90.0] {
            let more = format!("[path]\nfeed_angle_deg = {angle_deg}\nwaypoint_spacing_mm = 4\n");
            let (fit, region, ..) = fitted(shape, Spoil::default(), &more);
            let settings = scene::recipe(shape, &more).path().clone();
            let grids: Vec<GridId> = region.ids().collect();
            let plan = plan(&fit.surface, &region, &grids, &[], &settings).expect("a plan");
            let step_over = plan.step_over_mm.expect("rows");
            // The scene's region is a rectangle in x and y: all columns of a plane are equally wide, others nearly so.
            let spread = (step_over.max_mm - step_over.min_mm) / step_over.max_mm;
            println!("{shape:?} {angle_deg}: {step_over:?}");
            assert!(
                step_over.max_mm <= 12.0 * 1.002
                    && spread < if matches!(shape, Shape::Plane) { 0.01 } else { 0.12 }
            );
        }
    }
}

/// By hand: the chord of a cylinder of 400 mm radius leaves it by s² / 8R; 0.02 mm allow 8 mm.
#[test]
fn waypoints_come_closer_where_the_panel_bends() {
    let (fit, region, outline, settings) =
        fitted(Shape::Cylinder, Spoil::default(), "[path]\nchord_error_mm = 0.02\nplanning_time_ms = 200\n");
    let grids: Vec<GridId> = region.ids().collect();
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let contact: Vec<_> = plan.paths[0].waypoints.iter().filter(|waypoint| waypoint.contact).collect();
    let steps: Vec<f64> =
        contact.windows(2).map(|pair| tool(pair[0]).origin().distance_mm(tool(pair[1]).origin())).collect();
    let longest = steps.iter().copied().fold(0.0, f64::max);
    assert!((7.7..8.05).contains(&longest), "{longest}");
    // 8 mm in 200 ms are 40 mm/s: slower than the recipe's 60.
    for (pair, step) in contact.windows(2).zip(&steps) {
        assert!((pair[1].feed_mm_s - step / 0.2).abs() < 1e-9, "{} after {step} mm", pair[1].feed_mm_s);
        assert!(pair[1].blend_mm <= 0.2 * step + 1e-9);
    }
}

/// By hand: the disc comes down over 15 mm along the surface from 3 mm above it, goes 1.5 mm in and leaves the same way.
#[test]
fn the_disc_lands_and_leaves_while_it_moves() {
    let (surface, settings) = (rectangle(50.0, 50.0), settings("press_in_mm = 1.5\npad_stroke_mm = 5"));
    let plan = plan(&surface, &one_grid(), &["r1c1".parse().expect("a grid")], &[], &settings).expect("a plan");
    let path = &plan.paths[0].waypoints;
    let place = |n: usize| tool(&path[n]).origin().mm;
    let last = path.len() - 1;
    for [air, low, on] in [[0, 1, 2], [last, last - 1, last - 2]] {
        assert!(!path[air].contact && !path[low].contact && path[on].contact);
        assert!(
            (place(air).z - 40.0).abs() < 1e-9
                && (place(low).z - 3.0).abs() < 1e-9
                && (place(on).z + 1.5).abs() < 1e-9
        );
        assert!(((place(low) - place(on)).xy().norm() - 15.0).abs() < 1e-9);
        assert!(path[on].blend_mm > 0.0, "no stop on the panel");
        assert!(
            (place(low) - nalgebra::Point3::new(25.0, 25.0, 0.0)).xy().norm()
                < (place(on).xy() - nalgebra::Point2::new(25.0, 25.0)).norm()
        );
    }
    assert_eq!((path[0].blend_mm, path[last].blend_mm), (0.0, 0.0));
}

/// By hand: 20 mm of track at 10 mm/s under a disc of 5 mm radius: a place on the track's line, 10 mm from its ends,
/// lies under the disc for 1 s, one beside it by 4 mm for 0.6 s; there and back is two passes.
#[test]
fn dwell_by_hand() {
    let (surface, region) = (rectangle(50.0, 50.0), one_grid());
    let pose = |x: f64| KukaPose { x_mm: x, y_mm: 25.0, c_deg: 180.0, ..KukaPose::default() }.to_rigid();
    let at = |x: f64| dwell::Executed { panel_from_tool: pose(x), seconds: 2.0, contact: true };
    let grids: Vec<GridId> = region.ids().collect();
    let once = dwell::simulate(&surface, &region, &grids, &[at(15.0), at(35.0)], 5.0);
    let sample = |dwell: &dwell::Dwell, x: usize, y: usize| {
        let grid = &dwell.grids[0];
        (f64::from(grid.dwell_s[y * grid.columns + x]), grid.passes[y * grid.columns + x])
    };
    assert!((sample(&once, 25, 25).0 - 1.0).abs() < 0.11 && (sample(&once, 25, 28).0 - 0.7).abs() < 0.11);
    assert_eq!((sample(&once, 25, 25).1, sample(&once, 25, 31)), (1, (0.0, 0)));
    // The stadium of 20 · 10 + 25π = 278.5 of 2500 mm².
    assert!((once.share() - 0.1114).abs() < 0.003 && (once.grids[0].left_mm2() - 2_221.5).abs() < 8.0);
    let back = dwell::Executed { contact: false, ..at(60.0) };
    let twice = dwell::simulate(&surface, &region, &grids, &[at(15.0), at(35.0), back, at(35.0), at(15.0)], 5.0);
    assert_eq!(sample(&twice, 25, 25).1, 2);
    assert!((twice.grids[0].overlap() - once.share()).abs() < 0.04, "{}", twice.grids[0].overlap());
    assert!((sample(&twice, 25, 25).0 - 2.0).abs() < 0.21);
}

/// The plan's own coverage and the simulation of its poses agree.
#[test]
fn what_is_planned_is_what_the_simulated_path_covers() {
    let (fit, region, outline, settings) = fitted(Shape::Saddle, Spoil::default(), "");
    let grids: Vec<GridId> = region.ids().collect();
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let dwell = dwell::simulate(&fit.surface, &region, &grids, &dwell::planned(&plan), 15.0);
    assert!(
        (dwell.share() - plan.coverage).abs() < 0.002 && dwell.share() > 0.995,
        "{} {}",
        dwell.share(),
        plan.coverage
    );
    // Half of the path: what is left is seen.
    let mut half = dwell::planned(&plan);
    half.truncate(half.len() / 2);
    let executed = dwell::simulate(&fit.surface, &region, &grids, &half, 15.0);
    assert!((0.4..0.7).contains(&executed.share()), "{}", executed.share());
    let picture = executed.picture(&region, dwell.longest_s());
    assert!(picture.rgb.contains(&[210, 40, 30]) && picture.rgb.len() > 100_000);
    let used = disc::DiscUse::of(&plan, &settings, 0.0);
    assert!((used.swept_mm2 - plan.contact_mm * 30.0).abs() < 1e-6 && !used.asks_for_a_change());
}

/// A square hole of 44 mm in r2c2's neighbour at (207, 150) px: over it the tool is lifted, beside it nothing changes,
/// and what was not abraded is said.
#[test]
fn the_tool_is_lifted_over_a_hole() {
    let spoil = Spoil { hole_px: 14.0, ..Spoil::default() };
    let (fit, region, outline, settings) = fitted(Shape::Plane, spoil, "[surface]\nmax_hole_mm = 60\n");
    let holes = fit.map.holes(&region, settings.lift_hole_mm());
    let grids: Vec<GridId> = region.ids().collect();
    let lifted = plan_around(&fit.surface, &region, &grids, (&outline, &holes), &settings).expect("a plan");
    let whole = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let (mut over, mut beside) = (0, 0);
    for waypoint in &lifted.paths[0].waypoints {
        let pixel = scene::LENS
            .project(Point::<crate::geometry::Camera>::new(tool(waypoint).origin().mm))
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

/// The tool leans about its own axes, and its point stays where it was.
#[test]
fn lead_and_tilt_lean_the_tool_about_its_point() {
    let surface = rectangle(50.0, 50.0);
    let at = Parameter { u: 0.5, v: 0.5 };
    let upright = panel_from_tool(&surface, at, 0.0, Stance::of(&settings(""))).expect("a pose");
    let leaning = panel_from_tool(&surface, at, 0.0, Stance::of(&settings("lead_deg = 5"))).expect("a pose");
    assert!(leaning.origin().distance_mm(upright.origin()) < 1e-12);
    assert!(((upright.inverse() * leaning).turn().0 - 5.0).abs() < 1e-9);
    // By hand: Z = (0, 0, −1), X = (1, 0, 0); a lead of 5° turns Z towards X.
    let z = leaning.rotation() * Vector3::z();
    assert!((z - Vector3::new(5.0f64.to_radians().sin(), 0.0, -5.0f64.to_radians().cos())).norm() < 1e-9, "{z}");
}

#[test]
fn the_krl_program_is_as_written() {
    let surface = rectangle(12.0, 12.0);
    let one = one_grid();
    let straight = settings("landing_mm = 0");
    let plan = plan(&surface, &one, &[GridId { row: 1, column: 1 }], &[], &straight).expect("a plan");
    let panel = KukaPose { x_mm: 600.5, a_deg: -1.25, ..KukaPose::default() };
    let text = krl(&"PANEL_1".parse().expect("a name"), &plan, Some(panel), &settings(""));
    let expected = "\
&ACCESS RVP
&REL 1
DEF PANEL_1()
; Sanding paths in the frame of the panel. Check $TOOL, run in T1 first.
BAS(#INITMOV, 0)
; $TOOL = TOOL_DATA[1] ; the sanding tool, Z out of the pad
$BASE = {X 600.500, Y 0.000, Z 0.000, A -1.2500, B 0.0000, C 0.0000} ; where the panel stands
$ACC.CP = 1.000 ; m/s2
PTP $AXIS_ACT ; block coincidence, no motion
; grid r1c1
$VEL.CP = 0.0600 ; m/s
LIN {X 6.000, Y 6.000, Z 40.000, A 0.0000, B 0.0000, C 180.0000}
; contact
LIN {X 6.000, Y 6.000, Z 0.000, A 0.0000, B 0.0000, C 180.0000}
; air
LIN {X 6.000, Y 6.000, Z 40.000, A 0.0000, B 0.0000, C 180.0000}
END
";
    assert_eq!(text.replace("-0.0000", "0.0000").replace("-180.0000", "180.0000"), expected);
    for wrong in ["", "1st", "a b", "größe", "a_name_longer_than_24_chars"] {
        assert!(wrong.parse::<ProgramName>().is_err(), "{wrong}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// On any slanted grid: rows no farther apart than asked for, waypoints no farther apart than asked for, and
    /// nothing of the grid left out.
    #[test]
    fn rows_hold_what_they_promise(
        shift in prop::array::uniform8(-2.5..2.5f64), size in prop::array::uniform2(45.0..90.0f64),
        disc_mm in 12.0..40.0f64, share in 0.3..0.7f64, spacing_mm in 3.0..15.0f64,
    ) {
        let [w, h] = size;
        let surface = quad([
            [shift[0], shift[1]], [w + shift[2], shift[3]], [w + shift[4], h + shift[5]], [shift[6], h + shift[7]],
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
    }
}
