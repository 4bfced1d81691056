//! The protocol of the service's socket: the client sends one line with a JSON object, the service replies with one
//! line with a JSON object, then the connection ends.
//!
//! ```text
//! {"ask":"unhold","dried":true,"step":17}
//! {"answer":"refused","state":"idle","phase":null,"epoch":4,"step":18,"cycle_id":null,"verdict":null,"recording":null,"reasons":[…]}
//! ```
//!
//! The protocol is strict: a line is refused if it contains an unknown word, an unknown or repeated key, or more than
//! one object, is too long, or has no line end. The refusal states what is valid, and no part of the line is executed.
//! A recipe is sent as text, so that the client needs no file that the service can read. This module does not use the
//! socket itself: see `socket`.

use super::camera_lease::ShotRequest;
use super::request::RequestKind;
use crate::setup::StartRequest;
use panelprep_cell::cycle::Request;
use serde::{Deserialize, Serialize};

/// Maximum length of a line with its line end, bytes: that of a start, with a recipe whose characters are escaped.
pub const MAX_BYTES: usize = 256 * 1_024;
/// Maximum length of all other lines, bytes.
pub(super) const MAX_SHORT_BYTES: usize = 4 * 1_024;

/// Returns whether a line with this beginning may be as long as a start.
pub(super) fn is_long_line_allowed(beginning: &[u8]) -> bool {
    let word = b"\"start\"";
    let searched = &beginning[..beginning.len().min(MAX_SHORT_BYTES)];
    searched.windows(word.len()).any(|part| part == word)
}

/// A request as it is written on a line: its word and its parameters.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "ask", rename_all = "lowercase", deny_unknown_fields)]
enum Line {
    State {},
    Start(StartRequest),
    Hold {},
    Unhold {
        #[serde(default)]
        dried: bool,
        step: u64,
    },
    Accept {
        step: u64,
    },
    Stop {},
    Abort {},
    Clear {
        step: u64,
    },
    Reset {},
    #[serde(rename = "new-disc")]
    NewDisc {},
    Shoot {
        shot: ShotRequest,
    },
}

/// The reason why a line is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ProtocolError {
    /// The line is too long.
    #[error("the request line is longer than {most} bytes; send a shorter recipe or fewer parameters")]
    TooLong {
        /// Maximum length of a line, bytes.
        most: usize,
    },
    /// The line was not complete within the time limit.
    #[error("the request line was not complete in time; send the whole line at once")]
    Slow,
    /// The connection was closed, because too many connections were open.
    #[error(
        "connection closed: too many connections are open, and this connection was idle for the longest time; send \
         the request line at once, and try again"
    )]
    GaveWay,
    /// The line has no line end.
    #[error("the request line has no line end; end it with a line feed")]
    NoEnd,
    /// The line is not a valid request.
    #[error("not understood: {problem}")]
    NotUnderstood {
        /// The problem.
        problem: String,
    },
    /// Clients of the socket must not send this request.
    #[error("this request is not accepted through the socket; use the operator's page or `panelprep ctl`")]
    NotForClients,
}

/// Parses a request from a line with its line end.
///
/// # Errors
/// If the line is too long, has no line end, or is not exactly one valid object.
pub fn read_request(line: &[u8]) -> Result<RequestKind, ProtocolError> {
    if line.len() > MAX_BYTES {
        return Err(ProtocolError::TooLong { most: MAX_BYTES });
    }
    let Some((b'\n', object)) = line.split_last() else { return Err(ProtocolError::NoEnd) };
    let line = serde_json::from_slice(object)
        .map_err(|error| ProtocolError::NotUnderstood { problem: error.to_string() })?;
    Ok(match line {
        Line::State {} => RequestKind::State,
        Line::Start(start) => RequestKind::Start(start),
        Line::NewDisc {} => RequestKind::NewDisc,
        Line::Shoot { shot } => RequestKind::Shoot(shot),
        Line::Hold {} => RequestKind::Table(Request::Hold),
        Line::Unhold { dried, step } => RequestKind::Decided { request: Request::Unhold { dried }, step },
        Line::Accept { step } => RequestKind::Decided { request: Request::Accept, step },
        Line::Stop {} => RequestKind::Table(Request::Stop),
        Line::Abort {} => RequestKind::Table(Request::Abort),
        Line::Clear { step } => RequestKind::Decided { request: Request::Clear, step },
        Line::Reset {} => RequestKind::Table(Request::Reset),
    })
}

