//! The report of `check` on one file, with sentences that describe how the program understood the file.

use panelprep_base::config::Problem;
use panelprep_base::geometry::{Degrees, Frame, Vector, polygon};
use panelprep_base::number_text::{fixed_decimals, list};
use panelprep_cell::cell::{
    Arm, ArmModel, Camera, Cell, Gige, Intrinsics, Mount, MountedPose, Output, RemovalCalibration, RobotCorrection,
    RobotKind, Tool, ZividCamera,
};
use panelprep_cell::recipe::Recipe;
use panelprep_store::office::ArchiveSettings;
use std::collections::BTreeMap;

/// Kind of a recipe's file, which is checked against a cell.
pub(super) const RECIPE: &str = "recipe";

/// The result of the check of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct FileReport {
    /// The kind of the file; `None` if it is not clear.
    pub kind: Option<&'static str>,
    /// Problems of the file, ordered by line.
    pub problems: Vec<Problem>,
    /// Properties that are allowed but lead to problems, ordered by line.
    pub warnings: Vec<Problem>,
    /// Content of the file as the program understood it, one sentence for each property. Empty if a file in one of this
    /// program's own formats has problems.
    pub descriptions: Vec<String>,
}

/// Returns the indices of the reports on files of this kind.
pub(super) fn reports_of_kind(kind: &'static str, reports: &[FileReport]) -> Vec<usize> {
    (0..reports.len()).filter(|place| reports[*place].kind == Some(kind)).collect()
}

fn describe_zivid(zivid: &ZividCamera, device: &str) -> String {
    let which = match (&zivid.serial, &zivid.file_camera) {
        (_, Some(file)) => format!("{device} simulated from {}", file.display()),
        (Some(serial), None) => format!("{device} {serial}"),
        (None, None) => format!("{device}, the only one found"),
    };
    match zivid.settings.is_some() && zivid.settings_2d.is_some() {
        true => which,
        false => format!("{which}; it cannot capture until settings and settings_2d are named"),
    }
}

fn describe_gige(gige: &Gige, device: &str) -> String {
    match (&gige.serial, &gige.address) {
        (Some(serial), _) => format!("{device} {serial}"),
        (None, Some(address)) => format!("{device} at {address}"),
        (None, None) => format!("{device}, the only one found"),
    }
}

/// Describes which outputs the controller switches off automatically, and after which delay.
fn describe_off_delays(after_s: &BTreeMap<String, u16>) -> String {
    let say = |(name, after_s): (&String, &u16)| match after_s {
        0 => format!("{name} at once"),
        _ => format!("{name} after {after_s} s"),
    };
    let words: Vec<String> = after_s.iter().map(say).collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

fn describe_camera<Device>(camera: &Camera<Device>, device: impl Fn(&Device) -> String) -> String {
    match camera {
        Camera::Simulated => "simulated".to_owned(),
        Camera::Recorded { folder } => format!("recorded, from {}", folder.display()),
        Camera::Device(camera) => device(camera),
    }
}

fn describe_tool(tool: &Tool) -> String {
    let Some(tool) = tool.compliant() else { return "a spring; it receives no commands".to_owned() };
    let place = match &tool.address {
        Some(address) => format!("compliant, at {} port {}", address.host, address.port),
        None => "compliant, simulated".to_owned(),
    };
    let (stroke_mm, least_n, most_n, band_n) = (tool.stroke_mm, tool.min_force_n, tool.max_force_n, tool.band_n);
    format!("{place}; stroke {stroke_mm} mm, {least_n} to {most_n} N, force tolerance {band_n} N")
}

pub(super) fn describe_cell(cell: &Cell) -> Vec<String> {
    let robot = cell.robot();
    let controller = match robot.kind() {
        RobotKind::Mock => "mock".to_owned(),
        RobotKind::Eki => format!("KUKA controller at {}", robot.host()),
    };
    let named = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    let files = cell.calibration();
    let calibrations = [
        ("scanner", &files.scanner),
        ("flange_camera", &files.flange_camera),
        ("base_from_camera", &files.base_from_camera),
        ("flange_from_camera", &files.flange_from_camera),
        ("flange_from_tool", &files.flange_from_tool),
        ("removal", &files.removal),
    ];
    let calibrations = calibrations.iter().filter(|(_, file)| file.is_some()).map(|(name, _)| *name).collect();
    let box_of_waypoints = match cell.limits().workspace() {
        Some(space) => format!(
            "the tool centre point stays in the box from {} to {} mm",
            list(space.min.mm.coords.as_slice()),
            list(space.max.mm.coords.as_slice())
        ),
        None => "no box that limits the tool centre point is configured".to_owned(),
    };
    vec![
        format!("scanner: {}", describe_camera(cell.scanner(), |zivid| describe_zivid(zivid, "Zivid"))),
        format!(
            "flange camera: {}",
            describe_camera(cell.flange_camera(), |gige| describe_gige(gige, "GigE Vision camera"))
        ),
        format!(
            "robot: {controller}, commands on port {}, state on port {}",
            robot.command_port(),
            robot.state_port()
        ),
        format!("arm: {}", describe_arm(cell.arm())),
        format!("tool: {}", describe_tool(cell.tool())),
        format!("poses: {}", named(cell.poses().keys().map(String::as_str).collect())),
        format!("outputs: {}", named(cell.inputs_outputs().outputs().keys().map(String::as_str).collect())),
        format!("off after the end of an epoch: {}", describe_off_delays(cell.inputs_outputs().off_delays_s())),
        format!(
            "feedbacks: {}{}",
            named(cell.inputs_outputs().feedbacks().keys().map(String::as_str).collect()),
            describe_tool_off(cell)
        ),
        format!("calibration files named: {}", named(calibrations)),
        format!("limits: {box_of_waypoints}"),
        format!("store in {}", cell.store().display()),
    ]
}

/// Returns a warning if the cell has no signal that proves that its tool is off; otherwise an empty text.
fn describe_tool_off(cell: &Cell) -> &'static str {
    let has_tool = cell.inputs_outputs().output(Output::Tool).is_some();
    if has_tool && !cell.inputs_outputs().proves_tool_off() {
        "; tool off is NOT PROVEN: a broken wire of tool_running looks the same as a stopped tool; connect a \
         standstill signal as tool_stands"
    } else {
        ""
    }
}

