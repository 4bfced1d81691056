//! Values of nodes, and their types.

/// A value of a node.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// The value is not known, or there is none now.
    Absent,
    /// True or false.
    Boolean(bool),
    /// A whole number.
    Int32(i32),
    /// A whole number, 0 or greater.
    UInt32(u32),
    /// A number.
    Double(f64),
    /// A text.
    String(String),
    /// A time, ms since 1970.
    DateTime(i64),
    /// Texts, in order.
    Strings(Vec<String>),
    /// Times, ms since 1970, in order.
    DateTimes(Vec<i64>),
}

/// The type of a node's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[expect(missing_docs, reason = "the names are those of OPC UA")]
pub enum Kind {
    Boolean,
    Int32,
    UInt32,
    Double,
    String,
    DateTime,
    #[strum(serialize = "String[]")]
    Strings,
    #[strum(serialize = "DateTime[]")]
    DateTimes,
}

impl Kind {
    /// Returns the type's name, as the manual states it.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl Value {
    /// Returns its kind; `None` if there is no value.
    pub fn kind(&self) -> Option<Kind> {
        Some(match self {
            Value::Absent => return None,
            Value::Boolean(_) => Kind::Boolean,
            Value::Int32(_) => Kind::Int32,
            Value::UInt32(_) => Kind::UInt32,
            Value::Double(_) => Kind::Double,
            Value::String(_) => Kind::String,
            Value::DateTime(_) => Kind::DateTime,
            Value::Strings(_) => Kind::Strings,
            Value::DateTimes(_) => Kind::DateTimes,
        })
    }
}
