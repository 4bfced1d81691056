//! The daemon's end of the socket: one request, one answer, each with a deadline.

use super::clock::now_ns;
use super::message::{Hello, Reply, Request, ShotInfo, Size};
use super::sensor::ShotPlanes;
use super::wire::{self, FrameKind, OpenedFrame, WireError};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A connection to a worker.
#[derive(Debug)]
pub struct Link {
    stream: UnixStream,
    sequence: u32,
    is_ending: Arc<AtomicBool>,
}

/// An answer with its data.
#[derive(Debug)]
pub enum Answer {
    /// A reply without image data.
    Words(Reply),
    /// A 3D shot.
    Scan(ShotDelivery, ShotPlanes),
    /// A picture.
    Picture(ShotDelivery, Vec<[u8; 3]>),
}

/// A shot as it was delivered.
#[derive(Debug, Clone, PartialEq)]
pub struct ShotDelivery {
    /// The metadata of the shot.
    pub metadata: ShotInfo,
    /// The checksum of its payload.
    pub sum: u32,
    /// Time at which the shot had arrived completely, ns of the monotonic clock.
    pub arrived_ns: u64,
}

impl Link {
    /// Creates a link over this socket. If `is_ending` becomes true, the present wait is abandoned.
    pub fn new(stream: UnixStream, is_ending: Arc<AtomicBool>) -> Self {
        Link { stream, sequence: 0, is_ending }
    }

    /// Returns the worker's first message.
    ///
    /// # Errors
    /// If it does not arrive in time or cannot be read.
    pub fn receive_hello(&mut self, within: Duration) -> Result<Hello, WireError> {
        let mut timed = self.with_deadline(Instant::now() + within);
        let opened = wire::open(&mut timed, FrameKind::Hello)?;
        let hello = serde_json::from_slice(&opened.head)?;
        opened.finish_without_payload(&mut timed)?;
        Ok(hello)
    }

    /// Sends a request and waits for the answer.
    ///
    /// # Errors
    /// If no answer arrives in time, or the received data are not an answer. No request is possible afterwards: it
    /// is unknown what is in progress.
    pub fn send_and_receive(&mut self, request: &Request, within: Duration) -> Result<Answer, WireError> {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        let mut timed = self.with_deadline(Instant::now() + within);
        wire::write(&mut timed, (FrameKind::Request, sequence), &serde_json::to_vec(request)?, &[])?;
        let opened = wire::open(&mut timed, FrameKind::Reply)?;
        if opened.sequence != sequence {
            return Err(WireError::Sequence { found: opened.sequence, allowed: sequence });
        }
        match serde_json::from_slice(&opened.head)? {
            Reply::Scan(taken) => scan(opened, &mut timed, taken),
            Reply::Picture(taken) => {
                opened.check_payload_size(bytes(taken.size, 3))?;
                let mut rgb = vec![[0; 3]; taken.size.pixels()];
                let sum = opened.payload(&mut timed, &mut [rgb.as_flattened_mut()])?;
                Ok(Answer::Picture(ShotDelivery { metadata: taken, sum, arrived_ns: now_ns() }, rgb))
            }
            words => {
                opened.finish_without_payload(&mut timed)?;
                Ok(Answer::Words(words))
            }
        }
    }

    fn with_deadline(&self, until: Instant) -> TimedSocket<'_> {
        TimedSocket { stream: &self.stream, until, is_ending: &self.is_ending }
    }
}

/// Bytes of one point: x, y, z as f32, three colours, one f32.
const SCAN_BYTES: usize = 12 + 3 + 4;

fn bytes(size: Size, each: usize) -> usize {
    size.pixels().saturating_mul(each)
}

fn scan(opened: OpenedFrame, timed: &mut TimedSocket<'_>, taken: ShotInfo) -> Result<Answer, WireError> {
    opened.check_payload_size(bytes(taken.size, SCAN_BYTES))?;
    // Read directly into its final memory.
    let mut planes = ShotPlanes::with_size(taken.size);
    let into = &mut [
        bytemuck::cast_slice_mut(planes.points_mm.as_mut_slice()),
        planes.colors.as_flattened_mut(),
        bytemuck::cast_slice_mut(planes.snr.as_mut_slice()),
    ];
    let sum = opened.payload(timed, into)?;
    Ok(Answer::Scan(ShotDelivery { metadata: taken, sum, arrived_ns: now_ns() }, planes))
}

/// Interval of checks whether the program ends.
const SHUTDOWN_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// A socket with one deadline for all reads and writes.
struct TimedSocket<'a> {
    stream: &'a UnixStream,
    until: Instant,
    is_ending: &'a AtomicBool,
}

impl TimedSocket<'_> {
    /// Returns the time for one wait; an error if the time is over.
    fn remaining_wait(&self) -> std::io::Result<Duration> {
        if self.is_ending.load(Ordering::Relaxed) {
            return Err(std::io::Error::other("the program ends"));
        }
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left.min(SHUTDOWN_POLL_INTERVAL)) }
    }
}

impl Read for TimedSocket<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        loop {
            self.stream.set_read_timeout(Some(self.remaining_wait()?))?;
            match (&*self.stream).read(bytes) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                other => return other,
            }
        }
    }
}

impl Write for TimedSocket<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        loop {
            self.stream.set_write_timeout(Some(self.remaining_wait()?))?;
            match (&*self.stream).write(bytes) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                other => return other,
            }
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
