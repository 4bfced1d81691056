//! A camera that runs freely.

use super::*;

/// Aravis's fake camera numbers its frames from 65401 on: after 134 frames the numbers begin again at 1.
#[test]
fn numbers_begin_again_and_no_frame_is_lost() {
    let _alone = alone();
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

/// Eight seconds of full-size pictures of the simulated cell: each accepted picture equals an exposure byte by
/// byte, and the missing pictures between them are counted.
#[test]
fn full_pictures_keep_their_integrity() {
    let _alone = alone();
    let format = PixelFormat::BayerRG8;
    let full = [2048, 1536];
    // If the system's sockets have no room for a full picture, a smaller picture is used.
    let room = rmem_max().is_none_or(|given| given >= burst_bytes(full, PACKET_BYTES));
    let size_px = if room { full } else { [256, 192] };
    let raw = tiled(size_px, format);
    let loopback = loopback(size_px, format, numbered(raw.clone()));
    let exposing = ExposureMode::FreeRunning { frames_per_s: 5.0 };
    let mut camera =
        GigeCamera::open(Settings { exposure_mode: exposing, ..settings(size_px, format) }).expect("a thread");
    let mut next = || loop {
        match camera.picture() {
            // A busy machine may be late, or deliver incomplete pictures; those are counted.
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

/// Returns the simulated cell's pictures, repeated beside and below each other until they fill the size.
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
