//! Converts values to documents and back: the four kinds of message, with tags and order from the EthernetKRL
//! files.
//!
//! `Cmd` and `Req` go out, `Ack` and `St` come in. Numbers are written as the controller writes them, `%d` and
//! `%f`: six decimals, no exponent. A number that cannot be written in this form is refused when the command is
//! queued.

use super::ack::{ACK, Ack};
use super::channel::ChannelFile;
use super::command::{Command, CommandError, CommandFields, Request};
use super::decode::DecodeError;
use super::ids::{CommandId, Epoch};
use super::schema::{Field, Schema, SchemaError, integer_field, number_field};
use super::state::{STATE, State};

#[cfg(test)]
mod tests;

/// Values are not checked again here: a command was checked when it was queued, and a request contains only
/// numbers.
const COMMAND: [Field; 13] = [
    integer_field("Cmd/@Id", 1, i32::MAX),
    integer_field("Cmd/@Ep", 1, i32::MAX),
    integer_field("Cmd/@Op", 1, 8),
    integer_field("Cmd/@N1", 0, i32::MAX),
    integer_field("Cmd/@N2", 0, i32::MAX),
    number_field("Cmd/@R1", f64::MAX),
    number_field("Cmd/@R2", f64::MAX),
    number_field("Cmd/P/@X", f64::MAX),
    number_field("Cmd/P/@Y", f64::MAX),
    number_field("Cmd/P/@Z", f64::MAX),
    number_field("Cmd/P/@A", f64::MAX),
    number_field("Cmd/P/@B", f64::MAX),
    number_field("Cmd/P/@C", f64::MAX),
];

const REQUEST: [Field; 4] = [
    integer_field("Req/@Id", 1, i32::MAX),
    integer_field("Req/@Ep", 0, i32::MAX),
    integer_field("Req/@Op", 9, 12),
    integer_field("Req/@N1", 0, i32::MAX),
];

/// The message formats of both channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Wire {
    command: Schema,
    ack: Schema,
    request: Schema,
    state: Schema,
}

impl Wire {
    /// Creates the message formats from these two channel files.
    ///
    /// # Errors
    /// If a file lacks a tag, or has one that this program does not know.
    pub fn new(command_channel: &ChannelFile, state_channel: &ChannelFile) -> Result<Self, SchemaError> {
        Ok(Wire {
            command: Schema::new(&command_channel.received, &COMMAND)?,
            ack: Schema::new(&command_channel.sent, &ACK)?,
            request: Schema::new(&state_channel.received, &REQUEST)?,
            state: Schema::new(&state_channel.sent, &STATE)?,
        })
    }

    /// Returns a command as bytes; `to_come` is how many points of the same path follow.
    ///
    /// # Errors
    /// If a number is not finite or out of range, or the function is not allowed on this channel.
    pub fn encode_command(
        &self,
        id: CommandId,
        epoch: Epoch,
        command: &Command,
        to_come: u32,
    ) -> Result<Vec<u8>, CommandError> {
        let CommandFields { operation, n, r, p } = command.fields(to_come)?;
        let head = [f64::from(id.0), f64::from(epoch.0)].into_iter();
        let rest = [operation, n[0], n[1]].map(f64::from);
        let values: Vec<f64> = head.chain(rest).chain(r).chain(p).collect();
        Ok(self.command.encode(&values))
    }

    /// Encodes a request; `id` counts the requests of a connection from 1.
    pub fn encode_request(&self, id: u32, epoch: Epoch, request: &Request) -> Vec<u8> {
        let (operation, number) = match *request {
            Request::State => (9, 0),
            Request::Heartbeat { last_sent } => (10, last_sent),
            Request::Abort { next } => (11, next.0),
            Request::Reset { next } => (12, next.0),
            Request::Line { bits } => (13, bits),
        };
        self.request.encode(&[id, epoch.0, operation, number].map(f64::from))
    }

    /// Reads an acknowledgement from its document.
    ///
    /// # Errors
    /// If the document is not exactly one `Ack`.
    pub fn decode_ack(&self, document: &str) -> Result<Ack, DecodeError> {
        Ack::from_values(&self.ack.decode(document)?).ok_or(DecodeError::Missing { field: "Ack" })
    }

    /// Reads a state from its document.
    ///
    /// # Errors
    /// If the document is not exactly one `St`.
    pub fn decode_state(&self, document: &str) -> Result<State, DecodeError> {
        State::from_values(&self.state.decode(document)?).ok_or(DecodeError::Missing { field: "St" })
    }
}
