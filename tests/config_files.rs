//! Tests of the delivered configuration files.

use panelprep::check::check_files;
use panelprep::requirements::Purpose;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Every delivered file is read without a problem, and recognized as its kind of file.
#[test]
fn the_shipped_files_are_valid() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("config");
    let mut kinds = Vec::new();
    for folder in [root.clone(), root.join("panels")] {
        for entry in fs::read_dir(&folder).expect("the folder is there") {
            let path = entry.expect("an entry").path();
            if path.extension().is_some_and(|extension| extension == "toml") {
                let text = fs::read_to_string(&path).expect("the file is there");
                let name = path.to_string_lossy();
                let report = check_files(&[(&name, &text)], Some(Purpose::Cycle)).swap_remove(0);
                assert_eq!(report.problems, vec![], "{}", path.display());
                assert!(!report.descriptions.is_empty());
                kinds.push(report.kind);
            }
        }
    }
    kinds.sort();
    assert_eq!(kinds, [Some("archive"), Some("cell"), Some("cell"), Some("recipe")]);
}

/// The files to be loaded on the controller have neither errors nor warnings, separately and together.
#[test]
fn the_shipped_channel_files_are_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/kuka");
    let texts = ["CELLCMD.xml", "CELLSTAT.xml"].map(|name| fs::read_to_string(folder.join(name)).expect("it"));
    for report in check_files(&[("CELLCMD.xml", &texts[0]), ("CELLSTAT.xml", &texts[1])], None) {
        assert_eq!((report.kind, report.problems, report.warnings), (Some("EthernetKRL"), vec![], vec![]));
    }
}

/// Checks the delivered programs as a user does, without and with one error; a file that cannot be read does not hide
/// errors in other files.
#[test]
fn the_shipped_programs_are_valid_and_one_bad_file_hides_no_other() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/kuka");
    let run = |folder: &Path, files: &[&str]| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_panelprep"));
        let output =
            program.args(["check", "--kss", "8.7"]).args(files).current_dir(folder).output().expect("starts");
        (output.status.code(), String::from_utf8(output.stdout).expect("UTF-8"))
    };
    let programs = [
        "cell_judge.src",
        "cell_link.src",
        "cell_motion.src",
        "cell_submit.src",
        "cell_tell.src",
        "cell_user.src",
        "cell_config.dat",
        "cell_data.dat",
    ];
    let (exit, text) = run(&folder, &programs);
    assert!(exit == Some(0) && !text.contains("warning"), "{text}");
    assert!(
        text.contains(
            "cell_motion.src: ok\n  a program: routines visible to other files: CELL_MOTION; 12 local routines"
        ),
        "{text}"
    );
    assert!(text.contains("cell_data.dat: ok\n  a data list: "), "{text}");
    let copies = tempfile::tempdir().expect("a folder");
    for name in programs {
        let text = fs::read_to_string(folder.join(name)).expect("it is there");
        let text =
            text.replace("  CELL_USER_0( )", "  CELL_USER_0(1)").replace("DECL INT N\n", "DECL INT N ; f\u{fc}r\n");
        let latin: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).expect("Latin-1")).collect();
        fs::write(copies.path().join(name), latin).expect("written");
    }
    fs::write(copies.path().join("torn.xml"), b"<A>\xFC</A>").expect("written");
    let (exit, text) = run(copies.path(), &[&programs[..], &["torn.xml", "missing.xml"]].concat());
    assert_eq!(exit, Some(2), "{text}");
    assert!(
        text.contains("cell_user.src: not right\n  line 16: CELL_USER_0: found 1 arguments, expected 0"),
        "{text}"
    );
    assert!(text.contains("torn.xml: not right\n  line 1: "), "{text}");
    assert!(
        text.contains("missing.xml: not right\n  missing.xml: ") && text.contains("cell_judge.src: ok"),
        "{text}"
    );
}

