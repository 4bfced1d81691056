//! A check of `panelprep doctor`, and the checks of the computer: this program, the disk, the clock, the sockets.
//!
//! The functions `judge_…` convert a fact about the computer or a camera to a check; they are pure functions.

use crate::setup::{MIN_FREE_SPACE_MB, clock::now_unix_s, recordings as recordings_folder};
use panelprep_base::verdict::Reason;
use panelprep_cell::cell::{MainsFrequency, ZividSettings, ZividUse};
use panelprep_devices::gige::socket_buffer_bytes;
use panelprep_devices::zivid::{Flicker, Light, WarmUpState};
use panelprep_store::store::free_mb;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::UNIX_EPOCH;

/// The result of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ItemStatus {
    /// The item was checked and nothing is wrong.
    Right,
    /// The item was checked and is not correct.
    Wrong,
    /// The item was not checked, which is treated as a failure.
    Open,
}

/// A check of one item, with its result and advice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExaminedItem {
    /// Name of the checked item.
    pub name: String,
    /// Its status.
    pub status: ItemStatus,
    /// Result of the check.
    pub found: String,
    /// What to do; empty if the check passed.
    pub advice: String,
}

impl ExaminedItem {
    /// Returns whether the item was checked and nothing is wrong with it.
    pub fn is_passed(&self) -> bool {
        self.status == ItemStatus::Right
    }

    /// Creates an item with which nothing is wrong.
    pub fn passed(name: impl Into<String>, found: impl Into<String>) -> Self {
        ExaminedItem { name: name.into(), status: ItemStatus::Right, found: found.into(), advice: String::new() }
    }

    /// Creates an item that was not checked, for this reason.
    pub fn open(name: impl Into<String>, why: &str, advice: impl Into<String>) -> Self {
        ExaminedItem {
            name: name.into(),
            status: ItemStatus::Open,
            found: format!("not checked{why}"),
            advice: advice.into(),
        }
    }

    /// Creates an item with which something is wrong.
    pub fn failed(name: impl Into<String>, found: impl Into<String>, advice: impl Into<String>) -> Self {
        ExaminedItem { name: name.into(), status: ItemStatus::Wrong, found: found.into(), advice: advice.into() }
    }
}

/// Minimum free disk space for a passed check, MB; less space is enough for a few cycles only.
const MIN_FREE_MB: u64 = 10_000;
/// Maximum time by which the last entry of the store may be ahead of the clock, s.
const MAX_CLOCK_LEAD_S: i64 = 60;

/// Judges the room for the data that a cycle writes.
fn judge_disk(folder: &str, free_mb: u64) -> ExaminedItem {
    let found = format!("{free_mb} MB free on the disk of the store, {folder}");
    match free_mb {
        ..MIN_FREE_SPACE_MB => ExaminedItem::failed(
            "disk",
            found,
            format!("free some space: no cycle starts below {MIN_FREE_SPACE_MB} MB; a film needs 100 to 500 MB"),
        ),
        MIN_FREE_SPACE_MB..MIN_FREE_MB => {
            ExaminedItem::passed("disk", format!("{found}; enough for a few cycles only"))
        }
        _ => ExaminedItem::passed("disk", found),
    }
}

/// Returns an alarm if the disk of this store has little room; `None` if there is enough, or it cannot be queried.
pub fn low_disk_space(store: &Path) -> Option<Reason> {
    judge_disk_space(&store.display().to_string(), free_mb(store).ok()?)
}

fn judge_disk_space(folder: &str, free_mb: u64) -> Option<Reason> {
    let code = match free_mb {
        ..MIN_FREE_SPACE_MB => "disk_full",
        MIN_FREE_SPACE_MB..MIN_FREE_MB => "disk_scarce",
        _ => return None,
    };
    let ExaminedItem { found, advice, .. } = judge_disk(folder, free_mb);
    let words = if advice.is_empty() { found } else { format!("{found}; {advice}") };
    Some(Reason::new(code, words))
}

