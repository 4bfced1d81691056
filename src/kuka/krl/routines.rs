//! The controller's own routines, and the routines that KUKA delivers, with their arguments and return values. Sources:
//! README.md beside this file.

use std::collections::BTreeMap;
use std::sync::LazyLock;

/// A controller routine that the interpreter can execute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // each is the routine of its name
pub enum Builtin {
    Abs,
    Sqrt,
    Sin,
    Cos,
    Tan,
    Acos,
    Atan2,
    InvPos,
    Bas,
    IrStopm,
    Cwrite,
    Varstate,
    OnErrorProceed,
    ErrClear,
    EkiInit,
    EkiOpen,
    EkiClose,
    EkiClear,
    EkiCheckBuffer,
    EkiClearBuffer,
    EkiLock,
    EkiUnlock,
    EkiGetBool,
    EkiGetInt,
    EkiGetReal,
    EkiGetFrame,
    EkiSetBool,
    EkiSetInt,
    EkiSetReal,
    EkiSetFrame,
    EkiSend,
    EkiCheck,
}

/// How an argument is passed to a routine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ArgumentPassing {
    /// The argument is a value of this type.
    Value(&'static str),
    /// The argument is a variable of this type; it may be unassigned.
    Variable(&'static str),
    /// The argument is a variable of this type that has a value; without a value EthernetKRL stops the program.
    Filled(&'static str),
    /// Any argument.
    Any,
}

/// The signature of a routine of the controller.
#[derive(Debug)]
pub(super) struct KnownRoutine {
    /// The routine in the interpreter; `None` if calls of the routine are only checked.
    pub(super) builtin: Option<Builtin>,
    pub(super) argument_passing: Vec<ArgumentPassing>,
    /// Minimum number of arguments.
    pub(super) min_arguments: usize,
    /// Whether any number of further arguments may follow.
    pub(super) accepts_more: bool,
    /// The type of the routine's return value; `None` if it returns no value.
    pub(super) returns: Option<&'static str>,
    /// Whether the routine belongs to EthernetKRL 6; KSS 8 does not have it.
    pub(super) of_ethernet_krl_6: bool,
}

/// Returns the controller's routine with this name.
pub(super) fn find_routine(name: &str) -> Option<&'static KnownRoutine> {
    ROUTINES.get(name)
}

static ROUTINES: LazyLock<BTreeMap<&'static str, KnownRoutine>> = LazyLock::new(|| {
    let executed = EXECUTED_ROUTINES.iter().map(|(row, builtin)| parse_signature(row, Some(*builtin)));
    let checked = CHECKED_ROUTINES.iter().map(|row| parse_signature(row, None));
    let newer = ETHERNET_KRL_6_ROUTINES.iter().map(|row| {
        let (name, known) = parse_signature(row, None);
        (name, KnownRoutine { of_ethernet_krl_6: true, ..known })
    });
    executed.chain(checked).chain(newer).collect()
});

/// Returns whether a routine or variable exists only in EthernetKRL 6. A file that names it is written for EthernetKRL
/// 6.
pub(super) fn is_ethernet_krl_6_only(name: &str) -> bool {
    VARIABLES_OF_ETHERNET_KRL_6.contains(&name) || find_routine(name).is_some_and(|known| known.of_ethernet_krl_6)
}

/// Variables that exist only in EthernetKRL 6.
pub(super) const VARIABLES_OF_ETHERNET_KRL_6: [&str; 2] = ["EKIOK", "EKIINVALIDOPERATION"];

