//! Measures whether the panel has moved and whether the picture is in focus. Both are measured at the outline of the
//! panel, which is visible whether the panel is wet or dry.
//!
//! In a profile across the outline, the gradient has its centre at the edge, and the height of its peak measures the
//! sharpness. Neither centre nor peak changes with the light or with the film on the panel. If edges with normals nᵢ
//! moved by δᵢ, the panel moved by the d that minimises  Σ (nᵢ·d − δᵢ)²,  without outliers.  (1)
//!
//! Grey levels show the edge on most panels, but not if a wet panel is as grey as the background beside it. In that
//! case each profile is measured in the channel with the most contrast; the remaining profiles must agree and must
//! constrain the panel in both directions. An outline without contrast is reported as not measurable, not as a motion
//! of the panel.
//!
//! This module also checks whether the panel is at its located pose. The same profiles in the taught picture give the
//! expected position of the edge in each profile. If the panel is at its pose, each edge in the dry picture is at its
//! expected position.

use nalgebra::{Matrix2, Vector2};
use panelprep_base::geometry::{Camera, ColorPicture, Panel, PinholeCamera, Pixel, Rigid, median};
use panelprep_cell::panel::TaughtPanel;

/// Number of profiles across the outline.
const OUTLINE_PROFILE_COUNT: usize = 240;
/// Minimum number of profiles for a result.
const MIN_PROFILES: usize = 40;
/// Minimum remaining contrast of a visible edge, as a fraction of its contrast in the first picture: in grey levels,
/// and in the channels.
const MIN_REMAINING_CONTRAST: [f32; 2] = [0.3, 0.2];
/// Minimum percentage of the profiles that must be visible: in grey levels, or else in the channels.
const MIN_SEEN_PERCENT: [f64; 2] = [50.0, 25.0];
/// Minimum number of profiles that constrain the panel in its least constrained direction, for a measurement in the
/// channels. In addition, at least the fraction `MIN_AGREEING_FRACTION` of the profiles must agree with the common
/// motion within `MAX_AGREEMENT_DISTANCE_PX`, px.
const MIN_CONSTRAINT: f32 = 10.0;
const MIN_AGREEING_FRACTION: f64 = 0.6;
const MAX_AGREEMENT_DISTANCE_PX: f32 = 1.0;
/// Minimum contrast of a profile in the taught picture, as a multiple of `MIN_CONTRAST` in the present light, for its
/// edge to be expected in the dry picture as well.
const MIN_TAUGHT_CONTRAST: f32 = 1.5;

/// The outline of the panel at its present pose, with which pictures are compared.
#[derive(Debug)]
pub struct DryOutline {
    places: Vec<EdgeLocation>,
    /// For each profile position, the edges in the taught picture, with the panel at its taught pose.
    taught: Vec<[Profile; VIEW_COUNT]>,
    first: Vec<[Option<Edge>; VIEW_COUNT]>,
}

/// Motion and sharpness of the outline, compared with the first picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PanelMotion {
    /// Displacement of the panel in the picture, px.
    pub moved_px: f64,
    /// Sharpness relative to the first picture; 1 if both are equally sharp.
    pub sharpness: f64,
}

/// The measurement of the panel's outline in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OutlineMeasurement {
    /// The outline has no contrast in the first picture, so there is nothing to compare.
    NoContrast,
    /// Too little of the outline is visible to determine whether the panel moved: only this percentage.
    Lost(f64),
    /// Enough of the outline is visible, but its parts do not agree on one motion of the panel.
    Disagrees,
    /// The outline was measured.
    Measured(PanelMotion),
}

/// Minimum percentage of the outline that must be visible to determine whether the panel moved.
pub const MIN_OUTLINE_SEEN_PERCENT: f64 = MIN_SEEN_PERCENT[1];

