//! Runs each command in README and in every `--help`, exactly as written, in a new folder beside a copy of `config/`.
//!
//! The commands are taken from the texts themselves, so that a changed text is tested and a command without an example
//! is detected. Only the rendering is made smaller. The output must be readable for people.

use super::teach_page::ask;
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// The order of the commands: each command runs after those whose output it needs. Commands that are not listed run
/// at `*`.
const ORDER: [&str; 26] = [
    "render",
    "check",
    "teach",
    "calibrate verify",
    "calibrate touch",
    "calibrate intrinsics",
    "calibrate hand-eye",
    "calibrate tcp",
    "calibrate force",
    "locate",
    "identify",
    "refine",
    "inspect",
    "tune",
    "label",
    "plan",
    "robot",
    "doctor",
    "air-run",
    "cycle",
    "*",
    "demo",
    "replay",
    "run",
    "mock-robot",
    "calibrate strike", // no cycle starts on what was struck out
];
/// Commands whose examples may end with exit code 1, a verdict other than accept: grease, a lens or an arm in too few
/// pictures, and a cell before its demonstration.
const MAY_FIND_FAULT: [&str; 5] = ["inspect", "tune", "doctor", "calibrate intrinsics", "calibrate robot"];
/// Replacements for the ports in the examples of commands that listen, from the firewall's sixteen ports.
const PORTS: [(&str, &str); 2] = [("54600", "54608"), ("54601", "54609")];

fn program() -> PathBuf {
    PathBuf::from(env!("CARGO_BIN_EXE_panelprep"))
}

fn help(of: &[String]) -> String {
    let output = Command::new(program()).args(of).arg("--help").env("COLUMNS", "2000").output().expect("it starts");
    assert!(output.status.success(), "{of:?}");
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// Returns the subcommands that a help text lists.
fn listed(help: &str) -> Vec<String> {
    let after = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let lines = after.take_while(|line| !line.is_empty());
    let names = lines.filter_map(|line| line.strip_prefix("  ").filter(|rest| !rest.starts_with(' ')));
    names
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .map(str::to_owned)
        .collect()
}

/// Returns the examples of a help text: lines that begin with the program's name.
fn examples(help: &str) -> Vec<String> {
    help.lines().filter_map(|line| line.strip_prefix("  panelprep ")).map(str::to_owned).collect()
}

/// Returns every command with its help text and its examples; a command without an example is an error.
fn all_examples() -> BTreeMap<String, (String, Vec<String>)> {
    let mut all = BTreeMap::new();
    for name in listed(&help(&[])) {
        let text = help(std::slice::from_ref(&name));
        let (below, shown) = (listed(&text), examples(&text));
        if !shown.is_empty() {
            all.insert(name, (text, shown));
            continue;
        }
        assert!(!below.is_empty(), "`panelprep {name} --help` shows no example");
        for inner in below {
            let text = help(&[name.clone(), inner.clone()]);
            let shown = examples(&text);
            assert!(!shown.is_empty(), "`panelprep {name} {inner} --help` shows no example");
            all.insert(format!("{name} {inner}"), (text, shown));
        }
    }
    all
}

/// The folder in which the commands run, and the result of each command.
struct Walk {
    folder: tempfile::TempDir,
}

impl Walk {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("config"), &folder.path().join("config"));
        let bin = folder.path().join("target/debug");
        fs::create_dir_all(&bin).expect("a folder");
        std::os::unix::fs::symlink(program(), bin.join("panelprep")).expect("a link");
        Walk { folder }
    }

    /// Runs a line in a shell, as a person types it.
    fn command(&self, line: &str) -> Command {
        let mut command = Command::new("sh");
        let path = format!("{}:{}", self.folder.path().join("target/debug").display(), env!("PATH"));
        command.args(["-c", line]).current_dir(self.folder.path()).env("PATH", path);
        command
    }

    fn run(&self, line: &str) -> Output {
        let output = self.command(&with_smaller_rendering(line)).output().expect("a shell");
        let texts = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        texts.iter().for_each(|text| check_readable(line, text));
        let name = line.trim_start_matches("panelprep ");
        let worst = i32::from(MAY_FIND_FAULT.iter().any(|command| name.starts_with(command)));
        assert!(
            output.status.code().is_some_and(|code| (0..=worst).contains(&code)),
            "{line}: {}: {texts:?}",
            output.status
        );
        output
    }

    /// Starts a command that runs until it is requested to end.
    fn start_serving(&self, line: &str) -> Served {
        let line = with_smaller_rendering(line);
        let mut command = self.command(&format!("exec {line}"));
        Served(command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("a shell"))
    }
}

