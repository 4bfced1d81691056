//! Tests of faults during operation, and of the way in which they are reported.

use super::*;

const SIZE: [usize; 2] = [256, 192];
const FORMAT: PixelFormat = PixelFormat::BayerRG8;

fn picture() -> Vec<Vec<u8>> {
    vec![(0..SIZE[0] * SIZE[1]).map(|pixel| (pixel * 7 + pixel / SIZE[0]) as u8).collect()]
}

/// Returns the camera at the loopback interface as soon as the camera is connected.
fn open_camera() -> GigeCamera {
    let mut camera = GigeCamera::open(settings(SIZE, FORMAT)).expect("a thread");
    camera.check_ready().unwrap_or_else(|error| panic!("{error}"));
    camera
}

/// Each picture has 37 packets. If 3 % of the packets are dropped, about a third of the pictures is complete. Only
/// complete pictures are delivered.
#[test]
fn incomplete_pictures_are_retried_and_never_delivered() {
    let _alone = lock_port();
    let loopback = loopback(SIZE, FORMAT, numbered(picture()));
    let mut camera = open_camera();
    loopback.lose_packets(0.03);
    let (mut whole, mut refused) = (0, 0);
    for _ in 0..12 {
        wait_for("the camera", || camera.link_status() == LinkStatus::Connected);
        match camera.picture() {
            Ok(frame) => {
                exposure_of(&frame, &picture());
                whole += 1;
            }
            Err(
                GigeError::Refused { tries: MAX_ATTEMPTS, last: FrameRefusal::Incomplete { .. } }
                | GigeError::Timeout { .. },
            ) => {
                refused += 1;
            }
            Err(other) => panic!("{other}"),
        }
    }
    let counted = camera.statistics();
    assert_eq!(counted.accepted, whole);
    assert!(
        counted.refused > 0 && counted.retries > 0 && counted.missing_packets > 0,
        "{refused} failed; {counted}"
    );
    // After each failed picture the camera was released and connected again, so its settings were written again.
    assert_eq!(
        (counted.losses, counted.connections),
        (refused, refused + u64::from(camera.link_status() == LinkStatus::Connected))
    );
    // After the packet loss the camera works as before.
    loopback.lose_packets(0.0);
    wait_for("the camera", || camera.link_status() == LinkStatus::Connected);
    for _ in 0..3 {
        let before = loopback.exposures();
        let frame = camera.picture().unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(exposure_of(&frame, &picture()), before);
    }
}

/// If the connection to a camera is lost, the loss is reported once, and no caller waits for the camera. After the
/// reconnection the camera delivers pictures again.
#[test]
fn a_lost_camera_is_reported_once_and_reconnected() {
    let _alone = lock_port();
    let first = loopback(SIZE, FORMAT, numbered(picture()));
    let mut camera = open_camera();
    let gauge = camera.gauge();
    camera.picture().unwrap_or_else(|error| panic!("{error}"));
    drop(first);
    let lost = camera.picture().expect_err("it is gone");
    assert!(matches!(lost, GigeError::Lost { .. } | GigeError::Timeout { .. }), "{lost}");
    wait_for("the loss", || matches!(gauge.link_status(), LinkStatus::Away(_)));
    let begun = Instant::now();
    assert!(camera.picture().is_err() && camera.check_ready().is_err());
    assert!(begun.elapsed() < Duration::from_secs(1), "no caller waits for a camera that is away");
    assert_eq!(gauge.statistics().losses, 1);

    let second = loopback(SIZE, FORMAT, numbered(picture()));
    wait_for("the camera", || gauge.link_status() == LinkStatus::Connected);
    let before = second.exposures();
    let frame = camera.picture().unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(exposure_of(&frame, &picture()), before);
    let counted = camera.statistics();
    assert_eq!((counted.accepted, counted.losses, counted.connections), (2, 1, 2), "{counted}");
}

/// A camera that responds but delivers no picture is opened again, and so configured again.
#[test]
fn a_camera_without_a_picture_is_configured_again() {
    let _alone = lock_port();
    let loopback = loopback(SIZE, FORMAT, numbered(picture()));
    let mut camera = open_camera();
    camera.picture().unwrap_or_else(|error| panic!("{error}"));
    loopback.lose_packets(1.0);
    let refused = camera.picture().expect_err("nothing comes");
    assert!(matches!(refused, GigeError::Timeout { .. } | GigeError::Refused { .. }), "{refused}");
    assert_eq!(camera.check_ready(), Err(refused), "it is away for this reason");
    loopback.lose_packets(0.0);
    wait_for("the camera", || camera.link_status() == LinkStatus::Connected);
    let before = loopback.exposures();
    let frame = camera.picture().unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(exposure_of(&frame, &picture()), before);
    assert_eq!((camera.statistics().losses, camera.statistics().connections), (1, 2));
}

/// The heartbeat detects the loss even if no picture is requested.
#[test]
fn the_loss_of_an_unused_camera_is_detected() {
    let _alone = lock_port();
    let first = loopback(SIZE, FORMAT, numbered(picture()));
    let camera = open_camera();
    drop(first);
    wait_for("the loss", || matches!(camera.link_status(), LinkStatus::Away(_)));
    assert_eq!(camera.statistics().losses, 1);
}

