//! The controller's system variables that programs of a cell use.
//!
//! KUKA's public manuals define for each variable whether it stops the advance run, whether it is writable, and in
//! which versions of KSS it exists. An entry has a note if the manuals do not define one of these. The sources of the
//! other entries are in README.md beside this file.

use std::collections::BTreeMap;
use std::sync::LazyLock;

/// A version of KUKA System Software (KSS), for example `8.6`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Kss {
    /// The major version: the number before the dot.
    pub major: u8,
    /// The minor version: the number after the dot.
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
            _ => Err(format!("'{text}' is not a supported KSS version; valid: 8.2 to 8.7")),
        }
    }
}

/// The lowest version of KSS that the installation page supports.
pub const LOWEST_KSS: Kss = Kss { major: 8, minor: 3 };

/// A system variable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SystemVariable {
    /// With its `$`.
    pub name: &'static str,
    pub(super) type_name: &'static str,
    /// Number of array elements; 0 if the variable is not an array.
    pub(super) count: usize,
    pub(super) writable: bool,
    /// Whether an access to the variable stops the advance run until the arm has stopped.
    pub stops_advance: bool,
    /// The minor version of KSS 8 that introduced the variable.
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

/// The table of system variables. Access is `r` (read-only) or `w` (writable), followed by `s` (stops the advance run)
/// or `-` (does not stop it).
pub const SYSTEM_VARIABLES: [SystemVariable; 77] = [
    variable("$ACC", "CP", 0, "w-", 0),
    variable("$ACC_AXIS", "INT", 12, "w-", 0),
    variable("$ACC_MA", "CP", 0, "r-", 0),
    variable("$ACC_EXTAX", "INT", 6, "w-", 0),
    variable("$ADVANCE", "INT", 0, "w-", 0),
    variable("$ALARM_STOP", "BOOL", 0, "rs", 0),
    variable("$ALARM_STOP_INTERN", "BOOL", 0, "rs", 3),
    variable("$APO", "CONT", 0, "w-", 0),
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
    // This variable is used in public programs for 8.5 and 8.6, but the data lists of a controller with 8.3 do not
    // declare it.
    variable("$COULD_START_MOTION", "BOOL", 0, "rs", 5),
    variable("$CP_VEL_TYPE", "CP_VEL_TYPE", 0, "w-", 0),
    variable("$CYCFLAG", "BOOL", 256, "w-", 0),
    variable("$DATE", "DATE", 0, "r-", 0),
    variable("$DRIVES_OFF", "BOOL", 0, "rs", 0),
    variable("$DRIVES_ON", "BOOL", 0, "rs", 0),
    variable("$ERR", "ERROR_T", 0, "w-", 2),
    variable("$EXT", "BOOL", 0, "rs", 0),
    variable("$FLAG", "BOOL", 1024, "w-", 0),
    variable("$IN", "BOOL", 8192, "rs", 0),
    variable("$IN_HOME", "BOOL", 0, "rs", 0),
    variable("$IPO_MODE", "IPO_MODE", 0, "w-", 0),
    variable("$LOAD", "LOAD", 0, "w-", 0),
    variable("$LOAD_C", "LOAD", 0, "rs", 0),
    variable("$MODE_OP", "MODE_OP", 0, "r-", 0),
    variable("$MOVE_ENABLE", "BOOL", 0, "rs", 0),
    variable("$NULLFRAME", "FRAME", 0, "r-", 0),
    variable("$ON_PATH", "BOOL", 0, "rs", 0),
    variable("$ORI_TYPE", "ORI_TYPE", 0, "w-", 0),
    variable("$OUT", "BOOL", 8192, "ws", 0),
    variable("$OUT_C", "BOOL", 8192, "w-", 0),
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

/// Returns the index of this variable in [`SYSTEM_VARIABLES`].
pub(super) fn find(name: &str) -> Option<usize> {
    SYSTEM_VARIABLES.iter().position(|variable| variable.name == name)
}

/// A variable for which only the type is known, so that statements with it are not executed: a system variable, or a
/// variable that every `$config.dat` declares.
#[derive(Debug, Clone)]
pub(super) struct UnmodelledVariable {
    pub(super) type_name: &'static str,
    /// The number of dimensions; the sizes of the dimensions differ between controllers.
    pub(super) dimensions: usize,
}

/// Returns the variable with this name.
pub(super) fn find_variable(name: &str) -> Option<&'static UnmodelledVariable> {
    static UNMODELLED_VARIABLES: LazyLock<BTreeMap<&'static str, UnmodelledVariable>> = LazyLock::new(|| {
        let mut all = BTreeMap::new();
        for line in VARIABLE_NAMES_BY_TYPE.lines() {
            let mut words = line.split(' ');
            let type_name = words.next().unwrap_or_default();
            for word in words.filter(|word| !word.is_empty()) {
                let (name, sizes) = word.split_once('[').map_or((word, None), |(name, sizes)| (name, Some(sizes)));
                let dimensions = sizes.map_or(0, |sizes| 1 + sizes.matches(',').count());
                all.insert(name, UnmodelledVariable { type_name, dimensions });
            }
        }
        all
    });
    UNMODELLED_VARIABLES.get(name)
}