impl DryOutline {
    /// Creates the taught outline at the present pose of the panel.
    pub fn new(taught: &TaughtPanel, camera: &PinholeCamera, camera_from_panel: Rigid<Camera, Panel>) -> Self {
        let nominal = taught.panel_from_camera.inverse();
        let project = |&point| {
            let now = camera.project_inside(camera_from_panel * point)?;
            Some((now, taught.camera.project_inside(nominal * point)?))
        };
        let (pixels, then): (Vec<Pixel>, Vec<Pixel>) = taught.outline.iter().filter_map(project).unzip();
        let step = (pixels.len() / OUTLINE_PROFILE_COUNT).max(1);
        // The normal is calculated over some pixels to both sides, because the taught outline consists of steps from
        // pixel to pixel.
        let reach = (pixels.len() / 100).max(2);
        let place = |pixels: &[Pixel], i: usize| {
            let [from, at, to] = [i + pixels.len() - reach, i, i + reach].map(|i| pixels[i % pixels.len()]);
            let along = Vector2::new((to.u - from.u) as f32, (to.v - from.v) as f32);
            let length = along.norm();
            (length > 1.0).then(|| EdgeLocation {
                at: Vector2::new(at.u as f32, at.v as f32),
                normal: Vector2::new(-along.y, along.x) / length,
            })
        };
        let both = |i: usize| Some((place(&pixels, i)?, place(&then, i)?));
        let is_long = pixels.len() > 4 * reach;
        let chosen = if is_long { (0..pixels.len()).step_by(step).filter_map(both).collect() } else { vec![] };
        let picture = taught.scan.picture();
        let (places, then): (Vec<EdgeLocation>, Vec<EdgeLocation>) = chosen.into_iter().unzip();
        let taught = then.iter().map(|place| profiles(place, &picture)).collect();
        DryOutline { places, taught, first: Vec::new() }
    }

    /// Returns the distance between the panel's outline in this dry picture and the outline calculated from the pose,
    /// px. It is the larger of two values: the shift of the outline by (1), and the median offset of the profiles,
    /// which also shows a rotation or a change of the distance from the camera. If most of the outline is beyond the
    /// reach of the profiles, their reach is returned. `None` if the outline has too little contrast.
    pub fn outline_offset_px(&self, picture: &ColorPicture) -> Option<f64> {
        let now: Vec<[Profile; VIEW_COUNT]> = self.places.iter().map(|place| profiles(place, picture)).collect();
        let light: [f32; VIEW_COUNT] = std::array::from_fn(|view| {
            let both = self.taught.iter().zip(&now);
            let ratio = |(then, now): (&[Profile; VIEW_COUNT], &[Profile; VIEW_COUNT])| {
                Some(now[view].mean? / then[view].mean.filter(|mean| *mean > 1.0)?)
            };
            median_or_zero(&mut both.filter_map(ratio).collect::<Vec<f32>>())
        });
        let expected = |then: &[Profile; VIEW_COUNT], view: usize| {
            let is_sure = |edge: &Edge| edge.contrast * light[view] >= MIN_TAUGHT_CONTRAST * MIN_CONTRAST;
            then[view].edge.filter(is_sure)
        };
        let best = |then: &[Profile; VIEW_COUNT]| {
            let contrast = |view: usize| expected(then, view).map_or(0.0, |edge| edge.contrast * light[view]);
            (0..VIEW_COUNT).fold(GRAY_VIEW, |best, view| if contrast(view) > contrast(best) { view } else { best })
        };
        let by = |view: &dyn Fn(&[Profile; VIEW_COUNT]) -> usize| {
            let count = self.taught.iter().filter(|then| expected(then, view(then)).is_some()).count();
            if count < MIN_PROFILES {
                return None;
            }
            let offset =
                |(place, (then, now)): (&EdgeLocation, (&[Profile; VIEW_COUNT], &[Profile; VIEW_COUNT]))| {
                    let view = view(then);
                    Some((place.normal, now[view].edge?.offset_px - expected(then, view)?.offset_px))
                };
            let offsets: Vec<(Vector2<f32>, f32)> =
                self.places.iter().zip(self.taught.iter().zip(&now)).filter_map(offset).collect();
            // If most of the outline is beyond the reach of the profiles, the result is not missing: the distance is at
            // least this reach.
            if 2 * offsets.len() < count {
                return Some(f64::from(PROFILE_REACH_PX));
            }
            let mut off: Vec<f32> = offsets.iter().map(|(_, offset)| offset.abs()).collect();
            Some(f64::from(estimate_shift(&offsets).norm().max(median_or_zero(&mut off))))
        };
        // Grey levels are preferred, since they have the least noise; a colour channel is used only if the panel and
        // its surroundings are equally bright.
        by(&|_| GRAY_VIEW).or_else(|| by(&best))
    }

