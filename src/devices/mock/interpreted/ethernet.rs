//! The functions of EthernetKRL for the executed programs; they read and write the channels' buffers.
//!
//! A lost channel is not opened again automatically; the program must call EKI_Clear, EKI_Init and EKI_Open.

use super::super::channel_file::{EkiError, EkiFault, Element};
use super::super::codec::{Template, Value};
use super::super::model::Controller;
use super::super::wire::Channel;
use super::running::ControllerValues;
use panelprep_kuka::krl::{Builtin, Cell, EkiAnswer, UndocumentedBehaviour};

/// Error numbers of EthernetKRL, in this order: channel not available; channel initialised already; interpretation of
/// the configuration failed; channel exists already; unknown element; no client connected.
const NOT_AVAILABLE: i32 = 9;
const INITIALISED: i32 = 23;
const FAILED: i32 = 6;
const ALREADY_INITIALISED: i32 = 12;
const NO_ELEMENT: i32 = 16;
const DISCONNECTED: i32 = 10;
/// Time after EKI_Clear during which an EKI_Open may fail, ms.
const REOPEN_MS: u64 = 24;

pub(super) fn call(
    controller: &mut Controller,
    values: &mut ControllerValues,
    meaning: UndocumentedBehaviour,
    what: Builtin,
    (name, tag): (&str, &str),
    value: &[Cell],
) -> Result<EkiAnswer, String> {
    let channel = if name.eq_ignore_ascii_case("CELLCMD") {
        Channel::Command
    } else if name.eq_ignore_ascii_case("CELLSTAT") {
        Channel::State
    } else {
        return Ok(eki_answer(controller, Channel::Command, NOT_AVAILABLE));
    };
    let now_ms = controller.now_ms;
    let state = &mut values.channels[channel as usize];
    let msg_no = match what {
        Builtin::EkiClear => {
            if !state.initialised && meaning.clear_of_unknown_stops {
                return Err(format!("EKI_Clear: the channel {name} was never initialised"));
            }
            let msg_no = if state.initialised { 0 } else { NOT_AVAILABLE };
            (state.initialised, state.listens, state.cleared_ms) = (false, false, now_ms);
            values.changed = true;
            controller.close_by_program(channel);
            controller.link(channel).memory.clear();
            msg_no
        }
        Builtin::EkiInit if state.initialised => INITIALISED,
        Builtin::EkiInit | Builtin::EkiOpen if now_ms < values.channels_fail_until_ms => FAILED,
        Builtin::EkiInit => {
            state.initialised = true;
            state.set.fill(Value::Unset);
            0
        }
        Builtin::EkiOpen if !state.initialised => NOT_AVAILABLE,
        Builtin::EkiOpen if state.listens => ALREADY_INITIALISED,
        Builtin::EkiOpen
            if meaning.immediate_reopen_fails && now_ms < state.cleared_ms + REOPEN_MS && now_ms > REOPEN_MS =>
        {
            ALREADY_INITIALISED
        }
        Builtin::EkiOpen => {
            state.listens = true;
            0
        }
        Builtin::EkiClose => {
            state.listens = false;
            values.changed = true;
            controller.close_by_program(channel);
            0
        }
        Builtin::EkiLock | Builtin::EkiUnlock => 0,
        _ if !state.initialised => NOT_AVAILABLE,
        Builtin::EkiSend => send(controller, values, channel, tag),
        Builtin::EkiSetBool | Builtin::EkiSetInt | Builtin::EkiSetReal => {
            set(controller, values, channel, tag, value[0])
        }
        Builtin::EkiSetFrame => return Err("the mock controller does not support EKI_SetFrame".to_owned()),
        _ => return Ok(read(controller, channel, what, tag)),
    };
    Ok(eki_answer(controller, channel, msg_no))
}

fn eki_answer(controller: &Controller, channel: Channel, msg_no: i32) -> EkiAnswer {
    let connected = controller.is_connected(channel);
    EkiAnswer { buff: 0, read: 0, msg_no, connected, counter: 0, value: [Cell::Unset; 6] }
}

