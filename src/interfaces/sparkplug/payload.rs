//! The payload of Sparkplug B, as protobuf: the fields that a node without devices, templates and data sets sends,
//! or reads in a command. Other fields of a message are skipped when it is read.

use super::value::{DataType, Value};
use prost::{Message, Oneof};

/// A message: NBIRTH, NDATA, NDEATH or NCMD.
#[derive(Clone, PartialEq, Message)]
pub struct Payload {
    /// Time at which the message was sent, ms since 1970, UTC.
    #[prost(uint64, optional, tag = "1")]
    pub timestamp: Option<u64>,
    /// Its metrics.
    #[prost(message, repeated, tag = "2")]
    pub metrics: Vec<Metric>,
    /// The message's sequence number, 0 to 255; a death and a command have none.
    #[prost(uint64, optional, tag = "3")]
    pub seq: Option<u64>,
}

/// One value with its name or alias.
#[derive(Clone, PartialEq, Message)]
pub struct Metric {
    /// The name.
    #[prost(string, optional, tag = "1")]
    pub name: Option<String>,
    /// The number that replaces the name after the birth.
    #[prost(uint64, optional, tag = "2")]
    pub alias: Option<u64>,
    /// Time at which the value was read, ms since 1970, UTC.
    #[prost(uint64, optional, tag = "3")]
    pub timestamp: Option<u64>,
    /// The number of a [`DataType`].
    #[prost(uint32, optional, tag = "4")]
    pub datatype: Option<u32>,
    /// Whether the metric has no value.
    #[prost(bool, optional, tag = "7")]
    pub is_null: Option<bool>,
    /// The value.
    #[prost(oneof = "WireType", tags = "10, 11, 12, 13, 14, 15")]
    pub value: Option<WireType>,
}

/// A value as it is encoded in a message.
#[derive(Clone, PartialEq, Oneof)]
pub enum WireType {
    /// Whole numbers of up to 32 bits.
    #[prost(uint32, tag = "10")]
    Int(u32),
    /// Whole numbers of 64 bits; a negative number as its two's complement.
    #[prost(uint64, tag = "11")]
    Long(u64),
    /// Single precision.
    #[prost(float, tag = "12")]
    Float(f32),
    /// Double precision.
    #[prost(double, tag = "13")]
    Double(f64),
    /// Yes or no.
    #[prost(bool, tag = "14")]
    Boolean(bool),
    /// A text.
    #[prost(string, tag = "15")]
    Text(String),
}

impl Metric {
    /// Creates a metric with this value, read at this time, without name, alias and type.
    pub(super) fn new(value: &Value, unix_ms: u64) -> Self {
        let wire = match value {
            Value::Null => None,
            Value::Whole(number) => Some(WireType::Long(number.cast_unsigned())),
            Value::Real(number) => Some(WireType::Double(*number)),
            Value::Truth(truth) => Some(WireType::Boolean(*truth)),
            Value::Text(text) => Some(WireType::Text(text.clone())),
        };
        let is_null = wire.is_none().then_some(true);
        Metric { timestamp: Some(unix_ms), is_null, value: wire, ..Metric::default() }
    }

    /// Returns the same metric with its full name and type.
    pub(super) fn with_name(self, name: &str, datatype: DataType) -> Self {
        Metric { name: Some(name.to_owned()), datatype: Some(datatype.number()), ..self }
    }

    /// Returns the same metric with its alias.
    pub(super) fn with_alias(self, alias: u64) -> Self {
        Metric { alias: Some(alias), ..self }
    }
}
