//! `panelprep check`: the kind of a file, its problems, and what the program understood of it.
//!
//! The kind is decided by the names at the top of the file, so that a file may have any name; what begins with `<` or is
//! called `.xml` is an EthernetKRL file. Several of those are checked for clashes with each other. What is called `.src`,
//! `.sub` or `.dat` is KRL; such files are checked as one program. What is called `.yml` or `.yaml` is a Zivid's settings.

mod eki;
mod krl;
mod report;
mod text;

use crate::cell::{
    CELL_KEYS, Camera, Cell, FlangeCameraMount, Gige, Intrinsics, Mount, MountedPose, RemovalCalibration,
    RobotCorrection, RobotKind, ScannerMount, TargetMount, Tool, ToolMount, ZividCamera, ZividSettings,
};
use crate::config::{self, Problem, Problems};
use crate::geometry::{Degrees, Frame, Vector, polygon};
use crate::krl::{Kss, LOWEST_KSS};
use crate::recipe::{RECIPE_KEYS, Recipe};
use crate::requirements::{Purpose, Unmet, unmet};
use crate::words::{fixed, list};
use std::collections::BTreeMap;

pub use report::FileReport;
pub use text::{NotText, decode};

/// A kind of file: its name, the keys at its top, how it is checked.
struct Kind {
    name: &'static str,
    keys: &'static [&'static str],
    check: fn(&str, &str) -> Result<Vec<String>, Problems>,
}

const KINDS: [Kind; 9] = [
    Kind { name: CELL, keys: &CELL_KEYS, check: |name, text| Cell::check(name, text).map(|cell| say_cell(&cell)) },
    Kind {
        name: "recipe",
        keys: &RECIPE_KEYS,
        check: |name, text| Recipe::check(name, text).map(|recipe| say_recipe(&recipe)),
    },
    Kind {
        name: "intrinsics",
        keys: &["camera"],
        check: |name, text| Intrinsics::check(name, text).map(say_intrinsics),
    },
    mount::<ScannerMount>(&[ScannerMount::TABLE]),
    mount::<FlangeCameraMount>(&[FlangeCameraMount::TABLE]),
    mount::<ToolMount>(&[ToolMount::TABLE]),
    mount::<TargetMount>(&[TargetMount::TABLE]),
    Kind {
        name: "robot_correction",
        keys: &["robot_correction"],
        check: |name, text| RobotCorrection::check(name, text).map(|correction| say_correction(&correction)),
    },
    Kind {
        name: "removal",
        keys: &["removal"],
        check: |name, text| RemovalCalibration::check(name, text).map(|found| say_removal(&found)),
    },
];

const fn mount<M: Mount>(keys: &'static [&'static str]) -> Kind {
    Kind { name: M::TABLE, keys, check: |name, text| MountedPose::<M>::check(name, text).map(say_mount) }
}

/// Checks the texts of configuration files, by themselves and against each other; a file is its name in messages and
/// its text. A cell must say all that the purpose needs, where one is given. KRL is checked for the lowest version of
/// KSS that the installation page names.
pub fn check_files(files: &[(&str, &str)], purpose: Option<Purpose>) -> Vec<FileReport> {
    check_files_for(files, purpose, LOWEST_KSS)
}

/// [`check_files`] for controllers with this version of KSS and higher ones.
pub fn check_files_for(files: &[(&str, &str)], purpose: Option<Purpose>, kss: Kss) -> Vec<FileReport> {
    let mut channels = Vec::new();
    let mut programs = Vec::new();
    let mut reports = Vec::new();
    for (place, &(name, text)) in files.iter().enumerate() {
        if krl::is_krl(name) {
            programs.push((place, name, text));
            reports.push(FileReport { kind: None, problems: vec![], warnings: vec![], says: vec![] });
            continue;
        }
        if is_yaml(name) {
            reports.push(check_zivid(name, text));
            continue;
        }
        if !is_eki(name, text) {
            reports.push(check_ours(name, text, purpose));
            continue;
        }
        let checked = eki::check(name, text);
        channels.extend(checked.channel.map(|channel| (place, name, channel)));
        let eki::Checked { problems, warnings, says, .. } = checked;
        reports.push(FileReport { kind: Some("EthernetKRL"), problems, warnings, says });
    }
    let channels: Vec<_> = channels.iter().map(|(place, name, channel)| (*place, *name, channel)).collect();
    for (place, problem) in eki::clashes(&channels) {
        reports[place].problems.push(problem);
        reports[place].problems.sort_by_key(|problem| problem.line);
    }
    for (place, report) in krl::check(&programs, kss) {
        reports[place] = report;
    }
    reports
}

