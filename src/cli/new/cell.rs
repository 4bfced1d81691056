//! `panelprep new cell`: writes a cell file from the tables of the sample files for the connected devices, with the
//! answers of a person.
//!
//! For a real cell, poses, box, inputs and outputs can only be stated by its own people. Values that were not answered
//! are those of the sample; this is marked in the file and in the result. Optional entries (the arm's surroundings, the
//! camera poses measured with a tape, a stated error of the tool) are written as comments.

use super::super::args::{Common, FlangeCameraKind, NewCell, RobotKindName, ScannerKind};
use super::super::connecting::{self, FoundDevices};
use super::super::disk;
use super::super::fault::Fault;
use super::super::output::{Outcome, write_progress};
use super::questions::{Asker, BoxMm, Question, Refusal, accept_any, format_numbers, refusal, set};
use super::recipe::parse_document;
use clap::ValueEnum;
use panelprep_base::config::Problems;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cell::Cell;
use panelprep_service::requirements::{Purpose, to_problems, unmet_requirements};
use serde_json::json;
use toml_edit::Array;

const SIMULATED: &str = include_str!("../../../config/cell.toml");
const REAL_CELL_TEMPLATE: &str = include_str!("../../../config/cell-example.toml");
/// The paths of the store and the socket of an installed service.
const SERVICE_STORE: &str = "/var/lib/panelprep";
const SERVICE_SOCKET: &str = "/run/panelprep/panelprep.sock";
/// Tables whose values every real cell must state itself.
const CELL_SPECIFIC_TABLES: [&str; 5] = ["poses.park", "io.outputs", "io.off_after_s", "io.feedbacks", "limits"];
/// The optional tables of a real cell.
const OPTIONAL_TABLES: [&str; 7] = [
    "poses.ready",
    "poses.verify",
    "poses.service",
    "rough.base_from_camera",
    "rough.flange_from_camera",
    "arm",
    "keep_out",
];
/// The key of a number that only a person can state.
const STATED_NUMBER_KEY: &str = "tool_error_mm";

/// Returns the problems that `panelprep check` finds in the text of a cell file; the files that it names may be
/// missing.
fn problems(name: &str, text: &str) -> Problems {
    match Cell::check(name, text) {
        Err(problems) => problems,
        Ok(cell) => {
            Problems { file: name.to_owned(), list: to_problems(text, unmet_requirements(&cell, Purpose::Cycle)) }
        }
    }
}

