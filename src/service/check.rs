//! `panelprep check`: detects the kind of each file, reports its problems, and describes its content as the program
//! understood it.
//!
//! The kind of a file is determined by its top-level keys; the name of the file is free. Exceptions:
//!
//! - A file that begins with `<`, or whose name ends with `.xml`, is an EthernetKRL file. Several EthernetKRL files are
//!   also checked for conflicts with each other.
//! - Files with names that end with `.src`, `.sub` or `.dat` are KRL and are checked as one program.
//! - A file with a name that ends with `.yml` or `.yaml` contains the settings of a Zivid, or a lens calibration in the
//!   format of OpenCV, ROS or Zivid.
//!
//! Recipes that are checked together with one cell are compared with that cell.

mod controller;
mod eki;
mod report;
mod text;

pub use controller::is_krl;
pub use report::FileReport;
pub use text::{DecodedText, EncodingError, decode, utf_8_error};

use crate::requirements::recipe_fits::{parse_plausible_recipe, unmet_demands};
use crate::requirements::{
    CALIBRATION_ADVICE, ProblemKind, Purpose, ReadNamed, UnmetRequirement, incomplete_files, skip_file, to_problems,
};
use panelprep_base::config;
use panelprep_base::config::{Problem, Problems};
use panelprep_cell::cell::{
    CELL_KEYS, Cell, FlangeCameraMount, Intrinsics, Mount, MountedPose, RemovalCalibration, RobotCorrection,
    RobotKind, ScannerMount, TargetMount, ToolMount, ZividSettings,
};
use panelprep_cell::recipe::RECIPE_KEYS;
use panelprep_kuka::krl::Kss;
use panelprep_store::office::ArchiveSettings;
use report::{
    RECIPE, describe_archive, describe_cell, describe_correction, describe_intrinsics, describe_mount,
    describe_recipe, describe_removal, reports_of_kind,
};

/// A kind of configuration file: its name, its top-level keys, and the function that checks it.
struct FileKind {
    name: &'static str,
    keys: &'static [&'static str],
    check: fn(&str, &str) -> Result<Vec<String>, Problems>,
}

const KINDS: [FileKind; 10] = [
    FileKind {
        name: CELL_KIND,
        keys: &CELL_KEYS,
        check: |name, text| Cell::check(name, text).map(|cell| describe_cell(&cell)),
    },
    FileKind {
        name: RECIPE,
        keys: &RECIPE_KEYS,
        check: |name, text| parse_plausible_recipe(name, text).map(|recipe| describe_recipe(&recipe)),
    },
    FileKind {
        name: "intrinsics",
        keys: &["camera", "scanner_errors"],
        check: |name, text| Intrinsics::check(name, text).map(describe_intrinsics),
    },
    mount::<ScannerMount>(&[ScannerMount::TABLE]),
    mount::<FlangeCameraMount>(&[FlangeCameraMount::TABLE]),
    mount::<ToolMount>(&[ToolMount::TABLE]),
    mount::<TargetMount>(&[TargetMount::TABLE]),
    FileKind {
        name: "robot_correction",
        keys: &["robot_correction"],
        check: |name, text| RobotCorrection::check(name, text).map(|correction| describe_correction(&correction)),
    },
    FileKind {
        name: "removal",
        keys: &["removal"],
        check: |name, text| RemovalCalibration::check(name, text).map(|found| describe_removal(&found)),
    },
    FileKind {
        name: "archive",
        keys: &["broker", "database", "files", "fleet"],
        check: |name, text| ArchiveSettings::check(name, text).map(|settings| describe_archive(&settings)),
    },
];

const fn mount<M: Mount>(keys: &'static [&'static str]) -> FileKind {
    FileKind { name: M::TABLE, keys, check: |name, text| MountedPose::<M>::check(name, text).map(describe_mount) }
}

