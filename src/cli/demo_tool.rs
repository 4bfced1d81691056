//! The demo's cell with a compliant tool, commissioned in the way an engineer does it. Its payload and zero are
//! measured and verified, the removal by its disc is fitted to coupons, and the recipe requests a removal.

use super::args::Common;
use super::calibrate::{args as asked, tool};
use super::fault::Fault;
use super::outcome::Outcome;
use super::rendered::RenderedFiles;
use super::{disk, render_boards, render_coupons};
use serde_json::Value;

const CALIBRATION: &str = "removal.toml";
const NAMED: &str = "flange_from_tool = \"flange_from_tool.toml\"\n";
/// The assumed error of the simulated cell at the tool: the tool's stroke must have room for this error.
const TOOL_ERROR: &str = "tool_error_mm = 1.0\n";
/// The settings of the recipe. A step-over below the default and a high feed leave the feeds enough range to make the
/// removal uniform.
const ASKED: &str = "
[path]
force_n = 12.0
feed_mm_s = 120.0
step_over_mm = 9.0

[removal]
method = \"scheduled\"
target_um = 25.0
max_um = 60.0
";

/// Renders readings and coupons, calibrates, and writes the tool into the cell's file and the removal into the
/// recipe.
///
/// # Errors
/// If a file cannot be written, or a calibration is rejected.
pub fn calibrate(seed: u64, rendered: &RenderedFiles, progress: &dyn Fn(&str)) -> Result<(), Fault> {
    progress("calibrating the compliant tool: payload, force zero, and removal by its disc");
    render_boards::write_force(rendered)?;
    render_coupons::write(seed, rendered)?;
    let common = rendered.common_arguments();
    tool::run_removal(&asked::Removal {
        coupons: rendered.file_path("boards/coupons.csv"),
        disc_diameter_mm: render_coupons::DISC_DIAMETER_MM,
        pad_n_mm3: render_coupons::TOOL.pad.stiffness_n_mm3,
        orbit_mm: render_coupons::TOOL.orbit.diameter_mm,
        orbit_rev_min: render_coupons::TOOL.orbit.speed_rev_min,
        out: rendered.file_path(CALIBRATION),
    })?;
    let measured = tool::run_force(&readings(rendered, false), &common)?;
    let [payload_kg, zero_n] = ["payload_kg", "zero_n"].map(|key| measured.json.get(key).and_then(Value::as_f64));
    let (payload_kg, zero_n) = (payload_kg.unwrap_or(f64::NAN), zero_n.unwrap_or(f64::NAN));
    let cell = disk::read_text(&common.cell)?.replace(NAMED, &format!("{NAMED}removal = \"{CALIBRATION}\"\n"));
    let cell = cell.replace("verify_limit_mm", &format!("{TOOL_ERROR}verify_limit_mm"));
    let tool = format!("\n[tool]\nkind = \"simulated\"\npayload_kg = {payload_kg:.3}\nzero_n = {zero_n:.3}\n");
    disk::write(&common.cell, format!("{cell}{tool}"))?;
    let recipe = rendered.file_path("recipe.toml");
    let text = disk::read_text(&recipe)?;
    disk::write(&recipe, format!("{text}{ASKED}"))
}

/// Verifies payload and zero with the same readings, as at the beginning of each day.
///
/// # Errors
/// As `panelprep calibrate force --verify`.
pub fn verify(rendered: &RenderedFiles, common: &Common) -> Result<Outcome, Fault> {
    tool::run_force(&readings(rendered, true), common)
}

fn readings(rendered: &RenderedFiles, verify: bool) -> asked::Force {
    asked::Force { readings: rendered.file_path("boards/force.toml"), verify }
}
