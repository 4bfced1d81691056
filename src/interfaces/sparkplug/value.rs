//! Values of metrics, and their types in Sparkplug.

/// The types that this node uses, by their numbers in the specification.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
pub enum DataType {
    /// A whole number.
    Int64 = 4,
    /// A number.
    Double = 10,
    /// Yes or no.
    Boolean = 11,
    /// A text.
    String = 12,
}

impl DataType {
    /// Its number.
    pub fn number(self) -> u32 {
        self as u32
    }

    /// The type's name in the specification.
    pub fn type_name(self) -> &'static str {
        self.into()
    }
}

/// The value of a metric. An unknown value is `Null`, and never a number in its place.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Value {
    /// The value is not known, or there is none now.
    #[default]
    Null,
    /// A whole number.
    Whole(i64),
    /// A finite number.
    Real(f64),
    /// Yes or no.
    Truth(bool),
    /// A text.
    Text(String),
}

impl Value {
    /// A whole number, if there is one.
    pub(super) fn as_integer(number: Option<impl Into<i64>>) -> Self {
        number.map_or(Value::Null, |number| Value::Whole(number.into()))
    }

    /// A number, if there is one and it is finite.
    pub(super) fn as_number(number: Option<f64>) -> Self {
        number.filter(|number| number.is_finite()).map_or(Value::Null, Value::Real)
    }

    /// A text, if there is one.
    pub(super) fn text(text: Option<&str>) -> Self {
        text.map_or(Value::Null, |text| Value::Text(text.to_owned()))
    }
}
