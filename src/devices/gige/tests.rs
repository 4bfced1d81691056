//! Tests the driver with Aravis's fake camera: control and stream packets over the loopback interface, single pictures
//! on demand, and a free-running camera.

mod faults;

use super::*;
use panelprep_base::geometry::ColorPicture;
use panelprep_sim as sim;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Only one fake camera can use the port at a time.
static PORT: Mutex<()> = Mutex::new(());

pub(crate) fn lock_port() -> MutexGuard<'static, ()> {
    PORT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Starts the loopback camera. Several attempts are made, because another program may still be releasing the port.
fn loopback<F: Fn(u64, &mut [u8]) + Send + Sync + Clone + 'static>(
    size_px: [usize; 2],
    format: PixelFormat,
    fill: F,
) -> LoopbackCamera {
    let begun = Instant::now();
    loop {
        match LoopbackCamera::start("T1", size_px, format, Box::new(fill.clone())) {
            Err(LoopbackError::Taken) if begun.elapsed() < Duration::from_secs(300) => {
                std::thread::sleep(Duration::from_millis(200));
            }
            started => return started.unwrap_or_else(|error| panic!("{error}")),
        }
    }
}

fn settings(size_px: [usize; 2], format: PixelFormat) -> Settings {
    Settings {
        selector: CameraSelector::Address(LOOPBACK_ADDRESS.to_owned()),
        serial: Some("T1".to_owned()),
        user_set: "Default".to_owned(),
        size_px,
        format,
        exposure_us: None,
        gain_db: None,
        exposure_mode: ExposureMode::Triggered,
        packet_bytes: PACKET_BYTES,
        may_repeat: false,
    }
}

/// Each feature of a Triton that this program sets is set in Aravis and in the camera. Expected values, calculated by
/// hand: an exposure of 100 ms is nine tenths of the period 111.1 ms. Before, the camera's rate was 25 pictures per
/// second, at which the exposure is at most 40 ms.
#[test]
fn each_feature_of_a_camera_is_set() {
    let _alone = lock_port();
    let size_px = [64, 48];
    let raw = vec![vec![7; 64 * 48]];
    let loopback = loopback(size_px, PixelFormat::BayerRG8, numbered(raw));
    for on in [Register::ChunkModeActive, Register::PtpEnable, Register::ExposureAuto, Register::BalanceWhiteAuto] {
        loopback.write(on, 1);
    }
    loopback.write(Register::GainAuto, 2);
    let settings = Settings {
        user_set: "UserSet1".to_owned(),
        exposure_us: Some(100_000.0),
        gain_db: Some(3.0),
        ..settings(size_px, PixelFormat::BayerRG8)
    };
    let mut camera = GigeCamera::open(settings).expect("a thread");
    let frame = camera.picture().unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(frame.camera_c, Some(31.5));
    let held = |register| loopback.register(register).expect("a register");
    for (register, expected) in [
        (Register::UserSetSelector, 1),
        (Register::UserSetLoad, 1),
        (Register::ChunkModeActive, 0),
        (Register::PtpEnable, 0),
        (Register::ExposureAuto, 0),
        (Register::GainAuto, 0),
        (Register::BalanceWhiteAuto, 0),
        (Register::AcquisitionFrameRateEnable, 1),
        (Register::FramePeriod, 111_111),
        (Register::ExposureTime, 100_000),
        (Register::Gain, 30),
    ] {
        assert_eq!(held(register), expected, "{register:?}");
    }
    assert_eq!(camera.statistics().unarmed, 0);
}

/// Waits until this condition is true.
fn wait_for(what: &str, mut there: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !there() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{what} does not come");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Returns pictures of the simulated flange camera, at a quarter of its size.
fn flange_pictures() -> Vec<ColorPicture> {
    let cell = sim::Cell::new(1, sim::Scene::Good, 4);
    let views = cell.corner_views();
    views.iter().map(|view| cell.flange_picture(&view.base_from_flange, sim::PanelPosition::Nominal)).collect()
}

/// Returns a function that supplies these pictures in turn, with the number of the exposure in the first eight bytes.
fn numbered(pictures: Vec<Vec<u8>>) -> impl Fn(u64, &mut [u8]) + Send + Sync + Clone + 'static {
    move |exposure, pixels| {
        let shown = &pictures[exposure as usize % pictures.len()];
        let both = shown.len().min(pixels.len());
        pixels[..both].copy_from_slice(&shown[..both]);
        pixels[..8].copy_from_slice(&exposure.to_be_bytes());
    }
}

/// Returns the number of the exposure that a frame shows. Fails if any byte of the frame differs from that exposure.
fn exposure_of(frame: &Frame, pictures: &[Vec<u8>]) -> u64 {
    let number = u64::from_be_bytes(frame.pixels[..8].try_into().expect("eight bytes"));
    let mut sent = vec![0; frame.pixels.len()];
    numbered(pictures.to_vec())(number, &mut sent);
    assert!(frame.pixels == sent, "frame {} differs from exposure {number}", frame.facts.id);
    number
}

