//! The thread that keeps the cell connected to its broker.

use super::asking::Asking;
use super::broker::Broker;
use super::following::follow;
use super::session::{Ended, Parts, connected};
use crate::cell::{NodeCommands, SparkplugNode};
use crate::daemon::background::run_apart;
use crate::daemon::front_parts::FrontParts;
use crate::sparkplug::{EdgeNode, Ids, NodeSetup};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use tokio::runtime::Builder;
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
    /// What every front works with.
    pub parts: FrontParts,
}

/// The edge node while it is served. Dropping it tells the broker its death, and ends it.
#[derive(Debug)]
pub struct SparkplugEdge {
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl SparkplugEdge {
    /// Connects the cell to its broker, and again where the connection is lost or a file cannot be used: the cell does not wait for it.
    ///
    /// # Errors
    /// Where the system refuses a thread.
    pub fn serve(SparkplugParts { node, parts }: SparkplugParts) -> std::io::Result<Self> {
        let runtime =
            Builder::new_current_thread().enable_io().enable_time().max_blocking_threads(BLOCKING).build()?;
        let (end, ended) = oneshot::channel();
        let serve = move || {
            run_apart(&runtime, "MQTT Sparkplug", ended, async |leave| run((&node, &parts), leave).await);
            runtime.shutdown_timeout(END_WITHIN);
        };
        let thread = thread::Builder::new().name("sparkplug".to_owned()).spawn(serve);
        Ok(SparkplugEdge { end: Some(end), thread: Some(thread?) })
    }
}

impl Drop for SparkplugEdge {
    fn drop(&mut self) {
        drop(self.end.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

async fn run((node, parts): (&SparkplugNode, &FrontParts), leave: &mut oneshot::Receiver<()>) {
    let address = format!("{}:{}", node.broker, node.port);
    let from = format!("MQTT broker {address}");
    let asking = Asking { gateway: parts.gateway.clone(), people: parts.people.clone(), from };
    let (tell, view) = watch::channel(None);
    tokio::spawn(follow(parts.clone(), tell));
    let session = Parts { asking, view, begun: Instant::now(), address, alarms: parts.alarms.clone() };
    let mut edge = EdgeNode::new(NodeSetup {
        commands_allowed: node.commands == NodeCommands::Operator,
        aliases: node.aliases,
        ids: Ids {
            group_id: node.group_id.clone(),
            edge_node_id: node.edge_node_id.clone(),
            primary_host_id: node.primary_host_id.clone(),
        },
    });
    let mut pause = BACK_OFF[0];
    loop {
        let begun = Instant::now();
        let ended = match Broker::read(node) {
            Ok(broker) => connected((&session, &broker), &mut edge, leave).await,
            Err(problem) => Ended::Lost(format!("{problem}; [sparkplug] in the cell's file names what it uses")),
        };
        match ended {
            Ended::Leaves => return,
            Ended::HostOffline => {
                tracing::info!("MQTT Sparkplug: the primary host is offline; {} is left", session.address);
            }
            Ended::Lost(why) => session.fails(&why),
        }
        pause = if begun.elapsed() >= GOOD { BACK_OFF[0] } else { pause };
        tokio::select! {
            _ = &mut *leave => return,
            () = sleep(pause) => {}
        }
        pause = (2 * pause).min(BACK_OFF[1]);
    }
}
