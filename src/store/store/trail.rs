//! Positions in lists that are read page by page, the newest line first.

/// A position in the audit trail or among the requests. Lines are in the order of their time, and of their number
/// within one millisecond: the time alone does not separate two of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TrailPosition {
    /// The line's time, ms since 1970.
    pub unix_ms: i64,
    /// The line's number in its table, from 1.
    pub number: i64,
}

impl TrailPosition {
    /// The position after every line.
    pub const END: TrailPosition = TrailPosition { unix_ms: i64::MAX, number: i64::MAX };
}
