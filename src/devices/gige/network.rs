//! The network of this computer: the socket buffer that the packets of one picture need, the subnets that are reached
//! without a router, the explanation why an address cannot be reached, and the search for cameras.
//!
//! A GigE Vision camera and the network port to which it is connected must be in the same IPv4 subnet. A camera in
//! another subnet may respond to a search and then fail to open, or not respond at all. The subnets are the entries
//! without a gateway in the kernel's routing table. The functions for subnets take and return text.

use std::net::Ipv4Addr;

/// Minimum receive buffer that is requested, bytes: room for two pictures of a typical camera.
const MIN_SOCKET_BUFFER_BYTES: usize = 8 << 20;

/// Returns the receive buffer that is requested for pictures of this size, bytes. The operating system limits it to
/// `net.core.rmem_max`.
pub fn socket_buffer_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    burst_bytes(size_px, packet_bytes).max(MIN_SOCKET_BUFFER_BYTES)
}

/// Returns the receive buffer that a socket needs for all packets of one picture, bytes. The kernel adds its own
/// overhead to each packet, and allocates twice the requested size.
pub fn burst_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    // `HEADER_BYTES`: the IP, UDP and GVSP headers of a packet. `OVERHEAD_BYTES`: the kernel's overhead per packet,
    // which it adds before it rounds the size up to a power of two.
    const HEADER_BYTES: usize = 36;
    const OVERHEAD_BYTES: usize = 600;
    let each = (usize::from(packet_bytes) + OVERHEAD_BYTES).next_power_of_two() + 256;
    let packets =
        (size_px[0] * size_px[1]).div_ceil(usize::from(packet_bytes).saturating_sub(HEADER_BYTES).max(1)) + 2;
    packets * each / 2
}

/// Returns the maximum receive buffer that the operating system permits, bytes; `None` if it is not known.
pub fn rmem_max() -> Option<usize> {
    if let Ok(text) = std::fs::read_to_string("/proc/sys/net/core/rmem_max") {
        return text.trim().parse().ok();
    }
    // The service cannot read this file (`ProcSubset=pid`). Instead a socket requests the maximum size: the size that
    // it is granted is twice `rmem_max`.
    let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::LOCALHOST, 0)).ok()?;
    largest_receive_buffer(&socket)
}

/// Returns the size of the receive buffer that a socket is granted when it requests the maximum size, bytes.
fn largest_receive_buffer(socket: &std::net::UdpSocket) -> Option<usize> {
    let socket = socket2::SockRef::from(socket);
    socket.set_recv_buffer_size(i32::MAX as usize / 2).ok()?;
    socket.recv_buffer_size().ok().map(|granted| granted / 2)
}

/// Returns the subnets of this computer from the kernel's routing table. The table of the own process is read, because
/// the service has no access to other files in /proc.
#[cfg(feature = "gige")]
pub(super) fn local_subnets() -> Vec<Subnet> {
    parse_subnets(&std::fs::read_to_string("/proc/self/net/route").unwrap_or_default())
}

/// A subnet to which a network port of this computer belongs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subnet {
    /// The port, `eth0`.
    pub port: String,
    network: u32,
    mask: u32,
}

impl Subnet {
    fn contains(&self, address: Ipv4Addr) -> bool {
        u32::from(address) & self.mask == self.network
    }
}

impl std::fmt::Display for Subnet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}/{}", self.port, Ipv4Addr::from(self.network), self.mask.count_ones())
    }
}

/// Parses the subnets from a routing table in the format of `/proc/net/route`: hexadecimal numbers in the byte order of
/// the computer.
pub fn parse_subnets(routes: &str) -> Vec<Subnet> {
    let of_line = |line: &str| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let [port, network, gateway, _, _, _, _, mask, ..] = fields.as_slice() else { return None };
        let number = |hex: &str| u32::from_str_radix(hex, 16).ok().map(u32::from_be);
        let (network, gateway, mask) = (number(network)?, number(gateway)?, number(mask)?);
        (gateway == 0 && mask != 0).then(|| Subnet { port: (*port).to_owned(), network, mask })
    };
    routes.lines().skip(1).filter_map(of_line).collect()
}

/// Returns why a camera at this address cannot be reached; `None` if the address is not the reason.
pub fn unreachable_reason(address: &str, subnets: &[Subnet]) -> Option<String> {
    let address: Ipv4Addr = address.parse().ok()?;
    if address.is_loopback() || subnets.iter().any(|subnet| subnet.contains(address)) {
        return None;
    }
    let by_itself = if address.is_link_local() {
        " (an address that a camera selects automatically if no DHCP server responds)"
    } else {
        ""
    };
    Some(format!(
        "{address}{by_itself} is in none of this computer's subnets ({}); give the network port of the camera a fixed \
         address in the camera's subnet, or give the camera an address in the subnet of this port",
        describe_subnets(subnets)
    ))
}

