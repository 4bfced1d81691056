//! Checks of the computer: this program, its disk, its clock, its sockets.

use super::check::Check;
use super::judge;
use crate::cli::calibrate::now_unix_s;
use panelprep_devices::gige::socket_buffer_bytes;
use panelprep_service::daemon;
use panelprep_store::store::free_mb;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::UNIX_EPOCH;

/// Checks this program and the libraries that it uses.
pub(super) fn program() -> Check {
    let version = env!("CARGO_PKG_VERSION");
    match opencv::core::get_version_string() {
        Ok(opencv) => Check::passed("program", format!("panelprep {version} with OpenCV {opencv}")),
        Err(error) => Check::failed(
            "program",
            format!("panelprep {version}, but OpenCV does not report its version: {error}"),
            "reinstall the Debian package libopencv-dev",
        ),
    }
}

/// Checks whether a time server sets the clock.
pub(super) fn check_time_sync() -> Check {
    let asked = Command::new("timedatectl").args(["show", "--property=NTPSynchronized", "--value"]).output();
    let said = asked.ok().filter(|output| output.status.success());
    judge::judge_time_sync(said.and_then(|output| match output.stdout.trim_ascii() {
        b"yes" => Some(true),
        b"no" => Some(false),
        _ => None,
    }))
}

/// Checks that nothing in the store was written in the future; `None` if there is no store.
pub(super) fn check_clock_order(store: &Path) -> Option<Check> {
    let newest = fs::read_dir(store).ok()?.filter_map(|entry| {
        let written = entry.ok()?.metadata().ok()?.modified().ok()?;
        i64::try_from(written.duration_since(UNIX_EPOCH).ok()?.as_secs()).ok()
    });
    Some(judge::judge_clock_order(newest.max()?, now_unix_s()))
}

/// Checks the free space at the present or future path of the store.
pub(super) fn disk(store: &Path) -> Check {
    let whole = std::path::absolute(store).unwrap_or_else(|_| store.to_owned());
    let there: Option<PathBuf> = whole.ancestors().find(|folder| folder.is_dir()).map(Path::to_owned);
    let advice = "set `store` in the cell's file to a folder that this user may write";
    let Some(folder) = there else {
        return Check::failed("disk", format!("no part of {} exists", whole.display()), advice);
    };
    if rustix::fs::access(&folder, rustix::fs::Access::WRITE_OK).is_err() {
        return Check::failed("disk", format!("this user has no permission to write {}", folder.display()), advice);
    }
    match free_mb(&folder) {
        Ok(free_mb) => judge::disk(&folder.display().to_string(), free_mb),
        Err(error) => Check::failed("disk", format!("{}: {error}", folder.display()), advice),
    }
}

/// Recordings in the store, which are not removed automatically; `None` if there are none.
pub(super) fn recordings(store: &Path) -> Option<Check> {
    let folder = daemon::recordings(store);
    let bytes = |entry: std::io::Result<fs::DirEntry>| Some(entry.ok()?.metadata().ok()?.len());
    let sizes: Vec<u64> = fs::read_dir(&folder).ok()?.filter_map(bytes).collect();
    let (count, mb) = (sizes.len(), sizes.iter().sum::<u64>() / 1_000_000);
    let found =
        format!("{count} recordings, {mb} MB, in {}; recordings stay until you remove them", folder.display());
    (count > 0).then(|| Check::passed("recordings", found))
}

/// Finds the drivers of graphics processors that the kernel has.
pub(super) fn graphics_processor() -> Check {
    let devices = fs::read_to_string("/proc/devices").ok();
    judge::graphics_processor(devices.as_deref(), Path::new("/dev/nvidia-uvm").exists())
}

/// Compares the kernel's largest receive buffer with what a picture of this size needs.
pub(super) fn receive_buffer(size_px: Option<[usize; 2]>, packet_bytes: u16) -> Check {
    let text = fs::read_to_string("/proc/sys/net/core/rmem_max").ok();
    let needed = socket_buffer_bytes(size_px.unwrap_or_default(), packet_bytes);
    judge::receive_buffer(text.and_then(|text| text.trim().parse().ok()), needed, size_px)
}