    /// Sets this picture as the reference for the following ones and returns its sharpness: the largest step as a
    /// fraction of the contrast of the edge; `None` if the outline has no contrast.
    pub fn set_reference(&mut self, picture: &ColorPicture) -> Option<f64> {
        self.first = self.places.iter().map(|place| edges(place, picture)).collect();
        let sharpness = |view: &dyn Fn(&[Option<Edge>; VIEW_COUNT]) -> Option<Edge>| {
            let mut sharp: Vec<f32> = self.first.iter().filter_map(view).map(|edge| edge.sharpness).collect();
            (sharp.len() >= MIN_PROFILES).then(|| f64::from(median_or_zero(&mut sharp)))
        };
        sharpness(&|edges| edges[GRAY_VIEW]).or_else(|| sharpness(&highest_contrast_edge))
    }

    /// Measures how far the panel has moved since the first picture, and how sharp the picture is.
    pub fn measure_against_first(&self, picture: &ColorPicture) -> OutlineMeasurement {
        let in_gray = |(place, first): (&EdgeLocation, &[Option<Edge>; VIEW_COUNT])| {
            first[GRAY_VIEW].map(|first| (*place, first, edge(place, picture, GRAY_VIEW)))
        };
        let pairs: Vec<(EdgeLocation, Edge, Option<Edge>)> =
            self.places.iter().zip(&self.first).filter_map(in_gray).collect();
        let seen = edges_still_seen(&pairs, MIN_REMAINING_CONTRAST[0]);
        let is_seen = percentage(seen.len(), pairs.len()) >= MIN_SEEN_PERCENT[0];
        if pairs.len() >= MIN_PROFILES && is_seen {
            OutlineMeasurement::Measured(compute_motion(&seen))
        } else {
            self.measure_in_channels(picture)
        }
    }

    /// Measures the outline, each profile in its best channel.
    fn measure_in_channels(&self, picture: &ColorPicture) -> OutlineMeasurement {
        let in_best = |(place, first): (&EdgeLocation, &[Option<Edge>; VIEW_COUNT])| {
            let clearest = highest_contrast_edge(first)?;
            let now = edges(place, picture);
            let kept = |view: usize| Some((first[view]?, now[view]?));
            let contrast = |(first, now): (Edge, Edge)| first.contrast.min(now.contrast);
            let best =
                (0..VIEW_COUNT).filter_map(kept).reduce(|a, b| if contrast(b) > contrast(a) { b } else { a });
            Some(best.map_or((*place, clearest, None), |(first, now)| (*place, first, Some(now))))
        };
        let pairs: Vec<(EdgeLocation, Edge, Option<Edge>)> =
            self.places.iter().zip(&self.first).filter_map(in_best).collect();
        if pairs.len() < MIN_PROFILES {
            return OutlineMeasurement::NoContrast;
        }
        let seen = edges_still_seen(&pairs, MIN_REMAINING_CONTRAST[1]);
        let seen_percent = percentage(seen.len(), pairs.len());
        if seen.len() < MIN_PROFILES || seen_percent < MIN_SEEN_PERCENT[1] {
            return OutlineMeasurement::Lost(seen_percent);
        }
        let shifts = edge_shifts(&seen);
        let d = estimate_shift(&shifts);
        let agree: Vec<Vector2<f32>> = shifts
            .iter()
            .filter(|(n, shift)| (n.dot(&d) - shift).abs() <= MAX_AGREEMENT_DISTANCE_PX)
            .map(|(n, _)| *n)
            .collect();
        let held = agree.iter().map(|n| n * n.transpose()).sum::<Matrix2<f32>>();
        // Parallel edges alone would not show a motion along them.
        let is_held = held.symmetric_eigenvalues().min() >= MIN_CONSTRAINT;
        if is_held && agree.len() as f64 >= MIN_AGREEING_FRACTION * shifts.len() as f64 {
            OutlineMeasurement::Measured(compute_motion(&seen))
        } else {
            OutlineMeasurement::Disagrees
        }
    }
}

