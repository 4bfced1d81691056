//! Planted mistakes: each is one edit of a shipped file or of the example cell, and must be named; the unchanged
//! files give no message.

use super::sum::mixed_names;
use super::*;
use crate::cell::Cell;

const CELL: &str = include_str!("../../config/cell-example.toml");
const FILES: [(&str, &str); 8] = [
    (CONFIG, include_str!("../../config/kuka/cell_config.dat")),
    (DATA, include_str!("../../config/kuka/cell_data.dat")),
    ("cell_judge.src", include_str!("../../config/kuka/cell_judge.src")),
    ("cell_link.src", include_str!("../../config/kuka/cell_link.src")),
    (MOTION, include_str!("../../config/kuka/cell_motion.src")),
    ("cell_submit.src", include_str!("../../config/kuka/cell_submit.src")),
    ("cell_tell.src", include_str!("../../config/kuka/cell_tell.src")),
    (COMMANDS, include_str!("../../config/kuka/CELLCMD.xml")),
];
const STATE_FILE: &str = include_str!("../../config/kuka/CELLSTAT.xml");

/// Returns all texts, by name; the cell's file is "cell".
fn texts() -> Vec<(&'static str, String)> {
    let mut all: Vec<_> = FILES.iter().map(|(name, text)| (*name, (*text).to_owned())).collect();
    all.extend([(STATES, STATE_FILE.to_owned()), ("cell", CELL.to_owned())]);
    all
}

