//! Injects the fault: decides what happens to each message between the service and the controller.

use super::draw::Draw;
use super::lie::{Change, Kind, MessageFault, Way};
use super::message;
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Number of messages that are stored per direction, to be sent again later.
const REMEMBERED: usize = 40;
/// Invalid bytes between messages, which neither a controller nor the service would send.
const GARBAGE: [&[u8]; 6] = [b"xyz", b"<a/>", b"</St>", b"<", b"\xff\xfe<", b"<!DOCTYPE a [<!ENTITY b \"c\">]>"];

/// The data that is sent instead of a message.
#[derive(Debug)]
pub enum Piece {
    /// Bytes that are sent after this additional delay.
    Bytes(Duration, Vec<u8>),
    /// The request to close both ends of the connection.
    Close,
}

#[derive(Debug)]
struct ActiveFault {
    lie: MessageFault,
    since: Instant,
    left: u64,
    held: Option<Vec<u8>>,
    kept: Option<String>,
}

#[derive(Debug)]
struct Inside {
    active: Option<ActiveFault>,
    /// Number of messages that were changed.
    count: u64,
    memory: [VecDeque<Vec<u8>>; 4],
    draw: Draw,
    /// Bytes of an old connection that are sent first on the next connection.
    replayed: Option<(Way, Vec<u8>)>,
    /// For each channel, the time until which no connection is accepted.
    refused_until: [Option<Instant>; 2],
}

#[derive(Debug)]
pub struct FaultInjector(Mutex<Inside>);

impl FaultInjector {
    pub fn new(draw: Draw) -> Self {
        let (memory, refused_until) = Default::default();
        FaultInjector(Mutex::new(Inside { active: None, count: 0, memory, draw, replayed: None, refused_until }))
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins to inject this fault.
    pub fn begin(&self, lie: &MessageFault) {
        let mut inside = self.lock();
        if lie.kind == Kind::OldBytes {
            let old: Vec<u8> =
                inside.memory[lie.way as usize].iter().rev().take(8).rev().flatten().copied().collect();
            inside.replayed = Some((lie.way, old));
        }
        if lie.kind == Kind::Refuse {
            let until = Instant::now() + Duration::from_millis(lie.lasts_ms);
            inside.count += 1;
            for channel in 0..2 {
                if lie.both || lie.way.channel() == channel {
                    inside.refused_until[channel] = Some(until);
                }
            }
        }
        inside.active =
            Some(ActiveFault { lie: lie.clone(), since: Instant::now(), left: lie.times, held: None, kept: None });
    }

    /// Ends the fault: from now on messages are forwarded unchanged.
    pub fn end(&self) {
        let mut inside = self.lock();
        (inside.active, inside.replayed, inside.refused_until) = (None, None, [None; 2]);
    }

    pub fn note(&self) {
        self.lock().count += 1;
    }

    pub fn count(&self) -> u64 {
        self.lock().count
    }

    /// Returns whether the fault has been injected completely.
    pub fn is_over(&self) -> bool {
        self.lock().active.as_ref().is_none_or(|active| active.left == 0 || active.is_late())
    }

    pub fn refuses(&self, channel: usize) -> bool {
        self.lock().refused_until[channel].is_some_and(|until| Instant::now() < until)
    }

    /// Returns the bytes that are sent first on a new connection, if there are any.
    pub fn beginning(&self, way: Way) -> Option<Vec<u8>> {
        let mut inside = self.lock();
        let (_, bytes) = inside.replayed.take_if(|(of, bytes)| *of == way && !bytes.is_empty())?;
        inside.count += 1;
        Some(bytes)
    }

    /// Applies the fault to a message. Returns the data that is sent instead of the message.
    pub fn pass(&self, way: Way, document: Vec<u8>) -> Vec<Piece> {
        let mut inside = self.lock();
        let memory = &mut inside.memory[way as usize];
        memory.push_back(document.clone());
        if memory.len() > REMEMBERED {
            memory.pop_front();
        }
        let Some(mut active) = inside.active.take() else { return vec![now(document)] };
        let held = active.held.take();
        let is_meant = way == active.lie.way && (!active.lie.of_orders || is_order(&document));
        let is_sent = is_meant && active.left > 0 && !active.is_late();
        let mut pieces = Vec::new();
        if is_sent {
            let is_swapped = held.is_some();
            pieces = inside.change(&mut active, document);
            pieces.extend(held.map(now));
            if active.lie.kind != Kind::Reorder || is_swapped {
                active.left -= 1;
            }
        } else if way == active.lie.way {
            pieces.extend(held.map(now));
            pieces.push(now(document));
        } else {
            active.held = held;
            pieces.push(now(document));
        }
        inside.active = Some(active);
        pieces
    }
}

impl ActiveFault {
    fn is_late(&self) -> bool {
        self.since.elapsed() >= Duration::from_millis(self.lie.lasts_ms)
    }
}

/// Returns whether the message is a request that stops or opens an epoch.
fn is_order(document: &[u8]) -> bool {
    matches!(message::whole(&String::from_utf8_lossy(document), "Op"), 11 | 12)
}

fn now(bytes: Vec<u8>) -> Piece {
    Piece::Bytes(Duration::ZERO, bytes)
}

impl Inside {
    fn change(&mut self, active: &mut ActiveFault, document: Vec<u8>) -> Vec<Piece> {
        let lie = &active.lie;
        let amount = Duration::from_millis(lie.amount_ms);
        self.count += 1;
        match lie.kind {
            Kind::Delay => vec![Piece::Bytes(amount, document)],
            Kind::Jitter => {
                vec![Piece::Bytes(Duration::from_millis(self.draw.below(lie.amount_ms + 1)), document)]
            }
            Kind::Stall => {
                let end = active.since + Duration::from_millis(lie.lasts_ms);
                vec![Piece::Bytes(end.saturating_duration_since(Instant::now()), document)]
            }
            Kind::Loss | Kind::BlackHole => Vec::new(),
            Kind::Duplicate => vec![now(document.clone()), now(document)],
            Kind::Reorder if active.held.is_none() && active.kept.is_none() => {
                active.kept = Some(String::new());
                active.held = Some(document);
                self.count -= 1;
                Vec::new()
            }
            Kind::Reorder => {
                active.kept = None;
                vec![now(document)]
            }
            Kind::Damage => vec![now(self.damaged(document))],
            Kind::Cut => {
                let mut first = document;
                first.truncate(1 + self.draw.below(first.len() as u64 - 1) as usize);
                if lie.both { vec![now(first), Piece::Close] } else { vec![now(first)] }
            }
            Kind::Fragments => {
                (1..).zip(document).map(|(place, byte)| Piece::Bytes(amount * place, vec![byte])).collect()
            }
            Kind::Garbage => vec![now(self.draw.choose(&GARBAGE).to_vec()), now(document)],
            Kind::Close | Kind::Refuse | Kind::OldBytes => {
                self.count -= 1;
                vec![now(document)]
            }
            _ => self.change_meaning(active, document),
        }
    }

