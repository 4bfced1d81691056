//! The controller's programs as text: their form, and that they agree with the EthernetKRL files, the client, the
//! mock controller and the installation page. Nothing here replaces a controller: it keeps slips from getting there.

mod krl;

use krl::{File, Routine, Statement, data, files, folder};
use panelprep::cell::Cell;
use panelprep::devices::mock::Refusal;
use panelprep::eki::{CELLCMD, CELLSTAT, ChannelFile, Element, Kind, LinkLimits};
use std::collections::{BTreeMap, BTreeSet};

const KEYWORDS: [&str; 52] = [
    "AND",
    "BRAKE",
    "CASE",
    "CHAR",
    "CONST",
    "C_DIS",
    "DECL",
    "DEF",
    "DEFAULT",
    "DEFFCT",
    "DELAY",
    "DISTANCE",
    "DO",
    "ELSE",
    "END",
    "ENDFCT",
    "ENDFOR",
    "ENDIF",
    "ENDLOOP",
    "ENDSWITCH",
    "ENDWHILE",
    "EXOR",
    "F",
    "FALSE",
    "FOR",
    "GLOBAL",
    "IF",
    "IN",
    "INTERRUPT",
    "LIN",
    "LOOP",
    "NOT",
    "OFF",
    "ON",
    "OR",
    "OUT",
    "PRIO",
    "PTP",
    "RESUME",
    "RETURN",
    "SEC",
    "SIGNAL",
    "STRUC",
    "SWITCH",
    "THEN",
    "TO",
    "TRIGGER",
    "TRUE",
    "WAIT",
    "WHEN",
    "WHILE",
    "ENDDAT",
];
const TYPES: [&str; 11] =
    ["INT", "REAL", "BOOL", "FRAME", "AXIS", "E6AXIS", "E6POS", "EKI_STATUS", "STATE_T", "MODUS_T", "CELL_CMD_T"];
/// What KUKA's own software brings.
const FOREIGN: [&str; 3] = ["BAS", "IR_STOPM", "CWRITE"];
/// The functions of `eki.md` 3 that the programs use.
const EKI: [&str; 11] = [
    "EKI_INIT",
    "EKI_OPEN",
    "EKI_CLEAR",
    "EKI_CHECKBUFFER",
    "EKI_GETINT",
    "EKI_GETREAL",
    "EKI_GETFRAME",
    "EKI_SETINT",
    "EKI_SETREAL",
    "EKI_SEND",
    "EKI_CLOSE",
];
/// Every system variable that the programs touch; the installation page asks to prove those that matter.
const SYSTEM: [&str; 35] = [
    "$ACC",
    "$ACC_AXIS",
    "$ADVANCE",
    "$ALARM_STOP",
    "$ALARM_STOP_INTERN",
    "$APO",
    "$AXIS_ACT_MEAS",
    "$BASE",
    "$CMD",
    "$COULD_START_MOTION",
    "$DATE",
    "$FLAG",
    "$IN",
    "$IPO_MODE",
    "$MODE_OP",
    "$NULLFRAME",
    "$ORI_TYPE",
    "$OUT",
    "$PERI_RDY",
    "$POS_ACT",
    "$PRO_ACT",
    "$PRO_MOVE",
    "$PRO_STATE1",
    "$ROB_TIMER",
    "$STOPMESS",
    "$TIMER",
    "$TIMER_FLAG",
    "$TIMER_STOP",
    "$TOOL",
    "$USER_SAF",
    "$VEL",
    "$VEL_AXIS",
    "$CYCFLAG",
    "$ANIN",
    "$ANOUT",
];

fn routines(files: &[File]) -> BTreeMap<String, &Routine> {
    let mut all = BTreeMap::new();
    for routine in files.iter().flat_map(|file| &file.routines) {
        assert!(all.insert(routine.name.clone(), routine).is_none(), "{} is defined twice", routine.name);
    }
    all
}

fn locals(routine: &Routine) -> BTreeSet<String> {
    let declared = routine.body.iter().filter(|statement| statement.first_word() == "DECL");
    let names = declared.map(|statement| statement.words().last().expect("a name").clone());
    names.chain(routine.parameters.clone()).collect()
}

fn each(files: &[File], mut visit: impl FnMut(&Routine, &Statement)) {
    for routine in files.iter().flat_map(|file| &file.routines) {
        routine.body.iter().for_each(|statement| visit(routine, statement));
    }
}

