//! The errors that EthernetKRL reports to the program, the faults that close a channel, and the errors that prevent
//! the mock from starting.

/// The error that `Msg_No` reports to a program that reads a memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EkiError {
    /// The memory contains no value; the error is returned at once, without waiting.
    #[error("15: access to an empty memory")]
    Empty,
    /// The memory contains values of another type.
    #[error("20: the memory contains values of another type")]
    Type,
}

/// The reason why a channel was closed; reception errors have the number that the controller logs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EkiFault {
    /// The connection was disrupted.
    #[error("512: connection disrupted")]
    Disrupted,
    /// The other end does not answer.
    #[error("768: no response from the other system")]
    NoContact,
    /// The document is not XML, or a value does not have its element's type.
    #[error("1024: error reading received XML")]
    Malformed,
    /// More bytes than BUFFSIZE arrived without the end of a document.
    #[error("1024: more bytes than BUFFSIZE without the end of a document")]
    TooLong,
    /// The memory of a tag received one entry more than BUFFERING allows.
    #[error("1280: memory limit reached")]
    Overflow,
    /// A text is too long for a KRL string.
    #[error("1536: string too long")]
    TextTooLong,
    /// No client connected within TIMEOUT: the channel no longer listens, until the program opens it again.
    #[error("2048: server time limit reached")]
    TimeLimit,
    /// The program could not read what it needs, and closed the channel itself.
    #[error("the program closed the channel: {0}")]
    Unread(EkiError),
    /// The program found values of different documents in one row, and closed the channel itself.
    #[error(
        "the program closed the channel: an element was missing, so the memories of the tags contain values of \
         different messages"
    )]
    Drifted,
}

/// The reason why the mock controller cannot start.
#[derive(Debug, thiserror::Error)]
pub enum MockError {
    /// A program or data list of the controller is not correct.
    #[error("{0}")]
    Program(String),
    /// The EthernetKRL file does not satisfy the mock's requirements.
    #[error("{channel}.xml: {problem}")]
    File {
        /// CELLCMD or CELLSTAT.
        channel: &'static str,
        /// The problem.
        problem: FileProblem,
    },
    /// The mock cannot listen on a port.
    #[error("cannot listen on {address}: {reason}")]
    Listen {
        /// The address.
        address: std::net::SocketAddr,
        /// The system's error.
        reason: std::io::Error,
    },
    /// The system could not start a thread.
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
}

/// Problems of an EthernetKRL file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FileProblem {
    /// The file is not XML.
    #[error("is not XML: {0}")]
    Xml(String),
    /// A required section is missing.
    #[error("has no {0}")]
    Missing(&'static str),
    /// A text is not a number.
    #[error("{name} is \"{found}\"; valid: a whole number")]
    Number {
        /// The name of the attribute or element.
        name: String,
        /// The text found.
        found: String,
    },
    /// A value is not one of the permitted keywords.
    #[error("{name} is \"{found}\"; valid: {allowed}")]
    Word {
        /// The name of the attribute or element.
        name: &'static str,
        /// The text found.
        found: String,
        /// The valid words.
        allowed: &'static str,
    },
    /// An element has a type that the controller does not know.
    #[error("the element {tag} has the type \"{found}\"; valid: INT, REAL, BOOL, STRING, FRAME or no type")]
    Type {
        /// The element.
        tag: String,
        /// Its type.
        found: String,
    },
    /// An element that the controller's program reads is not received.
    #[error("does not receive {0} in the form that the program reads")]
    NotReceived(&'static str),
}
