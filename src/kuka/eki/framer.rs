//! Finds the XML documents in a stream of bytes. The result does not depend on how the stream is divided into reads.
//!
//! EthernetKRL sends documents one after another, without length or delimiter; one read may contain half a document or
//! three. A document ends where the nesting depth of its tags returns to zero, counted byte by byte and outside quotes.
//! Between documents, white space, NUL, byte order marks and XML prologs are skipped. A controller never sends a
//! document type, comments, entities, processing instructions, characters other than printable ASCII, or more than
//! [`MAX_DOCUMENT_BYTES`]. After one of these the framer accepts nothing more: the stream has no mark by which to find
//! the next document, so a new connection is needed.
//!
//! The framer does not check names or values, nor whether start and end tags match: `schema` checks them.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Maximum size of a document with its prolog, bytes.
pub const MAX_DOCUMENT_BYTES: usize = 8 * 1024;
/// Maximum nesting depth; the documents of this protocol have two levels.
const MAX_DEPTH: usize = 8;

/// The reason why a stream cannot be divided into documents. `at` is the byte's position in the stream; the first byte
/// is 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum FrameError {
    /// There is a text or an invalid byte between two documents.
    #[error("byte {at}: found {byte:#04x} between two documents; only '<' is valid there")]
    Stray {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
        /// The byte that is not valid here.
        byte: u8,
    },
    /// A control character or a byte that is not ASCII.
    #[error("byte {at}: {byte:#04x} is not a printable ASCII character")]
    Byte {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
        /// The byte that is not valid here.
        byte: u8,
    },
    /// A document type, a comment or CDATA.
    #[error("byte {at}: a document type, comment or CDATA, which no controller sends")]
    Declaration {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
    },
    /// A processing instruction other than a prolog before a document.
    #[error("byte {at}: a processing instruction, which no controller sends")]
    Instruction {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
    },
    /// An entity, or an ampersand without an entity.
    #[error("byte {at}: an entity, which no controller sends")]
    Entity {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
    },
    /// An invalid tag.
    #[error("byte {at}: {byte:#04x} is not valid in a tag")]
    Tag {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
        /// The byte that is not valid here.
        byte: u8,
    },
    /// An end tag without a start tag.
    #[error("byte {at}: an end tag without its start tag")]
    Unopened {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
    },
    /// Nested too deep.
    #[error("byte {at}: nested deeper than {limit} tags")]
    TooDeep {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
        /// The maximum nesting depth.
        limit: usize,
    },
    /// A document that is longer than any valid message.
    #[error("byte {at}: a document of more than {limit} bytes")]
    TooLong {
        /// Position of the error in the stream, bytes from 0.
        at: u64,
        /// The maximum length of a document, bytes.
        limit: usize,
    },
}

/// The position of the scanner in the syntax of the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ScanState {
    /// Outside of tags: between two documents, or between two tags of one document.
    Outside,
    /// In a byte order mark, after this number of its three bytes.
    Mark(usize),
    /// Behind `<`.
    Opened,
    /// In the name or the attributes of a start tag. `slash` is true if the previous byte was `/`.
    Start { slash: bool },
    /// In an attribute's value, which ends at this quote character.
    Quoted(u8),
    /// After an attribute's value; white space or the end of the tag must follow.
    Valued,
    /// In an end tag. `named` is true if its name has begun.
    End { named: bool },
    /// In an instruction `<?…`. `question` is true if the previous byte was `?`.
    Prolog { question: bool },
}

const BYTE_ORDER_MARK: [u8; 3] = [0xEF, 0xBB, 0xBF];
const PROLOG: &[u8] = b"<?xml";

