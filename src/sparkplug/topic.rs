//! The topics of one edge node.

/// The first part of every topic.
const NAMESPACE: &str = "spBv1.0";

/// The names by which the cell is known at the broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ids {
    /// The group of edge nodes.
    pub group_id: String,
    /// The node in it.
    pub edge_node_id: String,
    /// The host application without which nothing is published.
    pub primary_host_id: Option<String>,
}

impl Ids {
    fn of(&self, kind: &str) -> String {
        format!("{NAMESPACE}/{}/{kind}/{}", self.group_id, self.edge_node_id)
    }

    /// Where the birth is told.
    pub fn nbirth(&self) -> String {
        self.of("NBIRTH")
    }

    /// Where changes are told.
    pub fn ndata(&self) -> String {
        self.of("NDATA")
    }

    /// Where the death is told.
    pub fn ndeath(&self) -> String {
        self.of("NDEATH")
    }

    /// Where commands come.
    pub fn ncmd(&self) -> String {
        self.of("NCMD")
    }

    /// Where the primary host says whether it is online.
    pub fn state(&self) -> Option<String> {
        self.primary_host_id.as_ref().map(|host| format!("{NAMESPACE}/STATE/{host}"))
    }
}
