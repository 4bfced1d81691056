//! Finds the documents in a stream of bytes, however the stream is divided into reads.
//!
//! EthernetKRL sends documents back to back, without length or delimiter; one read may contain half a document or
//! three. A document ends where the depth of its tags returns to zero, counted outside quotes, byte by byte: it does
//! not matter how the stream is divided. Between documents white space, NUL, byte order marks and XML prologs are
//! skipped. Some content is never sent by a controller: a document type, comments, entities, instructions, anything
//! but printable ASCII, more than [`MAX_DOCUMENT_BYTES`]. After such content the framer accepts nothing more: the
//! stream has no mark by which to find the next document, so only a new connection can continue.
//!
//! Does not check names or values, nor whether tags match: see `schema`.

#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Longest document with its prolog.
pub const MAX_DOCUMENT_BYTES: usize = 8 * 1024;
/// Deepest nesting; the documents of this program have two levels.
const MAX_DEPTH: usize = 8;

/// The reason why a stream cannot be cut into documents. `at` counts the stream's bytes from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum FrameError {
    /// Text or invalid bytes between documents.
    #[error("byte {at}: found {byte:#04x} between two documents; only '<' is valid there")]
    Stray {
        /// The position.
        at: u64,
        /// The byte.
        byte: u8,
    },
    /// A control character or a byte that is not ASCII.
    #[error("byte {at}: {byte:#04x} is not a printable ASCII character")]
    Byte {
        /// The position.
        at: u64,
        /// The byte.
        byte: u8,
    },
    /// A document type, a comment or CDATA.
    #[error("byte {at}: a document type, comment or CDATA, which no controller sends")]
    Declaration {
        /// The position.
        at: u64,
    },
    /// A processing instruction other than a prolog before a document.
    #[error("byte {at}: a processing instruction, which no controller sends")]
    Instruction {
        /// The position.
        at: u64,
    },
    /// An entity, or a bare ampersand.
    #[error("byte {at}: an entity, which no controller sends")]
    Entity {
        /// The position.
        at: u64,
    },
    /// An invalid tag.
    #[error("byte {at}: {byte:#04x} is not valid in a tag")]
    Tag {
        /// The position.
        at: u64,
        /// The byte.
        byte: u8,
    },
    /// An end tag without a start tag.
    #[error("byte {at}: an end tag without its start tag")]
    Unopened {
        /// The position.
        at: u64,
    },
    /// Nested too deep.
    #[error("byte {at}: nested deeper than {limit} tags")]
    TooDeep {
        /// The position.
        at: u64,
        /// The largest valid depth.
        limit: usize,
    },
    /// Longer than any message.
    #[error("byte {at}: a document of more than {limit} bytes")]
    TooLong {
        /// The position.
        at: u64,
        /// The largest valid length.
        limit: usize,
    },
}

/// The state of the scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ScanState {
    /// Outside of tags: between documents or between the tags of one.
    Outside,
    /// In a byte order mark, after this many of its bytes.
    Mark(usize),
    /// Behind `<`.
    Opened,
    /// In the name or the attributes of a start tag; whether the last byte was `/`.
    Start { slash: bool },
    /// In an attribute's value, until this quote.
    Quoted(u8),
    /// After an attribute's value: white space or the end of the tag follows.
    Valued,
    /// In an end tag; whether a byte of its name was seen.
    End { named: bool },
    /// In `<?…`; whether the last byte was `?`.
    Prolog { question: bool },
}

const BYTE_ORDER_MARK: [u8; 3] = [0xEF, 0xBB, 0xBF];
const PROLOG: &[u8] = b"<?xml";

/// Cuts one stream into documents.
#[derive(Debug, Clone)]
pub struct Framer {
    state: ScanState,
    depth: usize,
    document: Vec<u8>,
    at: u64,
    ready: VecDeque<String>,
    broken: Option<FrameError>,
}

impl Default for Framer {
    fn default() -> Self {
        Framer {
            state: ScanState::Outside,
            depth: 0,
            document: Vec::new(),
            at: 0,
            ready: VecDeque::new(),
            broken: None,
        }
    }
}

impl Framer {
    /// Accepts the stream's next bytes. Bytes after an error are ignored.
    pub fn push(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while let (Some((&byte, behind)), None) = (rest.split_first(), self.broken) {
            let plain = self.content_length(rest);
            if plain > 0 {
                self.document.extend_from_slice(&rest[..plain]);
                self.at += plain as u64;
                rest = &rest[plain..];
                continue;
            }
            match self.step(byte) {
                Ok(()) => self.at += 1,
                Err(error) => self.broken = Some(error),
            }
            rest = behind;
        }
    }

