//! Finds the beginnings of a file's records, in parallel with its reader: an uncompressed chunk is refused before it
//! is read.
//!
//! The reader assumes that the last record of such a chunk ends with the chunk, and its count of bytes falls below
//! zero if it does not. Our recordings have only compressed chunks; their records are unpacked by their own lengths.

use super::error::TapeError;
use mcap::records::op;

/// Number of bytes of the magic at the beginning of a file.
const MAGIC_BYTES: u64 = 8;
/// Bytes of a record's kind and length.
const HEAD_BYTES: usize = 9;
/// Bytes of a chunk's head before the length of its compression's name: two times, its size, its checksum.
const BEFORE_NAME: usize = 28;
/// Bytes of a chunk's head including the length of its compression's name.
const CHUNK_BYTES: usize = HEAD_BYTES + BEFORE_NAME + 4;

/// Follows the records of a file through its bytes, in pieces of any size.
#[derive(Debug)]
pub struct RecordFraming {
    /// Bytes to skip: the magic, the rest of a record.
    skip: u64,
    /// The part of a record's head that has been received.
    head: Vec<u8>,
}

impl Default for RecordFraming {
    fn default() -> Self {
        RecordFraming { skip: MAGIC_BYTES, head: Vec::with_capacity(CHUNK_BYTES) }
    }
}

impl RecordFraming {
    /// Reads the next bytes of the file.
    ///
    /// # Errors
    /// If an uncompressed chunk begins in them.
    pub fn feed(&mut self, mut bytes: &[u8]) -> Result<(), TapeError> {
        while !bytes.is_empty() {
            let skipped = usize::try_from(self.skip).unwrap_or(usize::MAX).min(bytes.len());
            bytes = &bytes[skipped..];
            self.skip -= skipped as u64;
            let missing = self.missing_head_bytes().min(bytes.len());
            self.head.extend_from_slice(&bytes[..missing]);
            bytes = &bytes[missing..];
            if self.skip == 0 && self.missing_head_bytes() == 0 {
                self.judge()?;
                self.skip = self.length().saturating_sub((self.head.len() - HEAD_BYTES) as u64);
                self.head.clear();
            }
        }
        Ok(())
    }

    /// Returns the number of missing bytes of a record's head.
    fn missing_head_bytes(&self) -> usize {
        let needed = match self.head.first() {
            Some(&op::CHUNK) if self.head.len() >= HEAD_BYTES => {
                let rest = usize::try_from(self.length()).unwrap_or(usize::MAX);
                HEAD_BYTES + rest.min(CHUNK_BYTES - HEAD_BYTES)
            }
            _ => HEAD_BYTES,
        };
        needed.saturating_sub(self.head.len())
    }

    fn length(&self) -> u64 {
        self.head.get(1..).and_then(|rest| rest.first_chunk()).map_or(0, |length| u64::from_le_bytes(*length))
    }

    fn judge(&self) -> Result<(), TapeError> {
        let is_chunk = self.head.first() == Some(&op::CHUNK);
        match self.head.get(HEAD_BYTES + BEFORE_NAME..) {
            Some([0, 0, 0, 0]) if is_chunk => {
                Err(TapeError::Foreign { problem: "the file has a chunk that is not compressed".to_owned() })
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a file with its beginning, a short record, a record of another kind that contains bytes like those
    /// of a chunk, and then a chunk.
    fn file(name: &[u8]) -> Vec<u8> {
        let record = |op: u8, content: &[u8]| [&[op][..], &(content.len() as u64).to_le_bytes(), content].concat();
        let chunk = [&[7; BEFORE_NAME][..], &(name.len() as u32).to_le_bytes(), name, &[1; 20]].concat();
        let inside = record(op::CHUNK, &[0; 40]);
        [
            b"\x89MCAP0\r\n".to_vec(),
            record(op::HEADER, b"ab"),
            record(op::METADATA, &inside),
            record(op::CHUNK, &chunk),
        ]
        .concat()
    }

    #[test]
    fn only_a_chunk_that_is_not_packed_is_refused_at_any_cut() {
        for step in [1, 2, 3, 8, 64, 1_000] {
            let read = |bytes: &[u8]| {
                let mut framing = RecordFraming::default();
                bytes.chunks(step).try_for_each(|piece| framing.feed(piece))
            };
            assert!(read(&file(b"zstd")).is_ok(), "{step}");
            let error = read(&file(b"")).expect_err("refused").to_string();
            assert!(error.contains("a chunk that is not compressed"), "{step}: {error}");
            // A chunk that ends before the name of its compression is left to the reader, which refuses it.
            assert!(
                read(&[&file(b"zstd")[..8], &[op::CHUNK, 3, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, op::HEADER]].concat())
                    .is_ok()
            );
        }
    }
}