/// Checks the text of any configuration file by itself, for no purpose; `name` is the file's name in messages.
pub fn check_file(name: &str, text: &str) -> FileReport {
    check_files(&[(name, text)], None).swap_remove(0)
}

fn is_eki(name: &str, text: &str) -> bool {
    name.to_lowercase().ends_with(".xml") || text.trim_start_matches('\u{feff}').trim_start().starts_with('<')
}

fn is_yaml(name: &str) -> bool {
    let name = name.to_lowercase();
    name.ends_with(".yml") || name.ends_with(".yaml")
}

fn check_zivid(name: &str, text: &str) -> FileReport {
    let (problems, says) = match ZividSettings::read(name, text) {
        Ok(settings) => (vec![], settings.says()),
        Err(problems) => (problems.list, vec![]),
    };
    FileReport { kind: Some("zivid_settings"), problems, warnings: vec![], says }
}

fn check_ours(name: &str, text: &str, purpose: Option<Purpose>) -> FileReport {
    let Some(kind) = kind_of(&config::top_keys(text)) else {
        let begins = KINDS.map(|kind| format!("{} ({})", kind.name, kind.keys.join(", ")));
        return unclear(format!("not clear what this file is; its top would tell: {}", begins.join("; ")));
    };
    match (kind.check)(name, text) {
        Ok(says) => {
            let problems = purpose.map_or(vec![], |purpose| unmet_of(kind.name, (name, text), purpose));
            FileReport { kind: Some(kind.name), problems, warnings: vec![], says }
        }
        Err(problems) => {
            FileReport { kind: Some(kind.name), problems: problems.list, warnings: vec![], says: vec![] }
        }
    }
}

/// The kind that is checked for a purpose.
const CELL: &str = "cell";

/// What a cell's file does not say and this purpose needs, each at its line.
fn unmet_of(kind: &str, (name, text): (&str, &str), purpose: Purpose) -> Vec<Problem> {
    let cell = Some(kind).filter(|kind| *kind == CELL).and_then(|_| Cell::check(name, text).ok());
    let problem = |Unmet { key, message }: Unmet| {
        let message = format!("{message} ({} need it)", purpose.commands());
        Problem { line: config::line_of_key(text, &key), key, message }
    };
    let mut problems: Vec<Problem> =
        cell.map_or(vec![], |cell| unmet(&cell, purpose)).into_iter().map(problem).collect();
    problems.sort_by_key(|problem| problem.line);
    problems
}

fn unclear(message: String) -> FileReport {
    let problems = vec![Problem { line: 1, key: String::new(), message }];
    FileReport { kind: None, problems, warnings: vec![], says: vec![] }
}

/// The one kind that shares most names with the file; misspelt names count where no right one is there.
fn kind_of(top: &[String]) -> Option<&'static Kind> {
    let all: Vec<&str> = KINDS.iter().flat_map(|kind| kind.keys).copied().collect();
    let right = |kind: &Kind| top.iter().filter(|key| kind.keys.contains(&key.as_str())).count();
    let meant: Vec<&str> = top.iter().filter_map(|key| config::nearest(key, &all)).map(|(name, _)| name).collect();
    let near = |kind: &Kind| meant.iter().filter(|name| kind.keys.contains(name)).count();
    // A file that has all names of one kind and no other is of that kind, though a larger kind may know them as well.
    let is_whole = |kind: &Kind| top.len() == kind.keys.len() && right(kind) == top.len();
    match KINDS.iter().find(|kind| is_whole(kind)) {
        Some(kind) => Some(kind),
        None if KINDS.iter().any(|kind| right(kind) > 0) => most(right),
        None => most(near),
    }
}

fn most(score: impl Fn(&Kind) -> usize) -> Option<&'static Kind> {
    let best = KINDS.iter().map(&score).max().filter(|best| *best > 0)?;
    let mut kinds = KINDS.iter().filter(|kind| score(kind) == best);
    kinds.next().filter(|_| kinds.next().is_none())
}

fn say_zivid(zivid: &ZividCamera, device: &str) -> String {
    let which = match (&zivid.serial, &zivid.file_camera) {
        (_, Some(file)) => format!("{device} played from {}", file.display()),
        (Some(serial), None) => format!("{device} {serial}"),
        (None, None) => format!("{device}, the only one found"),
    };
    match zivid.settings.is_some() && zivid.settings_2d.is_some() {
        true => which,
        false => format!("{which}; takes no shot before settings and settings_2d are named"),
    }
}

