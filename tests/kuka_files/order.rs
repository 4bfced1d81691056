//! Checks the order of statements on which a stop depends, and the places at which each kind of statement is allowed.

use super::krl::{Routine, files};
use super::{each, routines};

/// If a variable has no value, the program stops when EKI_Get writes to it.
#[test]
fn each_variable_has_a_value_before_eki_get_writes_to_it() {
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

fn expect_in_order(routine: &Routine, codes: &[&str]) {
    let mut rest = routine.body.iter();
    for code in codes {
        let found = rest.any(|statement| statement.code.starts_with(code));
        assert!(found, "{}: {code} is not where it must be", routine.name);
    }
}

/// A stop depends on the order of two statements.
#[test]
fn the_order_on_which_a_stop_depends_is_kept() {
    let files = files();
    let routines = routines(&files);
    expect_in_order(
        routines["CELL_STOP"],
        &[
            "WAS_OPEN=CELL_OPEN",
            "CELL_OPEN=FALSE",
            "CELL_OFF_NOW(FALSE)",
            "IF WAS_OPEN",
            "$TIMER[CELL_T_OFF]=0",
            "CELL_OFF_DUE[I]=TRUE",
            "$FLAG[CELL_F_HALT]=TRUE",
        ],
    );
    expect_in_order(
        routines["CELL_RESET"],
        &["CELL_OPEN=FALSE", "CELL_BEGIN", "CELL_STOPPED=FALSE", "CELL_OPEN=TRUE"],
    );
    expect_in_order(routines["CELL_BEGIN"], &["CELL_RX=0", "CELL_EP=NUMBER"]);
    expect_in_order(routines["CELL_TAKE"], &["CELL_RING[SLOT]=CMD", "CELL_RX=CMD.ID"]);
    expect_in_order(
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
        expect_in_order(
            routines[isr],
            &[
                "CELL_OFF_NOW($TIMER_FLAG[CELL_T_SUBMIT])",
                "CELL_DEAD_EP=CELL_RUN_EP",
                "BRAKE",
                "IF CELL_BELOW",
                "RESUME",
            ],
        );
        assert_eq!(routines[isr].body.last().expect("some").code, "ENDIF", "nothing follows RESUME");
    }
    // The advance pointer must stay in the subprogram level that RESUME leaves.
    for below in ["CELL_STREAM", "CELL_RETREAT"] {
        assert_eq!(routines[below].body.last().expect("some").code, "$ADVANCE=0", "{below}");
    }
    expect_in_order(
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
        expect_in_order(routines[open], &["RET=EKI_Clear", "RET=EKI_Init", "RET=EKI_Open"]);
    }
    for read in ["CELL_REQUESTS", "CELL_COMMANDS"] {
        expect_in_order(routines[read], &["$FLAG[", "RET=EKI_CheckBuffer", "WHILE"]);
    }
}

fn body(name: &str) -> Vec<String> {
    let files = files();
    let routines = routines(&files);
    routines[name].body.iter().map(|statement| statement.code.clone()).collect()
}

/// Rules that the mock implements in the same way. The programs and the mock once differed in each of these rules.
#[test]
fn the_programs_follow_the_same_rules_as_the_mock() {
    // An epoch ends when its client disconnects, whether the robot is busy or not.
    assert_eq!(body("CELL_LOST"), ["IF CELL_OPEN THEN", "CELL_STOP(FALSE)", "ENDIF"]);
    let has = |routine: &str, codes: &[&str]| {
        let body = body(routine).join("\n");
        assert!(body.contains(&codes.join("\n")), "{routine}: {codes:?} not in\n{body}");
    };
    // When the robot program ends, its epoch is ended first; only then the program is marked as ended.
    has(
        "CELL_PROGRAM",
        &["IF CELL_NO_PROGRAM( ) THEN", "IF CELL_OPEN AND (CELL_READY OR CELL_BUSY( )) THEN", "CELL_STOP(FALSE)"],
    );
    // While the tool runs or water is on, the watchdog is active as it is during a motion.
    has("CELL_WATCH", &["IF (CELL_BUSY( ) OR CELL_AT_STAKE( )) AND ($TIMER[CELL_T_HEARD]>=CELL_WATCHDOG_MS) THEN"]);
    has("CELL_AT_STAKE", &["IF (CELL_OFF_MS[I]==0) AND $OUT[CELL_OFF[I]] THEN", "RETURN TRUE"]);
    // After the end of an epoch, each output is switched off after its own time, and stays off for a second; never in
    // an open epoch.
    has("CELL_OFF_NOW", &["IF ALL OR (CELL_OFF_MS[I]==0) THEN", "$OUT[CELL_OFF[I]]=FALSE"]);
    assert_eq!(body("CELL_OUTPUTS")[2..5], ["IF CELL_OPEN THEN", "RETURN", "ENDIF"]);
    has(
        "CELL_OUTPUTS",
        &[
            "SINCE=$TIMER[CELL_T_OFF]",
            "FOR I=1 TO CELL_OFF_N",
            "IF CELL_OFF_DUE[I] AND (SINCE>=CELL_OFF_MS[I]) THEN",
            "$OUT[CELL_OFF[I]]=FALSE",
            "CELL_OFF_DUE[I]=(SINCE<(CELL_OFF_MS[I]+CELL_OFF_AGAIN_MS))",
        ],
    );
    has("CELL_MOTION", &["IF $TIMER_FLAG[CELL_T_SUBMIT] THEN", "CELL_OFF_NOW(TRUE)"]);
    // No request raises the epoch by more than one; an abort stops in any case.
    has(
        "CELL_FOLLOWS",
        &["IF NUMBER<=CELL_EP THEN", "RETURN FALSE", "ENDIF", "RETURN ((NUMBER-CELL_EP)<=CELL_EPOCH_STEP)"],
    );
    has("CELL_ABORT", &["CELL_STOP(FALSE)", "IF CELL_FOLLOWS(NUMBER) THEN", "CELL_BEGIN(NUMBER)"]);
    has("CELL_RESET", &["DECL INT NUMBER", "IF CELL_FOLLOWS(NUMBER) THEN"]);
    // A stop resets a program that is paused, or that must stop at once.
    has("CELL_STOP", &["IF AT_ONCE OR ($PRO_STATE1==#P_STOP) THEN", "CELL_RESET_DUE=CELL_READY"]);
    // Outputs that are not listed are refused; inputs are refused only if they are not mapped.
    has(
        "CELL_JUDGE_VALUES",
        &["RIGHT=CELL_MAPPED(CMD.N1) AND ((CMD.N2==0) OR (CMD.N2==1)) AND ((CMD.R1==0.0) OR (CMD.R1==1.0))"],
    );
    has("CELL_JUDGE_VALUES", &["IF CELL_VIRTUAL(CMD.N1)==0 THEN", "RETURN CELL_E_READ_ONLY"]);
    // A move_j must stop exactly at its target.
    has("CELL_JUDGE_VALUES", &["RIGHT=(CMD.R1>=1.0) AND (CMD.R1<=100.0) AND (CMD.R2==0.0)"]);
    // The TCP is not reported before block coincidence.
    has(
        "CELL_TELL_STATE",
        &[
            "IF CELL_READY AND (VARSTATE(\"$POS_ACT_MES\")==#INITIALIZED) THEN",
            "ON_ERROR_PROCEED",
            "TCP=$POS_ACT_MES",
        ],
    );
    // The number of a state message continues from 0.
    has("CELL_TELL_STATE", &["IF CELL_SEQ<2147483647 THEN", "CELL_SEQ=CELL_SEQ+1", "ELSE", "CELL_SEQ=0"]);
    // A client is disconnected after 3 s without a request, whatever commands arrive, and even if another client tries
    // to connect while the first one is unreachable.
    has(
        "CELL_LINKS",
        &[
            "IF (NOT CELL_CMD_WAS) AND (NOT CELL_STAT_WAS) AND ($FLAG[CELL_F_CMD_ALIVE] OR $FLAG[CELL_F_STAT_ALIVE]) THEN",
            "$TIMER[CELL_T_SILENT]=0",
        ],
    );
    assert!(body("CELL_REQUEST").contains(&"$TIMER[CELL_T_SILENT]=0".to_owned()));
    assert!(!body("CELL_COMMAND").contains(&"$TIMER[CELL_T_SILENT]=0".to_owned()));
    // If the submit interpreter stops, the arm is stopped after the same time as for a silent client.
    has("CELL_CYCLE", &["$TIMER[CELL_T_SUBMIT]=-CELL_WATCHDOG_MS"]);
}

/// Each kind of statement appears only in allowed places.
#[test]
fn motion_waits_and_frames_are_only_in_allowed_places() {
    let allowed = [
        ("PTP", &["CELL_MOTION", "CELL_EXECUTE"][..]),
        ("LIN", &["CELL_EXECUTE", "CELL_RETREAT"]),
        ("BRAKE", &["CELL_ISR_STOP", "CELL_ISR_HALT"]),
        ("RESUME", &["CELL_ISR_STOP", "CELL_ISR_HALT"]),
        ("TRIGGER", &["CELL_EXECUTE"]),
        (
            "WAIT",
            &[
                "CELL_MOTION",
                "CELL_STREAM",
                "CELL_EXECUTE",
                "CELL_INSIDE",
                "CELL_RETREAT",
                "CELL_CATCH_UP",
                "CELL_CYCLE",
                "CELL_USER_0",
            ],
        ),
        ("$BASE", &["CELL_MOTION", "CELL_STREAM", "CELL_EXECUTE"]),
        ("$TOOL", &["CELL_MOTION", "CELL_STREAM", "CELL_EXECUTE"]),
        ("CELL_EP", &["CELL_BEGIN"]),
        ("CELL_RX", &["CELL_INIT", "CELL_BEGIN", "CELL_TAKE"]),
        ("CELL_OPEN", &["CELL_INIT", "CELL_STOP", "CELL_RESET"]),
        ("CELL_READY", &["CELL_INIT", "CELL_CYCLE", "CELL_MOTION", "CELL_PROGRAM"]),
        ("CELL_SEQ", &["CELL_INIT", "CELL_TELL_STATE"]),
    ];
    each(&files(), |routine, statement| {
        let first = statement.first_word();
        if let Some((_, homes)) = allowed.iter().find(|(word, _)| *word == first) {
            let is_write = !first.starts_with(['$', 'C']) || statement.code.starts_with(&format!("{first}="));
            assert!(!is_write || homes.contains(&routine.name.as_str()), "{}: {}", routine.name, statement.code);
        }
        for opener in ["EKI_Open", "EKI_Init", "EKI_Clear"] {
            let tries_again = routine.name == "CELL_TRY_OPEN" && opener == "EKI_Open";
            let home = routine.name.starts_with("CELL_OPEN_") || tries_again;
            assert!(home || !statement.code.contains(opener), "{}: {}", routine.name, statement.code);
        }
    });
}
