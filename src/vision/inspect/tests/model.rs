//! Tests of the default method on a plane panel.

use super::*;

/// Expected values, calculated by hand for the default method: all 20 × 15 px of 4 mm² are detected from 2 s on, in
/// grid r1c2. The film keeps 55/105 of the dry brightness, and the smallest reliably detected break has 12 px.
#[test]
fn the_model_finds_a_break_to_the_pixel() {
    let inspection = run(watch(0.0, FILM), |second| if second < 2 { vec![] } else { vec![[70, 30, 90, 45]] });
    assert_eq!(inspection.judgement.verdict, Verdict::Fail, "{:?}", inspection.judgement);
    assert_eq!((inspection.mask().count(), inspection.breaks.len()), (300, 1));
    assert!((inspection.breaks[0].area_mm2 - 1200.0).abs() < 0.1 && inspection.breaks[0].closed_share == 0.0);
    assert_eq!((inspection.grids[1].time_to_break_s, inspection.grids[0].time_to_break_s), (Some(2.0), None));
    let observation = &inspection.observation;
    assert!((observation.film_left.expect("told") - 55.0 / 105.0).abs() < 0.02, "{observation:?}");
    assert_eq!(observation.quality.off_px, None, "nor can it tell its place");
    assert!((observation.detection_limit_mm2 - 48.0).abs() < 0.1 && observation.never_wet_percent == 0.0);
    assert_eq!((observation.quality.usable, observation.quality.moved_px), (6, None), "a wall has no outline");
}

/// The film breaks at 1 s and closes after 3 s: it is recorded as a closed break. A place that appears bare in only one
/// picture is not a break.
#[test]
fn a_film_that_closes_again_has_broken() {
    let inspection = run(watch(0.0, FILM), |second| match second {
        1..=3 => vec![[70, 30, 90, 45]],
        4 => vec![[100, 60, 120, 80]],
        _ => vec![],
    });
    let [found] = inspection.breaks.as_slice() else { panic!("{:?}", inspection.breaks) };
    assert_eq!((inspection.judgement.verdict, found.first_seen_s, found.closed_share), (Verdict::Fail, 1.0, 1.0));
}

/// A change of the light by 20 % everywhere, up or down, is compensated; a change by 50 % cannot be compensated.
#[test]
fn a_change_of_light_is_compensated_within_its_limit() {
    let lit = |share: f64| {
        let mut watch = watch(0.0, FILM);
        watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
        for second in 0..6 {
            let mut picture = picture(&[[70, 30, 90, 45]]);
            let gain = if second == 0 { 1.0 } else { share };
            picture.rgb.as_flattened_mut().iter_mut().for_each(|gray| *gray = (f64::from(*gray) * gain) as u8);
            // The noise is added last: scaled with the picture, it would vanish, and the camera would be treated as
            // frozen.
            watch.push(&exposed(picture, second), 10.0 + second as f64, Phase::Wet).expect("in order");
        }
        watch.finish().expect("wet pictures")
    };
    for share in [0.8, 1.2] {
        let inspection = lit(share);
        assert_eq!(inspection.judgement.verdict, Verdict::Fail, "{share}");
        assert!(inspection.mask().count().abs_diff(300) <= 8, "{share}: rounding at the corners");
    }
    assert_eq!(codes(&lit(0.5))[0], "light");
    // With this additional light, an unbroken film looks like a film that broke everywhere.
    assert_ne!(lit(1.5).judgement.verdict, Verdict::Pass);
}

