//! Types and how many cells of memory each takes: a simple value one, a structure those of its components in order.

use std::collections::BTreeMap;

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    /// Not known, since its declaration is missing; told once, where it is missing.
    Unknown,
    /// 32 bits.
    Int,
    /// 32 bits.
    Real,
    /// TRUE or FALSE.
    Bool,
    /// One character.
    Char,
    /// A text in quotation marks.
    Text,
    /// A word of this enumeration.
    Enumeration(usize),
    /// A structure.
    Struc(usize),
}

/// One component of a structure.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// In upper case.
    pub name: String,
    /// Its type.
    pub kind: Type,
    /// Of an array.
    pub dimensions: Vec<usize>,
    /// Cells before it.
    pub offset: usize,
}

/// A structure.
#[derive(Debug, Clone, PartialEq)]
pub struct Struc {
    /// In upper case.
    pub name: String,
    /// In order.
    pub components: Vec<Component>,
    /// Cells.
    pub size: usize,
}

/// An enumeration.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Enumeration {
    pub(super) name: String,
    pub(super) words: Vec<String>,
}

/// All types that are known.
#[derive(Debug, Clone, PartialEq)]
pub struct Types {
    pub(super) strucs: Vec<Struc>,
    pub(super) enumerations: Vec<Enumeration>,
    names: BTreeMap<String, Type>,
}

/// KUKA's own structures, components as `TYPE NAME`.
const STRUCS: [(&str, &str); 13] = [
    ("FRAME", "REAL X,Y,Z,A,B,C"),
    ("POS", "REAL X,Y,Z,A,B,C,INT S,T"),
    ("E6POS", "REAL X,Y,Z,A,B,C,INT S,T,REAL E1,E2,E3,E4,E5,E6"),
    ("AXIS", "REAL A1,A2,A3,A4,A5,A6"),
    ("E6AXIS", "REAL A1,A2,A3,A4,A5,A6,E1,E2,E3,E4,E5,E6"),
    ("CP", "REAL CP,ORI1,ORI2"),
    ("APO", "REAL CDIS,INT CPTP,CVEL,REAL CORI"),
    ("INERTIA", "REAL X,Y,Z"),
    ("LOAD", "REAL M,FRAME CM,INERTIA J"),
    ("DATE", "INT CSEC,SEC,MIN,HOUR,DAY,MONTH,YEAR"),
    ("EKI_STATUS", "INT BUFF,READ,MSG_NO,BOOL CONNECTED,INT COUNTER"),
    ("STATE_T", "CMD_STAT RET1,INT HITS,LENGTH"),
    ("ERROR_T", "INT NUMBER"),
];

/// KUKA's own enumerations.
const ENUMERATIONS: [(&str, &str); 11] = [
    ("MODE_OP", "T1 T2 AUT EX INVALID"),
    ("PRO_STATE", "P_FREE P_RESET P_ACTIVE P_STOP P_END"),
    ("MODUS_T", "SYNC ASYNC COND ABS SEQ"),
    ("CMD_STAT", "CMD_OK CMD_TIMEOUT DATA_OK DATA_BLK DATA_END CMD_ABORT CMD_REJ CMD_PART CMD_SYN FMT_ERR"),
    ("IPO_MODE", "BASE TCP"),
    ("ORI_TYPE", "VAR CONSTANT JOINT"),
    (
        "BAS_COMMAND",
        "INITMOV ACC_CP ACC_PTP VEL_CP VEL_PTP ACC_GLUE TOOL BASE EX_BASE PTP_DAT CP_DAT FRAMES CP_PARAMS PTP_PARAMS",
    ),
    ("VAR_STATE", "DECLARED INITIALIZED UNDEFINED"),
    ("EKI_MODE", "NOTIFY STATE QUIT"),
    ("PRO_IP_MODE", "GO MSTEP ISTEP PSTEP BSTEP CSTEP"),
    ("CP_VEL_TYPE", "CONSTANT VAR_T1 VAR_ALL VAR_ALL_MODEL"),
];

impl Default for Types {
    fn default() -> Self {
        let simple = [("INT", Type::Int), ("REAL", Type::Real), ("BOOL", Type::Bool), ("CHAR", Type::Char)];
        let names = simple.map(|(name, kind)| (name.to_owned(), kind)).into();
        let mut types = Types { strucs: Vec::new(), enumerations: Vec::new(), names };
        for (name, words) in ENUMERATIONS {
            types.add_enumeration(name, words.split(' ').map(str::to_owned).collect());
        }
        for (name, list) in STRUCS {
            let mut kind = Type::Unknown;
            let components = list.split(',').map(|part| {
                let component = match part.split_once(' ') {
                    Some((type_name, component)) => {
                        kind = types.find(type_name).unwrap_or(Type::Unknown);
                        component
                    }
                    None => part,
                };
                (component.to_owned(), kind, Vec::new())
            });
            let components: Vec<_> = components.collect();
            types.add_struc(name, components);
        }
        types
    }
}

impl Types {
    /// The type of this name.
    pub(super) fn find(&self, name: &str) -> Option<Type> {
        self.names.get(name).copied()
    }

    /// False where the name is taken.
    pub(super) fn add_enumeration(&mut self, name: &str, words: Vec<String>) -> bool {
        let kind = Type::Enumeration(self.enumerations.len());
        self.enumerations.push(Enumeration { name: name.to_owned(), words });
        self.names.insert(name.to_owned(), kind).is_none()
    }

    /// False where the name is taken.
    pub(super) fn add_struc(&mut self, name: &str, components: Vec<(String, Type, Vec<usize>)>) -> bool {
        let mut size = 0;
        let mut placed = Vec::new();
        for (name, kind, dimensions) in components {
            let cells = self.cells(kind, &dimensions);
            placed.push(Component { name, kind, dimensions, offset: size });
            size += cells;
        }
        let kind = Type::Struc(self.strucs.len());
        self.strucs.push(Struc { name: name.to_owned(), components: placed, size });
        self.names.insert(name.to_owned(), kind).is_none()
    }

    /// How many cells a value of this type takes.
    pub(super) fn size(&self, kind: Type) -> usize {
        match kind {
            Type::Struc(index) => self.strucs[index].size,
            _ => 1,
        }
    }

    /// How many cells an array of this type takes.
    pub(super) fn cells(&self, kind: Type, dimensions: &[usize]) -> usize {
        dimensions.iter().product::<usize>() * self.size(kind)
    }

    /// The type's name, for messages.
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

    /// The structure behind a type.
    pub(super) fn struc(&self, kind: Type) -> Option<&Struc> {
        if let Type::Struc(index) = kind { self.strucs.get(index) } else { None }
    }

    /// Whether this is KUKA's own structure of this name.
    pub(super) fn is(&self, kind: Type, name: &str) -> bool {
        self.struc(kind).is_some_and(|struc| struc.name == name)
    }

    /// Whether it begins with X, Y, Z, A, B, C.
    pub(super) fn is_pose(&self, kind: Type) -> bool {
        ["FRAME", "POS", "E6POS"].iter().any(|name| self.is(kind, name))
    }

    /// Whether it begins with A1 to A6.
    pub(super) fn is_axes(&self, kind: Type) -> bool {
        ["AXIS", "E6AXIS"].iter().any(|name| self.is(kind, name))
    }

    /// The place of this word in its enumeration.
    pub(super) fn word(&self, kind: Type, word: &str) -> Option<usize> {
        let Type::Enumeration(index) = kind else { return None };
        self.enumerations[index].words.iter().position(|known| known == word)
    }
}
