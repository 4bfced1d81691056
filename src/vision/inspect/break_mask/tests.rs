//! Tests of the classification of candidates on a window of 40 × 40 px: the film has 0.6 of the dry brightness, a break
//! has 0.9 of it.

use super::*;

const SIDE: usize = 40;
const WINDOW: Window = Window { left: 0, top: 0, width: SIDE, height: SIDE };
const SIZES: FeatureSizes = FeatureSizes { glint_px: 50, bead_px: 6, break_px: 12 };

/// Simulated observations of a film; the default is a film that does not break.
struct Film {
    broke_s: Vec<f32>,
    open_s: Vec<Option<f32>>,
    bare: Vec<f32>,
    film: Vec<f32>,
    longest_step_s: f32,
    is_sanded: bool,
    has_contrast: bool,
    bright: Vec<bool>,
    /// The brightness of an open pixel in the last picture; `None` for its brightness while it appeared bare.
    now: Option<f32>,
    break_to_film: Option<[f32; 2]>,
}

impl Film {
    /// Creates a film that broke at 1 s at the given pixels and stays open.
    fn with(place: impl Fn(usize, usize) -> bool) -> Self {
        let inside = |i: usize| place(i % SIDE, i / SIDE);
        Film {
            broke_s: (0..SIDE * SIDE).map(|i| if inside(i) { 1.0 } else { NOT_BROKEN }).collect(),
            open_s: vec![None; SIDE * SIDE],
            bare: vec![0.9; SIDE * SIDE],
            film: vec![0.6; SIDE * SIDE],
            longest_step_s: 0.2,
            is_sanded: false,
            has_contrast: true,
            bright: vec![false; SIDE * SIDE],
            now: None,
            break_to_film: Some([1.2, 2.0]),
        }
    }

    /// Returns the number of broken pixels, and the number of pixels for which this is uncertain.
    fn broken_and_unsure(&self) -> (usize, usize) {
        let FinalMask { broke_s, unsure } = determine_breaks(&WINDOW, self.broke_s.clone(), SIZES, self);
        (broke_s.iter().filter(|time_s| **time_s < NOT_BROKEN).count(), unsure.len())
    }
}

impl PixelObservations for Film {
    fn bare_since_s(&self, _index: usize) -> Option<f32> {
        None
    }
    fn open_time_s(&self, index: usize) -> Option<f32> {
        self.open_s[index]
    }
    fn bare_brightness_ratio(&self, index: usize) -> f32 {
        if self.is_sanded { self.bare[index] / self.film[index] } else { self.bare[index] }
    }
    fn film_brightness_ratio(&self, index: usize) -> f32 {
        if self.is_sanded { 1.0 } else { self.film[index] }
    }
    fn noise(&self, _index: usize) -> f32 {
        0.005
    }
    fn is_film_brighter(&self, index: usize) -> bool {
        self.bright[index]
    }
    fn has_contrast(&self, _index: usize) -> bool {
        self.has_contrast
    }
    fn persist_s(&self) -> f32 {
        0.5
    }
    fn longest_step_s(&self) -> f32 {
        self.longest_step_s
    }
    fn is_inside(&self, _index: usize) -> bool {
        true
    }
    fn has_no_dry_brightness(&self, _index: usize) -> bool {
        self.is_sanded
    }
    fn levels(&self, index: usize) -> [f32; 2] {
        let is_open = self.broke_s[index] < NOT_BROKEN && self.open_s[index].is_none();
        let open = self.now.unwrap_or(self.bare[index]);
        [self.bare[index], if is_open { open } else { self.film[index] }].map(|look| look * 100.0)
    }
    fn neighbour_tolerance(&self) -> f32 {
        0.08
    }
    fn break_ratio_range(&self) -> Option<[f32; 2]> {
        self.break_to_film
    }
}

fn disc(column: usize, row: usize) -> bool {
    column.abs_diff(20).pow(2) + row.abs_diff(20).pow(2) <= 36
}

/// Expected value, calculated by hand: a disc of 6 px radius has 113 px.
#[test]
fn a_disc_of_uniform_brightness_is_a_break() {
    assert_eq!(Film::with(disc).broken_and_unsure(), (113, 0));
}

