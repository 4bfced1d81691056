//! Types and the number of memory cells of each: a simple value has one, a structure those of its components in order.
//!
//! A type is declared in a routine, in a module or for all files; KUKA's own types are known everywhere and may be
//! declared again, as a controller's data lists do.

use super::limits::MAX_LISTED;
use std::collections::BTreeMap;

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    /// An unknown type, because its declaration is missing. It is reported once, at the declaration that names it.
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
    /// Its type.
    pub kind: Type,
    /// Dimensions of an array.
    pub dimensions: Vec<usize>,
    /// Number of cells before it.
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
    /// Whether no file declares the type: it is KUKA's own type as far as it is known here, and may have more
    /// components.
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
    /// Whether no file declares the enumeration: it is KUKA's own type, and may have more constants.
    pub(super) kuka: bool,
}

/// The scope in which a type is known; the innermost one counts.
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
    pub(super) strucs: Vec<Struc>,
    pub(super) enumerations: Vec<Enumeration>,
    names: BTreeMap<String, Vec<(Scope, Type)>>,
}

/// A component that has no memory offset yet.
pub(super) struct NewComponent {
    pub(super) name: String,
    pub(super) kind: Type,
    pub(super) dimensions: Vec<usize>,
}

/// The first components of KUKA's poses; a shorter type is the beginning of a longer one.
const POSES: [&str; 4] = ["FRAME", "POS", "E3POS", "E6POS"];
/// The first components of KUKA's axis types, in the same order as for the poses.
const AXES: [&str; 3] = ["AXIS", "E3AXIS", "E6AXIS"];

impl Types {
    /// Adds the simple types.
    pub(super) fn add_simple(&mut self) {
        for (name, kind) in [("INT", Type::Int), ("REAL", Type::Real), ("BOOL", Type::Bool), ("CHAR", Type::Char)] {
            self.names.insert(name.to_owned(), vec![(Scope::Kuka, kind)]);
        }
    }

    /// Returns the type of this name that is visible in the scopes; KUKA's own types come last.
    pub(super) fn find(&self, name: &str, scopes: &[Scope]) -> Option<Type> {
        let known = self.names.get(name)?;
        let of = |scope: &Scope| known.iter().find(|(known, _)| known == scope).map(|(_, kind)| *kind);
        scopes.iter().chain(&[Scope::Everywhere, Scope::Kuka]).find_map(of)
    }

    /// Returns whether a type of this name is declared in any scope: if [`Types::find`] does not find it, the scope is
    /// not visible.
    pub(super) fn is_hidden(&self, name: &str) -> bool {
        self.names.contains_key(name)
    }

    /// Returns one of KUKA's own types; [`Type::Text`] for a text.
    pub(super) fn kuka_type(&self, name: &str) -> Type {
        match name {
            "TEXT" => Type::Text,
            _ => self.find(name, &[]).unwrap_or(Type::Unknown),
        }
    }

    /// Adds an enumeration; false if the name is already used in this scope.
    pub(super) fn add_enumeration(&mut self, scope: Scope, name: &str, words: Vec<String>) -> bool {
        let kind = Type::Enumeration(self.enumerations.len());
        let places = (0..=u16::MAX).zip(&words).map(|(place, word)| (word.clone(), place)).collect();
        let kuka = scope == Scope::Kuka;
        self.enumerations.push(Enumeration { name: name.to_owned(), words, places, kuka });
        self.add(scope, name, kind)
    }

    /// Adds a structure; false if the name is already used in this scope.
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

    /// The number of cells of a value of this type.
    pub(super) fn size(&self, kind: Type) -> usize {
        match kind {
            Type::Struc(index) => self.strucs[index].size,
            _ => 1,
        }
    }

    /// The number of cells of an array of this type; the largest number of this computer if there are more.
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

    /// Returns whether the type begins with X, Y, Z, A, B, C.
    pub(super) fn is_pose(&self, kind: Type) -> bool {
        self.is_one_of_types(kind, &POSES)
    }

    /// Returns whether the type begins with A1 to A6.
    pub(super) fn is_axes(&self, kind: Type) -> bool {
        self.is_one_of_types(kind, &AXES)
    }

    /// Returns whether the controller converts the two types into each other: both are poses, or both are axis
    /// positions.
    pub(super) fn are_convertible(&self, one: Type, other: Type) -> bool {
        (self.is_pose(one) && self.is_pose(other)) || (self.is_axes(one) && self.is_axes(other))
    }

    /// Returns whether two types are the same: one of KUKA's own types may be declared a second time.
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
    /// Lists the components of the structure, for a message.
    pub(super) fn describe_components(&self) -> String {
        join_names(self.components.iter().map(|component| component.name.as_str()), "")
    }
}

impl Enumeration {
    /// Lists the constants of the enumeration, for a message.
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
