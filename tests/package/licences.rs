//! Prints the licence file of the package: every crate that is linked, and every licence text once.

#[path = "../licences.rs"]
#[allow(dead_code, reason = "its tests run elsewhere")]
mod licences;

use std::collections::BTreeMap;
use std::io::Write;

/// Licences of parts that are not Rust code, in the sources of a crate or linked on the machine.
const BESIDE: &str = "\
SQLite is part of the program (crate libsqlite3-sys); it is in the public domain. Zstandard (crate zstd-sys) is part of it under the
BSD licence below. The fonts DejaVu Sans Condensed (crate dejavu) are part of it under their own licence below. OpenCV, Aravis, GLib and the C and C++ libraries are not in this package: they are the system's, under their own
licences in /usr/share/doc.";

fn main() -> std::io::Result<()> {
    let linked = licences::linked();
    let mut out = std::io::stdout().lock();
    writeln!(out, "Panelprep is licensed under Apache-2.0:\n\n{}", include_str!("../../LICENSE"))?;
    writeln!(out, "\n{BESIDE}\n\nThe program is linked of these crates:\n")?;
    let mut texts: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for it in &linked {
        let by = if it.authors.is_empty() { String::new() } else { format!(", by {}", it.authors.join(", ")) };
        writeln!(out, "{}: {}{by} {}", it.name, it.licence, it.repository)?;
        it.texts
            .iter()
            .for_each(|(file, text)| texts.entry(text.trim()).or_default().push(format!("{} ({file})", it.name)));
    }
    for (text, of) in texts {
        writeln!(out, "\n{}\n{}:\n\n{text}", "-".repeat(80), of.join(", "))?;
    }
    out.flush()
}
