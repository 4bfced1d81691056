//! Cells as a user writes them, and what is read from them; `mistakes` tests the messages for wrong ones,
//! `calibrations` the files that a cell names.

mod calibrations;
mod mistakes;
mod opcua;

use super::*;
use proptest::prelude::*;

/// Returns the problems of a cell's text, without the file's name.
fn cell_problems(text: &str) -> Vec<String> {
    problems(Cell::check("f", text))
}

fn problems<T>(checked: Result<T, Problems>) -> Vec<String> {
    let text = checked.err().map_or(String::new(), |problems| problems.to_string());
    text.lines().map(|line| line.trim_start_matches("f:").to_owned()).collect()
}

#[test]
fn an_empty_file_is_the_simulated_cell() {
    let cell = Cell::check("somewhere/cell.toml", "").unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!((cell.scanner(), cell.flange_camera()), (&Camera::Simulated, &Camera::Simulated));
    assert_eq!((cell.robot().kind(), cell.robot().host()), (RobotKind::Mock, "127.0.0.1"));
    assert_eq!((cell.robot().command_port(), cell.robot().state_port()), (54_600, 54_601));
    assert_eq!(cell.store(), Path::new("somewhere/store"));
    assert_eq!((cell.park_pose(), cell.limits().workspace(), cell.limits().tool_error_mm()), (None, None, None));
    assert_eq!(cell.calibration(), &CalibrationFiles::default());
}

/// `design.md`, "Limits, once".
#[test]
fn the_default_limits_are_the_designs() {
    let cell = Cell::check("cell.toml", "").unwrap_or_else(|problems| panic!("{problems}"));
    let limits = cell.limits();
    assert_eq!((limits.window_s(), limits.window_commands(), limits.min_points()), (1.0, 50, 5));
    assert_eq!((limits.heartbeat_ms(), limits.watchdog_ms(), limits.token_s()), (100, 400, 600.0));
    assert_eq!((limits.stop_deadline_s(), limits.observation_s(), limits.min_break_mm2()), (10.0, 60.0, 5.0));
}

