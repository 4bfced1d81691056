//! Tests of the parsers for the cell's file and for the lens and mount files that it names: valid and invalid files,
//! and files that are written and read back. A message about a wrong file names the line, the key and the valid values.

use super::*;
use panelprep_base::geometry::{KukaPose, PinholeCamera, Pixel, Point};
use proptest::prelude::*;

/// Returns the problems of a cell's file, without the name of the file.
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

/// Expected values: the defaults in `design.md`, "Limits, once".
#[test]
fn the_default_limits_are_those_of_the_design() {
    let cell = Cell::check("cell.toml", "").unwrap_or_else(|problems| panic!("{problems}"));
    let limits = cell.limits();
    assert_eq!((limits.window_s(), limits.window_commands(), limits.min_points()), (1.0, 50, 5));
    assert_eq!((limits.heartbeat_ms(), limits.watchdog_ms(), limits.token_s()), (100, 400, 600.0));
    assert_eq!((limits.stop_deadline_s(), limits.observation_s(), limits.min_break_mm2()), (10.0, 60.0, 5.0));
}

#[test]
fn file_names_are_relative_to_the_cells_folder() {
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

/// Tool and all water outputs are switched off without delay, extraction and light after their default or stated delay.
/// The lens shutter and the user's other outputs keep their state.
#[test]
fn each_automatic_switch_off_has_its_delay() {
    let outputs = "outputs = { light = 9, tool = 3, spray = 5, rinse = 6, extraction = 4, lens_shutter = 7, horn = 8, fan = 2 }";
    let text = format!("[io]\n{outputs}\noff_after_s = {{ light = 20, fan = 3 }}");
    let cell = Cell::check("cell.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
    let after: Vec<(&str, u16)> =
        cell.inputs_outputs().off_delays_s().iter().map(|(name, after_s)| (name.as_str(), *after_s)).collect();
    assert_eq!(after, [("extraction", 30), ("fan", 3), ("light", 20), ("rinse", 0), ("spray", 0), ("tool", 0)]);
    // Expected value, calculated by hand: the signal numbers 2 to 9 are the bits 0 to 7; the tool is bit 1, the spray
    // bit 3, the rinse bit 4.
    assert_eq!(cell.inputs_outputs().immediate_off_bits(), 0b11010);
}

/// Pages and records are kept for ever; the file states how long clips and scans are kept.
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
    fn no_text_causes_a_panic(text in "(?s).{0,200}") {
        let _ = (Cell::check("f", &text), Intrinsics::check("f", &text), MountedPose::<ToolMount>::check("f", &text));
    }
}

#[test]
fn the_opcua_server_is_off_by_default_and_its_certificates_are_in_the_store() {
    let cell = Cell::check("/cell/cell.toml", "store = 'kept'").expect("right");
    let OpcUa { listen, anonymous, is_unencrypted_allowed, certificates, .. } = cell.opcua().clone();
    assert_eq!((listen, anonymous, is_unencrypted_allowed), (None, AnonymousAccess::Nothing, false));
    assert_eq!(certificates, Path::new("/cell/kept/opcua"));
    let text = "[opcua]\nlisten = '0.0.0.0:4840'\nhost = 'cell-1.plant'\nanonymous = 'read'\nunencrypted = true\ncertificates = 'pki'";
    let cell = Cell::check("/cell/cell.toml", text).expect("right");
    let found = cell.opcua();
    assert_eq!(found.listen.map(|address| address.port()), Some(4_840));
    assert_eq!((found.anonymous, found.is_unencrypted_allowed), (AnonymousAccess::Read, true));
    assert_eq!((found.host.as_deref(), &*found.certificates), (Some("cell-1.plant"), Path::new("/cell/pki")));
}

#[test]
fn mistakes_of_the_opcua_server_are_named() {
    for (text, expected) in [
        (
            "listen = '4840'",
            "2: opcua.listen: found \"4840\", valid: an IP address and a port, such as \"0.0.0.0:4840\"",
        ),
        ("listen = '0.0.0.0:0'", "2: opcua.listen: found \"0.0.0.0:0\", valid: an IP address and a port"),
        ("anonymous = 'write'", "2: opcua.anonymous: found the text \"write\", valid: \"nothing\" or \"read\""),
        ("unencrypted = true", "2: opcua.unencrypted: found true, but log-in is not possible"),
        ("host = 'a b'", "2: opcua.host: found \"a b\", valid: a computer's name or an IP address"),
        ("listen = '0.0.0.0:4840'\nport = 4840", "3: opcua.port: unknown key"),
        ("anonymous = 'read'", "1: opcua.listen: is missing: the address and port of the server"),
    ] {
        let found = cell_problems(&format!("[opcua]\n{text}"));
        assert!(found.len() == 1 && found[0].starts_with(expected), "{text}: {found:?}");
    }
}

const LENS: &str =
    "[camera]\nwidth_px = 1944\nheight_px = 1200\nfx_px = 1785.0\nfy_px = 1784.0\ncx_px = 972.0\ncy_px = 600.0
k1 = -0.1\nk2 = 0.12\np1 = 0.0006\np2 = -0.0004\nk3 = -0.02\n";

#[test]
fn intrinsics_are_read_with_their_provenance() {
    let text = format!("{LENS}serial = \"Z-2\"\ndate = 2026-05-31\nrms_px = 0.21\n");
    let lens = Intrinsics::check("f", &text).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!((lens.camera.width_px, lens.camera.fx_px, lens.camera.k3), (1944, 1785.0, -0.02));
    assert_eq!(
        (lens.serial.as_deref(), lens.date, lens.rms_px),
        (Some("Z-2"), Date::parse("2026-05-31"), Some(0.21))
    );
}

#[test]
fn intrinsics_that_cannot_be_a_cameras_are_refused() {
    let wrong = |from: &str, to: &str| problems(Intrinsics::check("f", &LENS.replace(from, to)));
    assert_eq!(
        wrong("fx_px = 1785.0", "fx_mm = 6.2"),
        ["4: camera.fx_mm: unknown key; this length is in px: write fx_px"]
    );
    assert_eq!(wrong("k2 = 0.12", "k2 = nan"), ["9: camera.k2: found nan, valid: a number from -1000 to 1000"]);
    assert_eq!(wrong("p1 = 0.0006\n", ""), ["1: camera.p1: is missing; this key has no default"]);
    // Expected value, calculated by hand: with k1 = −10 the distortion folds at 1 − 30 r² = 0, so at r = 0.18; the
    // corner of the picture is at 0.64.
    assert_eq!(
        wrong("k1 = -0.1", "k1 = -10.0"),
        [
            "8: camera.k1: with k1, k2, p1, p2 and k3, the pixel (0, 0) has no ray; check that these values are those \
             of this camera"
        ]
    );
    // Expected value, calculated by hand: with k1 = −1 the distortion folds at r = 0.58. The only solution of r − r³ =
    // 0.64 is r = −1.23, on the other side of the axis.
    assert_eq!(wrong("k1 = -0.1", "k1 = -1.0").len(), 1, "a false inverse is none");
    let dated = |date: &str| problems(Intrinsics::check("f", &format!("{LENS}date = {date}")));
    assert_eq!(dated("2026-05-31T10:00:00"), ["13: camera.date: valid: a date, such as 2026-05-31"]);
    assert_eq!(dated("'yesterday'"), ["13: camera.date: valid: a date, such as 2026-05-31"]);
    assert!(dated("'2026-05-31'").is_empty());
}

const MOUNT: &str = "x_mm = 600\ny_mm = 0\nz_mm = 900\na_deg = 90\nb_deg = 0\nc_deg = 180\n";

/// Expected value, calculated by hand: Rx(180) maps the camera's z to −z, and the rotation A about Z does not change
/// this. A point 500 mm in front of the lens is at z = 400.
#[test]
fn a_mount_maps_its_own_frames() {
    let text = format!("[base_from_camera]\n{MOUNT}rms_mm = 0.1\n");
    let mounted = MountedPose::<ScannerMount>::check("f", &text).unwrap_or_else(|problems| panic!("{problems}"));
    let seen = mounted.rigid() * Point::at(0.0, 0.0, 500.0);
    assert!(seen.distance_mm(Point::at(600.0, 0.0, 400.0)) < 1e-9, "{seen:?}");
    assert_eq!((mounted.rms_mm, mounted.uncertainty_mm), (Some(0.1), None));
}

#[test]
fn a_mount_is_not_taken_for_another() {
    let camera = format!("[flange_from_camera]\n{MOUNT}");
    assert_eq!(problems(MountedPose::<FlangeCameraMount>::check("f", &camera)), Vec::<String>::new());
    assert_eq!(
        problems(MountedPose::<ToolMount>::check("f", &camera)),
        ["1: flange_from_camera: unknown key; did you mean flange_from_tool?"]
    );
    let axis = "axis_measured = true\n";
    assert_eq!(
        problems(MountedPose::<FlangeCameraMount>::check("f", &format!("{camera}{axis}"))),
        [
            "8: flange_from_camera.axis_measured: unknown key; valid keys here: x_mm, y_mm, z_mm, a_deg, b_deg, c_deg, \
             date, rms_mm, uncertainty_mm, serial, robot_correction, program, pictures, residuals_mm"
        ]
    );
    let tool = format!("[flange_from_tool]\n{MOUNT}{axis}");
    let tool = MountedPose::<ToolMount>::check("f", &tool).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(tool.axis_measured, Some(true));
}

#[test]
fn a_mount_in_other_units_is_refused() {
    let text = format!(
        "[base_from_camera]\n{}",
        MOUNT.replace("x_mm = 600", "x_m = 0.6").replace("a_deg = 90", "a_rad = 1.57")
    );
    assert_eq!(
        problems(MountedPose::<ScannerMount>::check("f", &text)),
        [
            "2: base_from_camera.x_m: unknown key; this length is in mm: write x_mm",
            "5: base_from_camera.a_rad: unknown key; this angle is in degrees: write a_deg"
        ]
    );
}

fn date() -> impl Strategy<Value = Option<Date>> {
    prop::option::of((2000..2100i32, 1..=12i32, 1..=28i32))
        .prop_map(|day| day.and_then(|(year, month, day)| Date::parse(&format!("{year:04}-{month:02}-{day:02}"))))
}

proptest! {
    /// All numbers of a written calibration are read back exactly.
    #[test]
    fn written_intrinsics_are_read_back(
        (width_px, height_px) in (16..4000usize, 16..4000usize),
        focal_px in 4_000.0..9_000.0f64,
        centre_px in prop::array::uniform2(0.0..4000.0f64),
        coefficients in prop::array::uniform5(-1e-3..1e-3f64),
        serial in prop::option::of("\\PC{0,12}[^\\s\\p{C}]"),
        date in date(),
        rms_px in prop::option::of(0.0..9.0f64),
    ) {
        let [k1, k2, p1, p2, k3] = coefficients;
        let [cx_px, cy_px] = centre_px;
        let (fx_px, fy_px) = (focal_px, focal_px * 1.001);
        let camera = PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 };
        let provenance = Provenance {
            program: Some("panelprep \"0\"".to_owned()),
            pictures: vec!["ab".to_owned(), "cd".to_owned()],
            residuals: rms_px.into_iter().collect(),
        };
        let covariance = rms_px.map(|_| LensCovariance::from_fn(|i, j| 0.1 / (1.0 + i.abs_diff(j) as f64)));
        let outline_px = vec![Pixel::at(1.5, 2.0), Pixel::at(9.0, 2.0), Pixel::at(9.0, 8.25)];
        let extent = LensExtent {
            model: Some("k1k2".to_owned()),
            excluded_coefficients: vec!["k3: as good without".to_owned()],
            supported: rms_px.map(|error_px| SupportedArea { error_px, outline_px }),
        };
        let lens = Intrinsics { camera, covariance, serial, date, rms_px, extent, provenance, errors: None };
        prop_assert_eq!(Intrinsics::check("f", &lens.to_toml()), Ok(lens.clone()), "{}", lens.to_toml());
    }

    #[test]
    fn written_mounts_are_read_back(
        place_mm in prop::array::uniform3(-2e4..2e4f64),
        angles_deg in prop::array::uniform3(-360.0..360.0f64),
        date in date(),
        residuals_mm in prop::option::of((0.0..9.0f64, 1e-12..9.0f64)),
        axis_measured in prop::option::of(prop::bool::ANY),
    ) {
        let ([x_mm, y_mm, z_mm], [a_deg, b_deg, c_deg]) = (place_mm, angles_deg);
        let (rms_mm, uncertainty_mm) = residuals_mm.unzip();
        let pose = KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg };
        let mut tool = MountedPose::<ToolMount>::from_pose(pose);
        (tool.date, tool.rms_mm) = (date, rms_mm);
        (tool.uncertainty_mm, tool.axis_measured) = (uncertainty_mm, axis_measured);
        prop_assert_eq!(MountedPose::check("f", &tool.to_toml()), Ok(tool.clone()), "{}", tool.to_toml());
        let camera = MountedPose::<ScannerMount>::from_pose(pose);
        prop_assert_eq!(MountedPose::check("f", &camera.to_toml()), Ok(camera));
    }
}

