//! The person who follows the manual: answers the program's questions at the terminal, jogs the arm, draws on the page,
//! and edits the two files that the manual names.

use super::cell::{Cell, PORTS, SERIAL};
use crate::teach_page;
use panelprep::geometry::Joints;
use std::fs;
use std::path::Path;
use toml_edit::{Array, DocumentMut, Item, Table, value};

/// The arm's park pose, degrees, and below it the ready pose and the permitted box of the tool's tip.
const PARK_DEG: &str = "-120,-75,110,0,55,90";
const READY_DEG: [f64; 6] = [0.0, -120.0, 145.0, 0.0, -25.0, 90.0];
const BOX_MM: [&str; 2] = ["100,-450,50", "700,450,900"];

/// Returns the person's answer to a line of the program, if there is one; `asked` counts the earlier answers to this
/// command.
pub fn answer(cell: &Cell, store: &Path, line: &str, asked: &mut usize) -> Option<String> {
    let words = |words: &str| Some(format!("{words}\n"));
    let number = *asked;
    let said = if line.contains("Press Enter for pose") && line.contains("of the tip") {
        let pose = numbered(line)?;
        cell.hold_tip(pose - 1, false);
        if pose == 7 { words("axis") } else { words("") }
    } else if line.contains("Hold a mark on the tool's axis") {
        let mark = numbered(line)?;
        cell.hold_tip(mark - 1, true);
        if mark == 3 { words("done") } else { words("") }
    } else if let Some((_, rest)) = line.split_once("Touch the board's inner corner [") {
        let (column, row) = rest.split(']').next()?.split_once(", ")?;
        cell.touch_corner(column.parse().ok()?, row.parse().ok()?);
        words("")
    } else if line.contains("Move the camera on the flange until it sees the") {
        cell.jog_to_corner(number);
        words("")
    } else if let Some(url) = line.split_whitespace().find(|word| word.starts_with("http://")) {
        draw(cell, url);
        return None;
    } else if let Some((step, _)) =
        line.strip_prefix("Type the step number, ").and_then(|rest| rest.split_once(", to "))
    {
        words(step)
    } else if line.contains("axis angles at which the arm is clear") {
        words(PARK_DEG)
    } else if line.contains("minimum corner of the box in which the tool's tip") {
        words(BOX_MM[0])
    } else if line.contains("maximum corner of this box") && line.contains("[750,450,900]") {
        words(BOX_MM[1])
    } else if line.contains("the camera on the flange: simulated or gige") {
        words("gige")
    } else if line.contains("serial number of the camera on the flange") {
        words(SERIAL)
    } else if line.contains("the store's folder") {
        words(&store.display().to_string())
    } else if line.starts_with("Enter the flange's pose") {
        panic!("the controller answers, so no person need read the pendant");
    } else if !line.starts_with(' ') && line.contains(" [") && line.ends_with(']') {
        // The proposed answer.
        words("")
    } else {
        None
    };
    *asked += usize::from(said.is_some());
    said
}

/// Returns the number of the requested pose.
fn numbered(line: &str) -> Option<usize> {
    line.split_once("Press Enter for pose ")?.1.split(' ').next()?.parse().ok()
}

/// Draws on the page as a person does: corners of the region, fewer grids, save, done.
fn draw(cell: &Cell, url: &str) {
    let url = url.trim_end_matches('.').to_owned();
    let region = cell.region();
    let corners: Vec<[f64; 2]> = region.corners_px.iter().map(|pixel| [pixel.u, pixel.v]).collect();
    let drawing = ask(&url, "GET", "drawing.json", "");
    let mut drawing: serde_json::Value = serde_json::from_str(&drawing).expect("JSON");
    let drawn = &mut drawing["drawn"];
    drawn["corners_px"] = serde_json::json!(corners);
    (drawn["rows"], drawn["columns"]) = (3.into(), 4.into());
    let saved = ask(&url, "POST", "save", &drawn.to_string());
    assert!(!saved.contains("error"), "{saved}");
    ask(&url, "POST", "done", "");
}

/// Sends a request to the page; returns the body of the response, which must be a success.
fn ask(url: &str, method: &str, page: &str, body: &str) -> String {
    let answer = teach_page::ask(url, method, page, body);
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    answer.split_once("\r\n\r\n").expect("a body").1.to_owned()
}

fn edited(file: &Path, edit: impl FnOnce(&mut DocumentMut)) {
    let mut document: DocumentMut = fs::read_to_string(file).expect("written").parse().expect("TOML");
    edit(&mut document);
    fs::write(file, document.to_string()).expect("written");
}

/// Edits the cell's file with the values of this cell, as the manual requires.
pub fn edit_cell(file: &Path, verify: Joints) {
    edited(file, |cell| {
        let pose = |degrees: [f64; 6]| {
            let mut table = Table::new();
            for (axis, angle) in degrees.into_iter().enumerate() {
                table[&format!("a{}_deg", axis + 1)] = value(angle);
            }
            Item::Table(table)
        };
        cell["poses"]["ready"] = pose(READY_DEG);
        cell["poses"]["verify"] = pose(verify.degrees());
        let [command, state] = PORTS.map(i64::from);
        (cell["robot"]["command_port"], cell["robot"]["state_port"]) = (value(command), value(state));
        (cell["scanner"]["settings"], cell["scanner"]["settings_2d"]) = (value("scan.yml"), value("film.yml"));
    });
}

/// Sets a film and a sanding pass that take less time than those of a real panel, and the search box of the simulated
/// panel.
pub fn edit_recipe(file: &Path) {
    edited(file, |recipe| {
        recipe["process"]["observation_s"] = value(8.0);
        recipe["path"]["feed_mm_s"] = value(120.0);
        // The value that `panelprep tune` proposes for pictures of half the size.
        recipe["inspect"]["min_break_mm2"] = value(18.0);
        let corner = |corner: [f64; 3]| value(corner.into_iter().collect::<Array>());
        let [least, greatest] = panelprep::sim::SEARCH_BOX_MM;
        (recipe["locate"]["box_min_mm"], recipe["locate"]["box_max_mm"]) = (corner(least), corner(greatest));
    });
}
