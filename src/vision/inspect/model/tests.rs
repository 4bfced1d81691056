//! Tests of the film model alone, on 64 × 64 px: dry 100 levels, wet 60 levels.
//!
//! Expected values, calculated by hand: a break returns to at least 80 levels (`damp` 0.8), the gap to the film is 20
//! levels, and the noise is that of rounding, 0.35 levels. A pixel is bare from 77.9 levels, which is 80 minus six
//! times the noise, up to 9/8 of 100 and the rounding.

use super::*;

const SIDE: usize = 64;
const TERMS: FilmParameters = FilmParameters { channel_weights: [1.0; 3], persist_s: 0.6, damp: 0.8 };
/// Columns and rows of a place of 100 px.
const PLACE: [std::ops::Range<usize>; 2] = [30..40, 30..40];

fn picture(level: impl Fn(usize, usize) -> u8) -> ColorPicture {
    let rgb = (0..SIDE * SIDE).map(|index| [level(index % SIDE, index / SIDE); 3]).collect();
    ColorPicture { width: SIDE, height: SIDE, rgb }
}

/// Returns a picture of the film at 60 levels, with this level at `PLACE`.
fn film(place: u8) -> ColorPicture {
    picture(|column, row| if PLACE[0].contains(&column) && PLACE[1].contains(&row) { place } else { 60 })
}

fn model(sanded: &[bool], terms: FilmParameters) -> Model {
    let window = Window { left: 0, top: 0, width: SIDE, height: SIDE };
    let mut model = Model::new(window, &[true; SIDE * SIDE], sanded, terms);
    model.add_dry(&picture(|_, _| 100));
    model
}

/// Judges pictures with these times and levels, and returns the number of pixels that broke.
fn show(model: &mut Model, times_s: impl Iterator<Item = f64>, level: impl Fn(f64) -> u8) -> usize {
    let one = |time_s: f64| {
        let picture = film(level(time_s));
        model.measure_wet(&picture);
        model.judge_last(&picture, time_s).len()
    };
    times_s.map(one).sum()
}

/// Returns whether the place broke and whether it was seen, after 2 s of film and 2 s at this level, at five pictures
/// per second.
fn after_film(model: &mut Model, level: u8) -> (bool, bool) {
    let times_s = (0..20).map(|picture| 0.2 * f64::from(picture));
    let broke = show(model, times_s, |time_s| if time_s < 2.0 { 60 } else { level });
    assert!(broke == 0 || broke == 100, "all of the place or nothing: {broke}");
    (broke == 100, model.was_observed(35 * SIDE + 35))
}

#[test]
fn pixels_are_classified_as_bare_film_or_neither() {
    let found = |level: u8| after_film(&mut model(&[], TERMS), level);
    for level in [78, 80, 100, 112] {
        assert_eq!(found(level), (true, true), "{level}");
    }
    assert_eq!(found(61), (false, true), "film");
    // A steady brightness that is neither film nor bare, reached within a moment: the state of the place is unknown.
    for level in [40, 76, 120] {
        assert_eq!(found(level), (false, false), "{level}");
    }
}

/// Expected values, calculated by hand: 74 levels are beyond the middle of the gap, 80 − 20/2 = 70, and below 77.9, the
/// minimum of a bare pixel. A place whose brightness drifts there within 1.5 s does not pass if it stays there for more
/// than 3 s.
#[test]
fn a_place_that_stays_between_film_and_bare_is_not_seen() {
    let seen = |stays_s: f64| {
        let mut model = model(&[], TERMS);
        let level = |time_s: f64| match time_s - 2.0 {
            since_s if since_s < 0.0 || since_s > 1.5 + stays_s => 60,
            since_s => 60 + (14.0 * (since_s / 1.5).min(1.0)).round() as u8,
        };
        let times_s = (0..60).map(|picture| 0.2 * f64::from(picture));
        assert_eq!(show(&mut model, times_s, level), 0, "it is not bare");
        model.was_observed(35 * SIDE + 35)
    };
    assert!(seen(2.0) && !seen(5.0));
}

/// 74 levels are between film and bare, and `persist_s` is 0.6 s. A place with this brightness in the last 2 s, or in
/// the last four pictures, does not pass. A place with this brightness in the last two pictures, for 0.4 s, passes.
#[test]
fn a_place_that_ends_between_film_and_bare_is_not_seen() {
    let seen = |pictures: u32| {
        let mut model = model(&[], TERMS);
        let times_s = (0..60).map(|picture| 0.2 * f64::from(picture));
        let from_s = 0.2 * f64::from(60 - pictures) - 0.1;
        assert_eq!(show(&mut model, times_s, |time_s| if time_s < from_s { 60 } else { 74 }), 0, "it is not bare");
        model.was_observed(35 * SIDE + 35)
    };
    assert_eq!([2, 4, 10].map(seen), [true, false, false]);
}

/// Expected values, calculated by hand for a film at 60 of 100 levels: half of the change by a break is (80/60 − 1)/2 =
/// 1/6 of the film brightness, 10 levels up or down. A bare place is at most (1/0.6)^1.3 · 9/8 = 2.186 times as bright
/// as its film, which is 131 levels.
#[test]
fn a_sanded_place_is_compared_only_with_its_film_brightness() {
    let sanded: Vec<bool> = (0..SIDE * SIDE).map(|index| index / SIDE >= 20).collect();
    for (level, is_open) in
        [(68, false), (52, false), (72, true), (48, true), (90, true), (128, true), (134, false)]
    {
        assert_eq!(after_film(&mut model(&sanded, TERMS), level).0, is_open, "{level}");
    }
    // The dry reference from before the sanding is not used: a sanded place whose film has exactly this brightness is
    // film.
    let mut dark = model(&sanded, TERMS);
    let times_s = (0..20).map(|picture| 0.2 * f64::from(picture));
    assert_eq!((show(&mut dark, times_s, |_| 100), dark.ever_wet(35 * SIDE + 35)), (0, true));
}