/// Each row has a type and its variables; `ANY` stands for an unspecified type. The system variables come first, then
/// those of `$config.dat`.
const VARIABLE_NAMES_BY_TYPE: &str = "\
BOOL $AUX_POWER $BRAKETEST_MONTIME $BRAKETEST_REQ_EX $BRAKETEST_REQ_INT $BRAKETEST_WARN $BWDSTART $CHCK_MOVENA $COLLMON_ACTIVE_COM $COLLMON_ACTIVE_PRO $COLL_ALARM $COLL_ENABLE \
$CONF_MESS $CONSENT $DATA_INTEGRITY $DRIVES_ENABLE $EXCLU $EXT_START $IMM_STOP $IMPROVED_COLLMON $IN_HOME1 $IN_HOME2 $IN_HOME3 $IN_HOME4 $IN_HOME5 $IOSIM_OPT $IS_OFFICE_LITE $I_O_ACT $I_O_ACTCONF $KCP_CONNECT \
$LINE_SEL_OK $LOOP_CONT $MASTERINGTEST_ACTIVE $MASTERINGTEST_REQ_EXT $MASTERINGTEST_REQ_INT $MASTERINGTEST_SWITCH_OK $MEAS_PULSE[] $MODE_AUTO $MODE_TEST $MOT_STOP $MOVE_BCO $NEAR_POSRET $OUT_NODRIVE $PAL_MODE $POWER_FAIL \
$PRO_START $SAFEGATE_OP $SAFETY_DRIVES_ENABLED $SHUTDOWN $SIMULATE $SS_MODE $TCP_IPO $TURN $US2_VOLTAGE_ON $WAIT_FOR_ON $WAIT_FOR_ON1 $WORKSTATE1 $WORKSTATE2 $WORKSTATE3 $WORKSTATE4 $WORKSTATE5 $WORKSTATE6 $WORKSTATE7 $WORKSTATE8 \
$DEF_A4FIX $DEF_A5LINK $ZERO_MOVE $ZUST_ASYNC
INT $ACT_EX_AX $ACT_GROUP $ASYNC_AXIS $ASYNC_EX_AX_DECOUPLE $BRAKE_SIG $COLLMON_IDX $COLLMON_MAX[] $COLLMON_TOL_ACT[] $COLLMON_TOL_COM[] $COLLMON_TOL_PRO[] $COLLMON_TOL_PRO_C[] $COLLMON_TOL_PRO_DEF[] \
$COUNT_I[] $DEF_FLT_CP $DEF_FLT_PTP $EX_AX_ASYNC $EX_AX_IGNORE $EX_AX_NUM $FILTER $INPOSITION $INTERPRETER $JUS_TOOL_NO $KR_SERIALNO $MASTERINGTEST_GROUP $MOT_TEMP[] $NUM_AX $NUM_IN $NUM_OUT $OV_ACT $OV_AJOG[] $OV_JOG \
$OV_ROB $ROBRUNTIME $SEN_PINT[] $SEN_PINT_C[] $SET_IO_SIZE $STOPMB_ID $TECH_MAX $TORQMON[] $TORQMON_COM[] $TORQMON_COM_DEF[] $TORQMON_DEF[] $TORQ_DIFF[] $TORQ_DIFF2[] $USER_LEVEL $VW_PSPS_STOP
REAL $ACT_POWER $ANIN[] $ANOUT[] $BRK_DEL $CAL_DIFF $CONST_VEL $CONST_VEL_C $CP_VEL_MODE $CURR_ACT[] $DEF_LA3_M $DEF_L_M $DIST_NEXT $FOL_ERROR[] $GEAR_JERK[] $JOINT_OFFSET[] $LENGTH_A $LENGTH_B $MAMES[] $MAMES_ACT[] \
$RAISE_TIME[] $RED_JUS_UEB $SEN_PREA[] $SEN_PREA_C[] $SOFTN_END[] $SOFTP_END[] $TORQUE_AXIS_ACT[] $VEL_ACT $VEL_AXIS_ACT[] $VEL_AXIS_MA[]
CHAR $DATAPATH[] $IPO_WAIT_FOR[] $JKMODE[] $LANGUAGE[] $LK_MASTER[] $LK_SLAVES[] $LOOP_MSG[] $MODEL_NAME[] $PRO_I_O[] $PRO_NAME[] $PRO_NAME1[] $RCV_INFO[] $ROBNAME[] $ROBTRAFO[] $TRACE_FOLDER[] \
$TRAFONAME[] $V_R1MADA[] $V_STEUMADA[] $WAIT_FOR[] $WAIT_FOR1[]
FRAME $DEF_LA3_CM $DEF_L_CM $ERSYSROOT $ROBROOT_C $TFLWP $TIRORO
E6AXIS $AXIS_HOME[] $H_AXIS_TOL[] $H_POS $H_POS_TOL
LOAD $LOAD_A1 $LOAD_A2 $LOAD_A3
INERTIA $DEF_LA3_J $DEF_L_J
CIRC_TYPE $CIRC_TYPE
CP $ACC_OV
JERK_STRUC $JERK $JERK_MA
DATE $DATE_HOST
ANY $ACCU_STATE $ADAP_ACC $ASYNC_STATE $AXWORKSPACE $CIRC_MODE $COOP_KRC $COSYS $DEVICE $ECO_LEVEL $EX_KIN $IOBUS_INFO $KINCLASS $MAIN_AXIS $MOTION_MODE $MOVE_STATE $MSG_T $PRO_IP $PRO_IP1 $PRO_MODE $PROG_INFO $RINT_LIST $SINT_LIST $SPL_TECH \
$SPL_TECH_C $SPL_VEL_MODE $TARGET_STATUS $TECH $TECHPAR $TECHPAR_C $TOOL_DIRECTION $TRACE $WAIT_STATE $WORKSPACE $WRIST_AXIS
E6AXIS XHOME XHOME1 XHOME2 XHOME3 XHOME4 XHOME5
FRAME TOOL_DATA[] BASE_DATA[] TOOL_CORR BASE_CORR M_BASE_CORR
LOAD LOAD_DATA[] LOAD_A1_DATA LOAD_A2_DATA LOAD_A3_DATA
CHAR TOOL_NAME[,] BASE_NAME[,]
FDAT FHOME FDAT_ACT
PDAT PDEFAULT PDAT_ACT
LDAT LDEFAULT LDAT_ACT
BOOL BASE_CORR_ON CHECK_HOME M_BAS_COR_ON STOPM_FLAG TOOL_CORR_ON TOOL_CORR_W_ON
INT APPL_RUN COMPL_GROUP DEF_ACC_PTP DEF_ADVANCE DEF_APO_CPTP DEF_APO_CVEL DEF_GROUP[] DEF_VEL_PTP ERR_TO_PLC MAX_BASE MAX_TOOL PGNO PGNO_ERROR PGNO_FBIT PGNO_FBIT_REFL PGNO_LENGTH PGNO_PARITY PGNO_REQ PGNO_TYPE PGNO_VALID POWER REFLECT_PROG_NR
REAL DEF_ACC_CP DEF_ACC_ORI1 DEF_ACC_ORI2 DEF_APO_CDIS DEF_APO_CORI DEF_VEL_CP DEF_VEL_FACT DEF_VEL_ORI1 DEF_VEL_ORI2 REDACCEXAX[] REDVELEXAX[]
ANY MACHINE_DEF MACHINE_FRAME_DAT MACHINE_TOOL_DAT ODAT_ACT";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn type_and_dimensions_of_a_known_variable_are_found() {
        let of = |name: &str| find_variable(name).map(|named| (named.type_name, named.dimensions));
        assert_eq!(of("$POWER_FAIL"), Some(("BOOL", 0)));
        assert_eq!(of("$ANIN"), Some(("REAL", 1)));
        assert_eq!(of("TOOL_NAME"), Some(("CHAR", 2)));
        assert_eq!(of("$NOWHERE"), None);
        assert!(
            SYSTEM_VARIABLES.iter().all(|variable| find_variable(variable.name).is_none()),
            "one place for each"
        );
    }
}
