//! The socket buffers that a picture in one burst of packets needs, and the system's information about its network.

#[cfg(feature = "gige")]
use super::subnet::{Subnet, parse_subnets};

/// The minimum request, bytes: two pictures of an ordinary camera.
const MIN_BYTES: usize = 8 << 20;

/// Returns the buffer requested from the system for such pictures, bytes. Granted up to `net.core.rmem_max`.
pub fn socket_buffer_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    burst_bytes(size_px, packet_bytes).max(MIN_BYTES)
}

/// Returns the receive buffer that a socket needs for a picture in one burst, bytes. The kernel counts each packet
/// with its own overhead, and grants twice the requested size.
pub fn burst_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    // `HEADERS`: IP, UDP and GVSP headers of a packet. `OVERHEAD`: what the kernel adds to a packet before it
    // rounds the size up to a power of two.
    const HEADERS: usize = 36;
    const OVERHEAD: usize = 600;
    let each = (usize::from(packet_bytes) + OVERHEAD).next_power_of_two() + 256;
    let packets = (size_px[0] * size_px[1]).div_ceil(usize::from(packet_bytes).saturating_sub(HEADERS).max(1)) + 2;
    packets * each / 2
}

/// Returns the largest receive buffer that the system grants, bytes, if the system reports it.
pub fn rmem_max() -> Option<usize> {
    if let Ok(text) = std::fs::read_to_string("/proc/sys/net/core/rmem_max") {
        return text.trim().parse().ok();
    }
    // The service cannot read this file (`ProcSubset=pid`). If a socket requests the maximum, the size granted is
    // `rmem_max`, counted twice.
    let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::LOCALHOST, 0)).ok()?;
    largest_receive_buffer(&socket)
}

/// Returns the buffer that a socket is granted when it requests the largest possible size.
fn largest_receive_buffer(socket: &std::net::UdpSocket) -> Option<usize> {
    let socket = socket2::SockRef::from(socket);
    socket.set_recv_buffer_size(i32::MAX as usize / 2).ok()?;
    socket.recv_buffer_size().ok().map(|granted| granted / 2)
}

/// Returns this computer's subnets, as the kernel lists them; the service can read only its own process in /proc.
#[cfg(feature = "gige")]
pub(super) fn local_subnets() -> Vec<Subnet> {
    parse_subnets(&std::fs::read_to_string("/proc/self/net/route").unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A socket reports the same value as the kernel's file.
    #[test]
    fn the_largest_buffer_is_found_without_the_kernels_file() {
        let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::LOCALHOST, 0)).expect("a socket");
        let file = std::fs::read_to_string("/proc/sys/net/core/rmem_max").expect("it is there");
        assert_eq!(largest_receive_buffer(&socket), file.trim().parse().ok());
    }

    /// Calculated by hand: 3,145,728 bytes in packets of 1,364: 2,307 packets and two more. For each packet 2,048 +
    /// 256 bytes are counted, and half of the sum is requested.
    #[test]
    fn a_burst_is_its_packets_as_the_kernel_counts_them() {
        assert_eq!(burst_bytes([2_048, 1_536], 1_400), 2_309 * 2_304 / 2);
        assert_eq!(socket_buffer_bytes([2_048, 1_536], 1_400), 8 << 20);
        // Calculated by hand: 19,961,856 bytes in packets of 7,964: 2,507 packets and two more, 16,384 + 256 bytes
        // each.
        assert_eq!(socket_buffer_bytes([5_472, 3_648], 8_000), 2_509 * 16_640 / 2);
    }
}
