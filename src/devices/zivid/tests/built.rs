//! The camera library built with the SDK stub, and settings for it. The tests of this crate and those of the program
//! use both.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The settings for 3D scans: the shipped sample.
pub const SCAN: &str = include_str!("../../../../config/zivid/scan.yml");
/// The settings for pictures: the shipped sample.
pub const PICTURE: &str = include_str!("../../../../config/zivid/film.yml");

/// Builds the camera library once and returns its path.
pub fn library() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        // This file is compiled in two crates in different folders, so the root folder is searched.
        let mut folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
        let root = folders.find(|folder| folder.join("Makefile").exists()).expect("the project's root");
        let made =
            Command::new("make").args(["-s", "zivid-stub"]).current_dir(root).output().expect("make is here");
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        root.join("target/zivid-stub/libpanelprep_zivid.so")
    })
}
