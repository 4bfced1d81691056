//! The camera library over the played camera, and settings for it; used by the tests inside and by those of the program.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Settings as Zivid Studio heads them.
pub const SCAN: &str =
    "__version__:\n  serializer: 1\n  data: 22\nSettings:\n  Acquisitions: []\n  Color:\n    Settings2D: {}\n";
/// Those of pictures.
pub const PICTURE: &str = "__version__:\n  serializer: 1\n  data: 3\nSettings2D:\n  Acquisitions: []\n";

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
