//! The structure of a frame, and its possible errors; `wire` reads and writes frames.

use strum::VariantArray;

pub(super) const MAGIC: [u8; 4] = *b"PPZV";

/// The version of this protocol: of the frames and of the messages in them.
pub const VERSION: u16 = 2;

/// The sender of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
pub enum FrameKind {
    /// From the worker, when it starts.
    Hello,
    /// The daemon sent the frame.
    Request,
    /// From the worker, once for each request.
    Reply,
}

impl FrameKind {
    pub(super) const ALL: &'static [FrameKind] = <Self as VariantArray>::VARIANTS;

    pub(super) fn number(self) -> u16 {
        match self {
            FrameKind::Hello => 1,
            FrameKind::Request => 2,
            FrameKind::Reply => 3,
        }
    }

    fn keyword(self) -> &'static str {
        match self {
            FrameKind::Hello => "a greeting",
            FrameKind::Request => "a request",
            FrameKind::Reply => "a reply",
        }
    }
}

/// Errors of a frame.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The stream ended between two frames.
    #[error("the connection has ended")]
    Ended,
    /// The stream ended within a frame.
    #[error("the connection ended within the {part} of a frame")]
    Cut {
        /// The part that was cut off.
        part: FramePart,
    },
    /// The frame came too slowly, or not at all.
    #[error("the rest of the {part} of a frame did not arrive in time")]
    Stalled {
        /// The part that did not arrive.
        part: FramePart,
    },
    /// The data do not begin with the opening of a frame.
    #[error("a frame begins with {found:02x?}, expected {MAGIC:02x?}")]
    NotAFrame {
        /// The first bytes.
        found: [u8; 4],
    },
    /// The other program is of another version.
    #[error("the received frames have the version {found}, but this program uses version {VERSION}")]
    Version {
        /// Version found.
        found: u16,
    },
    /// A checksum is wrong.
    #[error("the checksum of a frame's {part} is {found:08x}, but the checksum of its bytes is {computed:08x}")]
    Checksum {
        /// The damaged part.
        part: FramePart,
        /// Checksum sent.
        found: u32,
        /// Computed.
        computed: u32,
    },
    /// Another kind of frame was expected.
    #[error("found a frame of kind {found}, expected kind {}, {}", allowed.number(), allowed.keyword())]
    Kind {
        /// Kind found.
        found: u16,
        /// The expected kind.
        allowed: FrameKind,
    },
    /// A reply to another request.
    #[error("found a response to request {found}, but the last request was {allowed}")]
    Sequence {
        /// Number found.
        found: u32,
        /// The expected number.
        allowed: u32,
    },
    /// The frame is longer than allowed.
    #[error("the {part} of a frame has {found} bytes (limit {allowed} bytes)")]
    TooLong {
        /// The part that is too long.
        part: FramePart,
        /// Length found, bytes.
        found: u64,
        /// Largest valid length, bytes.
        allowed: u64,
    },
    /// A payload of another size than its head states.
    #[error("a frame's payload has {found} bytes, but its head states {expected} bytes")]
    PayloadSize {
        /// Size stated by the frame's opening, bytes.
        found: u64,
        /// Size stated by the frame's head, bytes.
        expected: u64,
    },
    /// A head without known content.
    #[error("the head of a frame cannot be read: {0}")]
    Head(#[from] serde_json::Error),
    /// The system reported an error.
    #[error("the connection failed: {0}")]
    Io(std::io::Error),
}

/// A part of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FramePart {
    /// Its first bytes.
    Opening,
    /// The head, which is JSON.
    Head,
    /// The payload, which is binary.
    Payload,
}

impl std::fmt::Display for FramePart {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            FramePart::Opening => "opening",
            FramePart::Head => "head",
            FramePart::Payload => "payload",
        })
    }
}
