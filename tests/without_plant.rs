//! Tests that a cell works without the servers of the plant, and with wrong files for them: log and doctor report the
//! problems.

use super::commands::{json, rendered};
use super::service::Service;

/// Each connection is reported with its file or address. None prevents the service from starting, and the service can
/// be ended immediately.
#[test]
fn wrong_files_of_the_plant_stop_no_cell() {
    let folder = rendered("clean");
    let folder = folder.path();
    let file = folder.join("cell/cell.toml");
    let tables = "
[page]
listen = '127.0.0.1:28443'
certificate = 'none.pem'
certificate_key = 'none.key'

[office]
broker = 'tls://127.0.0.1:1'
cell = 'a'
ca = 'no-ca.pem'

[push]
to = 'http://127.0.0.1:1/cell-1'
token_file = 'no-token'

[sparkplug]
broker = 'localhost'
port = 1
group_id = 'g'
edge_node_id = 'e'
user = 'u'
password_file = 'no-password'

[opcua]
listen = '127.0.0.1:28444'
certificates = 'cell.toml'
";
    let text = std::fs::read_to_string(&file).expect("a cell");
    std::fs::write(&file, text + tables).expect("written");
    let service = Service::start(folder);
    for words in [
        "operator's page: cell/none.pem: No such file or directory (os error 2); check the files that [page] in the cell's file names",
        "the transfer of records to the office server does not work: cell/no-ca.pem: No such file",
        "the transfer of signed records to the quality system does not work: cell/no-token: No such file",
        "MQTT Sparkplug: no connection to localhost:1: cell/no-password: No such file",
        "OPC UA server: certificate file cell/cell.toml/own: Not a directory",
    ] {
        service.wait(words, |service| service.log().contains(words));
    }
    let (exit, reported) = json(folder, "doctor --cell cell/cell.toml");
    let reported = reported.to_string();
    assert_ne!(exit, 0, "{reported}");
    for words in ["office: cell/no-ca.pem", "quality system: cell/no-token", "MQTT broker: cell/no-password"] {
        assert!(reported.contains(words), "{words}: {reported}");
    }
    let begun = std::time::Instant::now();
    service.signal(rustix::process::Signal::TERM);
    assert!(service.wait_for_end().success());
    assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
}
