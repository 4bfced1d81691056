//! The service's socket, in lines: one JSON object asks, one answers, then the connection ends.
//!
//! ```text
//! {"ask":"unhold","dried":true}
//! {"answer":"refused","state":"idle","phase":null,"epoch":4,"cycle_id":null,"verdict":null,"recording":null,"reasons":[…]}
//! ```
//!
//! Strict: an unknown word, an unknown or repeated key, more than one object, a line that is too long or has no end is
//! refused with what is allowed; nothing of it is done. A recipe goes as its text, so that who asks needs no file that
//! the service can read. Reads and writes no socket: see `socket`.

use super::lending::ShotWish;
use super::replay::Recorded;
use crate::verdict::{Reason, Verdict};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The longest line, with its end: a recipe and its escapes. Only a start is that long.
pub const MOST_BYTES: usize = 256 * 1_024;
/// The longest of any other line.
pub(super) const MOST_SHORT_BYTES: usize = 4 * 1_024;

/// Whether a line that begins so may be as long as a start.
pub(super) fn may_be_long(beginning: &[u8]) -> bool {
    let word = b"\"start\"";
    let searched = &beginning[..beginning.len().min(MOST_SHORT_BYTES)];
    searched.windows(word.len()).any(|part| part == word)
}

/// What may be asked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "ask", rename_all = "lowercase", deny_unknown_fields)]
pub enum Wish {
    /// How things stand.
    State {},
    /// A cycle.
    Start {
        /// The recipe's name in messages.
        recipe: String,
        /// Its text.
        text: String,
        /// Where it is recorded, where it is.
        #[serde(default)]
        record: Option<RecordIn>,
        /// The part that stands in the cell, by whose order and hand.
        #[serde(default)]
        part: Option<PartNames>,
    },
    /// See [`crate::cycle::Request`], likewise for the others.
    Hold {},
    /// As there.
    Unhold {
        /// A person confirms that the panel is dry.
        #[serde(default)]
        dried: bool,
    },
    /// As there.
    Accept {},
    /// As there.
    Stop {},
    /// As there.
    Abort {},
    /// As there.
    Clear {},
    /// As there.
    Reset {},
    /// A new disc was mounted.
    #[serde(rename = "new-disc")]
    NewDisc {},
    /// A shot by the cell's cameras, while the cell rests without a cycle. The answer is a stream: see `lending`.
    Shoot {
        /// Which.
        shot: ShotWish,
    },
}

/// Which part a cycle is about, as far as it is told.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartNames {
    /// The part's serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// The work order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<String>,
    /// Who operates the cell, as that person was named.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
}

/// Where a cycle is recorded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordIn {
    /// In the store, under the cycle's number.
    Store,
    /// In this new file, its path from the root.
    File(PathBuf),
}

/// Why a line says nothing.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ProtocolError {
    /// Too long.
    #[error("the line is longer than {most} bytes")]
    TooLong {
        /// The longest that is read.
        most: usize,
    },
    /// It took too long.
    #[error("the line did not come whole in time; write it at once")]
    Slow,
    /// Others needed the place.
    #[error(
        "too many connections are open, and this one was silent for longest; write the line at once, and try again"
    )]
    GaveWay,
    /// It broke off.
    #[error("the line has no end")]
    NoEnd,
    /// It is not what is allowed.
    #[error("not understood: {problem}")]
    NotUnderstood {
        /// What is wrong.
        problem: String,
    },
}

impl Wish {
    /// Reads a line, with its end.
    ///
    /// # Errors
    /// Where it is too long, has no end, or is not exactly one allowed object.
    pub fn read(line: &[u8]) -> Result<Self, ProtocolError> {
        if line.len() > MOST_BYTES {
            return Err(ProtocolError::TooLong { most: MOST_BYTES });
        }
        let Some((b'\n', object)) = line.split_last() else { return Err(ProtocolError::NoEnd) };
        serde_json::from_slice(object).map_err(|error| ProtocolError::NotUnderstood { problem: error.to_string() })
    }
}

/// How it went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Exit {
    /// The table took it.
    Done,
    /// Not now, or not so.
    Refused,
    /// Not with a cell in this condition.
    Fault,
}

impl Exit {
    /// The exit code of `panelprep ctl`.
    pub fn code(self) -> u8 {
        match self {
            Exit::Done => 0,
            Exit::Refused => 2,
            Exit::Fault => 3,
        }
    }
}

/// What is answered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reply {
    /// How it went.
    pub answer: Exit,
    /// The PackML word; none where the loop was not asked.
    pub state: Option<String>,
    /// The phase inside Execute; where the cycle is held, the one in which it goes on.
    pub phase: Option<String>,
    /// The panel of the cycle that runs or ran last.
    pub panel: Option<String>,
    /// Its abrasions so far.
    pub pass: Option<u8>,
    /// Seconds of the film that is under way.
    pub film_s: Option<f64>,
    /// Waypoints executed of the path that is under way.
    pub waypoint: Option<u32>,
    /// All of them.
    pub of: Option<u32>,
    /// The page of the last cycle, once it is written.
    pub page: Option<PathBuf>,
    /// Where the arm's axes stand, degrees, while it stands and the link to it lives.
    #[serde(default)]
    pub axes_deg: Option<[f64; 6]>,
    /// The robot's last epoch.
    pub epoch: Option<u32>,
    /// The cycle that runs, or ran last since the service started.
    pub cycle_id: Option<i64>,
    /// Its verdict, once it has one.
    pub verdict: Option<Verdict>,
    /// Its recording, where it has one.
    pub recording: Option<Recorded>,
    /// What was done, where the state does not say it.
    pub done: Option<String>,
    /// Why it was refused, or why the cell is in this state.
    pub reasons: Vec<Reason>,
}

