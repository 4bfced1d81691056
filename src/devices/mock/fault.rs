//! What EthernetKRL closes a channel for, and what keeps the mock from starting.

/// A reception error: the controller logs its number and closes the channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EkiFault {
    /// Not XML, or a value that is not of its element's type.
    #[error("1024: error reading received XML")]
    Malformed,
    /// More bytes than BUFFSIZE without the end of a document.
    #[error("1024: more bytes than BUFFSIZE without the end of a document")]
    TooLong,
    /// One record more than BUFFERING allows.
    #[error("1280: memory limit reached")]
    Overflow,
}

/// Why the mock controller cannot start.
#[derive(Debug, thiserror::Error)]
pub enum MockError {
    /// The EthernetKRL file is not what the mock needs.
    #[error("{channel}.xml: {problem}")]
    File {
        /// CELLCMD or CELLSTAT.
        channel: &'static str,
        /// What is wrong.
        problem: FileProblem,
    },
    /// A port cannot be listened on.
    #[error("cannot listen on {address}: {reason}")]
    Listen {
        /// Where.
        address: std::net::SocketAddr,
        /// What the system says.
        reason: std::io::Error,
    },
    /// The system gives no thread.
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
}

/// What is wrong with an EthernetKRL file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FileProblem {
    /// Not XML.
    #[error("is not XML: {0}")]
    Xml(String),
    /// A section that must be there is not.
    #[error("has no {0}")]
    Missing(&'static str),
    /// A number is not one.
    #[error("{name} is \"{found}\"; a whole number is needed")]
    Number {
        /// Of which attribute or element.
        name: String,
        /// What stands there.
        found: String,
    },
    /// An element of a type that the mock does not know.
    #[error("the element {tag} has the type \"{found}\"; INT, REAL, FRAME or none is known")]
    Type {
        /// The element.
        tag: String,
        /// Its type.
        found: String,
    },
    /// An element that the controller's program reads is not received.
    #[error("does not receive {0}, which the program reads")]
    NotReceived(&'static str),
}
