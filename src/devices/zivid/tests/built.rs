//! The camera library built with the simulated SDK, and settings for it. The tests in this crate and those of the
//! program use both.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Settings of 3D shots: the delivered sample.
pub const SCAN: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/config/zivid/scan.yml"));
/// Settings of pictures.
pub const PICTURE: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/config/zivid/film.yml"));

/// The library, built.
pub fn library() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let made =
            Command::new("make").args(["-s", "zivid-stub"]).current_dir(root).output().expect("make is here");
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        root.join("target/zivid-stub/libpanelprep_zivid.so")
    })
}