/// Divides one stream of bytes into XML documents.
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
    /// Processes the next bytes of the stream. Bytes after an error are ignored.
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

    /// Returns how many of the first bytes are ordinary content: such bytes extend the document and do not change the
    /// scanner's state.
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

    /// Returns the next complete document, or `None` if more bytes are needed. Documents that were complete before an
    /// error are returned first.
    ///
    /// # Errors
    /// If the stream contains data that no controller sends; every later call returns the same error.
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
            (ScanState::Start { slash: true }, b'>') => self.end_element(self.depth),
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
            (ScanState::End { named: true }, b'>') => self.end_element(self.depth - 1),
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
    fn end_element(&mut self, depth: usize) -> ScanState {
        self.depth = depth;
        if depth == 0 {
            // Only ASCII bytes reach this point, so nothing is replaced.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eki::fixture::{ACK, STATE};
    use proptest::prelude::*;

    /// Divides a stream that arrives in one read. Returns the documents and the error, if any.
    fn cut(stream: &[u8]) -> (Vec<String>, Option<FrameError>) {
        cut_at(stream, &[])
    }

    /// Divides a stream that arrives in several reads; `cuts` are the positions at which the reads end.
    fn cut_at(stream: &[u8], cuts: &[usize]) -> (Vec<String>, Option<FrameError>) {
        let mut framer = Framer::default();
        let (mut documents, mut from) = (Vec::new(), 0);
        for to in cuts.iter().copied().chain([stream.len()]) {
            framer.push(&stream[from..to]);
            from = to;
            loop {
                match framer.next_document() {
                    Ok(Some(document)) => documents.push(document),
                    Ok(None) => break,
                    Err(error) => return (documents, Some(error)),
                }
            }
        }
        (documents, None)
    }

    #[test]
    fn documents_without_delimiter_are_separated() {
        let quoted = "<a b='>\"/>' c=\">'\"><d/><e></e></a>";
        let stream = format!("\u{feff}<?xml version=\"1.0\"?>\r\n{ACK}{STATE}\0 {ACK}\n\0{quoted}<f/>");
        let (documents, error) = cut(stream.as_bytes());
        assert_eq!(documents, [ACK, STATE, ACK, quoted, "<f/>"]);
        assert_eq!(error, None);
    }

    /// Divides a stream with all kinds of content at every single position, and at every pair of positions in its first
    /// part. The documents are always the same.
    #[test]
    fn the_division_into_reads_does_not_matter() {
        let stream =
            format!("\u{feff}<?xml v='1'?>{ACK}\0\n<a b='>'/><c> <d e=\"'/\" ></d >\n</c>{STATE}{ACK}<!x>");
        let stream = stream.as_bytes();
        let whole = cut(stream);
        assert_eq!(whole.0.len(), 5);
        assert_eq!(whole.1, Some(FrameError::Declaration { at: stream.len() as u64 - 3 }));
        for first in 0..=stream.len() {
            assert_eq!(cut_at(stream, &[first]), whole, "cut at {first}");
        }
        for first in 0..120 {
            for second in first..120 {
                assert_eq!(cut_at(stream, &[first, second]), whole, "cut at {first} and {second}");
            }
        }
    }

    #[test]
    fn content_that_no_controller_sends_is_an_error_with_its_position() {
        let cases: [(&[u8], FrameError); 24] = [
            (b"x", FrameError::Stray { at: 0, byte: b'x' }),
            (b"<a/>x", FrameError::Stray { at: 4, byte: b'x' }),
            (b"\xEF\xBBx", FrameError::Stray { at: 2, byte: b'x' }),
            (b"<!DOCTYPE a>", FrameError::Declaration { at: 1 }),
            (b"<!-- a -->", FrameError::Declaration { at: 1 }),
            (b"<a><![CDATA[b]]></a>", FrameError::Declaration { at: 4 }),
            (b"<a><!-- b --></a>", FrameError::Declaration { at: 4 }),
            (b"<?php x?>", FrameError::Instruction { at: 8 }),
            (b"<?xmlx?>", FrameError::Instruction { at: 7 }),
            (b"<a><?xml?></a>", FrameError::Instruction { at: 4 }),
            (b"<a b=\"&lt;\"/>", FrameError::Entity { at: 6 }),
            (b"<a>&x;</a>", FrameError::Entity { at: 3 }),
            (b"<a>\0</a>", FrameError::Byte { at: 3, byte: 0 }),
            (b"<a b=\"\x01\"/>", FrameError::Byte { at: 6, byte: 1 }),
            (b"<a b=\"\xC3\xA4\"/>", FrameError::Byte { at: 6, byte: 0xC3 }),
            (b"<a\xEF\xBB\xBF/>", FrameError::Byte { at: 2, byte: 0xEF }),
            (b"< a/>", FrameError::Tag { at: 1, byte: b' ' }),
            (b"<1/>", FrameError::Tag { at: 1, byte: b'1' }),
            (b"<a/ >", FrameError::Tag { at: 3, byte: b' ' }),
            (b"<a b=\"<\"/>", FrameError::Tag { at: 6, byte: b'<' }),
            (b"<a b=\"1\"c=\"2\"/>", FrameError::Tag { at: 8, byte: b'c' }),
            (b"<a b=\"1\"\"2\"/>", FrameError::Tag { at: 8, byte: b'"' }),
            (b"<a></>", FrameError::Tag { at: 5, byte: b'>' }),
            (b"</a>", FrameError::Unopened { at: 1 }),
        ];
        for (stream, error) in cases {
            let text = String::from_utf8_lossy(stream);
            assert_eq!(cut(stream).1, Some(error), "{text}");
            let every_byte: Vec<usize> = (0..stream.len()).collect();
            assert_eq!(cut_at(stream, &every_byte).1, Some(error), "{text}, byte by byte");
        }
    }

    /// A document of 8192 bytes is accepted, and one of 8193 bytes is too long. Eight nesting levels are accepted, nine
    /// are not.
    #[test]
    fn size_and_depth_are_limited() {
        let padded = |bytes: usize| format!("<a b=\"{}\"/>", "x".repeat(bytes - 9));
        assert_eq!(cut(padded(MAX_DOCUMENT_BYTES).as_bytes()).0.len(), 1);
        let limit = MAX_DOCUMENT_BYTES;
        let long = cut(padded(limit + 1).as_bytes());
        assert_eq!(long, (vec![], Some(FrameError::TooLong { at: limit as u64, limit })));
        let nested = |depth: usize| "<a>".repeat(depth) + &"</a>".repeat(depth);
        assert_eq!(cut(nested(8).as_bytes()).0.len(), 1);
        assert_eq!(cut(nested(9).as_bytes()).1, Some(FrameError::TooDeep { at: 26, limit: 8 }));
    }

    #[test]
    fn documents_before_an_error_are_returned_and_the_error_persists() {
        let mut framer = Framer::default();
        framer.push(format!("{ACK}x{ACK}").as_bytes());
        assert_eq!(framer.next_document(), Ok(Some(ACK.to_owned())));
        let error = Err(FrameError::Stray { at: ACK.len() as u64, byte: b'x' });
        assert_eq!(framer.next_document(), error);
        framer.push(ACK.as_bytes());
        assert_eq!(framer.next_document(), error);
    }

    /// Pieces of streams, valid and invalid, so that a random sequence of them reaches every state of the scan.
    const PIECES: [&[u8]; 24] = [
        b"<a>",
        b"</a>",
        b"<b c=\"1\">",
        b"</b>",
        b"<d e='\"'/>",
        b"<?xml?>",
        b"<?",
        b"?>",
        b"<",
        b">",
        b"/",
        b"\"",
        b"'",
        b" ",
        b"\0",
        b"\n",
        b"x",
        b"&",
        b"!",
        b"\xEF\xBB\xBF",
        b"\xEF",
        b"<a/>",
        b"</a >",
        b"\xFF",
    ];

    proptest! {
        #[test]
        fn any_division_of_any_stream_gives_the_same_documents(
            pieces in prop::collection::vec(0..PIECES.len(), 0..40),
            places in prop::collection::vec(0.0..1.0f64, 0..8),
        ) {
            let stream: Vec<u8> = pieces.iter().flat_map(|&piece| PIECES[piece]).copied().collect();
            let mut cuts: Vec<usize> = places.iter().map(|place| (place * stream.len() as f64) as usize).collect();
            cuts.sort_unstable();
            prop_assert_eq!(cut_at(&stream, &cuts), cut(&stream));
        }
    }
}
