//! Tests the service in real time: `panelprep run` and `panelprep mock-robot` as two programs, connected by sockets.

use super::service::{START, Service, replays, taught};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};

/// Two of the sixteen ports that a controller's firewall opens; no other test uses them.
const PORTS: [u16; 2] = [54_614, 54_615];

/// A stand-alone mock controller and the lines that it printed; killed when the test ends.
pub struct Mock {
    child: Child,
    told: Arc<Mutex<Vec<String>>>,
}

impl Drop for Mock {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Mock {
    pub fn start(folder: &Path, ports: [u16; 2]) -> Self {
        Self::start_with(folder, "mock-robot --config . --cell cell/cell.toml", ports)
    }

    /// Starts a mock controller with this command, which must listen on these ports.
    pub fn start_with(folder: &Path, command: &str, ports: [u16; 2]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(command.split_whitespace())
            .current_dir(folder)
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines().map_while(Result::ok);
        assert!(lines.next().is_some_and(|first| first.contains(&ports[0].to_string())), "it listens");
        let told = Arc::new(Mutex::new(Vec::new()));
        let keeps = told.clone();
        std::thread::spawn(move || lines.for_each(|line| keeps.lock().expect("whole").push(line)));
        Mock { child, told }
    }

    /// Returns the number of lines that contain this word.
    pub fn count_lines(&self, word: &str) -> usize {
        self.told.lock().expect("whole").iter().filter(|line| line.contains(word)).count()
    }
}

/// Changes the files of a taught cell so that its robot is connected over two sockets and its cameras replay the
/// pictures of a folder.
pub fn over_sockets(folder: &Path, [command, state]: [u16; 2]) {
    for (file, shipped) in [
        ("CELLCMD.xml", include_str!("../config/kuka/CELLCMD.xml")),
        ("CELLSTAT.xml", include_str!("../config/kuka/CELLSTAT.xml")),
    ] {
        let text = shipped.replace("<PORT>54600<", &format!("<PORT>{command}<"));
        std::fs::write(folder.join(file), text.replace("<PORT>54601<", &format!("<PORT>{state}<")))
            .expect("written");
    }
    let cell = folder.join("cell");
    std::fs::create_dir(cell.join("corners")).expect("a folder");
    for (from, to) in [
        ("scan.pcd", "clip/scan.pcd"),
        ("scan.pcd", "clip/scan2.pcd"),
        ("corner.png", "corners/1.png"),
        ("flange.json", "corners/1.json"),
    ] {
        std::fs::copy(cell.join(from), cell.join(to)).expect("copied");
    }
    let text = std::fs::read_to_string(cell.join("cell.toml")).expect("the cell");
    let robot = format!("kind = \"eki\"\nhost = \"127.0.0.1\"\ncommand_port = {command}\nstate_port = {state}\n");
    let text = text
        .replace("kind = \"mock\"\n", &robot)
        .replace("[scanner]\nkind = \"simulated\"", "[scanner]\nkind = \"recorded\"\nfolder = \"clip\"")
        .replace(
            "[flange_camera]\nkind = \"simulated\"",
            "[flange_camera]\nkind = \"recorded\"\nfolder = \"corners\"",
        );
    assert!(!text.contains("simulated\""), "{text}");
    std::fs::write(cell.join("cell.toml"), text).expect("written");
}

/// A stop during a motion, a controller that disappears during a motion, and the recovery. Each ends in the required
/// state, and nothing moves without a request.
#[test]
fn the_service_stops_and_survives_a_controller_by_the_wall_clock() {
    let folder = taught("clean");
    let folder = folder.path();
    over_sockets(folder, PORTS);
    let mock = Mock::start(folder, PORTS);
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    service.wait("the arm parks", |_| mock.count_lines("executed") >= 2);
    service.done("stop");
    service.reach("stopped");
    let executed = mock.count_lines("executed");
    std::thread::sleep(std::time::Duration::from_millis(1_500));
    assert_eq!(mock.count_lines("executed"), executed, "it stands: {:?}", mock.told.lock());

    service.reset();
    service.done(&format!("{START} --record wall.mcap"));
    // The scan was evaluated in parallel with the loop, while the robot continued to report.
    service.wait("the way to the corner", |service| service.done("state")["phase"] == "refine");
    drop(mock);
    service.reach("aborted");
    let reasons = service.done("state")["reasons"].to_string();
    assert!(reasons.contains("controller"), "{reasons}");
    replays(&service, folder, "aborted");

    let mock = Mock::start(folder, PORTS);
    service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
    service.reach("stopped");
    assert_eq!(mock.count_lines("executed"), 0, "nothing moves because the link is back");
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.wait_for_end().code(), Some(0));
}
