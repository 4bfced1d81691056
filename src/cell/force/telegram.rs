//! Telegrams of the FerRobotics ACF over TCP: ASCII text with fields separated by spaces; each telegram ends with the
//! letter k.
//!
//! ```text
//! log-in   WORDk                                    echoed as it is
//! command  id force f_zero t_ramp payload 0k        whole number, N, N, s, kg
//! reply    id force position contact errork         whole number, N, mm, 0 or 1, eight bits as a number
//! ```
//!
//! In a command, `force` is the actuator force in contact, `f_zero` the actuator force before contact, and `t_ramp` the
//! duration of the change from `f_zero` to `force` when contact begins. The tool replies to each command once and sends
//! nothing without a request. The format is that of the public driver `sam-xl/ferrobotics_acf` (log-in word `ferba`, id
//! 1040, port 7070), with the order of the error bits in its table. A reply in any other format is refused completely.
//!
//! All functions are pure: they convert bytes to values and values to bytes.

use serde::{Deserialize, Serialize};

/// The byte that ends each telegram.
pub const TERMINATOR: u8 = b'k';

/// Maximum length of the log-in word with its terminator, bytes.
pub const MAX_LOGIN_ECHO_BYTES: usize = 64;

/// Maximum length of a reply, bytes; the format needs about 40.
pub const MAX_REPLY_BYTES: usize = 96;

/// Maximum force, N, and position, mm, in a reply: no compliant tool has larger ones.
const MAX_FORCE_N: f64 = 2_000.0;
const MAX_POSITION_MM: f64 = 500.0;

/// Returns the log-in telegram with this word.
pub fn login(word: &str) -> Vec<u8> {
    let mut bytes = word.as_bytes().to_vec();
    bytes.push(TERMINATOR);
    bytes
}

/// A command to the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// The tool's id in telegrams.
    pub id: u16,
    /// Actuator force in contact, N.
    pub force_n: f64,
    /// Actuator force before contact, N.
    pub free_force_n: f64,
    /// Duration of the ramp from the force before contact to the force in contact, when contact begins, s.
    pub ramp_s: f64,
    /// The mass whose weight the tool itself compensates, kg.
    pub payload_kg: f64,
}

impl Command {
    /// Returns the command as a telegram.
    pub fn bytes(&self) -> Vec<u8> {
        let Command { id, force_n, free_force_n: no_contact_n, ramp_s, payload_kg } = self;
        // Adding 0.0 removes the sign of −0.0, which would be written as "-0.00".
        let (force_n, no_contact_n) = (force_n + 0.0, no_contact_n + 0.0);
        format!("{id} {force_n:.2} {no_contact_n:.2} {ramp_s:.3} {payload_kg:.3} 0k").into_bytes()
    }
}

/// The values that the tool reports in a reply.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolReading {
    /// The measured force, N: the actuator force without the weight of the payload.
    pub force_n: f64,
    /// The tool's extension, mm: 0 is fully back.
    pub position_mm: f64,
    /// Whether the tool reports contact.
    pub contact: bool,
    /// The error bits that the tool reports.
    pub errors: ErrorBits,
}

/// The eight bits of the tool's error byte, in the order of the driver's table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ErrorBits(pub u8);

/// The meaning of each error bit, from the lowest bit to the highest.
const MEANINGS: [&str; 8] = [
    "the valve has an error",
    "the sensor has an error",
    "the head and the controller do not match",
    "the commanded force cannot be reached",
    "the force before contact was set to 0",
    "a commanded value is out of range",
    "the head does not answer the controller",
    "the parameters of the head were not read completely",
];

impl ErrorBits {
    /// Returns whether no error bit is set.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns the meanings of the error bits that are set, as text.
    pub fn describe(self) -> String {
        let set = |(bit, meaning): (usize, &&'static str)| (self.0 >> bit & 1 == 1).then_some(*meaning);
        MEANINGS.iter().enumerate().filter_map(set).collect::<Vec<_>>().join(", ")
    }
}

/// The reason why a reply is not valid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TelegramError {
    /// The reply is longer than any valid reply.
    #[error("the reply has {bytes} bytes without a terminator, the maximum is {MAX_REPLY_BYTES}")]
    TooLong {
        /// Number of bytes received.
        bytes: usize,
    },
    /// The reply contains bytes that are not printable ASCII.
    #[error("the reply contains bytes that are not text")]
    NotText,
    /// The number of fields is not five.
    #[error("the reply has {found} fields instead of five: id, force, position, contact, error")]
    Fields {
        /// Number of fields received.
        found: usize,
    },
    /// A field with an invalid value.
    #[error("{field} is \"{found}\"")]
    Field {
        /// The name of the field.
        field: &'static str,
        /// The text of the field.
        found: String,
    },
    /// The reply comes from another tool.
    #[error("tool id {found} replied, but the request was for id {expected}")]
    OtherId {
        /// The id of the tool that replied.
        found: u32,
        /// The id of the tool to which the command was sent.
        expected: u16,
    },
}

