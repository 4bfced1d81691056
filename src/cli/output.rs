//! The program's output streams. The reader may close a stream at any time (`| head -1`): this does not end the
//! command and does not change its exit code.

use super::fault::Fault;
use std::io::{self, ErrorKind, Write};

/// Writes a line of the result to standard output.
///
/// # Errors
/// If it cannot be written for a reason other than a missing reader, such as a full disk.
pub fn print_line(line: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    match writeln!(stdout, "{line}").and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}

/// Reads a line that a person types at the terminal, without leading and trailing blanks; `None` if the input has
/// ended.
///
/// # Errors
/// If standard input cannot be read.
pub fn read_answer_line() -> Result<Option<String>, Fault> {
    let mut line = String::new();
    let read =
        io::stdin().read_line(&mut line).map_err(|error| Fault::file_fault("standard input".as_ref(), error))?;
    Ok((read > 0).then(|| line.trim().to_owned()))
}

/// Writes a line of progress, or a problem, to standard error. If that fails, there is no other place to report it.
pub fn write_progress(line: &str) {
    #[expect(
        clippy::let_underscore_must_use,
        reason = "the output has no reader: there is no other place to say it"
    )]
    let _ = writeln!(io::stderr().lock(), "{line}");
}
