//! Mutations of the controller's shipped programs.

use super::{Mutation, change};

const LINK_SOURCE_PATH: &str = "config/kuka/cell_link.src";
const MOTION_SOURCE_PATH: &str = "config/kuka/cell_motion.src";
const SUBMIT_SOURCE_PATH: &str = "config/kuka/cell_submit.src";

pub(super) const ALL: [Mutation; 12] = [
    change(
        "programs: a command of an ended epoch is judged",
        LINK_SOURCE_PATH,
        "IF CMD.EP<CELL_EP THEN\n    RETURN",
        "IF CMD.EP<0 THEN\n    RETURN",
    )
    .of_programs(),
    change(
        "programs: the watchdog × 4",
        SUBMIT_SOURCE_PATH,
        "($TIMER[CELL_T_HEARD]>=CELL_WATCHDOG_MS)",
        "($TIMER[CELL_T_HEARD]>=(4*CELL_WATCHDOG_MS))",
    )
    .of_programs(),
    change(
        "programs: an epoch continues without its client",
        LINK_SOURCE_PATH,
        "  IF CELL_OPEN THEN\n    CELL_STOP(FALSE)\n  ENDIF",
        "  IF CELL_OPEN AND CELL_STOPPED THEN\n    CELL_STOP(FALSE)\n  ENDIF",
    )
    .of_programs(),
    change(
        "programs: an abort whose number may not follow does not stop",
        LINK_SOURCE_PATH,
        "  DECL INT NUMBER\n  CELL_STOP(FALSE)\n  IF CELL_FOLLOWS(NUMBER) THEN\n    CELL_BEGIN(NUMBER)",
        "  DECL INT NUMBER\n  IF CELL_FOLLOWS(NUMBER) THEN\n    CELL_STOP(FALSE)\n    CELL_BEGIN(NUMBER)",
    )
    .of_programs(),
    change(
        "programs: any jump of the epoch is taken",
        LINK_SOURCE_PATH,
        "RETURN ((NUMBER-CELL_EP)<=CELL_EPOCH_STEP)",
        "RETURN TRUE",
    )
    .of_programs(),
    change(
        "programs: a stop in contact does not retract",
        MOTION_SOURCE_PATH,
        "IF CELL_RETRACT AND (NOT $FLAG[CELL_F_HALT]) THEN",
        "IF CELL_RETRACT AND $FLAG[CELL_F_HALT] THEN",
    )
    .of_programs(),
    change(
        "programs: a stop leaves the water on",
        SUBMIT_SOURCE_PATH,
        "IF ALL OR (CELL_OFF_MS[I]==0) THEN",
        "IF (I<>2) AND (ALL OR (CELL_OFF_MS[I]==0)) THEN",
    )
    .and(
        SUBMIT_SOURCE_PATH,
        "IF CELL_OFF_DUE[I] AND (SINCE>=CELL_OFF_MS[I]) THEN",
        "IF (I<>2) AND CELL_OFF_DUE[I] AND (SINCE>=CELL_OFF_MS[I]) THEN",
    )
    .of_programs(),
    change(
        "programs: what a stop left on is not switched off in its time",
        SUBMIT_SOURCE_PATH,
        "    $TIMER[CELL_T_OFF]=0\n    FOR I=1 TO CELL_OFF_N\n      CELL_OFF_DUE[I]=TRUE",
        "    $TIMER[CELL_T_OFF]=0\n    FOR I=1 TO CELL_OFF_N\n      CELL_OFF_DUE[I]=FALSE",
    )
    .of_programs(),
    change(
        "programs: standing in contact does not end the epoch",
        SUBMIT_SOURCE_PATH,
        "IF LATE OR ($TIMER[CELL_T_STILL]>=CELL_DWELL_MS) THEN",
        "IF LATE AND ($TIMER[CELL_T_STILL]>=(100*CELL_DWELL_MS)) THEN",
    )
    .of_programs(),
    change(
        "programs: what the safety controller stopped is continued",
        SUBMIT_SOURCE_PATH,
        "IF CELL_SAFE_WAS AND (NOT SAFE) THEN",
        "IF CELL_SAFE_WAS AND (NOT SAFE) AND CELL_STOPPED THEN",
    )
    .of_programs(),
    change(
        "programs: a client that is gone without a word keeps its place",
        LINK_SOURCE_PATH,
        "IF $TIMER[CELL_T_SILENT]>=CELL_SILENT_MS THEN",
        "IF $TIMER[CELL_T_SILENT]>=(1000*CELL_SILENT_MS) THEN",
    )
    .of_programs(),
    change(
        "programs: the watchdog does not look at tool and water",
        SUBMIT_SOURCE_PATH,
        "IF (CELL_BUSY( ) OR CELL_AT_STAKE( )) AND",
        "IF CELL_BUSY( ) AND",
    )
    .of_programs(),
];