/// The purpose for which files are checked, and the options of the check.
#[derive(Clone, Copy)]
pub struct CheckedFor<'a> {
    /// The purpose for which the cell's file must be complete. With `None`, the keys that only a motion or a cycle
    /// needs may be missing.
    pub purpose: Option<Purpose>,
    /// Whether a missing file that the cell's file names is only a warning.
    pub are_missing_files_allowed: bool,
    /// The function that reads the files named in the cell's file.
    pub read: ReadNamed<'a>,
    /// The version of KSS on the controller: KRL is checked for this version and higher ones; `None` if it is not
    /// known.
    pub kss: Option<Kss>,
}

/// Checks the texts of configuration files: each file by itself, and all files against each other. Each element of
/// `files` is the file's name in messages and its text. If a purpose is given, the cell's file must contain all values
/// that this purpose needs; the files that it names are not read.
pub fn check_files(files: &[(&str, &str)], purpose: Option<Purpose>) -> Vec<FileReport> {
    let checked_for = CheckedFor { purpose, are_missing_files_allowed: true, read: &skip_file, kss: None };
    check_files_for(files, &checked_for)
}

/// Checks configuration files as [`check_files`] does, with the purpose and the other conditions of `checked_for`.
pub fn check_files_for(files: &[(&str, &str)], checked_for: &CheckedFor<'_>) -> Vec<FileReport> {
    let mut channels = Vec::new();
    let mut programs = Vec::new();
    let mut reports = Vec::new();
    for (place, &(name, text)) in files.iter().enumerate() {
        if is_krl(name) {
            programs.push((place, name, text));
            reports.push(FileReport { kind: None, problems: vec![], warnings: vec![], descriptions: vec![] });
            continue;
        }
        if Intrinsics::is_foreign_format(text) {
            let (problems, content) = match Intrinsics::check(name, text) {
                Ok(intrinsics) => (vec![], describe_intrinsics(intrinsics)),
                Err(problems) => (problems.list, vec![]),
            };
            reports.push(FileReport {
                kind: Some("intrinsics"),
                problems,
                warnings: vec![],
                descriptions: content,
            });
            continue;
        }
        if is_yaml(name) {
            reports.push(check_zivid(name, text));
            continue;
        }
        if !is_eki(name, text) {
            reports.push(check_own_format(name, text, checked_for));
            continue;
        }
        let checked = eki::check_eki_file(name, text);
        channels.extend(checked.channel.map(|channel| (place, name, channel)));
        let eki::EkiCheckResult { problems, warnings, descriptions: content, .. } = checked;
        reports.push(FileReport { kind: Some("EthernetKRL"), problems, warnings, descriptions: content });
    }
    let channels: Vec<_> = channels.iter().map(|(place, name, channel)| (*place, *name, channel)).collect();
    for (place, problem) in eki::find_clashes(&channels) {
        reports[place].problems.push(problem);
    }
    for (place, warning) in eki::differing_address_warnings(&channels) {
        reports[place].warnings.push(warning);
    }
    for (place, report) in controller::check_krl_files(&programs, checked_for.kss) {
        reports[place] = report;
    }
    check_recipes_against_cell(files, checked_for.read, &mut reports);
    match single_cell(files, &reports) {
        Some((place, cell)) if cell.robot().kind() == RobotKind::Eki => {
            controller::compare_with_cell(files, (place, &cell), &mut reports);
        }
        _ => controller::compare_programs(files, &mut reports),
    }
    for report in &mut reports {
        report.problems.sort_by_key(|problem| problem.line);
        report.warnings.sort_by_key(|warning| warning.line);
    }
    reports
}

/// Returns the cell and its index in `files`, if exactly one of the files is a cell and it has no problem.
fn single_cell(files: &[(&str, &str)], reports: &[FileReport]) -> Option<(usize, Cell)> {
    let [place] = reports_of_kind(CELL_KIND, reports)[..] else { return None };
    Some((place, Cell::check(files[place].0, files[place].1).ok()?))
}

/// Reports the requirements of recipes that the cell cannot meet, if exactly one cell is among the files.
fn check_recipes_against_cell(files: &[(&str, &str)], read: ReadNamed<'_>, reports: &mut [FileReport]) {
    let Some((_, cell)) = single_cell(files, reports) else { return };
    for place in reports_of_kind(RECIPE, reports) {
        let (name, text) = files[place];
        let Ok(recipe) = parse_plausible_recipe(name, text) else { continue };
        let unfit = unmet_demands(&cell, &recipe, read);
        reports[place].problems.extend(to_problems(text, unfit));
    }
}

