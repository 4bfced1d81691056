//! Tests `panelprep robot` and `panelprep mock-robot`: one function at a time, with all checks.

use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

const NAMES: &str = "[poses]\n\
    park = { a1_deg = -120.0, a2_deg = -75.0, a3_deg = 110.0, a4_deg = 0.0, a5_deg = 55.0, a6_deg = 90.0 }\n\
    [io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
    [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\nlight_on = 5\n\
    [limits]\nbox_min_mm = [100.0, -450.0, 50.0]\nbox_max_mm = [700.0, 450.0, 900.0]\n";

fn cell(folder: &Path, robot: &str) {
    std::fs::write(folder.join("cell.toml"), format!("store = \"store\"\n{robot}{NAMES}")).expect("written");
}

/// Runs `panelprep robot …`; returns its exit code, its JSON object, and its text on standard error.
fn robot(folder: &Path, arguments: &str) -> (i32, Value, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(format!("robot {arguments} --cell cell.toml --json").split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts");
    let (text, error) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let object = serde_json::from_str(&text).unwrap_or_else(|wrong| panic!("{arguments}: {wrong}: {text}{error}"));
    (output.status.code().expect("an exit code"), object, error.into_owned())
}

fn codes(object: &Value) -> Vec<&str> {
    object["reasons"].as_array().expect("reasons").iter().filter_map(|reason| reason["code"].as_str()).collect()
}

#[test]
fn each_function_goes_through_its_gate() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    cell(folder, "[robot]\nkind = \"mock\"\n");
    let (exit, output, _) = robot(folder, "state");
    assert_eq!((exit, &output["state"]["mode"]), (0, &Value::from("EXT")), "{output}");
    assert!(!folder.join("store").exists(), "to look writes nothing");

    let (exit, output, _) = robot(folder, "move-j park");
    assert_eq!((exit, &output["state"]["joints"]["a1_deg"]), (0, &Value::from(-120.0)), "{output}");
    // The home position of the arm is (435, 0, 682.058) mm with B 30°: see the kinematics of the mock controller.
    let (exit, output, _) = robot(folder, "move-lin --speed-mm-s 200 445,20,682.058,180,30,180");
    assert_eq!(exit, 0, "{output}");
    let tip = &output["state"]["base_from_tcp"];
    let off_mm = [("x_mm", 445.0), ("y_mm", 20.0), ("z_mm", 682.058)]
        .map(|(key, wanted)| (tip[key].as_f64().expect("a number") - wanted).abs());
    assert!(off_mm.into_iter().all(|off_mm| off_mm < 0.01), "{output}");

    for (arguments, expected) in [
        ("move-lin 435,0,1000,180,30,180", vec!["outside_box"; 3]),
        ("move-lin --speed-mm-s 251 435,0,680,180,30,180", vec!["speed"]),
        ("move-j 0,-90,361,0,60,0", vec!["axis_limit"]),
        ("set-out ligth on", vec!["no_such_output"]),
        // The missing conditions for the tool: water drained, extraction, approach point. For the spray: arm parked,
        // lens shut.
        ("set-out tool on", vec!["interlock"; 3]),
        ("set-out spray on", vec!["interlock"; 2]),
    ] {
        let (exit, output, _) = robot(folder, arguments);
        assert_eq!((exit, &output["verdict"]), (1, &Value::from("reject")), "{arguments}: {output}");
        assert_eq!(codes(&output), expected, "{arguments}: {output}");
    }
    let (exit, output, _) = robot(folder, "set-out light on --keep-s 2");
    assert_eq!((exit, &output["state"]["inputs"]["light_on"]), (0, &Value::from(true)), "{output}");
    let (exit, output, error) = robot(folder, "set-in 3 on");
    assert_eq!(exit, 2);
    assert!(error.contains("read-only"), "{error}{output}");
    let (exit, output, _) = robot(folder, "move-lin 1,2,3");
    assert_eq!(exit, 2);
    assert!(
        output["reasons"][0]["message"]
            .as_str()
            .is_some_and(|words| words.contains("found 3 numbers, expected six")),
        "{output}"
    );
}

/// Before an epoch sets a tool, the controller has none. The tool that is calibrated on the flange is checked
/// nevertheless: a box around its tip prevents a motion of the axes, and a linear motion with another tool.
#[test]
fn a_motion_keeps_the_tool_on_the_flange_out_of_boxes() {
    use panelprep::geometry::{Base, Flange, KukaPose, Rigid, Tool};
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    cell(folder, "[robot]\nkind = \"mock\"\n");
    let there = "move-j 20,-90,90,0,60,0";
    let (exit, output, _) = robot(folder, there);
    assert_eq!(exit, 0, "{output}");
    let pose: KukaPose = serde_json::from_value(output["state"]["base_from_tcp"].clone()).expect("a pose");
    let tool = KukaPose { z_mm: 120.0, ..KukaPose::default() };
    let base_from_flange: Rigid<Base, Flange> = pose.to_rigid();
    let tip = (base_from_flange * tool.to_rigid::<Flange, Tool>()).origin().mm;
    let side = |mm: f64| format!("[{:.1}, {:.1}, {:.1}]", tip.x + mm, tip.y + mm, tip.z + mm);
    let clamp = format!(
        "[robot]\nkind = \"mock\"\n[[keep_out]]\nname = \"clamp\"\nmin_mm = {}\nmax_mm = {}\n",
        side(-20.0),
        side(20.0)
    );
    cell(folder, &clamp);
    let (exit, output, _) = robot(folder, there);
    assert_eq!(exit, 0, "nothing is calibrated yet: {output}");
    let calibrated = format!("{clamp}[calibration]\nflange_from_tool = \"tool.toml\"\n");
    cell(folder, &calibrated);
    let (exit, output, _) = robot(folder, there);
    assert_eq!(exit, 0, "the file is not made yet: {output}");
    let mount = "[flange_from_tool]\nx_mm = 0.0\ny_mm = 0.0\nz_mm = 120.0\na_deg = 0.0\nb_deg = 0.0\nc_deg = 0.0\n";
    std::fs::write(folder.join("tool.toml"), mount).expect("written");
    let line = format!(
        "move-lin --tool flange {},{},{},{},{},{}",
        pose.x_mm, pose.y_mm, pose.z_mm, pose.a_deg, pose.b_deg, pose.c_deg
    );
    for motion in [there, &line] {
        let (exit, output, _) = robot(folder, motion);
        assert_eq!((exit, codes(&output)), (1, vec!["out_of_reach"]), "{motion}: {output}");
        let message = output["reasons"][0]["message"].as_str().unwrap_or_default();
        assert!(message.contains("with the sanding tool") && message.contains("clamp"), "{message}");
    }
    std::fs::write(folder.join("tool.toml"), "nonsense").expect("written");
    assert_eq!(robot(folder, there).0, 2, "a calibration that is there must be right");
}

/// A child process that is killed when the test ends.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Writes the EthernetKRL files with other ports among the firewall's sixteen, as a user would change them. Returns the
/// table of a cell's file for this controller.
fn eki_files(folder: &Path, [command, state]: [u16; 2]) -> String {
    for (file, shipped, from, to) in [
        ("CELLCMD.xml", include_str!("../config/kuka/CELLCMD.xml"), 54_600, command),
        ("CELLSTAT.xml", include_str!("../config/kuka/CELLSTAT.xml"), 54_601, state),
    ] {
        let text = shipped.replace(&format!("<PORT>{from}</PORT>"), &format!("<PORT>{to}</PORT>"));
        assert_ne!(text, shipped, "{file} names its port");
        std::fs::write(folder.join(file), text).expect("written");
    }
    let ports = format!("command_port = {command}\nstate_port = {state}\n");
    format!("[robot]\nkind = \"eki\"\nhost = \"127.0.0.1\"\n{ports}")
}

/// Starts the mock controller with the files of the folder. Returns the process with its first line after it listens.
fn mock(folder: &Path, arguments: &str) -> (Running, String, impl Iterator<Item = String> + Send + use<>) {
    let mut mock = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(format!("mock-robot --config . --cell cell.toml {arguments}").split_whitespace())
        .current_dir(folder)
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut lines = BufReader::new(mock.stderr.take().expect("piped")).lines().map_while(Result::ok);
    let running = Running(mock);
    let first = lines.next().expect("a line");
    (running, first, lines)
}

/// Two commands, two connections, one controller: the second command reads the state that the first one left.
#[test]
fn a_stand_alone_mock_keeps_its_pose_between_commands() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let eki = eki_files(folder, [54_612, 54_613]);
    cell(folder, &eki);
    let (exit, output, _) = robot(folder, "state");
    assert_eq!((exit, codes(&output)), (3, vec!["no_controller"]), "{output}");
    // If the service answers, only the service may use the controller.
    std::fs::create_dir(folder.join("store")).expect("a folder");
    let service = std::os::unix::net::UnixListener::bind(folder.join("store/panelprep.sock")).expect("a socket");
    let (exit, output, _) = robot(folder, "state");
    assert_eq!((exit, codes(&output)), (3, vec!["no_controller"]), "{output}");
    assert!(
        output.to_string().contains("the service is connected to the controller")
            && output.to_string().contains("ctl state")
    );
    drop(service);
    std::fs::remove_dir_all(folder.join("store")).expect("removed");

    let (_mock, first, lines) = mock(folder, "--fault refuse=8@#2");
    assert!(first.contains("54612"), "{first}");

    let (exit, output, _) = robot(folder, "move-j 5,-90,90,0,60,0 --axis-speed-percent 50");
    assert_eq!(exit, 0, "{output}");
    let (exit, output, _) = robot(folder, "state");
    assert_eq!((exit, &output["state"]["joints"]["a1_deg"]), (0, &Value::from(5.0)), "{output}");
    // The requested injected fault occurs once.
    let (exit, output, _) = robot(folder, "call 0");
    assert_eq!((exit, codes(&output)), (3, vec!["robot"]), "{output}");
    let (exit, output, _) = robot(folder, "call 0");
    assert_eq!(exit, 0, "{output}");
    let said: Vec<String> = lines.take(2).collect();
    assert!(said.iter().any(|line| line.contains("epoch")), "{said:?}");
}