fn say_gige(gige: &Gige, device: &str) -> String {
    match (&gige.serial, &gige.address) {
        (Some(serial), _) => format!("{device} {serial}"),
        (None, Some(address)) => format!("{device} at {address}"),
        (None, None) => format!("{device}, the only one found"),
    }
}

/// What the controller switches off by itself, and when.
fn say_off(after_s: &BTreeMap<String, u16>) -> String {
    let say = |(name, after_s): (&String, &u16)| match after_s {
        0 => format!("{name} at once"),
        _ => format!("{name} after {after_s} s"),
    };
    let words: Vec<String> = after_s.iter().map(say).collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

fn say_camera<Device>(camera: &Camera<Device>, device: impl Fn(&Device) -> String) -> String {
    match camera {
        Camera::Simulated => "simulated".to_owned(),
        Camera::Recorded { folder } => format!("recorded, from {}", folder.display()),
        Camera::Device(camera) => device(camera),
    }
}

fn say_tool(tool: &Tool) -> String {
    let Some(tool) = tool.compliant() else { return "a spring; nothing is told to it".to_owned() };
    let place = match &tool.address {
        Some(address) => format!("compliant, at {} port {}", address.host, address.port),
        None => "compliant, simulated".to_owned(),
    };
    let (stroke_mm, least_n, most_n, band_n) = (tool.stroke_mm, tool.min_force_n, tool.max_force_n, tool.band_n);
    format!("{place}; stroke {stroke_mm} mm, {least_n} to {most_n} N, kept within {band_n} N")
}

fn say_cell(cell: &Cell) -> Vec<String> {
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
            "the tool stays in {} … {} mm",
            list(space.min.mm.coords.as_slice()),
            list(space.max.mm.coords.as_slice())
        ),
        None => "no box for the tool is stated".to_owned(),
    };
    vec![
        format!("scanner: {}", say_camera(cell.scanner(), |zivid| say_zivid(zivid, "Zivid"))),
        format!("flange camera: {}", say_camera(cell.flange_camera(), |gige| say_gige(gige, "GigE Vision camera"))),
        format!(
            "robot: {controller}, commands on port {}, state on port {}",
            robot.command_port(),
            robot.state_port()
        ),
        format!("tool: {}", say_tool(cell.tool())),
        format!("poses: {}", named(cell.poses().keys().map(String::as_str).collect())),
        format!("outputs: {}", named(cell.io().outputs().keys().map(String::as_str).collect())),
        format!("off after the end of an epoch: {}", say_off(cell.io().off_after_s())),
        format!("feedbacks: {}", named(cell.io().feedbacks().keys().map(String::as_str).collect())),
        format!("calibration files named: {}", named(calibrations)),
        format!("limits: {box_of_waypoints}"),
        format!("store in {}", cell.store().display()),
    ]
}

fn say_recipe(recipe: &Recipe) -> Vec<String> {
    let (region, process, locate, path) = (recipe.region(), recipe.process(), recipe.locate(), recipe.path());
    let observation =
        process.observation_s().map_or("as long as the cell says".to_owned(), |time| format!("{time} s"));
    let removal = recipe.removal().map(|removal| {
        format!("{} µm to be removed, nowhere more than {} µm", removal.target_um(), removal.max_um())
    });
    let mut says = vec![
        format!("panel {}: {} rows by {} columns of grids", recipe.panel(), region.rows(), region.columns()),
        format!("film watched {observation}, {} pictures a second", process.frames_per_second()),
        format!("a grid is abraded at most {} times a cycle", process.max_passes_per_grid()),
        format!("a part is abraded in at most {} passes over all its cycles", process.passes_of_a_part()),
        format!(
            "panel accepted up to {} mm, {}° turned and {}° tilted from its taught place",
            locate.max_shift_mm(),
            locate.turn_limit_deg(),
            locate.max_tilt_deg()
        ),
        format!(
            "disc of {} mm, rows at most {} mm apart, {} mm/s",
            path.disc_diameter_mm(),
            path.step_over_mm(),
            path.feed_mm_s()
        ),
    ];
    says.extend(removal);
    says
}

