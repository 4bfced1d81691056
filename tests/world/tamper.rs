//! Changes of messages in transit: lost, doubled, late, out of order, damaged; and messages with values that no intact
//! controller sends.

use super::link_cell::Tamper;
use super::script::Harm;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Maximum number of stored messages that may be sent again.
const MAX_KEPT_MESSAGES: usize = 60;
/// The operation of an abort request, as it is written in its message.
const ABORT: &str = " Op=\"11\"";
const HEARTBEAT: &str = " Op=\"10\"";

/// The planned changes of the next messages.
#[derive(Debug, Default)]
pub struct Tampering {
    /// The faults of the next messages: whether the message goes to the controller, the channel, and the fault.
    pub harms: Vec<(bool, usize, Harm)>,
    /// Wrong values in messages of the controller: the channel, an attribute, its wrong value, and the number of
    /// messages.
    pub lies: Vec<(usize, String, String, u32)>,
    /// Number of messages that were changed.
    pub applied: u64,
    /// Number of messages with commands of an ended epoch that must arrive again.
    pub replays: u32,
    /// Number of aborts that are answered like heartbeats, so that nothing is stopped.
    pub unheeded: u32,
    /// The last messages with commands, each with its epoch.
    sent: VecDeque<(u32, Vec<u8>)>,
    /// Messages that wait for the following one.
    held: Vec<(bool, usize, Vec<u8>)>,
}

impl Tampering {
    /// Returns the function that the connection calls for each message.
    pub fn port(shared: Arc<Mutex<Tampering>>) -> Tamper {
        Box::new(move |to_robot, channel, bytes| {
            shared.lock().unwrap_or_else(PoisonError::into_inner).message(to_robot, channel, bytes)
        })
    }

    fn message(&mut self, to_robot: bool, channel: usize, bytes: &[u8]) -> Option<Vec<(u64, Vec<u8>)>> {
        if let Some(asked) = self.unheard(to_robot, channel, bytes) {
            return Some(vec![(0, asked)]);
        }
        let replayed = if to_robot && channel == 0 { self.replayed(bytes) } else { vec![] };
        let pieces = self.harmed(to_robot, channel, bytes);
        if replayed.is_empty() {
            return pieces;
        }
        let pieces = pieces.unwrap_or_else(|| vec![(0, bytes.to_vec())]);
        Some(replayed.into_iter().map(|bytes| (0, bytes)).chain(pieces).collect())
    }

    /// Returns a heartbeat instead of an abort, if an abort must be replaced.
    fn unheard(&mut self, to_robot: bool, channel: usize, bytes: &[u8]) -> Option<Vec<u8>> {
        if !to_robot || channel == 0 || self.unheeded == 0 {
            return None;
        }
        let text = std::str::from_utf8(bytes).ok().filter(|text| text.contains(ABORT))?;
        self.unheeded -= 1;
        Some(text.replace(ABORT, HEARTBEAT).into_bytes())
    }

    /// Returns earlier messages of another epoch than that of this message, if they must arrive again. None of them may
    /// have an effect.
    fn replayed(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let Some(epoch) = epoch_of(bytes) else { return vec![] };
        self.sent.push_back((epoch, bytes.to_vec()));
        if self.sent.len() > MAX_KEPT_MESSAGES {
            self.sent.pop_front();
        }
        if self.replays == 0 {
            return vec![];
        }
        let ended: Vec<Vec<u8>> =
            self.sent.iter().filter(|(of, _)| *of < epoch).map(|(_, bytes)| bytes.clone()).collect();
        let count = ended.len().min(self.replays as usize);
        if count > 0 {
            self.replays = 0;
        }
        ended[ended.len() - count..].to_vec()
    }

    fn harmed(&mut self, to_robot: bool, channel: usize, bytes: &[u8]) -> Option<Vec<(u64, Vec<u8>)>> {
        let lied = if to_robot { None } else { self.lie(channel, bytes) };
        let bytes = lied.as_deref().unwrap_or(bytes);
        let harm = self.harms.iter().position(|(way, of, _)| (*way, *of) == (to_robot, channel));
        let harm = harm.map(|index| self.harms.remove(index).2);
        self.applied += u64::from(harm.is_some() || lied.is_some());
        let mut pieces = match harm {
            None if lied.is_none() && self.held.is_empty() => return None,
            None => vec![(0, bytes.to_vec())],
            Some(Harm::Lose) => vec![],
            Some(Harm::Twice) => vec![(0, bytes.to_vec()), (0, bytes.to_vec())],
            Some(Harm::Swap) => {
                self.held.push((to_robot, channel, bytes.to_vec()));
                return Some(vec![]);
            }
            Some(Harm::Damage { byte, bit }) => {
                let mut damaged = bytes.to_vec();
                let place = byte as usize % damaged.len().max(1);
                if let Some(byte) = damaged.get_mut(place) {
                    *byte ^= 1 << (bit & 7);
                }
                vec![(0, damaged)]
            }
            Some(Harm::Half) => vec![(0, bytes[..bytes.len() / 2].to_vec())],
            Some(Harm::Late(ms)) => vec![(ms, bytes.to_vec())],
        };
        let held = self.held.extract_if(.., |(way, of, _)| (*way, *of) == (to_robot, channel));
        pieces.extend(held.map(|(.., bytes)| (0, bytes)));
        Some(pieces)
    }

    /// Returns the message with a wrong attribute value, if one is planned.
    fn lie(&mut self, channel: usize, bytes: &[u8]) -> Option<Vec<u8>> {
        let index = self.lies.iter().position(|(of, ..)| *of == channel)?;
        let (_, name, value, times) = &mut self.lies[index];
        let text = std::str::from_utf8(bytes).ok()?;
        let begin = format!(" {name}=\"");
        let from = text.find(&begin)? + begin.len();
        let end = from + text[from..].find('"')?;
        let lied = format!("{}{value}{}", &text[..from], &text[end..]);
        *times = times.saturating_sub(1);
        if *times == 0 {
            self.lies.remove(index);
        }
        Some(lied.into_bytes())
    }
}

/// Returns the epoch of a message's first command.
fn epoch_of(bytes: &[u8]) -> Option<u32> {
    let text = std::str::from_utf8(bytes).ok()?;
    text.split(" Ep=\"").nth(1)?.split('"').next()?.parse().ok()
}
