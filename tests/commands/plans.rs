//! Tests plans with every pattern, and a rejected plan.

use super::{TEACH, json, keep, panelprep, rendered};
use panelprep::files;
use panelprep::geometry::OrganizedCloud;
use serde_json::{Value, json as value};

/// Every pattern on the rendered cell is accepted, for a single grid, adjacent grids and all grids, and the distances
/// between its lines are within the recipe's step-over.
#[test]
fn every_pattern_is_planned_on_the_rendered_cell() {
    let folder = rendered("good");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    let recipe = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("the recipe");
    for pattern in ["raster", "cross-hatch", "spiral", "offset", "offset-spiral"] {
        let text = format!("{recipe}\n[path]\npattern = \"{pattern}\"\n");
        std::fs::write(folder.join("cell/pattern.toml"), text).expect("written");
        for grids in ["--grids r1c1", "--grids r2c2,r2c3,r3c2", ""] {
            let (exit, plan) =
                json(folder, &format!("plan --cell cell/cell.toml --recipe cell/pattern.toml {grids}"));
            assert_eq!(
                (exit, plan["verdict"].as_str()),
                (0, Some("accept")),
                "{pattern} {grids}: {}",
                plan["reasons"]
            );
            let (step, coverage) = (plan["step_over_mm"]["max"].as_f64(), plan["coverage"].as_f64());
            assert!(step.is_some_and(|mm| mm <= 12.0) && coverage.is_some_and(|share| share >= 0.995), "{pattern}");
            assert!(plan["duration_s"].as_f64().is_some_and(f64::is_finite), "{pattern}");
            assert!(plan["dwell_ratio"].as_f64().is_some_and(|ratio| ratio <= 2.0), "{pattern} {grids}");
        }
    }
}

/// No program is written from a rejected plan, and an existing program is not used instead.
#[test]
fn a_rejected_plan_becomes_no_program() {
    let folder = rendered("good");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    let far = value!({"x_mm": 700.0, "y_mm": 0.0, "z_mm": 0.0, "a_deg": 0.0, "b_deg": 0.0, "c_deg": 0.0});
    keep(folder, "far.json", &far);
    let plan = "plan --cell cell/cell.toml --recipe cell/recipe.toml --grids r1c1 --krl sand.src";
    let (exit, refused) = json(folder, &format!("{plan} --located far.json"));
    assert_eq!(
        (exit, refused["verdict"].as_str(), &refused["krl"]),
        (1, Some("reject"), &Value::Null),
        "{refused}"
    );
    assert!(!folder.join("sand.src").exists());
    assert_eq!(json(folder, plan).0, 0);
    let earlier = std::fs::read(folder.join("sand.src")).expect("the program");
    let reported = panelprep(folder, &format!("{plan} --located far.json"));
    let reported = String::from_utf8_lossy(&reported.stdout).into_owned();
    assert!(
        reported.contains("no program was written to sand.src") && reported.contains("from an earlier plan"),
        "{reported}"
    );
    assert_eq!(std::fs::read(folder.join("sand.src")).expect("the program"), earlier);
    for (name, word) in [("sand.txt", ".src"), ("while.src", "not a reserved word")] {
        let output = panelprep(folder, &plan.replace("sand.src", name));
        assert_eq!(output.status.code(), Some(2), "{name}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(word), "{name}");
    }
}

/// The region has a hole in the middle, through which the background is visible. `teach` reports the hole with its size
/// and grid, and does not report a fault of the camera; `check` with the cell's file reports the same after teaching.
#[test]
fn a_hole_under_the_region_is_named_by_teach_and_check() {
    let folder = rendered("good");
    let folder = folder.path();
    let check = "check cell/cell.toml cell/recipe.toml";
    assert_eq!(json(folder, check).1["files"][1]["warnings"], serde_json::json!([]), "nothing was taught yet");
    let recipe: toml::Table =
        std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("a recipe").parse().expect("TOML");
    let corners = recipe["region"]["corners_px"].as_array().expect("corners").clone();
    let number =
        |value: &toml::Value| value.as_float().or(value.as_integer().map(|whole| whole as f64)).expect("px");
    let mean = |axis: usize| corners.iter().map(|corner| number(&corner[axis])).sum::<f64>() / 4.0;
    let file = folder.join("cell/taught_scan.pcd");
    let cloud = files::read_any_cloud(&std::fs::read(&file).expect("a scan"), None).expect("a scan");
    let (width, height) = (cloud.width(), cloud.height());
    // The hole is half-way from the region's middle to its first corner, because the search for the panel uses the
    // middle.
    let middle_px = [0, 1].map(|axis| (mean(axis) + number(&corners[0][axis])) / 2.0);
    let (middle, half) = (middle_px.map(|px| px.round() as usize), 7);
    let is_hole =
        |index: usize| (index % width).abs_diff(middle[0]) <= half && (index / width).abs_diff(middle[1]) <= half;
    let points = cloud.raw_points_mm().iter().enumerate();
    // The background is visible through the hole: on the same ray, at 1.2 times the distance.
    let points = points.map(|(index, &at)| if is_hole(index) { at.map(|mm| 1.2 * mm) } else { at }).collect();
    let holed = OrganizedCloud::new(width, height, points, cloud.picture().rgb).expect("organised");
    std::fs::write(&file, files::write_pcd(&holed)).expect("written");

    let (exit, output) = json(folder, TEACH);
    let codes: Vec<&str> = output["reasons"]
        .as_array()
        .expect("reasons")
        .iter()
        .filter_map(|reason| reason["code"].as_str())
        .collect();
    assert_eq!((exit, &output["verdict"], codes), (1, &"review".into(), vec!["region_over_hole"]), "{output}");
    let found = &output["region_off_panel"][0];
    let [size_mm, u] = [&found["size_mm"], &found["at_px"][0]].map(|value| value.as_f64().expect("a number"));
    assert!((25.0..60.0).contains(&size_mm) && (u - middle_px[0]).abs() < 2.0, "{found}");
    let (_, output) = json(folder, check);
    let warning = &output["files"][1]["warnings"][0];
    assert_eq!(warning["key"], "region.corners_px", "{output}");
    assert!(
        warning["message"].as_str().is_some_and(|words| words.contains("the region has a hole of ")),
        "{warning}"
    );
}