/// A child process that is killed when the test ends.
struct Served(Child);

impl Served {
    /// Waits for a line that contains these words.
    fn wait_for_line(&mut self, words: &str) -> String {
        let mut lines = BufReader::new(self.0.stderr.take().expect("piped")).lines().map_while(Result::ok);
        let found = lines.by_ref().find(|line| line.contains(words));
        let line = found.unwrap_or_else(|| panic!("nothing says {words}"));
        std::thread::spawn(move || lines.for_each(drop));
        line
    }

    fn end(mut self) -> Option<i32> {
        let id = rustix::process::Pid::from_child(&self.0);
        rustix::process::kill_process(id, rustix::process::Signal::TERM).expect("it runs");
        self.0.wait().expect("it ends").code()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder") {
        let path = entry.expect("an entry").path();
        let target = to.join(path.file_name().expect("a name"));
        if path.is_dir() {
            copy(&path, &target);
            continue;
        }
        // The pictures of the manual are not text.
        let Ok(text) = fs::read_to_string(&path) else {
            fs::copy(&path, target).expect("copied");
            continue;
        };
        fs::write(target, PORTS.iter().fold(text, |text, (port, own)| text.replace(port, own))).expect("written");
    }
}

/// Changes a rendering command so that it uses fewer pixels and a shorter film.
fn with_smaller_rendering(line: &str) -> String {
    let words: Vec<&str> = line.split_whitespace().collect();
    let add = |more: &str| format!("{line} {more}");
    match words.iter().position(|word| ["render", "demo"].contains(word)) {
        Some(_) if words.contains(&"--reduction") => line.to_owned(),
        Some(at) if words[at] == "render" => add("--reduction 4 --seconds 15"),
        Some(_) => add("--reduction 4"),
        None => line.to_owned(),
    }
}

/// Checks that a text has no panic, no NaN, no zero with a sign, and no debug format.
pub fn check_readable(line: &str, text: &str) {
    for wrong in ["panicked", "NaN", "Some(", "None,", "Ok(", "Err("] {
        assert!(!text.contains(wrong), "{line}: {wrong}: {text}");
    }
    if text.starts_with('{') {
        return; // an object for scripts
    }
    let is_part = |c: char| c.is_ascii_alphanumeric() || "-.".contains(c);
    let zero = text
        .split(|c| !is_part(c))
        .find(|token| token.strip_prefix("-0").is_some_and(|rest| rest.chars().all(|c| c == '0' || c == '.')));
    assert_eq!(zero, None, "{line}: {text}");
}

/// Returns the position of a command in the order; commands that are not in the list are at `*`.
fn place(name: &str) -> usize {
    let of = |wanted: &str| ORDER.iter().position(|known| *known == wanted);
    of(name).or(of("*")).expect("a star")
}