pub(super) fn describe_recipe(recipe: &Recipe) -> Vec<String> {
    let (region, process, locate, path) = (recipe.region(), recipe.process(), recipe.locate(), recipe.path());
    let observation =
        process.observation_s().map_or("as long as the cell's file states".to_owned(), |time| format!("{time} s"));
    let removal = recipe.removal().map(|removal| {
        format!("removal target {} µm, maximum {} µm at any place", removal.target_um(), removal.max_um())
    });
    let mut descriptions = vec![
        format!("panel {}: {} rows by {} columns of grids", recipe.panel(), region.rows(), region.columns()),
        format!("film observed for {observation}, {} pictures per second", process.frames_per_second()),
        format!("a grid is sanded at most {} times per cycle", process.max_passes_per_grid()),
        format!("a part is sanded in at most {} passes over all its cycles", process.effective_passes_per_part()),
        format!(
            "panel accepted up to {} mm shift, {}° rotation and {}° tilt from its taught pose",
            locate.max_shift_mm(),
            locate.turn_limit_deg(),
            locate.max_tilt_deg()
        ),
        format!(
            "disc diameter {} mm, step-over at most {} mm, feed {} mm/s",
            path.disc_diameter_mm(),
            path.step_over_mm(),
            path.feed_mm_s()
        ),
    ];
    descriptions.extend(removal);
    descriptions
}

pub(super) fn describe_intrinsics(intrinsics: Intrinsics) -> Vec<String> {
    let camera = intrinsics.camera;
    let view = |size_px: usize, focal_px: f64| Degrees::from_rad(2.0 * (size_px as f64 / 2.0 / focal_px).atan()).0;
    let (across, down) = (view(camera.width_px, camera.fx_px), view(camera.height_px, camera.fy_px));
    let residual = intrinsics.rms_px.map_or("unknown".to_owned(), |rms_px| format!("{rms_px:.3} px rms"));
    let mut descriptions = vec![
        format!(
            "camera of {} × {} px with a field of view of about {across:.1}° × {down:.1}°",
            camera.width_px, camera.height_px
        ),
        format!("residual: {residual}"),
    ];
    descriptions.extend(intrinsics.errors.map(|errors| {
        let corrected = if errors.field.is_some() {
            "the systematic error, the same in each scan, is subtracted"
        } else {
            "no systematic error was found"
        };
        format!(
            "measurement errors of the camera, from {} scans: {} mm of white noise, {} mm of smooth error with a \
             correlation length of {} mm; {corrected}",
            errors.board_positions,
            fixed_decimals(errors.white_mm, 3),
            fixed_decimals(errors.smooth_mm, 3),
            fixed_decimals(errors.correlation_mm, 0)
        )
    }));
    descriptions.extend(intrinsics.extent.model.map(|model| format!("lens model: {model}")));
    descriptions.extend(
        intrinsics
            .extent
            .excluded_coefficients
            .iter()
            .map(|reason| format!("excluded from the lens model: {reason}")),
    );
    descriptions.extend(intrinsics.extent.supported.map(|supported| {
        let picture_px2 = (camera.width_px * camera.height_px) as f64;
        let share = polygon::signed_area_px2(&supported.outline_px).abs() / picture_px2;
        format!(
            "lens calibrated to {} px in {} % of the picture; measurements outside of this part are refused",
            fixed_decimals(supported.error_px, 2),
            fixed_decimals(share * 100.0, 0)
        )
    }));
    descriptions
}