/// A bell-shaped brightness from 0.6 to 0.9 varies by more than 0.14 of the difference between bare surface and film,
/// so the candidate is not classified as a break. A break cannot be excluded either, so its pixels are uncertain.
#[test]
fn a_static_bell_shaped_brightness_is_uncertain() {
    let mut film = Film::with(disc);
    for (i, bare) in film.bare.iter_mut().enumerate() {
        let away2 = (i % SIDE).abs_diff(20).pow(2) + (i / SIDE).abs_diff(20).pow(2);
        *bare = 0.65 + 0.25 * (-(away2 as f32) / 18.0).exp();
    }
    assert_eq!(film.broken_and_unsure(), (0, 113));
}

/// Expected values, calculated by hand: in a line of 30 × 2 px every pixel touches the outside; in a disc of the same
/// size 37 pixels would not.
#[test]
fn a_thin_line_is_uncertain() {
    assert_eq!(
        Film::with(|column, row| (5..35).contains(&column) && (20..22).contains(&row)).broken_and_unsure(),
        (0, 60)
    );
}

/// If the film around the candidate appears bare, or reflections lie beside it, the result is uncertain.
#[test]
fn a_candidate_without_contrast_or_along_a_reflection_is_uncertain() {
    assert_eq!(Film { has_contrast: false, ..Film::with(disc) }.broken_and_unsure(), (0, 113));
    let mut film = Film::with(disc);
    for i in 0..SIDE * SIDE {
        film.bright[i] = i % SIDE > 20 && !disc(i % SIDE, i / SIDE);
    }
    assert_eq!(film.broken_and_unsure(), (0, 113));
}

/// The candidate is as small as a glint. Its left part appears bare from 1 s to 1.4 s, and its right part from 2 s to
/// 2.4 s: the bare appearance moved. If the whole candidate is open at one time, it broke and closed.
#[test]
fn a_moving_glint_is_no_break() {
    let place = |column: usize, row: usize| (10..16).contains(&column) && (10..16).contains(&row);
    let mut film = Film::with(place);
    for i in (0..SIDE * SIDE).filter(|i| place(i % SIDE, i / SIDE)) {
        film.open_s[i] = Some(0.4);
        film.bare[i] = 0.7 + 0.03 * (i % SIDE - 10) as f32;
        film.broke_s[i] = 1.0 + 0.2 * (i % SIDE - 10) as f32;
    }
    assert_eq!(film.broken_and_unsure(), (0, 0));
    let mut closed = Film::with(disc);
    closed.open_s = vec![Some(3.0); SIDE * SIDE];
    assert_eq!(closed.broken_and_unsure(), (113, 0));
}

/// Expected values, calculated by hand: a glint of 50 px has a diameter of 7.98 px, so candidates that are less than 32
/// px apart may belong to one trail. The specks open one after another and close 0.6 s later. The first is film at 1.6
/// − 0.5 + 0.4 = 1.5 s, before the last opens at 2.5 s. Specks that open at the same time, specks that stay open for 4
/// s, and a single speck stay uncertain. Two specks of 16 px, each as large as a break, also stay uncertain.
#[test]
fn places_of_one_trail_are_judged_together() {
    let specks = |count: usize, step_s: f32, open_s: f32| {
        let mut film = Film::with(|_, _| false);
        for order in 0..count {
            let i = 20 * SIDE + 2 + 7 * order;
            (film.broke_s[i], film.open_s[i]) = (1.0 + step_s * order as f32, Some(open_s));
        }
        film.broken_and_unsure()
    };
    assert_eq!(specks(6, 0.3, 0.6), (0, 0));
    assert_eq!(specks(6, 0.0, 0.6), (0, 6));
    assert_eq!(specks(6, 0.3, 4.0), (0, 6));
    assert_eq!(specks(1, 0.3, 0.6), (0, 1));
    let mut large = Film::with(|_, _| false);
    for i in 0..SIDE * SIDE {
        let (column, row) = (i % SIDE, i / SIDE);
        if [5, 15].iter().any(|left| (*left..left + 8).contains(&column)) && (20..22).contains(&row) {
            (large.broke_s[i], large.open_s[i]) = (if column < 14 { 1.0 } else { 3.0 }, Some(0.6));
        }
    }
    assert_eq!(large.broken_and_unsure(), (0, 32));
}

