//! The largest number of connections to a page, from one address and from all.

use crate::daemon::slots::{MaxConnections, Slots};
use std::net::{IpAddr, Ipv6Addr};

/// Largest number of connections at one time. If all are in use, the one that has been silent for longest gives way to
/// a new one.
pub(super) const CONNECTIONS: MaxConnections = MaxConnections { per_owner: 256, total: 512 };
/// Largest number of connections among these that may follow the events, a response without an end. Most connections
/// stay free for requests: even with all viewers there, 320 of 512 can carry a stop, and 192 of one address.
pub(super) const MAX_VIEWERS: MaxConnections = MaxConnections { per_owner: 64, total: 192 };

/// Places of connections, by their owners.
pub(super) type ViewerSlots = Slots<IpAddr>;

/// Returns the owner of a connection from this address: one host of IPv4, or one network of IPv6, since its hosts
/// choose addresses freely.
pub(super) fn owner(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V4(address) => IpAddr::V4(address),
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            IpAddr::V6(Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_of_ipv6_is_one_owner() {
        let of = |text: &str| owner(text.parse().expect("an address"));
        assert_eq!(of("2001:db8::1"), of("2001:db8::ffff:7"));
        assert_ne!(of("2001:db8::1"), of("2001:db8:0:1::1"));
        assert_eq!(of("::ffff:10.0.0.1"), of("10.0.0.1"));
        assert_ne!(of("10.0.0.1"), of("10.0.0.2"));
    }
}
