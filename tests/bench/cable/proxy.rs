//! The simulated cable: two real TCP connections between the service and the controller. Their data is divided into
//! messages, which the fault injector may change. Each direction has a thread that reads messages and a thread that
//! writes them at their times. A delayed message also delays the following messages, as in TCP.

use super::liar::{FaultInjector, Piece};
use super::lie::Way;
use super::message::Splitter;
use super::truth::{Side, Truth};
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Interval between two checks for a new client.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
const CONNECT_TIMEOUT: Duration = Duration::from_millis(500);

/// The two sockets of a channel's connection.
#[derive(Debug)]
struct Connection([TcpStream; 2]);

impl Connection {
    fn close(&self) {
        for stream in &self.0 {
            // The result is ignored, because the stream may already be closed.
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
}

/// The state that all threads of a cable share.
#[derive(Debug)]
struct Cable {
    liar: Arc<FaultInjector>,
    truth: Arc<Truth>,
    connections: [Mutex<Option<Arc<Connection>>>; 2],
    ends: AtomicBool,
}

/// The running cable, which carries messages until this value is dropped.
pub struct Proxy(Arc<Cable>);

impl Proxy {
    /// Listens at one address and forwards to the same ports of the other address.
    pub fn start(
        sought: IpAddr,
        controller: IpAddr,
        ports: [u16; 2],
        liar: &Arc<FaultInjector>,
        truth: &Arc<Truth>,
    ) -> Self {
        let (liar, truth) = (Arc::clone(liar), Arc::clone(truth));
        let cable = Arc::new(Cable { liar, truth, connections: Default::default(), ends: AtomicBool::new(false) });
        for (index, port) in ports.into_iter().enumerate() {
            let cable = Arc::clone(&cable);
            let addresses = [sought, controller].map(|host| SocketAddr::new(host, port));
            thread::spawn(move || cable.accept(index, addresses));
        }
        Proxy(cable)
    }

    /// Closes a channel's connection; returns false if there was no connection.
    pub fn close(&self, index: usize) -> bool {
        let connection = self.0.connections[index].lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(connection) = &connection {
            connection.close();
        }
        connection.is_some()
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.0.ends.store(true, Ordering::SeqCst);
        for index in 0..2 {
            self.close(index);
        }
    }
}

impl Cable {
    fn accept(self: Arc<Self>, index: usize, [sought, controller]: [SocketAddr; 2]) {
        let mut listener = None;
        while !self.ends.load(Ordering::SeqCst) {
            if self.liar.refuses(index) {
                listener = None;
            } else if listener.is_none() {
                listener = TcpListener::bind(sought).and_then(|new| new.set_nonblocking(true).map(|()| new)).ok();
            }
            if let Some(Ok((client, _))) = listener.as_ref().map(TcpListener::accept) {
                // The error is ignored: a controller that already has a client, or does not run, accepts no connection.
                let _ = self.carry(index, client, controller);
            }
            thread::sleep(POLL_INTERVAL);
        }
    }

    fn carry(self: &Arc<Self>, index: usize, client: TcpStream, controller: SocketAddr) -> std::io::Result<()> {
        let robot = TcpStream::connect_timeout(&controller, CONNECT_TIMEOUT)?;
        client.set_nonblocking(false)?;
        for stream in [&client, &robot] {
            stream.set_nodelay(true)?;
            stream.set_write_timeout(Some(Duration::from_secs(5)))?;
        }
        let connection = Arc::new(Connection([client.try_clone()?, robot.try_clone()?]));
        *self.connections[index].lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&connection));
        let ways = [[Way::Commands, Way::Acknowledgements], [Way::Requests, Way::States]][index];
        let ends = [(client.try_clone()?, robot.try_clone()?), (robot, client)];
        for (way, (from, to)) in ways.into_iter().zip(ends) {
            let (pieces, due) = channel();
            if let Some(bytes) = self.liar.beginning(way) {
                let _ = pieces.send((Instant::now(), Piece::Bytes(Duration::ZERO, bytes)));
            }
            let (reader, writer) = (Arc::clone(self), Arc::clone(self));
            let closes = Arc::clone(&connection);
            thread::spawn(move || reader.read(way, from, &pieces));
            thread::spawn(move || {
                writer.write(way, to, &due);
                closes.close();
            });
        }
        Ok(())
    }

    /// Reads messages until the end of the connection, and forwards the data that the fault injector returns.
    fn read(&self, way: Way, mut from: TcpStream, pieces: &Sender<(Instant, Piece)>) {
        let side = if way.is_to_controller() { Side::Said } else { Side::True };
        let (mut splitter, mut bytes, mut due) = (Splitter::default(), vec![0; 65_536], Instant::now());
        loop {
            let count = match from.read(&mut bytes) {
                Ok(0) => return,
                Ok(count) => count,
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(_) => return,
            };
            for document in splitter.push(&bytes[..count]) {
                self.truth.record(side, &document);
                for piece in self.liar.pass(way, document) {
                    if let Piece::Bytes(later, _) = &piece {
                        due = due.max(Instant::now() + *later);
                    }
                    if pieces.send((due, piece)).is_err() {
                        return;
                    }
                }
            }
        }
    }

    /// Writes the data at its time, until no more data can arrive or the connection must be closed.
    fn write(&self, way: Way, mut to: TcpStream, due: &Receiver<(Instant, Piece)>) {
        let side = if way.is_to_controller() { Side::Given } else { Side::Shown };
        let mut splitter = Splitter::default();
        while let Ok((at, piece)) = due.recv() {
            thread::sleep(at.saturating_duration_since(Instant::now()));
            let Piece::Bytes(_, bytes) = piece else { return };
            if to.write_all(&bytes).is_err() {
                return;
            }
            splitter.push(&bytes).iter().for_each(|document| self.truth.record(side, document));
        }
    }
}
