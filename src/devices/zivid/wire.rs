//! The frames between daemon and worker, and the errors of a frame. A frame consists of an opening, a head in JSON and
//! a payload, each followed by a checksum.
//!
//! ```text
//! opening, 24 bytes  "PPZV" · version u16 · kind u16 · sequence u32 · head's length u32 · payload's length u64
//! checksum           CRC-32 of all bytes of the frame so far, without earlier checksums; u32
//! head               JSON
//! checksum
//! payload            planes of numbers, one after the other
//! checksum
//! ```
//! All numbers are little endian. A length is used only after its checksum was verified, and the head is verified
//! before memory for the payload is allocated. Each checksum includes the previous parts, so that parts of different
//! frames cannot be combined. CRC-32 detects every change of up to 32 consecutive bits; it protects against a faulty
//! peer, not against a malicious one. A frame that is truncated, changed or of another protocol is an error, after
//! which the stream cannot be used any more: it has no marker at which reading could start again.

use crc32fast::Hasher;
use std::io::{ErrorKind, Read, Write};
use strum::VariantArray;

const OPENING_BYTES: usize = 24;

/// Maximum size of a head, bytes. The longest heads contain settings in YAML.
pub const MAX_HEAD_BYTES: usize = 1 << 20;

/// Maximum size of a payload, bytes: a 3D scan of 8 million points.
pub const MAX_PAYLOAD_BYTES: usize = 160 << 20;

/// Size of the pieces in which a payload is sent and its checksum is computed, bytes, so that both ends work at the
/// same time.
const PIECE_BYTES: usize = 1 << 18;

const MAGIC: [u8; 4] = *b"PPZV";

/// The version of this protocol: of the frames and of their messages.
pub const VERSION: u16 = 2;

