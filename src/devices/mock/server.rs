//! A mock controller that listens on two TCP ports, with one client each.
//!
//! One thread accepts clients and, on the wall clock, advances the time; one thread per client reads its bytes. All
//! output of a call to the controller is sent before the next call, acknowledgements first. On a simulated slow
//! connection, bytes arrive late but in order, in fragments that do not match the boundaries of documents.

use super::channel_file::MockError;
use super::model::{Controller, TICK_MS};
use super::options::Clock;
use super::wire::Channel;
use panelprep_base::geometry::{Base, Flange, Rigid};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Maximum time for a write to a client; if the client does not read, its connection is closed.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);
/// Interval of the checks for new clients. On the wall clock, the ticks that are due since the last check are executed
/// as well.
const POLL_INTERVAL: Duration = Duration::from_millis(3);

/// The addresses on which the mock listens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ports {
    /// IP address of the computer; the loopback address for a mock inside this program.
    pub host: IpAddr,
    /// TCP port of the command channel; 0 selects a free port.
    pub command: u16,
    /// TCP port of the state channel; 0 selects a free port.
    pub state: u16,
}

impl Ports {
    /// Returns the loopback address with two free ports.
    pub fn free_ports() -> Self {
        Ports { host: IpAddr::V4(Ipv4Addr::LOCALHOST), command: 0, state: 0 }
    }
}

struct Shared {
    controller: Controller,
    command: Option<TcpStream>,
    state: Option<TcpStream>,
    /// The delayed streams to the controller, one for each channel; the next field has those to the clients.
    slow_inputs: [DelayedStream; 2],
    slow_outputs: [DelayedStream; 2],
}

impl Shared {
    fn stream(&mut self, channel: Channel) -> &mut Option<TcpStream> {
        match channel {
            Channel::Command => &mut self.command,
            Channel::State => &mut self.state,
        }
    }

    /// Passes received bytes to the controller, sends the controller's output, and disconnects a client whose channel
    /// the controller has closed.
    fn exchange_bytes(&mut self) {
        let now = Instant::now();
        for channel in [Channel::Command, Channel::State] {
            while let Some(bytes) = self.slow_inputs[channel as usize].pop(now) {
                self.deliver(channel, &bytes);
            }
        }
        for channel in [Channel::Command, Channel::State] {
            let bytes = self.controller.take_output_bytes(channel);
            if self.stream(channel).is_none() {
                continue;
            }
            self.slow_outputs[channel as usize].send_bytes(now, &bytes);
            let mut sent = true;
            while let Some(piece) = self.slow_outputs[channel as usize].pop(now) {
                let stream = self.stream(channel).as_mut();
                sent &= stream.is_some_and(|stream| stream.write_all(&piece).is_ok());
            }
            if !sent || !self.controller.is_connected(channel) {
                self.disconnect_client(channel);
            }
        }
    }

    fn deliver(&mut self, channel: Channel, bytes: &[u8]) {
        match channel {
            Channel::Command => self.controller.command_bytes(bytes),
            Channel::State => self.controller.state_bytes(bytes),
        }
    }

    fn disconnect_client(&mut self, channel: Channel) {
        if let Some(stream) = self.stream(channel).take() {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "an error means that the client has already disconnected"
            )]
            let _ = stream.shutdown(Shutdown::Both);
        }
        self.slow_inputs[channel as usize].clear();
        self.slow_outputs[channel as usize].clear();
        self.controller.disconnect(channel);
    }
}

/// A handle of the controller in a running server, for cameras that request the flange pose and for tests that press
/// keys.
#[derive(Clone)]
pub struct MockHandle {
    shared: Arc<Mutex<Shared>>,
}

impl MockHandle {
    fn lock(&self) -> MutexGuard<'_, Shared> {
        // The lock is used even after a panic. Otherwise the failure of a test that holds the lock would be hidden by a
        // second failure here.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `act` with the controller, between two of its ticks, and sends the resulting output.
    pub fn with_controller<T>(&self, act: impl FnOnce(&mut Controller) -> T) -> T {
        let mut shared = self.lock();
        let result = act(&mut shared.controller);
        shared.exchange_bytes();
        result
    }

    /// Returns the current flange pose.
    pub fn flange_pose(&self) -> Rigid<Base, Flange> {
        self.lock().controller.flange_pose()
    }
}

/// A mock controller that listens on TCP ports. Dropping it closes its channels and ends its threads.
pub struct MockServer {
    handle: MockHandle,
    command_address: SocketAddr,
    state_address: SocketAddr,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl MockServer {
    /// Starts a mock controller that listens on these ports.
    ///
    /// # Errors
    /// If a port is in use, or the operating system cannot start a thread.
    pub fn start(controller: Controller, ports: Ports) -> Result<Self, MockError> {
        let clock = controller.clock();
        let (command, command_address) = listen(SocketAddr::new(ports.host, ports.command))?;
        let (state, state_address) = listen(SocketAddr::new(ports.host, ports.state))?;
        let (delay_ms, fragment, seed) = controller.wire_faults();
        let way = |index: u64| DelayedStream::new(delay_ms, fragment, seed.wrapping_add(index));
        let (ways_in, ways_out) = ([way(0), way(1)], [way(2), way(3)]);
        let shared =
            Shared { controller, command: None, state: None, slow_inputs: ways_in, slow_outputs: ways_out };
        let handle = MockHandle { shared: Arc::new(Mutex::new(shared)) };
        let ends = Arc::new(AtomicBool::new(false));
        let rounds = AcceptThread {
            handle: handle.clone(),
            listeners: [(Channel::Command, command), (Channel::State, state)],
            ending: ends.clone(),
            readers: Vec::new(),
        };
        let thread = std::thread::Builder::new().name("mock controller".to_owned());
        let thread = thread.spawn(move || rounds.run(clock)).map_err(MockError::Thread)?;
        Ok(MockServer { handle, command_address, state_address, ending: ends, thread: Some(thread) })
    }

    /// The controller inside.
    pub fn handle(&self) -> MockHandle {
        self.handle.clone()
    }

    /// Returns the address of the command channel.
    pub fn command_address(&self) -> SocketAddr {
        self.command_address
    }

    /// Returns the address of the state channel.
    pub fn state_address(&self) -> SocketAddr {
        self.state_address
    }
}

impl Drop for MockServer {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "the panic of the thread was already reported")]
            let _ = thread.join();
        }
    }
}