#[test]
fn names_of_files_start_at_the_cells_folder() {
    let text = "scanner = {kind = 'recorded', folder = 'shots'}\n[calibration]\nscanner = 'lens.toml'\nflange_from_tool = '/etc/tool.toml'";
    let cell = Cell::check("cells/a/cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(cell.scanner(), &Camera::Recorded { folder: "cells/a/shots".into() });
    assert_eq!(cell.calibration().scanner, Some("cells/a/lens.toml".into()));
    assert_eq!(cell.calibration().flange_from_tool, Some("/etc/tool.toml".into()));
    assert_eq!(cell.calibration().base_from_camera, None);
}

#[test]
fn a_gige_camera_is_set_by_the_cell() {
    let text = "[flange_camera]\nkind = 'gige'\naddress = '10.0.0.2'\npixel_format = 'Mono8'\nexposure_us = 8000";
    let cell = Cell::check("cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
    let gige = Gige {
        serial: None,
        address: Some("10.0.0.2".to_owned()),
        user_set: "Default".to_owned(),
        pixel_format: "Mono8",
        exposure_us: 8_000.0,
        gain_db: None,
        packet_bytes: 1_400,
    };
    assert_eq!(cell.flange_camera(), &Camera::Device(gige));
}

#[test]
fn names_that_the_user_chose_are_kept() {
    let axes = "a1_deg = 1, a2_deg = -90, a3_deg = 90, a4_deg = 4, a5_deg = 5, a6_deg = 350";
    let text = format!(
        "[poses]\npark = {{{axes}}}\nwash = {{{axes}}}\n[io]\noutputs = {{tool = 1, light = 4096}}\nfeedbacks.flow = 1"
    );
    let cell = Cell::check("cell.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(cell.park_pose().map(|park| (park.a1_deg, park.a6_deg)), Some((1.0, 350.0)));
    assert_eq!((cell.pose("wash"), cell.pose("dry")), (cell.park_pose(), None));
    assert_eq!(
        (cell.inputs_outputs().outputs().get("light"), cell.inputs_outputs().feedbacks().get("flow")),
        (Some(&4096), Some(&1))
    );
}

#[test]
fn signals_are_the_bits_in_the_order_of_their_numbers() {
    let cell = Cell::check("cell.toml", "[io.outputs]\nlight = 9\ntool = 3\nspray = 5\n").expect("good");
    let found = cell.inputs_outputs().decode_outputs(0b101);
    assert_eq!(found, [("light", true), ("spray", false), ("tool", true)], "3 is bit 0, 5 bit 1, 9 bit 2");
}

/// Tool and all water are switched off at once, extraction and light after their usual time or the stated time. The
/// shutter and the user's other outputs do not change.
#[test]
fn what_switches_off_automatically_has_its_time() {
    let outputs = "outputs = { light = 9, tool = 3, spray = 5, rinse = 6, extraction = 4, lens_shutter = 7, horn = 8, fan = 2 }";
    let text = format!("[io]\n{outputs}\noff_after_s = {{ light = 20, fan = 3 }}");
    let cell = Cell::check("cell.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
    let after: Vec<(&str, u16)> =
        cell.inputs_outputs().off_delays_s().iter().map(|(name, after_s)| (name.as_str(), *after_s)).collect();
    assert_eq!(after, [("extraction", 30), ("fan", 3), ("light", 20), ("rinse", 0), ("spray", 0), ("tool", 0)]);
    // Numbers 2 3 4 5 6 7 8 9 are bits 0 to 7: the tool is bit 1, the spray bit 3, the rinse bit 4.
    assert_eq!(cell.inputs_outputs().harmful_bits(), 0b11010);
}

/// Pages and records stay for ever; the file states how long clips and scans stay.
#[test]
fn the_store_s_table_states_what_is_kept() {
    let check = |text: &str| Cell::check("a/cell.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
    assert!(check("store = 'kept'").retention().is_unlimited());
    let cell = check("[store]\nfolder = 'kept'\nkeep = { days = 30, cycles = 200, failed_days = 180 }");
    assert_eq!(cell.store(), Path::new("a/kept"));
    let expected = Retention {
        passed: RetentionTime { days: Some(30), cycles: Some(200) },
        failed: RetentionTime { days: Some(180), cycles: None },
    };
    assert_eq!(*cell.retention(), expected);
    assert_eq!(check("[store]").store(), Path::new("a/store"));
    for (text, words) in [
        ("[store]\nkeep = { days = 0 }", "2: store.keep.days: found 0, valid: a whole number from 1 to 36500"),
        ("[store]\nkeep = { day = 3 }", "store.keep.day"),
        ("[store.keep]\ndays = 30\nfailed_days = 7", "3: store.keep.failed_days: found 7, the minimum is 30"),
        ("[store]\nkeep = 30", "store.keep: found 30, valid: a table"),
        ("store = 7", "store: found 7, valid: a text"),
    ] {
        let told = cell_problems(text);
        assert!(told.iter().any(|told| told.contains(words)), "{text}: {told:?}");
    }
}

#[test]
fn a_host_is_an_address_or_a_name() {
    let of = |host: &str| Cell::check("f", &format!("[robot]\nkind = 'eki'\nhost = '{host}'"));
    for host in ["172.31.1.147", "::1", "localhost", "krc-4.cell.example", "krc4_left", "a1.b2c"] {
        let cell = of(host).unwrap_or_else(|problems| panic!("{host}: {problems}"));
        let here = ["::1", "localhost"].contains(&host);
        assert_eq!(cell.robot().is_local_controller(), here, "{host}");
    }
    for host in [
        "host.foo bar",
        "172.31.1.999",
        "172.31.1",
        "-krc",
        "krc-",
        "krc..cell",
        "http://krc",
        "krc:54600",
        "krc/1",
    ] {
        assert!(of(host).is_err(), "{host}");
    }
}

proptest! {
    #[test]
    fn any_text_is_an_answer(text in "(?s).{0,200}") {
        let _ = (Cell::check("f", &text), Intrinsics::check("f", &text), MountedPose::<ToolMount>::check("f", &text));
    }
}
