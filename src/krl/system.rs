//! The controller's own variables and routines, as far as programs of a cell use them.
//!
//! What a variable does to the advance run, who may write it, and in which versions of KSS it exists, follows KUKA's
//! public manuals; where they are silent it is said beside the entry.

use super::types::{Type, Types};

/// A version of KUKA System Software, as `8.6`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Kss {
    /// The number before the dot.
    pub major: u8,
    /// The number behind it.
    pub minor: u8,
}

impl std::fmt::Display for Kss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

impl std::str::FromStr for Kss {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |part: &str| part.parse().ok();
        let found = text.split_once('.').and_then(|(major, minor)| Some((number(major)?, number(minor)?)));
        match found {
            Some((8, minor @ 2..=7)) => Ok(Kss { major: 8, minor }),
            _ => Err(format!("'{text}' is no version of KSS that is known here; allowed: 8.2 to 8.7")),
        }
    }
}

/// The lowest version that the installation page names.
pub const LOWEST_KSS: Kss = Kss { major: 8, minor: 3 };

/// A system variable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SystemVariable {
    /// With its `$`.
    pub name: &'static str,
    pub(super) type_name: &'static str,
    /// Elements of an array; 0 where it is none.
    pub(super) count: usize,
    pub(super) writable: bool,
    /// Reading or writing it lets the advance run wait for the arm.
    pub stops_advance: bool,
    /// Since this minor version of KSS 8.
    pub(super) since: u8,
}

const fn variable(
    name: &'static str,
    type_name: &'static str,
    count: usize,
    access: &str,
    since: u8,
) -> SystemVariable {
    let access = access.as_bytes();
    let writable = access[0] == b'w';
    SystemVariable { name, type_name, count, writable, stops_advance: access[1] == b's', since }
}

