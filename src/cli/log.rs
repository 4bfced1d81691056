//! What the program tells while it works, on standard error. Under systemd the journal adds the time itself.

use tracing::level_filters::LevelFilter;
use tracing_subscriber::fmt;

/// Begins to log; `PANELPREP_LOG` may name another level than `usual`: `error`, `warn`, `info`, `debug`, `trace`, `off`.
pub fn start(usual: LevelFilter) {
    let level = std::env::var("PANELPREP_LOG").ok().and_then(|word| word.parse().ok()).unwrap_or(usual);
    let log = fmt().with_writer(std::io::stderr).with_ansi(false).with_target(false).with_max_level(level);
    // It would be told by `eprintln!`, which panics where nobody reads.
    let log = log.log_internal_errors(false);
    // Set once for each process; a second one changes nothing.
    let _ = match std::env::var_os("JOURNAL_STREAM") {
        Some(_) => tracing::subscriber::set_global_default(log.without_time().finish()),
        None => tracing::subscriber::set_global_default(log.finish()),
    };
}
