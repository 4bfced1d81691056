//! The table `[opcua]` of a cell's file.

use super::super::*;
use super::cell_problems;

#[test]
fn the_opcua_server_is_off_until_it_is_asked_for_and_its_certificates_lie_in_the_store() {
    let cell = Cell::check("/cell/cell.toml", "store = 'kept'").expect("right");
    let OpcUa { listen, anonymous, is_unencrypted_allowed, certificates, .. } = cell.opcua().clone();
    assert_eq!((listen, anonymous, is_unencrypted_allowed), (None, AnonymousAccess::Nothing, false));
    assert_eq!(certificates, Path::new("/cell/kept/opcua"));
    let text = "[opcua]\nlisten = '0.0.0.0:4840'\nhost = 'cell-1.plant'\nanonymous = 'read'\nunencrypted = true\ncertificates = 'pki'";
    let cell = Cell::check("/cell/cell.toml", text).expect("right");
    let found = cell.opcua();
    assert_eq!(found.listen.map(|address| address.port()), Some(4_840));
    assert_eq!((found.anonymous, found.is_unencrypted_allowed), (AnonymousAccess::Read, true));
    assert_eq!((found.host.as_deref(), &*found.certificates), (Some("cell-1.plant"), Path::new("/cell/pki")));
}

#[test]
fn mistakes_of_the_opcua_server_are_named() {
    for (text, expected) in [
        (
            "listen = '4840'",
            "2: opcua.listen: found \"4840\", valid: an IP address and a port, such as \"0.0.0.0:4840\"",
        ),
        ("listen = '0.0.0.0:0'", "2: opcua.listen: found \"0.0.0.0:0\", valid: an IP address and a port"),
        ("anonymous = 'write'", "2: opcua.anonymous: found the text \"write\", valid: \"nothing\" or \"read\""),
        ("unencrypted = true", "2: opcua.unencrypted: found true, but log-in is not possible"),
        ("host = 'a b'", "2: opcua.host: found \"a b\", valid: a computer's name or an IP address"),
        ("listen = '0.0.0.0:4840'\nport = 4840", "3: opcua.port: unknown key"),
        ("anonymous = 'read'", "1: opcua.listen: is missing: the address and port of the server"),
    ] {
        let found = cell_problems(&format!("[opcua]\n{text}"));
        assert!(found.len() == 1 && found[0].starts_with(expected), "{text}: {found:?}");
    }
}