/// Checks the text of any configuration file by itself, without a purpose; `name` is the file's name in messages.
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
        Ok(settings) => (vec![], settings.summary()),
        Err(problems) => (problems.list, vec![]),
    };
    FileReport { kind: Some("zivid_settings"), problems, warnings: vec![], descriptions: says }
}

fn check_own_format(name: &str, text: &str, checked_for: &CheckedFor<'_>) -> FileReport {
    let Some(kind) = detect_kind(&config::top_keys(text)) else {
        let begins = KINDS.map(|kind| format!("{} ({})", kind.name, kind.keys.join(", ")));
        return unclear_kind_report(format!(
            "the kind of this file is not recognized: it has no top-level key of a known kind. The kinds and their \
             keys: {}",
            begins.join("; ")
        ));
    };
    match (kind.check)(name, text) {
        Ok(says) => {
            let (problems, warnings) = match kind.name {
                CELL_KIND => check_completeness(name, text, checked_for),
                _ => (vec![], vec![]),
            };
            FileReport { kind: Some(kind.name), problems, warnings, descriptions: says }
        }
        Err(problems) => {
            FileReport { kind: Some(kind.name), problems: problems.list, warnings: vec![], descriptions: vec![] }
        }
    }
}

/// Kind of a cell's file, the only kind that is checked for a purpose.
const CELL_KIND: &str = "cell";

/// Returns the problems and the warnings about values that the purpose needs and the cell's file does not contain, each
/// with its line. The first problem names the purpose. If missing files are allowed, all of them are reported in one
/// warning.
fn check_completeness(name: &str, text: &str, checked_for: &CheckedFor<'_>) -> (Vec<Problem>, Vec<Problem>) {
    let Ok(cell) = Cell::check(name, text) else { return (vec![], vec![]) };
    // Without a purpose no value is required, but the values that are present must be valid.
    let mut all = incomplete_files(&cell, checked_for.purpose.unwrap_or(Purpose::Cycle), checked_for.read);
    all.retain(|unmet| {
        checked_for.purpose.is_some() || matches!(unmet.kind, ProblemKind::MissingFile | ProblemKind::WrongFile)
    });
    let may_lack =
        |unmet: &UnmetRequirement| checked_for.are_missing_files_allowed && unmet.kind == ProblemKind::MissingFile;
    let (missing, unmet): (Vec<UnmetRequirement>, Vec<UnmetRequirement>) = all.into_iter().partition(may_lack);
    // The programs are accepted after the cell's file is written, so a new file is valid without their checksum.
    let later =
        |unmet: &UnmetRequirement| checked_for.are_missing_files_allowed && unmet.kind == ProblemKind::Acceptance;
    let (open, unmet): (Vec<UnmetRequirement>, Vec<UnmetRequirement>) = unmet.into_iter().partition(later);
    let mut problems = to_problems(text, unmet);
    if let (Some(first), Some(purpose)) = (problems.first_mut(), checked_for.purpose) {
        first.message = format!(
            "{} ({} start only when all problems in this list are corrected)",
            first.message,
            purpose.commands()
        );
    }
    (problems, missing_files_warning(text, missing).into_iter().chain(to_problems(text, open)).collect())
}

/// Returns one warning that lists all missing files, at the line of the first one.
fn missing_files_warning(text: &str, missing: Vec<UnmetRequirement>) -> Option<Problem> {
    let lines = missing.iter().map(|unmet| config::key_line(text, &unmet.key));
    let line = lines.min()?;
    let keys: Vec<String> = missing.into_iter().map(|unmet| unmet.key).collect();
    let files = if keys.len() == 1 { "the file that it names does" } else { "the files that it names do" };
    Some(Problem {
        line,
        key: keys.join(", "),
        message: format!(
            "{files} not exist, but a cycle needs every file; for a calibration file: {CALIBRATION_ADVICE}"
        ),
    })
}

