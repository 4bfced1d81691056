//! Clips that are not valid tests: each must be `invalid`, with the correct reason.

use crate::clips::{Bench, phase, times_s};
use crate::goal::Figure;
use panelprep::geometry::ColorPicture;
use panelprep::sim::{FilmSpec, Grease, WET_FROM_S};
use panelprep::verdict::Verdict;

const OBSERVED_S: f64 = 8.0;
/// A time in the middle of the film, s.
const MIDDLE_S: f64 = WET_FROM_S + 4.0;

/// A function that changes a picture of a clip; it returns `None` to omit the picture.
type Damage = fn(ColorPicture, f64) -> Option<ColorPicture>;

const DAMAGES: [(&str, &str, Damage); 14] = [
    ("cut short", "too_short", |picture, time_s| (time_s < WET_FROM_S + 7.0).then_some(picture)),
    ("nine of ten lost", "gap", |picture, time_s| {
        (time_s < WET_FROM_S + 0.1 || ((time_s * 5.0).round() as u32).is_multiple_of(10)).then_some(picture)
    }),
    ("1.5 s lost", "gap", |picture, time_s| (!(MIDDLE_S..MIDDLE_S + 1.5).contains(&time_s)).then_some(picture)),
    ("no dry picture", "no_dry_picture", |picture, time_s| (time_s >= 1.0).then_some(picture)),
    ("a film that changes little", "dark", |picture, _| Some(scale_brightness(picture, 0.15))),
    ("overexposed", "not_seen", |picture, _| Some(scale_brightness(picture, 4.5))),
    ("lamp down by a half", "light", |picture, time_s| {
        Some(scale_brightness(picture, if time_s > MIDDLE_S { 0.5 } else { 1.0 }))
    }),
    ("lamp up by a half", "light", |picture, time_s| {
        Some(scale_brightness(picture, if time_s > MIDDLE_S { 1.5 } else { 1.0 }))
    }),
    ("out of focus from the middle on", "focus", |picture, time_s| {
        Some(if time_s > MIDDLE_S { blur_picture(&picture, 4) } else { picture })
    }),
    ("out of focus throughout", "focus", |picture, _| Some(blur_picture(&picture, 4))),
    ("moved by 3 px", "moved", |picture, time_s| {
        Some(if time_s > MIDDLE_S { shift_picture(&picture, 3) } else { picture })
    }),
    // If the drop is on a greasy spot, the spot is neither wet nor dry and is reported as not seen.
    ("a drop on the dry panel", "wet_when_dry|not_seen", |picture, time_s| {
        Some(if time_s < 1.0 { change_spot(picture, |gray| gray * 0.55) } else { picture })
    }),
    ("a reflection that stands still", "not_seen", |picture, time_s| {
        Some(if time_s > WET_FROM_S { change_spot(picture, |gray| gray + 90.0) } else { picture })
    }),
    ("covered for 2 s", "bright", |picture, time_s| {
        Some(if (MIDDLE_S..MIDDLE_S + 2.0).contains(&time_s) { covered(picture) } else { picture })
    }),
];

