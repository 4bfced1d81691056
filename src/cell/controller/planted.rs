//! Test data: deliberate errors. Each is one edit of a file of the release or of the example cell, and must be reported
//! by both `check` and `doctor --kuka`.

use super::names::{COMMANDS, CONFIG, DATA, MOTION, STATES, SUBMIT, USER};

/// The file of the example cell, which has a real controller.
pub const CELL: &str = include_str!("../../../config/cell-example.toml");
/// The controller's files of the release, and KUKA's program of the submit interpreter with the calls of CELL_INIT and
/// CELL_CYCLE.
pub const FILES: [(&str, &str); 10] = [
    (CONFIG, include_str!("../../../config/kuka/cell_config.dat")),
    (DATA, include_str!("../../../config/kuka/cell_data.dat")),
    ("cell_judge.src", include_str!("../../../config/kuka/cell_judge.src")),
    ("cell_link.src", include_str!("../../../config/kuka/cell_link.src")),
    (MOTION, include_str!("../../../config/kuka/cell_motion.src")),
    ("cell_submit.src", include_str!("../../../config/kuka/cell_submit.src")),
    ("cell_tell.src", include_str!("../../../config/kuka/cell_tell.src")),
    (COMMANDS, include_str!("../../../config/kuka/CELLCMD.xml")),
    (USER, include_str!("../../../config/kuka/cell_user.src")),
    (SUBMIT, include_str!("../../../fixtures/krl/sps.sub")),
];
/// The file of the state channel in the release.
pub const STATE_FILE: &str = include_str!("../../../config/kuka/CELLSTAT.xml");

/// Returns all texts by file name; the cell's file has the name "cell".
pub fn texts() -> Vec<(&'static str, String)> {
    let mut all: Vec<_> = FILES.iter().map(|(name, text)| (*name, (*text).to_owned())).collect();
    all.extend([(STATES, STATE_FILE.to_owned()), ("cell", CELL.to_owned())]);
    all
}

/// Returns all texts, with one edit in one file.
pub fn texts_with_edit(file: &str, from: &str, to: &str) -> Vec<(&'static str, String)> {
    let mut all = texts();
    let text = &mut all.iter_mut().find(|(name, _)| *name == file).expect("a file").1;
    assert_eq!(text.matches(from).count(), 1, "{file}: \"{from}\" must occur there exactly once");
    *text = text.replace(from, to);
    all
}