    fn damaged(&mut self, mut document: Vec<u8>) -> Vec<u8> {
        let at = self.draw.below(document.len() as u64) as usize;
        document[at] ^= 1 << self.draw.below(8);
        document
    }

    fn change_meaning(&mut self, active: &mut ActiveFault, document: Vec<u8>) -> Vec<Piece> {
        let lie = &active.lie;
        let text = String::from_utf8_lossy(&document).into_owned();
        let kept = active.kept.get_or_insert_with(|| text.clone());
        let changed = match lie.kind {
            Kind::OldState => {
                let old =
                    self.memory[Way::States as usize].iter().rev().nth(10).map(|old| String::from_utf8_lossy(old));
                let Some(old) = old else { return vec![now(document)] };
                match lie.counts_go_on {
                    true => keeping(&old, &text, &["Seq", "Re", "T"]),
                    // The old message is sent after the true message.
                    false => format!("{text}{old}"),
                }
            }
            Kind::Frozen if lie.counts_go_on => keeping(kept, &text, &["Seq", "Re", "T"]),
            Kind::Frozen => kept.clone(),
            Kind::Clock => keeping(&text, kept, &["T"]),
            _ => changed(&text, lie.field, lie.change).unwrap_or_else(|| text.clone()),
        };
        if changed == text {
            // The message is unchanged, so the fault was not injected.
            self.count -= 1;
            active.left = active.left.saturating_add(1);
        }
        vec![now(changed.into_bytes())]
    }
}

/// Returns the document with these values replaced by those of another document.
fn keeping(document: &str, other: &str, names: &[&str]) -> String {
    names.iter().fold(document.to_owned(), |text, name| {
        let value = message::value(other, name).unwrap_or_default();
        message::replaced(&text, name, value).unwrap_or(text)
    })
}

fn changed(text: &str, field: &str, change: Change) -> Option<String> {
    let before = message::value(text, field)?;
    let is_real = before.contains('.');
    let after = match change {
        Change::Set(value) => value.to_owned(),
        Change::Add(more) if is_real => format!("{:.6}", before.parse::<f64>().ok()? + more),
        Change::Add(more) => (before.parse::<i64>().ok()? + more as i64).to_string(),
        Change::Turn(bit) => (before.parse::<i64>().ok()? ^ (1 << bit)).to_string(),
    };
    message::replaced(text, field, &after)
}
