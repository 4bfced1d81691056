use super::*;
use crate::eki::fixture::{ACK, STATE};
use proptest::prelude::*;

/// Cuts a stream that arrives in one piece; returns the documents and the final error.
fn cut(stream: &[u8]) -> (Vec<String>, Option<FrameError>) {
    cut_at(stream, &[])
}

/// Cuts a stream that arrives in pieces, divided at these positions.
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
fn documents_back_to_back_are_distinguished() {
    let quoted = "<a b='>\"/>' c=\">'\"><d/><e></e></a>";
    let stream = format!("\u{feff}<?xml version=\"1.0\"?>\r\n{ACK}{STATE}\0 {ACK}\n\0{quoted}<f/>");
    let (documents, error) = cut(stream.as_bytes());
    assert_eq!(documents, [ACK, STATE, ACK, quoted, "<f/>"]);
    assert_eq!(error, None);
}

/// A stream with all kinds of content, divided at every single position, and at every pair of positions in its first
/// part.
#[test]
fn no_cut_matters() {
    let stream = format!("\u{feff}<?xml v='1'?>{ACK}\0\n<a b='>'/><c> <d e=\"'/\" ></d >\n</c>{STATE}{ACK}<!x>");
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
fn what_no_controller_sends_breaks_the_stream_where_it_is() {
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

/// 8192 bytes are one document, one more is too long; eight levels are allowed, nine are not.
#[test]
fn size_and_depth_are_bounded() {
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
fn an_error_stays_and_what_came_before_it_is_kept() {
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
    fn any_cut_of_any_stream_gives_the_same(
        pieces in prop::collection::vec(0..PIECES.len(), 0..40),
        places in prop::collection::vec(0.0..1.0f64, 0..8),
    ) {
        let stream: Vec<u8> = pieces.iter().flat_map(|&piece| PIECES[piece]).copied().collect();
        let mut cuts: Vec<usize> = places.iter().map(|place| (place * stream.len() as f64) as usize).collect();
        cuts.sort_unstable();
        prop_assert_eq!(cut_at(&stream, &cuts), cut(&stream));
    }
}
