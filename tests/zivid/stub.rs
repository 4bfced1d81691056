//! The camera library with the emulated camera, and cameras with real worker processes; for tests and the bench.

use panelprep::devices::zivid::{
    AnswerTimeouts, CameraSetup, Restarts, Size, Source, WorkerLauncher, command_launcher,
};
use std::path::{Path, PathBuf};
use std::time::Duration;

#[path = "../../src/devices/zivid/tests/built.rs"]
mod built;

pub use built::{PICTURE, SCAN, library};

/// Returns an emulated camera of this size, described by a file with these lines, and its launcher: this program runs
/// as the worker process.
pub fn camera(folder: &Path, [width, height]: [usize; 2], lines: &str) -> (CameraSetup, WorkerLauncher) {
    let file = folder.join("camera.zfc");
    std::fs::write(&file, format!("width {width}\nheight {height}\n{lines}")).expect("written");
    let setup = CameraSetup {
        source: Source::File(file),
        serial: None,
        size: Size { width, height },
        scan_yaml: SCAN.to_owned(),
        picture_yaml: PICTURE.to_owned(),
        restarts: Restarts::default(),
        timeouts: AnswerTimeouts {
            search: Duration::from_millis(20),
            // A machine that builds at the same time may be very slow; stalls are tested with a shorter time limit.
            scan: Duration::from_secs(100),
            picture: Duration::from_secs(100),
            settings_and_temperatures: Duration::from_secs(100),
            ..AnswerTimeouts::default()
        },
    };
    let arguments = ["zivid-worker".into(), "--library".into(), library().into()];
    (setup, command_launcher(PathBuf::from(env!("CARGO_BIN_EXE_panelprep")), arguments.into()))
}