/// Access: `r` read only or `w` writable; `s` stops the advance run or `-` does not.
pub const SYSTEM_VARIABLES: [SystemVariable; 77] = [
    variable("$ACC", "CP", 0, "w-", 0),
    variable("$ACC_AXIS", "INT", 12, "w-", 0),
    variable("$ACC_MA", "CP", 0, "r-", 0),
    variable("$ACC_EXTAX", "INT", 6, "w-", 0),
    variable("$ADVANCE", "INT", 0, "w-", 0),
    variable("$ALARM_STOP", "BOOL", 0, "rs", 0),
    variable("$ALARM_STOP_INTERN", "BOOL", 0, "rs", 3),
    variable("$APO", "APO", 0, "w-", 0),
    variable("$AUT", "BOOL", 0, "rs", 0),
    variable("$AXIS_ACT", "E6AXIS", 0, "rs", 0),
    variable("$AXIS_ACT_MEAS", "E6AXIS", 0, "rs", 0),
    variable("$AXIS_BACK", "E6AXIS", 0, "rs", 0),
    variable("$AXIS_FOR", "E6AXIS", 0, "rs", 0),
    variable("$AXIS_INT", "E6AXIS", 0, "rs", 0),
    variable("$AXIS_RET", "E6AXIS", 0, "rs", 0),
    variable("$BASE", "FRAME", 0, "w-", 0),
    variable("$BASE_C", "FRAME", 0, "rs", 0),
    variable("$CMD", "INT", 0, "r-", 0),
    // Read in public programs for 8.5 and 8.6; a data list of an 8.3 does not declare it.
    variable("$COULD_START_MOTION", "BOOL", 0, "rs", 5),
    variable("$CP_VEL_TYPE", "CP_VEL_TYPE", 0, "w-", 0),
    variable("$CYCFLAG", "BOOL", 256, "w-", 0),
    variable("$DATE", "DATE", 0, "r-", 0),
    variable("$DRIVES_OFF", "BOOL", 0, "rs", 0),
    variable("$DRIVES_ON", "BOOL", 0, "rs", 0),
    variable("$ERR", "ERROR_T", 0, "w-", 2),
    variable("$EXT", "BOOL", 0, "rs", 0),
    variable("$FLAG", "BOOL", 1024, "w-", 0),
    variable("$IN", "BOOL", 4096, "rs", 0),
    variable("$IN_HOME", "BOOL", 0, "rs", 0),
    variable("$IPO_MODE", "IPO_MODE", 0, "w-", 0),
    variable("$LOAD", "LOAD", 0, "w-", 0),
    variable("$LOAD_C", "LOAD", 0, "rs", 0),
    variable("$MODE_OP", "MODE_OP", 0, "r-", 0),
    variable("$MOVE_ENABLE", "BOOL", 0, "rs", 0),
    variable("$NULLFRAME", "FRAME", 0, "r-", 0),
    variable("$ON_PATH", "BOOL", 0, "rs", 0),
    variable("$ORI_TYPE", "ORI_TYPE", 0, "w-", 0),
    variable("$OUT", "BOOL", 4096, "ws", 0),
    variable("$OUT_C", "BOOL", 4096, "w-", 0),
    variable("$OV_PRO", "INT", 0, "w-", 0),
    variable("$PERI_RDY", "BOOL", 0, "rs", 0),
    variable("$POS_ACT", "E6POS", 0, "rs", 0),
    variable("$POS_ACT_MES", "E6POS", 0, "rs", 0),
    variable("$POS_BACK", "E6POS", 0, "rs", 0),
    variable("$POS_FOR", "E6POS", 0, "rs", 0),
    variable("$POS_INT", "E6POS", 0, "rs", 0),
    variable("$POS_RET", "E6POS", 0, "rs", 0),
    variable("$PRO_ACT", "BOOL", 0, "rs", 0),
    variable("$PRO_IP_MODE", "PRO_IP_MODE", 0, "r-", 0),
    variable("$PRO_MODE1", "PRO_IP_MODE", 0, "r-", 0),
    variable("$PRO_MOVE", "BOOL", 0, "rs", 0),
    variable("$PRO_STATE", "PRO_STATE", 0, "r-", 0),
    variable("$PRO_STATE0", "PRO_STATE", 0, "r-", 0),
    variable("$PRO_STATE1", "PRO_STATE", 0, "r-", 0),
    variable("$RC_RDY1", "BOOL", 0, "rs", 0),
    variable("$ROBROOT", "FRAME", 0, "r-", 0),
    variable("$ROB_CAL", "BOOL", 0, "rs", 0),
    variable("$ROB_STOPPED", "BOOL", 0, "rs", 0),
    variable("$ROB_TIMER", "INT", 0, "r-", 0),
    variable("$SPEED", "CP", 0, "r-", 0),
    variable("$STOPMESS", "BOOL", 0, "rs", 0),
    variable("$STOPNOAPROX", "BOOL", 0, "w-", 0),
    variable("$T1", "BOOL", 0, "rs", 0),
    variable("$T2", "BOOL", 0, "rs", 0),
    variable("$TIMER", "INT", 64, "w-", 0),
    variable("$TIMER_FLAG", "BOOL", 64, "w-", 0),
    variable("$TIMER_STOP", "BOOL", 64, "w-", 0),
    variable("$TOOL", "FRAME", 0, "w-", 0),
    variable("$TOOL_C", "FRAME", 0, "rs", 0),
    variable("$USER_SAF", "BOOL", 0, "rs", 0),
    variable("$VEL", "CP", 0, "w-", 0),
    variable("$VEL_AXIS", "INT", 12, "w-", 0),
    variable("$VEL_EXTAX", "INT", 6, "w-", 0),
    variable("$VEL_MA", "CP", 0, "r-", 0),
    variable("$WORLD", "FRAME", 0, "r-", 0),
    variable("$ACT_BASE", "INT", 0, "w-", 0),
    variable("$ACT_TOOL", "INT", 0, "w-", 0),
];

/// The place of this variable in [`SYSTEM_VARIABLES`].
pub(super) fn find(name: &str) -> Option<usize> {
    SYSTEM_VARIABLES.iter().position(|variable| variable.name == name)
}

/// A routine of the controller, told apart by its place in the list of routines.
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