fn page() -> String {
    std::fs::read_to_string(folder().join("README.md")).expect("the page")
}

#[test]
fn the_text_is_what_a_controller_reads() {
    let files = files();
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "cell_config.dat",
            "cell_data.dat",
            "cell_judge.src",
            "cell_link.src",
            "cell_motion.src",
            "cell_submit.src",
            "cell_tell.src",
            "cell_user.src"
        ]
    );
    for file in &files {
        let name = &file.name;
        assert!(file.text.is_ascii() && !file.text.contains(['\t', '\r']), "{name}: plain ASCII, LF, no tabs");
        assert!(file.text.starts_with("&ACCESS RVP\n&REL 1\n&COMMENT "), "{name}: no header");
        assert!(
            file.text.contains("; Idea: ") && file.text.contains("yclic flags"),
            "{name}: its idea, what it uses"
        );
        for (index, line) in file.text.lines().enumerate() {
            assert!(line.len() <= 116 && line.trim_end() == line, "{name}:{}: {line}", index + 1);
        }
        let stem = name.split('.').next().unwrap_or_default().to_uppercase();
        if name.ends_with(".src") {
            assert_eq!(file.routines[0].name, stem, "{name}: the first routine has the file's name");
        } else {
            assert!(file.text.contains(&format!("DEFDAT {stem} PUBLIC\n")) && file.text.ends_with("ENDDAT\n"));
        }
        for statement in file.statements() {
            for word in statement.words() {
                assert!(word.len() <= 24, "{name}:{}: {word} is longer than 24", statement.line);
            }
        }
    }
}

#[test]
fn what_opens_is_closed_in_its_order() {
    let pairs =
        [("IF", "ENDIF"), ("LOOP", "ENDLOOP"), ("WHILE", "ENDWHILE"), ("FOR", "ENDFOR"), ("SWITCH", "ENDSWITCH")];
    for routine in files().iter().flat_map(|file| &file.routines) {
        let mut open: Vec<&str> = Vec::new();
        let mut declares = true;
        for (index, statement) in routine.body.iter().enumerate() {
            let at = format!("{}:{}: {}", routine.file, statement.line, statement.code);
            let first = statement.first_word();
            declares &= first == "DECL";
            assert!(declares || first != "DECL", "{at}: declared behind a statement");
            if let Some((opens, _)) = pairs.iter().find(|(opens, _)| *opens == first) {
                open.push(opens);
                assert_eq!(first == "IF", statement.code.ends_with(" THEN"), "{at}");
            }
            if let Some((opens, _)) = pairs.iter().find(|(_, closes)| *closes == first) {
                assert_eq!(open.pop(), Some(*opens), "{at}");
            }
            if first == "SWITCH" {
                // KRL takes neither a blank nor a comment there.
                let next = &routine.body[index + 1];
                assert!(next.line == statement.line + 1 && next.first_word() == "CASE", "{at}");
            }
            if ["CASE", "DEFAULT"].contains(&first.as_str()) {
                assert_eq!(open.last(), Some(&"SWITCH"), "{at}");
            }
            let brackets = |c: char| statement.code.matches(c).count();
            assert!(
                brackets('(') == brackets(')') && brackets('[') == brackets(']') && brackets('"') % 2 == 0,
                "{at}"
            );
        }
        assert!(open.is_empty(), "{} in {}: {open:?} is not closed", routine.name, routine.file);
    }
}

/// Comparisons bind weaker than AND and OR in KRL.
#[test]
fn comparisons_beside_and_or_or_stand_in_brackets() {
    each(&files(), |routine, statement| {
        let mut outside = String::new();
        let mut depth = 0;
        for c in statement.code.replace(['[', '{'], "(").replace([']', '}'], ")").chars() {
            depth += i32::from(c == '(') - i32::from(c == ')');
            if depth == 0 {
                outside.push(c);
            }
        }
        let joins = [" AND ", " OR "].iter().any(|join| outside.contains(join));
        let right = if outside.starts_with("IF") || outside.starts_with("WHILE") {
            outside.clone()
        } else {
            outside.split_once('=').map_or(String::new(), |(_, right)| right.to_owned())
        };
        let compares = right.contains(['<', '>']) || right.contains("==");
        assert!(!(joins && compares), "{}:{}: {}", routine.file, statement.line, statement.code);
    });
}

