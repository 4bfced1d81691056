//! The tool's orientation along a path: on the normal, landing, between areas, leaning.

use super::*;

#[test]
fn the_tool_is_on_the_normal_and_turns_gently() {
    let spoil = ScanDefects { noise_mm: 0.03, flying: 0.01, ..ScanDefects::default() };
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
                // X is the reference projected perpendicular to the tool's axis: Y has no component along the
                // reference.
                spin = spin.max((rotation * Vector3::y()).dot(&reference).abs());
                assert!(reference.norm() == 0.0 || (rotation * Vector3::x()).dot(&reference) > 0.5);
            }
            for pair in path.waypoints.windows(2) {
                turn = turn.max((tool(&pair[0]).inverse() * tool(&pair[1])).rotation_angle().0);
            }
        }
        println!("{shape:?}: normals {angle:.3}°, largest turn {turn:.2}°, step-over {:?}", plan.step_over_mm);
        assert!(angle < 0.25 && spin < 1e-9 && turn < 5.0, "{shape:?}: {angle}° {spin} {turn}°");
    }
}

#[test]
fn a_reference_along_the_normal_is_refused() {
    let surface = rectangle(50.0, 50.0);
    let place = Parameter { u: 0.5, v: 0.5 };
    let refused = panel_from_tool(
        &surface,
        place,
        0.0,
        ToolOrientation::from_settings(&settings("reference_axis = [0.05, 0, -1]")),
    );
    assert!(
        matches!(refused, Err(OrientationError::ReferenceAlongNormal { angle }) if (angle.0 - 2.862).abs() < 0.01)
    );
    assert!(
        panel_from_tool(
            &surface,
            place,
            0.0,
            ToolOrientation::from_settings(&settings("reference_axis = [0.2, 0, -1]"))
        )
        .is_ok()
    );
}

/// Between two grids, the tool moves through the air at 40 mm, also above a cylinder.
#[test]
fn between_grids_the_tool_stays_above_the_surface() {
    let (fit, region, outline, settings) =
        fitted(Shape::Cylinder, ScanDefects::default(), "[path]\nlanding_mm = 0\n");
    let grids = ["r1c1", "r3c5"].map(|id| id.parse().expect("a grid"));
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let flown: Vec<_> = plan.paths[1].waypoints.iter().take_while(|waypoint| !waypoint.contact).collect();
    assert!(flown.len() > 15);
    for waypoint in flown {
        assert!((Shape::Cylinder.distance_mm(tool(waypoint).origin()) - 40.0).abs() < 0.3);
    }
}

/// Calculated by hand: the chord of a cylinder of 400 mm radius deviates from the cylinder by s² / 8R; 0.02 mm
/// allow 8 mm.
#[test]
fn waypoints_come_closer_where_the_panel_bends() {
    let (fit, region, outline, settings) =
        fitted(Shape::Cylinder, ScanDefects::default(), "[path]\nchord_error_mm = 0.02\nplanning_time_ms = 200\n");
    let grids: Vec<GridId> = region.ids().collect();
    let plan = plan(&fit.surface, &region, &grids, &outline, &settings).expect("a plan");
    let contact: Vec<_> = plan.paths[0].waypoints.iter().filter(|waypoint| waypoint.contact).collect();
    let steps: Vec<f64> =
        contact.windows(2).map(|pair| tool(pair[0]).origin().distance_mm(tool(pair[1]).origin())).collect();
    let longest = steps.iter().copied().fold(0.0, f64::max);
    assert!((7.7..8.05).contains(&longest), "{longest}");
    // 8 mm in 200 ms are 40 mm/s: slower than the recipe's 60 mm/s.
    for (pair, step) in contact.windows(2).zip(&steps) {
        assert!(pair[1].feed_mm_s <= step / 0.2 + 1e-9, "{} after {step} mm", pair[1].feed_mm_s);
        assert!(pair[1].blend_mm <= 0.2 * step + 1e-9);
    }
}

/// Calculated by hand: the disc lands over 15 mm along the surface, from 3 mm above it, presses in by 1.5 mm and
/// retracts in the same way.
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

/// The tool leans about its own axes, and its point does not move.
#[test]
fn lead_and_tilt_lean_the_tool_about_its_point() {
    let surface = rectangle(50.0, 50.0);
    let at = Parameter { u: 0.5, v: 0.5 };
    let upright =
        panel_from_tool(&surface, at, 0.0, ToolOrientation::from_settings(&settings(""))).expect("a pose");
    let leaning = panel_from_tool(&surface, at, 0.0, ToolOrientation::from_settings(&settings("lead_deg = 5")))
        .expect("a pose");
    assert!(leaning.origin().distance_mm(upright.origin()) < 1e-12);
    assert!(((upright.inverse() * leaning).rotation_angle().0 - 5.0).abs() < 1e-9);
    // Calculated by hand: Z = (0, 0, −1), X = (1, 0, 0); a lead of 5° rotates Z towards X.
    let z = leaning.rotation() * Vector3::z();
    assert!((z - Vector3::new(5.0f64.to_radians().sin(), 0.0, -5.0f64.to_radians().cos())).norm() < 1e-9, "{z}");
}