fn found(texts: &[(&'static str, String)]) -> Vec<Difference> {
    let text = |name: &str| texts.iter().find(|(of, _)| *of == name).map(|(_, text)| text.as_str());
    let cell = Cell::check("cell.toml", text("cell").expect("the cell")).expect("a right cell");
    let files = ControllerFiles {
        config: text(CONFIG),
        motion: text(MOTION),
        commands: text(COMMANDS),
        states: text(STATES),
    };
    differences(&files, &cell)
}

/// Returns all texts with one edit of one file.
fn edited(file: &str, from: &str, to: &str) -> Vec<(&'static str, String)> {
    let mut all = texts();
    let text = &mut all.iter_mut().find(|(name, _)| *name == file).expect("a file").1;
    assert_eq!(text.matches(from).count(), 1, "{file}: \"{from}\" must stand there once");
    *text = text.replace(from, to);
    all
}

#[test]
fn untouched_files_give_no_difference() {
    assert_eq!(found(&texts()), []);
}

/// File, the shipped text, the text that replaces it, and the expected part of the message.
const MISTAKES: [(&str, &str, &str, &str); 74] = [
    // Outputs: numbers, order, counts.
    (CONFIG, "CELL_OUT[1]=17", "CELL_OUT[1]=1", "CELL_OUT[1]: is 1, which [io.outputs] lacks"),
    (CONFIG, "CELL_OUT[5]=21", "CELL_OUT[5]=22", "CELL_OUT[5]: is 22, which [io.outputs] lacks"),
    (CONFIG, "CELL_OUT[2]=18", "CELL_OUT[2]=21", "CELL_OUT[2]: is 21 (tool)"),
    (CONFIG, "CELL_OUT_N=5", "CELL_OUT_N=6", "CELL_OUT[6]: is missing, but CELL_OUT_N is 6"),
    (CONFIG, "CELL_OUT_N=5", "CELL_OUT_N=4", "CELL_OUT[5]: is 21, and CELL_OUT_N counts 4"),
    (CONFIG, "CELL_OUT_N=5", "CELL_OUT_N=40", "CELL_OUT_N: is 40, valid: a whole number from 0 to 31"),
    (CONFIG, "CELL_OUT[3]=19", "CELL_OUT[3]=0", "CELL_OUT[3]: is 0, valid:"),
    (CONFIG, "CELL_OUT[3]=19", "", "CELL_OUT[3]: is missing"),
    (CONFIG, "CELL_OUT[3]=19", "CELL_OUT[3]=19\nCELL_OUT[3]=20", "CELL_OUT[3]: is set twice"),
    (CONFIG, "CELL_OUT[4]=20", "CELL_OUT[4]=20.5", "CELL_OUT[4]: is 20.5, valid:"),
    ("cell", "light = 17", "light = 22", "CELL_OUT[1]: is 17, which [io.outputs] lacks"),
    ("cell", "tool = 21", "tool = 16", "CELL_OUT[1]: is 17 (light)"),
    (
        "cell",
        "spray = 18\n",
        "spray = 18\nfan = 23\n",
        "CELL_OUT_N: is 5, but the number of entries in [io.outputs] of the cell's file is 6",
    ),
    // Outputs that a stop switches off.
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
    // Inputs.
    (
        CONFIG,
        "CELL_IN[1]=17",
        "CELL_IN[1]=18",
        "CELL_IN[1]: is 18 (lens_shut), but [io.feedbacks] of the cell's file has 17 (water_off)",
    ),
    (CONFIG, "CELL_IN[4]=20", "CELL_IN[4]=30", "CELL_IN[4]: is 30, which [io.feedbacks] lacks"),
    (
        CONFIG,
        "CELL_IN_N=5",
        "CELL_IN_N=4",
        "CELL_IN_N: is 4, but the number of entries in [io.feedbacks] of the cell's file is 5",
    ),
    (CONFIG, "CELL_IN_N=5", "CELL_IN_N=6", "CELL_IN[6]: is missing"),
    (CONFIG, "CELL_IN[5]=21", "CELL_IN[5]=5000", "CELL_IN[5]: is 5000, valid:"),
    ("cell", "tool_running = 20", "tool_running = 22", "CELL_IN[4]: is 20, which [io.feedbacks] lacks"),
    // The line.
    (
        CONFIG,
        "CELL_LINE[3]=0",
        "CELL_LINE[3]=42",
        "CELL_LINE[3]: is 42, but [io.line_outputs] of the cell's file has 0 for pass",
    ),
    (CONFIG, "CELL_LINE[1]=0", "CELL_LINE[1]=21", "CELL_LINE[1]: $OUT[21] is also in CELL_OUT"),
    (CONFIG, "CELL_LINE_N=6", "CELL_LINE_N=5", "CELL_LINE_N: is 5, valid:"),
    (CONFIG, "CELL_LINE[6]=0", "", "CELL_LINE[6]: is missing"),
    // Mapped inputs.
    (CONFIG, "CELL_VIN_N=0", "CELL_VIN_N=1", "CELL_VIN[1]: is 0, valid:"),
    (CONFIG, "CELL_VIN[1]=0", "CELL_VIN[1]=33", "CELL_VIN[1]: is 33, and CELL_VIN_N counts 0"),
    (CONFIG, "CELL_VIN_N=0", "CELL_VIN_N=9", "CELL_VIN_N: is 9, valid:"),
    ("cell", "# [io.mapped_inputs] ", "[io.mapped_inputs]\nguard = 33\n# ", "CELL_VIN: lacks input 33"),
    // Flags and timers.
    (CONFIG, "CELL_F_CMD_CAME=851", "CELL_F_CMD_CAME=861", "RECEIVE ELEMENT: sets $FLAG[851], but CELL_F_CMD_CAME"),
    (CONFIG, "CELL_F_CMD_ALIVE=850", "CELL_F_CMD_ALIVE=860", "ALIVE: sets $FLAG[850], but CELL_F_CMD_ALIVE"),
    (CONFIG, "CELL_F_STAT_ALIVE=853", "CELL_F_STAT_ALIVE=860", "ALIVE: sets $FLAG[853], but CELL_F_STAT_ALIVE"),
    (
        CONFIG,
        "CELL_F_STAT_CAME=854",
        "CELL_F_STAT_CAME=860",
        "RECEIVE ELEMENT: sets $FLAG[854], but CELL_F_STAT_CAME",
    ),
    (CONFIG, "CELL_F_STOP=852", "CELL_F_STOP=862", "INTERRUPT DECL 21: watches $FLAG[852]"),
    (CONFIG, "CELL_F_HALT=855", "CELL_F_HALT=865", "INTERRUPT DECL 20: watches $FLAG[855]"),
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
        "INTERRUPT DECL 21: watches $FLAG[842]",
    ),
    (
        MOTION,
        "INTERRUPT DECL 22 WHEN $TIMER_FLAG[21]",
        "INTERRUPT DECL 22 WHEN $TIMER_FLAG[31]",
        "INTERRUPT DECL 22: watches $TIMER_FLAG[31]",
    ),
    (MOTION, "  INTERRUPT DECL 20 WHEN", "; INTERRUPT DECL 20 WHEN", "INTERRUPT DECL 20: is missing"),
    // The channels.
    (COMMANDS, "Set_Flag=\"851\"", "Set_Flag=\"861\"", "RECEIVE ELEMENT: sets $FLAG[861]"),
    (STATES, "<ALIVE Set_Flag=\"853\"/>", "", "ALIVE: sets no flag"),
    (
        COMMANDS,
        "<IP>172.31.1.147</IP>",
        "<IP>172.31.1.148</IP>",
        "IP: is 172.31.1.148, but [robot] host of the cell's file is 172.31.1.147",
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
        "RECEIVE ELEMENT: place 4 is Cmd/@N1 (REAL)",
    ),
    (STATES, "      <ELEMENT Tag=\"St/@Ov\" Type=\"INT\"/>\n", "", "SEND ELEMENT: place 13 is St/J/@A1 (REAL)"),
    (COMMANDS, "<ENVIRONMENT>Submit</ENVIRONMENT>", "<ENVIRONMENT>Program</ENVIRONMENT>", "ENVIRONMENT: "),
    (COMMANDS, "Limit=\"512\"", "Limit=\"16\"", "BUFFERING: 16 entries"),
    // Axes, space and speeds.
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
];

#[test]
fn each_planted_mistake_is_named() {
    let mut missed = Vec::new();
    for (file, from, to, words) in MISTAKES {
        let found = found(&edited(file, from, to));
        let said: Vec<String> = found
            .iter()
            .map(|it| format!("{}:{}: {}: {}", it.file, it.problem.line, it.problem.key, it.problem.message))
            .collect();
        if !said.iter().any(|said| said.contains(words)) {
            missed.push(format!("{file}: {from} → {to}\n  wanted: {words}\n  said: {said:#?}"));
        }
    }
    assert!(missed.is_empty(), "{} of {}:\n{}", missed.len(), MISTAKES.len(), missed.join("\n"));
}

/// The difference names the line of the edit.
#[test]
fn a_difference_names_its_line() {
    let all = found(&edited(CONFIG, "CELL_OFF_MS[4]=0", "CELL_OFF_MS[4]=1000"));
    let [one] = &all[..] else { panic!("{all:?}") };
    let line = FILES[0].1.lines().position(|line| line == "CELL_OFF_MS[4]=0").expect("there") + 1;
    assert_eq!((one.file, one.problem.line, one.problem.key.as_str()), (CONFIG, line, "CELL_OFF_MS"));
}

/// A flag that was changed in the XML file and in the data list, as the installation page allows, is right.
#[test]
fn a_flag_that_was_changed_in_both_places_is_right() {
    let mut all = edited(CONFIG, "CELL_F_CMD_ALIVE=850", "CELL_F_CMD_ALIVE=860");
    let commands = &mut all.iter_mut().find(|(name, _)| *name == COMMANDS).expect("it").1;
    *commands = commands.replace("Set_Flag=\"850\"", "Set_Flag=\"860\"");
    assert_eq!(found(&all), []);
}

fn named(all: &[(&'static str, String)]) -> Vec<(&'static str, String)> {
    all.iter().filter(|(name, _)| *name != "cell").cloned().collect()
}

fn sum(all: &[(&'static str, String)]) -> Result<i32, SumError> {
    let files: Vec<(&str, &str)> = all.iter().map(|(name, text)| (*name, text.as_str())).collect();
    program_sum(&files)
}

#[test]
fn the_sum_follows_each_value_and_refuses_an_edited_program() {
    let untouched = sum(&named(&texts())).expect("the shipped files");
    for (from, to) in [("CELL_OUT[1]=17", "CELL_OUT[1]=16"), ("CELL_VEL_MAX=0.25", "CELL_VEL_MAX=0.3")] {
        let other = sum(&named(&edited(CONFIG, from, to))).expect("a sum");
        assert_ne!(other, untouched, "{from} → {to}");
    }
    // KSS writes its own line ends, and increments the revision.
    let ends: Vec<_> = named(&texts())
        .into_iter()
        .map(|(name, text)| (name, text.replace('\n', "\r\n").replace("&REL 1\r", "&REL 12\r")))
        .collect();
    assert_eq!(sum(&ends), Ok(untouched));
    let edit = edited("cell_judge.src", "IF CMD.ID<>CELL_RX+1 THEN", "IF FALSE THEN");
    assert!(matches!(sum(&named(&edit)), Err(SumError::Edited { .. })));
    let lacks: Vec<_> = named(&texts()).into_iter().filter(|(name, _)| *name != "cell_link.src").collect();
    assert_eq!(sum(&lacks), Err(SumError::Missing("cell_link.src")));
}

/// Every value of the data list is part of the sum.
#[test]
fn nothing_of_the_data_list_is_left_out_of_the_sum() {
    let stated = crate::krl::parse(CONFIG, FILES[0].1).stated_values();
    let mixed = mixed_names();
    for value in stated {
        assert!(mixed.contains(value.name.as_str()), "{} is not mixed in", value.name);
    }
}