/// All problems of a file are reported, not only the first.
#[test]
fn the_signals_mistakes_are_reported_together() {
    let told = cell_problems("[io.outputs]\ntool = 3\nlight = 3\n[io.feedbacks]\na = 5\nb = 5");
    let (tool, b) = (
        "2: io.outputs.tool: found 3, which is already the number of light",
        "6: io.feedbacks.b: found 5, which is already the number of a",
    );
    assert!(told.len() == 2 && told[0].starts_with(tool) && told[1].starts_with(b), "{told:?}");
}

#[test]
fn each_mistake_is_named() {
    let axes = "{a1_deg = 0, a2_deg = 0, a3_deg = 0, a4_deg = 0, a5_deg = 0, a6_deg = 0}";
    let inputs: Vec<String> = (1..=32).map(|number| format!("n{number} = {number}")).collect();
    let cases = [
        (
            "scanner.kind = 'gige'",
            "1: scanner.kind: found the text \"gige\", valid: \"simulated\" or \"recorded\" or \"zivid\"",
        ),
        (
            "flange_camera.kind = 'zivid'",
            "1: flange_camera.kind: found the text \"zivid\", valid: \"simulated\" or \"recorded\" or \"gige\"",
        ),
        (
            "scanner.kind = 'recorded'",
            "1: scanner.folder: is missing; kind = \"recorded\" needs the folder of the recording",
        ),
        (
            "[scanner]\nfolder = 'shots'",
            "2: scanner.folder: has no effect with kind = \"simulated\"; this key is valid only with kind = \
             \"recorded\"",
        ),
        (
            "[scanner]\nkind = 'recorded'\nfolder = 'shots'\nserial = '1'",
            "4: scanner.serial: has no effect with kind = \"recorded\"; this key is valid only with kind = \"zivid\"",
        ),
        (
            "flange_camera = {kind = 'gige', serial = 221600123, exposure_us = 10000}",
            "1: flange_camera.serial: found 221600123, valid: a text that is not empty",
        ),
        (
            "[flange_camera]\nkind = 'gige'\nserial = '1'\naddress = '10.0.0.2'\nexposure_us = 10000",
            "4: flange_camera.address: cannot be combined with serial; state only one of the two keys",
        ),
        (
            "[flange_camera]\npacket_bytes = 9000",
            "2: flange_camera.packet_bytes: has no effect with kind = \"simulated\"; this key is valid only with kind \
             = \"gige\"",
        ),
        (
            "[flange_camera]\nkind = 'gige'\npacket_bytes = 9001\nexposure_us = 10000",
            "3: flange_camera.packet_bytes: found 9001, valid: a whole number from 576 to 9000",
        ),
        (
            "[flange_camera]\nkind = 'gige'",
            "1: flange_camera.exposure_us: is missing; kind = \"gige\" needs it, in µs: take a multiple of 10000 for lamps on mains \
             of 50 Hz, of 8333 on 60 Hz, such that the brightest parts are not saturated (`panelprep shoot corner` reports it)",
        ),
        (
            "[scanner]\nexposure_us = 100",
            "2: scanner.exposure_us: unknown key here; did you mean flange_camera.exposure_us?",
        ),
        ("[robot]\nkind = 'eki'", "1: robot.host: is missing; kind = \"eki\" needs the controller's address"),
        (
            "[robot]\nkind = 'eki'\nhost = 'host.foo bar'",
            "3: robot.host: found \"host.foo bar\", valid: an address such as 172.31.1.147, or a host name of letters, digits, \
             - and dots",
        ),
        (
            "[robot]\nkind = 'eki'\nhost = '0.0.0.0'",
            "3: robot.host: found \"0.0.0.0\", which is not the address of a single machine",
        ),
        (
            "[robot]\nprograms_sum = 1000003",
            "2: robot.programs_sum: found 1000003, valid: a whole number from 0 to 1000002",
        ),
        (
            "[robot]\nkind = 'eki'\nhost = 'krc'\nsigned_stage = 'C'",
            "4: robot.signed_stage: needs programs_sum, the checksum of the tested programs; run `panelprep doctor \
             --kuka DIR --accept` with the controller's files and add the line that it prints",
        ),
        (
            "[robot]\nhost = '172.31.1.147'",
            "2: robot.host: found \"172.31.1.147\"; kind = \"mock\" runs on this machine, 127.0.0.1",
        ),
        (
            "[robot]\nstate_port = 54616",
            "2: robot.state_port: found 54616, valid: a whole number from 54600 to 54615",
        ),
        (
            "[robot]\ncommand_port = 54601",
            "1: robot.state_port: found 54601, valid: any port other than command_port's",
        ),
        (
            "[robot]\nport = 54600",
            "2: robot.port: unknown key; valid keys here: kind, controller, host, command_port, state_port, programs_sum, signed_stage",
        ),
        (
            &format!("[poses]\nprak = {axes}"),
            "1: poses.park: is missing; state the axis angles at which the arm is clear of the panel: every cycle begins there",
        ),
        (
            &format!("[poses]\npark = {}", axes.replace("a6_deg", "a6_rad")),
            "2: poses.park.a6_rad: unknown key; this angle is in degrees: write a6_deg",
        ),
        (
            "[poses.park]\nx_mm = 3",
            "2: poses.park.x_mm: unknown key; valid keys here: a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg",
        ),
        ("[io.outputs]\ntool = 4097", "2: io.outputs.tool: found 4097, valid: a whole number from 1 to 4096"),
        ("[io.outputs]\ntool = 3\nlight = 3", "2: io.outputs.tool: found 3, which is already the number of light"),
        (
            "[io.feedbacks]\nflow = 1025",
            "2: io.feedbacks.flow: found 1025; $IN[1025] is always true and $IN[1026] is always false; state another input",
        ),
        (&format!("[io.feedbacks]\n{}", inputs.join("\n")), "1: io.feedbacks: found 32 names, the maximum is 31"),
        (
            "[io.feedbacks]\nflow = 1026",
            "2: io.feedbacks.flow: found 1026; $IN[1025] is always true and $IN[1026] is always false; state another input",
        ),
        (
            "[io]\ntool = 3",
            "2: io.tool: unknown key; valid keys here: outputs, feedbacks, mapped_inputs, off_after_s, line_outputs, may_stay_on",
        ),
        (
            "[io]\nfeedbacks = { flow = 4 }\nmapped_inputs = { start = 33, flow = 4 }",
            "3: io.mapped_inputs.flow: found 4, which is the number of a feedback; feedbacks are only read, never set",
        ),
        (
            "[io]\noutputs = { tool = 1, light = 2 }\noff_after_s = { lamp = 5 }",
            "3: io.off_after_s.lamp: is not an output of [io.outputs]; valid: light, tool",
        ),
        (
            "[io]\noutputs = { tool = 1, light = 2 }\noff_after_s = { tool = 5 }",
            "3: io.off_after_s.tool: found 5, valid: 0; tool and water are switched off immediately",
        ),
        (
            "[io]\noutputs = { tool = 1, light = 2 }\noff_after_s = { light = 601 }",
            "3: io.off_after_s.light: found 601, valid: a whole number from 0 to 600",
        ),
        (
            "[io]\noutputs = { tool = 1, fan = 2 }\nmay_stay_on = [\"fan\", \"tool\"]",
            "3: io.may_stay_on: found \"tool\"; tool and water are always switched off without delay; remove this name",
        ),
        (
            "[io]\noutputs = { tool = 1, light = 2 }\nmay_stay_on = [\"light\"]",
            "3: io.may_stay_on: found \"light\"; this output is switched off 60 s after the end of an epoch ([io.off_after_s], or its default time); remove it from may_stay_on",
        ),
        (
            "[io]\noutputs = { tool = 1 }\nmay_stay_on = [\"pump\"]",
            "3: io.may_stay_on: found \"pump\"; this name is not an output of [io.outputs]; valid: tool",
        ),
        (
            "[io]\noutputs = { lens_shutter = 1 }\noff_after_s = { lens_shutter = 5 }",
            "3: io.off_after_s.lens_shutter: protects the cameras from drops and is never switched off automatically; \
             remove this key",
        ),
        (
            "[limits]\nheartbeat_s = 0.1",
            "2: limits.heartbeat_s: unknown key; this time is in ms: write heartbeat_ms",
        ),
        ("[limits]\nwatchdog_ms = 150", "2: limits.watchdog_ms: found 150, the minimum is 200, twice heartbeat_ms"),
        ("[limits]\nwindow_s = 2", "2: limits.window_s: found 2, valid: a number from 0.1 to 1"),
        (
            "[limits]\nmin_points = 20\nwindow_commands = 10",
            "2: limits.min_points: found 20, the limit is window_commands, 10",
        ),
        ("[limits]\nbox_min_mm = [0, 0, 0]", "1: limits.box_max_mm: is missing; box_min_mm is given"),
        (
            "[limits]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 0, 1]",
            "3: limits.box_max_mm: [1, 0, 1] must exceed box_min_mm [0, 0, 0] in every axis",
        ),
        ("max_step_mm = 5", "1: max_step_mm: unknown key here; did you mean limits.max_step_mm?"),
        ("[calibrations]\nscanner = ''", "1: calibrations: unknown key; did you mean calibration?"),
    ];
    for (text, message) in cases {
        let said = cell_problems(text);
        assert!(said.iter().any(|said| said == message), "{text}: {said:#?}");
    }
    assert_eq!(
        cell_problems("[calibrations]\nscanner = ''")[1],
        "2: calibration.scanner: found the text \"\", valid: a text that is not empty"
    );
}