/// Reports whether a time server sets the clock; `kept` is `None` if this is not known.
fn judge_time_sync(kept: Option<bool>) -> ExaminedItem {
    match kept {
        Some(true) => ExaminedItem::passed("clock", "set by a time server"),
        // Records contain times that an inspector signs; the clock of a cell without a network may still be set by
        // hand.
        Some(false) => ExaminedItem::passed(
            "clock",
            "not set by a time server; records contain the time of this computer's own clock",
        ),
        None => ExaminedItem::passed("clock", "not known whether a time server sets the clock"),
    }
}

/// Checks that the last time written in the store is not ahead of the clock.
fn judge_clock_order(written_unix_s: i64, now_unix_s: i64) -> ExaminedItem {
    let ahead_s = written_unix_s - now_unix_s;
    if ahead_s > MAX_CLOCK_LEAD_S {
        let found =
            format!("the store's last entry is {:.1} h ahead of the computer's clock", ahead_s as f64 / 3600.0);
        return ExaminedItem::failed("clock beside the store", found, "set the computer's clock: `timedatectl`");
    }
    ExaminedItem::passed("clock beside the store", format!("last written {:.1} h ago", -ahead_s as f64 / 3600.0))
}

/// Judges whether a socket may have the buffer for a GigE Vision camera's picture, which comes in one burst.
/// `largest_bytes` is the kernel's `rmem_max`; without a size, the size of an ordinary camera is assumed.
fn judge_receive_buffer(
    largest_bytes: Option<u64>,
    needed_bytes: usize,
    size_px: Option<[usize; 2]>,
) -> ExaminedItem {
    let name = "socket buffers";
    let advice = format!(
        "put `net.core.rmem_max = {needed_bytes}` into /etc/sysctl.d/60-panelprep.conf and run `sysctl --system`"
    );
    let whose = match size_px {
        Some([width, height]) => format!("this camera, {width}×{height} px, needs {needed_bytes} bytes"),
        None => format!("a camera needs {needed_bytes} bytes"),
    };
    match largest_bytes {
        Some(bytes) if bytes >= needed_bytes as u64 => {
            ExaminedItem::passed(name, format!("up to {bytes} bytes; {whose}"))
        }
        Some(bytes) => ExaminedItem::failed(
            name,
            format!("up to {bytes} bytes; {whose}; with a smaller buffer, frames are lost"),
            advice,
        ),
        None => ExaminedItem::failed(
            name,
            "the kernel does not report the largest buffer size (/proc/sys/net/core/rmem_max)",
            advice,
        ),
    }
}

/// Checks whether there is a graphics processor for the Zivid SDK and whether the service may access it. This is
/// judged by the character devices of `/proc/devices`: their names are those that `config/panelprep-zivid.conf`
/// allows the service. `has_uvm_node`: /dev/nvidia-uvm exists.
fn judge_graphics_processor(devices: Option<&str>, has_uvm_node: bool) -> ExaminedItem {
    let name = "graphics processor";
    let Some(devices) = devices else {
        return ExaminedItem::failed(name, "the kernel does not list its devices (/proc/devices)", "mount /proc");
    };
    let characters = devices.split("Block devices:").next().unwrap_or_default();
    let names: Vec<&str> = characters.lines().filter_map(|line| line.split_whitespace().nth(1)).collect();
    let has = |wanted: &str| names.contains(&wanted);
    let uvm = "put a line `nvidia-uvm` into /etc/modules-load.d/panelprep.conf and run `modprobe nvidia-uvm`: the \
               service has no permission to load this module";
    match (has("nvidia") || has("nvidia-frontend"), has("nvidia-uvm"), has("drm")) {
        (true, true, _) if has_uvm_node => ExaminedItem::passed(name, "NVIDIA, with nvidia-uvm"),
        (true, true, _) => ExaminedItem::failed(
            name,
            "NVIDIA, but the device /dev/nvidia-uvm does not exist",
            "run `nvidia-modprobe -c 0 -u` at boot: the service has no permission to create a device",
        ),
        (true, false, _) => {
            ExaminedItem::failed(name, "NVIDIA, but its kernel module nvidia-uvm is not loaded", uvm)
        }
        (false, _, true) => {
            let found = "no NVIDIA driver; a display driver (drm) is loaded, which the Zivid SDK uses if the SDK supports it";
            ExaminedItem::passed(name, found)
        }
        (false, _, false) => ExaminedItem::failed(
            name,
            "no driver of a graphics processor is loaded (neither nvidia nor drm in /proc/devices); the Zivid SDK needs a graphics processor",
            "install the driver of the graphics processor; a file camera may work without a driver, see the SDK's manual",
        ),
    }
}