/// A film that disappears from the whole panel at once looks like an increase of the light. Expected value, calculated
/// by hand: 100/70 = 1.43 times as bright. The verdict must not be pass.
#[test]
fn a_film_that_breaks_everywhere_at_once_does_not_pass() {
    let shown = |level: u8| {
        let mut watch = watch(0.0, FILM);
        watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, [100; 3]), 1.0, Phase::Dry).expect("first");
        for second in 0..6 {
            let picture = ColorPicture::uniform(WIDTH, HEIGHT, [if second < 2 { 70 } else { level }; 3]);
            watch.push(&exposed(picture, second), 10.0 + second as f64, Phase::Wet).expect("in order");
        }
        watch.finish().expect("wet pictures").judgement.verdict
    };
    assert_ne!(shown(100), Verdict::Pass);
    assert_ne!(shown(94), Verdict::Pass);
    assert_eq!(shown(72), Verdict::Pass);
}

/// Expected values, calculated by hand: a disc of 25 mm has an area of 490.9 mm², 122 px of 4 mm², and a radius of 6.2
/// px. With a smaller disc fewer areas would be too narrow for it.
#[test]
fn the_smallest_disc_is_25_mm_wide() {
    assert_eq!(watch(0.0, FILM).smallest_disc_px(), 6);
}

#[test]
fn a_frozen_camera_or_no_dry_picture_gives_no_test() {
    let mut still = watch(0.0, FILM);
    still.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
    for second in 0..6 {
        still.push(&picture(&[]), 10.0 + second as f64, Phase::Wet).expect("in order");
    }
    assert!(codes(&still.finish().expect("wet pictures")).contains(&"frozen"));
    for method in [FILM, SHARP] {
        let inspection = watched(watch(0.0, method), |_| vec![]);
        assert_eq!((inspection.judgement.verdict, codes(&inspection)[0]), (Verdict::Invalid, "no_dry_picture"));
    }
}

/// Expected value, calculated by hand: columns 20 to 50 of 120 are a quarter of the region.
#[test]
fn a_test_of_a_hardly_wet_region_is_invalid() {
    let inspection = run(watch(0.0, FILM), |_| vec![[20, 20, 50, 100]]);
    assert_eq!((inspection.judgement.verdict, codes(&inspection)[0]), (Verdict::Invalid, "never_wet"));
    assert!((inspection.observation.never_wet_percent - 25.0).abs() < 0.1, "{:?}", inspection.observation);
    let less = run(watch(0.0, FILM), |_| vec![[20, 20, 40, 100]]);
    assert_eq!((less.judgement.verdict, less.grids[0].time_to_break_s), (Verdict::Fail, Some(0.0)));
}

/// Under the spray the place is wet in one picture, and it is dry again before the film is observed. This is a break at
/// 0 s, and not a place that never becomes wet.
#[test]
fn a_place_that_dries_under_the_spray_is_a_break_at_0_s() {
    let mut watch = watch(0.0, FILM);
    watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
    watch.push(&exposed(picture(&[]), 9), 2.0, Phase::Spray).expect("second");
    let inspection = watched(watch, |_| vec![[20, 20, 60, 100]]);
    assert_eq!(inspection.judgement.verdict, Verdict::Fail, "{:?}", inspection.judgement);
    assert_eq!(inspection.observation.never_wet_percent, 0.0);
    let first_column = inspection.grids.iter().filter(|grid| grid.id.column == 1);
    assert!(first_column.map(|grid| grid.time_to_break_s).eq([Some(0.0); 2]));
}

/// Expected value, calculated by hand: the mask covers columns 20 to 40, half of the first grids, which are 40 px wide.
#[test]
fn a_masked_grid_does_not_pass_and_hides_no_other_break() {
    let masked = format!("{FILM}\nmasked_px = [[[10, 10], [39.5, 10], [39.5, 110], [10, 110]]]");
    let clean = run(watch(0.0, &masked), |_| vec![]);
    assert_eq!((clean.judgement.verdict, codes(&clean)), (Verdict::Invalid, vec!["masked"]));
    assert_eq!(clean.grids.iter().filter(|grid| !grid.seen).count(), 2);
    assert!((clean.footprint.grids()[0].masked_share - 0.5).abs() < 0.01);
    let broken = run(watch(0.0, &masked), |second| if second < 2 { vec![] } else { vec![[25, 30, 90, 45]] });
    assert_eq!((broken.judgement.verdict, codes(&broken)), (Verdict::Fail, vec!["broken", "masked"]));
    assert_eq!(broken.mask().count(), 50 * 15, "nothing is looked at behind the mask");
}