fn percentage(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

/// Returns the edge with the highest contrast among the views of a profile.
fn highest_contrast_edge(edges: &[Option<Edge>; VIEW_COUNT]) -> Option<Edge> {
    edges.iter().flatten().copied().reduce(|a, b| if b.contrast > a.contrast { b } else { a })
}

/// Returns the edges with more than this fraction of their contrast in the first picture.
fn edges_still_seen(pairs: &[(EdgeLocation, Edge, Option<Edge>)], least: f32) -> Vec<(EdgeLocation, Edge, Edge)> {
    let kept = |&(place, first, now): &(EdgeLocation, Edge, Option<Edge>)| {
        now.filter(|now| now.contrast > least * first.contrast).map(|now| (place, first, now))
    };
    pairs.iter().filter_map(kept).collect()
}

fn edge_shifts(seen: &[(EdgeLocation, Edge, Edge)]) -> Vec<(Vector2<f32>, f32)> {
    seen.iter().map(|(place, first, now)| (place.normal, now.offset_px - first.offset_px)).collect()
}

fn compute_motion(seen: &[(EdgeLocation, Edge, Edge)]) -> PanelMotion {
    let mut sharp: Vec<f32> = seen.iter().map(|(_, first, now)| now.sharpness / first.sharpness).collect();
    PanelMotion {
        moved_px: f64::from(estimate_shift(&edge_shifts(seen)).norm()),
        sharpness: f64::from(median_or_zero(&mut sharp)),
    }
}

// Evaluates (1) four times; from the second time on, residuals above three times the median are excluded.
fn estimate_shift(shifts: &[(Vector2<f32>, f32)]) -> Vector2<f32> {
    let mut d = Vector2::zeros();
    let mut bound = f32::INFINITY;
    for _ in 0..4 {
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for (n, shift) in shifts.iter().filter(|(n, shift)| (n.dot(&d) - shift).abs() <= bound) {
            normal += n * n.transpose();
            right += n * *shift;
        }
        let Some(inverse) = normal.try_inverse() else { return d };
        d = inverse * right;
        let mut left: Vec<f32> = shifts.iter().map(|(n, shift)| (n.dot(&d) - shift).abs()).collect();
        // Profiles that a drop or a hand covers are excluded. The limit has a lower bound, so that perfect agreement
        // does not exclude all profiles.
        bound = (3.0 * median_or_zero(&mut left)).max(0.05);
    }
    d
}

/// Returns the median; 0 if there are no values.
fn median_or_zero(values: &mut [f32]) -> f32 {
    median(values).unwrap_or(0.0)
}

/// Length of a profile to each side of the outline, px.
const PROFILE_REACH_PX: i32 = 8;
const SAMPLE_COUNT: usize = 2 * PROFILE_REACH_PX as usize + 1;
/// Minimum contrast of a usable profile, grey levels.
const MIN_CONTRAST: f32 = 12.0;
/// Minimum gradient, as a fraction of the largest step of the profile; smaller gradients are noise.
const MIN_RELATIVE_GRADIENT: f32 = 0.25;

/// Number of views of a pixel: the mean of its channels, and each channel.
const VIEW_COUNT: usize = 4;
const GRAY_VIEW: usize = 0;

/// The position of a profile on the outline, with its direction.
#[derive(Debug, Clone, Copy)]
struct EdgeLocation {
    at: Vector2<f32>,
    normal: Vector2<f32>,
}

/// An edge in one profile.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Distance of the edge from the middle of the profile along the normal, px.
    offset_px: f32,
    /// Largest step, as a fraction of the contrast of the edge.
    sharpness: f32,
    contrast: f32,
}

/// The measured profile of a picture across one position of the outline.
#[derive(Debug, Clone, Copy, Default)]
struct Profile {
    edge: Option<Edge>,
    /// Mean level along the profile; `None` outside of the picture.
    mean: Option<f32>,
}

/// Returns the levels of one view along a profile; `None` if the profile leaves the picture.
fn read_profile(place: &EdgeLocation, picture: &ColorPicture, view: usize) -> Option<[f32; SAMPLE_COUNT]> {
    let mut profile = [0.0_f32; SAMPLE_COUNT];
    for (value, step) in profile.iter_mut().zip(-PROFILE_REACH_PX..) {
        *value = level(picture, place.at + place.normal * step as f32, view)?;
    }
    Some(profile)
}

fn profiles(place: &EdgeLocation, picture: &ColorPicture) -> [Profile; VIEW_COUNT] {
    std::array::from_fn(|view| {
        let mean =
            read_profile(place, picture, view).map(|profile| profile.iter().sum::<f32>() / SAMPLE_COUNT as f32);
        Profile { edge: edge(place, picture, view), mean }
    })
}

fn edges(place: &EdgeLocation, picture: &ColorPicture) -> [Option<Edge>; VIEW_COUNT] {
    std::array::from_fn(|view| edge(place, picture, view))
}

