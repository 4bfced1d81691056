//! Divides a stream of bytes into XML documents: KUKA's channels have neither length nor delimiter.
//!
//! A document ends where the nesting depth of the tags returns to zero outside of quotes. Between documents, white
//! space, NUL, a byte order mark and a prolog (`<?…?>`) are skipped. The result does not depend on how the stream is
//! divided into reads.

use super::channel_file::EkiFault;

/// Divides a stream of bytes into documents.
#[derive(Debug)]
pub(super) struct Framer {
    buffer: Vec<u8>,
    /// The start of the current document in `buffer`; the bytes before it were returned.
    start: usize,
    /// Number of bytes in `buffer` that were searched.
    searched: usize,
    place: ParserState,
    depth: usize,
    /// The position of the first byte inside the open tag.
    tag_start: usize,
    /// Maximum number of bytes of an incomplete document.
    limit_bytes: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum ParserState {
    Between,
    Text,
    Tag,
    Quoted(u8),
    Prolog,
}

impl Framer {
    pub(super) fn new(limit_bytes: usize) -> Self {
        let (start, seen, depth, tag_start) = (0, 0, 0, 0);
        Framer {
            buffer: Vec::new(),
            start,
            searched: seen,
            place: ParserState::Between,
            depth,
            tag_start,
            limit_bytes,
        }
    }

    pub(super) fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.start);
        self.searched -= self.start;
        self.tag_start = self.tag_start.saturating_sub(self.start);
        self.start = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// Skips bytes that have no meaning in the current state of the parser.
    fn skip_bytes(&mut self) {
        let rest = &self.buffer[self.searched..];
        let plain = match self.place {
            ParserState::Text => rest.iter().position(|&byte| byte == b'<'),
            ParserState::Quoted(quote) => rest.iter().position(|&byte| byte == quote),
            ParserState::Tag if self.searched > self.tag_start => {
                rest.iter().position(|byte| matches!(byte, b'"' | b'\'' | b'>'))
            }
            ParserState::Tag | ParserState::Between | ParserState::Prolog => Some(0),
        };
        self.searched += plain.unwrap_or(rest.len());
    }

    /// Returns the next complete document, if there is one.
    pub(super) fn next(&mut self) -> Result<Option<Vec<u8>>, EkiFault> {
        loop {
            self.skip_bytes();
            let at = self.searched;
            let Some(&byte) = self.buffer.get(at) else { break };
            self.searched += 1;
            match self.place {
                ParserState::Between => self.read_between(byte, at)?,
                ParserState::Text if byte == b'<' => self.open_tag(),
                ParserState::Tag if self.searched - 1 == self.tag_start && byte == b'!' => {
                    return Err(EkiFault::Malformed);
                }
                ParserState::Tag if self.searched - 1 == self.tag_start && byte == b'?' => {
                    self.place = ParserState::Prolog
                }
                ParserState::Tag if byte == b'"' || byte == b'\'' => self.place = ParserState::Quoted(byte),
                ParserState::Tag if byte == b'>' => {
                    if self.close_tag(at)? {
                        return Ok(Some(self.take_document()));
                    }
                }
                ParserState::Quoted(quote) if byte == quote => self.place = ParserState::Tag,
                ParserState::Prolog if byte == b'>' && self.buffer[at - 1] == b'?' => self.finish_prolog(),
                ParserState::Text | ParserState::Tag | ParserState::Quoted(_) | ParserState::Prolog => {}
            }
        }
        if self.buffer.len() - self.start > self.limit_bytes { Err(EkiFault::TooLong) } else { Ok(None) }
    }

    fn read_between(&mut self, byte: u8, at: usize) -> Result<(), EkiFault> {
        match byte {
            b'<' => {
                self.start = at;
                self.open_tag();
                Ok(())
            }
            b' ' | b'\t' | b'\r' | b'\n' | 0 | 0xEF | 0xBB | 0xBF => Ok(()),
            _ => Err(EkiFault::Malformed),
        }
    }

    fn open_tag(&mut self) {
        self.place = ParserState::Tag;
        self.tag_start = self.searched;
    }

    /// Processes the end of a tag (`>`); returns true if it also ends the document.
    fn close_tag(&mut self, at: usize) -> Result<bool, EkiFault> {
        let inside = &self.buffer[self.tag_start..at];
        match (inside.first(), inside.last()) {
            (None, _) => return Err(EkiFault::Malformed),
            (Some(b'/'), _) => self.depth = self.depth.checked_sub(1).ok_or(EkiFault::Malformed)?,
            (_, Some(b'/')) => {}
            _ => self.depth += 1,
        }
        self.place = if self.depth == 0 { ParserState::Between } else { ParserState::Text };
        Ok(self.depth == 0)
    }

    fn finish_prolog(&mut self) {
        self.place = if self.depth == 0 { ParserState::Between } else { ParserState::Text };
    }

    fn take_document(&mut self) -> Vec<u8> {
        let document = self.buffer[self.start..self.searched].to_vec();
        self.start = self.searched;
        document
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn documents(pieces: &[&[u8]]) -> Result<Vec<String>, EkiFault> {
        let (mut framer, mut found) = (Framer::new(1000), Vec::new());
        for piece in pieces {
            framer.push(piece);
            while let Some(document) = framer.next()? {
                found.push(String::from_utf8(document).expect("text"));
            }
        }
        Ok(found)
    }

    const STREAM: &str = "\u{feff}<?xml version=\"1.0\"?>\r\n<A x=\"/>\"/><B><C y='<'></C> t </B>\0\n<D></D><E>";

    #[test]
    fn documents_end_at_depth_zero_outside_of_quotes() {
        let expected = ["<A x=\"/>\"/>", "<B><C y='<'></C> t </B>", "<D></D>"];
        assert_eq!(documents(&[STREAM.as_bytes()]).expect("framed"), expected);
    }

    #[test]
    fn bytes_that_are_no_document_are_refused() {
        for wrong in ["x", "</A>", "<>", "<!DOCTYPE a><a/>", "<A></A></A>", "<A><!-- --></A>"] {
            assert_eq!(documents(&[wrong.as_bytes()]), Err(EkiFault::Malformed), "{wrong}");
        }
        let endless = format!("<A x=\"{}", "y".repeat(1000));
        assert_eq!(documents(&[endless.as_bytes()]), Err(EkiFault::TooLong));
    }

    proptest! {
        #[test]
        fn documents_are_the_same_for_every_cut_of_the_stream(cuts in prop::collection::vec(0..STREAM.len(), 0..8)) {
            let mut cuts = cuts;
            cuts.extend([0, STREAM.len()]);
            cuts.sort_unstable();
            let pieces: Vec<&[u8]> = cuts.windows(2).map(|cut| &STREAM.as_bytes()[cut[0]..cut[1]]).collect();
            prop_assert_eq!(documents(&pieces), documents(&[STREAM.as_bytes()]));
        }
    }
}
