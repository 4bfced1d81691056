//! Two TCP connections, set up so that a dead controller is noticed.

use super::address::Address;
use crate::eki::{Channel, LinkLoss};
use socket2::{SockRef, TcpKeepalive};
use std::io::{Error as IoError, ErrorKind};
use std::time::Duration;
use tokio::net::TcpStream;

/// How long a connection may take.
const CONNECT: Duration = Duration::from_secs(2);
/// Bytes that nobody confirms for this long end the connection.
const USER_TIMEOUT: Duration = Duration::from_secs(1);

/// Connects the command channel, then the state channel: a controller that is asked for its state has both.
pub(super) async fn connect(address: &Address) -> Result<(TcpStream, TcpStream), LinkLoss> {
    let command = open(Channel::Command, &address.host, address.command_port).await?;
    let state = open(Channel::State, &address.host, address.state_port).await?;
    Ok((command, state))
}

async fn open(channel: Channel, host: &str, port: u16) -> Result<TcpStream, LinkLoss> {
    let address = format!("{host}:{port}");
    let waited_ms = CONNECT.as_millis() as u64;
    let stream = match tokio::time::timeout(CONNECT, TcpStream::connect((host, port))).await {
        Ok(Ok(stream)) => stream,
        Ok(Err(error)) if error.kind() == ErrorKind::ConnectionRefused => {
            return Err(LinkLoss::Refused { channel, address });
        }
        Ok(Err(error)) if error.kind() != ErrorKind::TimedOut => return Err(failed(channel, &error)),
        Ok(Err(_)) | Err(_) => return Err(LinkLoss::NoAnswer { channel, address, waited_ms }),
    };
    set_up(&stream).map_err(|error| failed(channel, &error))?;
    Ok(stream)
}

fn set_up(stream: &TcpStream) -> Result<(), IoError> {
    stream.set_nodelay(true)?;
    let socket = SockRef::from(stream);
    let keepalive = TcpKeepalive::new().with_time(USER_TIMEOUT).with_interval(USER_TIMEOUT).with_retries(3);
    socket.set_tcp_keepalive(&keepalive)?;
    #[cfg(target_os = "linux")]
    socket.set_tcp_user_timeout(Some(USER_TIMEOUT))?;
    Ok(())
}

/// What the system says, and where a permission is looked for.
pub(super) fn failed(channel: Channel, error: &IoError) -> LinkLoss {
    let networks = match error.kind() {
        ErrorKind::PermissionDenied => {
            "; a firewall, or the service's unit: are the cell's networks in /etc/systemd/system/panelprep.service.d/network.conf?"
        }
        _ => "",
    };
    LinkLoss::System { channel, problem: format!("{error}{networks}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the kernel says it where a unit's IPAddressDeny holds the packet back.
    #[test]
    fn a_network_that_the_unit_does_not_allow_is_told() {
        let said = failed(Channel::Command, &IoError::from_raw_os_error(rustix::io::Errno::PERM.raw_os_error()));
        assert!(said.to_string().contains("panelprep.service.d/network.conf"), "{said}");
        let other =
            failed(Channel::Command, &IoError::from_raw_os_error(rustix::io::Errno::NETUNREACH.raw_os_error()));
        assert!(!other.to_string().contains("network.conf"), "{other}");
    }
}