#[test]
fn each_wrong_camera_is_refused_with_its_reason() {
    let _alone = lock_port();
    let says = |settings: Settings| {
        let mut camera = GigeCamera::open(settings).expect("a thread");
        camera.check_ready().expect_err("refused").to_string()
    };
    let nowhere = CameraSelector::Address("127.0.0.77".to_owned());
    let absent = says(Settings { selector: nowhere, ..settings(SIZE, FORMAT) });
    assert!(absent.starts_with("the GigE Vision camera at 127.0.0.77 was not found"), "{absent}");
    let _loopback = loopback(SIZE, FORMAT, numbered(picture()));
    let beside = LoopbackCamera::start("T2", SIZE, FORMAT, Box::new(numbered(picture())));
    assert_eq!(beside.err(), Some(LoopbackError::Taken), "one at a time, else a client speaks to either");
    let other = says(Settings { selector: CameraSelector::Serial("T2".to_owned()), ..settings(SIZE, FORMAT) });
    assert!(
        other.contains("serial T2 was not found: found") && other.contains("serial T1 at 127.0.0.1"),
        "{other}"
    );
    let swapped = says(Settings { serial: Some("T0".to_owned()), ..settings(SIZE, FORMAT) });
    assert!(
        swapped.starts_with("found the camera with serial T1, but the calibration is for serial T0"),
        "{swapped}"
    );
    let larger = says(settings([512, 384], FORMAT));
    assert_eq!(larger, "the camera's picture is 256×192 px, but its calibration is for 512×384 px");
    let gain = says(Settings { gain_db: Some(60.0), ..settings(SIZE, FORMAT) });
    assert!(gain.contains("does not accept Gain = 60: valid: 0 to 48"), "{gain}");
    let set = says(Settings { user_set: "UserSet7".to_owned(), ..settings(SIZE, FORMAT) });
    assert!(
        set.contains("does not accept UserSetSelector = UserSet7") && set.contains("Default, UserSet1"),
        "{set}"
    );
    // 12 s is longer than the frame period at the minimum frame rate of the camera, 0.1 pictures per second.
    let exposure = says(Settings { exposure_us: Some(12e6), ..settings(SIZE, FORMAT) });
    assert!(exposure.contains("does not accept AcquisitionFrameRate = 0.075: valid: 0.1 to 1000"), "{exposure}");
    // Another program controls the camera; here it is a second connection of this program.
    let mut first = GigeCamera::open(settings(SIZE, FORMAT)).expect("a thread");
    wait_for("the camera", || first.link_status() == LinkStatus::Connected);
    let second = GigeCamera::open(settings(SIZE, FORMAT)).expect("a thread");
    wait_for("a refusal", || matches!(second.link_status(), LinkStatus::Away(_)));
    assert!(
        matches!(second.link_status(), LinkStatus::Away(GigeError::Controlled { .. })),
        "{:?}",
        second.link_status()
    );
    // The first connection keeps control of the camera.
    exposure_of(&first.picture().unwrap_or_else(|error| panic!("{error}")), &picture());
}

/// The size of the camera's pictures is changed while the camera is in use.
#[test]
fn a_changed_picture_size_is_refused() {
    let _alone = lock_port();
    let loopback = loopback(SIZE, FORMAT, numbered(picture()));
    let mut camera = open_camera();
    camera.picture().unwrap_or_else(|error| panic!("{error}"));
    loopback.shrink_picture([128, 192]);
    let refused = camera.picture().expect_err("another size");
    assert!(
        matches!(
            &refused,
            GigeError::Refused {
                last: FrameRefusal::WrongForm { found_px: [128, 192], .. } | FrameRefusal::Incomplete { .. },
                ..
            }
        ),
        "{refused}"
    );
}

/// The camera accepts BayerRG8 but sends BayerRG12, as the documentation of the TRI032S describes. This is reported as
/// a wrong pixel format, not as packet loss.
#[test]
fn a_pixel_format_that_the_camera_changed_is_reported() {
    let _alone = lock_port();
    const BAYER_RG12: u32 = 0x0110_0011;
    let begun = Instant::now();
    let _loopback = loop {
        let fill = Box::new(numbered(picture()));
        match LoopbackCamera::start_sending("T1", SIZE, FORMAT, BAYER_RG12, fill) {
            Err(LoopbackError::Taken) if begun.elapsed() < Duration::from_secs(300) => {
                std::thread::sleep(Duration::from_millis(200));
            }
            started => break started.unwrap_or_else(|error| panic!("{error}")),
        }
    };
    let mut camera = GigeCamera::open(settings(SIZE, FORMAT)).expect("a thread");
    let told = camera.check_ready().expect_err("another format").to_string();
    assert!(told.starts_with("the camera accepted pixel format BayerRG8 but sends BayerRG12: frame "), "{told}");
    assert!(told.contains("pixel_format") && !told.contains("firewall"), "{told}");
}

/// A camera that never reports that it is ready is triggered anyway. Each wait is counted, and after the third one the
/// program does not wait any more.
#[test]
fn a_camera_that_never_reports_that_it_is_ready_is_triggered() {
    let _alone = lock_port();
    let loopback = loopback(SIZE, FORMAT, numbered(picture()));
    loopback.write(Register::TriggerArmed, 0);
    let mut camera = GigeCamera::open(settings(SIZE, FORMAT)).expect("a thread");
    for _ in 0..4 {
        let frame = camera.picture().unwrap_or_else(|error| panic!("{error}"));
        exposure_of(&frame, &picture());
    }
    assert_eq!(camera.statistics().unarmed, 3, "{}", camera.statistics());
    assert_eq!((camera.statistics().accepted, camera.statistics().losses), (4, 0));
}
