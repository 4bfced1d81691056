//! Errors that are injected by hand into the programs, one at a time: a walk or a scene must detect each of them.

use super::scenes::first_wrong;
use super::{behaviour_variant, load, texts, walk};
use panelprep::devices::mock::Programs;
use rayon::prelude::*;

/// An injected error: the file, the shipped text, its replacement, and a walk that detects it. If no walk is known, a
/// scene must detect it.
struct Mistake {
    name: &'static str,
    file: &'static str,
    ships: &'static str,
    planted: &'static str,
    seed: Option<u64>,
}

const fn mistake(
    name: &'static str,
    file: &'static str,
    ships: &'static str,
    planted: &'static str,
    seed: Option<u64>,
) -> Mistake {
    Mistake { name, file, ships, planted, seed }
}

#[rustfmt::skip] // a row for each mistake
const MISTAKES: [Mistake; 43] = [
    mistake(
        "a stop leaves the epoch open", "cell_submit.src",
        "  CELL_OPEN=FALSE\n  CELL_STOPPED=TRUE\n",
        "  CELL_STOPPED=TRUE\n",
        Some(0),
    ),
    mistake(
        "a stop raises the flag of a halt", "cell_submit.src",
        "    $FLAG[CELL_F_STOP]=TRUE\n  ENDIF\nEND",
        "    $FLAG[CELL_F_HALT]=TRUE\n  ENDIF\nEND",
        Some(0),
    ),
    mistake(
        "a stop raises no flag", "cell_submit.src",
        "  ELSE\n    $FLAG[CELL_F_STOP]=TRUE\n  ENDIF\nEND",
        "  ENDIF\nEND",
        Some(49),
    ),
    mistake(
        "a foreign program is reset", "cell_submit.src",
        "CELL_RESET_DUE=CELL_READY",
        "CELL_RESET_DUE=TRUE",
        Some(14),
    ),
    mistake(
        "counts are told for another epoch", "cell_submit.src",
        "  IF CELL_RUN_EP==CELL_EP THEN\n    RETURN CELL_DONE\n  ENDIF\n  RETURN 0",
        "  RETURN CELL_DONE",
        None,
    ),
    mistake(
        "a program that is gone leaves its epoch open", "cell_submit.src",
        "    IF CELL_OPEN AND (CELL_READY OR CELL_BUSY( )) THEN\n      CELL_STOP(FALSE)\n    ENDIF\n",
        "",
        Some(277),
    ),
    mistake(
        "the queue of a program that is gone is kept", "cell_submit.src",
        "    CELL_QR=0\n    CELL_QW=0\n",
        "",
        None,
    ),
    mistake(
        "drives off ends no epoch", "cell_submit.src",
        "  IF CELL_SAFE_WAS AND (NOT SAFE) THEN\n    CELL_STOP(TRUE)\n  ENDIF\n",
        "",
        None,
    ),
    mistake(
        "the robot program's own end is not heard", "cell_submit.src",
        "  IF CELL_DEAD_EP==CELL_EP THEN\n    IF",
        "  IF CELL_DEAD_EP==CELL_EP+1 THEN\n    IF",
        None,
    ),
    mistake(
        "the watchdog is ten times as patient", "cell_submit.src",
        "($TIMER[CELL_T_HEARD]>=CELL_WATCHDOG_MS)",
        "($TIMER[CELL_T_HEARD]>=10*CELL_WATCHDOG_MS)",
        Some(20),
    ),
    mistake(
        "no person watches a contact without motion", "cell_submit.src",
        "IF LATE OR ($TIMER[CELL_T_STILL]>=CELL_DWELL_MS) THEN",
        "IF FALSE THEN",
        None,
    ),
    mistake(
        "a late trigger hides a contact", "cell_submit.src",
        "  FOR I=0 TO CELL_Q_N-1\n",
        "  FOR I=0 TO 0\n",
        None,
    ),
    mistake(
        "an index of the queue is one too high", "cell_submit.src",
        "      K=K-(K/CELL_Q_N)*CELL_Q_N+1\n      IF CELL_Q_TOUCH",
        "      K=K-(K/CELL_Q_N)*CELL_Q_N+2\n      IF CELL_Q_TOUCH",
        Some(3),
    ),
    mistake(
        "the submit interpreter shows no sign of life", "cell_submit.src",
        "  $TIMER[CELL_T_SUBMIT]=-CELL_WATCHDOG_MS\n",
        "",
        Some(0),
    ),
    mistake(
        "commands are read before requests", "cell_submit.src",
        "  CELL_REQUESTS( )\n  CELL_COMMANDS( )\n",
        "  CELL_COMMANDS( )\n  CELL_REQUESTS( )\n",
        None,
    ),
    mistake(
        "a start of the submit interpreter believes that the program of before is still selected", "cell_submit.src",
        "  CELL_READY=FALSE\n  ; What an epoch",
        "  ; What an epoch",
        None,
    ),
    mistake(
        "a lost link ends no epoch", "cell_link.src",
        "  IF CELL_OPEN THEN\n    CELL_STOP(FALSE)\n  ENDIF\nEND",
        "END",
        Some(128),
    ),
    mistake(
        "a lost command channel is not opened again", "cell_link.src",
        "(NOT $FLAG[CELL_F_CMD_ALIVE]) THEN\n    CELL_LOST( )\n    CELL_OPEN_CMD( )\n",
        "(NOT $FLAG[CELL_F_CMD_ALIVE]) THEN\n    CELL_LOST( )\n",
        Some(18),
    ),
    mistake(
        "silence opens one channel only", "cell_link.src",
        "    CELL_OPEN_CMD( )\n    CELL_OPEN_STAT( )\n  ENDIF\n  CELL_TRY",
        "    CELL_OPEN_CMD( )\n  ENDIF\n  CELL_TRY",
        Some(583),
    ),
    mistake(
        "a channel is initialised without being cleared", "cell_link.src",
        "  IF CELL_CMD_MADE THEN\n    RET=EKI_Clear(\"CELLCMD\")\n  ENDIF\n",
        "",
        Some(69),
    ),
    mistake(
        "a channel that did not open is not tried again", "cell_link.src",
        "  CELL_TRY_OPEN( )\nEND",
        "END",
        Some(128),
    ),
    mistake(
        "one request may use the epoch up", "cell_link.src",
        "RETURN ((NUMBER-CELL_EP)<=CELL_EPOCH_STEP)",
        "RETURN TRUE",
        Some(289),
    ),
    mistake(
        "an epoch replaces one that moves without a stop", "cell_link.src",
        "    IF CELL_OPEN AND CELL_BUSY( ) THEN\n      CELL_STOP(FALSE)\n    ENDIF\n    CELL_OPEN=FALSE\n",
        "",
        None,
    ),
    mistake(
        "a reset forgets to allow commands", "cell_link.src",
        "    CELL_STOPPED=FALSE\n",
        "",
        Some(0),
    ),
    mistake(
        "an epoch begins with the count of the last one", "cell_link.src",
        "  CELL_RX=0\n  CELL_ERR=0\n",
        "  CELL_ERR=0\n",
        Some(0),
    ),
    mistake(
        "a command of an ended epoch is judged", "cell_link.src",
        "  IF CMD.EP<CELL_EP THEN\n    RETURN\n  ENDIF\n",
        "",
        Some(27),
    ),
    mistake(
        "a place of the ring is one too high", "cell_link.src",
        "  SLOT=SLOT-(SLOT/CELL_RING_N)*CELL_RING_N+1\n  CELL_RING",
        "  SLOT=SLOT-(SLOT/CELL_RING_N)*CELL_RING_N+2\n  CELL_RING",
        Some(0),
    ),
    mistake(
        "N1 and N2 are mixed up", "cell_link.src",
        "RET=EKI_GetInt(\"CELLCMD\",\"Cmd/@N1\",CMD.N1)",
        "RET=EKI_GetInt(\"CELLCMD\",\"Cmd/@N2\",CMD.N1)",
        Some(0),
    ),
    mistake(
        "what is left in the memory is forgotten", "cell_link.src",
        "  CELL_CMD_MORE=(RET.Buff>0)\n",
        "  CELL_CMD_MORE=FALSE\n",
        Some(125),
    ),
    mistake(
        "an abort stops nothing", "cell_link.src",
        "  DECL INT NUMBER\n  CELL_STOP(FALSE)\n",
        "  DECL INT NUMBER\n",
        Some(0),
    ),
    mistake(
        "a command may follow a missing one", "cell_judge.src",
        "  IF CMD.ID<>CELL_RX+1 THEN\n    RETURN CELL_E_ID_GAP\n  ENDIF\n",
        "",
        Some(100),
    ),
    mistake(
        "a line beside a running tool is judged by no override", "cell_judge.src",
        "IF ((CMD.N2==1) OR CELL_AT_STAKE( )) AND",
        "IF (CMD.N2==1) AND",
        None,
    ),
    mistake(
        "a line beside a running tool is judged by no length", "cell_judge.src",
        "      IF CELL_AT_STAKE( ) AND (NOT CELL_SHORT(CMD)) THEN\n        RETURN CELL_E_SPACE\n      ENDIF\n",
        "",
        None,
    ),
    mistake(
        "a speed is not judged", "cell_judge.src",
        "(CMD.R1>0.0) AND (CMD.R1<=CELL_VEL_MAX) AND",
        "(CMD.R1>0.0) AND",
        Some(165),
    ),
    mistake(
        "an epoch of before the program's start is begun", "cell_motion.src",
        "  CELL_DEAD_EP=CELL_EP\n  ; Block",
        "  ; Block",
        None,
    ),
    mistake(
        "an epoch that was left in contact is not retracted from", "cell_motion.src",
        "    IF CELL_BEHIND AND (NOT $FLAG[CELL_F_HALT]) THEN\n      CELL_RETRACT=TRUE\n    ENDIF\n",
        "",
        None,
    ),
    mistake(
        "a retract is asked for and not made", "cell_motion.src",
        "      CELL_RETREAT( )\n",
        "",
        Some(0),
    ),
    mistake(
        "an epoch that has ended is begun again", "cell_motion.src",
        "    IF CELL_OPEN AND (CELL_DEAD_EP<>CELL_EP) AND (NOT",
        "    IF (NOT",
        None,
    ),
    mistake(
        "the interrupt of a stop is off", "cell_motion.src",
        "  INTERRUPT ON 20\n  INTERRUPT ON 21\n  INTERRUPT ON 22\n",
        "  INTERRUPT ON 20\n  INTERRUPT ON 22\n",
        Some(49),
    ),
    mistake(
        "the base is not told back", "cell_motion.src",
        "      CELL_BASE=$BASE\n      CELL_BASE_SET=TRUE",
        "      CELL_BASE_SET=TRUE",
        Some(0),
    ),
    mistake(
        "a contact is not noted", "cell_motion.src",
        "  CELL_Q_TOUCH[K]=TOUCH\n",
        "  CELL_Q_TOUCH[K]=FALSE\n",
        Some(0),
    ),
    mistake(
        "another motion's command is reported as executed", "cell_motion.src",
        "    CELL_DONE=CELL_Q_ID[K]\n",
        "    CELL_DONE=CELL_Q_ID[1]\n",
        Some(0),
    ),
    mistake(
        "the retract goes into the panel", "cell_motion.src",
        "  AWAY.Z=-CELL_RETRACT_MM\n",
        "  AWAY.Z=CELL_RETRACT_MM\n",
        Some(0),
    ),
];

