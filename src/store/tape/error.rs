//! The number of a recording's format, the names of the records that belong to none of its topics, and the errors in
//! reading or writing a recording.

/// The number of the recording's format. A recording with another number has another meaning, and is read only from
/// [`OLDEST_FORMAT`] on.
///
/// 2: pictures have the camera's time, computed results have their time, a recording may begin with a cycle of a
/// running service. 3: points have an alpha channel, and the lenses are included: both for people who view the
/// recording. The content of 2 is read as before. 4: a compliant tool has its own topic. The content of 2 and 3 is read
/// as before.
pub const FORMAT: u32 = 4;
/// The oldest format that can be read.
pub const OLDEST_FORMAT: u32 = 2;

/// Names of the metadata records, of the attachment that states how the loop began, and of the files beside it.
pub(super) const METADATA: &str = "panelprep";
pub(super) const END: &str = "panelprep.end";
pub(super) const START: &str = "start.json";

/// The error in a recording. Times are seconds since it began.
#[derive(Debug, thiserror::Error)]
pub enum TapeError {
    /// The file is not an MCAP file.
    #[error("the file is not an MCAP file: {problem}")]
    NotMcap {
        /// The problem with the beginning of the file.
        problem: String,
    },
    /// The recording was written by another program.
    #[error("the MCAP file is not a recording of panelprep: {problem}")]
    Foreign {
        /// The missing or unexpected content.
        problem: String,
    },
    /// The recording has the format of another version of this program.
    #[error(
        "the recording has format {found} (written by panelprep {program}), this program reads format {FORMAT}; \
         replay the recording with the version that wrote it"
    )]
    Version {
        /// Its format.
        found: String,
        /// The program and version that wrote the recording.
        program: String,
    },
    /// The recording ends too early.
    #[error(
        "the recording was not finished: it ends {until_s:.3} s after its beginning with {entries} complete \
         entries; the program that wrote it ended too early, or the file was cut"
    )]
    Unfinished {
        /// Number of entries read.
        entries: u64,
        /// Time of the last entry, s.
        until_s: f64,
    },
    /// The recording ended before the end of its cycle.
    #[error("the recording was stopped {until_s:.3} s after its beginning, before its cycle ended: {why}")]
    Stopped {
        /// Time in the recording, s.
        until_s: f64,
        /// The reason why the recording stopped.
        why: String,
    },
    /// The recording itself states that something is missing.
    #[error(
        "the recording has a gap: {count} entries of {topic}, the first {from_s:.3} s after its beginning, could \
         not be written"
    )]
    Lost {
        /// The topic.
        topic: &'static str,
        /// Time in the recording, s.
        from_s: f64,
        /// Number of lost entries.
        count: u64,
    },
    /// Entries of a topic are missing.
    #[error(
        "the recording has a gap: {topic} continues with entry {found} after {from_s:.3} s, entry {expected} was \
         expected; the file was changed after recording"
    )]
    Gap {
        /// The topic.
        topic: &'static str,
        /// Time in the recording, s.
        from_s: f64,
        /// The number of the expected entry; if entries at the end are missing, the required number of entries.
        expected: u64,
        /// The number of the entry that was found; if entries at the end are missing, the number of entries that were
        /// found.
        found: u64,
    },
    /// The times of the entries do not increase.
    #[error("the recording is not in order: a timestamp of {topic} decreases {from_s:.3} s after its beginning")]
    OutOfOrder {
        /// The topic.
        topic: &'static str,
        /// Time in the recording, s.
        from_s: f64,
    },
    /// Bytes of the recording differ from the written ones.
    #[error("the recording is damaged {from_s:.3} s after its beginning: {problem}")]
    Damaged {
        /// Time in the recording, s.
        from_s: f64,
        /// The problem in the data.
        problem: String,
    },
    /// A message cannot be decoded.
    #[error("an entry of {topic} cannot be decoded {from_s:.3} s after the recording's beginning: {problem}")]
    Message {
        /// The topic.
        topic: &'static str,
        /// Time in the recording, s.
        from_s: f64,
        /// The problem in the message.
        problem: String,
    },
    /// The disk reported an error.
    #[error("the recording cannot be {doing}: {}", append_causes(source))]
    Disk {
        /// The operation: read or write.
        doing: &'static str,
        /// The error that was returned.
        source: mcap::McapError,
    },
    /// A picture cannot be compressed.
    #[error("a picture cannot be recorded: {0}")]
    Picture(#[from] panelprep_cell::files::PictureError),
}

/// Returns the text of an error with the texts of its causes. The library's own text leaves out the error of the
/// operating system.
fn append_causes(error: &dyn std::error::Error) -> String {
    let mut words = error.to_string();
    let mut cause = error.source();
    while let Some(deeper) = cause {
        words = format!("{words}: {deeper}");
        cause = deeper.source();
    }
    words
}
