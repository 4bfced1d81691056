use super::*;

const COMPLETE_CELL: &str = include_str!("../../../config/cell.toml");

fn keys(text: &str, purpose: Purpose) -> Vec<String> {
    let cell = Cell::check("cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
    unmet_requirements(&cell, purpose).into_iter().map(|unmet| unmet.key).collect()
}

/// Each case is one change of the shipped cell's file, with the keys that must then be reported.
#[test]
fn each_cause_that_prevents_a_cycle_is_reported() {
    assert_eq!(keys(COMPLETE_CELL, Purpose::Cycle), [""; 0]);
    let robot = "[robot]\nkind = \"mock\"";
    let eki = |host: &str| COMPLETE_CELL.replace(robot, &format!("[robot]\nkind = \"eki\"\nhost = \"{host}\""));
    assert!(COMPLETE_CELL.contains(robot));
    let replaced = |from: &str, to: &str| {
        let text = COMPLETE_CELL.replacen(from, to, 1);
        assert_ne!(text, COMPLETE_CELL, "{from}");
        text
    };
    let post = "\n[[keep_out]]\nname = \"post\"\nmin_mm = [-250, 200, 0]\nmax_mm = [-150, 300, 900]\n";
    for (text, expected) in [
        (replaced("park = { a1_deg = -120.0", "park = { a1_deg = -320.0"), vec!["poses.park.a1_deg"]),
        (replaced("ready = { a1_deg = 0.0", "ready = { a1_deg = 190.0"), vec!["poses.ready.a1_deg"]),
        (replaced("spray = 2 ", ""), vec!["io.outputs.spray"]),
        (replaced("lens_shut = 2", ""), vec!["io.feedbacks.lens_shut"]),
        (replaced("light_on = 5", ""), vec!["io.feedbacks.light_on"]),
        (replaced("box_min_mm = [", "# [").replacen("box_max_mm = [", "# [", 1), vec!["limits.box_min_mm"]),
        (replaced("flange_from_tool =", "# "), vec!["calibration.flange_from_tool"]),
        (
            replaced("box_min_mm = [", "box_min_mm = [0.1, -0.4, 0.0] # [").replacen(
                "box_max_mm = [",
                "box_max_mm = [0.8, 0.4, 0.9] # [",
                1,
            ),
            vec!["limits.box_max_mm"],
        ),
        (eki("172.31.1.147"), vec!["scanner.kind", "flange_camera.kind"]),
        (eki("127.0.0.1"), vec![]),
        (eki("localhost").replace("light_on = 5", ""), vec!["io.feedbacks.light_on"]),
        (
            replaced("[scanner]\nkind = \"simulated\"", "[scanner]\nkind = \"zivid\"\nsettings = \"a.yml\""),
            vec!["scanner.settings_2d"],
        ),
        (format!("{COMPLETE_CELL}{post}"), vec!["poses.park"]),
        (replaced("spray = 2 ", "pump = 9\nspray = 2 "), vec!["io.outputs.pump"]),
        (replaced("spray = 2 ", "pump = 9\nspray = 2 ") + "\n[io]\nmay_stay_on = [\"pump\"]\n", vec![]),
    ] {
        assert_eq!(keys(&text, Purpose::Cycle), expected, "{text}");
    }
}

/// No cycle can start on a real controller whose programs were not accepted. Single functions, with which the cell is
/// commissioned, and a rehearsal on this computer need no acceptance.
#[test]
fn a_cycle_on_a_real_controller_needs_accepted_programs() {
    let example = include_str!("../../../config/cell-example.toml");
    let needs = |text: &str, purpose| {
        let cell = Cell::check("cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
        let all = incomplete_files(&cell, purpose, &skip_file);
        all.into_iter().any(|unmet| unmet.kind == ProblemKind::Acceptance && unmet.key == "robot.programs_sum")
    };
    let accepted = example.replacen("# programs_sum = ", "programs_sum = ", 1);
    assert_ne!(accepted, example);
    let here = example.replacen("host = \"172.31.1.147\"", "host = \"127.0.0.1\"", 1);
    assert!(needs(example, Purpose::Cycle));
    assert!(!needs(example, Purpose::Robot) && !needs(&accepted, Purpose::Cycle));
    assert!(!needs(&here, Purpose::Cycle) && !needs(COMPLETE_CELL, Purpose::Cycle));
}

#[test]
fn a_real_cell_needs_no_feedback_of_its_light() {
    let example = include_str!("../../../config/cell-example.toml");
    assert_eq!(keys(example, Purpose::Cycle), [""; 0]);
    assert_eq!(keys(&example.replacen("light_on = 21", "", 1), Purpose::Cycle), [""; 0]);
    assert_eq!(keys("[robot]\nkind = 'eki'\nhost = 'krc'\n", Purpose::Robot), [""; 0]);
    let bare = keys("", Purpose::Robot);
    assert_eq!(bare.len(), 11, "five outputs, five feedbacks, the park pose: {bare:?}");
    assert_eq!(keys("", Purpose::Cycle).len(), 17, "with the box and five calibrations");
}

fn found(cell: &str, read: ReadNamed<'_>) -> Vec<(String, String)> {
    let cell = Cell::check("cell.toml", cell).unwrap_or_else(|problems| panic!("{problems}"));
    incomplete_files(&cell, Purpose::Cycle, read).into_iter().map(|unmet| (unmet.key, unmet.message)).collect()
}

/// Each missing file is reported once, and the advice is given once; an existing file is checked as the kind of file
/// that its key requires.
#[test]
fn missing_and_invalid_files_are_reported_once() {
    assert_eq!(found(COMPLETE_CELL, &skip_file), []);
    let missing = found(COMPLETE_CELL, &|_| NamedFile::Missing);
    let keys: Vec<&str> = missing.iter().map(|(key, _)| key.as_str()).collect();
    assert!(keys.len() >= 5 && keys.iter().all(|key| key.starts_with("calibration.")), "{keys:?}");
    let advised = missing.iter().filter(|(_, message)| message.contains("panelprep calibrate")).count();
    assert_eq!(
        (advised, missing[0].1.contains("which does not exist; `panelprep demo` creates this file")),
        (1, true)
    );
    let wrong = found(COMPLETE_CELL, &|_| NamedFile::Text("wavelength = 3".to_owned()));
    assert_eq!(wrong.len(), missing.len(), "{wrong:?}");
    assert!(wrong[0].1.contains("scanner.toml:1: wavelength: unknown key"), "{wrong:?}");
    let unreadable = found(COMPLETE_CELL, &|_| NamedFile::Unreadable("line 1 is not UTF-8".to_owned()));
    assert!(unreadable[0].1.ends_with("which cannot be read: line 1 is not UTF-8"), "{unreadable:?}");
}

/// Calibrations that were measured with the nominal arm, in a cell that corrects the arm.
#[test]
fn a_mount_measured_with_another_correction_is_refused() {
    let cell = "[calibration]\nrobot_correction = \"arm.toml\"\nflange_from_tool = \"tool.toml\"\n";
    let correction = "[robot_correction]\n";
    let tool = |by: &str| {
        format!(
            "[flange_from_tool]\nx_mm = 0\ny_mm = 0\nz_mm = 120\na_deg = 0\nb_deg = 0\nc_deg = 0\naxis_measured = true\n\
             {by}"
        )
    };
    let of_tool = |by: &str| {
        let read = |file: &Path| match file.ends_with("arm.toml") {
            true => NamedFile::Text(correction.to_owned()),
            false => NamedFile::Text(tool(by)),
        };
        let all = found(cell, &read);
        let of_tool = all.into_iter().filter(|(key, message)| {
            key == "calibration.flange_from_tool" && message.contains("another robot correction")
        });
        of_tool.count()
    };
    let ours = content_hash(correction.as_bytes());
    assert_eq!(of_tool(&format!("robot_correction = \"{ours}\"\n")), 0);
    assert_eq!(of_tool(&format!("robot_correction = \"{}\"\n", content_hash(b"other"))), 1);
    assert_eq!(of_tool(""), 0, "a person wrote it by hand");
}

#[test]
fn missing_settings_of_a_zivid_are_reported() {
    let zivid = COMPLETE_CELL.replacen(
        "[scanner]\nkind = \"simulated\"",
        "[scanner]\nkind = \"zivid\"\nsettings = \"a.yml\"\nsettings_2d = \"b.yml\"",
        1,
    );
    let read = |file: &Path| match file.extension().is_some_and(|ending| ending == "yml") {
        true => NamedFile::Missing,
        false => NamedFile::NotChecked,
    };
    let keys: Vec<String> = found(&zivid, &read).into_iter().map(|(key, _)| key).collect();
    assert_eq!(keys, ["scanner.settings", "scanner.settings_2d"]);
}
