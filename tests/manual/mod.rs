//! Follows the manual as a person who has only the package: every command of every page in its order, in one cell. The
//! cameras and the controller are used only over their real interfaces. At the end a greasy panel was detected, sanded
//! and passed, and the tool was at its required position.

mod cell;
mod installed;
mod messages;
mod pages;
mod person;
mod proofs;
mod scenery;

use super::goal::Figure;
use super::walk::check_readable;
use crate::zivid::stub;
use cell::Cell;
use installed::Computer;
use pages::Step;
use panelprep::cell::Cell as CellFile;
use panelprep::devices::world::contact_errors;
use scenery::CellContents;
use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

/// Maximum distance of the tool's tip from the true surface, mm, as in `make bench-seeds` for a cycle.
const SURFACE_MAX_MM: f64 = 1.0;
/// Commands whose exit code may report a verdict that is not accept.
const MAY_FIND_FAULT: [&str; 8] = [
    "panelprep doctor",
    "panelprep tune",
    "panelprep teach",
    "panelprep calibrate intrinsics",
    "panelprep calibrate hand-eye",
    "panelprep calibrate robot",
    "panelprep calibrate tcp",
    "panelprep shoot",
];
/// Time for which a refused command is repeated, because the cell may not be ready yet.
const RETRY_TIMEOUT: Duration = Duration::from_secs(60);

struct Walk {
    computer: Computer,
    cell: Cell,
    /// Commands that run in the background.
    beside: Vec<(String, std::process::Child)>,
}

#[test]
#[ignore = "the whole commissioning of a cell in real time: make bench-manual"]
fn the_manual_leads_from_the_package_to_a_cell_in_daily_work() {
    let folder = tempfile::tempdir().expect("a folder");
    let cell = match Cell::new(folder.path()) {
        Ok(cell) => cell,
        Err(why) => panic!("the cell's cameras cannot be simulated here: {why}"),
    };
    let root = folder.path().join("root");
    let mut computer = Computer::new(&root);
    let zivid = folder.path().join("zivid.txt");
    fs::write(&zivid, cell.zivid()).expect("written");
    let library = stub::library().parent().expect("a folder").display().to_string();
    computer.exported = vec![
        ("LD_LIBRARY_PATH".to_owned(), library),
        ("PANELPREP_ZIVID_STUB".to_owned(), zivid.display().to_string()),
    ];
    let mut walk = Walk { computer, cell, beside: Vec::new() };
    for name in pages::names() {
        eprintln!("# {name}");
        let text = fs::read_to_string(pages::folder().join(&name)).expect("a page");
        for step in pages::steps(&text) {
            match step {
                Step::Cell(words) if words == "a cycle runs" => walk.begin_cycle(),
                Step::Cell(words) if words == "the service runs" => {
                    walk.types(&name, "sudo systemctl start panelprep")
                }
                Step::Cell(words) => {
                    walk.cell
                        .put(CellContents::named(&words).unwrap_or_else(|| panic!("{name}: {words} is no scene")));
                }
                Step::Command(line) => walk.types(&name, &line),
            }
        }
    }
    walk.compare_with_truth();
}

impl Walk {
    fn types(&mut self, page: &str, line: &str) {
        let began = Instant::now();
        let here = self.computer.adapted_text(line);
        if let Some(folder) = here.strip_prefix("cd ") {
            self.computer.works_in = Path::new(folder).to_owned();
            return;
        }
        if let Some((name, value)) = here.strip_prefix("export ").and_then(|rest| rest.split_once('=')) {
            return self.computer.exported.push((name.to_owned(), value.to_owned()));
        }
        if let Some(beside) = here.strip_suffix(" &") {
            let child = self
                .computer
                .shell_command(&format!("exec {beside}"))
                .stdin(Stdio::null())
                .spawn()
                .expect("a shell");
            return self.beside.push((line.to_owned(), child));
        }
        if line == "wait" {
            for (line, mut child) in self.beside.drain(..) {
                assert!(child.wait().expect("it ends").success(), "{line}");
            }
            return;
        }
        if line.starts_with("panelprep calibrate hand-eye") {
            self.cell.jog_to_board();
        }
        let output = loop {
            let output = self.run_with_answers(&here);
            // The robot may not be connected yet, or a reset may still be in progress.
            let may_settle = line.starts_with("panelprep ctl") && !line.contains(" start ")
                || line.starts_with("panelprep robot set-out spray");
            if output.status.success() || !may_settle || began.elapsed() > RETRY_TIMEOUT {
                break output;
            }
            std::thread::sleep(Duration::from_millis(200));
        };
        let texts = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        let reported = format!("{page}: {line}\n{}\n{}", texts[0], texts[1]);
        let worst = i32::from(MAY_FIND_FAULT.iter().any(|command| line.starts_with(command)));
        assert!(
            output.status.code().is_some_and(|code| (0..=worst).contains(&code)),
            "{}: {reported}",
            output.status
        );
        let is_review =
            ["review", "warning", "WRONG"].iter().any(|word| texts.iter().any(|text| text.contains(word)));
        assert!(output.status.success() || is_review, "neither good nor for a person to look at: {reported}");
        if line.starts_with("panelprep") {
            texts.iter().for_each(|text| check_readable(line, text));
        }
        eprintln!("{:6.1} s  {line}", began.elapsed().as_secs_f64());
        if std::env::var_os("MANUAL_TELLS").is_some() {
            eprintln!("{}{}", texts[0], texts[1]);
        }
        self.make_edits_after(line);
    }