fn listen(address: SocketAddr) -> Result<(TcpListener, SocketAddr), MockError> {
    let failed = |reason| MockError::Listen { address, reason };
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    Ok((listener, address))
}

/// The thread that accepts clients and, on the wall clock, advances the time.
struct AcceptThread {
    handle: MockHandle,
    listeners: [(Channel, TcpListener); 2],
    ending: Arc<AtomicBool>,
    readers: Vec<JoinHandle<()>>,
}

impl AcceptThread {
    fn run(mut self, clock: Clock) {
        let started = Instant::now();
        let mut passed_ms = 0;
        while !self.ending.load(Ordering::Relaxed) {
            self.accept();
            if clock == Clock::Free {
                let now_ms = started.elapsed().as_millis() as u64;
                if now_ms >= passed_ms + TICK_MS {
                    self.handle.with_controller(|controller| controller.advance_ms(now_ms - passed_ms));
                    passed_ms = now_ms;
                }
            }
            self.handle.lock().exchange_bytes();
            std::thread::sleep(POLL_INTERVAL);
        }
        for (channel, _) in &self.listeners {
            self.handle.lock().disconnect_client(*channel);
        }
        for reader in self.readers.drain(..) {
            #[expect(clippy::let_underscore_must_use, reason = "the panic of the thread was already reported")]
            let _ = reader.join();
        }
    }

    fn accept(&mut self) {
        for (channel, listener) in &self.listeners {
            // If the channel already has a client, another client is disconnected immediately.
            while let Ok((stream, _)) = listener.accept() {
                if let Some(reader) = accept_client(&self.handle, *channel, stream) {
                    self.readers.push(reader);
                }
            }
        }
        self.readers.retain(|reader| !reader.is_finished());
    }
}

fn accept_client(handle: &MockHandle, channel: Channel, stream: TcpStream) -> Option<JoinHandle<()>> {
    let mut shared = handle.lock();
    if shared.stream(channel).is_some() {
        return None;
    }
    let prepared = stream
        .set_nonblocking(false)
        .and_then(|()| stream.set_nodelay(true))
        .and_then(|()| stream.set_write_timeout(Some(WRITE_TIMEOUT)))
        .and_then(|()| stream.try_clone());
    let reading = prepared.ok()?;
    let reader = handle.clone();
    if !shared.controller.connect(channel) {
        return None; // it does not listen again yet
    }
    let thread = std::thread::Builder::new().name(
        match channel {
            Channel::Command => "mock command channel",
            Channel::State => "mock state channel",
        }
        .to_owned(),
    );
    let thread = thread.spawn(move || read(&reader, channel, reading)).ok();
    match thread {
        Some(_) => *shared.stream(channel) = Some(stream),
        None => shared.controller.disconnect(channel),
    }
    thread
}

/// Reads bytes of a client until the client or the controller closes the connection.
fn read(handle: &MockHandle, channel: Channel, mut stream: TcpStream) {
    let mut bytes = vec![0; 65_536];
    loop {
        let count = match stream.read(&mut bytes) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(_) => break,
        };
        let mut shared = handle.lock();
        shared.slow_inputs[channel as usize].send_bytes(Instant::now(), &bytes[..count]);
        shared.exchange_bytes();
        if shared.stream(channel).is_none() {
            return;
        }
    }
    let mut shared = handle.lock();
    shared.disconnect_client(channel);
    shared.exchange_bytes();
}

/// One direction of a connection, with a random delay of its bytes.
#[derive(Debug)]
struct DelayedStream {
    delay_ms: Option<(u64, u64)>,
    fragment: bool,
    draw: Pcg64,
    pieces: VecDeque<(Instant, Vec<u8>)>,
}

impl DelayedStream {
    pub(super) fn new(delay_ms: Option<(u64, u64)>, fragment: bool, seed: u64) -> Self {
        DelayedStream { delay_ms, fragment, draw: Pcg64::seed_from_u64(seed), pieces: VecDeque::new() }
    }

    /// Adds bytes to the stream; they arrive after a random delay.
    fn send_bytes(&mut self, now: Instant, bytes: &[u8]) {
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

    /// Returns the next fragment that has arrived.
    pub(super) fn pop(&mut self, now: Instant) -> Option<Vec<u8>> {
        self.pieces.pop_front_if(|(due, _)| *due <= now).map(|(_, piece)| piece)
    }

    /// Discards the bytes in transit, because the connection is lost.
    pub(super) fn clear(&mut self) {
        self.pieces.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With a delay of 5 to 15 ms, none of 100 bytes arrives before 5 ms; at 15 ms all have arrived, in order, in more
    /// than one fragment.
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