/// Judges whether the cell's present light is suitable for the exposures of the camera's settings.
pub(super) fn judge_light(light: &Light, settings: &[ZividSettings]) -> ExaminedItem {
    let name = "light on the scene";
    let every = match light.frequency.as_str() {
        "" => String::new(),
        frequency => format!(" ({frequency} Hz)"),
    };
    let mains = match light.flicker {
        Flicker::None => return ExaminedItem::passed(name, "does not flicker at present"),
        Flicker::Grid50Hz => MainsFrequency::Hz50,
        Flicker::Grid60Hz => MainsFrequency::Hz60,
        Flicker::Other | Flicker::Unknown => {
            let found = format!(
                "flickers, but not at the frequency of the mains{every}: no suitable exposure time is known"
            );
            return ExaminedItem::failed(
                name,
                found,
                "find the lamp that flickers; use a lamp on direct current for the film",
            );
        }
    };
    let file = |settings: &ZividSettings| match settings.usage() {
        ZividUse::Scan => "settings",
        ZividUse::Film => "settings_2d",
    };
    let misfits = |settings: &&ZividSettings| !settings.matching_mains().contains(&mains);
    let wrong: Vec<&str> = settings.iter().filter(misfits).map(file).collect();
    let found = format!("flickers like lamps on mains of {}{every}", mains.name());
    if wrong.is_empty() {
        return ExaminedItem::passed(
            name,
            format!("{found}; each exposure time is a multiple of the flicker period"),
        );
    }
    let advice = format!(
        "make each ExposureTime in [scanner] {} a multiple of {:.0} µs, or use lamps on direct current",
        wrong.join(" and "),
        mains.flicker_period_us()
    );
    ExaminedItem::failed(
        name,
        format!("{found}, but an exposure time is not a multiple of the flicker period, or is not stated"),
        advice,
    )
}

/// Reports that the state of the light is not known, because the camera does not report it: a doubt, not a fault of
/// the cell.
pub(super) fn unknown_light(why: &str) -> ExaminedItem {
    ExaminedItem::passed("light on the scene", format!("not known whether the light flickers: {why}"))
}

/// Checks whether the 3D camera has reached its steady temperature. A doubt is reported; a cycle may still begin.
pub(super) fn check_warm_up(state: WarmUpState) -> ExaminedItem {
    let name = "scanner's warmth";
    match state {
        WarmUpState::Changing { .. } => {
            let advice =
                "let the camera take shots for ten minutes: run `panelprep doctor --warm-up`, or run cycles";
            ExaminedItem::failed(name, state.to_string(), advice)
        }
        WarmUpState::NoReadings { .. } => {
            ExaminedItem::passed(name, format!("{state}; `--warm-up` takes shots for that long"))
        }
        WarmUpState::Warm { .. } | WarmUpState::Unclear { .. } => ExaminedItem::passed(name, state.to_string()),
    }
}

/// Checks this program and the libraries that it uses.
pub(super) fn program() -> ExaminedItem {
    let version = env!("CARGO_PKG_VERSION");
    match opencv::core::get_version_string() {
        Ok(opencv) => ExaminedItem::passed("program", format!("panelprep {version} with OpenCV {opencv}")),
        Err(error) => ExaminedItem::failed(
            "program",
            format!("panelprep {version}, but OpenCV does not report its version: {error}"),
            "reinstall the Debian package libopencv-dev",
        ),
    }
}

