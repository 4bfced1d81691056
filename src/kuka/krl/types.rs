//! The types of KRL, and the number of memory cells of each type: a simple value has one cell, a structure has the
//! cells of its components in their order.
//!
//! A type is declared in a routine, in a module or for all files. KUKA's own types are always known and may be declared
//! again, as the controller's data lists do (`$operate.dat`, `$config.dat`). If these data lists are checked together
//! with a program, their declarations are used. Only the types that programs of a cell use are listed here. A type that
//! is not listed is reported as not checked, never as an error. Sources: README.md beside this file.

use super::expression::{TokenReader, parse_declaration};
use super::lex::tokens;
use super::syntax::{DeclarationContent, Expression, MAX_LISTED};
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    /// An unknown type, whose declaration is missing. It is reported once, where a declaration names it.
    Unknown,
    /// 32 bits.
    Int,
    /// 32 bits.
    Real,
    /// TRUE or FALSE.
    Bool,
    /// One character.
    Char,
    /// A string literal in quotation marks.
    Text,
    /// A constant of this enumeration.
    Enumeration(usize),
    /// A structure.
    Struc(usize),
}

/// One component of a structure.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// In upper case.
    pub name: String,
    /// The type of the component.
    pub kind: Type,
    /// The size of each dimension, if the component is an array.
    pub dimensions: Vec<usize>,
    /// Number of cells before the component in its structure.
    pub offset: usize,
}

/// A structure.
#[derive(Debug, Clone, PartialEq)]
pub struct Struc {
    /// In upper case.
    pub name: String,
    /// Components in their order.
    pub components: Vec<Component>,
    /// The index of each component, by its name.
    places: BTreeMap<String, usize>,
    /// Number of cells.
    pub size: usize,
    /// Whether the structure is KUKA's own and no file declares it; it may then have components that are not known
    /// here.
    pub(super) kuka: bool,
}

impl Struc {
    /// Returns the component of this name.
    pub(super) fn component(&self, name: &str) -> Option<&Component> {
        self.places.get(name).and_then(|place| self.components.get(*place))
    }
}

/// An enumeration.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Enumeration {
    pub(super) name: String,
    pub(super) words: Vec<String>,
    places: BTreeMap<String, u16>,
    /// Whether the enumeration is KUKA's own and no file declares it; it may then have constants that are not known
    /// here.
    pub(super) kuka: bool,
}

/// The scope in which a type is visible. If a name is declared in several scopes, the innermost one is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Scope {
    Routine {
        file: usize,
        place: usize,
    },
    Module(usize),
    Everywhere,
    /// The controller's own.
    Kuka,
}

/// All known types.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Types {
    strucs: Vec<Struc>,
    pub(super) enumerations: Vec<Enumeration>,
    names: BTreeMap<String, Vec<(Scope, Type)>>,
}

/// A component whose memory offset is not computed yet.
pub(super) struct NewComponent {
    pub(super) name: String,
    pub(super) kind: Type,
    pub(super) dimensions: Vec<usize>,
}

/// KUKA's pose types, from the shortest to the longest; each has the components of the previous one and further ones.
const POSE_TYPES: [&str; 4] = ["FRAME", "POS", "E3POS", "E6POS"];
/// KUKA's types of axis positions, in the same order as the pose types.
const AXIS_TYPES: [&str; 3] = ["AXIS", "E3AXIS", "E6AXIS"];

impl Types {
    /// Adds the simple types.
    fn add_simple(&mut self) {
        for (name, kind) in [("INT", Type::Int), ("REAL", Type::Real), ("BOOL", Type::Bool), ("CHAR", Type::Char)] {
            self.names.insert(name.to_owned(), vec![(Scope::Kuka, kind)]);
        }
    }

    /// Returns the type with this name that is visible in the scopes. KUKA's own types are searched last.
    pub(super) fn find(&self, name: &str, scopes: &[Scope]) -> Option<Type> {
        let known = self.names.get(name)?;
        let of = |scope: &Scope| known.iter().find(|(known, _)| known == scope).map(|(_, kind)| *kind);
        scopes.iter().chain(&[Scope::Everywhere, Scope::Kuka]).find_map(of)
    }

