//! Checks the controller's programs as text: their form, and their agreement with the EthernetKRL files, the client,
//! the mock controller and the installation page. These tests do not replace a controller; they detect careless errors
//! in the programs.

mod agree;
mod krl;
mod order;

use krl::{File, Routine, Statement, data, files};
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
/// Names that KUKA's own software defines.
const FOREIGN: [&str; 5] = ["BAS", "IR_STOPM", "CWRITE", "VARSTATE", "ON_ERROR_PROCEED"];
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
/// Every system variable that the programs use; the installation page asks the user to check the important ones.
const SYSTEM: [&str; 36] = [
    "$ACC",
    "$ACC_AXIS",
    "$ADVANCE",
    "$ALARM_STOP",
    "$ALARM_STOP_INTERN",
    "$APO",
    "$AXIS_ACT_MEAS",
    "$BASE",
    "$CMD",
    "$DATE",
    "$FLAG",
    "$IN",
    "$IPO_MODE",
    "$MODE_OP",
    "$NULLFRAME",
    "$ORI_TYPE",
    "$OUT",
    "$PERI_RDY",
    "$OV_PRO",
    "$POS_ACT",
    "$POS_ACT_MES",
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

#[test]
fn the_text_of_the_programs_has_a_valid_form() {
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
fn blocks_are_closed_in_the_order_of_their_opening() {
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
                // KRL accepts neither a blank line nor a comment here.
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

/// Comparisons beside AND or OR need brackets, because in KRL comparisons have a lower precedence than AND and OR.
#[test]
fn comparisons_beside_and_or_or_are_in_brackets() {
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
                assert!(known.contains(&name.as_str()), "{at}: {name} is not known");
            }
        }
        for local in &locals {
            assert!(!data.contains_key(local) && !routines.contains_key(local), "{}: {local}", routine.name);
        }
    });
    // Every program is called.
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
