//! The connection limiter: a proxy in front of the server that limits the number of connections, in total and for each
//! address, and records the address of each connection.
//!
//! async-opcua accepts every connection, but all parts of the service share the file descriptors. Therefore the limiter
//! accepts only a limited number of connections and forwards their bytes to the server, which listens on the loopback
//! interface only. While forwarding, it reads the number of the secure channel from the server's reply; by this number
//! a session is assigned to an address.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt, copy};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use tokio::time::sleep;

/// Maximum number of simultaneous connections in total, and below it from one address.
const MAX_CONNECTIONS: usize = 48;
const MAX_CONNECTIONS_PER_ADDRESS: usize = 16;
/// Time without accepting data after which a peer is treated as disconnected.
const DISCONNECT_TIMEOUT: Duration = Duration::from_secs(30);
/// Time for which the address of a disconnected peer is kept, because a report may still refer to this peer.
const DEPARTURE_RETENTION: Duration = Duration::from_secs(5);
/// Number of bytes of a message header: type, chunk type, size, and the channel number if there is one.
const HEADER_BYTES: usize = 12;
/// Maximum size of a message before the channel number is known, bytes: an acknowledgement, an error, or the opening of
/// a channel with a certificate.
const MAX_OPENING_BYTES: usize = 64 * 1_024;

/// The present connections.
#[derive(Debug, Default)]
pub(super) struct ConnectionLimiter(Mutex<Inside>);

#[derive(Debug, Default)]
struct Inside {
    open: BTreeMap<u64, Peer>,
    last: u64,
    rejected: u64,
    /// The addresses that were disconnected or rejected a short time ago, with the time.
    recently_left: BTreeMap<IpAddr, Instant>,
}

#[derive(Debug)]
struct Peer {
    from: IpAddr,
    channel: Option<u32>,
    disconnect: Arc<Notify>,
}

impl Inside {
    fn on_disconnect(&mut self, from: IpAddr) {
        self.recently_left.retain(|_, at| at.elapsed() < DEPARTURE_RETENTION);
        if self.recently_left.len() < MAX_CONNECTIONS {
            self.recently_left.insert(from, Instant::now());
        }
    }
}

impl ConnectionLimiter {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        // A poisoned lock is harmless, because every change under this lock is complete.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns a connection slot for this address; `None` if no slot is free.
    fn acquire_slot(&self, from: IpAddr) -> Option<(u64, Arc<Notify>)> {
        let mut inside = self.lock();
        let of_address = inside.open.values().filter(|peer| peer.from == from).count();
        if inside.open.len() >= MAX_CONNECTIONS || of_address >= MAX_CONNECTIONS_PER_ADDRESS {
            inside.rejected += 1;
            inside.on_disconnect(from);
            return None;
        }
        inside.last += 1;
        let (number, cut) = (inside.last, Arc::new(Notify::new()));
        inside.open.insert(number, Peer { from, channel: None, disconnect: cut.clone() });
        Some((number, cut))
    }

    fn release_slot(&self, number: u64) {
        let mut inside = self.lock();
        if let Some(Peer { from, .. }) = inside.open.remove(&number) {
            inside.on_disconnect(from);
        }
    }

    fn set_channel(&self, number: u64, channel: u32) {
        if let Some(peer) = self.lock().open.get_mut(&number) {
            peer.channel = Some(channel);
        }
    }

    /// Returns the address of the client with this secure channel.
    pub fn address_of_channel(&self, channel: u32) -> Option<IpAddr> {
        self.lock().open.values().find(|peer| peer.channel == Some(channel)).map(|peer| peer.from)
    }

    /// Returns the addresses that are connected or were connected a short time ago, without duplicates.
    pub fn addresses(&self) -> Vec<IpAddr> {
        let inside = self.lock();
        let lately =
            inside.recently_left.iter().filter(|(_, at)| at.elapsed() < DEPARTURE_RETENTION).map(|(from, _)| *from);
        let mut all: Vec<IpAddr> = inside.open.values().map(|peer| peer.from).chain(lately).collect();
        all.sort();
        all.dedup();
        all
    }

    /// Ends the connection of this secure channel.
    pub fn disconnect_channel(&self, channel: u32) {
        let inside = self.lock();
        inside
            .open
            .values()
            .filter(|peer| peer.channel == Some(channel))
            .for_each(|peer| peer.disconnect.notify_one());
    }

    /// Returns the number of connections that were rejected since the last call.
    pub fn take_rejected_count(&self) -> u64 {
        std::mem::take(&mut self.lock().rejected)
    }

