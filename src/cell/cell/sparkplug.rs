//! `[sparkplug]`: the settings of the cell as an edge node of MQTT Sparkplug B. The node is off until the table is
//! present.

use super::devices::{is_local_host, is_valid_host};
use panelprep_base::config::{Choice, Section};
use std::path::{Path, PathBuf};

/// The commands that the cell accepts from the broker. A rebirth command is always accepted, a start command never.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NodeCommands {
    /// No commands except a rebirth are accepted.
    #[default]
    None,
    /// Hold, stop and abort are accepted, with the permissions of an operator.
    Operator,
}

impl Choice for NodeCommands {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("none", NodeCommands::None), ("operator", NodeCommands::Operator)];
}

/// The settings of the edge node: the broker, and the cell's names in the Sparkplug namespace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SparkplugNode {
    /// The broker's host name or address.
    pub broker: String,
    /// The broker's TCP port.
    pub port: u16,
    /// TLS of the connection to the broker; may be `None` only if the broker runs on this computer.
    pub tls: Option<BrokerTls>,
    /// The user name, and the file with the password.
    pub login: Option<(String, PathBuf)>,
    /// The Sparkplug group to which the node belongs.
    pub group_id: String,
    /// The node's name within the group.
    pub edge_node_id: String,
    /// The primary host application: the node publishes only while this host is online.
    pub primary_host_id: Option<String>,
    /// The commands that are accepted.
    pub commands: NodeCommands,
    /// Whether metrics are sent with aliases; some host applications do not support aliases.
    pub aliases: bool,
}

/// The certificates of the TLS connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BrokerTls {
    /// The certificate of the authority that signed the broker's certificate, PEM.
    pub ca_certificate: PathBuf,
    /// The cell's certificate and its key, PEM, if the broker requires a client certificate.
    pub client_certificate: Option<[PathBuf; 2]>,
}

/// Valid TCP port numbers.
const PORTS: std::ops::RangeInclusive<u16> = 1..=u16::MAX;
/// Default ports of MQTT: with TLS, and without TLS.
const DEFAULT_PORTS: [u16; 2] = [8_883, 1_883];
/// Maximum length of one level of a topic, bytes; the whole topic must be shorter than MQTT's limit of 65 535.
const MAX_BYTES: usize = 200;

pub(super) fn parse_sparkplug(folder: &Path, section: &Section<'_, '_>) -> Option<Option<SparkplugNode>> {
    if !section.is_present() {
        return Some(None);
    }
    let broker = section.parse::<String>("broker", (), None);
    let port = section.parse::<Option<u16>>("port", PORTS, Some(None));
    let text = |key| section.parse::<Option<String>>(key, (), Some(None));
    let [ca_certificate, certificate, key] = ["ca_certificate", "certificate", "certificate_key"].map(text);
    let [user, password_file, primary_host_id] = ["user", "password_file", "primary_host_id"].map(text);
    let group_id = section.parse::<String>("group_id", (), None);
    let edge_node_id = section.parse::<String>("edge_node_id", (), None);
    let commands = section.parse::<NodeCommands>("commands", (), Some(NodeCommands::None));
    let aliases = section.parse::<bool>("aliases", (), Some(true));
    section.finish();
    let (broker, port, ca_certificate) = (broker?, port?, ca_certificate?);
    let own = parse_pair(section, ["certificate", "certificate_key"], [certificate?, key?]);
    let login = parse_pair(section, ["user", "password_file"], [user?, password_file?]);
    let tls = parse_tls(folder, section, &broker, (ca_certificate, own?));
    let (group_id, edge_node_id) = (group_id?, edge_node_id?);
    let primary_host_id = primary_host_id?;
    let ids = [
        ("group_id", Some(&group_id)),
        ("edge_node_id", Some(&edge_node_id)),
        ("primary_host_id", primary_host_id.as_ref()),
    ];
    let is_named = ids.map(|(key, id)| id.is_none_or(|id| is_valid_topic_part(section, key, id)));
    let (tls, login) = (tls?, login?);
    let (commands, aliases) = (commands?, aliases?);
    is_named.iter().all(|is_right| *is_right).then(|| {
        let port = port.unwrap_or(DEFAULT_PORTS[usize::from(tls.is_none())]);
        let login = login.map(|[user, file]| (user, folder.join(file)));
        Some(SparkplugNode { broker, port, tls, login, group_id, edge_node_id, primary_host_id, commands, aliases })
    })
}