/// Returns the name of the arm's model and the source of its parameters; for a custom arm, the most similar model.
fn describe_arm(arm: &Arm) -> String {
    match (arm.margins().model(), arm.nearest_preset()) {
        (ArmModel::Named(preset), _) => format!("{}, from the public model of {}", preset.name, preset.source),
        (ArmModel::Custom, Some((nearest, 0.0))) => {
            format!("custom; its lengths are those of {}", nearest.name)
        }
        (ArmModel::Custom, Some((nearest, off_mm))) => {
            format!(
                "custom; the nearest named arm is {}; one of its lengths differs by {} mm",
                nearest.name,
                fixed_decimals(off_mm, 1)
            )
        }
        (ArmModel::Custom, None) => "custom".to_owned(),
    }
}

pub(super) fn describe_correction(correction: &RobotCorrection) -> Vec<String> {
    let [before, after] =
        [correction.left_out_before_mm, correction.left_out_after_mm].map(|mm| fixed_decimals(mm, 3));
    vec![
        format!("correction of the arm, {}", correction.numbers.kind()),
        format!("error in validation pictures: {before} mm rms without this correction, {after} mm rms with it"),
    ]
}

pub(super) fn describe_archive(settings: &ArchiveSettings) -> Vec<String> {
    let ArchiveSettings { broker, waiting_gb, database, files, fleet } = settings;
    let page = fleet.as_ref().map_or("none".to_owned(), |fleet| format!("at {}", fleet.listen));
    vec![
        format!("web page of the office server: {page}"),
        format!("broker {}, at most {waiting_gb} GB of waiting messages", broker.address),
        format!("database {} of {} at {}:{}", database.name, database.user, database.host, database.port),
        format!("files in {}", files.display()),
    ]
}

pub(super) fn describe_removal(found: &RemovalCalibration) -> Vec<String> {
    let numbers = &found.numbers;
    vec![
        format!(
            "removal: k {:.3e} mm²/N, standard deviation {} %, from {} coupons that differ by {} % from the model",
            numbers.preston_mm2_per_n(),
            fixed_decimals(numbers.preston_deviation_percent(), 1),
            numbers.coupons(),
            fixed_decimals(numbers.coupon_deviation_percent(), 1)
        ),
        match numbers.disc_deviation_percent() {
            Some(percent) => format!(
                "{} discs; the standard deviation of the removal between discs is {} %",
                numbers.discs(),
                fixed_decimals(percent, 1)
            ),
            None => "the standard deviation between discs is not known: calibrate the removal again".to_owned(),
        },
        format!(
            "ln k falls by {} per square metre that the disc swept; orbit of {} mm at {} rev/min, pad stiffness {} N/mm³",
            fixed_decimals(numbers.wear_per_m2(), 2),
            numbers.orbit_mm(),
            numbers.orbit_rev_min(),
            numbers.pad_n_mm3()
        ),
    ]
}

pub(super) fn describe_mount<M: Mount>(mounted: MountedPose<M>) -> Vec<String> {
    let rigid = mounted.rigid();
    let (from, to) = (M::From::NAME, M::To::NAME);
    let (origin, axis) = (rigid.origin().mm, (rigid * Vector::<M::From>::new(nalgebra::Vector3::z())).mm);
    let residual = mounted.rms_mm.map_or("unknown".to_owned(), |rms_mm| format!("{rms_mm:.3} mm rms"));
    let mut descriptions = vec![
        format!(
            "{from} at ({}, {}, {}) mm in {to}",
            fixed_decimals(origin.x, 1),
            fixed_decimals(origin.y, 1),
            fixed_decimals(origin.z, 1)
        ),
        format!(
            "its Z axis in that frame: ({}, {}, {})",
            fixed_decimals(axis.x, 2),
            fixed_decimals(axis.y, 2),
            fixed_decimals(axis.z, 2)
        ),
        format!("residual: {residual}"),
    ];
    if M::HAS_AXIS {
        let measured = if mounted.axis_measured == Some(true) { "measured" } else { "not measured" };
        descriptions.push(format!("the tool's axis was {measured}"));
    }
    descriptions.extend(mounted.board.map(|board| format!("the board: {board}")));
    descriptions
}
