//! The SHA-256 by which contents are identified, and bytes as hexadecimal digits.

use sha2::{Digest, Sha256};

const DIGITS: &[u8; 16] = b"0123456789abcdef";

/// Calculates the SHA-256 of the bytes as 64 lower-case hexadecimal digits.
pub fn content_hash(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Writes bytes as lower-case hexadecimal digits, two for each byte.
pub fn hex(bytes: &[u8]) -> String {
    let digit = |value: u8| char::from(DIGITS[usize::from(value)]);
    bytes.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]).collect()
}

/// Returns the bytes of lower-case hexadecimal digits; `None` if the text is not such a number.
pub fn parse_hex(text: &str) -> Option<Vec<u8>> {
    if !is_hex(text, text.len()) || !text.len().is_multiple_of(2) {
        return None;
    }
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(text.get(at..at + 2)?, 16).ok()).collect()
}

/// Returns whether a text is exactly this number of lower-case hexadecimal digits: such a name cannot lead out of a
/// folder.
pub fn is_hex(text: &str, digits: usize) -> bool {
    text.len() == digits && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of FIPS 180-2, appendix B.1.
    #[test]
    fn the_standard_s_own_example() {
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(content_hash(b"abc"), expected);
    }

    #[test]
    fn digits_read_back_and_nothing_else_is_read() {
        assert_eq!((hex(&[0, 0x9f, 255]), parse_hex("009fff")), ("009fff".to_owned(), Some(vec![0, 0x9f, 255])));
        for wrong in ["0", "0g", "0G", "9F", "+1", "é"] {
            assert_eq!(parse_hex(wrong), None, "{wrong}");
        }
        assert!(is_hex("00ff", 4) && !is_hex("00ff", 6) && !is_hex("../a", 4));
    }
}
