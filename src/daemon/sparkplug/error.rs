//! Why the cell cannot be an edge node.

use crate::trust::TrustError;

/// Why the cell cannot be an edge node. A broker that is not there is none: it is tried again.
#[derive(Debug, thiserror::Error)]
pub enum SparkplugError {
    /// A file.
    #[error("MQTT Sparkplug: {0}; [sparkplug] in the cell's file names what it uses")]
    File(#[from] TrustError),
    /// The system gives no thread.
    #[error("MQTT Sparkplug has no thread: {0}")]
    Thread(std::io::Error),
}
