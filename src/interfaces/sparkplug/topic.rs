//! The topics of one edge node.

/// The first part of every topic.
const NAMESPACE: &str = "spBv1.0";

/// The names by which the cell is known at the broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellIds {
    /// The group of edge nodes.
    pub group_id: String,
    /// The name of the edge node in its group.
    pub edge_node_id: String,
    /// The host application without which nothing is published.
    pub primary_host_id: Option<String>,
}

impl CellIds {
    fn topic(&self, kind: &str) -> String {
        format!("{NAMESPACE}/{}/{kind}/{}", self.group_id, self.edge_node_id)
    }

    /// The topic of the birth.
    pub fn birth_topic(&self) -> String {
        self.topic("NBIRTH")
    }

    /// The topic of changes.
    pub fn data_topic(&self) -> String {
        self.topic("NDATA")
    }

    /// The topic of the death.
    pub fn death_topic(&self) -> String {
        self.topic("NDEATH")
    }

    /// The topic of commands.
    pub fn command_topic(&self) -> String {
        self.topic("NCMD")
    }

    /// The topic on which the primary host states whether it is online.
    pub fn state(&self) -> Option<String> {
        self.primary_host_id.as_ref().map(|host| format!("{NAMESPACE}/STATE/{host}"))
    }
}