/// The program tests what a client can test, and asks a person about the rest. The page contains both.
#[test]
fn the_proofs_are_tried_or_asked_of_a_person() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let eki = eki_files(folder, [54_602, 54_603]);
    cell(folder, "[robot]\nkind = \"mock\"\n");
    let (exit, reported, _) = robot(folder, "prove --out proven.html --by Ada");
    assert_eq!(exit, 2, "{reported}");
    cell(folder, &eki);
    let (_mock, _, lines) = mock(folder, "");
    std::thread::spawn(move || lines.for_each(drop));
    // No question is asked if the answers cannot be saved or would replace other answers.
    std::fs::write(folder.join("old.html"), "old").expect("written");
    for (options, words) in
        [("--out old.html --by Ada", "is not overwritten"), ("--out cell.toml/p.html --by Ada", "cell.toml/p.html")]
    {
        let (exit, reported, error) = robot(folder, &format!("prove {options}"));
        assert!(exit == 2 && reported.to_string().contains(words), "{options}: {reported}");
        assert!(!error.contains("1. "), "{error}");
    }
    assert_eq!(std::fs::read_to_string(folder.join("old.html")).expect("there"), "old");
    let without_name = ["robot", "prove", "--out", "new.html", "--by", " ", "--cell", "cell.toml"];
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep")).args(without_name).current_dir(folder).output();
    let output = output.expect("the program starts");
    assert!(output.status.code() == Some(2) && !folder.join("new.html").exists());
    assert!(String::from_utf8_lossy(&output.stderr).contains("must not be empty"));
    // Stage A begins with the questions of rows 4, 14 and 16; the other rows remain open.
    std::fs::write(folder.join("answers"), "y trace 1\nn it stopped\ny\n").expect("written");
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args("robot prove --out proven.html --by Ada --cell cell.toml --json".split_whitespace())
        .current_dir(folder)
        .stdin(std::fs::File::open(folder.join("answers")).expect("there"))
        .output()
        .expect("the program starts");
    let reported: Value = serde_json::from_slice(&output.stdout).expect("one object");
    let proofs = reported["proofs"].as_array().expect("proofs");
    let of = |number: u64| {
        let proof = proofs.iter().find(|proof| proof["number"] == number).expect("a row");
        (proof["finding"].as_str().expect("a word"), proof["tried"].as_bool().expect("yes or no"))
    };
    for number in [1, 2, 3, 5, 6, 7, 15, 18, 27, 33, 35, 39] {
        assert_eq!(of(number), ("proven", true), "{number}: {reported}");
    }
    assert_eq!(
        [of(4), of(14), of(16), of(23)],
        [("proven", false), ("wrong", false), ("open", false), ("open", false)]
    );
    assert_eq!(reported["stage"], "A");
    assert!(proofs.iter().all(|proof| proof["number"] != 9 && proof["number"] != 20), "stages B and C: {reported}");
    assert_eq!((output.status.code(), &reported["verdict"]), (Some(1), &Value::from("reject")));
    let page = std::fs::read_to_string(folder.join("proven.html")).expect("the page");
    assert!(page.contains("trace 1") && page.contains("it stopped") && page.contains("By Ada"), "{page}");
    assert_eq!(page.matches("<tr class=").count(), proofs.len());
    // A mock controller was tested, which proves nothing: the page states this, and cannot be signed.
    assert!(page.contains("not valid for a real controller") && !page.contains("signature"), "{page}");
    assert!(reported["mock"] == true && reported["reasons"][0]["code"] == "mock_controller", "{reported}");
}
