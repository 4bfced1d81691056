//! The acceptance check of a received scan or picture: is it the one that was requested? This is a pure function: every
//! doubt is a fault, and nothing is corrected.

use super::fault::ZividFault;
use super::message::{SettingsHash, ShotInfo, Size};
use super::sensor::ShotPlanes;

/// The expected properties of a requested scan or picture.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectedShot {
    /// The request, as a text for messages.
    pub what: &'static str,
    /// The hash of the settings for the capture.
    pub settings: SettingsHash,
    /// Serial number of the camera.
    pub serial: String,
    /// The picture size for which the camera was calibrated.
    pub size: Size,
    /// Time of the request, ns of the monotonic clock; data that are older are refused.
    pub from_ns: u64,
    /// Time at which the data were received completely, ns of the monotonic clock.
    pub until_ns: u64,
    /// The number of the previous scan or picture.
    pub last_number: u64,
    /// The checksum of the previous scan or picture; `None` for a file camera, which always delivers the same data.
    pub last_sum: Option<u32>,
}

/// Minimum percentage of pixels with a point. This limit detects a camera that sees nothing; the number of points on
/// the panel is checked when the panel is located.
pub const MIN_POINTS_PERCENT: f64 = 1.0;
/// Maximum pause for cooling during a clip of the water film, ms. A 3D scan of a static scene tolerates any pause.
pub const MAX_THROTTLED_MS: f64 = 500.0;

/// Compares the metadata of a scan or picture with the request; `sum` is the checksum of its payload.
///
/// # Errors
/// If the data are from another camera, have another size or other settings, are older than the request, or are equal
/// to the previous data.
pub fn accept(taken: &ShotInfo, sum: u32, asked: &ExpectedShot) -> Result<(), ZividFault> {
    if taken.serial != asked.serial {
        let (found, expected) = (taken.serial.clone(), asked.serial.clone());
        return Err(ZividFault::WrongCamera { found, expected });
    }
    if taken.size != asked.size {
        let px = |size: Size| [size.width, size.height];
        return Err(ZividFault::WrongSize {
            what: asked.what,
            found_px: px(taken.size),
            expected_px: px(asked.size),
        });
    }
    if taken.settings != asked.settings {
        let message = format!(
            "a shot with settings {} was received, but settings {} were requested",
            taken.settings, asked.settings
        );
        return Err(ZividFault::Settings { what: "the settings of the received shot", message });
    }
    let in_order = asked.from_ns <= taken.begun_ns
        && taken.begun_ns <= taken.exposed_ns
        && taken.exposed_ns <= taken.ready_ns
        && taken.ready_ns <= asked.until_ns;
    if !in_order {
        let ShotInfo { begun_ns, exposed_ns, ready_ns, .. } = taken;
        let (from_ns, until_ns) = (asked.from_ns, asked.until_ns);
        return Err(ZividFault::Frozen(format!(
            "a shot started at {begun_ns} ns, exposed until {exposed_ns} ns and ready at {ready_ns} ns is not between \
             request and response, {from_ns} to {until_ns} ns"
        )));
    }
    if taken.number <= asked.last_number {
        let (found, last) = (taken.number, asked.last_number);
        return Err(ZividFault::Frozen(format!("shot {found} was received after shot {last}")));
    }
    if asked.last_sum == Some(sum) {
        let number = taken.number;
        return Err(ZividFault::Frozen(format!("shot {number} has exactly the same data as the previous shot")));
    }
    Ok(())
}

/// Checks the coordinates of the points.
///
/// # Errors
/// If fewer than [`MIN_POINTS_PERCENT`] of the pixels have a point, or a coordinate is infinite, which no camera
/// measures.
pub fn accept_points(planes: &ShotPlanes) -> Result<(), ZividFault> {
    let (mut there, mut infinite) = (0_usize, 0_usize);
    for point in &planes.points_mm {
        there += usize::from(point.iter().all(|number| number.is_finite()));
        infinite += usize::from(point.iter().any(|number| number.is_infinite()));
    }
    if infinite > 0 {
        return Err(ZividFault::NotFinite(infinite));
    }
    let found_percent = 100.0 * there as f64 / planes.points_mm.len().max(1) as f64;
    match found_percent >= MIN_POINTS_PERCENT {
        true => Ok(()),
        false => Err(ZividFault::NoPoints { found_percent, needed_percent: MIN_POINTS_PERCENT }),
    }
}

