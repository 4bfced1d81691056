//! Tests with clips: labelled sets, advice from a clip, and clips that cannot be evaluated.

use super::{LOCATE, TEACH, VERIFY, json, keep, panelprep};
use serde_json::Value;

/// Three clips of 8 s, the last one without a break, are scored as a set; one of them gives advice about light and
/// thresholds.
#[test]
fn a_labelled_set_is_scored_and_a_clip_gives_advice() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (exit, files) = json(folder, "render --seed 3 --reduction 4 --seconds 8 --clips 3 --film usual --out cell");
    assert_eq!((exit, json(folder, TEACH).0), (0, 0), "{files}");
    keep(folder, "located.json", &json(folder, LOCATE).1);
    let set = "inspect --cell cell/cell.toml --recipe cell/recipe.toml --located located.json --truth cell/set";
    let (exit, scored) = json(folder, &format!("{set} --pictures plots"));
    assert_eq!((exit, scored["score"]["clips"].as_u64()), (0, Some(3)), "{scored}");
    assert_eq!(scored["clips"][2]["verdict"], "pass", "{scored}");
    assert!(scored["score"]["iou_within"].as_f64().is_some_and(|iou| iou > 0.8), "{scored}");
    assert!(folder.join("plots/missed_by_size.png").exists() && folder.join("plots/time_error.png").exists());

    let tune = "tune --cell cell/cell.toml --recipe cell/recipe.toml --located located.json --clip cell/set/0001 \
                --truth cell/set/0001/truth";
    let (exit, advice) = json(folder, tune);
    assert_eq!((exit, advice["verdict"].as_str()), (0, Some("accept")), "{advice}");
    // The advice concerns the configured method; it states nothing about the thresholds of the other method.
    assert!(
        advice["threshold"].is_null() && advice["hsv_min"].is_null() && advice["best_threshold"].is_null(),
        "{advice}"
    );
    let number = |key: &str| advice[key].as_f64().unwrap_or(f64::NAN);
    assert!(number("detection_limit_mm2") < number("min_break_mm2") && number("min_break_mm2") < 100.0, "{advice}");
    assert!(number("flash_s") < number("persist_s") && number("persist_s") >= 1.2, "{advice}");
    let grids = advice["grids"].as_array().expect("grids");
    // The film changes the brightness by about 28 grey levels.
    let contrast =
        |grid: &Value| grid["dry"].as_f64().unwrap_or(f64::NAN) - grid["wet"].as_f64().unwrap_or(f64::NAN);
    assert!(grids.len() == 24 && grids.iter().all(|grid| (15.0..45.0).contains(&contrast(grid))), "{advice}");
    assert!(
        grids.iter().all(|grid| grid["contrast_to_noise"].as_f64().is_some_and(|ratio| ratio > 5.0)),
        "{advice}"
    );
    let words = String::from_utf8(panelprep(folder, tune).stdout).expect("UTF-8");
    assert!(
        words.contains("persist_s = 1.2") && words.contains("lamp = ") && !words.contains("threshold"),
        "{words}"
    );

    let recipe = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("the recipe");
    let thesis = recipe.replace("method = \"film\"", "method = \"thesis\"");
    std::fs::write(folder.join("cell/thesis.toml"), thesis).expect("written");
    let (exit, advice) = json(folder, &tune.replace("recipe.toml", "thesis.toml"));
    // Expected value, by hand: half of 28 grey levels, times four, is 56.
    assert!(exit == 0 && advice["threshold"].as_u64().is_some_and(|it| (48..66).contains(&it)), "{advice}");
    assert!(advice["best_threshold"]["iou"].as_f64().is_some() && advice["persist_s"].is_null(), "{advice}");
}

/// With a quarter of the pixels in each direction, the smallest visible break is 16 times larger. The rendered recipe
/// states this. A recipe that requires the 5 mm² of the full-size cell needs a person's decision when it is taught, and
/// gives no valid test on a clip or in the cycle. Without `--located`, a panel that is not at its nominal place is not
/// evaluated.
#[test]
fn breaks_too_small_to_see_and_a_displaced_panel_give_no_valid_test() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (exit, files) = json(folder, "render --seed 3 --reduction 4 --seconds 8 --out cell");
    assert_eq!(exit, 0, "{files}");
    let stated = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("the recipe");
    let (plain, own) = stated.split_once("# The pixels of this camera are too coarse").expect("its own limit");
    assert!(own.contains("min_break_mm2 = "), "{own}");
    std::fs::write(folder.join("cell/plain.toml"), plain).expect("written");
    let plain = |arguments: &str| arguments.replace("cell/recipe.toml", "cell/plain.toml");
    let reason = |output: &Value, code: &str| -> String {
        let found = output["reasons"].as_array().expect("reasons").iter().find(|reason| reason["code"] == code);
        found.unwrap_or_else(|| panic!("no {code}: {output}"))["message"].as_str().expect("a message").to_owned()
    };
    let (exit, output) = json(folder, &plain(TEACH));
    assert_eq!((exit, output["verdict"].as_str()), (1, Some("review")), "{output}");
    assert!(reason(&output, "detection_limit").contains("a grid fails from 5.0 mm²"), "{output}");
    assert_eq!(json(folder, TEACH).0, 0);
    VERIFY.iter().for_each(|look| assert_eq!(json(folder, look).0, 0));
    keep(folder, "located.json", &json(folder, LOCATE).1);
    let inspect = "inspect --cell cell/cell.toml --recipe cell/recipe.toml --clip cell/clip";
    let (_, output) = json(folder, &format!("{inspect} --located located.json"));
    assert_ne!(output["verdict"].as_str(), Some("invalid"), "{output}");
    assert!(output["outline_off_px"].as_f64().is_some_and(|off_px| off_px < 0.7), "{output}");
    // A grid that was sanded after the dry picture, as a person stated, is compared only with its wet appearance.
    let (exit, output) = json(folder, &format!("{inspect} --located located.json --abraded r2c3"));
    let references: Vec<&str> =
        output["grids"].as_array().expect("grids").iter().filter_map(|grid| grid["reference"].as_str()).collect();
    let of = |start: &str| references.iter().filter(|reference| reference.starts_with(start)).count();
    assert_eq!((of("wet look alone, sanded"), of("dry and wet")), (1, 24 - 9), "{exit} {output}");
    let (exit, output) = json(folder, &format!("{inspect} --located located.json --abraded r2c3,r9c1"));
    assert!(
        exit == 2 && output.to_string().contains("no grid r9c1; valid: r1c1 to r4c6 (4 rows, 6 columns)"),
        "{output}"
    );
    let (exit, output) = json(folder, &plain(&format!("{inspect} --located located.json")));
    assert_eq!((exit, output["verdict"].as_str()), (1, Some("invalid")), "{output}");
    reason(&output, "detection_limit");
    let cycle = "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3 --scene clean";
    assert_eq!(json(folder, cycle).1["verdict"].as_str(), Some("pass"));
    let (exit, output) = json(folder, &plain(cycle));
    assert_eq!((exit, output["verdict"].as_str()), (1, Some("invalid")), "{output}");
    reason(&output, "detection_limit");
    // The panel is not at its nominal place.
    let (exit, output) = json(folder, inspect);
    assert_eq!((exit, output["verdict"].as_str()), (1, Some("invalid")), "{output}");
    assert!(reason(&output, "elsewhere").contains("state --located"), "{output}");
}
