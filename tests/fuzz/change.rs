//! Random changes of bytes from a seed, as they are caused by damage and by other programs.

use rand::RngExt;
use rand_pcg::Pcg64;

/// Numbers at the ends of their ranges, and characters with a meaning for parsers.
const PIECES: [&[u8]; 24] = [
    b"0",
    b"-1",
    b"2147483647",
    b"4294967296",
    b"1e400",
    b"nan",
    b"-0.0",
    b"inf",
    b"\0",
    b"\xFF\xFF\xFF\xFF",
    b"\xFF",
    b"\n",
    b"\r\n",
    b"\"",
    b"'",
    b"[",
    b"]",
    b"{",
    b"}",
    b"=",
    b"<a>",
    b"&lt;",
    b"\xC3",
    b"\xE2\x80\xA8",
];
/// Maximum size of a changed input, bytes.
const MAX_BYTES: usize = 64 << 10;

/// Returns the bytes with some changes; parts of `other` may be inserted.
pub fn change_bytes(bytes: &[u8], other: &[u8], draw: &mut Pcg64) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..draw.random_range(1..5) {
        if bytes.is_empty() {
            bytes.push(draw.random());
        }
        let at = draw.random_range(0..bytes.len());
        let length = draw.random_range(1..64).min(bytes.len() - at);
        match draw.random_range(0..8) {
            0 => bytes[at] ^= 1 << draw.random_range(0..8),
            1 => bytes[at] = draw.random(),
            2 => drop(bytes.drain(at..at + length)),
            3 => {
                let again = bytes[at..at + length].to_vec();
                bytes.splice(at..at, again);
            }
            4 => bytes.truncate(at),
            5 if !other.is_empty() => {
                let from = draw.random_range(0..other.len());
                let until = (from + length).min(other.len());
                bytes.splice(at..at, other[from..until].iter().copied());
            }
            _ => {
                let piece = PIECES[draw.random_range(0..PIECES.len())];
                let until = at + draw.random_range(0..2) * length.min(piece.len());
                bytes.splice(at..until, piece.iter().copied());
            }
        }
    }
    bytes.truncate(MAX_BYTES);
    bytes
}