fn unclear_kind_report(message: String) -> FileReport {
    let problems = vec![Problem { line: 1, key: String::new(), message }];
    FileReport { kind: None, problems, warnings: vec![], descriptions: vec![] }
}

/// Returns the kind that has the most top-level keys in common with the file; `None` if two kinds have the same number.
/// If the file has no key of a known kind, the most similar known keys are used, because keys may be misspelt.
fn detect_kind(top: &[String]) -> Option<&'static FileKind> {
    let all: Vec<&str> = KINDS.iter().flat_map(|kind| kind.keys).copied().collect();
    let right = |kind: &FileKind| top.iter().filter(|key| kind.keys.contains(&key.as_str())).count();
    let meant: Vec<&str> = top.iter().filter_map(|key| config::nearest(key, &all)).map(|(name, _)| name).collect();
    let near = |kind: &FileKind| meant.iter().filter(|name| kind.keys.contains(name)).count();
    // A file with exactly the keys of one kind is of that kind, even if another kind has these keys and further ones.
    let is_whole = |kind: &FileKind| top.len() == kind.keys.len() && right(kind) == top.len();
    match KINDS.iter().find(|kind| is_whole(kind)) {
        Some(kind) => Some(kind),
        None if KINDS.iter().any(|kind| right(kind) > 0) => best_scoring(right),
        None => best_scoring(near),
    }
}