#[test]
fn every_name_is_declared_and_every_call_fits() {
    let files = files();
    let (routines, data) = (routines(&files), data(&files));
    each(&files, |routine, statement| {
        let at = format!("{}:{}: {}", routine.file, statement.line, statement.code);
        let locals = locals(routine);
        let calls = statement.calls();
        for word in statement.words() {
            let word = word.as_str();
            let known = KEYWORDS.contains(&word)
                || TYPES.contains(&word)
                || FOREIGN.contains(&word)
                || EKI.contains(&word)
                || SYSTEM.contains(&word)
                || locals.contains(word)
                || data.contains_key(word)
                || routines.contains_key(word)
                || statement.code.contains(&format!("{{{word} "))
                || statement.code.contains(&format!(",{word} ")) && statement.code.contains('{');
            assert!(known, "{at}: {word} is declared nowhere");
        }
        for (name, arguments) in calls {
            if let Some(called) = routines.get(&name) {
                assert!(called.global || called.file == routine.file, "{at}: {name} is not GLOBAL");
                assert_eq!(arguments.len(), called.parameters.len(), "{at}: {name}");
            } else {
                let known = [&KEYWORDS[..], &FOREIGN, &EKI].concat();
                assert!(known.contains(&name.as_str()), "{at}: nobody has {name}");
            }
        }
        for local in &locals {
            assert!(!data.contains_key(local) && !routines.contains_key(local), "{}: {local}", routine.name);
        }
    });
    // And nothing is left over.
    let code: Vec<String> =
        files.iter().flat_map(File::statements).flat_map(|statement| statement.words()).collect();
    let entry = [
        "CELL_MOTION",
        "CELL_SUBMIT",
        "CELL_LINK",
        "CELL_JUDGE",
        "CELL_TELL",
        "CELL_USER",
        "CELL_INIT",
        "CELL_CYCLE",
    ];
    for name in routines.keys().filter(|name| !entry.contains(&name.as_str())).chain(data.keys()) {
        let name = name.split('[').next().unwrap_or_default();
        assert!(code.iter().filter(|word| *word == name).count() > 1, "{name} is used nowhere");
    }
}

