//! The thread that keeps the cell connected to its broker.

use super::broker::BrokerConnection;
use super::following::poll_cell;
use super::host_requests::HostRequests;
use super::session::{NAME, SessionEnd, SessionParts, connected};
use crate::daemon::background::{Background, Plan};
use crate::daemon::interface_context::InterfaceContext;
use panelprep_cell::cell::{NodeCommands, SparkplugNode};
use panelprep_interfaces::sparkplug::{CellIds, EdgeNode, NodeSetup};
use std::time::{Duration, Instant};
use tokio::sync::{oneshot, watch};
use tokio::time::sleep;

/// Delays before a lost broker is tried again: the first value at the beginning, then twice as long each time, up to
/// the second value.
const RETRY_DELAYS: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(60)];
/// Time after which a connection counts as stable.
const MIN_STABLE_TIME: Duration = Duration::from_secs(30);
/// Number of threads that wait for the store's disk and for the names of hosts.
const BLOCKING_THREADS: usize = 3;

/// The parts that the edge node needs.
pub struct SparkplugParts {
    /// The `[sparkplug]` table of the cell's file.
    pub node: SparkplugNode,
    /// The parts that every interface uses.
    pub front: InterfaceContext,
}

/// The edge node while it is served. Dropping it reports its death to the broker, and ends it.
#[derive(Debug)]
pub struct SparkplugEdge {
    _background: Background,
}

impl SparkplugEdge {
    /// Connects the cell to its broker, and tries again if the connection is lost or a file cannot be used: the cell
    /// does not wait for the connection.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub fn serve(SparkplugParts { node, front }: SparkplugParts) -> std::io::Result<Self> {
        let plan = Plan { name: "sparkplug", task: NAME, blocking_threads: BLOCKING_THREADS, stack_bytes: None };
        let begin = async move |leave: &mut oneshot::Receiver<()>| run((&node, &front), leave).await;
        Ok(SparkplugEdge { _background: Background::start(plan, begin)? })
    }
}

async fn run((node, front): (&SparkplugNode, &InterfaceContext), leave: &mut oneshot::Receiver<()>) {
    let address = format!("{}:{}", node.broker, node.port);
    let from = format!("MQTT broker {address}");
    let asking = HostRequests { gateway: front.gateway.clone(), people: front.people.clone(), origin: from };
    let (tell, view) = watch::channel(None);
    tokio::spawn(poll_cell(front.clone(), tell));
    let session = SessionParts {
        host_requests: asking,
        view,
        started: Instant::now(),
        address,
        alarms: front.alarms.clone(),
    };
    let mut edge = EdgeNode::new(NodeSetup {
        commands_allowed: node.commands == NodeCommands::Operator,
        aliases: node.aliases,
        ids: CellIds {
            group_id: node.group_id.clone(),
            edge_node_id: node.edge_node_id.clone(),
            primary_host_id: node.primary_host_id.clone(),
        },
    });
    let mut pause = RETRY_DELAYS[0];
    loop {
        let begun = Instant::now();
        let ended = match BrokerConnection::read(node) {
            Ok(broker) => connected((&session, &broker), &mut edge, leave).await,
            Err(problem) => SessionEnd::Lost(format!(
                "{problem}; check the files that [sparkplug] in the cell's file \
                                                 names"
            )),
        };
        match ended {
            SessionEnd::Leaving => return,
            SessionEnd::HostOffline => {
                tracing::info!(
                    "MQTT Sparkplug: the primary host is offline; disconnecting from {}",
                    session.address
                );
            }
            SessionEnd::Lost(why) => session.report_failure(&why),
        }
        pause = if begun.elapsed() >= MIN_STABLE_TIME { RETRY_DELAYS[0] } else { pause };
        tokio::select! {
            _ = &mut *leave => return,
            () = sleep(pause) => {}
        }
        pause = (2 * pause).min(RETRY_DELAYS[1]);
    }
}
