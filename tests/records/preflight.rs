//! Checks the PDF of a record with an independent validator, Apache PDFBox Preflight, as Debian provides it. Preflight
//! checks for PDF/A-1b; it may only report features that part 3 of the standard permits in addition to part 1.

use std::fs;
use std::path::Path;
use std::process::Command;

const LIBRARIES: [&str; 8] =
    ["preflight", "pdfbox2", "fontbox2", "xmpbox", "commons-logging", "commons-io", "javax.activation", "jaxb-api"];

/// Error codes for features that PDF/A-3 (ISO 19005-3) permits and PDF/A-1 does not: an embedded file in its dictionary
/// and among the names, a colour profile of version 4, and the part number.
const PERMITTED_BY_PART_3: [&str; 4] = ["1.2.9", "1.4.7", "2.1.6", "7.11.2"];

/// Returns the codes of the reported errors, each once; `None` if Preflight or Java is not installed.
fn found(pdf: &Path) -> Option<Vec<String>> {
    let libraries = LIBRARIES.map(|name| format!("/usr/share/java/{name}.jar"));
    let is_there = libraries.iter().all(|file| Path::new(file).exists());
    let javac = Command::new("javac").arg("-version").output().is_ok();
    if !is_there || !javac {
        return None;
    }
    let home = pdf.parent().expect("a folder");
    let done = Command::new("java")
        .arg(format!("-Duser.home={}", home.display()))
        .args(["-cp", &libraries.join(":")])
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/records/Preflight.java"))
        .arg(pdf)
        .output()
        .expect("java");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let told = String::from_utf8_lossy(&done.stdout).into_owned();
    let mut codes: Vec<String> =
        told.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect();
    codes.sort();
    codes.dedup();
    Some(codes)
}

fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let at = bytes.windows(from.len()).position(|part| part == from).expect("it is there");
    bytes[at..at + to.len()].copy_from_slice(to);
    bytes
}

/// Checks that Preflight only reports features that part 3 permits in addition to part 1. As a test of the validator,
/// it must also report a wrong colour space and a wrong font.
pub fn accepts(pdf: &Path) {
    let Some(codes) = found(pdf) else {
        eprintln!(
            "not run: libpdfbox2-java, libactivation-java, libjaxb-api-java and a Java compiler are needed (make preflight)"
        );
        return;
    };
    assert_eq!(codes, PERMITTED_BY_PART_3);
    let whole = fs::read(pdf).expect("the PDF");
    let changed = pdf.with_extension("changed.pdf");
    for (from, to, code) in
        [(&b"/GTS_PDFA1"[..], &b"/GTS_PDFX1"[..], "2.1.3"), (&b"/FontFile2"[..], &b"/FontFileX"[..], "3.1.3")]
    {
        fs::write(&changed, replaced(&whole, from, to)).expect("written");
        let codes = found(&changed).expect("run before");
        assert!(codes.iter().any(|found| found == code), "{code}: {codes:?}");
    }
    fs::remove_file(changed).expect("removed");
}