/// Parses a row of the tables below, `NAME arguments : type`. `TYPE` is an argument by value, `=TYPE` a variable,
/// `+TYPE` a variable that must have a value, and `*` any argument. `?` is written before the first optional argument,
/// and `…` stands for any number of further arguments.
fn parse_signature(row: &'static str, builtin: Option<Builtin>) -> (&'static str, KnownRoutine) {
    let (head, returns) = match row.split_once(" : ") {
        Some((head, returns)) => (head, Some(returns)),
        None => (row, None),
    };
    let mut words = head.split(' ');
    let name = words.next().unwrap_or_default();
    let (mut wants, mut required, mut open) = (Vec::new(), None, false);
    for word in words {
        match word.as_bytes().first() {
            Some(b'?') => required = Some(wants.len()),
            Some(b'=') => wants.push(ArgumentPassing::Variable(&word[1..])),
            Some(b'+') => wants.push(ArgumentPassing::Filled(&word[1..])),
            Some(b'*') => wants.push(ArgumentPassing::Any),
            _ if word == "…" => open = true,
            _ => wants.push(ArgumentPassing::Value(word)),
        }
    }
    let required = required.unwrap_or(wants.len());
    (
        name,
        KnownRoutine {
            builtin,
            argument_passing: wants,
            min_arguments: required,
            accepts_more: open,
            returns,
            of_ethernet_krl_6: false,
        },
    )
}

const EXECUTED_ROUTINES: [(&str, Builtin); 32] = [
    ("ABS NUMBER : REAL", Builtin::Abs),
    ("SQRT REAL : REAL", Builtin::Sqrt),
    ("SIN REAL : REAL", Builtin::Sin),
    ("COS REAL : REAL", Builtin::Cos),
    ("TAN REAL : REAL", Builtin::Tan),
    ("ACOS REAL : REAL", Builtin::Acos),
    ("ATAN2 REAL REAL : REAL", Builtin::Atan2),
    ("INV_POS FRAME : FRAME", Builtin::InvPos),
    ("BAS BAS_COMMAND ? REAL", Builtin::Bas),
    ("IR_STOPM", Builtin::IrStopm),
    ("CWRITE INT =STATE_T +MODUS_T TEXT …", Builtin::Cwrite),
    ("VARSTATE TEXT : VAR_STATE", Builtin::Varstate),
    ("ON_ERROR_PROCEED", Builtin::OnErrorProceed),
    ("ERR_CLEAR =ERROR_T", Builtin::ErrClear),
    ("EKI_INIT TEXT : EKI_STATUS", Builtin::EkiInit),
    ("EKI_OPEN TEXT : EKI_STATUS", Builtin::EkiOpen),
    ("EKI_CLOSE TEXT : EKI_STATUS", Builtin::EkiClose),
    ("EKI_CLEAR TEXT : EKI_STATUS", Builtin::EkiClear),
    ("EKI_CHECKBUFFER TEXT TEXT : EKI_STATUS", Builtin::EkiCheckBuffer),
    ("EKI_CLEARBUFFER TEXT TEXT : EKI_STATUS", Builtin::EkiClearBuffer),
    ("EKI_LOCK TEXT : EKI_STATUS", Builtin::EkiLock),
    ("EKI_UNLOCK TEXT : EKI_STATUS", Builtin::EkiUnlock),
    ("EKI_GETBOOL TEXT TEXT +BOOL : EKI_STATUS", Builtin::EkiGetBool),
    ("EKI_GETINT TEXT TEXT +INT : EKI_STATUS", Builtin::EkiGetInt),
    ("EKI_GETREAL TEXT TEXT +REAL : EKI_STATUS", Builtin::EkiGetReal),
    ("EKI_GETFRAME TEXT TEXT +FRAME : EKI_STATUS", Builtin::EkiGetFrame),
    ("EKI_SETBOOL TEXT TEXT BOOL : EKI_STATUS", Builtin::EkiSetBool),
    ("EKI_SETINT TEXT TEXT INT : EKI_STATUS", Builtin::EkiSetInt),
    ("EKI_SETREAL TEXT TEXT REAL : EKI_STATUS", Builtin::EkiSetReal),
    ("EKI_SETFRAME TEXT TEXT FRAME : EKI_STATUS", Builtin::EkiSetFrame),
    ("EKI_SEND TEXT TEXT ? INT : EKI_STATUS", Builtin::EkiSend),
    ("EKI_CHECK EKI_STATUS EKI_MODE ? TEXT", Builtin::EkiCheck),
];