    /// Returns whether any scope declares a type with this name. If [`Types::find`] does not find the type, that scope
    /// is not visible.
    pub(super) fn is_hidden(&self, name: &str) -> bool {
        self.names.contains_key(name)
    }

    /// Returns KUKA's own type with this name; [`Type::Text`] for a text.
    pub(super) fn kuka_type(&self, name: &str) -> Type {
        match name {
            "TEXT" => Type::Text,
            _ => self.find(name, &[]).unwrap_or(Type::Unknown),
        }
    }

    /// Adds an enumeration; returns false if the name already exists in this scope.
    pub(super) fn add_enumeration(&mut self, scope: Scope, name: &str, words: Vec<String>) -> bool {
        let kind = Type::Enumeration(self.enumerations.len());
        let places = (0..=u16::MAX).zip(&words).map(|(place, word)| (word.clone(), place)).collect();
        let kuka = scope == Scope::Kuka;
        self.enumerations.push(Enumeration { name: name.to_owned(), words, places, kuka });
        self.add(scope, name, kind)
    }

    /// Adds a structure; returns false if the name already exists in this scope.
    pub(super) fn add_struc(&mut self, scope: Scope, name: &str, components: Vec<NewComponent>) -> bool {
        let mut size = 0_usize;
        let mut placed = Vec::new();
        let mut places = BTreeMap::new();
        for NewComponent { name, kind, dimensions } in components {
            let cells = self.cells(kind, &dimensions);
            places.entry(name.clone()).or_insert(placed.len());
            placed.push(Component { name, kind, dimensions, offset: size });
            size = size.saturating_add(cells);
        }
        let kind = Type::Struc(self.strucs.len());
        let kuka = scope == Scope::Kuka;
        self.strucs.push(Struc { name: name.to_owned(), components: placed, places, size, kuka });
        self.add(scope, name, kind)
    }

    fn add(&mut self, scope: Scope, name: &str, kind: Type) -> bool {
        let known = self.names.entry(name.to_owned()).or_default();
        let is_free = known.iter().all(|(taken, _)| *taken != scope);
        if is_free {
            known.push((scope, kind));
        }
        is_free
    }

    /// Returns the number of cells of a value of this type.
    pub(super) fn size(&self, kind: Type) -> usize {
        match kind {
            Type::Struc(index) => self.strucs[index].size,
            _ => 1,
        }
    }

    /// Returns the number of cells of an array of this type; `usize::MAX` if the number overflows.
    pub(super) fn cells(&self, kind: Type, dimensions: &[usize]) -> usize {
        dimensions.iter().fold(self.size(kind), |cells, dimension| cells.saturating_mul(*dimension))
    }

    /// Returns the type's name, for messages.
    pub(super) fn name(&self, kind: Type) -> String {
        match kind {
            Type::Unknown => "an unknown type".to_owned(),
            Type::Int => "INT".to_owned(),
            Type::Real => "REAL".to_owned(),
            Type::Bool => "BOOL".to_owned(),
            Type::Char => "CHAR".to_owned(),
            Type::Text => "a text".to_owned(),
            Type::Enumeration(index) => self.enumerations[index].name.clone(),
            Type::Struc(index) => self.strucs[index].name.clone(),
        }
    }

    /// Returns the structure of a type.
    pub(super) fn structure(&self, kind: Type) -> Option<&Struc> {
        if let Type::Struc(index) = kind { self.strucs.get(index) } else { None }
    }

    /// Returns the enumeration of a type.
    pub(super) fn enumeration(&self, kind: Type) -> Option<&Enumeration> {
        if let Type::Enumeration(index) = kind { self.enumerations.get(index) } else { None }
    }

    fn is_one_of_types(&self, kind: Type, names: &[&str]) -> bool {
        self.structure(kind).is_some_and(|struc| names.contains(&struc.name.as_str()))
    }