/// Returns a list of the subnets as a text, for messages.
pub fn describe_subnets(subnets: &[Subnet]) -> String {
    match subnets {
        [] => "this computer has none".to_owned(),
        some => some.iter().map(Subnet::to_string).collect::<Vec<_>>().join(", "),
    }
}

/// A camera that responded to a search.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundCamera {
    /// The identifier with which Aravis opens the camera.
    pub id: String,
    /// Its serial number.
    pub serial: String,
    /// Its IP address.
    pub address: String,
}

/// Searches for GigE Vision cameras on every network interface of this computer.
///
/// # Errors
/// If no interface can be searched; the error is the reason as a text.
#[cfg(feature = "gige")]
pub fn search() -> Result<Vec<FoundCamera>, String> {
    use aravis::prelude::*;
    let interface = aravis::GvInterface::instance()
        .ok_or_else(|| "the Aravis library has no GigE Vision support".to_owned())?;
    interface.update_device_list();
    let text = |text: Option<aravis::glib::GString>| text.map_or(String::new(), String::from);
    let camera = |at| FoundCamera {
        id: text(interface.device_id(at)),
        serial: text(interface.device_serial_nbr(at)),
        address: text(interface.device_address(at)),
    };
    Ok((0..interface.n_devices()).map(camera).collect())
}

/// Replaces the search in a program that was built without the GigE Vision driver.
///
/// # Errors
/// Always.
#[cfg(not(feature = "gige"))]
pub fn search() -> Result<Vec<FoundCamera>, String> {
    Err("this program was built without the driver of GigE Vision cameras".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The maximum buffer that is found with a socket equals the value in the kernel's file.
    #[test]
    fn the_largest_buffer_is_found_without_the_kernels_file() {
        let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::LOCALHOST, 0)).expect("a socket");
        let file = std::fs::read_to_string("/proc/sys/net/core/rmem_max").expect("it is there");
        assert_eq!(largest_receive_buffer(&socket), file.trim().parse().ok());
    }

    /// Expected value, calculated by hand: 3,145,728 bytes need 2,307 packets of 1,364 bytes, and two more for header
    /// and trailer. The kernel counts 2,048 + 256 bytes per packet, and half of the sum is requested.
    #[test]
    fn a_burst_has_the_bytes_that_the_kernel_counts() {
        assert_eq!(burst_bytes([2_048, 1_536], 1_400), 2_309 * 2_304 / 2);
        assert_eq!(socket_buffer_bytes([2_048, 1_536], 1_400), 8 << 20);
        // Expected value, calculated by hand: 19,961,856 bytes need 2,507 packets of 7,964 bytes and two more, with
        // 16,384 + 256 bytes each.
        assert_eq!(socket_buffer_bytes([5_472, 3_648], 8_000), 2_509 * 16_640 / 2);
    }

    /// A routing table of Linux on a little-endian computer: 172.31.1.0/24 is 00011FAC with the mask 00FFFFFF. The
    /// first line is the default route through a router, so it adds no subnet.
    #[cfg(target_endian = "little")]
    const ROUTES: &str = "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\tMTU\tWindow\tIRTT\n\
        eth0\t00000000\t01011FAC\t0003\t0\t0\t0\t00000000\t0\t0\t0\n\
        eth0\t00011FAC\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n\
        eth1\t0040A8C0\t00000000\t0001\t0\t0\t0\t00F0FFFF\t0\t0\t0\n";

    #[cfg(target_endian = "little")]
    #[test]
    fn an_address_outside_of_the_subnets_is_reported() {
        let subnets = parse_subnets(ROUTES);
        assert_eq!(describe_subnets(&subnets), "eth0 172.31.1.0/24, eth1 192.168.64.0/20");
        for near in ["172.31.1.20", "192.168.70.9", "192.168.79.9", "127.0.0.1", "camera.local"] {
            assert_eq!(unreachable_reason(near, &subnets), None, "{near}");
        }
        let far = unreachable_reason("10.0.0.2", &subnets).expect("another subnet");
        assert!(
            far.starts_with("10.0.0.2 is in none of this computer's subnets (eth0 172.31.1.0/24, eth1"),
            "{far}"
        );
        let own = unreachable_reason("169.254.3.4", &subnets).expect("none of ours");
        assert!(own.contains("selects automatically if no DHCP server responds"), "{own}");
        assert!(unreachable_reason("10.0.0.2", &[]).is_some_and(|told| told.contains("this computer has none")));
    }

    #[test]
    fn an_invalid_routing_table_gives_no_subnets() {
        assert_eq!(parse_subnets(""), []);
        assert_eq!(parse_subnets("Iface\neth0 zz\n"), []);
    }
}