/// Each picture of the simulated cell, in colour and in monochrome, is received exactly as it was sent.
#[test]
fn single_pictures_are_received_byte_for_byte() {
    let _alone = lock_port();
    let pictures = flange_pictures();
    let size_px = [pictures[0].width, pictures[0].height];
    for format in [PixelFormat::BayerRG8, PixelFormat::BayerGB8, PixelFormat::Mono8] {
        let raw: Vec<Vec<u8>> = pictures.iter().map(|picture| mosaic(picture, format)).collect();
        let loopback = loopback(size_px, format, numbered(raw.clone()));
        // If a serial number is given, the camera is found by a search.
        let settings = Settings { selector: CameraSelector::Serial("T1".to_owned()), ..settings(size_px, format) };
        let mut camera = GigeCamera::open(settings).expect("a thread");
        camera.check_ready().unwrap_or_else(|error| panic!("{error}"));
        let before = loopback.exposures();
        for still in 0..4 {
            let frame = camera.picture().unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(exposure_of(&frame, &raw), before + still, "the exposure that was asked for");
            assert_eq!((frame.facts.size_px, frame.facts.format), (size_px, format.code()));
            assert!(demosaic(&frame.pixels, size_px, format).is_some());
        }
        let counted = camera.statistics();
        assert_eq!((counted.accepted, counted.connections, counted.losses), (4, 1, 0), "{counted}");
        drop(camera);
    }
}

/// The frame numbers of Aravis's fake camera start at 65401: after 134 frames they wrap to 1.
#[test]
fn frame_numbers_begin_again_and_no_frame_is_lost() {
    let _alone = lock_port();
    let (size_px, format) = ([64, 48], PixelFormat::Mono8);
    let raw = vec![(0..64 * 48).map(|pixel| (pixel % 251) as u8).collect::<Vec<u8>>()];
    let _loopback = loopback(size_px, format, numbered(raw.clone()));
    let exposing = ExposureMode::FreeRunning { frames_per_s: 50.0 };
    let mut camera =
        GigeCamera::open(Settings { exposure_mode: exposing, ..settings(size_px, format) }).expect("a thread");
    let mut before: Option<(u64, u64)> = None;
    let mut wrapped = false;
    for _ in 0..180 {
        let frame = camera.picture().unwrap_or_else(|error| panic!("{error}"));
        let (id, exposure) = (frame.facts.id, exposure_of(&frame, &raw));
        if let Some((last_id, last_exposure)) = before {
            assert_eq!(frames_ahead(last_id, id), Some(exposure - last_exposure));
            wrapped |= id < last_id;
        }
        before = Some((id, exposure));
    }
    assert!(wrapped, "{before:?}");
    assert_eq!(camera.statistics().refused, 0, "{}", camera.statistics());
}

/// Full-size pictures of the simulated cell for eight seconds: each accepted picture equals its exposure byte by byte,
/// and the missing pictures in between are counted.
#[test]
fn full_pictures_keep_their_integrity() {
    let _alone = lock_port();
    let format = PixelFormat::BayerRG8;
    let full = [2048, 1536];
    // If the operating system's socket buffers have no room for a full picture, a smaller picture is used.
    let room = rmem_max().is_none_or(|given| given >= burst_bytes(full, PACKET_BYTES));
    let size_px = if room { full } else { [256, 192] };
    let raw = tiled(size_px, format);
    let loopback = loopback(size_px, format, numbered(raw.clone()));
    let exposing = ExposureMode::FreeRunning { frames_per_s: 5.0 };
    let mut camera =
        GigeCamera::open(Settings { exposure_mode: exposing, ..settings(size_px, format) }).expect("a thread");
    let mut next = || loop {
        match camera.picture() {
            // On a busy computer pictures may be late or incomplete; these are counted.
            Err(GigeError::Timeout { .. }) => {}
            taken => break (taken.unwrap_or_else(|error| panic!("{error}")), camera.statistics()),
        }
    };
    let (begun, (frame, before)) = (Instant::now(), next());
    let first = exposure_of(&frame, &raw);
    let (mut last, mut counted) = (first, before);
    while begun.elapsed() < Duration::from_secs(8) || counted.accepted < 20 {
        assert!(begun.elapsed() < Duration::from_secs(180), "{counted}");
        let (frame, now) = next();
        (last, counted) = (exposure_of(&frame, &raw), now);
    }
    eprintln!("{}×{}: {} exposures; {counted}", size_px[0], size_px[1], last - first + 1);
    let seen = |counted: Statistics| counted.accepted + counted.refused + counted.lost;
    assert_eq!(seen(counted) - seen(before), last - first, "every exposure is accounted for: {counted}");
    assert!(loopback.exposures() > last);
}

/// Returns the pictures of the simulated cell, tiled until they fill this size.
fn tiled([width, height]: [usize; 2], format: PixelFormat) -> Vec<Vec<u8>> {
    let tile = |picture: &ColorPicture| {
        let at = |index: usize| {
            let (column, row) = (index % width % picture.width, index / width % picture.height);
            picture.rgb[row * picture.width + column]
        };
        let whole = ColorPicture { width, height, rgb: (0..width * height).map(at).collect() };
        mosaic(&whole, format)
    };
    flange_pictures().iter().map(tile).collect()
}