/// 10 × 10 px of the region have 60 levels in the dry picture, as if wet, and also in the wet pictures: they neither
/// break nor pass. If the same place has its full brightness in the dry picture and never becomes wet, it is a break.
#[test]
fn a_place_that_was_wet_in_the_dry_picture_neither_fails_nor_passes() {
    let block = [100, 30, 110, 40];
    let inspection = |dry: ColorPicture, wet: &[[usize; 4]]| {
        let mut watch = watch(0.0, FILM);
        watch.push(&dry, 1.0, Phase::Dry).expect("first");
        watched(watch, |_| wet.to_vec())
    };
    let mut dry = ColorPicture::uniform(WIDTH, HEIGHT, DRY);
    for row in block[1]..block[3] {
        dry.rgb[row * WIDTH + block[0]..row * WIDTH + block[2]].fill(WET);
    }
    let drop = inspection(dry, &[]);
    assert_eq!((drop.judgement.verdict, codes(&drop)), (Verdict::Invalid, vec!["wet_when_dry"]));
    assert!(drop.judgement.reasons[0].message.contains("r1c3"), "{:?}", drop.judgement);
    assert_eq!((drop.mask().count(), drop.grids.iter().filter(|grid| grid.seen).count()), (0, 5));
    let never = inspection(ColorPicture::uniform(WIDTH, HEIGHT, DRY), &[block]);
    assert_eq!((never.judgement.verdict, codes(&never)), (Verdict::Fail, vec!["broken"]));
}

/// Expected values, calculated by hand: 4 × 4 px of 4 mm² that reflect a lamp in all wet pictures are more than the 50
/// mm² from which a grid fails. If they reflect it in four of six pictures, they are hidden for more than half of the
/// time; in two pictures the reflection is a glint.
#[test]
fn a_reflection_that_does_not_move_hides_its_grid() {
    let with_reflection = |pictures| inspect_reflection([30, 50, 34, 54], pictures, &[]);
    let hidden = with_reflection(6);
    assert_eq!((hidden.judgement.verdict, codes(&hidden)), (Verdict::Invalid, vec!["not_seen"]));
    assert!((hidden.footprint.grids()[0].lost_mm2 - 64.0).abs() < 0.1, "{:?}", hidden.footprint.grids()[0]);
    assert_eq!(
        (codes(&with_reflection(4)), with_reflection(2).judgement.verdict),
        (vec!["not_seen"], Verdict::Pass)
    );
}

/// 20 × 15 px break, and the rim of the film beside them reflects a lamp for the same time. All 300 px are the break,
/// including the pixels within two cells of the rim. The same rim without a break beside it causes no break, but is
/// treated as not seen.
#[test]
fn a_bright_rim_beside_a_break_hides_none_of_it() {
    let broke = inspect_reflection([90, 30, 93, 45], 6, &[[70, 30, 90, 45]]);
    assert_eq!((broke.judgement.verdict, codes(&broke)), (Verdict::Fail, vec!["broken"]));
    assert_eq!((broke.mask().count(), broke.grids[1].time_to_break_s), (300, Some(1.0)));
    let clean = inspect_reflection([90, 30, 93, 45], 6, &[]);
    assert_eq!((codes(&clean), clean.mask().count()), (vec!["not_seen"], 0));
}