/// One half of a break opened at 4 s and the other at 5 s, and each half closed again 1 s later. At one picture per
/// second this is no evidence of a motion. Expected value, calculated by hand: the first half may have closed as late
/// as 5 − 0.5 + 2 = 6.5 s, when the other half was already open.
#[test]
fn a_break_between_two_pictures_is_no_motion() {
    let place = |column: usize, row: usize| (10..14).contains(&column) && (10..14).contains(&row);
    let mut film = Film { longest_step_s: 1.0, ..Film::with(place) };
    for i in (0..SIDE * SIDE).filter(|i| place(i % SIDE, i / SIDE)) {
        film.broke_s[i] = if i % SIDE < 12 { 4.0 } else { 5.0 };
        film.open_s[i] = Some(1.0);
    }
    assert_eq!(film.broken_and_unsure(), (16, 0));
    assert_eq!(Film { longest_step_s: 0.2, ..film }.broken_and_unsure(), (0, 0));
}

/// Expected values, calculated by hand: two films of 22 and 66 levels contain breaks of 34 and 88 levels. The mean of
/// the breaks, 61, is within 8 % of the brighter film, but no single pixel is.
#[test]
fn a_break_over_two_kinds_of_film_did_not_become_film() {
    let mut film = Film { is_sanded: true, ..Film::with(disc) };
    for i in 0..SIDE * SIDE {
        (film.film[i], film.bare[i]) = if i % SIDE < 20 { (0.22, 0.34) } else { (0.66, 0.88) };
    }
    let (broke, unsure) = film.broken_and_unsure();
    assert_eq!(broke + unsure, 113);
}

/// Expected result: 2 × 2 px of water within a break are a bead and belong to the break; 3 × 3 px are more than the
/// maximum size of a bead, 6 px.
#[test]
fn a_bead_belongs_to_its_break() {
    let with_hole = |side: usize| {
        let hole = 19..19 + side;
        Film::with(move |column, row| disc(column, row) && !(hole.contains(&column) && hole.contains(&row)))
    };
    assert_eq!(with_hole(2).broken_and_unsure(), (113, 0));
    assert_eq!(with_hole(3).broken_and_unsure().0, 113 - 9);
}

/// A candidate beside an edge of a sanded area. Expected values, calculated by hand: 0.62 is the brightness of the film
/// on the right, and 0.62/0.36 = 1.72 times the brightness of the film on the left. A break of the left film would have
/// the same brightness, so the state of the candidate is unknown.
#[test]
fn a_candidate_between_two_films_is_uncertain() {
    let beside = |left: f32| {
        let mut film = Film { is_sanded: true, bare: vec![0.62; SIDE * SIDE], ..Film::with(disc) };
        (0..SIDE * SIDE).for_each(|i| film.film[i] = if i % SIDE < 20 { left } else { 0.62 });
        film.broken_and_unsure()
    };
    assert_eq!((beside(0.36), beside(0.6)), ((0, 113), (0, 0)));
}

/// Expected results for a sanded place, calculated by hand. With 0.9/0.6 = 1.5 times the film brightness, within 1.2 to
/// 2.0, the place broke. With 0.62, within 8 % of the film around it, the place became film after a glint. With 0.45,
/// or if the film is unknown, the result is neither. With a mean of 0.7 and 0.62 in the last picture, the place also
/// became film.
#[test]
fn a_sanded_place_is_compared_with_the_film_around_it() {
    let sanded = |bare: f32| Film { is_sanded: true, bare: vec![bare; SIDE * SIDE], ..Film::with(disc) };
    assert_eq!(sanded(0.9).broken_and_unsure(), (113, 0));
    assert_eq!(sanded(0.62).broken_and_unsure(), (0, 0));
    assert_eq!(sanded(0.45).broken_and_unsure(), (0, 113));
    assert_eq!(Film { now: Some(0.62), ..sanded(0.7) }.broken_and_unsure(), (0, 0));
    assert_eq!(Film { break_to_film: None, ..sanded(0.9) }.broken_and_unsure(), (0, 113));
}
