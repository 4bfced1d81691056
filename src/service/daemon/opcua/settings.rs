//! Settings of async-opcua: addresses, security, and limits of everything that a client may send or store.

use super::certificates::{KEY, OWN_CERTIFICATE};
use opcua::crypto::SecurityPolicy;
use opcua::server::{ServerBuilder, ServerEndpoint};
use opcua::types::{BuildInfo, DateTime, MessageSecurityMode, UAString};
use panelprep_cell::cell::OpcUa;
use std::net::SocketAddr;

/// Time without a request after which a session ends, ms.
const SESSION_MS: u64 = 60_000;
/// Limits of a message and its content, bytes and items.
const MESSAGE_BYTES: usize = 256 * 1_024;
const CHUNKS: usize = 16;
const STRING_BYTES: usize = 64 * 1_024;
const ARRAY_ITEMS: usize = 2_000;
const SESSIONS: usize = 40;

/// Returns the name by which clients reach the server: the one that the cell's file states, the address, or the
/// computer's name.
pub(super) fn host(settings: &OpcUa, address: SocketAddr) -> String {
    match &settings.host {
        Some(host) => host.clone(),
        None if address.ip().is_unspecified() => computer(),
        None if address.is_ipv6() => format!("[{}]", address.ip()),
        None => address.ip().to_string(),
    }
}

fn computer() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

/// Returns the application URI, the identity of this program that its certificate states.
pub(super) fn application_uri(host: &str) -> String {
    format!("urn:{}:panelprep", host.trim_matches(['[', ']']))
}

/// Returns the host names in the certificate.
pub(super) fn hosts(host: &str, address: SocketAddr) -> Vec<String> {
    let mut all =
        vec![host.trim_matches(['[', ']']).to_owned(), computer(), "localhost".to_owned(), "127.0.0.1".to_owned()];
    all.extend((!address.ip().is_unspecified()).then(|| address.ip().to_string()));
    all.sort();
    all.dedup();
    all
}

/// Returns a server with these settings, still without nodes.
pub(super) fn builder(settings: &OpcUa, address: SocketAddr) -> ServerBuilder {
    let host = host(settings, address);
    let version = UAString::from(env!("CARGO_PKG_VERSION"));
    let mut builder = ServerBuilder::new()
        .application_name("Panelprep")
        .application_uri(application_uri(&host))
        .product_uri("urn:panelprep")
        .build_info(BuildInfo {
            product_uri: UAString::from("urn:panelprep"),
            manufacturer_name: UAString::from("Panelprep"),
            product_name: UAString::from("Panelprep"),
            software_version: version.clone(),
            build_number: version,
            build_date: DateTime::null(),
        })
        .pki_dir(&settings.certificates)
        .certificate_path(OWN_CERTIFICATE)
        .private_key_path(KEY)
        .trust_client_certs(false)
        .check_cert_time(true)
        .discovery_urls(vec![format!("opc.tcp://{host}:{}/", address.port())])
        .host(host)
        .port(address.port())
        .max_message_size(MESSAGE_BYTES)
        .max_chunk_count(CHUNKS)
        .max_string_length(STRING_BYTES)
        .max_byte_string_length(STRING_BYTES)
        .max_array_length(ARRAY_ITEMS)
        .max_sessions(SESSIONS)
        .max_session_timeout_ms(SESSION_MS)
        .diagnostics_enabled(false);
    for policy in [SecurityPolicy::Basic256Sha256, SecurityPolicy::Aes256Sha256RsaPss] {
        let endpoint = ServerEndpoint::new("/", policy, MessageSecurityMode::SignAndEncrypt, &[]);
        builder = builder.add_endpoint(policy.to_str(), endpoint);
    }
    if settings.is_unencrypted_allowed {
        builder = builder.add_endpoint("None", ServerEndpoint::new_none("/", &[]));
    }
    let limits = builder.limits_mut();
    limits.operational.max_nodes_per_method_call = 10;
    limits.operational.max_nodes_per_read = ARRAY_ITEMS;
    limits.operational.max_nodes_per_write = 1;
    limits.operational.max_nodes_per_node_management = 1;
    limits.subscriptions.max_subscriptions_per_session = 10;
    limits.subscriptions.max_monitored_items_per_sub = 500;
    limits.subscriptions.max_monitored_item_queue_size = 100;
    limits.subscriptions.max_queued_notifications = 50;
    builder
}