/// Expected values, calculated by hand: a reflection covers 64 px, 256 mm² and 4 % of a grid, of which 100 px broke:
/// the grid failed, whatever is hidden. Of 10 hidden and 12 broken px, 40 and 48 mm², neither alone would make a grid
/// fail, but both together do.
#[test]
fn a_failed_grid_stays_failed_and_hidden_area_is_added_to_broken_area() {
    let failed = inspect_reflection([30, 48, 38, 56], 6, &[[44, 24, 54, 34]]);
    assert_eq!((failed.judgement.verdict, codes(&failed)), (Verdict::Fail, vec!["broken"]));
    assert_eq!(
        (failed.grids[0].failed, failed.grids[0].seen),
        (true, false),
        "the page says how much was not seen"
    );
    assert!((failed.footprint.grids()[0].lost_mm2 - 256.0).abs() < 0.1, "{:?}", failed.footprint.grids()[0]);
    let (hidden, broke) = ([30, 50, 35, 52], [[44, 24, 48, 27]]);
    assert_eq!(
        [inspect_reflection(hidden, 6, &[]), inspect_reflection(hidden, 0, &broke)]
            .map(|alone| alone.judgement.verdict),
        [Verdict::Pass; 2]
    );
    let both = inspect_reflection(hidden, 6, &broke);
    assert_eq!((both.judgement.verdict, codes(&both)), (Verdict::Invalid, vec!["not_seen"]));
    assert!((both.grids[0].broken_mm2 - 48.0).abs() < 0.1, "{:?}", both.grids[0]);
}

/// Inspects a film with a reflection on a rectangle in the first `pictures` of six wet pictures, and with blocks that
/// break after the first picture.
fn inspect_reflection(
    [left, top, right, bottom]: [usize; 4],
    pictures: usize,
    blocks: &[[usize; 4]],
) -> Inspection {
    let mut watch = watch(0.0, FILM);
    watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
    for second in 0..6 {
        let mut picture = exposed(picture(if second > 0 { blocks } else { &[] }), second);
        for row in (top..bottom).filter(|_| second < pictures) {
            picture.rgb[row * WIDTH + left..row * WIDTH + right].fill([255; 3]);
        }
        watch.push(&picture, 10.0 + second as f64, Phase::Wet).expect("in order");
    }
    watch.finish().expect("wet pictures")
}

/// A shadow removes 20 % of the light in the first fully wet picture: an unbroken film passes, and a break is detected.
#[test]
fn a_shadow_on_the_first_wet_picture_is_no_film() {
    let shaded = |blocks: &[[usize; 4]]| {
        let mut watch = watch(0.0, FILM);
        watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
        for second in 0..6 {
            let mut picture = exposed(picture(if second > 1 { blocks } else { &[] }), second);
            for pixel in picture.rgb.iter_mut().filter(|_| second == 0) {
                *pixel = pixel.map(|gray| gray / 5 * 4);
            }
            watch.push(&picture, 10.0 + second as f64, Phase::Wet).expect("in order");
        }
        watch.finish().expect("wet pictures")
    };
    let whole = shaded(&[]);
    assert_eq!(whole.judgement.verdict, Verdict::Pass, "{:?}", whole.judgement);
    let broken = shaded(&[[70, 30, 90, 45]]);
    assert_eq!((broken.judgement.verdict, broken.mask().count()), (Verdict::Fail, 300), "{:?}", broken.judgement);
}

/// A film that reflects a dark object (30 levels) on the left grids and a diffuser (150 levels) on the next grids; the
/// dry panel has 105 levels. A break has the dry brightness in both and is exact to the pixel, while the lamp tints the
/// pictures, red by +6 % and blue by −6 %. The surroundings of the region, here the wall, show the light.
#[test]
fn a_break_in_a_reflecting_film_is_found_in_tinted_light() {
    let levels = [[30; 3], [150; 3], [30; 3]];
    let inspection = inspect_reflecting_film(levels, &[[30, 30, 50, 45], [70, 65, 90, 80]]);
    assert_eq!(inspection.judgement.verdict, Verdict::Fail, "{:?}", inspection.judgement);
    assert_eq!((inspection.mask().count(), inspection.breaks.len()), (600, 2));
    assert_eq!((inspection.grids[0].time_to_break_s, inspection.grids[4].time_to_break_s), (Some(1.0), Some(1.0)));
    assert_eq!(inspect_reflecting_film(levels, &[]).judgement.verdict, Verdict::Pass);
}

