//! The OPC UA server: an interface through which a production line uses the service's requests and states. The server
//! makes no decisions for the cell.
//!
//! ```text
//! client ─ limiter (limits, addresses) ─ async-opcua (channels, certificates, sessions) ─ access (accounts, roles)
//!                                        └─ nodes ┬─ OPC UA's own nodes, conditions
//!                                                  └─ the cell's nodes ─ calls → Gateway → the loop
//! the loop ─ state, five times a second ─ follow ─ values of `packml::NODES`, conditions
//! the store ─ once a second ──────────────┘
//! ```
//!
//! The limiter is the proxy of `connection_limit`. The server has its own thread and runtime, separate from the cell's
//! supervision. A panic in code that reads from the network ends a connection, or this server, which is then restarted;
//! it never stops the cell. The loop never waits for clients. Names and passwords, roles, locks after wrong passwords,
//! and the audit trail are those of the operator's page. Stop and abort need no role.
//!
//! This file contains the server's thread, which listens, restarts the server if it fails, and ends the server with the
//! service. It also contains the settings of async-opcua: addresses, security, and the limits of everything that a
//! client may send or store.

mod access;
mod address_space;
mod calls;
mod certificates;
mod conditions;
mod connection_limit;
mod follow;
mod nodes;

use self::access::Access;
use self::calls::Calls;
use self::certificates::{KEY_PATH, OWN_CERTIFICATE, RejectedFiles, TrustedFiles};
use self::conditions::AlarmConditions;
use self::connection_limit::ConnectionLimiter;
use self::follow::{Follower, NewestCycle, StoreReader, StoreValues, poll_store};
use self::nodes::{CellNodes, CoreNodes};
use super::background::{Background, Plan};
use super::gateway::InterfaceContext;
use opcua::crypto::SecurityPolicy;
use opcua::server::address_space::AddressSpace;
use opcua::server::diagnostics::DiagnosticsNodeManagerBuilder;
use opcua::server::node_manager::ServerContext;
use opcua::server::node_manager::memory::{InMemoryNodeManager, InMemoryNodeManagerBuilder};
use opcua::server::{Server, ServerBuilder, ServerEndpoint, ServerHandle};
use opcua::types::{BuildInfo, DateTime, MessageSecurityMode, UAString};
use panelprep_cell::cell::OpcUa;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{oneshot, watch};
use tokio::time::sleep;

/// Delay before a retry if the address is not available or the server has failed.
const RESTART_DELAY: Duration = Duration::from_secs(1);
/// Name of the server in the log and in alarms.
const NAME: &str = "OPC UA server";
/// Number of threads that wait for the store's disk and hash passwords.
const BLOCKING_THREADS: usize = 4;
/// Stack size of a thread, bytes: sufficient to decode any message, because messages can be nested.
const STACK_BYTES: usize = 8 * 1_024 * 1_024;

/// The parts of the service that the server needs.
pub struct OpcUaParts {
    /// The `[opcua]` table of the cell's file.
    pub settings: OpcUa,
    /// The parts that all interfaces share.
    pub front: InterfaceContext,
}

/// The running OPC UA server; dropping this value ends it.
#[derive(Debug)]
pub struct OpcUaServer {
    _background: Background,
}

impl OpcUaServer {
    /// Starts the server; returns `None` if the cell's file contains no address for it. If the address is not available
    /// now, or certificates cannot be used, the server tries again later; the cell does not wait for it.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn serve(parts: OpcUaParts) -> std::io::Result<Option<Self>> {
        let Some(address) = parts.settings.listen else { return Ok(None) };
        let plan =
            Plan { name: "opcua", task: NAME, blocking_threads: BLOCKING_THREADS, stack_bytes: Some(STACK_BYTES) };
        let begin = async move |ended: &mut oneshot::Receiver<()>| run((&parts, address), ended).await;
        Ok(Some(OpcUaServer { _background: Background::start(plan, begin)? }))
    }
}

