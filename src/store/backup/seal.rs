//! The archive's last bytes: the SHA-256 of all bytes before them, in a frame that zstd skips.
//!
//! The check of a compressed frame does not cover each of its bits, and a file that was cut at the end of a frame
//! would be a shorter archive. The seal covers every bit.

use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Error, Read, Seek, SeekFrom, Write};

/// Magic number of a frame that zstd skips, the first of those in the format; the length of the content follows.
const MAGIC: [u8; 4] = 0x184D_2A50_u32.to_le_bytes();
const SEAL_MAGIC: &[u8; 16] = b"panelprep seal 1";
const PAYLOAD: u32 = 16 + 32;
/// Length of a seal, bytes.
pub const BYTES: u64 = 8 + PAYLOAD as u64;

/// Hashes the bytes that are written through it.
pub struct HashingWriter<W> {
    inner: W,
    hasher: Sha256,
}

impl<W: Write> HashingWriter<W> {
    pub fn new(inner: W) -> Self {
        HashingWriter { inner, hasher: Sha256::new() }
    }

    /// Writes the seal.
    pub fn seal(mut self) -> Result<W, Error> {
        self.inner.write_all(&frame(self.hasher.finalize().into()))?;
        self.inner.flush()?;
        Ok(self.inner)
    }
}

impl<W: Write> Write for HashingWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let count = self.inner.write(bytes)?;
        self.hasher.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.inner.flush()
    }
}

fn frame(hash: [u8; 32]) -> Vec<u8> {
    [&MAGIC[..], &PAYLOAD.to_le_bytes(), SEAL_MAGIC, &hash].concat()
}

/// The result of checking the seal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SealCheck {
    /// The file is as it was written: the number of bytes before the seal.
    Whole(u64),
    /// The file has no seal: it was cut short, or is not a backup.
    Missing,
    /// The file's bytes were changed.
    Broken,
}

/// Reads the whole file and checks it against its seal; the file is then positioned at its beginning.
pub fn verify_seal(file: &mut File) -> Result<SealCheck, Error> {
    let length = file.metadata()?.len();
    let Some(before) = length.checked_sub(BYTES) else { return Ok(SealCheck::Missing) };
    file.seek(SeekFrom::Start(0))?;
    let (mut hasher, mut buffer, mut left) = (Sha256::new(), vec![0; 1 << 20], before);
    while left > 0 {
        let most = usize::try_from(left).unwrap_or(usize::MAX).min(buffer.len());
        let count = file.read(&mut buffer[..most])?;
        if count == 0 {
            return Ok(SealCheck::Missing);
        }
        hasher.update(&buffer[..count]);
        left -= count as u64;
    }
    let mut found = Vec::new();
    file.take(BYTES).read_to_end(&mut found)?;
    file.seek(SeekFrom::Start(0))?;
    let begins = found.starts_with(&MAGIC) && found.get(8..24) == Some(&SEAL_MAGIC[..]);
    Ok(match found == frame(hasher.finalize().into()) {
        true => SealCheck::Whole(before),
        false if begins => SealCheck::Broken,
        false => SealCheck::Missing,
    })
}