/// Parses two keys that must be stated together.
fn parse_pair(
    section: &Section<'_, '_>,
    keys: [&'static str; 2],
    values: [Option<String>; 2],
) -> Option<Option<[String; 2]>> {
    match values {
        [Some(first), Some(second)] => Some(Some([first, second])),
        [None, None] => Some(None),
        [first, _] => {
            let missing = keys[usize::from(first.is_some())];
            section.problem(missing, format!("is missing; state both {} and {}, or neither", keys[0], keys[1]));
            None
        }
    }
}

/// Parses the TLS settings. Without TLS, the password could be read on the network and commands could be forged;
/// therefore only a broker on this computer may be used without TLS.
fn parse_tls(
    folder: &Path,
    section: &Section<'_, '_>,
    broker: &str,
    (ca_certificate, own): (Option<String>, Option<[String; 2]>),
) -> Option<Option<BrokerTls>> {
    if !is_valid_host(broker) {
        let allowed = "valid: an address such as 192.168.10.5, or a host name of letters, digits, - and dots; the \
                       port has its own key, port";
        section.problem("broker", format!("found \"{broker}\", {allowed}"));
        return None;
    }
    let is_here = is_local_host(broker);
    match ca_certificate {
        Some(file) => {
            let own = own.map(|files| files.map(|file| folder.join(file)));
            Some(Some(BrokerTls { ca_certificate: folder.join(file), client_certificate: own }))
        }
        None if is_here && own.is_none() => Some(None),
        None => {
            let message = "is missing; the connection to a broker on another computer needs TLS: name the certificate \
                           of the authority (CA) that signed the broker's certificate";
            section.problem("ca_certificate", message);
            None
        }
    }
}

fn is_valid_topic_part(section: &Section<'_, '_>, key: &str, id: &str) -> bool {
    let is_right = id.len() <= MAX_BYTES && !id.chars().any(|c| "+/#".contains(c) || c.is_control());
    if !is_right {
        let allowed =
            "valid: up to 200 bytes without the characters +, / and #, since it is a part of an MQTT topic";
        section.problem(key, format!("found \"{}\", {allowed}", id.escape_debug()));
    }
    is_right
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    const NAMES: &str = "group_id = 'plant'\nedge_node_id = 'cell 1'\n";

    fn read(table: &str) -> Result<Option<SparkplugNode>, String> {
        let cell = Cell::check("cells/cell.toml", table).map_err(|problems| problems.to_string())?;
        Ok(cell.sparkplug().cloned())
    }

    #[test]
    fn it_is_off_without_its_table() {
        assert_eq!(read(""), Ok(None));
        let here = read(&format!("[sparkplug]\nbroker = '127.0.0.1'\n{NAMES}"));
        let here = here.expect("right").expect("a node");
        assert_eq!((here.port, &here.tls, &here.login), (1_883, &None, &None));
        assert_eq!(
            (here.commands, here.aliases),
            (NodeCommands::None, true),
            "a host asks for nothing unless said"
        );
        let more = "broker = 'mqtt.plant'\nca_certificate = 'ca.pem'\ncertificate = 'own.pem'\ncertificate_key = '/own.key'\n\
                    user = 'cell'\npassword_file = 'password'\nprimary_host_id = 'scada'\ncommands = 'operator'\naliases = false\n";
        let there = read(&format!("[sparkplug]\n{more}{NAMES}")).expect("right").expect("a node");
        let own = Some(["cells/own.pem".into(), "/own.key".into()]);
        assert_eq!(there.tls, Some(BrokerTls { ca_certificate: "cells/ca.pem".into(), client_certificate: own }));
        assert_eq!(there.login, Some(("cell".to_owned(), "cells/password".into())));
        assert_eq!((there.port, there.commands, there.aliases), (8_883, NodeCommands::Operator, false));
    }

    #[test]
    fn each_mistake_is_named() {
        let named = |more: &str| read(&format!("[sparkplug]\n{more}\n{NAMES}")).expect_err("wrong");
        for (more, words) in [
            ("", "sparkplug.broker: is missing"),
            (
                "broker = '10.0.0.5'",
                "sparkplug.ca_certificate: is missing; the connection to a broker on another computer",
            ),
            ("broker = '10.0.0.5:1883'", "the port has its own key"),
            ("broker = 'localhost'\nport = 0", "valid: a whole number from 1 to 65535"),
            (
                "broker = 'localhost'\nuser = 'me'",
                "sparkplug.password_file: is missing; state both user and password_file, or neither",
            ),
            ("broker = 'localhost'\ncertificate = 'a'", "sparkplug.certificate_key: is missing"),
            ("broker = 'localhost'\ncertificate = 'a'\ncertificate_key = 'b'", "sparkplug.ca_certificate"),
            ("broker = 'localhost'\nprimary_host_id = 'a/b'", "found \"a/b\""),
            ("broker = 'localhost'\ncommands = 'engineer'", "valid: \"none\" or \"operator\""),
            ("broker = 'localhost'\ngroup = 'a'", "did you mean group_id?"),
        ] {
            let told = named(more);
            assert!(told.contains(words), "{more}: {told}");
        }
        for id in ["a+b", "a#", "a/b", "a\\nb", &"x".repeat(201)] {
            let text = format!("[sparkplug]\nbroker = 'localhost'\ngroup_id = \"{id}\"\nedge_node_id = 'c'");
            assert!(read(&text).expect_err("wrong").contains("a part of an MQTT topic"), "{id}");
        }
    }
}