fn channels() -> [(&'static str, ChannelFile); 2] {
    [("CELLCMD", CELLCMD), ("CELLSTAT", CELLSTAT)]
        .map(|(name, text)| (name, ChannelFile::parse(text).expect("a shipped file")))
}

fn is_of(kind: Kind, function: &str) -> bool {
    match kind {
        Kind::Int => function.ends_with("INT"),
        Kind::Real => function.ends_with("REAL"),
        Kind::Frame => function.ends_with("FRAME"),
        Kind::Bool | Kind::Text => false,
    }
}

/// What is read is received, what is set is sent, both by their type; and nothing of the files is left out.
#[test]
fn programs_and_channel_files_name_the_same_elements() {
    let files = files();
    let channels = BTreeMap::from(channels());
    let mut used = BTreeSet::new();
    each(&files, |routine, statement| {
        for (function, arguments) in statement.calls().iter().filter(|(name, _)| name.starts_with("EKI_")) {
            let at = format!("{}:{}: {}", routine.file, statement.line, statement.code);
            let text = |place: usize| arguments[place].trim_matches('"').to_owned();
            let file = channels.get(text(0).as_str()).unwrap_or_else(|| panic!("{at}: no such channel"));
            assert!(statement.code.starts_with("RET=EKI_"), "{at}: its status is looked at");
            let find = |elements: &[Element]| elements.iter().find(|element| element.tag == text(1)).cloned();
            match function.as_str() {
                "EKI_INIT" | "EKI_OPEN" | "EKI_CLEAR" => assert_eq!(arguments.len(), 1, "{at}"),
                "EKI_CHECKBUFFER" => {
                    assert!(find(&file.received).is_some_and(|found| found.kind.is_some()), "{at}")
                }
                "EKI_SEND" => {
                    let root = format!("{}/", text(1));
                    assert!(file.sent.iter().all(|element| element.tag.starts_with(&root)), "{at}");
                }
                get_or_set => {
                    let elements = if get_or_set.starts_with("EKI_GET") { &file.received } else { &file.sent };
                    let element = find(elements).unwrap_or_else(|| panic!("{at}: not in {}.xml", text(0)));
                    assert!(element.kind.is_some_and(|kind| is_of(kind, get_or_set)), "{at}: {:?}", element.kind);
                    assert!(used.insert(text(1)), "{at}: twice");
                }
            }
        }
    });
    let all: BTreeSet<String> = channels
        .values()
        .flat_map(|file| file.received.iter().chain(&file.sent))
        .filter(|element| element.kind.is_some())
        .map(|element| element.tag.clone())
        .collect();
    assert_eq!(used, all);
}

/// A variable that has no value stops the program when EKI_Get writes to it.
#[test]
fn what_is_read_into_has_a_value_before() {
    let mut looked_at = 0;
    for routine in files().iter().flat_map(|file| &file.routines) {
        for (index, statement) in routine.body.iter().enumerate() {
            for (_, arguments) in statement.calls().iter().filter(|(name, _)| name.starts_with("EKI_GET")) {
                let whole = arguments[2].split('.').next().unwrap_or_default();
                let set = |target: &str| {
                    routine.body[..index].iter().any(|before| before.code.starts_with(&format!("{target}=")))
                };
                assert!(set(whole) && (!arguments[2].ends_with(".P") || set(&arguments[2])), "{}", statement.code);
                looked_at += 1;
            }
        }
    }
    assert_eq!(looked_at, 12);
}

fn number(data: &BTreeMap<String, String>, name: &str) -> f64 {
    data.get(name).unwrap_or_else(|| panic!("no {name}")).parse().unwrap_or_else(|_| panic!("{name} is no number"))
}

/// Flags and timers stand where they are declared, in the XML files, in the interrupts and on the page, and there alike.
#[test]
fn flags_and_timers_agree_everywhere() {
    let files = files();
    let data = data(&files);
    let [(_, commands), (_, states)] = channels();
    let flag = |name: &str| number(&data, name) as u32;
    let root = |file: &ChannelFile| file.received.iter().find_map(|element| element.set_flag).expect("a flag");
    assert_eq!(commands.alive_flag, Some(flag("CELL_F_CMD_ALIVE")));
    assert_eq!(root(&commands), flag("CELL_F_CMD_CAME"));
    assert_eq!(states.alive_flag, Some(flag("CELL_F_STAT_ALIVE")));
    assert_eq!(root(&states), flag("CELL_F_STAT_CAME"));
    let motion = &files.iter().find(|file| file.name == "cell_motion.src").expect("it").text;
    for declared in [
        format!("INTERRUPT DECL 20 WHEN $FLAG[{}]==TRUE DO CELL_ISR_HALT( )", flag("CELL_F_HALT")),
        format!("INTERRUPT DECL 21 WHEN $FLAG[{}]==TRUE DO CELL_ISR_STOP( )", flag("CELL_F_STOP")),
        format!("INTERRUPT DECL 22 WHEN $TIMER_FLAG[{}]==TRUE DO CELL_ISR_STOP( )", flag("CELL_T_SUBMIT")),
    ] {
        assert!(motion.contains(&declared), "{declared}");
    }
    let page = page();
    let named: Vec<&String> =
        data.keys().filter(|name| name.starts_with("CELL_F_") || name.starts_with("CELL_T_")).collect();
    assert_eq!(named.len(), 11);
    for name in &named {
        let kind = if name.starts_with("CELL_F_") { "$FLAG" } else { "$TIMER" };
        let row = format!("| `{kind}` | {} | `{name}` |", data[*name]);
        assert!(page.contains(&row), "the page lacks {row}");
    }
    let numbers: BTreeSet<&String> = named.iter().map(|name| &data[*name]).collect();
    assert_eq!(numbers.len(), named.len(), "each number once");
    // Elsewhere they are used by their names.
    each(&files, |routine, statement| {
        for array in ["$FLAG[", "$TIMER[", "$TIMER_FLAG[", "$TIMER_STOP[", "$OUT[", "$IN["] {
            for (at, _) in statement.code.match_indices(array) {
                let literal = statement.code[at + array.len()..].starts_with(|c: char| c.is_ascii_digit());
                let allowed = statement.code.starts_with("INTERRUPT DECL");
                assert!(!literal || allowed, "{}:{}: {}", routine.file, statement.line, statement.code);
            }
        }
    });
}

/// `const NAME: … = value;` anywhere in the mock.
fn mock_constant(name: &str) -> f64 {
    let folder = folder().join("../../src/devices/mock");
    let mut texts = Vec::new();
    let mut folders = vec![folder];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("the mock") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                texts.push(std::fs::read_to_string(path).expect("readable"));
            }
        }
    }
    let declared = format!("const {name}: ");
    let mut values = texts.iter().flat_map(|text| text.lines()).filter_map(|line| {
        let (_, value) = line.split_once(&declared)?.1.split_once('=')?;
        value.trim().trim_end_matches(';').replace('_', "").parse().ok()
    });
    values.next().unwrap_or_else(|| panic!("the mock has no {name}"))
}