/// The unit permits the system calls of the program that are outside of its groups (nice, for the connection and for
/// computing). It is as hardened as it states: its exposure level is at most 1.2, if systemd is available here to
/// compute it.
#[test]
fn the_shipped_unit_is_hardened_and_permits_the_calls_of_the_program() {
    let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/panelprep.service");
    let text = fs::read_to_string(&unit).expect("it is there");
    let at = |line: &str| text.lines().position(|found| found == line).unwrap_or_else(|| panic!("no {line}"));
    assert!(at("SystemCallFilter=setpriority") > at("SystemCallFilter=~@privileged @resources"));
    at("SystemCallErrorNumber=EPERM");
    at("LimitNICE=-10");
    // AF_NETLINK is needed to find GigE Vision cameras: the search lists the network interfaces with it.
    at("RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK");
    // The kernel reports the user who sends a request on the socket. In a separate user namespace, each user would be
    // reported as the overflow user, UID 65534.
    assert!(!text.lines().any(|line| line.starts_with("PrivateUsers=")));
    // The file beside the unit allows the networks of the cell; the delivered sample allows the network of the robot.
    at("IPAddressDeny=any");
    let networks = fs::read_to_string(unit.with_file_name("panelprep-network.conf")).expect("it ships");
    assert!(networks.lines().any(|line| line == "IPAddressAllow=172.31.1.0/24"), "{networks}");
    let mut judge = Command::new("systemd-analyze");
    judge.args(["security", "--offline=true", "--threshold=12", "--no-pager"]).arg(unit);
    match judge.output() {
        Ok(judged) => assert!(judged.status.success(), "{}", String::from_utf8_lossy(&judged.stdout)),
        Err(error) => eprintln!("systemd-analyze is not here: {error}"),
    }
}

/// The samples of Zivid settings are recognized; a file for the film in which the camera's projector is on is refused
/// at this line.
#[test]
fn the_shipped_camera_settings_are_valid() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/zivid");
    for (name, says) in [("scan.yml", "3D shots with colour"), ("film.yml", "pictures of the film")] {
        let text = fs::read_to_string(root.join(name)).expect("it ships");
        let report = check_files(&[(name, &text)], None).swap_remove(0);
        assert_eq!((report.kind, report.problems.as_slice()), (Some("zivid_settings"), [].as_slice()), "{name}");
        assert!(report.descriptions[0].contains(says), "{:?}", report.descriptions);
        let lit = check_files(&[(name, &text.replace("Brightness: 0", "Brightness: 1"))], None).swap_remove(0);
        assert_eq!(lit.problems.len(), usize::from(name == "film.yml"), "{lit:?}");
    }
}

/// The unit for a cell with a Zivid names the devices of the graphics processor as today's drivers do. If systemd is
/// installed here, it accepts every line of both files. Without systemd none of this is checked, and the test reports
/// this.
#[test]
fn systemd_accepts_the_unit_for_a_zivid() {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config");
    let more = fs::read_to_string(config.join("panelprep-zivid.conf")).expect("it ships");
    for device in ["drm", "nvidia", "nvidiactl", "nvidia-uvm"] {
        let line = format!("DeviceAllow=char-{device} rw");
        assert!(more.lines().any(|found| found == line), "no {line}");
    }
    assert!(more.lines().any(|line| line == "SupplementaryGroups=video render"));
    let folder = tempfile::tempdir().expect("a folder");
    let beside = folder.path().join("panelprep.service.d");
    fs::create_dir(&beside).expect("made");
    let unit = fs::read_to_string(config.join("panelprep.service")).expect("it ships");
    let unit = unit.replace("/usr/bin/panelprep", env!("CARGO_BIN_EXE_panelprep"));
    fs::write(folder.path().join("panelprep.service"), unit).expect("written");
    fs::copy(config.join("panelprep-network.conf"), beside.join("network.conf")).expect("it ships");
    let says = |more: &str| {
        fs::write(beside.join("zivid.conf"), more).expect("written");
        let mut verify = Command::new("systemd-analyze");
        let verify = verify.args(["verify", "--man=no"]).arg(folder.path().join("panelprep.service"));
        let reply = verify
            .output()
            .map(|reply| (reply.status.success(), String::from_utf8_lossy(&reply.stderr).into_owned()));
        reply.map(|(right, words)| (right, words.lines().filter(|line| line.contains("panelprep")).count()))
    };
    match says(&more) {
        Ok(found) => {
            assert_eq!(found, (true, 0), "systemd takes each line");
            let spoilt = says(&more.replace("DevicePolicy=closed", "DevicePolicy=shut")).expect("it is here");
            assert_eq!(spoilt.1, 1, "and tells one that it does not take");
        }
        Err(error) => eprintln!("NOT RUN: systemd-analyze is not here ({error}); the units were not verified"),
    }
}