/// Each error: file, original text, replacement, and a part of the expected message.
pub const MISTAKES: &[(&str, &str, &str, &str)] = &[
    // Outputs: numbers, order, count.
    (CONFIG, "CELL_OUT[1]=17", "CELL_OUT[1]=1", "CELL_OUT[1]: is 1, which is not in [io.outputs], but"),
    (CONFIG, "CELL_OUT[5]=21", "CELL_OUT[5]=22", "CELL_OUT[5]: is 22, which is not in [io.outputs], but"),
    (CONFIG, "CELL_OUT[2]=18", "CELL_OUT[2]=21", "CELL_OUT[2]: is 21 (tool)"),
    (CONFIG, "CELL_OUT_N=5", "CELL_OUT_N=6", "CELL_OUT[6]: is missing, but CELL_OUT_N is 6"),
    (CONFIG, "CELL_OUT_N=5", "CELL_OUT_N=4", "CELL_OUT[5]: is 21, but CELL_OUT_N is 4, so this value"),
    (CONFIG, "CELL_OUT_N=5", "CELL_OUT_N=40", "CELL_OUT_N: is 40, valid: a whole number from 0 to 31"),
    (CONFIG, "CELL_OUT[3]=19", "CELL_OUT[3]=0", "CELL_OUT[3]: is 0, valid:"),
    (CONFIG, "CELL_OUT[3]=19", "", "CELL_OUT[3]: is missing"),
    (CONFIG, "CELL_OUT[3]=19", "CELL_OUT[3]=19\nCELL_OUT[3]=20", "CELL_OUT[3]: is set twice"),
    (CONFIG, "CELL_OUT[4]=20", "CELL_OUT[4]=20.5", "CELL_OUT[4]: is 20.5, valid:"),
    ("cell", "light = 17", "light = 22", "CELL_OUT[1]: is 17, which is not in [io.outputs]"),
    ("cell", "tool = 21", "tool = 16", "CELL_OUT[1]: is 17 (light)"),
    (
        "cell",
        "spray = 18\n",
        "spray = 18\nfan = 23\n",
        "CELL_OUT_N: is 5, but the number of entries in [io.outputs] of the cell's file is 6",
    ),
    // Outputs that are switched off at a stop.
    (CONFIG, "CELL_OFF[4]=21", "CELL_OFF[4]=22", "NO STOP SWITCHES TOOL OFF"),
    (CONFIG, "CELL_OFF[2]=18", "CELL_OFF[2]=19", "NO STOP SWITCHES SPRAY OFF"),
    (CONFIG, "CELL_OFF_N=4", "CELL_OFF_N=3", "NO STOP SWITCHES TOOL OFF"),
    (CONFIG, "CELL_OFF_N=4", "CELL_OFF_N=0", "NO STOP SWITCHES TOOL OFF"),
    (CONFIG, "CELL_OFF_MS[4]=0", "CELL_OFF_MS[4]=1000", "is switched off after 1000 ms"),
    (CONFIG, "CELL_OFF_MS[2]=0", "CELL_OFF_MS[2]=30000", "TOOL AND WATER MUST BE SWITCHED OFF IMMEDIATELY"),
    (CONFIG, "CELL_OFF_MS[1]=60000", "CELL_OFF_MS[1]=6000", "(light) is switched off after 6000 ms"),
    (CONFIG, "CELL_OFF_MS[3]=30000", "", "(extraction) has no CELL_OFF_MS"),
    (CONFIG, "CELL_OFF_MS[4]=0", "", "(tool) has no CELL_OFF_MS"),
    (CONFIG, "CELL_OFF[1]=17", "CELL_OFF[1]=19", "(lens_shutter) would be switched off at the end of an epoch"),
    (CONFIG, "CELL_OFF[1]=17", "CELL_OFF[1]=33", "$OUT[33] is neither in CELL_OUT nor in [io.outputs]"),
    (CONFIG, "CELL_OFF[3]=20", "CELL_OFF[3]=21", "(tool) is listed twice"),
    (CONFIG, "CELL_OFF_N=4", "CELL_OFF_N=5", "CELL_OFF[5]: is missing"),
    (
        "cell",
        "light = 60",
        "light = 61",
        "(light) is switched off after 60000 ms, but [io.off_after_s] of the cell's file states 61000",
    ),
    ("cell", "extraction = 30", "extraction = 31", "(extraction) is switched off after 30000 ms"),
    ("cell", "spray = 18\n", "spray = 18\nrinse = 23\n", "NO STOP SWITCHES RINSE OFF"),
    // Inputs: numbers, order, count.
    (
        CONFIG,
        "CELL_IN[1]=17",
        "CELL_IN[1]=18",
        "CELL_IN[1]: is 18 (lens_shut), but [io.feedbacks] of the cell's file has 17 (water_off)",
    ),
    (CONFIG, "CELL_IN[4]=20", "CELL_IN[4]=30", "CELL_IN[4]: is 30, which is not in [io.feedbacks], but"),
    (
        CONFIG,
        "CELL_IN_N=5",
        "CELL_IN_N=4",
        "CELL_IN_N: is 4, but the number of entries in [io.feedbacks] of the cell's file is 5",
    ),
    (CONFIG, "CELL_IN_N=5", "CELL_IN_N=6", "CELL_IN[6]: is missing"),
    (CONFIG, "CELL_IN[5]=21", "CELL_IN[5]=5000", "CELL_IN[5]: is 5000, valid:"),
    ("cell", "tool_running = 20", "tool_running = 22", "CELL_IN[4]: is 20, which is not in [io.feedbacks], but"),
    // Outputs to the production line.
    (
        CONFIG,
        "CELL_LINE[3]=0",
        "CELL_LINE[3]=42",
        "CELL_LINE[3]: is 42, but [io.line_outputs] of the cell's file has 0 for pass",
    ),
    (CONFIG, "CELL_LINE[1]=0", "CELL_LINE[1]=21", "CELL_LINE[1]: $OUT[21] is also in CELL_OUT"),
    (CONFIG, "CELL_LINE_N=6", "CELL_LINE_N=5", "CELL_LINE_N: is 5, valid:"),
    (CONFIG, "CELL_LINE[6]=0", "", "CELL_LINE[6]: is not stated"),
    // Inputs that are mapped to flags.
    (CONFIG, "CELL_VIN_N=0", "CELL_VIN_N=1", "CELL_VIN[1]: is 0, valid:"),
    (CONFIG, "CELL_VIN[1]=0", "CELL_VIN[1]=33", "CELL_VIN[1]: is 33, but CELL_VIN_N is 0, so this value"),
    (CONFIG, "CELL_VIN_N=0", "CELL_VIN_N=9", "CELL_VIN_N: is 9, valid:"),
    ("cell", "# [io.mapped_inputs] ", "[io.mapped_inputs]\nguard = 33\n# ", "CELL_VIN: does not contain input 33"),
    // Numbers of flags and timers.
    (CONFIG, "CELL_F_CMD_CAME=851", "CELL_F_CMD_CAME=861", "RECEIVE ELEMENT: sets $FLAG[851], but CELL_F_CMD_CAME"),
    (CONFIG, "CELL_F_CMD_ALIVE=850", "CELL_F_CMD_ALIVE=860", "ALIVE: sets $FLAG[850], but CELL_F_CMD_ALIVE"),
    (CONFIG, "CELL_F_STAT_ALIVE=853", "CELL_F_STAT_ALIVE=860", "ALIVE: sets $FLAG[853], but CELL_F_STAT_ALIVE"),
    (
        CONFIG,
        "CELL_F_STAT_CAME=854",
        "CELL_F_STAT_CAME=860",
        "RECEIVE ELEMENT: sets $FLAG[854], but CELL_F_STAT_CAME",
    ),
    (CONFIG, "CELL_F_STOP=852", "CELL_F_STOP=862", "INTERRUPT DECL 21: monitors $FLAG[852], but"),
    (CONFIG, "CELL_F_HALT=855", "CELL_F_HALT=865", "INTERRUPT DECL 20: monitors $FLAG[855], but"),
    (CONFIG, "CELL_F_HALT=855", "CELL_F_HALT=852", "CELL_F_HALT: is 852, which is already used by CELL_F_STOP"),
    (CONFIG, "CELL_F_HALT=855", "CELL_F_HALT=1025", "CELL_F_HALT: is 1025, valid:"),
    (
        CONFIG,
        "CELL_T_SUBMIT=21",
        "CELL_T_SUBMIT=31",
        "CELL_T_SUBMIT: is 31, but the previous timer, CELL_T_HEARD, is 20",
    ),
    (CONFIG, "CELL_T_STILL=26", "CELL_T_STILL=65", "CELL_T_STILL: is 65, valid:"),
    (CONFIG, "CELL_T_OFF=25", "CELL_T_OFF=24", "CELL_T_OFF: is 24, but the previous timer, CELL_T_SILENT, is 24"),
    (
        MOTION,
        "INTERRUPT DECL 21 WHEN $FLAG[852]",
        "INTERRUPT DECL 21 WHEN $FLAG[842]",
        "INTERRUPT DECL 21: monitors $FLAG[842], but",
    ),
    (
        MOTION,
        "INTERRUPT DECL 22 WHEN $TIMER_FLAG[21]",
        "INTERRUPT DECL 22 WHEN $TIMER_FLAG[31]",
        "INTERRUPT DECL 22: monitors $TIMER_FLAG[31], but",
    ),
    (MOTION, "  INTERRUPT DECL 20 WHEN", "; INTERRUPT DECL 20 WHEN", "INTERRUPT DECL 20: is missing"),
    // The files of the EthernetKRL channels.
    (COMMANDS, "Set_Flag=\"851\"", "Set_Flag=\"861\"", "RECEIVE ELEMENT: sets $FLAG[861]"),
    (STATES, "<ALIVE Set_Flag=\"853\"/>", "", "ALIVE: sets no flag"),
    (
        COMMANDS,
        "<IP>172.31.1.147</IP>",
        "<IP>172.31.1.148</IP>",
        "IP: is 172.31.1.148, and [robot] host of the cell's file is 172.31.1.147",
    ),
    (STATES, "<IP>172.31.1.147</IP>", "<IP>192.168.1.147</IP>", "IP: is 192.168.1.147"),
    (COMMANDS, "<PORT>54600</PORT>", "<PORT>54601</PORT>", "command_port and state_port are exchanged"),
    (
        STATES,
        "<PORT>54601</PORT>",
        "<PORT>54605</PORT>",
        "PORT: is 54605, but [robot] of the cell's file has 54601",
    ),
    (
        "cell",
        "host = \"172.31.1.147\"",
        "host = \"172.31.1.140\"",
        "[robot] host of the cell's file is 172.31.1.140",
    ),
    (
        COMMANDS,
        "Tag=\"Cmd/@N1\" Type=\"INT\"",
        "Tag=\"Cmd/@N1\" Type=\"REAL\"",
        "RECEIVE ELEMENT: position 4 is Cmd/@N1 (REAL), but",
    ),
    (STATES, "      <ELEMENT Tag=\"St/@Ov\" Type=\"INT\"/>\n", "", "SEND ELEMENT: position 13 is St/J/@A1 (REAL)"),
    (COMMANDS, "<ENVIRONMENT>Submit</ENVIRONMENT>", "<ENVIRONMENT>Program</ENVIRONMENT>", "ENVIRONMENT: "),
    (COMMANDS, "Limit=\"512\"", "Limit=\"16\"", "CONFIGURATION/INTERNAL/BUFFERING: found 16 entries in"),
    // Axes, workspace and speeds.
    (
        CONFIG,
        "CELL_AXIS_MAX[3]=156.0",
        "CELL_AXIS_MAX[3]=165.0",
        "CELL_AXIS_MAX[3]: is 165°, but [arm] of the cell's file has 156°",
    ),
    (CONFIG, "CELL_AXIS_MIN[5]=-120.0", "CELL_AXIS_MIN[5]=120.0", "CELL_AXIS_MIN[5]: is 120°"),
    (CONFIG, "CELL_VEL_MAX=0.25", "CELL_VEL_MAX=2.0", "CELL_VEL_MAX: is 2 m/s, the limit is 1.25 times"),
    (CONFIG, "CELL_VEL_MAX=0.25", "CELL_VEL_MAX=0.1", "CELL_VEL_MAX: is 0.1 m/s"),
    (CONFIG, "CELL_BOX_MAX[1]=760.0", "CELL_BOX_MAX[1]=1760.0", "CELL_BOX_MAX[1]: is 1760 mm"),
    (CONFIG, "CELL_STEP_MM=110.0", "CELL_STEP_MM=1000.0", "CELL_STEP_MM: is 1000 mm"),
    // Values with which the PC plans motions, and values that it sends.
    (CONFIG, "CELL_RETRACT_MM=50.0", "CELL_RETRACT_MM=200.0", "CELL_RETRACT_MM: is 200, the limits are 50 to 50"),
    (CONFIG, "CELL_RETRACT_MM=50.0", "CELL_RETRACT_MM=10.0", "CELL_RETRACT_MM: is 10, the limits are 50 to 50"),
    (
        CONFIG,
        "CELL_RETRACT_VEL=0.2",
        "CELL_RETRACT_VEL=0.01",
        "CELL_RETRACT_VEL: is 0.01, the limits are 0.2 to 0.2",
    ),
    (
        CONFIG,
        "CELL_RETRACT_VEL=0.2",
        "CELL_RETRACT_VEL=0.25",
        "CELL_RETRACT_VEL: is 0.25, the limits are 0.2 to 0.2",
    ),
    (CONFIG, "CELL_RETRACT_ACC=2.0", "CELL_RETRACT_ACC=0.1", "CELL_RETRACT_ACC: is 0.1, the limits are 2 to 10"),
    (CONFIG, "CELL_RETRACT_ACC=2.0", "CELL_RETRACT_ACC=1.9", "CELL_RETRACT_ACC: is 1.9, the limits are 2 to 10"),
    (CONFIG, "CELL_ACC_MAX=10.0", "CELL_ACC_MAX=0.1", "CELL_ACC_MAX: is 0.1, the limits are 1 to 10"),
    // The cell's own subroutines.
    (
        CONFIG,
        "CELL_USER_N=1",
        "CELL_USER_N=5",
        "CELL_USER_CALL: has no CASE 1, 2, 3, 4, and CELL_USER_N of cell_config.dat",
    ),
    (CONFIG, "CELL_USER_N=1", "CELL_USER_N=0", "CASE 0: is never called: CELL_USER_N"),
    (USER, "GLOBAL DEF CELL_USER_CALL(N:IN)", "GLOBAL DEF CELL_USER_DO(N:IN)", "CELL_USER_CALL: is missing"),
    (USER, "GLOBAL DEF CELL_USER_CALL(N:IN)", "DEF CELL_USER_CALL(N:IN)", "CELL_USER_CALL: is not GLOBAL"),
    (USER, "    CASE 0\n", "    CASE 1\n", "CELL_USER_CALL: has no CASE 0"),
    (USER, "  SWITCH N\n", "  SWITCH CELL_USER_N\n", "SWITCH: does not branch by the first parameter"),
    (USER, "      CELL_USER_0( )\n", "", "CASE 0: does nothing"),
    (
        USER,
        "WAIT SEC 0.1",
        "WAIT SEC 0.2",
        "CELL_USER_REVISION: is 154822, and the text of cell_user.src has the sum ",
    ),
    (CONFIG, "CELL_USER_REVISION=154822", "CELL_USER_REVISION=1", "CELL_USER_REVISION: is 1, and the text"),
    // Declarations of the data list.
    (
        CONFIG,
        "CONST INT CELL_OUT_N=5",
        "CONST REAL CELL_OUT_N=5",
        "CELL_OUT_N: is declared as `DECL GLOBAL CONST REAL CELL_OUT_N`, and must be `DECL GLOBAL CONST INT CELL_OUT_N`",
    ),
    (CONFIG, "CONST INT CELL_F_STOP=852", "CONST REAL CELL_F_STOP=852", "CELL_F_STOP: is declared as"),
    (CONFIG, "GLOBAL REAL CELL_AXIS_MIN[6]", "GLOBAL INT CELL_AXIS_MIN[6]", "CELL_AXIS_MIN: is declared as"),
    (
        CONFIG,
        "GLOBAL INT CELL_OUT[31]",
        "GLOBAL INT CELL_OUT[8]",
        "CELL_OUT: is declared as `DECL GLOBAL INT CELL_OUT[8]`",
    ),
    (CONFIG, "DECL GLOBAL INT CELL_OFF_MS[31]\n", "", "CELL_OFF_MS: has a value but no declaration"),
    (
        CONFIG,
        "DECL GLOBAL INT CELL_OFF[31]",
        "DECL INT CELL_OFF[31]",
        "CELL_OFF: is declared as `DECL INT CELL_OFF[31]`",
    ),
    (CONFIG, "DEFDAT CELL_CONFIG PUBLIC", "DEFDAT CELL_CONFIG", "DEFDAT: is not PUBLIC"),
    (CONFIG, "DECL GLOBAL CONST INT CELL_T_OFF=25\n", "", "CELL_T_OFF: is not declared, and the programs need it"),
    // Addresses of the controller.
    (COMMANDS, "<IP>172.31.1.147</IP>", "", "INTERNAL/IP: is missing"),
    (STATES, "<IP>172.31.1.147</IP>", "<IP>krc</IP>", "INTERNAL/IP: is \"krc\", which is not an address"),
    (
        "cell",
        "host = \"172.31.1.147\"",
        "host = \"localhost\"",
        "[robot] host of the cell's file is localhost (127.0.0.1",
    ),
    // Additional outputs of the cell that are not switched off at a stop.
    ("cell", "spray = 18\n", "spray = 18\npump = 22\n", "NO STOP SWITCHES PUMP OFF"),
    ("cell", "spray = 18\n", "spray = 18\ntool_2 = 22\n", "NO STOP SWITCHES TOOL_2 OFF"),
    // The program of the submit interpreter.
    (SUBMIT, "  CELL_INIT( )\n", "", "CELL_INIT: is not called"),
    (SUBMIT, "    CELL_CYCLE( )\n", "    ; CELL_CYCLE( )\n", "CELL_CYCLE: is not called"),
    (
        SUBMIT,
        "  CELL_INIT( )\n  ;ENDFOLD (USER INIT)\n  LOOP\n",
        "  LOOP\n  CELL_INIT( )\n",
        "CELL_INIT: is called in the loop",
    ),
    (SUBMIT, "  LOOP\n", "  CELL_CYCLE( )\n  LOOP\n", "CELL_CYCLE: is called outside of the loop"),
    (SUBMIT, "  LOOP\n", "  CELL_INIT( )\n  LOOP\n", "CELL_INIT: is called a second time"),
    (SUBMIT, "    CELL_CYCLE( )\n", "    CELL_CYCLE( )\n    CELL_INIT( )\n", "CELL_INIT: is called a second time"),
    (
        SUBMIT,
        "    CELL_CYCLE( )\n",
        "    CELL_CYCLE( )\n    CELL_CYCLE( )\n",
        "CELL_CYCLE: is called a second time",
    ),
    (SUBMIT, "  $OUT[40]=FALSE\n", "  CELL_INIT( )\n", "CELL_INIT: is called outside of the main routine"),
    // A variable is assigned a number first and then an expression.
    (CONFIG, "CELL_OUT[3]=19", "CELL_OUT[3]=19\nCELL_OUT[3]=CELL_OUT_N", "CELL_OUT[3]: is not a plain number"),
    (
        CONFIG,
        "CELL_BOX_MAX[1]=760.0",
        "CELL_BOX_MAX[1]=760.0\nCELL_BOX_MAX[1]=CELL_STEP_MM",
        "CELL_BOX_MAX[1]: is not a plain",
    ),
];

/// Returns the errors that are not reported. `said` returns all messages about texts with one edit; an error is
/// reported if one of these messages contains the expected words.
pub fn unreported_mistakes(said: impl Fn(&[(&'static str, String)]) -> Vec<String>) -> Vec<String> {
    let mut missed = Vec::new();
    for (file, from, to, words) in MISTAKES {
        let said = said(&texts_with_edit(file, from, to));
        if !said.iter().any(|said| said.contains(words)) {
            missed.push(format!("{file}: {from} → {to}\n  wanted: {words}\n  said: {said:#?}"));
        }
    }
    missed
}