#[test]
fn the_numbers_are_those_of_client_and_mock() {
    let data = data(&files());
    let of = |name: &str| number(&data, name);
    let limits = LinkLimits::default();
    assert_eq!(of("CELL_WATCHDOG_MS"), limits.watchdog.as_millis() as f64);
    assert!(of("CELL_STATE_MS") <= limits.heartbeat.as_millis() as f64);
    assert!(of("CELL_RING_N") >= 2.0 * limits.window_commands as f64, "a ring that the client cannot fill");
    // The client gives a silent controller up after 1 s; the controller waits longer, so that it is not the first.
    assert!(of("CELL_SILENT_MS") > 1000.0);
    for (ours, mocks, unit) in [
        ("CELL_WATCHDOG_MS", "WATCHDOG_MS", 1.0),
        ("CELL_RING_N", "RING", 1.0),
        ("CELL_PER_CYCLE", "COMMANDS_PER_TICK", 1.0),
        ("CELL_ADVANCE", "ADVANCE", 1.0),
        ("CELL_STATE_MS", "STATE_EVERY_MS", 1.0),
        ("CELL_ACK_MS", "ACK_EVERY_MS", 1.0),
        ("CELL_CYCLE_MS", "TICK_MS", 1.0),
        ("CELL_RETRACT_MM", "RETRACT_MM", 1.0),
        ("CELL_RETRACT_VEL", "RETRACT_MM_S", 1000.0),
        ("CELL_RETRACT_ACC", "RETRACT_MM_S2", 1000.0),
    ] {
        assert_eq!(of(ours) * unit, mock_constant(mocks), "{ours} and the mock's {mocks}");
    }
    assert_eq!(data["CELL_RING_N"], "100");
    assert!(files().iter().any(|file| file.text.contains("CELL_RING[100]")), "the array is as long");
    let arm = panelprep::devices::mock::Arm::kr6_r700_2();
    for (axis, [low, high]) in arm.limits_deg.into_iter().enumerate() {
        assert_eq!(of(&format!("CELL_AXIS_MIN[{}]", axis + 1)), low);
        assert_eq!(of(&format!("CELL_AXIS_MAX[{}]", axis + 1)), high);
    }
}

#[test]
fn refusals_and_operations_have_the_same_numbers() {
    let files = files();
    let data = data(&files);
    let refusals = [
        ("CELL_E_ID_GAP", Refusal::IdGap),
        ("CELL_E_EPOCH", Refusal::WrongEpoch),
        ("CELL_E_RING_FULL", Refusal::RingFull),
        ("CELL_E_OPERATION", Refusal::UnknownOperation),
        ("CELL_E_RANGE", Refusal::OutOfRange),
        ("CELL_E_NO_FRAMES", Refusal::NoBaseOrTool),
        ("CELL_E_READ_ONLY", Refusal::ReadOnly),
        ("CELL_E_REACH", Refusal::Unreachable),
        ("CELL_E_NO_MOTION", Refusal::NoMotion),
        ("CELL_E_STOPPED", Refusal::Stopped),
    ];
    for (name, refusal) in refusals {
        assert_eq!(number(&data, name), f64::from(refusal as i32), "{name}");
    }
    assert_eq!(data.keys().filter(|name| name.starts_with("CELL_E_")).count(), refusals.len());
    let mut cases = BTreeMap::new();
    for file in &files {
        for statement in file.statements().iter().filter(|statement| !statement.comment.is_empty()) {
            if let Some(number) = statement.code.strip_prefix("CASE ") {
                let name = statement.comment.to_uppercase();
                assert_eq!(number.parse(), Ok(mock_constant(&name)), "{}: {name}", file.name);
                cases.entry(file.name.as_str()).or_insert_with(Vec::new).push(name);
            }
        }
    }
    assert_eq!(cases["cell_motion.src"].len(), 7);
    assert_eq!(cases["cell_judge.src"].len(), 8);
    assert_eq!(cases["cell_link.src"], ["ABORT", "RESET"]);
}

