//! Tests whole cycles, each with one command: on a rendered cell, and of the demonstration.

use super::{json, rendered, taught_and_verified};
use panelprep::store::Store;
use serde_json::{Value, json as value};

/// Runs the live cycle on the simulated cell, over sockets and in virtual time: the film breaks, the grids are sanded,
/// the next film passes.
#[test]
fn a_whole_cycle_passes_after_an_abrasion() {
    let folder = rendered("good");
    taught_and_verified(folder.path());
    let cycle = "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3";
    let (exit, ended) = json(folder.path(), cycle);
    assert_eq!((exit, ended["verdict"].as_str()), (0, Some("pass")), "{ended}");
    assert!(ended["abraded"].as_array().is_some_and(|grids| !grids.is_empty()), "{ended}");
    let page =
        std::fs::read_to_string(folder.path().join(ended["report"].as_str().expect("a file"))).expect("the page");
    assert!(
        page.contains("released / not released") && page.contains("start: done, with at most 2 sanding passes"),
        "{page}"
    );
    let (exit, ended) = json(folder.path(), &format!("{cycle} --scene clean"));
    assert_eq!((exit, ended["verdict"].as_str()), (0, Some("pass")), "{ended}");
    assert_eq!(ended["abraded"].as_array().map(Vec::len), Some(0), "no contact with a clean panel: {ended}");
    let (exit, ended) = json(folder.path(), &format!("{cycle} --scene no-panel"));
    assert_eq!((exit, ended["verdict"].as_str()), (1, Some("reject")), "{ended}");
    // An air-run of the whole region: no film is captured, and no grid is sanded.
    let air = cycle.replace("cycle --cell", "air-run --cell");
    let (exit, ended) = json(folder.path(), &air);
    assert_eq!((exit, ended["verdict"].as_str()), (0, Some("pass")), "{ended}");
    assert_eq!(ended["abraded"].as_array().map(Vec::len), Some(0), "{ended}");
    let page =
        std::fs::read_to_string(folder.path().join(ended["report"].as_str().expect("a file"))).expect("the page");
    assert!(page.contains("air-run: done, with at most") && !page.contains("The abrasion</h"), "{page}");
}

/// Runs the demonstration as `make demo` does at full size, and another seed at half the size; `make bench-seeds` runs
/// ten more seeds.
#[test]
fn the_demo_of_the_readme_reaches_every_minimum() {
    for command in ["demo --out demo", "demo --seed 2 --reduction 2 --out demo"] {
        reaches_every_minimum(command);
    }
}

fn reaches_every_minimum(command: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let (exit, result) = json(folder.path(), command);
    assert_eq!((exit, result["verdict"].as_str()), (0, Some("pass")), "{result}");
    let number = |pointer: &str| result.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
    assert!(number("/locate/error_max_mm") < 0.5 && number("/refine/error_max_mm") < 0.5, "{result}");
    let inspect = result["inspect"].as_array().expect("inspections");
    assert!(inspect.len() >= 2, "{result}");
    assert!(number("/inspect/0/grids_true") > 0.0 && number("/inspect/0/iou") > 0.94, "{result}");
    assert!(inspect.iter().all(|one| one["grids_failed"] == one["grids_true"]), "{result}");
    assert!(inspect.iter().all(|one| one["grids_wrong"] == 0), "{result}");
    assert_eq!((&inspect[0]["pass"], &inspect[inspect.len() - 1]["pass"]), (&value!(false), &value!(true)));
    assert!(number("/abrade/0/waypoints") > 10.0, "{result}");
    assert_eq!(result["abrade"][0]["waypoints"], result["abrade"][0]["waypoints_done"]);
    assert!(number("/abrade/0/coverage") >= 0.95 && number("/abrade/0/normal_error_max_deg") <= 1.0, "{result}");
    assert!(number("/abrade/0/surface_error_max_mm") <= 1.0, "{result}");
    let step = (number("/abrade/0/step_over_mm/min"), number("/abrade/0/step_over_mm/max"));
    assert!(5.0 < step.0 && step.0 <= step.1 && step.1 < 12.5, "{result}");
    assert!(number("/budget_mm/locate") > 0.0 && number("/budget_mm/fit") > 0.0, "{result}");
    // The boards were captured and touched before, so no component of the error budget is missing.
    let parts = ["hand_eye", "locate", "fit", "robot"].map(|part| number(&format!("/budget_mm/{part}")));
    let total_mm = parts.iter().map(|mm| mm * mm).sum::<f64>().sqrt();
    assert!(total_mm < 0.6 && (number("/budget_mm/total") - total_mm).abs() < 1e-9, "{result}");
    let page = std::fs::read_to_string(folder.path().join("demo/index.html")).expect("the page");
    assert!(page.matches("<img").count() >= 8 && !page.contains("src=\"http"), "the page holds its pictures");
    let pictures = std::fs::read_dir(folder.path().join("demo/pictures")).expect("the pictures").count();
    assert_eq!(page.matches("<img").count(), pictures);
}

/// The arm does not move to a panel that is missing or is another panel.
#[test]
fn the_demo_rejects_a_wrong_panel_without_a_move_toward_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let (exit, result) = json(folder.path(), "demo --seed 1 --scene wrong-panel --reduction 4 --out demo");
    assert_eq!((exit, result["verdict"].as_str()), (1, Some("reject")), "{result}");
    assert!(result["reasons"].as_array().is_some_and(|reasons| !reasons.is_empty()), "{result}");
    let page = std::fs::read_to_string(folder.path().join("demo/index.html")).expect("the page");
    assert!(
        page.contains("<td>to the park pose, epoch") && !page.contains("<td>to corner pose"),
        "only to the park pose: {page}"
    );
}

/// A recording that cannot be opened stops the command before a cycle begins, so that no incomplete cycle has to be
/// concluded and signed later.
#[test]
fn no_cycle_begins_if_its_recording_cannot_be_opened() {
    let folder = rendered("good");
    let at = folder.path();
    taught_and_verified(at);
    std::fs::write(at.join("there.mcap"), "mine").expect("written");
    std::os::unix::fs::symlink("nowhere", at.join("link.mcap")).expect("a link");
    let of = |command: &str| format!("{command} --cell cell/cell.toml --recipe cell/recipe.toml --seed 3 --record");
    for command in [of("cycle"), of("air-run"), "demo --reduction 4 --out demo --record".to_owned()] {
        for (file, words) in [
            ("there.mcap", "already exists"),
            ("link.mcap", "already exists"),
            ("nowhere/a.mcap", "no such folder"),
            ("there.mcap/a.mcap", "no such folder"),
            ("cell/store/a.mcap", "inside the store"),
            ("cell/../cell/store/reports/a.mcap", "inside the store"),
        ] {
            if command.starts_with("demo") && words == "inside the store" {
                continue;
            }
            std::fs::create_dir_all(at.join("cell/store/reports")).expect("a folder");
            let (exit, output) = json(at, &format!("{command} {file}"));
            assert!(exit == 2 && output["reasons"].to_string().contains(words), "{command} {file}: {output}");
        }
    }
    assert!(!at.join("demo").exists(), "nothing is rendered");
    assert_eq!(std::fs::read_to_string(at.join("there.mcap")).expect("there"), "mine");
    let store = Store::open(&at.join("cell/store")).expect("opens");
    assert!(store.cycle(panelprep::record::CycleId(1)).is_err(), "no cycle was begun");
}
