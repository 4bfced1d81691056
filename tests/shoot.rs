//! Tests `panelprep shoot` as a person uses it who has only cameras on a bench.

use super::commands::json;
use serde_json::Value;
use std::fs;
use std::path::Path;

fn number(told: &Value, key: &str) -> f64 {
    told[key].as_f64().unwrap_or(f64::NAN)
}

/// A cell without any calibration captures scans, pictures, corners and a film with simulated cameras. A recorded
/// camera, also without a calibration, then replays the film and the scans.
#[test]
fn cameras_without_a_calibration_take_pictures() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("config/cell.toml"), folder.join("cell.toml"))
        .expect("copied");
    let shoot = |what: &str| json(folder, &format!("shoot --cell cell.toml {what}"));

    let (exit, output) = shoot("scan --count 2 --out shots");
    let (first, scan) = (output["shots"][0].clone(), &output["shots"][1]);
    assert!(exit == 0 && number(scan, "points") > 100_000.0, "{output}");
    assert!(
        (0.05..0.95).contains(&number(scan, "missing_share")) && number(scan, "sharpness_gray_per_px") > 10.0,
        "{output}"
    );
    for ending in ["pcd", "ply", "png"] {
        assert!(folder.join(format!("shots/scan_0002.{ending}")).is_file(), "{ending}");
    }
    // Existing files are not overwritten.
    let before = fs::read(folder.join("shots/scan_0001.pcd")).expect("a scan");
    assert_eq!(shoot("scan --out shots").0, 0);
    assert_eq!(fs::read(folder.join("shots/scan_0001.pcd")).expect("a scan"), before);
    assert!(folder.join("shots/scan_0003.ply").is_file());

    let (exit, output) = shoot("corner --out shots");
    assert!(exit == 0 && output["shots"][0]["size_px"] == serde_json::json!([2048, 1536]), "{output}");
    assert!(folder.join("shots/corner_0001.json").is_file(), "the simulated arm says where it was");
    let (exit, output) = shoot("picture --out shots");
    assert!(exit == 0 && number(&output["shots"][0], "mean_gray") > 20.0, "the light is on: {output}");

    let (exit, output) =
        shoot("film --seconds 2 --pictures-per-second 2 --spray-from-s 0.4 --wet-from-s 0.9 --out film");
    assert!(exit == 0 && number(&output, "pictures") >= 4.0 && number(&output, "dropped") == 0.0, "{output}");
    assert!(
        (number(&output, "pictures_per_s") - 2.0).abs() < 0.1 && number(&output, "longest_gap_s") < 0.6,
        "{output}"
    );
    let list = fs::read_to_string(folder.join("film/clip.csv")).expect("a list");
    assert!(["00001.png,0,dry", ",spray", ",wet"].iter().all(|part| list.contains(part)), "{list}");
    let (exit, output) = shoot("film --seconds 1 --out film");
    assert!(exit == 2 && output["reasons"].to_string().contains("another folder"), "{output}");

    let (exit, output) = shoot("film --seconds 1 --wet-from-s 3 --out other");
    assert!(exit == 2 && output["reasons"].to_string().contains("the limits are 0 to 1"), "{output}");
    // Dry pictures are never marked as wet: with a spray, the command must state when the spray ends.
    for (phases, words) in [
        ("--spray-from-s 0.4", "give --wet-from-s"),
        ("--spray-from-s 0.6 --wet-from-s 0.3", "the wet pictures after the spray"),
        ("--spray-from-s 0.4 --wet-from-s 3", "both within the film"),
        ("--spray-from-s nan --wet-from-s 0.5", "the spray must begin at 0 s or later"),
    ] {
        let (exit, output) = shoot(&format!("film --seconds 1 {phases} --out other"));
        assert!(exit == 2 && output["reasons"].to_string().contains(words), "{phases}: {output}");
    }
    assert!(!folder.join("other").exists(), "nothing is taken");

    // The folder cannot be created: more pictures arrive than may wait for the disk, and the command ends with an
    // error.
    let (exit, output) = shoot("film --seconds 60 --pictures-per-second 20 --out cell.toml/film");
    assert!(exit == 2 && output["reasons"].to_string().contains("cell.toml/film"), "{output}");

    // As a recording.
    fs::copy(folder.join("shots/scan_0001.pcd"), folder.join("film/scan_0001.pcd")).expect("copied");
    let text = fs::read_to_string(folder.join("cell.toml")).expect("a cell");
    let begin = text.find("[scanner]").expect("a scanner");
    let end = begin + text[begin + 1..].find("\n[").map_or(text.len() - begin, |at| at + 1);
    let recorded = format!("{}[scanner]\nkind = \"recorded\"\nfolder = \"film\"\n{}", &text[..begin], &text[end..]);
    fs::write(folder.join("cell.toml"), recorded).expect("written");
    let (exit, output) = shoot("scan --out again");
    assert!(exit == 0 && output["shots"][0]["points"] == first["points"], "{output}");
    let (exit, output) = shoot("film --seconds 60 --out again");
    assert!(exit == 0 && number(&output, "pictures") >= 4.0, "{output}");
    let doctor = json(folder, "doctor --cell cell.toml").1.to_string();
    assert!(
        !doctor.contains("calibrate first") && doctor.contains("recorded: the shots are read from a recording"),
        "{doctor}"
    );
}