/// Bits of In and Out: the example cell's numbers, ascending, as the client counts them.
#[test]
fn the_mapped_signals_are_those_of_the_example_cell() {
    let data = data(&files());
    let text = std::fs::read_to_string(folder().join("../cell-example.toml")).expect("the example");
    let cell = Cell::check("cell-example.toml", &text).expect("right");
    for (array, count, named) in
        [("CELL_IN", "CELL_IN_N", cell.io().feedbacks()), ("CELL_OUT", "CELL_OUT_N", cell.io().outputs())]
    {
        let numbers: BTreeSet<u16> = named.values().copied().collect();
        assert_eq!(number(&data, count), numbers.len() as f64);
        for (index, expected) in numbers.into_iter().enumerate() {
            assert_eq!(number(&data, &format!("{array}[{}]", index + 1)), f64::from(expected));
        }
    }
    assert_eq!(number(&data, "CELL_TOOL_OUT"), f64::from(cell.io().outputs()["tool"]));
}

fn in_order(routine: &Routine, codes: &[&str]) {
    let mut rest = routine.body.iter();
    for code in codes {
        let found = rest.any(|statement| statement.code.starts_with(code));
        assert!(found, "{}: {code} is not where it must be", routine.name);
    }
}

/// The order of two statements is what a stop stands on.
#[test]
fn the_order_that_a_stop_stands_on_is_kept() {
    let files = files();
    let routines = routines(&files);
    in_order(routines["CELL_STOP"], &["CELL_OPEN=FALSE", "$OUT[CELL_TOOL_OUT]=FALSE", "$FLAG[CELL_F_HALT]=TRUE"]);
    in_order(routines["CELL_RESET"], &["CELL_OPEN=FALSE", "CELL_BEGIN", "CELL_STOPPED=FALSE", "CELL_OPEN=TRUE"]);
    in_order(routines["CELL_BEGIN"], &["CELL_RX=0", "CELL_EP=NUMBER"]);
    in_order(routines["CELL_TAKE"], &["CELL_RING[SLOT]=CMD", "CELL_RX=CMD.ID"]);
    in_order(
        routines["CELL_STREAM"],
        &[
            "CELL_DONE=0",
            "CELL_RUN_EP=CELL_EP",
            "INTERRUPT ON 20",
            "INTERRUPT ON 21",
            "INTERRUPT ON 22",
            "IF $FLAG[CELL_F_STOP] OR $FLAG[CELL_F_HALT] OR $TIMER_FLAG[CELL_T_SUBMIT]",
            "CELL_DEAD_EP=CELL_RUN_EP",
            "WHILE",
            "CMD=CELL_RING[SLOT]",
            "IF CELL_OPEN AND (CELL_EP==CELL_RUN_EP)",
            "CELL_EXECUTE",
            "ENDWHILE",
            "WAIT SEC 0",
            "INTERRUPT OFF 20",
        ],
    );
    for isr in ["CELL_ISR_STOP", "CELL_ISR_HALT"] {
        in_order(
            routines[isr],
            &["$OUT[CELL_TOOL_OUT]=FALSE", "CELL_DEAD_EP=CELL_RUN_EP", "BRAKE", "IF CELL_BELOW", "RESUME"],
        );
        assert_eq!(routines[isr].body.last().expect("some").code, "ENDIF", "nothing follows RESUME");
    }
    // The advance pointer stays in the level that RESUME leaves.
    for below in ["CELL_STREAM", "CELL_RETREAT"] {
        assert_eq!(routines[below].body.last().expect("some").code, "$ADVANCE=0", "{below}");
    }
    in_order(
        routines["CELL_MOTION"],
        &[
            "CELL_DEAD_EP=CELL_EP",
            "PTP $AXIS_ACT_MEAS",
            "LOOP",
            "INTERRUPT OFF 20",
            "IF CELL_RETRACT",
            "CELL_FORGET",
            "$FLAG[CELL_F_STOP]=FALSE",
            "IF CELL_OPEN AND (CELL_DEAD_EP<>CELL_EP)",
            "CELL_STREAM",
        ],
    );
    for open in ["CELL_OPEN_CMD", "CELL_OPEN_STAT"] {
        in_order(routines[open], &["RET=EKI_Clear", "RET=EKI_Init", "RET=EKI_Open"]);
    }
    for read in ["CELL_REQUESTS", "CELL_COMMANDS"] {
        in_order(routines[read], &["$FLAG[", "RET=EKI_CheckBuffer", "WHILE"]);
    }
}