/// The answers; initially the proposed values.
#[derive(Clone)]
struct Answers {
    scanner: ScannerKind,
    scanner_serial: Option<String>,
    flange_camera: FlangeCameraKind,
    /// The key by which the flange camera is selected, and its value.
    flange_camera_by: Option<(&'static str, String)>,
    robot: RobotKindName,
    host: Option<String>,
    /// The park pose and the box of the TCP; only for a real cell.
    motion: Option<Motion>,
    store: String,
}

/// The limits of the motions of a real cell.
#[derive(Clone)]
struct Motion {
    park_deg: [f64; 6],
    box_mm: BoxMm,
}

/// The limits of the motions in the sample file.
const SAMPLE_MOTION: Motion = Motion {
    park_deg: [-90.0, -120.0, 120.0, 0.0, 60.0, 0.0],
    box_mm: [[250.0, -450.0, 50.0], [750.0, 450.0, 900.0]],
};

/// The file that lists the networks of the cell for the service's systemd unit.
const NETWORKS_FILE: &str = "/etc/systemd/system/panelprep.service.d/network.conf";

/// Asks the questions and writes the cell file.
pub(super) fn run(args: &NewCell, common: &Common) -> Result<Outcome, Fault> {
    if args.out.symlink_metadata().is_ok() {
        return Err(Fault::AlreadyExists { file: args.out.clone() });
    }
    let answers = Answers::ask_questions(args, common, &mut Asker::for_terminal(args.yes))?;
    let name = args.out.display().to_string();
    let text = text(&name, &answers)?;
    let problems = problems(&name, &text);
    if !problems.list.is_empty() {
        return Err(problems.into());
    }
    disk::write_new(&args.out, &text)?;
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    outcome.lines = vec![
        format!("written: {name}; `panelprep check {name}` accepts it"),
        format!(
            "next, make the files that the cell's file names: `panelprep check --for cycle {name}` lists these files"
        ),
    ];
    let to_check: &[&str] = if answers.robot == RobotKindName::Eki { &CELL_SPECIFIC_TABLES } else { &[] };
    if !to_check.is_empty() {
        let tables = to_check.join(", ");
        outcome.add_line(format!(
            "compare the numbers in these tables with your cell before anything moves: {tables}"
        ));
        outcome.add_line(
            "measure the cameras' positions with a tape, and state the positions in [rough]: without [rough], the \
             calibration of a camera's mount ends in review",
        );
        outcome.add_line(format!(
            "the service can reach only the networks in {NETWORKS_FILE}: see the page network of the manual"
        ));
    }
    outcome.add_value("file", json!(args.out));
    outcome.add_value("to_check", json!(to_check));
    Ok(outcome)
}

/// Refuses options that belong to another kind of device than the chosen one. Otherwise a person would believe that the
/// value is in the file.
fn refuse_options(
    others: &'static str,
    chosen: &str,
    given: &[(&'static str, &Option<String>)],
) -> Result<(), Fault> {
    let of_another = given.iter().find_map(|(option, value)| Some((*option, value.as_ref()?)));
    of_another.map_or(Ok(()), |(option, found)| {
        let problem = format!(
            "the option belongs to {others}, but {chosen} was chosen; leave the option out, or choose {others}"
        );
        Err(Fault::BadAnswer { option, found: found.clone(), problem })
    })
}

/// Reports the result of a search for devices, and returns what was found; empty if no search was made.
fn report_search(args: &NewCell, look: impl FnOnce() -> FoundDevices) -> Vec<String> {
    if args.no_search {
        return vec![];
    }
    let FoundDevices { serials, description: words } = look();
    write_progress(&words);
    serials
}

impl Answers {
    /// Returns the proposed answers, for a cell that needs no device.
    fn proposed_answers() -> Self {
        Answers {
            scanner: ScannerKind::Simulated,
            scanner_serial: None,
            flange_camera: FlangeCameraKind::Simulated,
            flange_camera_by: None,
            robot: RobotKindName::Mock,
            host: None,
            motion: None,
            store: "store".to_owned(),
        }
    }

    fn ask_questions(args: &NewCell, common: &Common, asker: &mut Asker<'_>) -> Result<Self, Fault> {
        // The robot is asked first, because it determines which cameras may be simulated.
        let answers = robot(args, asker, Answers::proposed_answers())?;
        let answers = scanner(args, asker, answers)?;
        let mut answers = flange_camera(args, asker, answers)?;
        let is_real = answers.robot == RobotKindName::Eki;
        if is_real {
            answers.motion = Some(motion(args, asker, &answers)?);
        }
        let given = common.store.as_ref().map(|folder| folder.display().to_string());
        let question = Question::new("the store's folder", "--store", given.as_deref());
        let proposal = if is_real { SERVICE_STORE } else { "store" };
        answers.store = asker.ask_text(&question.with_proposal(proposal), |store| {
            Answers { store: store.clone(), ..answers.clone() }.check_file("store")
        })?;
        Ok(answers)
    }

    /// Checks that the file with these answers has no problem at keys that begin with `keys`.
    fn check_file(&self, keys: &str) -> Refusal {
        let text = text("", self).map_err(|fault| fault.to_string())?;
        refusal(problems("", &text).list, keys)
    }

    /// Returns whether the robot controller is a separate device; then no camera may be simulated.
    fn is_robot_remote(&self) -> bool {
        Answers { scanner: ScannerKind::Simulated, ..self.clone() }.check_file("scanner.kind").is_err()
    }
}

/// Returns the error for an option whose value is not valid here.
fn refuse_option_value<T: ValueEnum>(
    option: &'static str,
    value: T,
    check: impl Fn(&T) -> Refusal,
) -> Result<T, Fault> {
    let Err(problem) = check(&value) else { return Ok(value) };
    let found = value.to_possible_value().map_or(String::new(), |word| word.get_name().to_owned());
    Err(Fault::BadAnswer { option, found, problem })
}

fn scanner(args: &NewCell, asker: &mut Asker<'_>, answers: Answers) -> Result<Answers, Fault> {
    let found = match (args.scanner, &args.scanner_serial) {
        (None | Some(ScannerKind::Zivid), None) => report_search(args, connecting::find_zivid_camera),
        _ => vec![],
    };
    let is_none = found.is_empty() && args.scanner_serial.is_none() && !answers.is_robot_remote();
    let proposal = if is_none { "simulated" } else { "zivid" };
    let kinds = [("simulated", ScannerKind::Simulated), ("zivid", ScannerKind::Zivid)];
    let check = |scanner: &ScannerKind| Answers { scanner: *scanner, ..answers.clone() }.check_file("scanner.kind");
    let scanner = match args.scanner {
        Some(kind) => refuse_option_value("--scanner", kind, check)?,
        None => {
            let question = Question::new("the fixed 3D camera: simulated or zivid", "--scanner", None);
            asker.ask_choice(&question.with_proposal(proposal), &kinds, check)?
        }
    };
    let scanner_serial = match (scanner, &args.scanner_serial) {
        (ScannerKind::Simulated, _) => {
            let given = [("--scanner-serial", &args.scanner_serial)];
            refuse_options("--scanner zivid", "--scanner simulated", &given)?;
            None
        }
        (ScannerKind::Zivid, given @ Some(_)) => given.clone(),
        // Without a serial number, the first camera that was found is used.
        (ScannerKind::Zivid, None) => found.into_iter().next(),
    };
    Ok(Answers { scanner, scanner_serial, ..answers })
}

fn flange_camera(args: &NewCell, asker: &mut Asker<'_>, answers: Answers) -> Result<Answers, Fault> {
    let is_named = args.flange_camera_serial.is_some() || args.flange_camera_address.is_some();
    let found = match args.flange_camera {
        Some(FlangeCameraKind::Simulated) => vec![],
        _ if is_named => vec![],
        _ => report_search(args, connecting::find_gige_cameras),
    };
    let is_none = found.is_empty() && !is_named && !answers.is_robot_remote();
    let proposal = if is_none { "simulated" } else { "gige" };
    let kinds = [("simulated", FlangeCameraKind::Simulated), ("gige", FlangeCameraKind::Gige)];
    let check = |flange_camera: &FlangeCameraKind| {
        Answers { flange_camera: *flange_camera, ..answers.clone() }.check_file("flange_camera.kind")
    };
    let flange_camera = match args.flange_camera {
        Some(kind) => refuse_option_value("--flange-camera", kind, check)?,
        None => {
            let question = Question::new("the camera on the flange: simulated or gige", "--flange-camera", None);
            asker.ask_choice(&question.with_proposal(proposal), &kinds, check)?
        }
    };
    let answers = Answers { flange_camera, ..answers };
    let flange_camera_by = match flange_camera {
        FlangeCameraKind::Simulated => {
            let given = [
                ("--flange-camera-serial", &args.flange_camera_serial),
                ("--flange-camera-address", &args.flange_camera_address),
            ];
            refuse_options("--flange-camera gige", "--flange-camera simulated", &given)?;
            None
        }
        FlangeCameraKind::Gige => {
            let (key, question) = match &args.flange_camera_address {
                Some(address) => {
                    let words = "address of the camera on the flange";
                    ("address", Question::new(words, "--flange-camera-address", Some(address)))
                }
                None => {
                    let given = args.flange_camera_serial.as_deref();
                    let words = "serial number of the camera on the flange";
                    ("serial", Question::new(words, "--flange-camera-serial", given))
                }
            };
            let question = match found.first() {
                Some(serial) => question.with_proposal(serial.clone()),
                None => question,
            };
            let by = asker.ask_text(&question, |by| {
                Answers { flange_camera_by: Some((key, by.clone())), ..answers.clone() }.check_file("flange_camera")
            })?;
            Some((key, by))
        }
    };
    Ok(Answers { flange_camera_by, ..answers })
}

fn robot(args: &NewCell, asker: &mut Asker<'_>, answers: Answers) -> Result<Answers, Fault> {
    let of_eki = [
        ("--host", &args.host),
        ("--park-deg", &args.park_deg),
        ("--box-min-mm", &args.box_min_mm),
        ("--box-max-mm", &args.box_max_mm),
    ];
    let kinds = [("mock", RobotKindName::Mock), ("eki", RobotKindName::Eki)];
    let robot = match args.robot {
        Some(kind) => kind,
        None => {
            let words = "the robot's controller: mock (inside this program) or eki (a KUKA controller)";
            let proposal = if of_eki.iter().any(|(_, value)| value.is_some()) { "eki" } else { "mock" };
            asker.ask_choice(&Question::new(words, "--robot", None).with_proposal(proposal), &kinds, accept_any)?
        }
    };
    if robot == RobotKindName::Mock {
        refuse_options("--robot eki", "--robot mock", &of_eki)?;
        return Ok(answers);
    }
    let answers = Answers { robot, motion: Some(SAMPLE_MOTION), ..answers };
    let question = Question::new("the controller's address on its KLI network", "--host", args.host.as_deref());
    let host = asker
        .ask_text(&question, |host| Answers { host: Some(host.clone()), ..answers.clone() }.check_file("robot"))?;
    if !args.no_search {
        write_progress(&connecting::controller(&host, STATE_PORT));
    }
    Ok(Answers { host: Some(host), ..answers })
}

fn motion(args: &NewCell, asker: &mut Asker<'_>, answers: &Answers) -> Result<Motion, Fault> {
    let words =
        "axis angles at which the arm is clear of the panel and of both cameras' view, degrees: a1,a2,a3,a4,a5,a6";
    let question = Question::new(words, "--park-deg", args.park_deg.as_deref());
    let park_deg = asker.numbers(
        &question.with_proposal(format_numbers(&SAMPLE_MOTION.park_deg)),
        |park_deg: &[f64; 6]| {
            if park_deg.iter().all(|angle| *angle == 0.0) {
                return Err("all axes at 0 is not a park pose: state angles at which the arm is clear".to_owned());
            }
            let motion = Motion { park_deg: *park_deg, ..SAMPLE_MOTION };
            Answers { motion: Some(motion), ..answers.clone() }.check_file("poses")
        },
    )?;
    let [least, greatest] = SAMPLE_MOTION.box_mm.map(|corner| format_numbers(&corner));
    let words = "minimum corner of the box in which the tool's tip must stay, mm in the robot's base: x,y,z";
    let corners = [
        Question::new(words, "--box-min-mm", args.box_min_mm.as_deref()).with_proposal(least),
        Question::new("maximum corner of this box: x,y,z", "--box-max-mm", args.box_max_mm.as_deref())
            .with_proposal(greatest),
    ];
    let box_mm = asker.box_mm(corners, |box_mm| {
        let motion = Motion { park_deg, box_mm: *box_mm };
        Answers { motion: Some(motion), ..answers.clone() }.check_file("limits")
    })?;
    Ok(Motion { park_deg, box_mm })
}

/// The TCP port of the state channel in the sample files.
const STATE_PORT: u16 = 54_601;

/// One table of a TOML file: its header and all lines up to the next header.
struct Block<'t> {
    /// The name of the table, for example `poses.park`; empty for the lines before the first table.
    name: &'t str,
    text: &'t str,
}

/// Divides a file into its tables.
fn split_tables(text: &str) -> Vec<Block<'_>> {
    let starts = text.match_indices('\n').map(|(at, _)| at + 1).filter(|at| text[*at..].starts_with('['));
    let mut cuts: Vec<usize> = std::iter::once(0).chain(starts).collect();
    cuts.push(text.len());
    let block = |cut: &[usize]| {
        let text = &text[cut[0]..cut[1]];
        let header = text.lines().next().unwrap_or_default().trim_start_matches('[');
        let name = if text.starts_with('[') { header.split(']').next().unwrap_or_default() } else { "" };
        Block { name, text }
    };
    cuts.windows(2).map(block).collect()
}

fn block<'t>(text: &'t str, name: &str) -> &'t str {
    split_tables(text).into_iter().find(|block| block.name == name).map_or("", |block| block.text)
}

