//! The program's messages on standard error while it works. Under systemd the journal adds the time itself.
//!
//! An event is always one line. Names and texts come from files and from clients, and a line feed in one of them
//! must not begin a line that looks like another event.

use std::io::{Result, Write};
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::fmt;
use tracing_subscriber::layer::SubscriberExt;

/// Starts the log; `PANELPREP_LOG` may set another level than `usual`: `error`, `warn`, `info`, `debug`, `trace`,
/// `off`.
pub fn start(usual: LevelFilter) {
    let level = std::env::var("PANELPREP_LOG").ok().and_then(|word| word.parse().ok()).unwrap_or(usual);
    let out = || OneLine(std::io::stderr());
    let log = fmt().with_writer(out).with_ansi(false).with_target(false).with_max_level(level);
    // An internal error would be printed by `eprintln!`, which panics if standard error has no reader.
    let log = log.log_internal_errors(false);
    // The messages of these libraries can be caused by any input from a network, so they are not part of the usual
    // log.
    let is_of_network = |target: &str| ["opcua", "async_nats"].iter().any(|name| target.starts_with(name));
    let is_told = move |of: &tracing::Metadata<'_>| level >= LevelFilter::DEBUG || !is_of_network(of.target());
    #[expect(clippy::let_underscore_must_use, reason = "set once for each process; a second one changes nothing")]
    let _ = match std::env::var_os("JOURNAL_STREAM") {
        Some(_) => tracing::subscriber::set_global_default(log.without_time().finish().with(filter_fn(is_told))),
        None => tracing::subscriber::set_global_default(log.finish().with(filter_fn(is_told))),
    };
}

/// Writes each event as one line. Each event arrives complete; its control characters, except the one at its end,
/// are written as escapes.
struct OneLine<W>(W);

impl<W: Write> Write for OneLine<W> {
    fn write(&mut self, event: &[u8]) -> Result<usize> {
        let text = String::from_utf8_lossy(event);
        let inside = text.strip_suffix('\n').unwrap_or(&text);
        let is_plain = |c: char| !c.is_control() && !matches!(c, '\u{2028}' | '\u{2029}');
        if inside.chars().all(is_plain) {
            self.0.write_all(event)?;
        } else {
            let escaped: String = inside
                .chars()
                .map(|c| if is_plain(c) { c.to_string() } else { c.escape_default().to_string() })
                .collect();
            self.0.write_all(escaped.as_bytes())?;
            self.0.write_all(&text.as_bytes()[inside.len()..])?;
        }
        Ok(event.len())
    }

    fn flush(&mut self) -> Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(event: &str) -> String {
        let mut bytes = Vec::new();
        OneLine(&mut bytes).write_all(event.as_bytes()).expect("memory");
        String::from_utf8(bytes).expect("UTF-8")
    }

    #[test]
    fn an_event_is_one_line_whatever_it_holds() {
        assert_eq!(written("INFO anna (uid 7) asks: stop; 25 µm\n"), "INFO anna (uid 7) asks: stop; 25 µm\n");
        let forged = "WARN refused: /tmp/a\n2026-11-22 INFO root (uid 0) asks: abort\r\x1b[2K\u{2028}\n";
        let told = "WARN refused: /tmp/a\\n2026-11-22 INFO root (uid 0) asks: abort\\r\\u{1b}[2K\\u{2028}\n";
        assert_eq!(written(forged), told);
    }
}