/// Returns the number of damages that were not reported, or were reported with a wrong reason.
pub fn run(seeds: u64, reduction: usize) -> usize {
    let (mut wrong, mut all) = (0, 0);
    for seed in 1..=seeds {
        let bench = Bench::new(seed, reduction, "");
        let grease = Grease::Mixed { count: 3, until_s: WET_FROM_S + 6.0 };
        let spots = if seed % 2 == 0 { Vec::new() } else { bench.cell.with_other_grease(&grease, seed) };
        let film = bench.cell.film_with_spec(&spots, &FilmSpec::TYPICAL_FILM, seed);
        let demands = bench.demands(OBSERVED_S);
        let mut frozen = None;
        let still: (&str, &str, Damage) = ("a camera that stands still", "frozen", |picture, _| Some(picture));
        let whole: (&str, &str, Damage) = ("whole", "", |picture, _| Some(picture));
        for (name, code, damage) in DAMAGES.into_iter().chain([still, whole]) {
            let mut watch = bench.watch(OBSERVED_S, None);
            for time_s in times_s(&demands) {
                let picture = if code == "frozen" && time_s > MIDDLE_S {
                    frozen.get_or_insert_with(|| film.picture(time_s)).clone()
                } else {
                    film.picture(time_s)
                };
                if let Some(picture) = damage(picture, time_s) {
                    watch.push(&picture, time_s, phase(&film, time_s)).expect("in order");
                }
            }
            let judgement = watch.finish().expect("wet pictures").judgement;
            let codes: Vec<&str> = judgement.reasons.iter().map(|reason| &*reason.code).collect();
            let right = match code {
                "" => judgement.verdict != Verdict::Invalid,
                _ => judgement.verdict == Verdict::Invalid && code.split('|').any(|code| codes.contains(&code)),
            };
            wrong += usize::from(!right);
            all += 1;
            println!(
                "{seed:4}  {name:32} {:8} {codes:?}{}",
                judgement.verdict.keyword(),
                if right { "" } else { "  <-" }
            );
        }
    }
    let found = format!("{wrong} of {all}");
    Figure("film: damaged clips that were not reported").report("0", &found, wrong == 0 && all > 0);
    println!("damaged clips, {seeds} seeds: {wrong} not reported, or reported wrongly (target 0)");
    wrong
}

fn scale_brightness(mut picture: ColorPicture, share: f64) -> ColorPicture {
    picture.rgb.as_flattened_mut().iter_mut().for_each(|gray| *gray = (f64::from(*gray) * share).round() as u8);
    picture
}

fn shift_picture(picture: &ColorPicture, right: usize) -> ColorPicture {
    let mut moved = picture.clone();
    for row in 0..picture.height {
        let line = &picture.rgb[row * picture.width..(row + 1) * picture.width];
        moved.rgb[row * picture.width + right..(row + 1) * picture.width]
            .copy_from_slice(&line[..picture.width - right]);
    }
    moved
}

/// Changes the brightness of a circular spot in the picture's middle, about 4 mm in diameter.
fn change_spot(mut picture: ColorPicture, change: impl Fn(f64) -> f64) -> ColorPicture {
    let (width, height) = (picture.width, picture.height);
    let radius_px = width as f64 / 400.0;
    for (index, pixel) in picture.rgb.iter_mut().enumerate() {
        let (u, v) = ((index % width) as f64 - width as f64 / 2.0, (index / width) as f64 - height as f64 / 2.0);
        if u.hypot(v) < radius_px {
            *pixel = pixel.map(|gray| change(f64::from(gray)).round() as u8);
        }
    }
    picture
}

fn covered(mut picture: ColorPicture) -> ColorPicture {
    let (width, half) = (picture.width, picture.width * 55 / 100);
    for row in 0..picture.height {
        picture.rgb[row * width..row * width + half].fill([150, 140, 120]);
    }
    picture
}

/// Blurs the picture twice with a box filter of `2 reach + 1` px, along rows and columns.
fn blur_picture(picture: &ColorPicture, reach: usize) -> ColorPicture {
    let (width, height) = (picture.width, picture.height);
    let pass = |from: &[[u8; 3]], along: usize, length: usize, across: usize, count: usize| {
        let mut out = vec![[0; 3]; from.len()];
        for line in 0..count {
            let mut sum = [0_i32; 3];
            let at = |i: usize| from[line * across + i.min(length - 1) * along].map(i32::from);
            let add =
                |sum: &mut [i32; 3], value: [i32; 3], sign: i32| (0..3).for_each(|c| sum[c] += sign * value[c]);
            (0..reach).for_each(|i| add(&mut sum, at(i), 1));
            add(&mut sum, at(0).map(|value| value * (reach as i32 + 1)), 1);
            for i in 0..length {
                add(&mut sum, at(i + reach), 1);
                add(&mut sum, at(i.saturating_sub(reach + 1)), -1);
                out[line * across + i * along] =
                    sum.map(|value| (value / (2 * reach as i32 + 1)).clamp(0, 255) as u8);
            }
        }
        out
    };
    let mut rgb = picture.rgb.clone();
    for _ in 0..2 {
        rgb = pass(&rgb, 1, width, width, height);
        rgb = pass(&rgb, width, height, 1, width);
    }
    ColorPicture { width, height, rgb }
}
