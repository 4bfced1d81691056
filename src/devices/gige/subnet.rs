//! The addresses that this computer reaches without a router, and the explanation why another address cannot be
//! reached.
//!
//! A GigE Vision camera and the port that it is plugged into must be in one IPv4 subnet. A camera in another subnet
//! may answer a search and then fail to open, or not answer at all. The kernel's routing table names the subnets: its
//! lines without a gateway. Both the input and the output of this module are text.

use std::net::Ipv4Addr;

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
        describe(subnets)
    ))
}

/// Describes the subnets in words.
pub fn describe(subnets: &[Subnet]) -> String {
    match subnets {
        [] => "this computer has none".to_owned(),
        some => some.iter().map(Subnet::to_string).collect::<Vec<_>>().join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table as Linux writes it on a little endian machine: 172.31.1.0/24 is 00011FAC with mask 00FFFFFF. The
    /// first line is the default route through a router, so it makes no address directly reachable.
    #[cfg(target_endian = "little")]
    const ROUTES: &str = "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\tMTU\tWindow\tIRTT\n\
        eth0\t00000000\t01011FAC\t0003\t0\t0\t0\t00000000\t0\t0\t0\n\
        eth0\t00011FAC\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n\
        eth1\t0040A8C0\t00000000\t0001\t0\t0\t0\t00F0FFFF\t0\t0\t0\n";

    #[cfg(target_endian = "little")]
    #[test]
    fn a_neighbour_is_reached_and_another_subnet_is_named() {
        let subnets = parse_subnets(ROUTES);
        assert_eq!(describe(&subnets), "eth0 172.31.1.0/24, eth1 192.168.64.0/20");
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
    fn a_table_that_is_none_names_nothing() {
        assert_eq!(parse_subnets(""), []);
        assert_eq!(parse_subnets("Iface\neth0 zz\n"), []);
    }
}
