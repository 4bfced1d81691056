//! The format number of a recording, the names of records without a topic, and the errors of reading or writing a
//! recording.

/// The format number of recordings. Recordings with lower numbers are readable from [`OLDEST_FORMAT`] on.
///
/// Format 2: pictures have the camera's time, computed results have their time, and a recording may begin with a cycle
/// of a running service. Format 3: points have an alpha channel, and the lenses are included, both for people who view
/// the recording; the other content is that of format 2. Format 4: a compliant tool has its own topic; the other
/// content is that of formats 2 and 3.
pub const FORMAT: u32 = 4;
/// The oldest format that can be read.
pub const OLDEST_FORMAT: u32 = 2;

/// Name of the metadata records; below, the name of the attachment with the state of the control loop at the start.
pub(super) const METADATA: &str = "panelprep";
pub(super) const END: &str = "panelprep.end";
pub(super) const START: &str = "start.json";

/// The reason why a recording cannot be read or written. Times are seconds since its start.
#[derive(Debug, thiserror::Error)]
pub enum TapeError {
    /// The file is not an MCAP file.
    #[error("the file is not an MCAP file: {problem}")]
    NotMcap {
        /// The problem at the beginning of the file.
        problem: String,
    },
    /// The recording was written by another program.
    #[error("the MCAP file is not a recording of panelprep: {problem}")]
    Foreign {
        /// What is missing or unexpected.
        problem: String,
    },
    /// The format of the recording is that of another program version.
    #[error(
        "the recording has format {found} (written by panelprep {program}), this program reads format {FORMAT}; \
         replay the recording with the version that wrote it"
    )]
    Version {
        /// The format of the recording.
        found: String,
        /// The version of the program that wrote the recording.
        program: String,
    },
    /// The recording is truncated.
    #[error(
        "the recording was not finished: it ends {until_s:.3} s after its beginning with {entries} complete \
         entries; the program that wrote it ended too early, or the file was cut"
    )]
    Unfinished {
        /// Number of complete entries.
        entries: u64,
        /// Time of the last complete entry, s.
        until_s: f64,
    },
    /// The recording ended before the end of its cycle.
    #[error("the recording was stopped {until_s:.3} s after its beginning, before its cycle ended: {why}")]
    Stopped {
        /// Time of the last entry, s.
        until_s: f64,
        /// The reason why the recording stopped.
        why: String,
    },
    /// The recording states that entries are missing.
    #[error(
        "the recording has a gap: {count} entries of {topic}, the first {from_s:.3} s after its beginning, could \
         not be written"
    )]
    Lost {
        /// The topic of the missing entries.
        topic: &'static str,
        /// Time of the first missing entry, s.
        from_s: f64,
        /// Number of missing entries.
        count: u64,
    },
    /// Entries of a topic are missing, although the recording does not state this.
    #[error(
        "the recording has a gap: {topic} continues with entry {found} after {from_s:.3} s, entry {expected} was \
         expected; the file was changed after recording"
    )]
    Gap {
        /// The topic with the gap.
        topic: &'static str,
        /// Time of the gap, s.
        from_s: f64,
        /// Number of the expected entry; at the end of a recording, the expected number of entries.
        expected: u64,
        /// Number of the entry that was found; at the end of a recording, the number of entries that were found.
        found: u64,
    },
    /// The times of the entries decrease.
    #[error("the recording is not in order: a timestamp of {topic} decreases {from_s:.3} s after its beginning")]
    OutOfOrder {
        /// The topic of the entries.
        topic: &'static str,
        /// Time of the entry, s.
        from_s: f64,
    },
    /// The recording is damaged.
    #[error("the recording is damaged {from_s:.3} s after its beginning: {problem}")]
    Damaged {
        /// Time of the damage, s.
        from_s: f64,
        /// What is wrong with the data.
        problem: String,
    },
    /// An entry cannot be decoded.
    #[error("an entry of {topic} cannot be decoded {from_s:.3} s after the recording's beginning: {problem}")]
    Message {
        /// The topic of the entry.
        topic: &'static str,
        /// Time of the entry, s.
        from_s: f64,
        /// The problem of the entry.
        problem: String,
    },
    /// The recording cannot be read or written.
    #[error("the recording cannot be {doing}: {}", append_causes(source))]
    Disk {
        /// The failed operation: "read" or "written".
        doing: &'static str,
        /// The error of the library.
        source: mcap::McapError,
    },
    /// A picture cannot be compressed.
    #[error("a picture cannot be recorded: {0}")]
    Picture(#[from] panelprep_cell::files::PictureError),
}

/// Returns the text of an error with the texts of its causes, because the library's own text does not contain the error
/// of the operating system.
fn append_causes(error: &dyn std::error::Error) -> String {
    let mut words = error.to_string();
    let mut cause = error.source();
    while let Some(deeper) = cause {
        words = format!("{words}: {deeper}");
        cause = deeper.source();
    }
    words
}
