//! The reason why the broker did not do what was requested.

use panelprep_base::trust::TrustError;

/// Errors of the connection to the broker.
#[derive(Debug, thiserror::Error)]
pub enum BrokerError {
    /// A file that belongs to the broker cannot be used.
    #[error(transparent)]
    File(#[from] TrustError),
    /// The broker does not answer, or refuses the connection.
    #[error("cannot connect to the broker {address}: {problem}")]
    Connect {
        /// Its address.
        address: String,
        /// The connection's message.
        problem: String,
    },
    /// The broker does not have the streams of this program.
    #[error("the broker {address} has no stream {stream}; start `panelprep archive run`, which creates the stream")]
    NoStream {
        /// Its address.
        address: String,
        /// The stream.
        stream: &'static str,
    },
    /// The broker did not accept a message, or did not confirm that it did.
    #[error("the broker {address} did not accept a message: {problem}")]
    Refused {
        /// Its address.
        address: String,
        /// The broker's message.
        problem: String,
    },
    /// Another operation failed.
    #[error("the broker {address}: cannot {operation}: {problem}")]
    Failed {
        /// Its address.
        address: String,
        /// The attempted operation.
        operation: &'static str,
        /// The broker's message.
        problem: String,
    },
}
