//! KUKA's own types, as far as programs of a cell name them.
//!
//! A controller declares most of them in data lists of its own (`$operate.dat`, `$config.dat`). If these are
//! checked together with a program, their declarations count. A type that is missing here is reported as not
//! checked, never as wrong. Sources: README.md beside this file.

use super::declaration::parse_declaration;
use super::expression::TokenReader;
use super::lex::tokens;
use super::syntax::{DeclarationContent, Expression};
use super::types::{NewComponent, Scope, Type, Types};
use std::sync::LazyLock;

/// Declarations in KRL, each after the types that it names.
const TYPES: &str = "
STRUC FRAME REAL X,Y,Z,A,B,C
STRUC POS REAL X,Y,Z,A,B,C,INT S,T
STRUC E3POS REAL X,Y,Z,A,B,C,INT S,T,REAL E1,E2,E3
STRUC E6POS REAL X,Y,Z,A,B,C,INT S,T,REAL E1,E2,E3,E4,E5,E6
STRUC AXIS REAL A1,A2,A3,A4,A5,A6
STRUC E3AXIS REAL A1,A2,A3,A4,A5,A6,E1,E2,E3
STRUC E6AXIS REAL A1,A2,A3,A4,A5,A6,E1,E2,E3,E4,E5,E6
ENUM MODE_OP T1,T2,AUT,EX,INVALID
ENUM PRO_STATE P_FREE,P_RESET,P_ACTIVE,P_STOP,P_END,P_STOP_BP
ENUM PRO_IP_MODE GO,MSTEP,ISTEP,PSTEP,BSTEP,CSTEP
ENUM MODUS_T SYNC,ASYNC,COND,ABS,SEQ
ENUM CMD_STAT CMD_OK,CMD_TIMEOUT,DATA_OK,DATA_BLK,DATA_END,CMD_ABORT,CMD_REJ,CMD_PART,CMD_SYN,FMT_ERR
ENUM IPO_MODE BASE,TCP
ENUM ORI_TYPE VAR,CONSTANT,JOINT,IGNORE
ENUM CIRC_TYPE BASE,PATH
ENUM CP_VEL_TYPE CONSTANT,VAR_T1,VAR_ALL,VAR_ALL_MODEL
ENUM VAR_STATE DECLARED,INITIALIZED,UNKNOWN
ENUM CASE_SENSE_T CASE_SENS,NOT_CASE_SENS
ENUM ESYS NONE,EASYS,EBSYS,ECSYS,EDSYS,EESYS,EFSYS,ERSYS,ROBOT,CONVEYOR
ENUM DIRECTION FORWARD,BACKWARD
ENUM SW_ONOFF ON,OFF
ENUM APO_MODE_T CDIS,CPTP,CVEL,CORI
ENUM BAS_COMMAND INITMOV,ACC_CP,ACC_PTP,VEL_CP,VEL_PTP,ACC_GLUE,TOOL,BASE,EX_BASE,PTP_DAT,CP_DAT,FRAMES,CP_PARAMS,PTP_PARAMS,OUT_SYNC,OUT_ASYNC,GROUP
ENUM EKI_MODE NOTIFY,STATE,QUIT
ENUM EKRLMSGTYPE NOTIFY,STATE,QUIT,WAITING
ENUM KRLMSGPARTYPE_T VALUE,KEY,EMPTY
ENUM PROG_INT_E R_INT,S_INT,EXT_S_INT1,EXT_S_INT2,EXT_S_INT3,EXT_S_INT4,EXT_S_INT5,EXT_S_INT6,EXT_S_INT7
ENUM INT_TYP_E I_NORMAL,I_INTERRUPT,I_STOP_INTERRUPT
ENUM TRIGGER_UP_TYPE TRG_NONE,TRG_REGULAR,TRG_BACKWARD,TRG_RESTART,TRG_REPLAY,TRG_FORWARD
ENUM ROB_STOP_T RAMP_DOWN,PATH_MAINTAINING
STRUC CP REAL CP,ORI1,ORI2
STRUC CONT REAL CDIS,INT CPTP,CVEL,REAL CORI
STRUC INERTIA REAL X,Y,Z
STRUC LOAD REAL M,FRAME CM,INERTIA J
STRUC JERK_STRUC REAL CP,ORI,E6AXIS AX
STRUC DATE INT CSEC,SEC,MIN,HOUR,DAY,MONTH,YEAR
STRUC EKI_STATUS INT BUFF,READ,MSG_NO,BOOL CONNECTED,INT COUNTER
STRUC STATE_T CMD_STAT RET1,INT HITS,LENGTH,MSG_NO,CHAR MSG_TYPE,MSG_TXT[60]
STRUC ERROR_T INT NUMBER,PROG_INT_E INTERPRETER,INT_TYP_E INT_TYPE,INT INT_PRIO,LINE_NR,CHAR MODULE[24],UP_NAME[24],TRIGGER_UP_TYPE TRIGGER_TYPE
STRUC KRLMSG_T CHAR MODUL[24],INT NR,CHAR MSG_TXT[80]
STRUC KRLMSGPAR_T KRLMSGPARTYPE_T PAR_TYPE,CHAR PAR_TXT[26],INT PAR_INT,REAL PAR_REAL,BOOL PAR_BOOL
STRUC KRLMSGDLGSK_T KRLMSGPARTYPE_T SK_TYPE,CHAR SK_TXT[10]
STRUC KRLMSGOPT_T BOOL VL_STOP,CLEAR_P_RESET,CLEAR_P_SAW,LOG_TO_DB
STRUC STOPMESS INT CONFNO,GRO,MESSNO,STATE
STRUC FDAT INT TOOL_NO,BASE_NO,IPO_MODE IPO_FRAME,CHAR POINT2[24],BOOL TQ_STATE
STRUC PDAT REAL VEL,ACC,APO_DIST,APO_MODE_T APO_MODE,REAL GEAR_JERK,INT EXAX_IGN
STRUC LDAT REAL VEL,ACC,APO_DIST,APO_FAC,AXIS_VEL,AXIS_ACC,ORI_TYPE ORI_TYP,CIRC_TYPE CIRC_TYP,REAL JERK_FAC,GEAR_JERK,INT EXAX_IGN
STRUC BASIS_SUGG_T CHAR POINT1[24],POINT2[24],CP_PARAMS[24],PTP_PARAMS[24],CONT[24],CP_VEL[24],PTP_VEL[24],SYNC_PARAMS[24],SPL_NAME[24],A_PARAMS[24]
";

