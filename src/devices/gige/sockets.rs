//! What a picture that comes in one burst of packets needs of the system's sockets, and what the system says of its network.

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
    std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok()?.trim().parse().ok()
}

/// This computer's subnets, as the kernel lists them.
pub(super) fn subnets_here() -> Vec<Subnet> {
    subnets(&std::fs::read_to_string("/proc/net/route").unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 3,145,728 bytes in packets of 1,364: 2,307 and two more, for each of which 2,048 + 256 bytes are counted and half asked.
    #[test]
    fn a_burst_is_its_packets_as_the_kernel_counts_them() {
        assert_eq!(burst_bytes([2_048, 1_536], 1_400), 2_309 * 2_304 / 2);
        assert_eq!(socket_buffer_bytes([2_048, 1_536], 1_400), 8 << 20);
        // 19,961,856 bytes in packets of 7,964: 2,507 and two, 16,384 + 256 each.
        assert_eq!(socket_buffer_bytes([5_472, 3_648], 8_000), 2_509 * 16_640 / 2);
    }
}