/// Routines whose calls are only checked, grouped by subject: EthernetKRL; messages (MsgLib); texts; arithmetic and
/// poses; channels; signals, times and errors; motion parameters; sensors.
const CHECKED_ROUTINES: [&str; 123] = [
    "EKI_GETSTRING TEXT TEXT +TEXT : EKI_STATUS",
    "EKI_SETSTRING TEXT TEXT TEXT : EKI_STATUS",
    "EKI_GETBOOLARRAY TEXT TEXT +BOOL : EKI_STATUS",
    "EKI_GETINTARRAY TEXT TEXT +INT : EKI_STATUS",
    "EKI_GETREALARRAY TEXT TEXT +REAL : EKI_STATUS",
    "EKI_GETFRAMEARRAY TEXT TEXT +FRAME : EKI_STATUS",
    "EKI_SETBOOLARRAY TEXT TEXT * : EKI_STATUS",
    "EKI_SETINTARRAY TEXT TEXT * : EKI_STATUS",
    "EKI_SETREALARRAY TEXT TEXT * : EKI_STATUS",
    "EKI_SETFRAMEARRAY TEXT TEXT * : EKI_STATUS",
    "MSGNOTIFY …",
    "MSGSTATE …",
    "MSGQUIT …",
    "MSGDIALOG …",
    "MSGLOAD …",
    "MSGDELETE …",
    "MSGLOOP …",
    "SET_KRLMSG EKRLMSGTYPE =KRLMSG_T * =KRLMSGOPT_T : INT",
    "SET_KRLDLG =KRLMSG_T * * =KRLMSGOPT_T : INT",
    "EXISTS_KRLMSG INT : BOOL",
    "EXISTS_KRLDLG INT =INT : BOOL",
    "CLEAR_KRLMSG INT : BOOL",
    "SET_KRLDLGANSWER INT INT : BOOL",
    "GET_MSGBUFFER * : INT",
    "ISMESSAGESET INT : BOOL",
    "STRLEN TEXT : INT",
    "STRDECLLEN TEXT : INT",
    "STRCLEAR =TEXT : BOOL",
    "STRADD =TEXT TEXT : INT",
    "STRCOPY =TEXT TEXT : BOOL",
    "STRFIND INT TEXT TEXT CASE_SENSE_T : INT",
    "STRCOMP TEXT TEXT CASE_SENSE_T : BOOL",
    "STRTOBOOL TEXT =BOOL : BOOL",
    "STRTOINT TEXT =INT : BOOL",
    "STRTOREAL TEXT =REAL : BOOL",
    "STRTOSTRING TEXT =TEXT : BOOL",
    "STRTOFRAME TEXT =FRAME : BOOL",
    "STRTOPOS TEXT =POS : BOOL",
    "STRTOE3POS TEXT =E3POS : BOOL",
    "STRTOE6POS TEXT =E6POS : BOOL",
    "STRTOAXIS TEXT =AXIS : BOOL",
    "STRTOE3AXIS TEXT =E3AXIS : BOOL",
    "STRTOE6AXIS TEXT =E6AXIS : BOOL",
    "FRAND REAL REAL : REAL",
    "FORWARD E6AXIS =INT : E6POS",
    "INVERSE E6POS E6AXIS =INT : E6AXIS",
    "EK FRAME ESYS FRAME : FRAME",
    "LK FRAME TEXT FRAME ESYS : FRAME",
    "TOOL_ADJ * : FRAME",
    "COPEN * =INT",
    "CCLOSE INT =STATE_T",
    "CREAD INT =STATE_T MODUS_T REAL =INT TEXT …",
    "CIOCTL INT INT * TEXT =INT : INT",
    "CWAIT BOOL",
    "SREAD TEXT =STATE_T =INT TEXT …",
    "SWRITE =TEXT =STATE_T +INT TEXT …",
    "CAST_TO =TEXT INT * …",
    "CAST_FROM TEXT INT * …",
    "MBX_REC INT =STOPMESS : INT",
    "IOCTL TEXT INT INT : INT",
    "REMOTECMD TEXT TEXT : BOOL",
    "REMOTEREAD TEXT TEXT =INT : CHAR",
    "SYNCCMD * TEXT INT",
    "SYNC : INT",
    "PULSE * BOOL REAL",
    "GET_SIG_INF TEXT =TEXT …",
    "GETSYSSTATE TEXT =INT =REAL : BOOL",
    "IS_KEY_PRESSED INT : BOOL",
    "TIMER_LIMIT REAL : BOOL",
    "ERR_RAISE =ERROR_T",
    "GETVARSIZE * : INT",
    "VARTYPE TEXT : VAR_TYPE",
    "GETCYCDEF INT : CHAR",
    "GET_DECL_PLACE TEXT : CHAR",
    "DIAG_START * * : INT",
    "DIAG_STOP : INT",
    "GET_SYSTEM_DATA TEXT TEXT TEXT =INT : REAL",
    "SET_SYSTEM_DATA TEXT TEXT TEXT REAL : INT",
    "SET_SYSTEM_DATA_DELAYED TEXT TEXT TEXT REAL : INT",
    "WSPACEGIVE INT : BOOL",
    "WSPACETAKE INT INT : BOOL",
    "CANCELPROGSYNC * TEXT : RET_C_PSYNC_E",
    "DELETE_BACKWARD_BUFFER",
    "ROB_STOP ROB_STOP_T",
    "ROB_STOP_RELEASE",
    "SET_OPT_FILTER E6POS : INT",
    "SET_CD_PARAMS …",
    "RESET_CD_PARAMS …",
    "SVEL_JOINT * … : REAL",
    "SVEL_CP * … : CP",
    "SACC_JOINT * … : REAL",
    "SACC_CP * … : CP",
    "SGEAR_JERK * … : REAL",
    "SJERK * … : JERK_STRUC",
    "SAPO * … : CONT",
    "SAPO_PTP * … : CONT",
    "SORI_TYP * … : ORI_TYPE",
    "SCIRC_TYP * … : CIRC_TYPE",
    "SIPO_MODE * … : IPO_MODE",
    "SLOAD * … : LOAD",
    "STOOL * … : FRAME",
    "STOOL2 * … : FRAME",
    "SBASE * … : FRAME",
    "S_EXAX_IGN * : INT",
    "S_EXAX_IGN2 * : INT",
    "SCIRC_M * : CIRC_MODE",
    "USE_CM_PRO_VALUES * … : INT",
    "P00 P00_COMMAND * * INT",
    "P00_SUBM * *",
    "BASISTECH_PLC_INIT …",
    "BASISTECH_PLC_LOOP …",
    "RSI_CREATE TEXT ? =INT BOOL : INT",
    "RSI_DELETE ? INT : INT",
    "RSI_ON ? * * INT : INT",
    "RSI_OFF ? INT : INT",
    "RSI_MOVECORR ? * : INT",
    "RSI_SETPUBLICPAR INT TEXT TEXT REAL : INT",
    "RSI_GETPUBLICPAR INT TEXT TEXT =REAL : INT",
    "RSI_CHECKID INT : BOOL",
    "RSI_ENABLE INT : INT",
    "RSI_DISABLE INT : INT",
    "RSI_RESET : INT",
    "RSI_SHOW : INT",
];

const ETHERNET_KRL_6_ROUTINES: [&str; 3] =
    ["EKI_LOAD TEXT … : INT", "EKI_UNLOAD TEXT … : INT", "EKI_READNEXT TEXT … : INT"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_of_the_routine_tables_is_parsed() {
        assert_eq!(
            ROUTINES.len(),
            EXECUTED_ROUTINES.len() + CHECKED_ROUTINES.len() + ETHERNET_KRL_6_ROUTINES.len(),
            "a name twice"
        );
        let bas = find_routine("BAS").expect("it");
        assert_eq!(
            (bas.builtin, bas.min_arguments, bas.argument_passing.len(), bas.returns),
            (Some(Builtin::Bas), 1, 2, None)
        );
        let write = find_routine("CWRITE").expect("it");
        assert!(
            write.accepts_more && write.argument_passing[1] == ArgumentPassing::Variable("STATE_T"),
            "{write:?}"
        );
        assert_eq!(find_routine("STRLEN").map(|length| length.returns), Some(Some("INT")));
        assert!(
            find_routine("EKI_LOAD").is_some_and(|load| load.of_ethernet_krl_6)
                && find_routine("EKI_INIT").is_some()
        );
        assert!(find_routine("NOWHERE").is_none());
    }
}