fn read(controller: &mut Controller, channel: Channel, what: Builtin, tag: &str) -> EkiAnswer {
    let empty = eki_answer(controller, channel, 0);
    let memory = &mut controller.link(channel).memory;
    let Some(place) = memory.find(tag) else { return EkiAnswer { msg_no: NO_ELEMENT, ..empty } };
    let mut value = [Cell::Unset; 6];
    let found = match what {
        Builtin::EkiGetInt => memory.get_int(place).map(|(number, counter)| {
            value[0] = Cell::Int(number);
            counter
        }),
        Builtin::EkiGetReal => memory.get_real(place).map(|(number, counter)| {
            value[0] = Cell::Real(number as f32);
            counter
        }),
        Builtin::EkiGetFrame => memory.get_frame(place).map(|(numbers, counter)| {
            value = numbers.map(|number| Cell::Real(number as f32));
            counter
        }),
        Builtin::EkiGetBool => Err(EkiError::Type),
        Builtin::EkiClearBuffer => {
            memory.clear_buffers();
            return empty;
        }
        _ => {
            let buff = i32::try_from(memory.waiting_count(place)).unwrap_or(i32::MAX);
            return EkiAnswer { buff, ..empty };
        }
    };
    let buff = i32::try_from(memory.waiting_count(place)).unwrap_or(i32::MAX);
    match found {
        Ok(counter) => EkiAnswer { buff, read: 1, counter: counter.cast_signed(), value, ..empty },
        Err(EkiError::Empty) => EkiAnswer { msg_no: 15, ..empty },
        Err(EkiError::Type) => EkiAnswer { buff, msg_no: 20, ..empty },
    }
}

fn set(controller: &Controller, values: &mut ControllerValues, channel: Channel, tag: &str, value: Cell) -> i32 {
    let sent = controller.sent_elements(channel);
    let state = &mut values.channels[channel as usize];
    // Programs set the values in the order of the file, so each search starts after the last match.
    let (before, behind) = sent.split_at(state.set_next.min(sent.len()));
    let Some(place) = behind.iter().chain(before).position(|element| element.tag == tag) else { return NO_ELEMENT };
    let place = (place + before.len()) % sent.len();
    state.set_next = place + 1;
    let value = match value {
        Cell::Int(number) => Value::Int(number),
        Cell::Real(number) => Value::Real(number),
        Cell::Bool(value) => Value::Bool(value),
        _ => Value::Unset,
    };
    state.set[place] = value;
    0
}

fn send(controller: &mut Controller, values: &ControllerValues, channel: Channel, tag: &str) -> i32 {
    if !controller.sent_elements(channel).iter().any(|element| element.tag.split('/').next() == Some(tag)) {
        return NO_ELEMENT;
    }
    if !controller.is_connected(channel) {
        return DISCONNECTED;
    }
    if !controller.troubles.is_channel_silenced(channel) {
        let sent = match channel {
            Channel::Command => &controller.setup.commands.sent,
            Channel::State => &controller.setup.states.sent,
        };
        let template = controller.templates[channel as usize].get_or_insert_with(|| {
            let tags: Vec<&str> = sent.iter().map(|element| element.tag.as_str()).collect();
            Template::new(sent, &tags)
        });
        let out = match channel {
            Channel::Command => &mut controller.commands.out,
            Channel::State => &mut controller.states.out,
        };
        template.write(out, &values.channels[channel as usize].set);
    }
    0
}

impl Controller {
    /// Connects a client. Returns true if the program has opened the channel and no other client is connected.
    pub(in super::super) fn connect_interpreted(&mut self, channel: Channel) -> bool {
        self.wait_for_channel_open(channel);
        let listens =
            self.running.as_ref().is_some_and(|running| running.values.channels[channel as usize].listens);
        if !listens || self.is_connected(channel) {
            return false;
        }
        let link = self.link(channel);
        link.out.clear();
        (link.connected, link.fault) = (true, None);
        self.show_alive(channel);
        self.note_change();
        true
    }

    /// Processes the loss of a client, or a channel that EthernetKRL has closed. The channel stays closed until the
    /// program opens it.
    pub(in super::super) fn lose_interpreted(&mut self, channel: Channel, fault: EkiFault) {
        let link = self.link(channel);
        if !link.connected {
            return;
        }
        (link.connected, link.fault) = (false, Some(fault));
        link.out.clear();
        self.clear_held(channel);
        self.show_alive(channel);
        if let Some(running) = &mut self.running {
            running.values.channels[channel as usize].listens = false;
        }
        self.note_change();
    }

    /// Closes the channel at the request of the program.
    pub(super) fn close_by_program(&mut self, channel: Channel) {
        self.troubles.cable_buffer[channel as usize].clear();
        self.troubles.hung_up[channel as usize] = false;
        let link = self.link(channel);
        link.connected = false;
        link.out.clear();
        self.show_alive(channel);
    }

    pub(super) fn sent_elements(&self, channel: Channel) -> &[Element] {
        match channel {
            Channel::Command => &self.setup.commands.sent,
            Channel::State => &self.setup.states.sent,
        }
    }

    /// Notes that the condition of an interrupt may have changed.
    pub(in super::super) fn note_change(&mut self) {
        if let Some(running) = &mut self.running {
            running.values.changed = true;
        }
    }
}