/// Each kind of statement is only where it may be.
#[test]
fn motion_waits_and_frames_are_where_they_may_be() {
    let allowed = [
        ("PTP", &["CELL_MOTION", "CELL_EXECUTE"][..]),
        ("LIN", &["CELL_EXECUTE", "CELL_RETREAT"]),
        ("BRAKE", &["CELL_ISR_STOP", "CELL_ISR_HALT"]),
        ("RESUME", &["CELL_ISR_STOP", "CELL_ISR_HALT"]),
        ("TRIGGER", &["CELL_EXECUTE"]),
        ("WAIT", &["CELL_MOTION", "CELL_STREAM", "CELL_EXECUTE", "CELL_RETREAT", "CELL_USER_0"]),
        ("$BASE", &["CELL_MOTION", "CELL_STREAM", "CELL_EXECUTE"]),
        ("$TOOL", &["CELL_MOTION", "CELL_STREAM", "CELL_EXECUTE"]),
        ("CELL_EP", &["CELL_BEGIN"]),
        ("CELL_RX", &["CELL_INIT", "CELL_BEGIN", "CELL_TAKE"]),
        ("CELL_OPEN", &["CELL_INIT", "CELL_STOP", "CELL_RESET"]),
    ];
    each(&files(), |routine, statement| {
        let first = statement.first_word();
        if let Some((_, homes)) = allowed.iter().find(|(word, _)| *word == first) {
            let is_write = !first.starts_with(['$', 'C']) || statement.code.starts_with(&format!("{first}="));
            assert!(!is_write || homes.contains(&routine.name.as_str()), "{}: {}", routine.name, statement.code);
        }
        for opener in ["EKI_Open", "EKI_Init", "EKI_Clear"] {
            let home = routine.name.starts_with("CELL_OPEN_");
            assert!(home || !statement.code.contains(opener), "{}: {}", routine.name, statement.code);
        }
    });
}

/// Sum times 31 plus the byte, modulo 1000003, over the programs that nobody edits.
#[test]
fn the_checksum_is_of_these_programs() {
    let files = files();
    let mut sum = 0u64;
    for file in files.iter().filter(|file| !["cell_config.dat", "cell_user.src"].contains(&file.name.as_str())) {
        for line in file.text.lines().filter(|line| !line.contains("CELL_PROGRAM_SUM=")) {
            sum = line.bytes().fold(sum, |sum, byte| (sum * 31 + u64::from(byte)) % 1_000_003);
        }
    }
    let found = number(&data(&files), "CELL_PROGRAM_SUM");
    assert_eq!(found, sum as f64, "programs were changed: CELL_PROGRAM_SUM in cell_data.dat must be {sum}");
    // Every value that may be edited is mixed in.
    let tell = &files.iter().find(|file| file.name == "cell_tell.src").expect("it").text;
    for name in data(&files[..1]).keys() {
        let name = name.split('[').next().unwrap_or_default();
        assert!(
            tell.contains(&format!("({name})")) || tell.contains(&format!("({name}[I])")),
            "{name} is not mixed in"
        );
    }
}

/// The page names every file, every refusal that a person meets, and both folds.
#[test]
fn the_page_is_complete() {
    let page = page();
    for file in files() {
        assert!(page.contains(&format!("`{}`", file.name)), "{}", file.name);
    }
    for word in
        ["CELLCMD.xml", "CELLSTAT.xml", "CELL_INIT( )", "CELL_CYCLE( )", "USER INIT", "USER PLC", "172.31.1.147"]
    {
        assert!(page.contains(word), "{word}");
    }
    for (_, file) in channels() {
        assert!(page.contains(&file.port.to_string()) && page.contains(&file.address.expect("an address")));
    }
}