    /// Makes the edits that the person makes after a command.
    fn make_edits_after(&mut self, line: &str) {
        let etc = self.computer.root.join("etc/panelprep");
        if line.starts_with("panelprep new cell") {
            let file = etc.join("cell.toml");
            person::edit_cell(&file, self.cell.verify_pose());
            let text = fs::read_to_string(&file).expect("written");
            let read = CellFile::check("cell.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
            self.cell.start_controller(&read);
        }
        if line.starts_with("panelprep new recipe") {
            person::edit_recipe(&etc.join("door.toml"));
        }
    }

    /// Runs a command and lets the person answer its questions.
    fn run_with_answers(&self, line: &str) -> Output {
        let mut child = self.computer.shell_command(line);
        let mut child =
            child.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("a shell");
        let mut stdin = child.stdin.take();
        let mut reported = child.stderr.take().expect("piped");
        let mut stdout = child.stdout.take().expect("piped");
        let reads = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            stdout.read_to_end(&mut bytes).map(|_| bytes).unwrap_or_default()
        });
        let (mut stderr, mut line_now, mut byte, mut asked) = (Vec::new(), Vec::new(), [0; 1], 0);
        let store = self.computer.root.join("var/lib/panelprep");
        while reported.read(&mut byte).is_ok_and(|read| read == 1) {
            stderr.push(byte[0]);
            if byte[0] != b'\n' {
                line_now.push(byte[0]);
                continue;
            }
            let whole = String::from_utf8_lossy(&std::mem::take(&mut line_now)).into_owned();
            if let (Some(answer), Some(stdin)) =
                (person::answer(&self.cell, &store, &whole, &mut asked), stdin.as_mut())
            {
                // The program may have continued without the answer.
                let _ = stdin.write_all(answer.as_bytes());
            }
        }
        let status = child.wait().expect("it ends");
        Output { status, stdout: reads.join().expect("read"), stderr }
    }

    /// Starts a cycle, as another person does, and waits until it is running.
    fn begin_cycle(&self) {
        self.cell.put(CellContents::Panel(1));
        let began = Instant::now();
        let done =
            |line: &str| self.computer.shell_command(&self.computer.adapted_text(line)).output().expect("a shell");
        let recipe = "panelprep ctl start --recipe /etc/panelprep/door.toml";
        for line in ["panelprep ctl reset --wait", recipe] {
            while !done(line).status.success() {
                assert!(began.elapsed() < 2 * RETRY_TIMEOUT, "{line}: {:?}", done(line));
                std::thread::sleep(Duration::from_millis(200));
            }
        }
        while !String::from_utf8_lossy(&done("panelprep ctl state").stdout).contains("execute") {
            assert!(began.elapsed() < 3 * RETRY_TIMEOUT, "{:?}", done("panelprep ctl state"));
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    /// Compares the result with the ground truth.
    fn compare_with_truth(&self) {
        let (truth, trace, greasy) = self.cell.greasy_panel_state();
        let errors = contact_errors(&trace, &truth).expect("the greasy panel was abraded");
        eprintln!(
            "in contact: {} samples, the tip {:.3} mm from the true surface at most, the tool's axis {:.2}° from its normal",
            errors.samples, errors.surface_max_mm, errors.normal_max_deg
        );
        Figure("manual: contact off the surface").report(
            &format!("{SURFACE_MAX_MM} mm"),
            &format!("{:.2} mm", errors.surface_max_mm),
            errors.surface_max_mm < SURFACE_MAX_MM,
        );
        assert!(errors.surface_max_mm < SURFACE_MAX_MM, "{errors:?}");
        // Spots smaller than the recipe's minimum break area may remain.
        let spots = truth.spots.len();
        eprintln!("of {spots} greasy spots {greasy} are left, each smaller than the smallest break that counts");
        assert!(2 * greasy < spots, "{greasy} of {spots} spots are still greasy");
        assert_eq!(self.cell.violations(), "");
        let reports = self.computer.root.join("var/lib/panelprep/reports");
        assert!(fs::read_dir(reports).expect("reports").count() >= 3);
    }
}