/// Checks whether a time server sets the clock.
pub(super) fn check_time_sync() -> ExaminedItem {
    let asked = Command::new("timedatectl").args(["show", "--property=NTPSynchronized", "--value"]).output();
    let said = asked.ok().filter(|output| output.status.success());
    judge_time_sync(said.and_then(|output| match output.stdout.trim_ascii() {
        b"yes" => Some(true),
        b"no" => Some(false),
        _ => None,
    }))
}

/// Checks that nothing in the store was written in the future; `None` if there is no store.
pub(super) fn check_clock_order(store: &Path) -> Option<ExaminedItem> {
    let newest = fs::read_dir(store).ok()?.filter_map(|entry| {
        let written = entry.ok()?.metadata().ok()?.modified().ok()?;
        i64::try_from(written.duration_since(UNIX_EPOCH).ok()?.as_secs()).ok()
    });
    Some(judge_clock_order(newest.max()?, now_unix_s()))
}

/// Checks the free space at the present or future path of the store.
pub(super) fn disk(store: &Path) -> ExaminedItem {
    let whole = std::path::absolute(store).unwrap_or_else(|_| store.to_owned());
    let there: Option<PathBuf> = whole.ancestors().find(|folder| folder.is_dir()).map(Path::to_owned);
    let advice = "set `store` in the cell's file to a folder that this user may write";
    let Some(folder) = there else {
        return ExaminedItem::failed("disk", format!("no part of {} exists", whole.display()), advice);
    };
    if rustix::fs::access(&folder, rustix::fs::Access::WRITE_OK).is_err() {
        return ExaminedItem::failed(
            "disk",
            format!("this user has no permission to write {}", folder.display()),
            advice,
        );
    }
    match free_mb(&folder) {
        Ok(free_mb) => judge_disk(&folder.display().to_string(), free_mb),
        Err(error) => ExaminedItem::failed("disk", format!("{}: {error}", folder.display()), advice),
    }
}

/// Reports the recordings in the store, which are not removed automatically; `None` if there are none.
pub(super) fn recordings(store: &Path) -> Option<ExaminedItem> {
    let folder = recordings_folder(store);
    let bytes = |entry: std::io::Result<fs::DirEntry>| Some(entry.ok()?.metadata().ok()?.len());
    let sizes: Vec<u64> = fs::read_dir(&folder).ok()?.filter_map(bytes).collect();
    let (count, mb) = (sizes.len(), sizes.iter().sum::<u64>() / 1_000_000);
    let found =
        format!("{count} recordings, {mb} MB, in {}; recordings stay until you remove them", folder.display());
    (count > 0).then(|| ExaminedItem::passed("recordings", found))
}

/// Finds the drivers of graphics processors that the kernel has loaded.
pub(super) fn graphics_processor() -> ExaminedItem {
    let devices = fs::read_to_string("/proc/devices").ok();
    judge_graphics_processor(devices.as_deref(), Path::new("/dev/nvidia-uvm").exists())
}