    /// Returns the number of leading bytes that are ordinary content: they extend the document and do not change the
    /// state of the scan.
    fn content_length(&self, bytes: &[u8]) -> usize {
        match self.state {
            ScanState::Outside if self.depth > 0 => {}
            ScanState::Start { slash: false } | ScanState::Quoted(_) => {}
            _ => return 0,
        }
        let room = MAX_DOCUMENT_BYTES - self.document.len();
        let is_plain = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b' ' | b'.' | b'-' | b'=');
        bytes.iter().take(room).take_while(|byte| is_plain(byte)).count()
    }

    /// Returns the next complete document; `None` while more bytes are needed. Documents that were complete before an
    /// error are returned first.
    ///
    /// # Errors
    /// If the stream cannot be divided any further; every later call returns the same error.
    pub fn next_document(&mut self) -> Result<Option<String>, FrameError> {
        match (self.ready.pop_front(), self.broken) {
            (Some(document), _) => Ok(Some(document)),
            (None, Some(error)) => Err(error),
            (None, None) => Ok(None),
        }
    }

    /// Returns true if a document has begun and has not ended.
    pub fn is_inside(&self) -> bool {
        self.broken.is_none() && !(self.state == ScanState::Outside && self.document.is_empty())
    }

    fn step(&mut self, byte: u8) -> Result<(), FrameError> {
        let at = self.at;
        let between = self.depth == 0 && self.document.is_empty();
        match self.state {
            ScanState::Outside if between && matches!(byte, b' ' | b'\t' | b'\r' | b'\n' | 0) => return Ok(()),
            ScanState::Outside if between && byte == BYTE_ORDER_MARK[0] => self.state = ScanState::Mark(1),
            ScanState::Mark(seen) if byte == BYTE_ORDER_MARK[seen] => {
                self.state =
                    if seen + 1 == BYTE_ORDER_MARK.len() { ScanState::Outside } else { ScanState::Mark(seen + 1) };
            }
            ScanState::Mark(_) => return Err(FrameError::Stray { at, byte }),
            ScanState::Outside if between && byte != b'<' => return Err(FrameError::Stray { at, byte }),
            _ => return self.process_byte(byte),
        }
        Ok(())
    }

    /// Processes a byte of a document or a prolog.
    fn process_byte(&mut self, byte: u8) -> Result<(), FrameError> {
        let at = self.at;
        if !matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n') {
            return Err(FrameError::Byte { at, byte });
        }
        if self.document.len() == MAX_DOCUMENT_BYTES {
            return Err(FrameError::TooLong { at, limit: MAX_DOCUMENT_BYTES });
        }
        if byte == b'&' {
            return Err(FrameError::Entity { at });
        }
        self.document.push(byte);
        let starts_name = byte.is_ascii_alphabetic() || byte == b'_';
        self.state = match (self.state, byte) {
            (ScanState::Outside, b'<') => ScanState::Opened,
            (ScanState::Opened, b'!') => return Err(FrameError::Declaration { at }),
            (ScanState::Opened, b'?') if self.depth == 0 => ScanState::Prolog { question: false },
            (ScanState::Opened, b'?') => return Err(FrameError::Instruction { at }),
            (ScanState::Opened, b'/') if self.depth == 0 => return Err(FrameError::Unopened { at }),
            (ScanState::Opened, b'/') => ScanState::End { named: false },
            (ScanState::Opened, _) if starts_name => ScanState::Start { slash: false },
            (ScanState::Start { slash: true }, b'>') => self.closed(self.depth),
            (ScanState::Start { .. } | ScanState::Valued, b'>') if self.depth == MAX_DEPTH => {
                return Err(FrameError::TooDeep { at, limit: MAX_DEPTH });
            }
            (ScanState::Start { .. } | ScanState::Valued, b'>') => {
                self.depth += 1;
                ScanState::Outside
            }
            (ScanState::Start { slash: false } | ScanState::Valued, b'/') => ScanState::Start { slash: true },
            (ScanState::Valued, b' ' | b'\t' | b'\r' | b'\n') => ScanState::Start { slash: false },
            (ScanState::Valued, _) => return Err(FrameError::Tag { at, byte }),
            (ScanState::Start { slash: false }, quote @ (b'"' | b'\'')) => ScanState::Quoted(quote),
            (ScanState::Start { slash: true }, _)
            | (ScanState::Opened | ScanState::Start { .. } | ScanState::Quoted(_), b'<') => {
                return Err(FrameError::Tag { at, byte });
            }
            (ScanState::Opened, _) => return Err(FrameError::Tag { at, byte }),
            (ScanState::Quoted(quote), _) if byte == quote => ScanState::Valued,
            (ScanState::End { named: true }, b'>') => self.closed(self.depth - 1),
            (ScanState::End { named: false }, _) if !starts_name => return Err(FrameError::Tag { at, byte }),
            (ScanState::End { .. }, b'<' | b'/' | b'"' | b'\'') => return Err(FrameError::Tag { at, byte }),
            (ScanState::End { .. }, _) => ScanState::End { named: true },
            (ScanState::Prolog { question: true }, b'>') => return self.prolog_ended(),
            (ScanState::Prolog { .. }, _) => ScanState::Prolog { question: byte == b'?' },
            (state, _) => state,
        };
        Ok(())
    }

    /// Processes the end of an element, after which the nesting depth is `depth`; at zero the document is complete.
    fn closed(&mut self, depth: usize) -> ScanState {
        self.depth = depth;
        if depth == 0 {
            // Every byte was checked to be ASCII.
            self.ready.push_back(String::from_utf8_lossy(&self.document).into_owned());
            self.document.clear();
        }
        ScanState::Outside
    }

    fn prolog_ended(&mut self) -> Result<(), FrameError> {
        let named = self.document.strip_prefix(PROLOG).and_then(|rest| rest.first());
        if !named.is_some_and(|&next| next == b'?' || next.is_ascii_whitespace()) {
            return Err(FrameError::Instruction { at: self.at });
        }
        self.document.clear();
        self.state = ScanState::Outside;
        Ok(())
    }
}
