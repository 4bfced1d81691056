//! Readings that were written by hand.

use super::super::telegram::ErrorBits;
use super::*;

const LIMITS: WatchLimits = WatchLimits {
    stroke_mm: 30.0,
    band_n: 5.0,
    band_within: Duration::from_millis(150),
    contact_within: Duration::from_millis(200),
};

const PRESSED: ToolReading = ToolReading { force_n: 20.0, position_mm: 15.0, contact: true, errors: ErrorBits(0) };

fn pressing(low_n: f64, high_n: f64) -> ExpectedForce {
    ExpectedForce { force_phase: ForcePhase::Pressing, force_range_n: [low_n, high_n] }
}

/// Returns the first reason and its time; there is a reading each 50 ms.
fn first_reason(readings: impl Fn(u64) -> (ToolReading, f64, ExpectedForce)) -> Option<(u64, String)> {
    let mut watch = ForceWatch::default();
    (0..=2_000).step_by(50).find_map(|ms| {
        let (reading, contact_n, expected) = readings(ms);
        let reason = watch.evaluate((&reading, contact_n), expected, &LIMITS, Time::from_ms(ms))?;
        Some((ms, reason.code.to_string()))
    })
}

fn at(ms: u64, code: &str) -> Option<(u64, String)> {
    Some((ms, code.to_owned()))
}

/// By hand: a band of 5 N around 20 N includes 15 and 25; 25.1 N from 500 ms on is reported at 650 ms.
#[test]
fn a_force_out_of_its_band_is_reported_once_it_lasts() {
    let force = |contact_n: f64| {
        first_reason(|ms| (PRESSED, if ms < 500 { 20.0 } else { contact_n }, pressing(20.0, 20.0)))
    };
    assert_eq!((force(25.0), force(15.0)), (None, None));
    assert_eq!((force(25.1), force(14.9)), (at(650, "force_band"), at(650, "force_band")));
    // Short peaks are not reported, however many there are.
    assert_eq!(first_reason(|ms| (PRESSED, if ms % 200 < 150 { 30.0 } else { 20.0 }, pressing(20.0, 20.0))), None);
    // During the ramp from 5 N, all forces in between are as expected.
    assert_eq!(first_reason(|_| (PRESSED, 2.0, pressing(5.0, 20.0))), None);
}

#[test]
fn contact_stroke_and_errors_are_reported() {
    let lost = ToolReading { contact: false, ..PRESSED };
    let from_500 =
        |reading: ToolReading| move |ms| (if ms < 500 { PRESSED } else { reading }, 20.0, pressing(20.0, 20.0));
    assert_eq!(first_reason(from_500(lost)), at(700, "no_contact"));
    assert_eq!(
        first_reason(|_| (lost, 0.0, pressing(20.0, 20.0))),
        at(200, "no_contact"),
        "a path that never touched"
    );
    // By hand: the middle two thirds of 30 mm are 5 to 25 mm.
    for (position_mm, found) in
        [(5.01, None), (24.99, None), (4.9, at(650, "tool_stroke")), (25.1, at(650, "tool_stroke"))]
    {
        assert_eq!(first_reason(from_500(ToolReading { position_mm, ..PRESSED })), found, "{position_mm}");
    }
    assert_eq!(first_reason(from_500(ToolReading { errors: ErrorBits(1), ..PRESSED })), at(500, "tool_errors"));
}

/// During landing, less than the set-point or no contact is allowed; too much force is reported.
#[test]
fn landing_may_have_no_contact_yet_and_never_too_much() {
    let landing = ExpectedForce { force_phase: ForcePhase::Landing, force_range_n: [5.0, 5.0] };
    let air = ToolReading { contact: false, ..PRESSED };
    assert_eq!(first_reason(|_| (air, 0.0, landing)), None);
    assert_eq!(first_reason(|_| (PRESSED, 10.1, landing)), at(150, "force_band"));
    // Calculated by hand: a sixth of 30 mm is 5 mm; the tool has 600 ms to reach it.
    let held = ExpectedForce { force_phase: ForcePhase::HeldBack, force_range_n: [-30.0, -30.0] };
    let out = ToolReading { position_mm: 5.1, ..air };
    assert_eq!(first_reason(|_| (out, 0.0, held)), at(600, "tool_stuck"));
    assert_eq!(
        first_reason(|ms| (if ms < 500 { out } else { ToolReading { position_mm: 5.0, ..air } }, 0.0, held)),
        None
    );
}

#[test]
fn a_path_begins_with_a_tool_that_is_back() {
    let back = ToolReading { force_n: -30.0, position_mm: 0.2, contact: false, errors: ErrorBits(0) };
    assert_eq!(not_ready_reason(&back, 30.0), None);
    let code = |reading: ToolReading| not_ready_reason(&reading, 30.0).map(|reason| reason.code.to_string());
    assert_eq!(code(ToolReading { contact: true, ..back }).as_deref(), Some("contact_in_air"));
    assert_eq!(code(ToolReading { position_mm: 6.0, ..back }).as_deref(), Some("tool_stuck"));
    assert_eq!(code(ToolReading { errors: ErrorBits(128), ..back }).as_deref(), Some("tool_errors"));
}

/// The tool is held back and has had enough time to go back: a contact then is not with the panel, whatever the
/// force.
#[test]
fn contact_in_the_air_is_reported() {
    let held = ExpectedForce { force_phase: ForcePhase::HeldBack, force_range_n: [-30.0, -30.0] };
    let touches = ToolReading { position_mm: 5.0, contact: true, ..PRESSED };
    assert_eq!(first_reason(|_| (touches, 200.0, held)), at(600, "contact_in_air"));
}