/// Runs the server until it is requested to end. If the server cannot be started, or ends without a request, it is
/// started again.
async fn run((parts, address): (&OpcUaParts, SocketAddr), ended: &mut oneshot::Receiver<()>) {
    let alarms = &parts.front.alarms;
    loop {
        let problem = tokio::select! {
            served = serve_until_end(parts, address) => served.err().unwrap_or_else(|| "the server ended without a \
                reported cause; see the lines above in the log".to_owned()),
            _ = &mut *ended => return,
        };
        if alarms.set_connection_problem(NAME, Some(&problem)) {
            tracing::warn!("{NAME}: {problem}; retrying every second");
        }
        tokio::select! {
            () = sleep(RESTART_DELAY) => {}
            _ = &mut *ended => return,
        }
    }
}

/// A server with all its parts, before it is started.
struct BuiltServer {
    server: Server,
    handle: ServerHandle,
    nodes: Arc<InMemoryNodeManager<CellNodes>>,
    core: Arc<InMemoryNodeManager<CoreNodes>>,
    conditions: Arc<AlarmConditions>,
    access: Arc<Access>,
    connections: Arc<ConnectionLimiter>,
}

fn build(parts: &OpcUaParts, address: SocketAddr) -> Result<BuiltServer, String> {
    let door = Arc::new(ConnectionLimiter::default());
    let access = Arc::new(Access::new(parts.front.people.clone(), door.clone(), parts.settings.anonymous));
    let calls = Arc::new(Calls::new(access.clone(), parts.front.clone()));
    let conditions = Arc::new(AlarmConditions::default());
    let shared = (calls.clone(), conditions.clone());
    let core = move |context: ServerContext, space: &mut AddressSpace| CoreNodes::build(shared, context, space);
    let cell = move |context: ServerContext, space: &mut AddressSpace| CellNodes::build(calls, &context, space);
    let (server, handle) = builder(&parts.settings, address)
        .without_node_managers()
        .with_node_manager(InMemoryNodeManagerBuilder::new(core))
        .with_node_manager(DiagnosticsNodeManagerBuilder)
        .with_node_manager(InMemoryNodeManagerBuilder::new(cell))
        .with_authenticator(access.clone())
        .build()?;
    let nodes = handle.node_managers().get_of_type::<InMemoryNodeManager<CellNodes>>();
    let nodes = nodes.ok_or_else(|| {
        "internal fault: the nodes of the cell are missing in the OPC UA server; report \
                                     this"
            .to_owned()
    })?;
    let core = handle.node_managers().get_of_type::<InMemoryNodeManager<CoreNodes>>();
    let core = core.ok_or_else(|| {
        "internal fault: the standard nodes of the OPC UA server are missing; report \
                                   this"
            .to_owned()
    })?;
    conditions.set_namespace(nodes.inner().namespace);
    Ok(BuiltServer { server, handle, nodes, core, conditions, access, connections: door })
}