    /// Accepts connections and forwards them to the server, until the listener is dropped.
    pub async fn serve_connections(self: Arc<Self>, listener: TcpListener, server: SocketAddr) {
        loop {
            let Ok((stream, from)) = listener.accept().await else {
                // For example, no file descriptor is free; the connection is accepted later.
                sleep(Duration::from_millis(50)).await;
                continue;
            };
            let Some((number, cut)) = self.acquire_slot(from.ip().to_canonical()) else { continue };
            let door = self.clone();
            tokio::spawn(async move {
                tokio::select! {
                    () = door.forward_connection(number, stream, server) => {}
                    () = cut.notified() => {}
                }
                door.release_slot(number);
            });
        }
    }

    async fn forward_connection(&self, number: u64, stream: TcpStream, server: SocketAddr) {
        let socket = socket2::SockRef::from(&stream);
        let is_set = socket
            .set_tcp_user_timeout(Some(DISCONNECT_TIMEOUT))
            .and_then(|()| socket.set_tcp_nodelay(true))
            .is_ok();
        let Some(inner) =
            TcpStream::connect(server).await.ok().filter(|inner| is_set && inner.set_nodelay(true).is_ok())
        else {
            return;
        };
        let (mut from_client, mut to_client) = stream.into_split();
        let (mut from_server, mut to_server) = inner.into_split();
        let ask = copy(&mut from_client, &mut to_server);
        let answer = async {
            while let Some((message, channel)) = message(&mut from_server).await {
                if to_client.write_all(&message).await.is_err() {
                    return;
                }
                if let Some(channel) = channel {
                    self.set_channel(number, channel);
                    break;
                }
            }
            drop(copy(&mut from_server, &mut to_client).await);
        };
        // If one side closes the connection, the other side is closed too.
        tokio::select! {
            _ = ask => {}
            () = answer => {}
        }
    }
}

/// Reads one message of the server before the channel is known. Returns the message, and the channel number if the
/// message opens a channel.
async fn message(from: &mut (impl AsyncReadExt + Unpin)) -> Option<(Vec<u8>, Option<u32>)> {
    let mut header = [0; HEADER_BYTES];
    from.read_exact(&mut header).await.ok()?;
    let size = usize::try_from(u32::from_le_bytes([header[4], header[5], header[6], header[7]])).ok()?;
    let rest = size.checked_sub(HEADER_BYTES).filter(|rest| *rest <= MAX_OPENING_BYTES)?;
    let mut whole = header.to_vec();
    whole.resize(HEADER_BYTES + rest, 0);
    from.read_exact(&mut whole[HEADER_BYTES..]).await.ok()?;
    let channel = u32::from_le_bytes([header[8], header[9], header[10], header[11]]);
    Some((whole, header.starts_with(b"OPN").then_some(channel)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_clients_is_limited_and_no_client_uses_all_slots() {
        let door = ConnectionLimiter::default();
        let address = |number: u8| IpAddr::from([10, 0, 0, number]);
        let taken: Vec<_> = (0..30).filter_map(|_| door.acquire_slot(address(1))).collect();
        assert_eq!(taken.len(), MAX_CONNECTIONS_PER_ADDRESS);
        assert!(door.acquire_slot(address(2)).is_some(), "another address is not kept out");
        let others = (3..100).filter(|number| door.acquire_slot(address(*number)).is_some()).count();
        assert_eq!(others, MAX_CONNECTIONS - MAX_CONNECTIONS_PER_ADDRESS - 1);
        assert_eq!(door.take_rejected_count(), 30 - MAX_CONNECTIONS_PER_ADDRESS as u64 + 97 - others as u64);
        door.release_slot(taken[0].0);
        assert!(door.addresses().contains(&address(1)), "also who has just left");
        let (number, _) = door.acquire_slot(address(2)).expect("a place is free again");
        door.set_channel(number, 77);
        assert_eq!((door.address_of_channel(77), door.address_of_channel(78)), (Some(address(2)), None));
    }

    /// The messages of a real server: an acknowledgement, then the opening of channel 0x0102.
    #[tokio::test]
    async fn the_channel_is_read_from_the_answer_and_invalid_data_ends_it() {
        let mut ack = b"ACKF\x1c\0\0\0".to_vec();
        ack.resize(28, 0);
        let mut open = b"OPNF\x10\0\0\0\x02\x01\0\0".to_vec();
        open.extend([9; 4]);
        let bytes = [ack.clone(), open.clone()].concat();
        let mut from = bytes.as_slice();
        assert_eq!(message(&mut from).await, Some((ack, None)));
        assert_eq!(message(&mut from).await, Some((open, Some(0x0102))));
        assert_eq!(message(&mut from).await, None, "the end");
        assert_eq!(message(&mut b"OPNF\x04\0\0\0\0\0\0\0".as_slice()).await, None, "shorter than its header");
        assert_eq!(message(&mut b"OPNF\xff\xff\xff\xff\0\0\0\0".as_slice()).await, None, "longer than any");
    }
}
