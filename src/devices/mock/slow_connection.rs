//! A slow connection: bytes arrive late, in order, in pieces that do not follow the documents' boundaries.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// One direction of one connection.
#[derive(Debug)]
pub(super) struct DelayedStream {
    delay_ms: Option<(u64, u64)>,
    fragment: bool,
    draw: Pcg64,
    pieces: VecDeque<(Instant, Vec<u8>)>,
}

impl DelayedStream {
    pub(super) fn new(delay_ms: Option<(u64, u64)>, fragment: bool, seed: u64) -> Self {
        DelayedStream { delay_ms, fragment, draw: Pcg64::seed_from_u64(seed), pieces: VecDeque::new() }
    }

    /// Sends bytes with the delay.
    pub(super) fn send_bytes(&mut self, now: Instant, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let length = if self.fragment { self.draw.random_range(1..=rest.len()) } else { rest.len() };
            let (piece, behind) = rest.split_at(length);
            let late_ms = self.delay_ms.map_or(0, |(low, high)| self.draw.random_range(low..=high));
            let due = now + Duration::from_millis(late_ms);
            let due = self.pieces.back().map_or(due, |(last, _)| due.max(*last));
            self.pieces.push_back((due, piece.to_vec()));
            rest = behind;
        }
    }

    /// Returns the next piece that has arrived.
    pub(super) fn pop(&mut self, now: Instant) -> Option<Vec<u8>> {
        self.pieces.pop_front_if(|(due, _)| *due <= now).map(|(_, piece)| piece)
    }

    /// Clears the stream: the connection is lost, and with it the bytes in transit.
    pub(super) fn clear(&mut self) {
        self.pieces.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 bytes with 5 to 15 ms of delay: none before 5 ms, all at 15 ms, in order, in more than one piece.
    #[test]
    fn bytes_come_late_in_order_and_in_pieces() {
        let mut way = DelayedStream::new(Some((5, 15)), true, 1);
        let (now, bytes): (Instant, Vec<u8>) = (Instant::now(), (0..100).collect());
        way.send_bytes(now, &bytes);
        assert_eq!(way.pop(now + Duration::from_millis(4)), None);
        let mut found: Vec<Vec<u8>> = Vec::new();
        while let Some(piece) = way.pop(now + Duration::from_millis(15)) {
            found.push(piece);
        }
        assert!(found.len() > 1 && found.concat() == bytes);
    }
}