async fn serve_until_end(parts: &OpcUaParts, address: SocketAddr) -> Result<(), String> {
    let host = host(&parts.settings, address);
    let (uri, hosts) = (application_uri(&host), hosts(&host, address));
    let thumbprint = certificates::prepare(&parts.settings.certificates, &uri, &hosts);
    let thumbprint = thumbprint.map_err(|error| error.to_string())?;
    let listener = TcpListener::bind(address).await;
    let listener = listener.map_err(|error| {
        format!(
            "cannot listen at {address}: {error}; set another address at \
                                                     [opcua] listen, or end the program that uses it"
        )
    })?;
    let failed = |error: std::io::Error| error.to_string();
    let behind = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.map_err(failed)?;
    let behind_address = behind.local_addr().map_err(failed)?;
    let BuiltServer { server, handle, nodes, core, conditions, access, connections: door } = build(parts, address)?;
    let (tell_depth, depth) = watch::channel(StoreValues::default());
    let (tell_cycle, cycle) = watch::channel(NewestCycle::default());
    let reader = StoreReader {
        access,
        front: parts.front.clone(),
        connections: door.clone(),
        folder: parts.settings.certificates.clone(),
        rejected: RejectedFiles::default(),
        trusted: TrustedFiles::default(),
        files_read: None,
        counted: None,
        last: StoreValues::default(),
    };
    let follower = Follower {
        gateway: parts.front.gateway.clone(),
        nodes,
        core,
        conditions,
        handle: handle.clone(),
        depth,
        cycle: tell_cycle,
    };
    parts.front.alarms.set_connection_problem(NAME, None);
    tracing::info!("{NAME}: opc.tcp://{host}:{}/, SHA-1 of its certificate {thumbprint}", address.port());
    // If one of these parts ends, all the others are ended too.
    tokio::select! {
        served = server.run_with(behind) => served,
        () = poll_store(reader, cycle, tell_depth) => Ok(()),
        () = follower.update_nodes() => Ok(()),
        () = keep_reported_port(&handle, address.port()) => Ok(()),
        () = door.serve_connections(listener, behind_address) => Ok(()),
    }
}

/// Sets the reported port to the port of the limiter, repeatedly, because the server itself listens on another port
/// behind the limiter.
async fn keep_reported_port(handle: &ServerHandle, port: u16) {
    loop {
        handle.info().port.store(port, Ordering::Relaxed);
        sleep(Duration::from_millis(20)).await;
    }
}

/// Time without a request after which a session ends, ms.
const SESSION_TIMEOUT_MS: u64 = 60_000;
/// Limits of a message and its content; bytes, or number of items.
const MAX_MESSAGE_BYTES: usize = 256 * 1_024;
const MAX_CHUNKS: usize = 16;
const MAX_STRING_BYTES: usize = 64 * 1_024;
const MAX_ARRAY_ITEMS: usize = 2_000;
const MAX_SESSIONS: usize = 40;

/// Returns the name under which clients reach the server: the name in the cell's file, the address, or the name of the
/// computer.
fn host(settings: &OpcUa, address: SocketAddr) -> String {
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

/// Returns the application URI, by which the certificate identifies this program.
fn application_uri(host: &str) -> String {
    format!("urn:{}:panelprep", host.trim_matches(['[', ']']))
}

/// Returns the host names for the certificate.
fn hosts(host: &str, address: SocketAddr) -> Vec<String> {
    let mut all =
        vec![host.trim_matches(['[', ']']).to_owned(), computer(), "localhost".to_owned(), "127.0.0.1".to_owned()];
    all.extend((!address.ip().is_unspecified()).then(|| address.ip().to_string()));
    all.sort();
    all.dedup();
    all
}

/// Returns a server with these settings, without nodes.
fn builder(settings: &OpcUa, address: SocketAddr) -> ServerBuilder {
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
        .private_key_path(KEY_PATH)
        .trust_client_certs(false)
        .check_cert_time(true)
        .discovery_urls(vec![format!("opc.tcp://{host}:{}/", address.port())])
        .host(host)
        .port(address.port())
        .max_message_size(MAX_MESSAGE_BYTES)
        .max_chunk_count(MAX_CHUNKS)
        .max_string_length(MAX_STRING_BYTES)
        .max_byte_string_length(MAX_STRING_BYTES)
        .max_array_length(MAX_ARRAY_ITEMS)
        .max_sessions(MAX_SESSIONS)
        .max_session_timeout_ms(SESSION_TIMEOUT_MS)
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
    limits.operational.max_nodes_per_read = MAX_ARRAY_ITEMS;
    limits.operational.max_nodes_per_write = 1;
    limits.operational.max_nodes_per_node_management = 1;
    limits.subscriptions.max_subscriptions_per_session = 10;
    limits.subscriptions.max_monitored_items_per_sub = 500;
    limits.subscriptions.max_monitored_item_queue_size = 100;
    limits.subscriptions.max_queued_notifications = 50;
    builder
}