impl Reply {
    /// An answer of which the loop knows nothing.
    pub fn refused(answer: Exit, reasons: Vec<Reason>) -> Self {
        Reply {
            answer,
            state: None,
            phase: None,
            panel: None,
            pass: None,
            film_s: None,
            waypoint: None,
            of: None,
            page: None,
            axes_deg: None,
            epoch: None,
            cycle_id: None,
            verdict: None,
            recording: None,
            done: None,
            reasons,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn each_wish_reads_back() {
        let part =
            PartNames { serial: Some("SN \"7\"".to_owned()), order: None, operator: Some("Ännä".to_owned()) };
        let start = |record| {
            let (recipe, text) = ("panel.toml".to_owned(), "panel = \"a\\b\"\n".to_owned());
            Wish::Start { recipe, text, record, part: Some(part.clone()) }
        };
        let file = RecordIn::File("/var/cycle 7.mcap".into());
        for wish in [
            start(None),
            start(Some(RecordIn::Store)),
            start(Some(file)),
            Wish::State {},
            Wish::Unhold { dried: true },
            Wish::Abort {},
            Wish::Shoot { shot: ShotWish::Scan },
            Wish::Shoot { shot: ShotWish::Film { pictures_per_second: 2.5 } },
        ] {
            let line = format!("{}\n", serde_json::to_string(&wish).expect("JSON"));
            assert_eq!(Wish::read(line.as_bytes()), Ok(wish), "{line}");
        }
        assert_eq!(Wish::read(b"{\"ask\":\"unhold\"}\n"), Ok(Wish::Unhold { dried: false }), "wet unless said");
        assert_eq!(Wish::read(b" {\"ask\" : \"hold\"} \r\n"), Ok(Wish::Hold {}));
        let corner = Wish::read(b"{\"ask\":\"shoot\",\"shot\":\"corner\"}\n");
        assert_eq!(corner, Ok(Wish::Shoot { shot: ShotWish::Corner }));
    }

    /// Each with a word that its message must hold.
    #[test]
    fn hostile_lines_ask_for_nothing() {
        let deep = format!("{}1{}\n", "[".repeat(100_000), "]".repeat(100_000));
        let cases: [(&[u8], &str); 18] = [
            (b"", "no end"),
            (b"{\"ask\":\"abort\"}", "no end"),
            (b"\n", "EOF"),
            (b"abort\n", "expected"),
            (b"\"abort\"\n", "abort"),
            (b"{}\n", "ask"),
            (b"{\"ask\":\"jump\"}\n", "`hold`"),
            (b"{\"ask\":\"Abort\"}\n", "`abort`"),
            (b"{\"ask\":\"hold\",\"force\":true}\n", "force"),
            (b"{\"ask\":\"hold\",\"ask\":\"abort\"}\n", "duplicate"),
            (b"{\"ask\":\"hold\"}{\"ask\":\"abort\"}\n", "trailing"),
            (b"{\"ask\":\"unhold\",\"dried\":\"yes\"}\n", "boolean"),
            (b"{\"ask\":\"unhold\",\"dried\":1}\n", "boolean"),
            (b"{\"ask\":\"start\",\"recipe\":\"a.toml\"}\n", "text"),
            (b"{\"ask\":\"start\",\"recipe\":\"a\",\"text\":\"\",\"record\":true}\n", "invalid type"),
            (b"{\"ask\":\"start\",\"recipe\":\"a\",\"text\":\"\",\"record\":\"here\"}\n", "`store`"),
            (b"{\"ask\":\"ho\xffld\"}\n", "unicode"),
            (deep.as_bytes(), "invalid type: sequence"),
        ];
        for (line, word) in cases {
            let error = Wish::read(line).expect_err("refused").to_string();
            assert!(error.contains(word), "{}: {error}", String::from_utf8_lossy(&line[..line.len().min(60)]));
        }
        let long = format!("{{\"ask\":\"start\",\"recipe\":\"a\",\"text\":\"{}\"}}\n", "x".repeat(MOST_BYTES));
        assert_eq!(Wish::read(long.as_bytes()), Err(ProtocolError::TooLong { most: MOST_BYTES }));
    }

    proptest! {
        /// Whatever comes, it is read or refused; a cut line is refused.
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200), cut in 0_usize..28) {
            let _ = Wish::read(&bytes);
            let line = b"{\"ask\":\"unhold\",\"dried\":true}\n";
            prop_assert!(Wish::read(&line[..cut]).is_err());
        }
    }
}
