//! The documents that have arrived in lock step and are not yet handed over.

use super::super::codec::{Value, decode};
use super::super::error::EkiFault;
use super::super::framer::Framer;
use super::super::setup::Setup;
use super::super::wire::Channel;
use std::collections::VecDeque;

/// A document and the fields read from it; `None` for a field that the document lacks.
#[derive(Debug)]
pub(super) struct Document {
    pub(super) bytes: Vec<u8>,
    pub(super) epoch: Option<i32>,
    pub(super) id: Option<i32>,
    pub(super) operation: Option<i32>,
    pub(super) number: Option<i32>,
}

/// The documents that wait to be sent.
#[derive(Debug)]
pub(super) struct HeldDocuments {
    pub(super) framers: [Framer; 2],
    pub(super) commands: VecDeque<Document>,
    pub(super) requests: VecDeque<Document>,
    /// Epoch and id of the newest command that arrived.
    pub(super) arrived: (i32, i32),
    /// Whether commands that a heartbeat names may still arrive, because their channel was not lost.
    pub(super) awaits_commands: bool,
    /// A request is being served.
    pub(super) is_serving: bool,
}

impl HeldDocuments {
    pub(super) fn new(setup: &Setup) -> Self {
        HeldDocuments {
            framers: [&setup.commands, &setup.states].map(|file| Framer::new(file.limit_bytes)),
            commands: VecDeque::new(),
            requests: VecDeque::new(),
            arrived: (0, 0),
            awaits_commands: true,
            is_serving: false,
        }
    }

    pub(super) fn queue_mut(&mut self, channel: Channel) -> &mut VecDeque<Document> {
        match channel {
            Channel::Command => &mut self.commands,
            Channel::State => &mut self.requests,
        }
    }

    pub(super) fn is_delivered(&self, heartbeat: &Document, epoch: i32) -> bool {
        let (Some(of), Some(last)) = (heartbeat.epoch, heartbeat.number) else { return true };
        last <= 0 || !self.awaits_commands || of < epoch || self.arrived >= (of, last)
    }

    /// Takes the commands up to the one that a heartbeat names.
    pub(super) fn take_up_to(&mut self, heartbeat: &Document) -> Vec<Document> {
        let named = heartbeat.epoch.zip(heartbeat.number);
        let is_later = |command: &Document| match (command.epoch.zip(command.id), named) {
            (Some(key), Some(named)) => key > named,
            _ => false,
        };
        let count = self.commands.iter().position(is_later).unwrap_or(self.commands.len());
        self.commands.drain(..count).collect()
    }
}

impl Document {
    pub(super) fn new(bytes: Vec<u8>, elements: &[super::super::channel_file::Element]) -> Self {
        let arrived: Result<_, EkiFault> = decode(elements, &bytes);
        let arrived = arrived.unwrap_or_default();
        let int = |ending: &str| {
            arrived.iter().find_map(|arrival| {
                match (&arrival.value, elements[arrival.element].tag.ends_with(ending)) {
                    (Some(Value::Int(number)), true) => Some(*number),
                    _ => None,
                }
            })
        };
        Document { epoch: int("/@Ep"), id: int("/@Id"), operation: int("/@Op"), number: int("/@N1"), bytes }
    }
}
