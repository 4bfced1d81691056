//! The addresses on which a controller listens, and the two TCP connections to them, with settings by which a dead
//! controller is detected.

use panelprep_cell::cell;
use panelprep_kuka::eki::{Channel, LinkLoss};
use socket2::{SockRef, TcpKeepalive};
use std::io::{Error as IoError, ErrorKind};
use std::time::Duration;
use tokio::net::TcpStream;

/// Timeout for a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Time after which a connection ends if sent bytes are not acknowledged.
const USER_TIMEOUT: Duration = Duration::from_secs(1);

/// The addresses on which a controller listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    /// Host name or address of the controller.
    pub host: String,
    /// Port of the command channel.
    pub command_port: u16,
    /// Port of the state channel.
    pub state_port: u16,
}

impl From<&cell::Robot> for Address {
    fn from(robot: &cell::Robot) -> Self {
        Address {
            host: robot.host().to_owned(),
            command_port: robot.command_port(),
            state_port: robot.state_port(),
        }
    }
}

/// Connects the command channel, then the state channel: so a controller that receives a state request has both
/// channels.
pub(super) async fn connect(address: &Address) -> Result<(TcpStream, TcpStream), LinkLoss> {
    // One after the other: if the program on the controller does not run, one refusal with its port is the whole
    // message.
    let command = open(Channel::Command, &address.host, address.command_port).await?;
    let state = open(Channel::State, &address.host, address.state_port).await?;
    Ok((command, state))
}

async fn open(channel: Channel, host: &str, port: u16) -> Result<TcpStream, LinkLoss> {
    let address = format!("{host}:{port}");
    let stream = match tokio::time::timeout(CONNECT_TIMEOUT, TcpStream::connect((host, port))).await {
        Ok(Ok(stream)) => stream,
        Ok(Err(error)) => return Err(connection_refusal(&error, channel, address)),
        Err(_) => return Err(no_answer_loss(channel, address)),
    };
    configure_stream(&stream).map_err(|error| system_loss(channel, &error))?;
    Ok(stream)
}

/// Returns the reason for a failed connection. If a cable is unplugged, the next host or the system itself reports
/// that there is no route; this is reported as a controller that does not answer.
fn connection_refusal(error: &IoError, channel: Channel, address: String) -> LinkLoss {
    match error.kind() {
        ErrorKind::ConnectionRefused => LinkLoss::Refused { channel, address },
        ErrorKind::TimedOut | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
            no_answer_loss(channel, address)
        }
        ErrorKind::PermissionDenied => system_loss(channel, error),
        _ => LinkLoss::System { channel, problem: format!("{address}: {error}") },
    }
}

fn no_answer_loss(channel: Channel, address: String) -> LinkLoss {
    LinkLoss::NoAnswer { channel, address, waited_ms: CONNECT_TIMEOUT.as_millis() as u64 }
}

fn configure_stream(stream: &TcpStream) -> Result<(), IoError> {
    // Nagle's algorithm would hold back a heartbeat or an abort, until the last segment is
    // acknowledged.
    stream.set_nodelay(true)?;
    let socket = SockRef::from(stream);
    let keepalive = TcpKeepalive::new().with_time(USER_TIMEOUT).with_interval(USER_TIMEOUT).with_retries(3);
    socket.set_tcp_keepalive(&keepalive)?;
    #[cfg(target_os = "linux")]
    // Keepalive does not run while data is unacknowledged; this limit finds a pulled cable then.
    socket.set_tcp_user_timeout(Some(USER_TIMEOUT))?;
    Ok(())
}

/// Returns the system's error and, if a permission is missing, where to check it.
pub(super) fn system_loss(channel: Channel, error: &IoError) -> LinkLoss {
    if matches!(error.kind(), ErrorKind::ConnectionReset | ErrorKind::ConnectionAborted | ErrorKind::BrokenPipe) {
        return LinkLoss::Closed { channel };
    }
    let networks = match error.kind() {
        ErrorKind::PermissionDenied => {
            "; check the firewall, and that the cell's networks are in \
             /etc/systemd/system/panelprep.service.d/network.conf"
        }
        _ => "",
    };
    LinkLoss::System { channel, problem: format!("{error}{networks}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error as the kernel reports it if a unit's IPAddressDeny blocks the packet.
    #[test]
    fn a_network_that_the_unit_does_not_allow_is_reported() {
        let said =
            system_loss(Channel::Command, &IoError::from_raw_os_error(rustix::io::Errno::PERM.raw_os_error()));
        assert!(said.to_string().contains("panelprep.service.d/network.conf"), "{said}");
        let other = system_loss(
            Channel::Command,
            &IoError::from_raw_os_error(rustix::io::Errno::NETUNREACH.raw_os_error()),
        );
        assert!(!other.to_string().contains("network.conf"), "{other}");
    }

    /// The errors as the kernel reports them if a cable is unplugged, and if no program listens.
    #[test]
    fn a_host_that_cannot_be_reached_does_not_answer() {
        let loss = |errno: rustix::io::Errno| {
            let error = IoError::from_raw_os_error(errno.raw_os_error());
            connection_refusal(&error, Channel::Command, "192.0.2.7:54600".to_owned())
        };
        for errno in [rustix::io::Errno::HOSTUNREACH, rustix::io::Errno::NETUNREACH, rustix::io::Errno::TIMEDOUT] {
            let said = loss(errno).to_string();
            assert!(
                said.contains("192.0.2.7:54600 does not respond") && said.contains("the cable is connected"),
                "{said}"
            );
        }
        assert!(matches!(loss(rustix::io::Errno::CONNREFUSED), LinkLoss::Refused { .. }));
        assert!(matches!(loss(rustix::io::Errno::PERM), LinkLoss::System { .. }));
    }
}