fn planted(mistake: &Mistake) -> Programs {
    let mut texts = texts("config/kuka");
    let (_, text) = texts.iter_mut().find(|(name, _)| name == mistake.file).expect("a file");
    assert_eq!(text.matches(mistake.ships).count(), 1, "{}: the text that ships", mistake.name);
    *text = text.replace(mistake.ships, mistake.planted);
    load(&texts)
}

/// Returns the first of these walks that detects the error, and the violated requirement.
fn first_detecting_walk(programs: &Programs, seeds: std::ops::Range<u64>) -> Option<(u64, String)> {
    seeds.into_par_iter().find_map_first(|seed| {
        walk(seed, programs, behaviour_variant(seed)).1.err().map(|violation| (seed, violation))
    })
}

/// Each error is detected by a scene, or by a walk in which the shipped programs violate no requirement. `KRL_FIND=400`
/// searches for such walks again; `KRL_NAME=speed` limits the search to errors with this word in their name.
#[test]
fn planted_mistakes_in_the_programs_are_found() {
    let anew: Option<u64> = std::env::var("KRL_FIND").ok().and_then(|walks| walks.parse().ok());
    let ships = load(&texts("config/kuka"));
    let mut missed = Vec::new();
    let named = std::env::var("KRL_NAME").unwrap_or_default();
    for mistake in MISTAKES.iter().filter(|mistake| anew.is_none() || mistake.name.contains(&named)) {
        let programs = planted(mistake);
        let seeds = match (anew, mistake.seed) {
            (Some(walks), _) => 0..walks,
            (None, Some(seed)) => seed..seed + 1,
            (None, None) => 0..0,
        };
        let walked = first_detecting_walk(&programs, seeds);
        if let Some((seed, _)) = walked {
            assert_eq!(walk(seed, &ships, behaviour_variant(seed)).1, Ok(()), "{}", mistake.name);
        }
        let shown = if walked.is_none() { first_wrong(&programs) } else { None };
        println!("{}: {walked:?} {shown:?}", mistake.name);
        if walked.is_none() && shown.is_none() {
            missed.push(mistake.name);
        }
    }
    println!("not found: {missed:?}");
    assert!(missed.is_empty(), "not found: {missed:?}");
}