/// Returns the line for this request, with its line end.
///
/// # Errors
/// If clients of the socket must not send this request.
pub fn request_line(what: &RequestKind) -> Result<String, ProtocolError> {
    let line = match what {
        RequestKind::State => Line::State {},
        RequestKind::Start(start) => Line::Start(start.clone()),
        RequestKind::NewDisc => Line::NewDisc {},
        RequestKind::Shoot(shot) => Line::Shoot { shot: *shot },
        RequestKind::Table(Request::Hold) => Line::Hold {},
        RequestKind::Decided { request: Request::Unhold { dried }, step } => {
            Line::Unhold { dried: *dried, step: *step }
        }
        RequestKind::Decided { request: Request::Accept, step } => Line::Accept { step: *step },
        RequestKind::Decided { request: Request::Clear, step } => Line::Clear { step: *step },
        RequestKind::Table(Request::Stop) => Line::Stop {},
        RequestKind::Table(Request::Abort) => Line::Abort {},
        RequestKind::Table(Request::Reset) => Line::Reset {},
        RequestKind::Table(_)
        | RequestKind::Decided { .. }
        | RequestKind::Outdated { .. }
        | RequestKind::Begin(_)
        | RequestKind::Hold { .. }
        | RequestKind::Refused { .. }
        | RequestKind::Leave => return Err(ProtocolError::NotForClients),
    };
    let object = serde_json::to_string(&line)
        .map_err(|error| ProtocolError::NotUnderstood { problem: error.to_string() })?;
    Ok(object + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A request that is read and written again gives the same line, byte for byte.
    #[test]
    fn each_written_request_is_read_unchanged() {
        let start =
            r#"{"ask":"start","recipe":"panel.toml","text":"panel = \"a\\b\"\n","record":RECORD,"part":PART}"#;
        let part = r#"{"serial":"SN \"7\"","operator":"Ännä"}"#;
        let start = |record, part| start.replace("RECORD", record).replace("PART", part);
        let plain = ["state", "hold", "stop", "abort", "reset", "new-disc"];
        let plain = plain.map(|word| format!("{{\"ask\":\"{word}\"}}"));
        let others = [
            start("null", "null"),
            start("\"store\"", part),
            start("{\"file\":\"/var/cycle 7.mcap\"}", "null"),
            r#"{"ask":"unhold","dried":true,"step":17}"#.to_owned(),
            r#"{"ask":"accept","step":17}"#.to_owned(),
            r#"{"ask":"clear","step":18446744073709551615}"#.to_owned(),
            r#"{"ask":"shoot","shot":"scan"}"#.to_owned(),
            r#"{"ask":"shoot","shot":{"film":{"pictures_per_second":2.5}}}"#.to_owned(),
        ];
        for line in plain.iter().chain(&others) {
            let line = format!("{line}\n");
            let read = read_request(line.as_bytes()).expect("allowed");
            assert_eq!(request_line(&read), Ok(line));
        }
        let table = |line: &[u8]| match read_request(line) {
            Ok(RequestKind::Table(request)) => request,
            other => panic!("{other:?}"),
        };
        let wet = read_request(b"{\"ask\":\"unhold\",\"step\":3}\n");
        assert!(
            matches!(wet, Ok(RequestKind::Decided { request: Request::Unhold { dried: false }, step: 3 })),
            "wet unless said: {wet:?}"
        );
        assert_eq!(table(b" {\"ask\" : \"hold\"} \r\n"), Request::Hold);
        assert_eq!(request_line(&RequestKind::Leave), Err(ProtocolError::NotForClients));
    }

    /// Each invalid line, with a word that its error message must contain.
    #[test]
    fn invalid_lines_cause_no_request() {
        let deep = format!("{}1{}\n", "[".repeat(100_000), "]".repeat(100_000));
        let cases: [(&[u8], &str); 23] = [
            (b"", "no line end"),
            (b"{\"ask\":\"abort\"}", "no line end"),
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
            // Refused, because a decision must contain the number of the step to which it refers.
            (b"{\"ask\":\"unhold\",\"dried\":true}\n", "step"),
            (b"{\"ask\":\"accept\"}\n", "step"),
            (b"{\"ask\":\"clear\"}\n", "step"),
            (b"{\"ask\":\"clear\",\"step\":-1}\n", "u64"),
            (b"{\"ask\":\"accept\",\"step\":null}\n", "u64"),
            (b"{\"ask\":\"start\",\"recipe\":\"a.toml\"}\n", "text"),
            (b"{\"ask\":\"start\",\"recipe\":\"a\",\"text\":\"\",\"record\":true}\n", "invalid type"),
            (b"{\"ask\":\"start\",\"recipe\":\"a\",\"text\":\"\",\"record\":\"here\"}\n", "`store`"),
            (b"{\"ask\":\"ho\xffld\"}\n", "unicode"),
            (deep.as_bytes(), "invalid type: sequence"),
        ];
        for (line, word) in cases {
            let error = read_request(line).expect_err("refused").to_string();
            assert!(error.contains(word), "{}: {error}", String::from_utf8_lossy(&line[..line.len().min(60)]));
        }
        let long = format!("{{\"ask\":\"start\",\"recipe\":\"a\",\"text\":\"{}\"}}\n", "x".repeat(MAX_BYTES));
        assert!(matches!(read_request(long.as_bytes()), Err(ProtocolError::TooLong { most: MAX_BYTES })));
    }

    proptest! {
        /// Any sequence of bytes is either read or refused; an incomplete line is refused.
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200), cut in 0_usize..28) {
            let _ = read_request(&bytes);
            let line = b"{\"ask\":\"unhold\",\"step\":12345678}\n";
            prop_assert!(read_request(&line[..cut]).is_err());
        }
    }
}
