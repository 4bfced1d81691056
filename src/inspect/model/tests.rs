//! The model by itself, on 64 × 64 px: dry 100 levels, wet 60.

use super::*;

const SIDE: usize = 64;

fn picture(level: impl Fn(usize, usize) -> u8) -> ColorPicture {
    let rgb = (0..SIDE * SIDE).map(|index| [level(index % SIDE, index / SIDE); 3]).collect();
    ColorPicture { width: SIDE, height: SIDE, rgb }
}

/// Two pictures into the film; three that show it make a break.
fn watching() -> Model {
    let window = Window { left: 0, top: 0, width: SIDE, height: SIDE };
    let mut model = Model::new(window, &[true; SIDE * SIDE], [1.0; 3], 3);
    model.dry(&picture(|_, _| 100));
    show(&mut model, |_, _| 60);
    model
}

/// Shows one more picture; what it says of itself, and how many pixels broke by it.
fn show(model: &mut Model, level: impl Fn(usize, usize) -> u8) -> (PictureMeasurement, usize) {
    let picture = picture(level);
    let look = model.look(&picture);
    let since_wet_s = model.times_s.len() as f64;
    (look, model.follow(&picture, since_wet_s).len())
}

/// By hand. One row in two tells the light: with 66 in every fourth row, from row 2 on, it is (60 + 66)/2/60 = 1.05. Which
/// brightness counts is told by one row in four: with 75 in every eighth, from row 4 on, their mean is 67.5, so that
/// 0.86 · 67.5 = 58 to 78 count: the light is (3 · 60 + 75)/4/60 = 1.0625. One row in four tells what is hidden: of 16
/// such rows row 4 is.
#[test]
fn rows_tell_the_light_and_what_is_hidden() {
    let light = |from: usize, every: usize, level: u8| {
        show(&mut watching(), |_, row| if row % every == from { level } else { 60 }).0.light
    };
    assert!((light(2, 4, 66) - 1.05).abs() < 1e-3, "{}", light(2, 4, 66));
    assert!((light(4, 8, 75) - 1.0625).abs() < 1e-3, "{}", light(4, 8, 75));
    let look = show(&mut watching(), |_, row| if row == 4 { 255 } else { 60 }).0;
    assert_eq!((look.hidden, look.film_left), (1.0 / 16.0, watching().wetting.film));
}

/// By hand: below 4 levels a dry place tells nothing, from 250 on it may be overexposed.
#[test]
fn a_black_or_overexposed_dry_place_is_not_seen() {
    let window = Window { left: 0, top: 0, width: SIDE, height: SIDE };
    let mut model = Model::new(window, &[true; SIDE * SIDE], [1.0; 3], 3);
    model.dry(&picture(|column, _| [3, 4, 249, 250][column % 4]));
    assert_eq!([0, 1, 2, 3].map(|index| model.sees(index)), [false, true, true, false]);
}

/// By hand: 3 px of a cell, in rows that are looked at, are a glint's core, 2 px are noise. Next to a core, in the cells
/// around its own of 8 × 8 px, nothing breaks; two cells away it does.
#[test]
fn beside_a_glint_nothing_looks_dry() {
    let broke = |core: usize, from: usize| {
        let mut model = watching();
        let level = |column: usize, row: usize| match (column, row) {
            (16.., 18) if column < 16 + core => 250,
            (_, 20..24) if (from..from + 4).contains(&column) => 100,
            _ => 60,
        };
        (0..5).map(|_| show(&mut model, level).1).sum::<usize>()
    };
    assert_eq!([broke(3, 26), broke(2, 26), broke(3, 34)], [0, 16, 16]);
}

/// By hand, wet 60 of 100 levels: a film that grows to 48 looks like a light of 0.8, under which dry is 91.5 levels at most. What lies
/// around the panel is as bright as before, so that a place of 100 levels has broken.
#[test]
fn what_breaks_in_a_film_that_grew_darker_is_no_glint() {
    let broke = |around: u8| {
        let window = Window { left: SIDE / 2, top: SIDE / 2, width: SIDE, height: SIDE };
        let mut model = Model::new(window, &[true; SIDE * SIDE], [1.0; 3], 3);
        let show = |film: u8, around: u8, place: u8| {
            let level = |index: usize| {
                let (column, row) = (index % (2 * SIDE), index / (2 * SIDE));
                let is_panel = [column, row].iter().all(|at| (SIDE / 2..3 * SIDE / 2).contains(at));
                let is_place = [column, row].iter().all(|at| (60..70).contains(at));
                if is_place {
                    place
                } else if is_panel {
                    film
                } else {
                    around
                }
            };
            let rgb = (0..4 * SIDE * SIDE).map(|index| [level(index); 3]).collect();
            ColorPicture { width: 2 * SIDE, height: 2 * SIDE, rgb }
        };
        model.dry(&show(100, 100, 100));
        let films = [60, 60, 57, 54, 51, 48, 48, 48, 48, 48, 48];
        let pictures = films.iter().enumerate().map(|(time, &film)| {
            let place = if time < 6 { film } else { around };
            let picture = show(film, around, place);
            model.look(&picture);
            model.follow(&picture, time as f64).len()
        });
        pictures.sum::<usize>()
    };
    assert_eq!(broke(100), 100);
    assert_eq!(broke(80), 100, "the same under a lamp that faded to 0.8");
}

/// A red primer of (100, 35, 35) that the film makes (58, 13, 13). By hand, in the mean of the channels 57 and 28: a place that mirrors
/// 25 levels of white is as bright as (83, 38, 38), 53, nearly dry, and has not its colour. It does not break and was not seen, while
/// one that is dry again breaks, also under a lamp of 0.9.
#[test]
fn a_white_reflection_on_a_coloured_panel_is_no_break() {
    let broke = |place: [u8; 3], lamp: f64| {
        let window = Window { left: 0, top: 0, width: SIDE, height: SIDE };
        let mut model = Model::new(window, &[true; SIDE * SIDE], [1.0; 3], 3);
        let show = |film: [u8; 3], place: [u8; 3]| {
            let is_place = |index: &usize| [index % SIDE, index / SIDE].iter().all(|at| (30..40).contains(at));
            let lit = |rgb: [u8; 3]| rgb.map(|level| (f64::from(level) * lamp).round() as u8);
            let rgb = (0..SIDE * SIDE).map(|index| lit(if is_place(&index) { place } else { film })).collect();
            ColorPicture { width: SIDE, height: SIDE, rgb }
        };
        let (dry, film) = ([100, 35, 35], [58, 13, 13]);
        model.dry(&ColorPicture { width: SIDE, height: SIDE, rgb: vec![dry; SIDE * SIDE] });
        let pictures = (0..8).map(|time| {
            let picture = show(film, if time < 2 { film } else { place });
            model.look(&picture);
            model.follow(&picture, f64::from(time)).len()
        });
        (pictures.sum::<usize>(), model.saw(35 * SIDE + 35))
    };
    assert_eq!(broke([83, 38, 38], 1.0), (0, false));
    assert_eq!(broke([100, 35, 35], 1.0), (100, true));
    assert_eq!(broke([100, 35, 35], 0.9), (100, true));
}