fn say_intrinsics(intrinsics: Intrinsics) -> Vec<String> {
    let camera = intrinsics.camera;
    let view = |size_px: usize, focal_px: f64| Degrees::from_rad(2.0 * (size_px as f64 / 2.0 / focal_px).atan()).0;
    let (across, down) = (view(camera.width_px, camera.fx_px), view(camera.height_px, camera.fy_px));
    let residual = intrinsics.rms_px.map_or("unknown".to_owned(), |rms_px| format!("{rms_px:.3} px rms"));
    let mut says = vec![
        format!(
            "camera of {} × {} px that sees about {across:.1}° × {down:.1}°",
            camera.width_px, camera.height_px
        ),
        format!("residual: {residual}"),
    ];
    says.extend(intrinsics.extent.model.map(|model| format!("lens model: {model}")));
    says.extend(intrinsics.extent.left_out.iter().map(|reason| format!("left out of it: {reason}")));
    says.extend(intrinsics.extent.supported.map(|supported| {
        let picture_px2 = (camera.width_px * camera.height_px) as f64;
        let share = polygon::signed_area_px2(&supported.outline_px).abs() / picture_px2;
        format!(
            "known to {} px in {} % of the picture; measurements outside of that part are refused",
            fixed(supported.error_px, 2),
            fixed(share * 100.0, 0)
        )
    }));
    says
}

fn say_correction(correction: &RobotCorrection) -> Vec<String> {
    let [before, after] = [correction.left_out_before_mm, correction.left_out_after_mm].map(|mm| fixed(mm, 3));
    vec![
        format!("correction of the arm, {}", correction.numbers.kind()),
        format!("pictures that were left out: {before} mm rms off without it, {after} mm with it"),
    ]
}

fn say_removal(found: &RemovalCalibration) -> Vec<String> {
    let numbers = &found.numbers;
    vec![
        format!(
            "removal: k {:.3e} mm²/N, σ {} %, by {} coupons that differ by {} % from the model",
            numbers.preston_mm2_per_n(),
            fixed(numbers.preston_deviation_percent(), 1),
            numbers.coupons(),
            fixed(numbers.coupon_deviation_percent(), 1)
        ),
        format!(
            "ln k falls by {} on a square metre; orbit of {} mm at {} rev/min, pad of {} N/mm³",
            fixed(numbers.wear_per_m2(), 2),
            numbers.orbit_mm(),
            numbers.orbit_rev_min(),
            numbers.pad_n_mm3()
        ),
    ]
}

fn say_mount<M: Mount>(mounted: MountedPose<M>) -> Vec<String> {
    let rigid = mounted.rigid();
    let (from, to) = (M::From::NAME, M::To::NAME);
    let (origin, axis) = (rigid.origin().mm, (rigid * Vector::<M::From>::new(nalgebra::Vector3::z())).mm);
    let residual = mounted.rms_mm.map_or("unknown".to_owned(), |rms_mm| format!("{rms_mm:.3} mm rms"));
    let mut says = vec![
        format!("{from} at ({}, {}, {}) mm in {to}", fixed(origin.x, 1), fixed(origin.y, 1), fixed(origin.z, 1)),
        format!("its Z axis points along ({}, {}, {}) there", fixed(axis.x, 2), fixed(axis.y, 2), fixed(axis.z, 2)),
        format!("residual: {residual}"),
    ];
    if M::HAS_AXIS {
        let measured = if mounted.axis_measured == Some(true) { "measured" } else { "not measured" };
        says.push(format!("the tool's axis was {measured}"));
    }
    says.extend(mounted.board.map(|board| format!("the board: {board}")));
    says
}

#[cfg(test)]
mod tests {
    use super::*;

    fn says(name: &str, text: &str) -> Vec<String> {
        check_file(name, text).problems.into_iter().map(|problem| problem.message).collect()
    }

    /// What the sample calls a default is one.
    #[test]
    fn the_samples_state_the_defaults() {
        let text = include_str!("../config/cell.toml");
        let limits: Vec<&str> = text.lines().filter(|line| !line.starts_with("box_")).collect();
        assert_eq!(limits.len() + 2, text.lines().count(), "the box has no default");
        let (stated, default) = (Cell::check("cell.toml", &limits.join("\n")), Cell::check("cell.toml", ""));
        assert_eq!(stated.as_ref().map(Cell::limits), default.as_ref().map(Cell::limits));
        let text = include_str!("../config/panels/example.toml");
        let without: Vec<&str> = text.lines().filter(|line| !line.contains("# default")).collect();
        assert!(without.len() + 25 < text.lines().count());
        assert_eq!(Recipe::check("a", &without.join("\n")), Recipe::check("a", text));
    }

