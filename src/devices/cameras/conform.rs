//! Conformance tests for all scanners; they are run on the simulated scanner and on the Zivid's.

use super::Scanner;
use panelprep_base::geometry::PinholeCamera;
use std::collections::BTreeSet;

/// Checks 3D scans: they have the calibrated size and colours, each point projects to its own pixel, and their times
/// increase.
pub fn check_shot(scanner: &mut dyn Scanner, lens: &PinholeCamera) {
    scanner.wait_warmed_up();
    scanner.check_ready().expect("it would deliver");
    let mut last_s = f64::NEG_INFINITY;
    for _ in 0..2 {
        let shot = scanner.capture_3d().expect("a shot");
        let cloud = &shot.cloud;
        assert_eq!((cloud.width(), cloud.height()), (lens.width_px, lens.height_px));
        assert!(shot.time_s >= last_s, "{} after {last_s}", shot.time_s);
        last_s = shot.time_s;
        let (mut there, mut colors) = (0, BTreeSet::new());
        for (index, point) in cloud.valid_points() {
            let pixel = lens.project(point).expect("before the camera");
            let (column, row) = ((index % lens.width_px) as f64, (index / lens.width_px) as f64);
            let off_px = (pixel.u - column).hypot(pixel.v - row);
            assert!(off_px < 0.6, "the point of pixel {column}, {row} is projected {off_px} px beside it");
            assert!((100.0..5_000.0).contains(&point.mm.z), "{point:?}");
            there += 1;
            colors.insert(cloud.color_at(index));
        }
        let pixels = lens.width_px * lens.height_px;
        assert!(
            there > pixels / 100 && there < pixels,
            "{there} of {pixels} pixels have a point: some have one, some have none"
        );
        assert!(colors.len() > 50, "{} colours: a shot without colours has only one", colors.len());
    }
}

/// Checks colour pictures: they have the calibrated size, are not uniform, and their times increase.
pub fn check_pictures(scanner: &mut dyn Scanner, lens: &PinholeCamera) {
    let mut last_s = f64::NEG_INFINITY;
    for _ in 0..3 {
        let taken = scanner.capture_2d().expect("a picture");
        assert_eq!((taken.picture.width, taken.picture.height), (lens.width_px, lens.height_px));
        assert_eq!(taken.picture.rgb.len(), lens.width_px * lens.height_px);
        assert!(taken.time_s >= last_s, "{} after {last_s}", taken.time_s);
        last_s = taken.time_s;
        let colors: BTreeSet<_> = taken.picture.rgb.iter().collect();
        assert!(colors.len() > 50, "{} colours", colors.len());
    }
}

/// Checks a clip: the times of its pictures increase and are close to its start time, and another capture ends the
/// clip. `pass` advances the time.
pub fn check_clips(scanner: &mut dyn Scanner, lens: &PinholeCamera, mut pass: impl FnMut()) {
    assert!(scanner.next_clip_picture().is_err() && scanner.end_clip().is_err(), "none has begun");
    let began_s = scanner.begin_clip(10.0).expect("begun");
    let (mut last_s, mut taken) = (f64::NEG_INFINITY, 0);
    while taken < 4 {
        let Some(next) = scanner.next_clip_picture().expect("it continues") else {
            pass();
            continue;
        };
        assert_eq!((next.picture.width, next.picture.height), (lens.width_px, lens.height_px));
        assert!(next.time_s > last_s, "{} after {last_s}", next.time_s);
        assert!(
            (next.time_s - began_s).abs() < 60.0,
            "begun at {began_s} s, taken at {} s: both times are of one clock",
            next.time_s
        );
        (last_s, taken) = (next.time_s, taken + 1);
    }
    scanner.end_clip().expect("ended");
    assert!(scanner.next_clip_picture().is_err(), "it has ended");
    scanner.begin_clip(10.0).expect("begun again");
    let between = scanner.capture_2d().expect("a picture");
    assert!(between.time_s >= last_s, "all times are of one clock");
    assert!(scanner.next_clip_picture().is_err(), "a picture ends a clip");
}
