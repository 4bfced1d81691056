//! Checks whether the received shot is the one that was requested. A pure function: every doubt is a fault, and
//! nothing is corrected.

use super::fault::ZividFault;
use super::message::{SettingsHash, ShotInfo, Size};
use super::sensor::ShotPlanes;

/// The expected values with which a shot is compared.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectedShot {
    /// The request, as text.
    pub what: &'static str,
    /// Hash of the settings with which the shot must be taken.
    pub settings: SettingsHash,
    /// Serial number of the camera.
    pub serial: String,
    /// The size for which the camera was calibrated.
    pub size: Size,
    /// Time of the request, ns of the monotonic clock: nothing older counts.
    pub from_ns: u64,
    /// Time at which the shot had arrived.
    pub until_ns: u64,
    /// The number of the previous shot.
    pub last_number: u64,
    /// The checksum of the previous shot; `None` for a file camera, which delivers the same shot repeatedly.
    pub last_sum: Option<u32>,
}

/// Smallest percentage of a shot's points that must be present. The points needed for a panel are checked when it is
/// located; this limit detects a camera that sees nothing.
pub const MIN_POINTS_PERCENT: f64 = 1.0;
/// Longest pause for cooling while a film is taken, ms. A 3D shot of a stationary scene tolerates any pause.
pub const MAX_THROTTLED_MS: f64 = 500.0;

/// Checks the data of a shot or picture against the request; `sum` is the checksum of its payload.
///
/// # Errors
/// If it is from another camera, has another size or other settings, is old, or is the same as before.
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
/// If there are almost no points, or some coordinates are infinite, which no camera measures.
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

/// Checks whether a film may contain a picture for which the camera paused.
///
/// # Errors
/// If the pause was too long.
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

    /// Calculated by hand: 1 of 100 points is 1 %, which is enough; 0 is not.
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