/// Converts the lines of a table to comments.
fn as_comments(text: &str) -> String {
    let line = |line: &str| match line.trim().is_empty() || line.starts_with('#') {
        true => format!("{line}\n"),
        false => format!("# {line}\n"),
    };
    text.lines().map(line).collect()
}

/// Adds the comment that the values of a table must be compared with the cell.
fn to_check(text: &str) -> String {
    let line = |line: &str| match line.starts_with(STATED_NUMBER_KEY) {
        true => format!("# {line}\n"),
        false => format!("{line}\n"),
    };
    let lines: String = text.lines().map(line).collect();
    format!("{CHECK_COMMENT}\n{lines}")
}

/// The comment that is written before each table with values of the sample.
const CHECK_COMMENT: &str = "# TO CHECK before anything moves: numbers in this table that you did not state are from \
                             the sample, not from your cell.";

/// Returns the text of the cell file.
fn text(name: &str, answers: &Answers) -> Result<String, Fault> {
    let is_real = answers.robot == RobotKindName::Eki;
    let scanner = if answers.scanner == ScannerKind::Zivid { REAL_CELL_TEMPLATE } else { SIMULATED };
    let flange_camera =
        if answers.flange_camera == FlangeCameraKind::Gige { REAL_CELL_TEMPLATE } else { SIMULATED };
    let base = if is_real { REAL_CELL_TEMPLATE } else { SIMULATED };
    let mut text = head(answers);
    for Block { name, text: own } in split_tables(base) {
        let own = match name {
            "" => String::new(),
            "scanner" => block(scanner, name).to_owned(),
            "flange_camera" => block(flange_camera, name).to_owned(),
            "calibration" => block(REAL_CELL_TEMPLATE, name).to_owned(),
            name if is_real && OPTIONAL_TABLES.contains(&name) => as_comments(own),
            name if is_real && CELL_SPECIFIC_TABLES.contains(&name) => to_check(own),
            _ => own.to_owned(),
        };
        text.push_str(&own);
    }
    let mut cell = parse_document(name, &text)?;
    set(&mut cell, "", "store", answers.store.as_str());
    if let Some(scanner) = cell.get_mut("scanner").and_then(toml_edit::Item::as_table_mut) {
        scanner.remove("serial");
    }
    if let Some(serial) = &answers.scanner_serial {
        set(&mut cell, "scanner", "serial", serial.as_str());
    }
    if let Some((key, value)) = &answers.flange_camera_by {
        if let Some(camera) = cell.get_mut("flange_camera").and_then(toml_edit::Item::as_table_mut) {
            camera.remove("serial");
        }
        set(&mut cell, "flange_camera", key, value.as_str());
    }
    if let Some(host) = &answers.host {
        set(&mut cell, "robot", "host", host.as_str());
    }
    if let Some(Motion { park_deg, box_mm: [least, greatest] }) = &answers.motion {
        let array = |numbers: &[f64]| numbers.iter().copied().collect::<Array>();
        set(&mut cell, "limits", "box_min_mm", array(least));
        set(&mut cell, "limits", "box_max_mm", array(greatest));
        for (axis, angle) in park_deg.iter().enumerate() {
            set(&mut cell, "poses.park", &format!("a{}_deg", axis + 1), *angle);
        }
    }
    Ok(cell.to_string())
}

/// Returns the part of the cell file before its first table.
fn head(answers: &Answers) -> String {
    let socket = match answers.store == SERVICE_STORE {
        true => format!("socket = \"{SERVICE_SOCKET}\" # as in panelprep.service: members of the service's group may send requests\n"),
        false => {
            "# socket = \"panelprep.sock\" # socket by which `panelprep ctl` finds `panelprep run`; default: in the store\n"
                .to_owned()
        }
    };
    format!(
        "# A robot cell, created by `panelprep new cell`. Names of files are relative to this file's folder; `panelprep check FILE`
# lists the errors and describes the cell as it was read.

store = \"store\" # folder for taught panels, cycles and their pictures; all is kept for ever
# Or, at the end of this file, as a table that states how long clips and scans are kept (pages and records stay for ever):
# [store]
# folder = \"store\"
# record_key = \"record-key.pem\"   # the private key that signs records; without it, a key in the store, or a credential of systemd
# keep = {{ days = 30, cycles = 200, failed_days = 365, failed_cycles = 1000 }}   # days before the newest cycle; number of newest cycles
{socket}
"
    )
}
