//! Reads input files: only regular files, completely, and only up to a size limit.
//!
//! Reading a pipe can block for ever, and a device may have no end. A file that is far too large would use up the
//! memory that other parts of the program need. Therefore the type of a file is checked before the file is opened.

use std::fs::{File, FileType, OpenOptions};
use std::io::{Error, ErrorKind, Read, Result};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

/// Maximum size of a file that is read completely, bytes. A full-size scan as text needs a quarter of this size.
pub const MAX_BYTES: u64 = 512 << 20;

/// Opens a regular file for reading. This never blocks.
///
/// # Errors
/// If the file does not exist, is a folder, a pipe, a socket or a device, or if the operating system refuses to open
/// it.
pub fn open(file: &Path) -> Result<File> {
    // Opening a device may already have an effect, so the type is checked before the file is opened, and again after
    // it is opened.
    check_regular_file(file.metadata()?.file_type())?;
    let without_waiting = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
    let opened = OpenOptions::new().read(true).custom_flags(without_waiting).open(file)?;
    check_regular_file(opened.metadata()?.file_type())?;
    Ok(opened)
}

/// Returns the bytes of a regular file of at most [`MAX_BYTES`].
///
/// # Errors
/// The errors of [`open`], and if the file is larger than this.
pub fn read(file: &Path) -> Result<Vec<u8>> {
    read_at_most(file, MAX_BYTES)
}

fn read_at_most(file: &Path, most_bytes: u64) -> Result<Vec<u8>> {
    let opened = open(file)?;
    let stated = opened.metadata()?.len();
    let too_large = |found: u64| {
        let words = format!("the file has at least {found} bytes (limit {most_bytes} bytes)");
        Error::new(ErrorKind::FileTooLarge, words)
    };
    if stated > most_bytes {
        return Err(too_large(stated));
    }
    let mut bytes = Vec::with_capacity(usize::try_from(stated).unwrap_or_default());
    // The limit is applied again, because the file may grow while it is read.
    opened.take(most_bytes + 1).read_to_end(&mut bytes)?;
    match bytes.len() as u64 {
        found if found > most_bytes => Err(too_large(found)),
        _ => Ok(bytes),
    }
}

fn check_regular_file(kind: FileType) -> Result<()> {
    let found = match kind {
        kind if kind.is_file() => return Ok(()),
        kind if kind.is_dir() => "a folder",
        kind if kind.is_fifo() => "a pipe",
        kind if kind.is_socket() => "a socket",
        _ => "a device",
    };
    let words = format!("the path is {found}, not a regular file; copy the content into a regular file");
    Err(Error::new(ErrorKind::InvalidInput, words))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType, Mode, mknodat};

    #[test]
    fn only_regular_files_are_opened_and_without_waiting() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = folder.path().join("scan.pcd");
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a pipe");
        let socket = folder.path().join("socket");
        let _listens = std::os::unix::net::UnixListener::bind(&socket).expect("a socket");
        let cases = [(pipe.as_path(), "is a pipe"), (folder.path(), "is a folder"), (&socket, "is a socket")];
        for (file, words) in cases.into_iter().chain([(Path::new("/dev/zero"), "is a device")]) {
            let error = read(file).expect_err("refused").to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_file_that_is_too_large_is_not_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("notes.txt");
        std::fs::write(&file, b"12345").expect("written");
        assert_eq!(read_at_most(&file, 5).expect("fits"), b"12345");
        let error = read_at_most(&file, 4).expect_err("too large").to_string();
        assert!(error.contains("has at least 5 bytes") && error.contains("limit 4 bytes"), "{error}");
        // A sparse file: it needs no disk space, but reading the file would need the memory.
        File::create(&file).and_then(|file| file.set_len(MAX_BYTES + 1)).expect("grown");
        assert!(read(&file).expect_err("too large").to_string().contains("limit 536870912 bytes"));
    }
}
