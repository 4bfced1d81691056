//! What a picture that comes in one burst of packets needs of the system's sockets, and what the system says of its network.

#[cfg(feature = "gige")]
use super::subnet::{Subnet, subnets};

/// What is asked for at least, bytes: two pictures of an ordinary camera.
const LEAST_BYTES: usize = 8 << 20;

/// What is asked of the system for such pictures, bytes. Granted up to `net.core.rmem_max`.
pub fn socket_buffer_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    burst_bytes(size_px, packet_bytes).max(LEAST_BYTES)
}

/// What a socket's receive buffer must be for a picture that comes in one burst, bytes: the kernel counts each packet with its
/// own overhead, and grants twice what it is asked for.
pub fn burst_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    // IP, UDP and GVSP headers of a packet; what the kernel counts for one of these sizes, by powers of two.
    const HEADERS: usize = 36;
    const OVERHEAD: usize = 600;
    let each = (usize::from(packet_bytes) + OVERHEAD).next_power_of_two() + 256;
    let packets = (size_px[0] * size_px[1]).div_ceil(usize::from(packet_bytes).saturating_sub(HEADERS).max(1)) + 2;
    packets * each / 2
}

/// The largest receive buffer that the system gives, bytes, where it says so.
pub fn rmem_max() -> Option<usize> {
    if let Ok(text) = std::fs::read_to_string("/proc/sys/net/core/rmem_max") {
        return text.trim().parse().ok();
    }
    // The service sees no such file (`ProcSubset=pid`); a socket that asks for all gets that much, counted twice.
    let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::LOCALHOST, 0)).ok()?;
    largest(&socket)
}

/// What a socket gets that asks for as much as can be said.
fn largest(socket: &std::net::UdpSocket) -> Option<usize> {
    let socket = socket2::SockRef::from(socket);
    socket.set_recv_buffer_size(i32::MAX as usize / 2).ok()?;
    socket.recv_buffer_size().ok().map(|granted| granted / 2)
}

/// This computer's subnets, as the kernel lists them; the service sees its own process alone in /proc.
#[cfg(feature = "gige")]
pub(super) fn subnets_here() -> Vec<Subnet> {
    subnets(&std::fs::read_to_string("/proc/self/net/route").unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A socket tells what the kernel's file tells.
    #[test]
    fn the_largest_buffer_is_found_without_the_kernels_file() {
        let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::LOCALHOST, 0)).expect("a socket");
        let file = std::fs::read_to_string("/proc/sys/net/core/rmem_max").expect("it is there");
        assert_eq!(largest(&socket), file.trim().parse().ok());
    }

    /// 3,145,728 bytes in packets of 1,364: 2,307 and two more, for each of which 2,048 + 256 bytes are counted and half asked.
    #[test]
    fn a_burst_is_its_packets_as_the_kernel_counts_them() {
        assert_eq!(burst_bytes([2_048, 1_536], 1_400), 2_309 * 2_304 / 2);
        assert_eq!(socket_buffer_bytes([2_048, 1_536], 1_400), 8 << 20);
        // 19,961,856 bytes in packets of 7,964: 2,507 and two, 16,384 + 256 each.
        assert_eq!(socket_buffer_bytes([5_472, 3_648], 8_000), 2_509 * 16_640 / 2);
    }
}