/// The kind of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
pub enum FrameKind {
    /// The first message of the worker, sent when it starts.
    Hello,
    /// A request of the daemon.
    Request,
    /// A reply of the worker; there is one for each request.
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

/// The reason why a frame is refused or was not received.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The stream ended between two frames.
    #[error("the other process has closed the connection")]
    Ended,
    /// The stream ended within a frame.
    #[error("the connection ended within the {part} of a frame")]
    Cut {
        /// The part of the frame in which the stream ended.
        part: FramePart,
    },
    /// The frame, or the rest of it, did not arrive in time.
    #[error("the rest of the {part} of a frame did not arrive in time")]
    Stalled {
        /// The part of the frame that did not arrive.
        part: FramePart,
    },
    /// The first bytes are not those of a frame.
    #[error("a frame begins with {found:02x?}, expected {MAGIC:02x?}")]
    NotAFrame {
        /// The first bytes.
        found: [u8; 4],
    },
    /// The other program uses another version of the protocol.
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
    /// The frame is of another kind than expected.
    #[error("found a frame of kind {found}, expected kind {}, {}", allowed.number(), allowed.keyword())]
    Kind {
        /// Kind found.
        found: u16,
        /// The expected kind.
        allowed: FrameKind,
    },
    /// The frame is a reply to another request.
    #[error("found a response to request {found}, but the last request was {allowed}")]
    Sequence {
        /// Number found.
        found: u32,
        /// The expected number.
        allowed: u32,
    },
    /// A part of the frame is longer than its maximum.
    #[error("the {part} of a frame has {found} bytes (limit {allowed} bytes)")]
    TooLong {
        /// The part of the frame that is too long.
        part: FramePart,
        /// Length found, bytes.
        found: u64,
        /// Maximum length of the part, bytes.
        allowed: u64,
    },
    /// The payload does not have the size that follows from the head.
    #[error("a frame's payload has {found} bytes, but its head states {expected} bytes")]
    PayloadSize {
        /// Size of the payload according to the opening, bytes.
        found: u64,
        /// Size of the payload according to the head, bytes.
        expected: u64,
    },
    /// The head is not a valid message.
    #[error("the head of a frame cannot be read: {0}")]
    Head(#[from] serde_json::Error),
    /// The operating system reported an error of the connection.
    #[error("the connection failed: {0}")]
    Io(std::io::Error),
}

/// A part of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FramePart {
    /// The first bytes of the frame.
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

/// Writes a frame; the planes of the payload follow one another.
///
/// # Errors
/// If the stream accepts no more data, or a part is longer than its maximum; in the second case nothing is written.
pub fn write(
    stream: &mut impl Write,
    (kind, sequence): (FrameKind, u32),
    head: &[u8],
    planes: &[&[u8]],
) -> Result<(), WireError> {
    let payload_bytes: usize = planes.iter().map(|plane| plane.len()).sum();
    check_length(FramePart::Head, head.len() as u64, MAX_HEAD_BYTES)?;
    check_length(FramePart::Payload, payload_bytes as u64, MAX_PAYLOAD_BYTES)?;
    let mut opening = Vec::with_capacity(OPENING_BYTES + head.len() + 8);
    opening.extend(MAGIC);
    opening.extend(VERSION.to_le_bytes());
    opening.extend(kind.number().to_le_bytes());
    opening.extend(sequence.to_le_bytes());
    opening.extend((head.len() as u32).to_le_bytes());
    opening.extend((payload_bytes as u64).to_le_bytes());
    let mut sum = Hasher::new();
    sum.update(&opening);
    opening.extend(checksum_so_far(&sum).to_le_bytes());
    sum.update(head);
    opening.extend(head);
    opening.extend(checksum_so_far(&sum).to_le_bytes());
    stream.write_all(&opening).map_err(WireError::Io)?;
    for piece in planes.iter().flat_map(|plane| plane.chunks(PIECE_BYTES)) {
        sum.update(piece);
        stream.write_all(piece).map_err(WireError::Io)?;
    }
    stream.write_all(&sum.finalize().to_le_bytes()).map_err(WireError::Io)?;
    stream.flush().map_err(WireError::Io)
}

fn checksum_so_far(sum: &Hasher) -> u32 {
    sum.clone().finalize()
}

fn check_length(part: FramePart, found: u64, most: usize) -> Result<(), WireError> {
    let allowed = most as u64;
    if found <= allowed { Ok(()) } else { Err(WireError::TooLong { part, found, allowed }) }
}

/// A frame whose opening and head were read; the payload was not read yet.
#[derive(Debug)]
pub struct OpenedFrame {
    /// The sequence number; a reply has the number of its request.
    pub sequence: u32,
    /// The head of the frame, JSON.
    pub head: Vec<u8>,
    payload_bytes: u64,
    sum: Hasher,
}

/// Reads a frame of this kind up to its payload.
///
/// # Errors
/// If the stream ends, or the received data are not a valid frame of this kind.
pub fn open(stream: &mut impl Read, allowed_kind: FrameKind) -> Result<OpenedFrame, WireError> {
    let mut opening = [0; OPENING_BYTES];
    read_exact_bytes(stream, &mut opening[..1], FramePart::Opening).map_err(|error| match error {
        WireError::Cut { .. } => WireError::Ended,
        other => other,
    })?;
    read_exact_bytes(stream, &mut opening[1..], FramePart::Opening)?;
    let [m0, m1, m2, m3, v0, v1, k0, k1, s0, s1, s2, s3, h0, h1, h2, h3, payload @ ..] = opening;
    if [m0, m1, m2, m3] != MAGIC {
        return Err(WireError::NotAFrame { found: [m0, m1, m2, m3] });
    }
    // The version is checked before the checksum, because another version may use another checksum.
    let version = u16::from_le_bytes([v0, v1]);
    if version != VERSION {
        return Err(WireError::Version { found: version });
    }
    let mut sum = Hasher::new();
    sum.update(&opening);
    check_checksum(stream, &sum, FramePart::Opening)?;
    let kind = u16::from_le_bytes([k0, k1]);
    if FrameKind::ALL.iter().copied().find(|known| known.number() == kind) != Some(allowed_kind) {
        return Err(WireError::Kind { found: kind, allowed: allowed_kind });
    }
    let head_bytes = u32::from_le_bytes([h0, h1, h2, h3]);
    let payload_bytes = u64::from_le_bytes(payload);
    check_length(FramePart::Head, u64::from(head_bytes), MAX_HEAD_BYTES)?;
    check_length(FramePart::Payload, payload_bytes, MAX_PAYLOAD_BYTES)?;
    let mut head = vec![0; head_bytes as usize];
    read_exact_bytes(stream, &mut head, FramePart::Head)?;
    sum.update(&head);
    check_checksum(stream, &sum, FramePart::Head)?;
    Ok(OpenedFrame { sequence: u32::from_le_bytes([s0, s1, s2, s3]), head, payload_bytes, sum })
}

impl OpenedFrame {
    /// Compares the size of the payload with the size that follows from the head, before memory is allocated.
    ///
    /// # Errors
    /// If the sizes differ.
    pub fn check_payload_size(&self, expected: usize) -> Result<(), WireError> {
        let (found, expected) = (self.payload_bytes, expected as u64);
        if found == expected { Ok(()) } else { Err(WireError::PayloadSize { found, expected }) }
    }