#[test]
fn every_command_of_readme_and_help_does_what_it_states() {
    let (walk, all, begun) = (Walk::new(), all_examples(), Instant::now());
    let texts: String = all.values().map(|(text, _)| text.as_str()).collect();
    let mut names: Vec<&String> = all.keys().filter(|name| *name != "ctl").collect();
    names.sort_by_key(|name| place(name));
    for name in names {
        for example in &all[name].1 {
            let line = format!("panelprep {example}");
            let began = Instant::now();
            match name.as_str() {
                "render" => {
                    // Other examples need a labelled set, which this example does not create.
                    let wants = texts.contains("render --clips 6") && line.contains("--boards");
                    let clips = if wants { " --clips 6" } else { "" };
                    walk.run(&format!("{line}{clips}"));
                }
                "run" => serve_and_request(&walk, &line, &all["ctl"].1),
                "label" => open_and_close_page(&walk, &line),
                // These commands need a broker and a database: tests/office.rs starts both.
                needs_servers if needs_servers == "fleet" || needs_servers.starts_with("archive ") => {}
                "mock-robot" => {
                    let mut mock = walk.start_serving(&line);
                    mock.wait_for_line("mock controller");
                    mock.end();
                }
                _ => {
                    let output = walk.run(&line);
                    // Writes the output of `locate` to the file in `> target/cell/located.json`, as the help texts of
                    // later commands require.
                    let kept = all["refine"].0.split("with `> ").nth(1).and_then(|rest| rest.split('`').next());
                    if let (true, Some(file)) = (name == "locate", kept) {
                        fs::write(walk.folder.path().join(file), output.stdout).expect("written");
                    }
                }
            }
            eprintln!("{:6.1} s  {line}", began.elapsed().as_secs_f64());
        }
    }
    readme(&walk);
    pages(walk.folder.path());
    eprintln!("{:6.1} s  in all", begun.elapsed().as_secs_f64());
}

/// Opens a page in the browser and closes it with its button.
fn open_and_close_page(walk: &Walk, line: &str) {
    let mut served = walk.start_serving(line);
    let told = served.wait_for_line("http://");
    let url = told.split_whitespace().find(|word| word.starts_with("http://")).expect("an address");
    assert!(ask(url, "GET", "", "").contains("<!doctype html>"), "{line}");
    assert!(ask(url, "POST", "done", "").starts_with("HTTP/1.1 200"), "{line}");
    assert_eq!(served.0.wait().expect("it ends").code(), Some(0), "{line}");
}

/// Starts the service and sends the requests one after the other.
fn serve_and_request(walk: &Walk, line: &str, asked: &[String]) {
    let mut service = walk.start_serving(line);
    service.wait_for_line("listens on");
    for question in asked {
        // A reset is accepted after the controller has answered and if no cycle is running; a start is accepted after
        // the reset is complete.
        let since = Instant::now();
        loop {
            let output = walk.command(&format!("panelprep {question}")).output().expect("a shell");
            if output.status.success() {
                check_readable(question, &String::from_utf8_lossy(&output.stdout));
                break;
            }
            let said = String::from_utf8_lossy(&output.stdout).into_owned();
            assert!(since.elapsed() < Duration::from_secs(180), "{question}: {said}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
    assert_eq!(service.end(), Some(0), "{line}");
}

/// Runs the code blocks of README: of the `make` lines only the parts that use this program, and all other lines as
/// written.
fn readme(walk: &Walk) {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).expect("README");
    let blocks: Vec<&str> =
        text.split("```").skip(1).step_by(2).filter_map(|block| block.strip_prefix("sh\n")).collect();
    assert!(!blocks.is_empty(), "README shows no command");
    for line in blocks.iter().flat_map(|block| block.lines()) {
        let line = line.split(" #").next().unwrap_or_default().trim();
        if let Some(target) = line.strip_prefix("make ") {
            let makefile = env!("CARGO_MANIFEST_DIR");
            // If cargo builds into another folder, make would use the program there.
            let mut make = Command::new("make");
            let output =
                make.args(["-n", "-C", makefile, target]).env_remove("CARGO_TARGET_DIR").output().expect("make");
            assert!(output.status.success(), "{line}: {output:?}");
            let does = String::from_utf8_lossy(&output.stdout).into_owned();
            does.lines().filter(|line| line.starts_with("target/debug/panelprep")).for_each(|line| {
                walk.run(line);
            });
        } else if !line.is_empty() && !line.starts_with('#') {
            walk.run(line);
        }
    }
}

/// Checks every page that the commands wrote.
fn pages(folder: &Path) {
    let mut folders = vec![folder.to_owned()];
    let mut seen = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() && !path.is_symlink() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "html") {
                let html = fs::read_to_string(&path).expect("a page");
                // Embedded pictures are text without words.
                let words =
                    html.split("src=\"data:").map(|part| part.split_once('"').map_or(part, |(_, rest)| rest));
                check_readable(&path.display().to_string(), &words.collect::<String>());
                seen += 1;
            }
        }
    }
    assert!(seen >= 3, "{seen} pages");
}
