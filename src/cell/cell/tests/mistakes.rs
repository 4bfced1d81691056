//! The messages for a cell's file that is wrong: each mistake with its line, its key and what is allowed.

use super::cell_problems;

/// One mistake does not hide the next.
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
            "4: robot.signed_stage: needs programs_sum, the checksum of the programs that were proven; run `panelprep doctor \
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
            "1: poses.park: is missing; every cycle begins by parking the arm clear of the panel",
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
            "2: io.feedbacks.flow: found 1025; $IN[1025] is always true and $IN[1026] always false",
        ),
        (&format!("[io.feedbacks]\n{}", inputs.join("\n")), "1: io.feedbacks: found 32 names (limit 31)"),
        (
            "[io.feedbacks]\nflow = 1026",
            "2: io.feedbacks.flow: found 1026; $IN[1025] is always true and $IN[1026] always false",
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
            "3: io.may_stay_on: found \"tool\"; tool and water go off at once; remove it",
        ),
        (
            "[io]\noutputs = { tool = 1, light = 2 }\nmay_stay_on = [\"light\"]",
            "3: io.may_stay_on: found \"light\"; it goes off 60 s after the end of an epoch ([io.off_after_s], or its usual time); remove one",
        ),
        (
            "[io]\noutputs = { tool = 1 }\nmay_stay_on = [\"pump\"]",
            "3: io.may_stay_on: found \"pump\"; it is no output of [io.outputs]; valid: tool",
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
