//! This computer's network: the socket buffers that a picture in one burst of packets needs, the addresses that are
//! reached without a router, the explanation why another address cannot be reached, and the search for the cameras
//! that answer.
//!
//! A GigE Vision camera and the port that it is plugged into must be in one IPv4 subnet. A camera in another subnet
//! may answer a search and then fail to open, or not answer at all. The kernel's routing table names the subnets: its
//! lines without a gateway. The functions on subnets have text as their input and as their output.

use std::net::Ipv4Addr;

/// The smallest buffer that is requested, bytes: two pictures of an ordinary camera.
const MIN_SOCKET_BUFFER_BYTES: usize = 8 << 20;

/// Returns the buffer requested from the system for such pictures, bytes. Granted up to `net.core.rmem_max`.
pub fn socket_buffer_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    burst_bytes(size_px, packet_bytes).max(MIN_SOCKET_BUFFER_BYTES)
}

/// Returns the receive buffer that a socket needs for a picture in one burst, bytes. The kernel counts each packet
/// with its own overhead, and grants twice the requested size.
pub fn burst_bytes(size_px: [usize; 2], packet_bytes: u16) -> usize {
    // `HEADER_BYTES`: IP, UDP and GVSP headers of a packet. `OVERHEAD_BYTES`: what the kernel adds to a packet before
    // it rounds the size up to a power of two.
    const HEADER_BYTES: usize = 36;
    const OVERHEAD_BYTES: usize = 600;
    let each = (usize::from(packet_bytes) + OVERHEAD_BYTES).next_power_of_two() + 256;
    let packets =
        (size_px[0] * size_px[1]).div_ceil(usize::from(packet_bytes).saturating_sub(HEADER_BYTES).max(1)) + 2;
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

/// A subnet that a port of this computer is in.
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

/// Returns the subnets of a table of routes in the form of `/proc/net/route`: hexadecimal, in the machine's byte
/// order.
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

/// Returns why a camera at this address cannot be reached; `None` if the reason is not the address.
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

/// Describes the subnets in words.
pub fn describe_subnets(subnets: &[Subnet]) -> String {
    match subnets {
        [] => "this computer has none".to_owned(),
        some => some.iter().map(Subnet::to_string).collect::<Vec<_>>().join(", "),
    }
}

/// A camera that answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundCamera {
    /// The identifier with which Aravis opens the camera.
    pub id: String,
    /// Its serial number.
    pub serial: String,
    /// Its IP address.
    pub address: String,
}

/// Searches every network interface of this machine for GigE Vision cameras.
///
/// # Errors
/// If no interface can be searched; the reason in words.
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

/// Returns an error in place of the search.
///
/// # Errors
/// Always, since this program was built without the driver.
#[cfg(not(feature = "gige"))]
pub fn search() -> Result<Vec<FoundCamera>, String> {
    Err("this program was built without the driver of GigE Vision cameras".to_owned())
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
    fn a_burst_has_the_bytes_that_the_kernel_counts() {
        assert_eq!(burst_bytes([2_048, 1_536], 1_400), 2_309 * 2_304 / 2);
        assert_eq!(socket_buffer_bytes([2_048, 1_536], 1_400), 8 << 20);
        // Calculated by hand: 19,961,856 bytes in packets of 7,964: 2,507 packets and two more, 16,384 + 256 bytes
        // each.
        assert_eq!(socket_buffer_bytes([5_472, 3_648], 8_000), 2_509 * 16_640 / 2);
    }

    /// The routing table as Linux writes it on a little endian machine: 172.31.1.0/24 is 00011FAC with mask 00FFFFFF.
    /// The first line is the default route through a router, so it makes no address directly reachable.
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