fn edge(place: &EdgeLocation, picture: &ColorPicture, view: usize) -> Option<Edge> {
    let profile = read_profile(place, picture, view)?;
    let steps: [f32; SAMPLE_COUNT - 1] = std::array::from_fn(|i| profile[i + 1] - profile[i]);
    let contrast = (profile[..4].iter().sum::<f32>() - profile[SAMPLE_COUNT - 4..].iter().sum::<f32>()).abs() / 4.0;
    let largest = steps.iter().fold(0.0_f32, |largest, step| largest.max(step.abs()));
    if contrast < MIN_CONTRAST {
        return None;
    }
    let (mut sum, mut weight) = (0.0, 0.0);
    for (i, step) in steps.iter().enumerate() {
        let height = (step.abs() - MIN_RELATIVE_GRADIENT * largest).max(0.0);
        sum += height * (i as f32 + 0.5 - PROFILE_REACH_PX as f32);
        weight += height;
    }
    Some(Edge { offset_px: sum / weight, sharpness: largest / contrast, contrast })
}

/// Interpolates the level of one view between four pixels; `None` outside of the picture.
fn level(picture: &ColorPicture, at: Vector2<f32>, view: usize) -> Option<f32> {
    let within = |at: f32, length: usize| at >= 0.0 && at < length as f32 - 1.0;
    if !within(at.x, picture.width) || !within(at.y, picture.height) {
        return None;
    }
    let (column, row) = (at.x as usize, at.y as usize);
    let (across, down) = (at.x - column as f32, at.y - row as f32);
    let value = |rgb: [u8; 3]| match view {
        GRAY_VIEW => f32::from(rgb.iter().map(|&level| u16::from(level)).sum::<u16>()) / 3.0,
        _ => f32::from(rgb[view - 1]),
    };
    let mix = |row: usize| {
        let pixels = &picture.rgb[row * picture.width + column..][..2];
        value(pixels[0]) * (1.0 - across) + value(pixels[1]) * across
    };
    Some(mix(row) * (1.0 - down) + mix(row + 1) * down)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a picture of a dark square of 60 px in front of a bright background, with edges `blur_px` wide, shifted
    /// to the right by `shift`; the square has the grey level `inside`.
    fn square(shift: f32, blur_px: f32, inside: f32) -> ColorPicture {
        let mut picture = ColorPicture::uniform(100, 100, [0; 3]);
        let cover = |from: f32, at: f32| ((at - from) / blur_px + 0.5).clamp(0.0, 1.0);
        for (index, pixel) in picture.rgb.iter_mut().enumerate() {
            let (u, v) = ((index % 100) as f32 - shift, (index / 100) as f32);
            let share = cover(20.0, u) * cover(-80.0, -u) * cover(20.0, v) * cover(-80.0, -v);
            *pixel = [(180.0 + (inside - 180.0) * share) as u8; 3];
        }
        picture
    }

    fn outline() -> DryOutline {
        let side = |i: u16| f32::from(i) + 24.0;
        let place = |u: f32, v: f32, nu: f32, nv: f32| EdgeLocation {
            at: Vector2::new(u, v),
            normal: Vector2::new(nu, nv),
        };
        let places = (0..52).flat_map(|i| {
            [
                place(20.0, side(i), -1.0, 0.0),
                place(80.0, side(i), 1.0, 0.0),
                place(side(i), 20.0, 0.0, -1.0),
                place(side(i), 80.0, 0.0, 1.0),
            ]
        });
        let places: Vec<EdgeLocation> = places.collect();
        let taught = places.iter().map(|place| profiles(place, &square(0.0, 1.0, 70.0))).collect();
        DryOutline { places, taught, first: Vec::new() }
    }

    /// Expected values, calculated by hand: a shift of only 3 px to the right is visible on two of the four sides. With
    /// 4 px down as well, the displacement of the panel is 5 px.
    #[test]
    fn a_displaced_panel_is_detected() {
        let outline = outline();
        let off = |picture: &ColorPicture| outline.outline_offset_px(picture);
        assert!(off(&square(0.0, 1.0, 70.0)).expect("contrast") < 0.05);
        assert!(off(&square(0.0, 3.0, 42.0)).expect("contrast") < 0.2, "a film and a blur are no other place");
        let mut dimmed = square(0.0, 1.0, 70.0);
        dimmed.rgb.iter_mut().for_each(|pixel| *pixel = pixel.map(|gray| gray / 2));
        assert!(off(&dimmed).expect("contrast") < 0.05, "nor is another light");
        let away = |right: usize, down: usize| {
            let mut picture = square(right as f32, 1.0, 70.0);
            picture.rgb.rotate_right(100 * down);
            off(&picture)
        };
        for (right, down, expected) in [(3, 0, 3.0), (0, 2, 2.0), (3, 4, 5.0)] {
            let found = away(right, down).expect("contrast");
            assert!((found - expected).abs() < 0.2, "{right}, {down}: {found}");
        }
        assert_eq!(away(14, 14), Some(f64::from(PROFILE_REACH_PX)), "farther than the profiles reach");
        dimmed.rgb.iter_mut().for_each(|pixel| *pixel = pixel.map(|gray| gray / 6));
        assert_eq!(off(&dimmed), None, "too dark to tell");
    }

    fn seen(sight: OutlineMeasurement) -> PanelMotion {
        let OutlineMeasurement::Measured(steadiness) = sight else { panic!("{sight:?}") };
        steadiness
    }

    #[test]
    fn a_shift_and_a_blur_are_measured_whatever_the_film_inside() {
        let mut outline = outline();
        assert!(outline.set_reference(&square(0.0, 1.0, 70.0)).expect("contrast") > 0.4);
        for shift in [0.0, 0.4, 1.0, 3.0] {
            let found = seen(outline.measure_against_first(&square(shift, 1.0, 42.0)));
            assert!((found.moved_px - f64::from(shift)).abs() < 0.15, "{shift}: {found:?}");
            assert!(found.sharpness > 0.7, "{found:?}");
        }
        let blurred = seen(outline.measure_against_first(&square(0.0, 6.0, 42.0)));
        assert!(blurred.moved_px < 0.1 && blurred.sharpness < 0.4, "{blurred:?}");
    }

    /// Expected values, calculated by hand: 16 of 208 profiles have an edge 4 px farther inside. Without outlier
    /// rejection the result would be a motion of 16 · 4/104 = 0.6 px.
    #[test]
    fn neither_a_drop_at_the_edge_nor_an_invisible_outline_is_a_motion() {
        let mut outline = outline();
        outline.set_reference(&square(0.0, 1.0, 70.0)).expect("contrast");
        let mut dented = square(0.0, 1.0, 70.0);
        for row in 60..76 {
            dented.rgb[row * 100 + 18..row * 100 + 24].fill([180; 3]);
        }
        assert!(seen(outline.measure_against_first(&dented)).moved_px < 0.1);
        assert_eq!(outline.measure_against_first(&square(0.0, 1.0, 178.0)), OutlineMeasurement::Lost(0.0));
    }

    #[test]
    fn without_contrast_nothing_is_reported() {
        let mut outline = outline();
        assert_eq!(outline.set_reference(&square(0.0, 1.0, 178.0)), None);
        assert_eq!(outline.measure_against_first(&square(0.0, 1.0, 70.0)), OutlineMeasurement::NoContrast);
    }

    /// A red panel of (190, 40, 30) on a grey background of 125 differs from it by 39 grey levels when dry. When wet,
    /// (150, 110, 100), it differs by hardly 5. Expected values, calculated by hand: in the red channel the edge has 65
    /// levels when dry and 25 when wet, so a shift of 2 px can still be measured. If the wet panel is (120, 128, 122),
    /// no channel shows the edge.
    #[test]
    fn an_outline_without_gray_contrast_is_seen_in_its_colours() {
        let coloured = |shift: f32, inside: [f32; 3]| {
            let channels = inside.map(|level| square(shift, 1.0, level).rgb);
            let mut picture = square(shift, 1.0, 0.0);
            for (index, pixel) in picture.rgb.iter_mut().enumerate() {
                // The background has 125 levels instead of 180.
                *pixel = std::array::from_fn(|i| {
                    let share = (180.0 - f32::from(channels[i][index][0])) / (180.0 - inside[i]);
                    (125.0 + share * (inside[i] - 125.0)) as u8
                });
            }
            picture
        };
        let mut outline = outline();
        outline.set_reference(&coloured(0.0, [190.0, 40.0, 30.0])).expect("contrast");
        for shift in [0.0, 2.0] {
            let found = seen(outline.measure_against_first(&coloured(shift, [150.0, 110.0, 100.0])));
            assert!((found.moved_px - f64::from(shift)).abs() < 0.25, "{shift}: {found:?}");
        }
        assert_eq!(
            outline.measure_against_first(&coloured(0.0, [120.0, 128.0, 122.0])),
            OutlineMeasurement::Lost(0.0)
        );
    }
}