/// How an argument of the controller's own routines is handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wants {
    /// A value of this type.
    Value(&'static str),
    /// A variable of this type, whatever it holds.
    Variable(&'static str),
    /// A variable of this type that must hold a value before: EthernetKRL stops the program else.
    Filled(&'static str),
}

/// Name, routine, arguments, type of its value; empty where it has none.
pub(super) type Row = (&'static str, Builtin, &'static [Wants], &'static str);

const TEXT: Wants = Wants::Value("TEXT");

/// The controller's own routines.
#[rustfmt::skip] // a row for each routine
pub(super) const BUILTINS: [Row; 32] = [
    ("ABS", Builtin::Abs, &[Wants::Value("NUMBER")], "REAL"),
    ("SQRT", Builtin::Sqrt, &[Wants::Value("REAL")], "REAL"),
    ("SIN", Builtin::Sin, &[Wants::Value("REAL")], "REAL"),
    ("COS", Builtin::Cos, &[Wants::Value("REAL")], "REAL"),
    ("TAN", Builtin::Tan, &[Wants::Value("REAL")], "REAL"),
    ("ACOS", Builtin::Acos, &[Wants::Value("REAL")], "REAL"),
    ("ATAN2", Builtin::Atan2, &[Wants::Value("REAL"), Wants::Value("REAL")], "REAL"),
    ("INV_POS", Builtin::InvPos, &[Wants::Value("FRAME")], "FRAME"),
    ("BAS", Builtin::Bas, &[Wants::Value("BAS_COMMAND"), Wants::Value("REAL")], ""),
    ("IR_STOPM", Builtin::IrStopm, &[], ""),
    ("CWRITE", Builtin::Cwrite, &[Wants::Value("INT"), Wants::Variable("STATE_T"), Wants::Filled("MODUS_T"), TEXT], ""),
    ("VARSTATE", Builtin::Varstate, &[TEXT], "VAR_STATE"),
    ("ON_ERROR_PROCEED", Builtin::OnErrorProceed, &[], ""),
    ("ERR_CLEAR", Builtin::ErrClear, &[Wants::Variable("ERROR_T")], ""),
    ("EKI_INIT", Builtin::EkiInit, &[TEXT], "EKI_STATUS"),
    ("EKI_OPEN", Builtin::EkiOpen, &[TEXT], "EKI_STATUS"),
    ("EKI_CLOSE", Builtin::EkiClose, &[TEXT], "EKI_STATUS"),
    ("EKI_CLEAR", Builtin::EkiClear, &[TEXT], "EKI_STATUS"),
    ("EKI_CHECKBUFFER", Builtin::EkiCheckBuffer, &[TEXT, TEXT], "EKI_STATUS"),
    ("EKI_CLEARBUFFER", Builtin::EkiClearBuffer, &[TEXT, TEXT], "EKI_STATUS"),
    ("EKI_LOCK", Builtin::EkiLock, &[TEXT], "EKI_STATUS"),
    ("EKI_UNLOCK", Builtin::EkiUnlock, &[TEXT], "EKI_STATUS"),
    ("EKI_GETBOOL", Builtin::EkiGetBool, &[TEXT, TEXT, Wants::Filled("BOOL")], "EKI_STATUS"),
    ("EKI_GETINT", Builtin::EkiGetInt, &[TEXT, TEXT, Wants::Filled("INT")], "EKI_STATUS"),
    ("EKI_GETREAL", Builtin::EkiGetReal, &[TEXT, TEXT, Wants::Filled("REAL")], "EKI_STATUS"),
    ("EKI_GETFRAME", Builtin::EkiGetFrame, &[TEXT, TEXT, Wants::Filled("FRAME")], "EKI_STATUS"),
    ("EKI_SETBOOL", Builtin::EkiSetBool, &[TEXT, TEXT, Wants::Value("BOOL")], "EKI_STATUS"),
    ("EKI_SETINT", Builtin::EkiSetInt, &[TEXT, TEXT, Wants::Value("INT")], "EKI_STATUS"),
    ("EKI_SETREAL", Builtin::EkiSetReal, &[TEXT, TEXT, Wants::Value("REAL")], "EKI_STATUS"),
    ("EKI_SETFRAME", Builtin::EkiSetFrame, &[TEXT, TEXT, Wants::Value("FRAME")], "EKI_STATUS"),
    ("EKI_SEND", Builtin::EkiSend, &[TEXT, TEXT], "EKI_STATUS"),
    ("EKI_CHECK", Builtin::EkiCheck, &[Wants::Value("EKI_STATUS"), Wants::Value("EKI_MODE")], ""),
];

/// The type of a wanted argument; `None` for what is not one type, NUMBER and TEXT.
pub(super) fn wanted_type(types: &Types, name: &str) -> Option<Type> {
    match name {
        "TEXT" => Some(Type::Text),
        _ => types.find(name),
    }
}