    #[test]
    fn a_file_is_known_by_its_tables() {
        for (text, kind) in [
            ("[robot]\nkind = 'mock'", Some("cell")),
            ("store = 'x'", Some("cell")),
            ("[robot_correction]\nkind = 'geometry'", Some("robot_correction")),
            ("[removal]\ncoupons = 12", Some("removal")),
            ("[locate]\n[region]\n[removal]", Some("recipe")),
            ("[locate]\n[corner]\n[robot]", Some("recipe")),
            ("[camera]", Some("intrinsics")),
            ("[base_from_camera]", Some("base_from_camera")),
            ("[flange_from_camera]", Some("flange_from_camera")),
            ("[flange_from_tool]", Some("flange_from_tool")),
            ("[regoin]\nrows = 3", Some("recipe")),
            ("[base_from_camrea]", Some("base_from_camera")),
            ("[base_from_camera]\n[flange_from_camera]", None),
            ("[camera]\n[scaner]\n[robt]", Some("intrinsics")),
            ("[wavelength]", None),
            ("", None),
        ] {
            assert_eq!(check_file("a.toml", text).kind, kind, "{text}");
        }
    }

    /// The lists of names at the top are those that the checks know.
    #[test]
    fn the_kinds_know_their_own_keys() {
        for kind in &KINDS {
            let problems = (kind.check)("a.toml", "wavelength = 3").expect_err("a wrong key");
            let message = format!("unknown key; known here: {}", kind.keys.join(", "));
            assert!(problems.list.iter().any(|problem| problem.message == message), "{}: {problems}", kind.name);
        }
    }

    #[test]
    fn what_is_not_clear_is_said() {
        assert_eq!(
            says("a.toml", "x = 3"),
            ["not clear what this file is; its top would tell: \
              cell (store, socket, socket_role, scanner, flange_camera, robot, tool, poses, io, calibration, limits, rough, arm, keep_out, page); \
              recipe (panel, process, locate, corner, region, inspect, surface, path, removal); \
              intrinsics (camera); base_from_camera (base_from_camera); \
              flange_from_camera (flange_from_camera); flange_from_tool (flange_from_tool); \
              base_from_board (base_from_board); robot_correction (robot_correction); removal (removal)"]
        );
        // Whatever it is called.
        assert_eq!(check_file("a.toml", "\u{feff}\n<ETHERNETKRL/>").kind, Some("EthernetKRL"));
        assert_eq!(check_file("CELLCMD.XML", "x = 3").kind, Some("EthernetKRL"));
    }

    /// By hand: 2 atan(972 / 1785) = 57.1°, 2 atan(600 / 1784) = 37.2°.
    #[test]
    fn what_was_understood_is_said() {
        let cell = "[robot]\nkind = 'eki'\nhost = 'krc'\n[scanner]\nkind = 'zivid'\nsettings = 's.yml'\nsettings_2d = 'p.yml'\n[limits]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 2, 3]";
        assert_eq!(
            check_file("c/cell.toml", cell).says,
            [
                "scanner: Zivid, the only one found",
                "flange camera: simulated",
                "robot: KUKA controller at krc, commands on port 54600, state on port 54601",
                "tool: a spring; nothing is told to it",
                "poses: none",
                "outputs: none",
                "off after the end of an epoch: none",
                "feedbacks: none",
                "calibration files named: none",
                "limits: the tool stays in [0, 0, 0] … [1, 2, 3] mm",
                "store in c/store",
            ]
        );
        let lens =
            "[camera]\nwidth_px = 1944\nheight_px = 1200\nfx_px = 1785\nfy_px = 1784\ncx_px = 972\ncy_px = 600
            k1 = 0\nk2 = 0\np1 = 0\np2 = 0\nk3 = 0\nrms_px = 0.2";
        assert_eq!(
            check_file("a.toml", lens).says,
            ["camera of 1944 × 1200 px that sees about 57.1° × 37.2°", "residual: 0.200 px rms"]
        );
        let mount = "[flange_from_tool]\nx_mm = 0\ny_mm = 10\nz_mm = 120\na_deg = 0\nb_deg = 90\nc_deg = 0";
        assert_eq!(
            check_file("a.toml", mount).says,
            [
                "tool at (0.0, 10.0, 120.0) mm in flange",
                "its Z axis points along (1.00, 0.00, 0.00) there",
                "residual: unknown",
                "the tool's axis was not measured"
            ]
        );
    }
}