/// Checks the pause of the camera before a picture of a clip.
///
/// # Errors
/// If the pause was longer than [`MAX_THROTTLED_MS`].
pub fn accept_pause(taken: &ShotInfo, during: &'static str) -> Result<(), ZividFault> {
    let (paused_ms, allowed_ms, lens_c) = (taken.throttled_ms, MAX_THROTTLED_MS, taken.lens_c);
    match paused_ms <= allowed_ms {
        true => Ok(()),
        false => Err(ZividFault::Throttled { during, paused_ms, allowed_ms, lens_c }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 4, height: 2 };

    fn asked() -> ExpectedShot {
        ExpectedShot {
            what: "a 3D shot",
            settings: "abc".to_owned(),
            serial: "12".to_owned(),
            size: SIZE,
            from_ns: 100,
            until_ns: 200,
            last_number: 6,
            last_sum: Some(1),
        }
    }

    fn taken() -> ShotInfo {
        ShotInfo {
            size: SIZE,
            settings: "abc".to_owned(),
            serial: "12".to_owned(),
            number: 7,
            begun_ns: 100,
            exposed_ns: 150,
            ready_ns: 200,
            throttled_ms: 500.0,
            lens_c: Some(41.0),
            dropped: 0,
        }
    }

    #[test]
    fn a_requested_shot_is_accepted_at_its_limits() {
        assert_eq!(accept(&taken(), 2, &asked()), Ok(()));
        assert_eq!(accept_pause(&taken(), "a picture"), Ok(()));
    }

    #[test]
    fn each_doubt_is_reported_as_its_fault() {
        let row = |change: &dyn Fn(&mut ShotInfo)| {
            let mut taken = taken();
            change(&mut taken);
            accept(&taken, 2, &asked()).map_err(|fault| fault.row())
        };
        assert_eq!(row(&|taken| taken.serial = "13".to_owned()), Err("C5"));
        assert_eq!(row(&|taken| taken.size = Size { width: 2, height: 4 }), Err("C5"));
        assert_eq!(row(&|taken| taken.settings = "abd".to_owned()), Err("C5"));
        assert_eq!(row(&|taken| taken.begun_ns = 99), Err("C9"), "taken before it was asked for");
        assert_eq!(row(&|taken| taken.exposed_ns = 99), Err("C9"));
        assert_eq!(row(&|taken| taken.exposed_ns = 201), Err("C9"));
        assert_eq!(row(&|taken| taken.ready_ns = 201), Err("C9"));
        assert_eq!(row(&|taken| taken.number = 6), Err("C9"));
        assert_eq!(accept(&taken(), 1, &asked()).map_err(|fault| fault.row()), Err("C9"));
        assert_eq!(accept(&taken(), 1, &ExpectedShot { last_sum: None, ..asked() }), Ok(()), "a file camera");
        let hot = ShotInfo { throttled_ms: 500.1, ..taken() };
        let words = accept_pause(&hot, "a picture").expect_err("hot").to_string();
        assert!(
            words.starts_with("C3 the 3D camera is hot") && words.contains("lens temperature 41 °C"),
            "{words}"
        );
        assert!(accept_pause(&ShotInfo { throttled_ms: f64::NAN, ..taken() }, "a picture").is_err());
    }

    /// Expected results, calculated by hand: 1 of 100 points is 1 %, which is accepted; 0 points are refused.
    #[test]
    fn a_shot_needs_points() {
        let mut planes = ShotPlanes::with_size(Size { width: 10, height: 10 });
        planes.points_mm.fill([f32::NAN; 3]);
        let none = accept_points(&planes).expect_err("all missing").to_string();
        assert!(none.starts_with("C6 no 3D data: 0.00 % of"), "{none}");
        planes.points_mm[7] = [1.0, 2.0, 700.0];
        assert_eq!(accept_points(&planes), Ok(()));
        planes.points_mm[8] = [1.0, f32::NAN, f32::NEG_INFINITY];
        assert_eq!(accept_points(&planes), Err(ZividFault::NotFinite(1)));
    }
}