/// Compares the kernel's largest receive buffer with what a picture of this size needs.
pub(super) fn receive_buffer(size_px: Option<[usize; 2]>, packet_bytes: u16) -> ExaminedItem {
    let text = fs::read_to_string("/proc/sys/net/core/rmem_max").ok();
    let needed = socket_buffer_bytes(size_px.unwrap_or_default(), packet_bytes);
    judge_receive_buffer(text.and_then(|text| text.trim().parse().ok()), needed, size_px)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests the device names of drivers of version 550 and later, and those of older versions.
    #[test]
    fn a_graphics_processor_is_found_by_its_driver_name() {
        let listed = |names: &str| {
            let lines: String = names.split(' ').map(|name| format!("195 {name}\n")).collect();
            let text = format!("Character devices:\n  1 mem\n{lines}\nBlock devices:\n  8 sd\n253 nvidia\n");
            judge_graphics_processor(Some(&text), true)
        };
        assert!(listed("nvidia nvidia-modeset nvidiactl nvidia-uvm drm").is_passed());
        assert!(listed("nvidia-frontend nvidia-uvm").is_passed());
        let unloaded = listed("nvidia nvidiactl drm");
        assert!(!unloaded.is_passed() && unloaded.advice.contains("modprobe nvidia-uvm"), "{unloaded:?}");
        assert!(listed("drm").found.contains("no NVIDIA driver"));
        let none = listed("tty");
        assert!(
            !none.is_passed() && none.found.contains("neither nvidia nor drm"),
            "{none:?}: a block device is none"
        );
        assert!(!judge_graphics_processor(None, true).is_passed());
        let nodeless = judge_graphics_processor(Some("Character devices:\n195 nvidia\n508 nvidia-uvm\n"), false);
        assert!(!nodeless.is_passed() && nodeless.advice.contains("nvidia-modprobe -c 0 -u"), "{nodeless:?}");
    }

    /// Expected results, calculated by hand: the sample settings have exposure times of 10 and 20 ms. 20 ms are 2.4
    /// flicker periods of a lamp on 60 Hz mains.
    #[test]
    fn a_lamp_that_flickers_is_reported_with_the_settings_that_do_not_fit() {
        let files =
            [include_str!("../../../../config/zivid/scan.yml"), include_str!("../../../../config/zivid/film.yml")];
        let settings =
            files.map(|text| ZividSettings::read("f", text).unwrap_or_else(|problems| panic!("{problems}")));
        let told =
            |flicker, frequency: &str| judge_light(&Light { flicker, frequency: frequency.to_owned() }, &settings);
        assert!(told(Flicker::None, "").is_passed());
        let fits = told(Flicker::Grid50Hz, "100.02");
        assert!(
            fits.is_passed() && fits.found.starts_with("flickers like lamps on mains of 50 Hz (100.02 Hz)"),
            "{fits:?}"
        );
        let other = told(Flicker::Grid60Hz, "120");
        assert!(
            !other.is_passed() && other.advice.contains("settings and settings_2d a multiple of 8333 µs"),
            "{other:?}"
        );
        assert!(!told(Flicker::Unknown, "").is_passed());
        let doubt = check_warm_up(WarmUpState::NoReadings { followed_s: 61.0 });
        assert!(doubt.is_passed() && doubt.found.contains("recorded for 1 of 10 min"), "{doubt:?}");
        assert!(!check_warm_up(WarmUpState::Changing { rise_c_per_min: 0.8 }).is_passed());
    }

    #[test]
    fn a_full_disk_and_a_small_buffer_state_what_to_do() {
        assert!(
            judge_disk("store", MIN_FREE_SPACE_MB).is_passed()
                && judge_disk("store", 50_000).found.starts_with("50000 MB free")
        );
        let full = judge_disk("store", MIN_FREE_SPACE_MB - 1);
        assert!(!full.is_passed() && full.advice.contains("1000 MB"));
        let alarm = |free_mb| judge_disk_space("store", free_mb).map(|reason| reason.code.into_owned());
        let codes = [MIN_FREE_SPACE_MB - 1, MIN_FREE_SPACE_MB, MIN_FREE_MB].map(alarm);
        assert_eq!(codes, [Some("disk_full".to_owned()), Some("disk_scarce".to_owned()), None]);
        let buffer = |largest| judge_receive_buffer(largest, 20_874_880, Some([5_472, 3_648]));
        assert!(buffer(Some(20_874_880)).is_passed() && buffer(Some(20_874_880)).found.contains("5472×3648"));
        for small in [Some(8_388_608), None] {
            let check = buffer(small);
            assert!(!check.is_passed() && check.advice.contains("net.core.rmem_max = 20874880"), "{check:?}");
        }
    }

    /// Expected result, calculated by hand: an entry at 10:02 is two minutes ahead of the clock at 10:00, more than the
    /// limit of one minute.
    #[test]
    fn a_clock_that_was_set_back_is_reported() {
        assert!(
            judge_clock_order(36_060, 36_000).is_passed()
                && judge_clock_order(0, 36_000).found.contains("10.0 h ago")
        );
        let behind = judge_clock_order(36_120, 36_000);
        assert!(!behind.is_passed() && behind.found.contains("0.0 h ahead"));
    }
}
