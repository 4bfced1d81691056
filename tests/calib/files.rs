//! Runs the program in a folder, and writes its input files there.

use crate::boards::GOOD_ROBOT;
use panelprep::files::write_gray_png;
use panelprep::geometry::{Camera, GrayPicture, KukaPose};
use panelprep::sim::{BoardCell, BoardPrint, BoardShot};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

pub const BOARD: &str = "--board 9x6 --square-mm 25";

/// Runs the program in a folder; returns its exit code, its JSON object and its standard error.
pub fn panelprep(folder: &Path, arguments: &str) -> (i32, Value, String) {
    let arguments = format!("calibrate {arguments} --json");
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let words = String::from_utf8(output.stderr).expect("UTF-8");
    let object = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{arguments}: {error}: {text}{words}"));
    (output.status.code().expect("an exit code"), object, words)
}

pub fn pose_text(pose: &KukaPose) -> String {
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = pose;
    format!(
        "{{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, z_mm = {z_mm:?}, a_deg = {a_deg:?}, b_deg = {b_deg:?}, c_deg = {c_deg:?} }}"
    )
}

pub fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    std::fs::write(folder.join(name), bytes).expect("written");
}

pub fn save(folder: &Path, name: &str, picture: &GrayPicture) {
    write(folder, name, write_gray_png(picture).expect("a picture"));
}

/// Returns a cell with pictures of a quarter of the size, in which the board is still detected; tests that use this
/// cell do not test accuracy.
pub fn small_cell() -> BoardCell {
    BoardCell::new(5, BoardPrint::chessboard(5, 4, 40.0), GOOD_ROBOT).with_reduction(4)
}

/// Saves shots of the fixed camera and returns the text of their poses file.
pub fn save_shots(cell: &BoardCell, count: usize, save: impl Fn(&str, &BoardShot<Camera>) -> String) -> String {
    let entry = |shot: &BoardShot<Camera>| {
        let name = save(&format!("{:02}", shot.index), shot);
        let pose = pose_text(&KukaPose::from_rigid(&shot.base_from_flange));
        format!("[[poses]]\nimage = \"{name}\"\nbase_from_flange = {pose}\n")
    };
    cell.fixed_shots(count).iter().map(entry).collect()
}
