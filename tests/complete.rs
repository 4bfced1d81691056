//! Tests whether the files are complete for a cycle: `check --for cycle`, `doctor` and `cycle` agree.

use super::commands::{json, panelprep, rendered};
use std::fs;
use std::path::Path;
use toml_edit::{Array, DocumentMut, value};

fn edited(file: &Path, edit: impl FnOnce(&mut DocumentMut)) {
    let mut document: DocumentMut = fs::read_to_string(file).expect("there").parse().expect("TOML");
    edit(&mut document);
    fs::write(file, document.to_string()).expect("written");
}

/// Returns the keys of the errors in all files.
fn errors(answer: &serde_json::Value) -> Vec<String> {
    let files = answer["files"].as_array().expect("files");
    let all = files.iter().flat_map(|file| file["errors"].as_array().expect("errors"));
    all.map(|error| error["key"].as_str().expect("a key").to_owned()).collect()
}

fn spoil_recipe(recipe: &mut DocumentMut, key: &str) {
    match key {
        "path.feed_mm_s" => recipe["path"]["feed_mm_s"] = value(400.0),
        "region.corners_px" => {
            let corners = recipe["region"]["corners_px"].as_array_mut().expect("corners");
            for corner in corners.iter_mut() {
                let far = corner.as_array().expect("a corner").iter();
                let far: Array = far.map(|number| 10.0 * number.as_float().expect("a number")).collect();
                *corner = far.into();
            }
        }
        _ => {
            recipe["locate"]["box_min_mm"] = value(Array::from_iter([0.3, -0.4, 0.1]));
            recipe["locate"]["box_max_mm"] = value(Array::from_iter([0.7, 0.4, 0.8]));
        }
    }
}

/// One item at a time is made invalid: it is the only error of `check --for cycle`, and `cycle` refuses the files with
/// the same key.
#[test]
fn no_cycle_begins_with_files_that_check_finds_incomplete() {
    let folder = rendered("good");
    let folder = folder.path();
    let (cell, recipe) = (folder.join("cell/cell.toml"), folder.join("cell/recipe.toml"));
    let check = || json(folder, "check --for cycle cell/cell.toml cell/recipe.toml");
    let cycle = || {
        let output = panelprep(folder, "cycle --cell cell/cell.toml --recipe cell/recipe.toml");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(check().0, 0, "{}", check().1);
    let (exit, answer) = cycle();
    assert!(exit == Some(2) && answer.contains("`panelprep teach`"), "complete, and nothing was taught: {answer}");

    let kept = [&cell, &recipe].map(|file| fs::read_to_string(file).expect("there"));
    for key in ["path.feed_mm_s", "region.corners_px", "locate.box_max_mm"] {
        edited(&recipe, |recipe| spoil_recipe(recipe, key));
        let (exit, answer) = check();
        assert_eq!((exit, errors(&answer)), (1, vec![key.to_owned()]), "{answer}");
        let (exit, answer) = cycle();
        assert!(exit == Some(2) && answer.contains("recipe.toml:") && answer.contains(key), "{answer}");
        fs::write(&recipe, &kept[1]).expect("written");
    }

    let named = |key: &str| {
        let cell: DocumentMut = kept[0].parse().expect("TOML");
        folder.join("cell").join(cell["calibration"][key].as_str().expect("named"))
    };
    for key in ["scanner", "flange_from_camera", "flange_from_tool"] {
        let file = named(key);
        let text = fs::read_to_string(&file).expect("there");
        let spoilt = [
            None,
            Some("[camera]\n".to_owned()),
            Some(text.replace("axis_measured = true", "axis_measured = false")),
        ];
        for wrong in spoilt.into_iter().filter(|wrong| wrong.as_ref() != Some(&text)) {
            match &wrong {
                None => fs::remove_file(&file).expect("removed"),
                Some(wrong) => fs::write(&file, wrong).expect("written"),
            }
            let key = format!("calibration.{key}");
            let (exit, answer) = check();
            assert_eq!((exit, errors(&answer)), (1, vec![key.clone()]), "{wrong:?} {answer}");
            let (exit, answer) = cycle();
            assert!(exit == Some(2) && answer.contains(&key), "{answer}");
            // Before the calibrations are made, a cell's file may be valid without them. A calibration that exists but
            // is wrong is never accepted.
            let (exit, answer) = json(folder, "check cell/cell.toml");
            assert_eq!(exit, i32::from(wrong.is_some()), "{answer}");
            assert_eq!(answer["files"][0]["warnings"].as_array().map(Vec::len), Some(usize::from(wrong.is_none())));
            let (exit, answer) = json(folder, "doctor --cell cell/cell.toml");
            let answer = answer["checks"].as_array().expect("checks").iter().filter(|check| check["ok"] == false);
            let answer = answer
                .filter(|check| check.to_string().contains(&*file.file_name().expect("it").to_string_lossy()));
            assert_eq!((exit, answer.count()), (1, 1), "{key}: once");
        }
        fs::write(&file, text).expect("written");
    }
    assert_eq!(check().0, 0, "as it was");
}

/// If a value in [path] is refused, only this value is reported: the further requirements of [removal] are not known.
#[test]
fn an_invalid_path_value_is_not_reported_as_a_missing_force() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let recipe = |step: &str, force: &str| {
        let text = include_str!("../config/panels/example.toml");
        let mut recipe: DocumentMut = text.parse().expect("TOML");
        recipe["path"]["step_over_mm"] = step.parse().expect("a value");
        let removal = "target_um = 20.0\nmax_um = 60.0\n";
        let removal: DocumentMut = format!("[removal]\n{removal}{force}").parse().expect("TOML");
        recipe["removal"] = removal["removal"].clone();
        fs::write(folder.join("recipe.toml"), recipe.to_string()).expect("written");
        errors(&json(folder, "check recipe.toml").1)
    };
    assert_eq!(recipe("9.0", ""), ["removal.force_n"]);
    assert_eq!(recipe("0.009", ""), ["path.step_over_mm"]);
    assert_eq!(recipe("\"9 mm\"", "force_n = 20.0"), ["path.step_over_mm"]);
    assert_eq!(recipe("9.0", "force_n = 20.0"), Vec::<String>::new());
}