/// Parses a reply without its terminator, from the tool with the id `expected`.
///
/// # Errors
/// If the format is invalid, or another tool has replied.
pub fn parse_reply(bytes: &[u8], expected: u16) -> Result<ToolReading, TelegramError> {
    if bytes.len() > MAX_REPLY_BYTES {
        return Err(TelegramError::TooLong { bytes: bytes.len() });
    }
    let text = std::str::from_utf8(bytes).ok().filter(|text| text.bytes().all(is_text_byte));
    let fields: Vec<&str> = text.ok_or(TelegramError::NotText)?.split_ascii_whitespace().collect();
    let [id, force, position, contact, errors] = fields[..] else {
        return Err(TelegramError::Fields { found: fields.len() });
    };
    let found: u32 = id.parse().map_err(|_| field_error("id", id))?;
    // The id is checked first: the reply of another tool may be well-formed, but its values belong to that tool.
    if found != u32::from(expected) {
        return Err(TelegramError::OtherId { found, expected });
    }
    Ok(ToolReading {
        force_n: number("force", force, -MAX_FORCE_N..=MAX_FORCE_N)?,
        position_mm: number("position", position, -MAX_POSITION_MM..=MAX_POSITION_MM)?,
        contact: match contact {
            "0" => false,
            "1" => true,
            _ => return Err(field_error("contact", contact)),
        },
        errors: ErrorBits(errors.parse().map_err(|_| field_error("error", errors))?),
    })
}

fn is_text_byte(byte: u8) -> bool {
    byte.is_ascii_graphic() || byte.is_ascii_whitespace()
}

fn number(field: &'static str, text: &str, allowed: std::ops::RangeInclusive<f64>) -> Result<f64, TelegramError> {
    let value: f64 = text.parse().map_err(|_| field_error(field, text))?;
    // The comparison also refuses NaN.
    if allowed.contains(&value) { Ok(value) } else { Err(field_error(field, text)) }
}

fn field_error(field: &'static str, found: &str) -> TelegramError {
    TelegramError::Field { field, found: found.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const COMMAND: Command = Command { id: 1040, force_n: 20.0, free_force_n: -5.0, ramp_s: 0.25, payload_kg: 1.3 };

    /// Expected telegrams, written by hand in the format of the driver.
    #[test]
    fn telegrams_are_those_of_the_driver() {
        assert_eq!(login("ferba"), b"ferbak");
        assert_eq!(COMMAND.bytes(), b"1040 20.00 -5.00 0.250 1.300 0k");
        assert_eq!(Command { force_n: -0.0, ..COMMAND }.bytes(), b"1040 0.00 -5.00 0.250 1.300 0k");
        let read = ToolReading { force_n: 19.7, position_mm: 17.25, contact: true, errors: ErrorBits(0) };
        assert_eq!(parse_reply(b"1040 19.7 17.25 1 0", 1040), Ok(read));
        let errors = parse_reply(b"1040 -3 0.0 0 9", 1040).expect("a reply").errors;
        assert_eq!(errors.describe(), "the valve has an error, the commanded force cannot be reached");
    }

    #[test]
    fn an_invalid_reply_is_refused_with_its_problem() {
        let says = |bytes: &[u8]| parse_reply(bytes, 7).expect_err("refused").to_string();
        assert_eq!(
            says(b"7 1.0 2.0 1"),
            "the reply has 4 fields instead of five: id, force, position, contact, error"
        );
        assert_eq!(says(b"8 1.0 2.0 1 0"), "tool id 8 replied, but the request was for id 7");
        for (bytes, field) in [
            (&b"7 nan 2 1 0"[..], "force"),
            (b"7 inf 2 1 0", "force"),
            (b"7 1,5 2 1 0", "force"),
            (b"7 1 1e400 1 0", "position"),
            (b"7 1 2 true 0", "contact"),
            (b"7 1 2 1 256", "error"),
            (b"7.0 1 2 1 0", "id"),
        ] {
            assert!(says(bytes).starts_with(field), "{}", says(bytes));
        }
        assert_eq!(says(b"7 1 2 1 \xc3\xa4"), "the reply contains bytes that are not text");
        assert!(says(&[b'1'; 97]).starts_with("the reply has 97 bytes without a terminator"));
    }

    proptest! {
        /// The parser does not panic for any bytes, and the values that it returns are within their limits.
        #[test]
        fn any_bytes_are_a_reply_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..120)) {
            if let Ok(reading) = parse_reply(&bytes, 1040) {
                prop_assert!(reading.force_n.abs() <= MAX_FORCE_N && reading.position_mm.is_finite());
            }
        }

        /// If one byte of a reply is changed, either the reply is refused, or it is still a reply of the same tool with
        /// finite values.
        #[test]
        fn a_changed_byte_gives_no_reply_of_another_tool(at in 0_usize..19, to in any::<u8>()) {
            let mut bytes = b"1040 19.7 17.25 1 0".to_vec();
            bytes[at] = to;
            if let Ok(reading) = parse_reply(&bytes, 1040) {
                prop_assert!(bytes.starts_with(b"1040") || bytes[0].is_ascii_whitespace());
                prop_assert!(reading.force_n.is_finite() && reading.position_mm.is_finite());
            }
        }

        /// Splitting a command at its spaces gives the written values, rounded to two decimals.
        #[test]
        fn a_command_is_read_back(force_n in -500.0..500.0_f64, ramp_s in 0.0..10.0_f64) {
            let text = String::from_utf8(Command { force_n, ramp_s, ..COMMAND }.bytes()).expect("text");
            let fields: Vec<&str> = text.strip_suffix("0k").expect("ended").split(' ').collect();
            prop_assert!((fields[1].parse::<f64>().expect("a number") - force_n).abs() <= 0.0051);
            prop_assert!((fields[3].parse::<f64>().expect("a number") - ramp_s).abs() <= 0.00051);
        }
    }
}