/// A break lasts from 4 s to 8 s of a film, with 1 to 30 pictures per second, at equal or unequal intervals. The break
/// is detected, and its start time is within one picture of 4 s.
#[test]
fn times_are_those_of_the_time_stamps() {
    for rate in [1.0, 2.0, 5.0, 12.0, 30.0] {
        for uneven in [0.0, 0.4] {
            let count = (12.0 * rate) as u32;
            let time_s = |picture: u32| {
                let off = if picture % 2 == 1 { uneven / rate } else { 0.0 };
                f64::from(picture) / rate + off
            };
            let mut model = model(&[], FilmParameters { persist_s: 1.0, ..TERMS });
            let broke =
                show(
                    &mut model,
                    (0..count).map(time_s),
                    |time_s| {
                        if (4.0..8.0).contains(&time_s) { 95 } else { 60 }
                    },
                );
            assert_eq!(broke, 100, "{rate} a second, uneven by {uneven}");
            let since_s = f64::from(model.broke_s(35 * SIDE + 35).expect("broken"));
            assert!((since_s - 4.0).abs() <= 1.5 / rate + 1e-3, "{rate}: {since_s}");
            assert!(!model.is_open_now(35 * SIDE + 35), "{rate}: it closed");
        }
    }
}

/// A place that appears bare for less than `persist_s` did not break, even if many pictures show it.
#[test]
fn a_flash_is_no_break() {
    for rate in [5.0, 30.0] {
        let mut model = model(&[], TERMS);
        let times_s = (0..(6.0 * rate) as u32).map(|picture| f64::from(picture) / rate);
        assert_eq!(show(&mut model, times_s, |time_s| if (2.0..2.39).contains(&time_s) { 95 } else { 60 }), 0);
    }
}

/// While water is sprayed, a pixel is wet if its brightness is outside of the bare range by more than 10 % of its dry
/// brightness. Expected values, calculated by hand: below 70 or above 120 levels.
#[test]
fn wet_places_under_the_spray_are_found() {
    for (level, is_wet) in [(69, true), (71, false), (119, false), (121, true)] {
        let mut model = model(&[], TERMS);
        model.spray(&film(level));
        assert_eq!(model.ever_wet(35 * SIDE + 35), is_wet, "{level}");
    }
}

/// Expected result: a dry pixel below 4 levels shows no film, and a pixel of 250 levels and more may be overexposed.
#[test]
fn a_black_or_overexposed_dry_place_is_not_seen() {
    let window = Window { left: 0, top: 0, width: SIDE, height: SIDE };
    let mut model = Model::new(window, &[true; SIDE * SIDE], &[], TERMS);
    model.add_dry(&picture(|column, _| [3, 4, 249, 250][column % 4]));
    assert_eq!([0, 1, 2, 3].map(|index| model.is_evaluated(index)), [false, true, true, false]);
}

/// A place whose film is overexposed for half of the time, or for the last 3 s, was not seen.
#[test]
fn a_place_that_is_hidden_for_long_is_not_seen() {
    let seen = |from_s: f64, to_s: f64| {
        let mut model = model(&[], TERMS);
        let times_s = (0..60).map(|picture| 0.2 * f64::from(picture));
        show(&mut model, times_s, |time_s| if (from_s..to_s).contains(&time_s) { 255 } else { 60 });
        model.was_observed(35 * SIDE + 35)
    };
    assert!(seen(2.0, 7.5) && !seen(2.0, 8.5), "of 11.8 s");
    assert!(seen(9.2, 12.0) && !seen(8.4, 12.0), "at the end");
}

/// A red primer of (100, 35, 35), which the film changes to (58, 13, 13). Expected values, calculated by hand: the
/// means of the channels are 57 and 28. A place that reflects 25 levels of white has (83, 38, 38) and a mean of 53:
/// nearly as bright as dry, but of another colour. This place does not break and is treated as not seen. A place that
/// is dry again breaks, also under a lamp with a gain of 0.9.
#[test]
fn a_white_reflection_on_a_coloured_panel_is_no_break() {
    let broke = |place: [u8; 3], lamp: f64| {
        let window = Window { left: 0, top: 0, width: SIDE, height: SIDE };
        let mut model = Model::new(window, &[true; SIDE * SIDE], &[], TERMS);
        let show = |film: [u8; 3], place: [u8; 3]| {
            let is_place = |index: &usize| [index % SIDE, index / SIDE].iter().all(|at| (30..40).contains(at));
            let lit = |rgb: [u8; 3]| rgb.map(|level| (f64::from(level) * lamp).round() as u8);
            let rgb = (0..SIDE * SIDE).map(|index| lit(if is_place(&index) { place } else { film })).collect();
            ColorPicture { width: SIDE, height: SIDE, rgb }
        };
        let (dry, film) = ([100, 35, 35], [58, 13, 13]);
        model.add_dry(&ColorPicture { width: SIDE, height: SIDE, rgb: vec![dry; SIDE * SIDE] });
        let pictures = (0..20).map(|time| {
            let picture = show(film, if time < 6 { film } else { place });
            model.measure_wet(&picture);
            model.judge_last(&picture, 0.2 * f64::from(time)).len()
        });
        (pictures.sum::<usize>(), model.was_observed(35 * SIDE + 35))
    };
    assert_eq!(broke([83, 38, 38], 1.0), (0, false));
    assert_eq!(broke([100, 35, 35], 1.0), (100, true));
    assert_eq!(broke([100, 35, 35], 0.9), (100, true));
}
