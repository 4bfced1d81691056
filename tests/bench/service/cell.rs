//! A taught cell in its own folder, and its service as systemd runs it.

use super::taught::{LINE_INPUTS, LINE_OUTPUTS, TEACH, VERIFY};
use super::watchdog::{WATCHDOG_TIMEOUT, Watchdog};
use std::fs;
use std::io::Write;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Two of the sixteen ports that a controller's firewall leaves open; no test uses them.
const PORTS: [u16; 2] = [54_606, 54_607];
/// Ports of a copied cell.
pub const OTHER_PORTS: [u16; 2] = [54_608, 54_609];
/// The address at which the controller listens, and to which the service connects.
const CONTROLLER_ADDRESS: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);
/// The account (name and password) of the clients that read the page.
pub const VIEWER: (&str, &str) = ("viewer", "correct horse");

const LINE: &str = "\n[line]\nrecipe = 'recipe.toml'\n";

/// The clock of the cell, and the source of its start requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// Real time; a person starts cycles.
    Wall,
    /// Virtual time in lock step with the program; a simulated production line starts cycles.
    Line,
}

/// A cell that is ready for a service.
pub struct Prepared {
    folder: TempDir,
    program: PathBuf,
    pub pace: Pace,
    pub page: SocketAddr,
    controller: IpAddr,
}

impl Prepared {
    /// Copies the cell to a separate folder. The controller listens at the address `controller`. The service connects
    /// to the address `sought`, at which its page also listens.
    pub fn copied(&self, sought: IpAddr, controller: IpAddr) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        copy(&self.folder.path().join("cell"), &folder.path().join("cell"));
        let page = SocketAddr::new(sought, self.page.port());
        let moved = [
            (format!("host = \"{CONTROLLER_ADDRESS}\""), format!("host = \"{sought}\"")),
            (format!("listen = \"{}\"", self.page), format!("listen = \"{page}\"")),
            (format!("command_port = {}", PORTS[0]), format!("command_port = {}", OTHER_PORTS[0])),
            (format!("state_port = {}", PORTS[1]), format!("state_port = {}", OTHER_PORTS[1])),
        ];
        replaced(&folder.path().join("cell/cell.toml"), &moved.each_ref().map(|(from, to)| (&**from, &**to)));
        Prepared { folder, program: self.program.clone(), pace: self.pace, page, controller }
    }

    pub fn socket(&self) -> PathBuf {
        self.store().join("panelprep.sock")
    }

    pub fn recipe(&self) -> PathBuf {
        self.folder.path().join("cell/recipe.toml")
    }

    /// Returns the path of a file that the service's configuration names relative to its folder.
    pub fn in_folder(&self, file: &str) -> PathBuf {
        self.folder.path().join(file)
    }

    pub fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("run.log")).unwrap_or_default()
    }

    /// Returns the controller's log, if the controller is a separate process.
    pub fn controller_log(&self) -> String {
        fs::read_to_string(self.folder.path().join("robot.log")).unwrap_or_default()
    }

    fn store(&self) -> PathBuf {
        self.folder.path().join("cell/store")
    }

    pub fn store_bytes(&self) -> u64 {
        bytes_of(&self.store())
    }

    fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(&self.program);
        command.args(arguments.split_whitespace()).current_dir(self.folder.path()).stdout(Stdio::null());
        command
    }

    /// Runs a command of the program to its end.
    ///
    /// # Errors
    /// The command's message, if its exit code is not 0.
    pub fn run(&self, arguments: &str) -> Result<(), String> {
        let output = self.command(arguments).output().expect("the program starts");
        let said = || format!("{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        output.status.success().then_some(()).ok_or_else(said)
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).expect("a new folder");
    for entry in fs::read_dir(from).expect("a folder").flatten() {
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        match from.is_dir() {
            true => copy(&from, &to),
            false => drop(fs::copy(&from, &to).expect("copied")),
        }
    }
}

fn bytes_of(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    // A file may be deleted between the listing and this call.
    let bytes = entries.map(|entry| match entry.metadata() {
        Ok(found) if found.is_dir() => bytes_of(&entry.path()),
        found => found.map_or(0, |found| found.len()),
    });
    bytes.sum()
}

/// Replaces texts in a file of the cell.
fn replaced(file: &Path, changes: &[(&str, &str)]) {
    let mut text = fs::read_to_string(file).expect("rendered");
    for (from, to) in changes {
        assert!(text.contains(from), "{from}: {text}");
        text = text.replacen(from, to, 1);
    }
    fs::write(file, text).expect("written");
}

