//! The camera library over the played camera, and cameras behind real workers; for tests and the bench.

use panelprep::devices::zivid::{Launcher, Patience, Restarts, Setup, Size, Source, launcher};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;

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

/// A camera of this size, played from a file of these lines, and its workers: this program in its role.
pub fn camera(folder: &Path, [width, height]: [usize; 2], lines: &str) -> (Setup, Launcher) {
    let file = folder.join("camera.zfc");
    std::fs::write(&file, format!("width {width}\nheight {height}\n{lines}")).expect("written");
    let setup = Setup {
        source: Source::File(file),
        serial: None,
        size: Size { width, height },
        scan_yaml: SCAN.to_owned(),
        picture_yaml: PICTURE.to_owned(),
        restarts: Restarts::default(),
        patience: Patience {
            search: Duration::from_millis(20),
            // A machine that builds beside may be very slow; what stalls is tested with a time of its own.
            scan: Duration::from_secs(100),
            picture: Duration::from_secs(100),
            words: Duration::from_secs(100),
            ..Patience::default()
        },
    };
    let arguments = ["zivid-worker".into(), "--library".into(), library().into()];
    (setup, launcher(PathBuf::from(env!("CARGO_BIN_EXE_panelprep")), arguments.into()))
}
