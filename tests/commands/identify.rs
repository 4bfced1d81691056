//! Tests `identify` and the comparison by `teach` on files.

use super::{TEACH, json, rendered};
use serde_json::Value;
use std::fs;

const IDENTIFY: &str = "identify --cell cell/cell.toml --scan cell/scan.pcd";

fn code(answer: &Value) -> Option<&str> {
    answer["reasons"][0]["code"].as_str()
}

/// The only taught panel is proposed with its recipe; an order or a serial number of another panel is for a person, and
/// so is a missing number if the recipe states its form: without it no cycle starts. A second teaching under another
/// name is named when it is taught, and neither of the two is accepted afterwards, unless only the recipes of a folder
/// count.
#[test]
fn a_panel_is_identified_and_equal_panels_are_named() {
    let folder = rendered("good");
    let folder = folder.path();
    let recipe = fs::read_to_string(folder.join("cell/recipe.toml")).expect("there");
    let (exit, taught) = json(folder, TEACH);
    assert_eq!((exit, taught["compared_panels"].as_u64()), (0, Some(0)), "{taught}");
    let name = taught["panel"].as_str().expect("a name");
    // Today's recipe states the form of the serial numbers.
    let numbered = format!("[panel]\nname = \"{name}\"\nserial_pattern = \"SN-####\"\n");
    let today = recipe.replace(&format!("panel = \"{name}\"\n"), "") + &numbered;
    fs::write(folder.join("cell/recipe.toml"), &today).expect("written");
    let (exit, found) = json(folder, &format!("{IDENTIFY} --part SN-0017 --expect {name}"));
    assert_eq!(
        (exit, found["verdict"].as_str(), &found["panel"]),
        (0, Some("accept"), &taught["panel"]),
        "{found}"
    );
    assert_eq!(found["recipes"][0]["sha256"], panelprep::files::content_hash(today.as_bytes()), "{found}");
    for (other, reason) in
        [("--expect fairing", "other_panel"), ("--part RH-0017", "other_panel"), ("", "part_name")]
    {
        let (exit, found) = json(folder, &format!("{IDENTIFY} {other}"));
        assert_eq!((exit, code(&found)), (1, Some(reason)), "{found}");
    }
    let (exit, refused) = json(folder, "cycle --cell cell/cell.toml --recipe cell/recipe.toml --order WO-4");
    assert_eq!(exit, 2, "{refused}");
    let words = "states no serial number, but the recipe's [panel] serial_pattern requires one";
    assert!(refused["reasons"].to_string().contains(words), "{refused}");

    fs::create_dir(folder.join("twins")).expect("made");
    let twin = recipe.replace(&format!("\"{name}\""), "\"twin\"");
    fs::write(folder.join("twins/twin.toml"), twin).expect("written");
    let (_, twin) = json(folder, &TEACH.replace("cell/recipe.toml", "twins/twin.toml"));
    assert_eq!(twin["alike"][0]["panel"].as_str(), Some(name), "{twin}");
    let (exit, found) = json(folder, IDENTIFY);
    assert_eq!((exit, code(&found)), (1, Some("panels_alike")), "{found}");
    let (exit, found) = json(folder, &format!("{IDENTIFY} --panels twins"));
    assert_eq!((exit, found["panel"].as_str()), (0, Some("twin")), "{found}");
}

/// A recipe that cannot be read may be that of the panel in the scan: it counts as not excluded.
#[test]
fn a_panel_that_cannot_be_compared_is_not_excluded() {
    let folder = rendered("good");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    fs::write(folder.join("cell/broken.toml"), "[region\n").expect("written");
    let (exit, found) = json(folder, &format!("{IDENTIFY} --panels cell"));
    assert_eq!((exit, code(&found)), (1, Some("panel_not_compared")), "{found}");
    let (exit, none) = json(folder, &format!("{IDENTIFY} --panels ."));
    assert_eq!((exit, code(&none)), (1, Some("no_known_panel")), "{none}");
}