/// Renders, teaches and verifies a cell with small pictures and short films.
pub fn prepare(program: &Path, pace: Pace) -> Prepared {
    let folder = tempfile::tempdir().expect("a folder");
    let page = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free port");
    let program = fs::canonicalize(program).expect("the program is there");
    let prepared = Prepared { folder, program, pace, page, controller: CONTROLLER_ADDRESS };
    let run = |arguments: &str| prepared.run(arguments).unwrap_or_else(|said| panic!("{said}"));
    run("render --seed 3 --reduction 4 --seconds 10 --out cell");
    let folder = prepared.folder.path();
    let file = folder.join("cell/cell.toml");
    match pace {
        Pace::Wall => {
            let ports = format!("command_port = {}\nstate_port = {}", PORTS[0], PORTS[1]);
            let robot = format!("kind = \"eki\"\nhost = \"{CONTROLLER_ADDRESS}\"\n{ports}");
            replaced(&file, &[("kind = \"mock\"", &robot)]);
        }
        Pace::Line => {
            replaced(&file, &[LINE_INPUTS.into()]);
        }
    }
    let mut cell = fs::OpenOptions::new().append(true).open(&file).expect("the cell's file");
    let signals = if pace == Pace::Line { [LINE_OUTPUTS, LINE].concat() } else { String::new() };
    write!(cell, "\n{signals}\n[page]\nlisten = \"{page}\"\n").expect("written");
    let short = "frames_per_second = 2.0\nspray_s = 4.0\nrinse_s = 1.0\ndrain_s = 0.5";
    replaced(&folder.join("cell/recipe.toml"), &[("frames_per_second = 5.0", short)]);
    [TEACH, VERIFY[0], VERIFY[1]].into_iter().for_each(run);
    let (name, password) = VIEWER;
    let mut child = prepared
        .command(&format!("user add {name} --role viewer --cell cell/cell.toml"))
        .stdin(Stdio::piped())
        .spawn()
        .expect("the program starts");
    writeln!(child.stdin.take().expect("its input"), "{password}").expect("it reads");
    assert!(child.wait().expect("it ends").success(), "an account");
    prepared
}

/// A process that is killed when this value is dropped.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The running service, and the controller if it is a separate process.
pub struct Running<'p> {
    prepared: &'p Prepared,
    service: Killed,
    _controller: Option<Killed>,
}

impl<'p> Running<'p> {
    /// Starts the controller and the service, and waits until the service listens.
    pub fn start(prepared: &'p Prepared) -> (Self, Watchdog) {
        let parts = if prepared.pace == Pace::Line { "--line-parts 1000000" } else { "" };
        Running::start_with(prepared, parts)
    }

    /// Starts the controller and the service, and waits until the service listens; `more` contains additional arguments
    /// for the service.
    pub fn start_with(prepared: &'p Prepared, more: &str) -> (Self, Watchdog) {
        let folder = prepared.folder.path();
        let notify = folder.join("notify");
        let watchdog = Watchdog::listen(&notify);
        let controller = (prepared.pace == Pace::Wall).then(|| {
            let mut command =
                prepared.command(&format!("mock-robot --cell cell/cell.toml --host {}", prepared.controller));
            let log = fs::File::create(folder.join("robot.log")).expect("a log");
            Killed(command.stderr(log).spawn().expect("the program starts"))
        });
        let log = fs::File::create(folder.join("run.log")).expect("a log");
        let service = prepared
            .command(&format!("run --cell cell/cell.toml --seed 3 {more}"))
            .env("NOTIFY_SOCKET", notify)
            .env("WATCHDOG_USEC", WATCHDOG_TIMEOUT.as_micros().to_string())
            .env("MALLOC_ARENA_MAX", "2")
            .stderr(log)
            .spawn()
            .expect("the program starts");
        let mut running = Running { prepared, service: Killed(service), _controller: controller };
        let since = Instant::now();
        while watchdog.signs() == 0 {
            let is_patient = running.is_alive() && since.elapsed() < Duration::from_secs(120);
            assert!(is_patient, "the service does not become ready\n{}", prepared.log());
            std::thread::sleep(Duration::from_millis(20));
        }
        (running, watchdog)
    }

    pub fn id(&self) -> u32 {
        self.service.0.id()
    }

    pub fn is_alive(&mut self) -> bool {
        matches!(self.service.0.try_wait(), Ok(None))
    }

    /// Returns how the service ended, with its last log lines, if it ended without a request.
    pub fn ended_by_itself(&mut self) -> Option<String> {
        let status = self.service.0.try_wait().expect("its status")?;
        let log = self.prepared.log();
        let lines: Vec<&str> = log.lines().rev().take(20).collect();
        Some(format!(
            "the service ended by itself with {status}\n{}",
            lines.into_iter().rev().collect::<Vec<_>>().join("\n")
        ))
    }
}