/// On the right grids the film reflects light that makes it 1 level brighter than the dry panel. A break would not be
/// visible there, and these grids do not pass, whatever breaks elsewhere.
#[test]
fn a_film_as_bright_as_the_dry_panel_gives_no_result() {
    for blocks in [vec![], vec![[30, 30, 50, 45]]] {
        let inspection = inspect_reflecting_film([[30; 3], [150; 3], DRY.map(|level| level + 1)], &blocks);
        assert_eq!(
            (inspection.judgement.verdict, codes(&inspection)[0]),
            (Verdict::Invalid, "no_contrast"),
            "{:?}",
            inspection.judgement
        );
        let faint: Vec<bool> = inspection.grids.iter().map(|grid| grid.no_contrast && !grid.seen).collect();
        assert_eq!(faint, [false, false, true, false, false, true]);
    }
}

/// Inspects a film with these levels on the left, middle and right grids of the region; the blocks break after the
/// first picture.
fn inspect_reflecting_film(levels: [[u8; 3]; 3], blocks: &[[usize; 4]]) -> Inspection {
    let tint = [1.06, 1.0, 0.94];
    let mut watch = watch(0.0, FILM);
    watch.push(&exposed(ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1), 1.0, Phase::Dry).expect("first");
    for second in 0..6 {
        let mut picture = ColorPicture::uniform(WIDTH, HEIGHT, DRY);
        for row in 20..100 {
            for (column, level) in levels.into_iter().enumerate() {
                picture.rgb[row * WIDTH + 20 + 40 * column..][..40].fill(level);
            }
        }
        for &[left, top, right, bottom] in blocks.iter().filter(|_| second > 0) {
            (top..bottom).for_each(|row| picture.rgb[row * WIDTH + left..row * WIDTH + right].fill(DRY));
        }
        if second % 2 == 1 {
            let tinted = |level: u8, i: usize| (f64::from(level) * tint[i]).round() as u8;
            picture.rgb.iter_mut().for_each(|pixel| *pixel = std::array::from_fn(|i| tinted(pixel[i], i)));
        }
        watch.push(&exposed(picture, second), 10.0 + second as f64, Phase::Wet).expect("in order");
    }
    watch.finish().expect("wet pictures")
}

/// Expected values, calculated by hand: the film has 55/105 = 0.524 of the dry brightness, a damp break 0.8. At 4
/// levels they differ by 1.1, at 16 levels by 4.4: three and twelve times the noise of rounding, 0.35 levels. At least
/// four times the noise is required.
#[test]
fn a_part_that_the_film_hardly_changes_cannot_be_judged() {
    let codes_with = |level: u8| {
        let shown = |bright: u8, dark: u8| {
            let mut picture = ColorPicture::uniform(WIDTH, HEIGHT, [bright; 3]);
            picture.rgb.chunks_mut(WIDTH).for_each(|row| row[100..].fill([dark; 3]));
            picture
        };
        let mut watch = watch(0.0, FILM);
        watch.push(&shown(105, level), 1.0, Phase::Dry).expect("first");
        let wet = (f64::from(level) * 55.0 / 105.0) as u8;
        for second in 0..6 {
            watch.push(&exposed(shown(55, wet), second), 10.0 + second as f64, Phase::Wet).expect("in order");
        }
        let inspection = watch.finish().expect("wet pictures");
        codes(&inspection).into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    assert!(!codes_with(4).is_empty(), "a part of which nothing can be said");
    assert_eq!(codes_with(30), Vec::<String>::new());
}