/// More of KUKA's own types, from machine data and from programs that KUKA delivers. Only their names are known:
/// their components are not checked.
const NAME_ONLY_TYPES: [&str; 39] = [
    "ACC_CAR",
    "ADAP_ACC",
    "AXBOX",
    "AXIS_OF_COORDINATES",
    "BOX",
    "BRAKE_STATE",
    "CIRC_MODE",
    "CONTROL_PARAMETER",
    "COOP_KRC",
    "CP_STATMON",
    "CYLINDER",
    "DHART",
    "EKO_MODE",
    "EMSTOP_PATH",
    "EXT_MOD_T",
    "EX_KIN",
    "FRA",
    "FUNCT_TYPE",
    "HDAT",
    "INDIVIDUAL_MAMES",
    "INSTALLED_MOTION_MODES",
    "KINCLASS",
    "MAIN_AXIS",
    "MODEL_TYPE",
    "MODULEPARAM_T",
    "MOTION_MODE",
    "MSGBUF_T",
    "P00_COMMAND",
    "PRO_IO_T",
    "SER",
    "SPIN",
    "SPLINE_PARA_VARIANT",
    "SPREADSTARTPOLICY",
    "STEP_ENUM",
    "SUPPLY_VOLTAGE",
    "TARGET_STATUS",
    "TRPSPIN",
    "WRIST_AXIS",
    "WS_CONFIG",
];

/// Returns whether KUKA has a type of this name with contents that are not known here.
pub(super) fn is_name_only_type(name: &str) -> bool {
    NAME_ONLY_TYPES.binary_search(&name).is_ok()
}

/// Returns all of KUKA's types; files are checked with a copy of them.
pub(super) fn kuka_types() -> &'static Types {
    static KUKA: LazyLock<Types> = LazyLock::new(|| {
        let mut types = Types::default();
        types.add_simple();
        for line in TYPES.lines() {
            add(&mut types, line);
        }
        types
    });
    &KUKA
}

fn add(types: &mut Types, line: &str) {
    let (tokens, _) = tokens(line);
    let Ok(declared) = parse_declaration(&mut TokenReader::new(&tokens), 1) else { return };
    match declared.kind {
        DeclarationContent::Enumeration { name, words } => {
            types.add_enumeration(Scope::Kuka, &name, words);
        }
        DeclarationContent::Struc { name, components } => {
            let placed = components.into_iter().map(|(type_name, item)| NewComponent {
                kind: types.find(&type_name, &[]).unwrap_or(Type::Unknown),
                dimensions: item.dimensions.iter().map(size).collect(),
                name: item.name,
            });
            let placed = placed.collect();
            types.add_struc(Scope::Kuka, &name, placed);
        }
        _ => {}
    }
}

fn size(dimension: &Option<Expression>) -> usize {
    match dimension {
        Some(Expression::Int(size)) => usize::try_from(*size).unwrap_or(0),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: six REAL, two INT, six REAL; RET1, HITS, LENGTH, MSG_NO, MSG_TYPE and sixty characters.
    #[test]
    fn each_line_is_a_type_and_knows_what_it_names() {
        let types = kuka_types();
        let lines = TYPES.lines().filter(|line| !line.is_empty()).count();
        assert_eq!(types.strucs.len() + types.enumerations.len(), lines);
        let components = types.strucs.iter().flat_map(|struc| &struc.components);
        assert_eq!(components.filter(|component| component.kind == Type::Unknown).count(), 0);
        assert_eq!([types.size(types.kuka_type("E6POS")), types.size(types.kuka_type("STATE_T"))], [14, 65]);
        assert!(
            NAME_ONLY_TYPES.is_sorted() && NAME_ONLY_TYPES.iter().all(|name| types.find(name, &[]).is_none()),
            "one place for each"
        );
    }
}