    /// Reads the payload into planes of the size that follows from the head, and returns its checksum.
    ///
    /// # Errors
    /// If the payload has another size, is truncated, or has a wrong checksum.
    pub fn payload(self, stream: &mut impl Read, planes: &mut [&mut [u8]]) -> Result<u32, WireError> {
        self.check_payload_size(planes.iter().map(|plane| plane.len()).sum())?;
        let (mut sum, mut own) = (self.sum, Hasher::new());
        for piece in planes.iter_mut().flat_map(|plane| plane.chunks_mut(PIECE_BYTES)) {
            read_exact_bytes(stream, piece, FramePart::Payload)?;
            sum.update(piece);
            own.update(piece);
        }
        check_checksum(stream, &sum, FramePart::Payload)?;
        Ok(own.finalize())
    }

    /// Reads the end of a frame that must not have a payload.
    ///
    /// # Errors
    /// If the frame has a payload, or its checksum is wrong.
    pub fn finish_without_payload(self, stream: &mut impl Read) -> Result<(), WireError> {
        self.payload(stream, &mut []).map(drop)
    }
}

fn check_checksum(stream: &mut impl Read, sum: &Hasher, part: FramePart) -> Result<(), WireError> {
    let mut found = [0; 4];
    read_exact_bytes(stream, &mut found, part)?;
    let (found, computed) = (u32::from_le_bytes(found), checksum_so_far(sum));
    if found == computed { Ok(()) } else { Err(WireError::Checksum { part, found, computed }) }
}

fn read_exact_bytes(stream: &mut impl Read, bytes: &mut [u8], part: FramePart) -> Result<(), WireError> {
    stream.read_exact(bytes).map_err(|error| match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset | ErrorKind::BrokenPipe => WireError::Cut { part },
        ErrorKind::TimedOut | ErrorKind::WouldBlock => WireError::Stalled { part },
        _ => WireError::Io(error),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn written(sequence: u32, head: &[u8], planes: &[&[u8]]) -> Vec<u8> {
        let mut bytes = Vec::new();
        write(&mut bytes, (FrameKind::Reply, sequence), head, planes).expect("written");
        bytes
    }

    /// Reads a frame; returns the sequence number, the head, and planes of these sizes.
    fn read(mut bytes: &[u8], sizes: &[usize]) -> Result<(u32, Vec<u8>, Vec<Vec<u8>>), WireError> {
        let opened = open(&mut bytes, FrameKind::Reply)?;
        let (sequence, head) = (opened.sequence, opened.head.clone());
        let mut planes: Vec<Vec<u8>> = sizes.iter().map(|&size| vec![0; size]).collect();
        let mut filled: Vec<&mut [u8]> = planes.iter_mut().map(Vec::as_mut_slice).collect();
        opened.payload(&mut bytes, &mut filled)?;
        Ok((sequence, head, planes))
    }

    /// Expected size, calculated by hand: 24 bytes of opening, 2 of head, 3 of payload, and three checksums of 4 bytes.
    #[test]
    fn a_frame_has_the_documented_bytes() {
        let bytes = written(258, b"{}", &[&[1, 2, 3]]);
        assert_eq!(bytes.len(), 24 + 4 + 2 + 4 + 3 + 4);
        assert_eq!(bytes[..24], *b"PPZV\x02\0\x03\0\x02\x01\0\0\x02\0\0\0\x03\0\0\0\0\0\0\0");
        assert_eq!(bytes[24..28], crc32fast::hash(&bytes[..24]).to_le_bytes());
        assert_eq!(read(&bytes, &[2, 1]).expect("whole"), (258, b"{}".to_vec(), vec![vec![1, 2], vec![3]]));
    }

    #[test]
    fn bytes_that_are_no_frame_are_reported() {
        let bytes = written(1, b"{}", &[&[7; 9]]);
        let told = |bytes: &[u8], size| read(bytes, &[size]).expect_err("refused").to_string();
        assert_eq!(told(&[], 9), "the other process has closed the connection");
        assert_eq!(told(&bytes[..30], 9), "the connection ended within the head of a frame");
        assert_eq!(told(&bytes, 8), "a frame's payload has 9 bytes, but its head states 8 bytes");
        assert!(told(b"HTTP/1.1 200 OK and more of the same", 9).contains("[48, 54, 54, 50]"));
        let mut newer = bytes.clone();
        newer[4] = 3;
        assert_eq!(told(&newer, 9), "the received frames have the version 3, but this program uses version 2");
        let mut request = Vec::new();
        write(&mut request, (FrameKind::Request, 1), b"{}", &[]).expect("written");
        assert_eq!(told(&request, 0), "found a frame of kind 2, expected kind 3, a reply");
    }

    /// If the opening states a payload that is too long, no memory is allocated for it.
    #[test]
    fn a_length_above_the_limit_is_refused_on_both_sides() {
        let mut opening = b"PPZV\x02\0\x03\0\0\0\0\0".to_vec();
        opening.extend(0_u32.to_le_bytes());
        opening.extend(u64::MAX.to_le_bytes());
        opening.extend(crc32fast::hash(&opening).to_le_bytes());
        assert!(matches!(read(&opening, &[]), Err(WireError::TooLong { part: FramePart::Payload, .. })));
        let head = vec![b' '; MAX_HEAD_BYTES + 1];
        let mut nothing = Vec::new();
        let refused = write(&mut nothing, (FrameKind::Request, 0), &head, &[]);
        assert!(matches!(refused, Err(WireError::TooLong { part: FramePart::Head, .. })) && nothing.is_empty());
    }

    proptest! {
        #[test]
        fn a_written_frame_is_read_unchanged(
            sequence: u32, head in proptest::collection::vec(any::<u8>(), 0..300),
            planes in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..2_000), 0..4),
        ) {
            let slices: Vec<&[u8]> = planes.iter().map(Vec::as_slice).collect();
            let sizes: Vec<usize> = planes.iter().map(Vec::len).collect();
            let whole = read(&written(sequence, &head, &slices), &sizes);
            prop_assert_eq!(whole.expect("whole"), (sequence, head, planes));
        }

        /// A frame that is truncated at any byte is refused.
        #[test]
        fn every_cut_is_refused(payload in proptest::collection::vec(any::<u8>(), 0..90)) {
            let bytes = written(7, b"{\"a\":1}", &[&payload]);
            for end in 0..bytes.len() {
                prop_assert!(read(&bytes[..end], &[payload.len()]).is_err(), "{end} of {}", bytes.len());
            }
        }

        /// A frame in which any bits of any byte are changed is refused.
        #[test]
        fn every_changed_byte_is_refused(payload in proptest::collection::vec(any::<u8>(), 0..90), bits in 1_u8..) {
            let bytes = written(7, b"{\"a\":1}", &[&payload]);
            for at in 0..bytes.len() {
                let mut changed = bytes.clone();
                changed[at] ^= bits;
                prop_assert!(read(&changed, &[payload.len()]).is_err(), "byte {at} of {}", bytes.len());
            }
        }

        /// Parts of two frames do not form a valid frame.
        #[test]
        fn parts_of_different_frames_form_no_frame(first: [u8; 8], second: [u8; 8]) {
            prop_assume!(first != second);
            let (one, other) = (written(1, &first, &[b"same"]), written(1, &second, &[b"same"]));
            let mixed = [&one[..40], &other[40..]].concat();
            prop_assert!(read(&mixed, &[4]).is_err());
        }
    }
}