    /// Returns whether the first components of the type are X, Y, Z, A, B and C.
    pub(super) fn is_pose(&self, kind: Type) -> bool {
        self.is_one_of_types(kind, &POSE_TYPES)
    }

    /// Returns whether the first components of the type are A1 to A6.
    pub(super) fn is_axes(&self, kind: Type) -> bool {
        self.is_one_of_types(kind, &AXIS_TYPES)
    }

    /// Returns whether the controller converts the two types to each other: both are poses, or both are axis positions.
    pub(super) fn are_convertible(&self, one: Type, other: Type) -> bool {
        (self.is_pose(one) && self.is_pose(other)) || (self.is_axes(one) && self.is_axes(other))
    }

    /// Returns whether two types are the same; one of KUKA's own types may be declared again in a file.
    pub(super) fn are_same_type(&self, one: Type, other: Type) -> bool {
        match (one, other) {
            (Type::Enumeration(_), Type::Enumeration(_)) | (Type::Struc(_), Type::Struc(_)) => {
                self.name(one) == self.name(other)
            }
            _ => one == other,
        }
    }

    /// Returns the index of this constant in its enumeration.
    pub(super) fn constant_index(&self, kind: Type, word: &str) -> Option<u16> {
        self.enumeration(kind)?.places.get(word).copied()
    }
}

impl Struc {
    /// Returns a list of the structure's components, for messages.
    pub(super) fn describe_components(&self) -> String {
        join_names(self.components.iter().map(|component| component.name.as_str()), "")
    }
}

impl Enumeration {
    /// Returns a list of the enumeration's constants, for messages.
    pub(super) fn describe_constants(&self) -> String {
        join_names(self.words.iter().map(String::as_str), "#")
    }
}

fn join_names<'a>(names: impl Iterator<Item = &'a str>, sign: &str) -> String {
    let mut all: Vec<String> = names.take(MAX_LISTED + 1).map(|name| format!("{sign}{name}")).collect();
    if all.len() > MAX_LISTED {
        all[MAX_LISTED] = "…".to_owned();
    }
    all.join(", ")
}

/// KUKA's types as KRL declarations; each follows the types that it uses.
const KUKA_TYPES: &str = "
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

/// Further types of KUKA, from machine data and from programs that KUKA delivers. Only their names are known, so their
/// components are not checked.
const TYPES_KNOWN_BY_NAME_ONLY: [&str; 39] = [
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

/// Returns whether this is the name of a KUKA type whose components are not known here.
pub(super) fn is_type_known_by_name_only(name: &str) -> bool {
    TYPES_KNOWN_BY_NAME_ONLY.binary_search(&name).is_ok()
}

/// Returns all of KUKA's types. Each check works with a copy of them.
pub(super) fn kuka_types() -> &'static Types {
    static KUKA: LazyLock<Types> = LazyLock::new(|| {
        let mut types = Types::default();
        types.add_simple();
        for line in KUKA_TYPES.lines() {
            add_kuka_type(&mut types, line);
        }
        types
    });
    &KUKA
}

fn add_kuka_type(types: &mut Types, line: &str) {
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

    /// Expected sizes, calculated by hand. The first structure has six REAL, two INT and six REAL. The second one has
    /// RET1, HITS, LENGTH, MSG_NO, MSG_TYPE and sixty characters.
    #[test]
    fn each_declared_kuka_type_is_read() {
        let types = kuka_types();
        let lines = KUKA_TYPES.lines().filter(|line| !line.is_empty()).count();
        assert_eq!(types.strucs.len() + types.enumerations.len(), lines);
        let components = types.strucs.iter().flat_map(|struc| &struc.components);
        assert_eq!(components.filter(|component| component.kind == Type::Unknown).count(), 0);
        assert_eq!([types.size(types.kuka_type("E6POS")), types.size(types.kuka_type("STATE_T"))], [14, 65]);
        assert!(
            TYPES_KNOWN_BY_NAME_ONLY.is_sorted()
                && TYPES_KNOWN_BY_NAME_ONLY.iter().all(|name| types.find(name, &[]).is_none()),
            "one place for each"
        );
    }
}
