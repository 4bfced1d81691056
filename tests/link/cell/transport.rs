//! The bytes in transit in each of the four directions, with the delay and the pieces that the cell states, and with
//! the ends of connections.

use super::{Cell, Insides, Watch};
use panelprep::devices::mock;
use panelprep::eki::{Channel, LinkLoss, Report, Time};
use rand::RngExt;
use std::collections::VecDeque;

pub(super) enum Piece {
    Bytes(Vec<u8>),
    End,
}

/// The bytes in transit in one direction of one connection.
#[derive(Default)]
pub(super) struct Direction {
    pieces: VecDeque<(u64, Piece)>,
}

impl Direction {
    pub(super) fn put(&mut self, due_ms: u64, piece: Piece) {
        let due_ms = self.pieces.back().map_or(due_ms, |(last_ms, _)| due_ms.max(*last_ms));
        self.pieces.push_back((due_ms, piece));
    }

    fn pop(&mut self, now_ms: u64) -> Option<Piece> {
        self.pieces.pop_front_if(|(due_ms, _)| *due_ms <= now_ms).map(|(_, piece)| piece)
    }

    pub(super) fn due_ms(&self) -> Option<u64> {
        self.pieces.front().map(|(due_ms, _)| *due_ms)
    }
}

pub(super) const CHANNELS: [(Channel, mock::Channel); 2] =
    [(Channel::Command, mock::Channel::Command), (Channel::State, mock::Channel::State)];

impl Cell {
    pub(super) fn connect(&mut self) {
        if self.up || self.now_ms < self.retry_at_ms {
            return;
        }
        let opened = CHANNELS.map(|(_, end)| self.controller.connect(end));
        if opened == [true; 2] {
            (self.up, self.robot_open) = (true, [true; 2]);
            self.to_robot = Default::default();
            self.to_client = Default::default();
            (self.heard_ms, self.reached_ms) = (self.now_ms, self.now_ms);
            self.session.connected(Time::from_ms(self.now_ms));
            return;
        }
        for ((_, end), opened) in CHANNELS.into_iter().zip(opened) {
            if opened {
                self.controller.disconnect(end);
            }
        }
        let refused = LinkLoss::Refused { channel: Channel::Command, address: "the mock".to_owned() };
        self.session.disconnected(refused);
        self.back_off();
    }

    fn back_off(&mut self) {
        self.retry_at_ms = self.now_ms + self.pause_ms;
        self.pause_ms = (2 * self.pause_ms).min(1_000);
    }

    pub(super) fn reach_robot(&mut self) {
        if self.now_ms < self.deaf_until_ms {
            return;
        }
        for (index, (_, end)) in CHANNELS.into_iter().enumerate() {
            while let Some(piece) = self.to_robot[index].pop(self.now_ms) {
                self.reached_ms = self.now_ms;
                match (piece, end) {
                    (Piece::Bytes(bytes), mock::Channel::Command) => self.controller.command_bytes(&bytes),
                    (Piece::Bytes(bytes), mock::Channel::State) => self.controller.state_bytes(&bytes),
                    (Piece::End, _) => self.controller.disconnect(end),
                }
            }
        }
    }

    pub(super) fn leave_robot(&mut self) {
        for (index, (_, end)) in CHANNELS.into_iter().enumerate() {
            let bytes = self.controller.take_output_bytes(end);
            if !bytes.is_empty() && self.up {
                self.messages += 1;
                self.put(false, index, &bytes);
            }
            if self.robot_open[index] && !self.controller.is_connected(end) {
                self.robot_open[index] = false;
                let due_ms = self.now_ms + self.delay_ms.0;
                self.to_client[index].put(due_ms, Piece::End);
            }
        }
    }

    fn put(&mut self, to_robot: bool, index: usize, bytes: &[u8]) {
        let Some(tamper) = &mut self.tamper else { return self.put_late(to_robot, index, bytes, 0) };
        match tamper(to_robot, index, bytes) {
            None => self.put_late(to_robot, index, bytes, 0),
            Some(pieces) => {
                for (late_ms, piece) in pieces {
                    self.put_late(to_robot, index, &piece, late_ms);
                }
            }
        }
    }

    fn put_late(&mut self, to_robot: bool, index: usize, bytes: &[u8], late_ms: u64) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let length = if self.fragment { self.draw.random_range(1..=rest.len()) } else { rest.len() };
            let (piece, behind) = rest.split_at(length);
            let due_ms = self.now_ms + late_ms + self.draw.random_range(self.delay_ms.0..=self.delay_ms.1);
            let way = if to_robot { &mut self.to_robot[index] } else { &mut self.to_client[index] };
            way.put(due_ms, Piece::Bytes(piece.to_vec()));
            rest = behind;
        }
    }

    pub(super) fn reach_client(&mut self) {
        for (index, (channel, _)) in CHANNELS.into_iter().enumerate() {
            while let Some(piece) = self.to_client[index].pop(self.now_ms) {
                if !self.session.is_connected() {
                    continue;
                }
                let now = Time::from_ms(self.now_ms);
                match (piece, channel) {
                    (Piece::Bytes(bytes), Channel::Command) => self.session.push_command_bytes(&bytes, now),
                    (Piece::Bytes(bytes), Channel::State) => {
                        self.heard_ms = self.now_ms;
                        self.session.push_state_bytes(&bytes, now);
                    }
                    (Piece::End, _) => self.session.disconnected(LinkLoss::Closed { channel }),
                }
            }
        }
    }

    pub(super) fn leave_client(&mut self, watch: &mut impl Watch) {
        while let Some((channel, bytes)) = self.session.poll_transmit(Time::from_ms(self.now_ms)) {
            if channel == Channel::Command {
                let (epoch, id) = epoch_and_id(&bytes);
                watch.sent(epoch, id, self.now_ms);
            }
            if self.up {
                self.messages += 1;
                self.put(true, usize::from(channel == Channel::State), &bytes);
            }
        }
        if self.up && !self.session.is_connected() {
            self.up = false;
            self.to_robot.iter_mut().for_each(|way| way.put(self.now_ms + self.delay_ms.0, Piece::End));
            self.to_client = Default::default();
            self.back_off();
        }
        while let Some(report) = self.session.poll_report() {
            if matches!(report, Report::Connected { .. }) {
                self.pause_ms = 100;
            }
            let Cell { session, controller, now_ms, heard_ms, .. } = &*self;
            let insides = Insides { session, controller, now_ms: *now_ms, heard_ms: *heard_ms, stalled: false };
            watch.on_report(&report, &insides);
            self.reports.push_back(report);
        }
    }
}

/// Returns the epoch and the ID of a command from its bytes: `<Cmd Id="17" Ep="3" …`.
fn epoch_and_id(bytes: &[u8]) -> (u32, u32) {
    let text = std::str::from_utf8(bytes).expect("ASCII");
    let mut values = text.split('"').skip(1).step_by(2).map(|value| value.parse::<u32>().expect("a number"));
    let id = values.next().expect("an id");
    (values.next().expect("an epoch"), id)
}