fn best_scoring(score: impl Fn(&FileKind) -> usize) -> Option<&'static FileKind> {
    let best = KINDS.iter().map(&score).max().filter(|best| *best > 0)?;
    let mut kinds = KINDS.iter().filter(|kind| score(kind) == best);
    kinds.next().filter(|_| kinds.next().is_none())
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::recipe::Recipe;

    fn problem_messages(name: &str, text: &str) -> Vec<String> {
        check_file(name, text).problems.into_iter().map(|problem| problem.message).collect()
    }

    /// Compares each default value that a sample file states with the default value of the program.
    #[test]
    fn sample_files_state_the_default_values() {
        let text = include_str!("../../config/cell.toml");
        let has_default = |line: &&str| !line.starts_with("box_") && !line.starts_with("tool_error_mm");
        let limits: Vec<&str> = text.lines().filter(has_default).collect();
        assert_eq!(limits.len() + 3, text.lines().count(), "the box and the error at the tool have no default");
        let (stated, default) = (Cell::check("cell.toml", &limits.join("\n")), Cell::check("cell.toml", ""));
        assert_eq!(stated.as_ref().map(Cell::limits), default.as_ref().map(Cell::limits));
        let text = include_str!("../../config/panels/example.toml");
        let without: Vec<&str> = text.lines().filter(|line| !line.contains("# default")).collect();
        assert!(without.len() + 25 < text.lines().count());
        assert_eq!(Recipe::check("a", &without.join("\n")), Recipe::check("a", text));
    }

    #[test]
    fn top_level_keys_determine_the_kind() {
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

    /// Compares the top-level keys that `KINDS` lists with the keys that the checks accept.
    #[test]
    fn each_kind_lists_the_keys_that_its_check_accepts() {
        for kind in &KINDS {
            let problems = (kind.check)("a.toml", "wavelength = 3").expect_err("a wrong key");
            let message = format!("unknown key; valid keys here: {}", kind.keys.join(", "));
            assert!(problems.list.iter().any(|problem| problem.message == message), "{}: {problems}", kind.name);
        }
    }

    #[test]
    fn a_file_of_unclear_kind_is_reported() {
        assert_eq!(
            problem_messages("a.toml", "x = 3"),
            [
                "the kind of this file is not recognized: it has no top-level key of a known kind. The kinds and their \
                 keys: cell (store, socket, socket_role, scanner, flange_camera, robot, tool, poses, io, calibration, \
                 limits, rough, arm, keep_out, page, office, push, sparkplug, opcua, line, part); recipe (panel, process, \
                 locate, corner, region, inspect, surface, path, treat, removal, nominal); intrinsics (camera, \
                 scanner_errors); base_from_camera (base_from_camera); flange_from_camera (flange_from_camera); \
                 flange_from_tool (flange_from_tool); base_from_board (base_from_board); robot_correction \
                 (robot_correction); removal (removal); archive (broker, database, files, fleet)"
            ]
        );
        // The kind does not depend on the file's name.
        assert_eq!(check_file("a.toml", "\u{feff}\n<ETHERNETKRL/>").kind, Some("EthernetKRL"));
        assert_eq!(check_file("CELLCMD.XML", "x = 3").kind, Some("EthernetKRL"));
    }

    /// Expected values, calculated by hand: 2 atan(972 / 1785) = 57.1° and 2 atan(600 / 1784) = 37.2°. The recipe is
    /// valid when it is checked alone. When it is checked with a cell, the cell's tool must be able to execute it.
    #[test]
    fn recipes_are_checked_against_the_cell() {
        let recipe = ("panel.toml", include_str!("../../config/panels/example.toml"));
        let told = |files: &[(&str, &str)]| -> Vec<String> {
            let reports = check_files(files, None);
            reports.into_iter().flat_map(|report| report.problems).map(|problem| problem.key).collect()
        };
        let (compliant, spring) =
            (("cell.toml", "[tool]\nkind = \"simulated\"\n"), ("b.toml", "[tool]\nkind = \"spring\"\n"));
        assert_eq!([told(&[recipe]), told(&[spring, recipe])], [vec![], Vec::<String>::new()]);
        assert_eq!(told(&[compliant, recipe]), ["path.force_n"]);
        assert_eq!(told(&[recipe, compliant]), ["path.force_n"]);
        assert_eq!(
            told(&[recipe, compliant, spring]),
            Vec::<String>::new(),
            "of two cells it is not known which one is meant"
        );
    }

    #[test]
    fn the_report_describes_the_content() {
        let cell = "[robot]\nkind = 'eki'\nhost = 'krc'\n[scanner]\nkind = 'zivid'\nsettings = 's.yml'\nsettings_2d = 'p.yml'\n[limits]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 2, 3]";
        assert_eq!(
            check_file("c/cell.toml", cell).descriptions,
            [
                "scanner: Zivid, the only one found",
                "flange camera: simulated",
                "robot: KUKA controller at krc, commands on port 54600, state on port 54601",
                "arm: kr6-r700-2, from the public model of kroshu/kuka_robot_descriptions, kuka_agilus_support",
                "tool: a spring; it receives no commands",
                "poses: none",
                "outputs: none",
                "off after the end of an epoch: none",
                "feedbacks: none",
                "calibration files named: none",
                "limits: the tool centre point stays in the box from [0, 0, 0] to [1, 2, 3] mm",
                "store in c/store",
                "not compared with cell_config.dat, cell_motion.src, CELLCMD.xml, CELLSTAT.xml: it is not verified \
                 that a stop is received and switches tool and water off, or that signals and ports are the same on \
                 both sides. Check this file together with the controller's files",
            ]
        );
        let lens =
            "[camera]\nwidth_px = 1944\nheight_px = 1200\nfx_px = 1785\nfy_px = 1784\ncx_px = 972\ncy_px = 600
            k1 = 0\nk2 = 0\np1 = 0\np2 = 0\nk3 = 0\nrms_px = 0.2";
        assert_eq!(
            check_file("a.toml", lens).descriptions,
            ["camera of 1944 × 1200 px with a field of view of about 57.1° × 37.2°", "residual: 0.200 px rms"]
        );
        let mount = "[flange_from_tool]\nx_mm = 0\ny_mm = 10\nz_mm = 120\na_deg = 0\nb_deg = 90\nc_deg = 0";
        assert_eq!(
            check_file("a.toml", mount).descriptions,
            [
                "tool at (0.0, 10.0, 120.0) mm in flange",
                "its Z axis in that frame: (1.00, 0.00, 0.00)",
                "residual: unknown",
                "the tool's axis was not measured"
            ]
        );
    }
}
