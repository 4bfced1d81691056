//! The thread that keeps the cell connected to its broker.

use super::asking::Asking;
use super::broker::Broker;
use super::error::SparkplugError;
use super::following::{Followed, follow};
use super::session::{Ended, Parts, connected};
use crate::cell::{NodeCommands, SparkplugNode};
use crate::daemon::alarms::Alarms;
use crate::daemon::background::step_back;
use crate::daemon::gateway::Gateway;
use crate::daemon::people::People;
use crate::daemon::setup_source::SetupSource;
use crate::sparkplug::{EdgeNode, Ids, NodeSetup};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{oneshot, watch};
use tokio::time::sleep;

/// A lost broker is tried again after this time, then after twice as long each time, up to the second one.
const BACK_OFF: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(60)];
/// A connection that lived for so long was a good one.
const GOOD: Duration = Duration::from_secs(30);
/// Threads that wait for the store's disk and for names of hosts.
const BLOCKING: usize = 3;
/// The program's end waits so long for them.
const END_WITHIN: Duration = Duration::from_secs(2);

/// What the edge node is made of.
pub struct SparkplugParts {
    /// `[sparkplug]` of the cell's file.
    pub node: SparkplugNode,
    /// Where requests go.
    pub gateway: Gateway,
    /// The store as fronts have it.
    pub people: Arc<People>,
    /// The alarms of the cell.
    pub alarms: Arc<Alarms>,
    /// What is set up.
    pub setup: Arc<dyn SetupSource>,
}

/// The edge node while it is served. Dropping it tells the broker its death, and ends it.
#[derive(Debug)]
pub struct SparkplugEdge {
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl SparkplugEdge {
    /// Connects the cell to its broker, and again where the connection is lost: the cell does not wait for it.
    ///
    /// # Errors
    /// Where a certificate, a key or the password cannot be read, or the system refuses a thread.
    pub fn serve(parts: SparkplugParts) -> Result<Self, SparkplugError> {
        let broker = Broker::read(&parts.node)?;
        let runtime = Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(BLOCKING)
            .build()
            .map_err(SparkplugError::Thread)?;
        let (end, ended) = oneshot::channel();
        let serve = move || {
            step_back();
            run(&runtime, parts, broker, ended);
            runtime.shutdown_timeout(END_WITHIN);
        };
        let thread = thread::Builder::new().name("sparkplug".to_owned()).spawn(serve);
        Ok(SparkplugEdge { end: Some(end), thread: Some(thread.map_err(SparkplugError::Thread)?) })
    }
}

impl Drop for SparkplugEdge {
    fn drop(&mut self) {
        drop(self.end.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn run(runtime: &Runtime, parts: SparkplugParts, broker: Broker, mut leave: oneshot::Receiver<()>) {
    let SparkplugParts { node, gateway, people, alarms, setup } = parts;
    let from = format!("MQTT broker {}", broker.address);
    let asking = Asking { gateway: gateway.clone(), people: people.clone(), from };
    let (tell, view) = watch::channel(None);
    runtime.spawn(follow(Arc::new(Followed { gateway, people, alarms, setup }), tell));
    let session = Parts { broker, asking, view, begun: Instant::now() };
    let mut edge = EdgeNode::new(NodeSetup {
        commands_allowed: node.commands == NodeCommands::Operator,
        aliases: node.aliases,
        ids: Ids {
            group_id: node.group_id,
            edge_node_id: node.edge_node_id,
            primary_host_id: node.primary_host_id,
        },
    });
    runtime.block_on(again_and_again(&session, &mut edge, &mut leave));
}

async fn again_and_again(parts: &Parts, node: &mut EdgeNode, leave: &mut oneshot::Receiver<()>) {
    let (address, mut pause) = (&parts.broker.address, BACK_OFF[0]);
    loop {
        let begun = Instant::now();
        match connected(parts, node, leave).await {
            Ended::Leaves => return,
            Ended::HostOffline => tracing::info!("MQTT Sparkplug: the primary host is offline; {address} is left"),
            Ended::Lost(why) => tracing::warn!("MQTT Sparkplug: no connection to {address}: {why}"),
        }
        pause = if begun.elapsed() >= GOOD { BACK_OFF[0] } else { pause };
        tokio::select! {
            _ = &mut *leave => return,
            () = sleep(pause) => {}
        }
        pause = (2 * pause).min(BACK_OFF[1]);
    }
}
