//! The Sparkplug B payload in protobuf, the values of metrics with their data types, and the topics of an edge node. It
//! contains only the fields that a node without devices, templates and data sets sends, or reads in a command. All
//! other fields of a received message are ignored.

use prost::{Message, Oneof};

/// A message: NBIRTH, NDATA, NDEATH or NCMD.
#[derive(Clone, PartialEq, Message)]
pub struct Payload {
    /// Time at which the message was sent, ms since 1970, UTC.
    #[prost(uint64, optional, tag = "1")]
    pub timestamp: Option<u64>,
    /// The metrics in the message.
    #[prost(message, repeated, tag = "2")]
    pub metrics: Vec<Metric>,
    /// Sequence number of the message, 0 to 255; absent in a death message and in a command.
    #[prost(uint64, optional, tag = "3")]
    pub seq: Option<u64>,
}

/// A value with the name or alias of its metric.
#[derive(Clone, PartialEq, Message)]
pub struct Metric {
    /// The name of the metric; absent if the alias is used.
    #[prost(string, optional, tag = "1")]
    pub name: Option<String>,
    /// The alias, which replaces the name in messages after the birth message.
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
    /// The value of the metric.
    #[prost(oneof = "WireType", tags = "10, 11, 12, 13, 14, 15")]
    pub value: Option<WireType>,
}

/// A value in its encoded form.
#[derive(Clone, PartialEq, Oneof)]
pub enum WireType {
    /// An integer of up to 32 bits.
    #[prost(uint32, tag = "10")]
    Int(u32),
    /// An integer of 64 bits; a negative one as its two's complement.
    #[prost(uint64, tag = "11")]
    Long(u64),
    /// A number of single precision.
    #[prost(float, tag = "12")]
    Float(f32),
    /// A number of double precision.
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
    /// Creates a metric with this value and the time at which it was read, but without name, alias and data type.
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

    /// Returns the metric with its full name and data type.
    pub(super) fn with_name(self, name: &str, datatype: DataType) -> Self {
        Metric { name: Some(name.to_owned()), datatype: Some(datatype.number()), ..self }
    }

    /// Returns the metric with its alias.
    pub(super) fn with_alias(self, alias: u64) -> Self {
        Metric { alias: Some(alias), ..self }
    }
}

/// The data types that this node uses, with their numbers in the specification.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
pub enum DataType {
    /// A signed integer of 64 bits.
    Int64 = 4,
    /// A number of double precision.
    Double = 10,
    /// Yes or no.
    Boolean = 11,
    /// A text.
    String = 12,
}

impl DataType {
    /// Returns the number of the data type in the specification.
    pub fn number(self) -> u32 {
        self as u32
    }

    /// Returns the name of the data type in the specification.
    pub fn type_name(self) -> &'static str {
        self.into()
    }
}

/// The value of a metric. An unknown value is `Null`, never a default number.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Value {
    /// The value is unknown, or does not exist at present.
    #[default]
    Null,
    /// A signed integer.
    Whole(i64),
    /// A finite number.
    Real(f64),
    /// Yes or no.
    Truth(bool),
    /// A text.
    Text(String),
}

impl Value {
    /// Returns an integer as a value; `Null` for `None`.
    pub(super) fn as_integer(number: Option<impl Into<i64>>) -> Self {
        number.map_or(Value::Null, |number| Value::Whole(number.into()))
    }

    /// Returns a number as a value; `Null` for `None`, or if the number is not finite.
    pub(super) fn as_number(number: Option<f64>) -> Self {
        number.filter(|number| number.is_finite()).map_or(Value::Null, Value::Real)
    }

    /// Returns a text as a value; `Null` for `None`.
    pub(super) fn text(text: Option<&str>) -> Self {
        text.map_or(Value::Null, |text| Value::Text(text.to_owned()))
    }
}

/// The first level of every topic.
const NAMESPACE: &str = "spBv1.0";

/// The names of the cell in the Sparkplug namespace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellIds {
    /// The Sparkplug group to which the node belongs.
    pub group_id: String,
    /// The name of the edge node within its group.
    pub edge_node_id: String,
    /// The primary host application: nothing is published while it is offline. `None` without a primary host.
    pub primary_host_id: Option<String>,
}

impl CellIds {
    fn topic(&self, kind: &str) -> String {
        format!("{NAMESPACE}/{}/{kind}/{}", self.group_id, self.edge_node_id)
    }

    /// Returns the topic of birth messages.
    pub fn birth_topic(&self) -> String {
        self.topic("NBIRTH")
    }

    /// Returns the topic of data messages.
    pub fn data_topic(&self) -> String {
        self.topic("NDATA")
    }

    /// Returns the topic of death messages.
    pub fn death_topic(&self) -> String {
        self.topic("NDEATH")
    }

    /// Returns the topic of commands.
    pub fn command_topic(&self) -> String {
        self.topic("NCMD")
    }

    /// Returns the topic of the primary host's STATE messages; `None` without a primary host.
    pub fn state(&self) -> Option<String> {
        self.primary_host_id.as_ref().map(|host| format!("{NAMESPACE}/STATE/{host}"))
    }
}
