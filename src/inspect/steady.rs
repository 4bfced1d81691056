//! Is the panel still where it was, and is it in focus? Told by its outline, which is seen wet or dry.
//!
//! Across the outline, a profile's gradient has its centre where the edge is and a peak that is as high as the edge is
//! sharp; neither changes with light, nor with the film inside. For edges at normals nᵢ that moved by δᵢ, the panel moved
//! by the d that minimises  Σ (nᵢ·d − δᵢ)²,  without those that lie far from it.  (1)
//! An outline without contrast tells nothing, and is said to.
//!
//! Does it stand where the pose puts it? The same profiles in the taught picture say where on each the edge is when the
//! panel is in its place. In the dry picture of a panel that stands there each edge is at the same place of its profile.

use crate::geometry::{Camera, ColorPicture, Panel, PinholeCamera, Pixel, Rigid, median};
use crate::panel::TaughtPanel;
use nalgebra::{Matrix2, Vector2};

/// Places on the outline, and how far a profile reaches to both sides, px.
const PLACES: usize = 240;
const REACH_PX: i32 = 8;
/// A profile needs this much contrast in the dry picture, and a peak of this share of it, to tell anything.
const MIN_CONTRAST: f32 = 12.0;
const MIN_PROFILES: usize = 40;
/// A profile of the taught picture is expected again where it keeps so many times the least contrast in today's light.
const SURE_CONTRAST: f32 = 1.5;
/// Of a profile's gradient, what is below this share of its largest step is noise.
const NOISE_SHARE: f32 = 0.25;

/// One place on the outline.
#[derive(Debug, Clone, Copy)]
struct EdgeLocation {
    at: Vector2<f32>,
    normal: Vector2<f32>,
}

/// An edge in one profile.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// From the profile's middle along the normal, px.
    offset_px: f32,
    /// The largest step as a share of the whole way.
    sharpness: f32,
    contrast: f32,
}

/// The outline as the dry picture shows it.
#[derive(Debug)]
pub struct Outline {
    places: Vec<EdgeLocation>,
    /// What the taught picture shows at each place, with the panel where it was taught.
    taught: Vec<Profile>,
    first: Vec<Option<Edge>>,
}

/// What a picture shows across one place.
#[derive(Debug, Clone, Copy, Default)]
struct Profile {
    edge: Option<Edge>,
    /// Mean grey level along it; none beyond the picture.
    mean: Option<f32>,
}

/// The outline against the first picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steadiness {
    /// How far the panel moved in the picture, px.
    pub moved_px: f64,
    /// Sharpness against the first picture's: 1 is as sharp.
    pub sharpness: f64,
}

impl Outline {
    /// The taught outline where the panel stands now.
    pub fn new(taught: &TaughtPanel, camera: &PinholeCamera, camera_from_panel: Rigid<Camera, Panel>) -> Self {
        let nominal = taught.panel_from_camera.inverse();
        let project = |&point| {
            let now = camera.project_inside(camera_from_panel * point)?;
            Some((now, taught.camera.project_inside(nominal * point)?))
        };
        let (pixels, then): (Vec<Pixel>, Vec<Pixel>) = taught.outline.iter().filter_map(project).unzip();
        let step = (pixels.len() / PLACES).max(1);
        // The normal over some pixels to both sides: the taught outline goes from pixel to pixel.
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
        let taught = then.iter().map(|place| Profile::of(place, &picture)).collect();
        Outline { places, taught, first: Vec::new() }
    }

    /// How far the panel's outline in this dry picture lies from where the pose puts it, px: the larger of its shift, by (1),
    /// and of the median of its profiles, which tells turns and another distance. Where most of the outline is not within
    /// reach of them, it is farther than they reach. `None` where the outline has too little contrast to tell.
    pub fn off_px(&self, picture: &ColorPicture) -> Option<f64> {
        let now: Vec<Profile> = self.places.iter().map(|place| Profile::of(place, picture)).collect();
        let both = || self.taught.iter().zip(&now);
        let mut light: Vec<f32> =
            both().filter_map(|(then, now)| Some(now.mean? / then.mean.filter(|mean| *mean > 1.0)?)).collect();
        let light = middle(&mut light);
        let expected = |edge: &Edge| edge.contrast * light >= SURE_CONTRAST * MIN_CONTRAST;
        let count = self.taught.iter().filter(|then| then.edge.as_ref().is_some_and(expected)).count();
        if count < MIN_PROFILES {
            return None;
        }
        let offset = |(place, (then, now)): (&EdgeLocation, (&Profile, &Profile))| {
            Some((place.normal, now.edge?.offset_px - then.edge.filter(expected)?.offset_px))
        };
        let offsets: Vec<(Vector2<f32>, f32)> = self.places.iter().zip(both()).filter_map(offset).collect();
        if 2 * offsets.len() < count {
            return Some(f64::from(REACH_PX));
        }
        let mut off: Vec<f32> = offsets.iter().map(|(_, offset)| offset.abs()).collect();
        Some(f64::from(moved(&offsets).norm().max(middle(&mut off))))
    }

    /// Takes this picture as the one that later ones are held against. Its own sharpness comes back: the largest step as
    /// a share of the edge; `None` where the outline has no contrast.
    pub fn begin(&mut self, picture: &ColorPicture) -> Option<f64> {
        self.first = self.places.iter().map(|place| edge(place, picture)).collect();
        let mut sharp: Vec<f32> = self.first.iter().flatten().map(|edge| edge.sharpness).collect();
        (sharp.len() >= MIN_PROFILES).then(|| f64::from(middle(&mut sharp)))
    }

    /// What moved since, and how sharp it is.
    pub fn hold_against(&self, picture: &ColorPicture) -> Option<Steadiness> {
        let pairs: Vec<(EdgeLocation, Edge, Option<Edge>)> = (self.places.iter().zip(&self.first))
            .filter_map(|(place, first)| first.map(|first| (*place, first, edge(place, picture))))
            .collect();
        if pairs.len() < MIN_PROFILES {
            return None;
        }
        let seen: Vec<(EdgeLocation, Edge, Edge)> = pairs
            .iter()
            .filter_map(|&(place, first, now)| {
                now.filter(|now| now.contrast > 0.3 * first.contrast).map(|now| (place, first, now))
            })
            .collect();
        // Most of the outline is gone: the panel is elsewhere, or nothing is seen.
        if seen.len() * 2 < pairs.len() {
            return Some(Steadiness { moved_px: f64::from(REACH_PX), sharpness: 0.0 });
        }
        let shifts: Vec<(Vector2<f32>, f32)> =
            seen.iter().map(|(place, first, now)| (place.normal, now.offset_px - first.offset_px)).collect();
        let mut sharp: Vec<f32> = seen.iter().map(|(_, first, now)| now.sharpness / first.sharpness).collect();
        Some(Steadiness { moved_px: f64::from(moved(&shifts).norm()), sharpness: f64::from(middle(&mut sharp)) })
    }
}

// (1), four times, without what lies more than three times the median away
fn moved(shifts: &[(Vector2<f32>, f32)]) -> Vector2<f32> {
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
        bound = (3.0 * middle(&mut left)).max(0.05);
    }
    d
}

const COUNT: usize = 2 * REACH_PX as usize + 1;

/// The grey levels across a place; `None` where they leave the picture.
fn profile_of(place: &EdgeLocation, picture: &ColorPicture) -> Option<[f32; COUNT]> {
    let mut profile = [0.0_f32; COUNT];
    for (value, step) in profile.iter_mut().zip(-REACH_PX..) {
        *value = gray(picture, place.at + place.normal * step as f32)?;
    }
    Some(profile)
}

impl Profile {
    fn of(place: &EdgeLocation, picture: &ColorPicture) -> Self {
        let mean = profile_of(place, picture).map(|profile| profile.iter().sum::<f32>() / COUNT as f32);
        Profile { edge: edge(place, picture), mean }
    }
}

fn edge(place: &EdgeLocation, picture: &ColorPicture) -> Option<Edge> {
    let profile = profile_of(place, picture)?;
    let steps: [f32; COUNT - 1] = std::array::from_fn(|i| profile[i + 1] - profile[i]);
    let contrast = (profile[..4].iter().sum::<f32>() - profile[COUNT - 4..].iter().sum::<f32>()).abs() / 4.0;
    let largest = steps.iter().fold(0.0_f32, |largest, step| largest.max(step.abs()));
    if contrast < MIN_CONTRAST {
        return None;
    }
    let (mut sum, mut weight) = (0.0, 0.0);
    for (i, step) in steps.iter().enumerate() {
        let height = (step.abs() - NOISE_SHARE * largest).max(0.0);
        sum += height * (i as f32 + 0.5 - REACH_PX as f32);
        weight += height;
    }
    Some(Edge { offset_px: sum / weight, sharpness: largest / contrast, contrast })
}

/// The mean of the channels between four pixels; `None` beyond the picture.
fn gray(picture: &ColorPicture, at: Vector2<f32>) -> Option<f32> {
    let within = |at: f32, length: usize| at >= 0.0 && at < length as f32 - 1.0;
    if !within(at.x, picture.width) || !within(at.y, picture.height) {
        return None;
    }
    let (column, row) = (at.x as usize, at.y as usize);
    let (across, down) = (at.x - column as f32, at.y - row as f32);
    let value = |[r, g, b]: [u8; 3]| f32::from(u16::from(r) + u16::from(g) + u16::from(b)) / 3.0;
    let mix = |row: usize| {
        let pixels = &picture.rgb[row * picture.width + column..][..2];
        value(pixels[0]) * (1.0 - across) + value(pixels[1]) * across
    };
    Some(mix(row) * (1.0 - down) + mix(row + 1) * down)
}

/// The median, 0 of none.
fn middle(values: &mut [f32]) -> f32 {
    median(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dark square of 60 px before a light ground, its edges `blur_px` wide, `shift` to the right; `inside` grey.
    fn square(shift: f32, blur_px: f32, inside: f32) -> ColorPicture {
        let mut picture = ColorPicture::filled(100, 100, [0; 3]);
        let cover = |from: f32, at: f32| ((at - from) / blur_px + 0.5).clamp(0.0, 1.0);
        for (index, pixel) in picture.rgb.iter_mut().enumerate() {
            let (u, v) = ((index % 100) as f32 - shift, (index / 100) as f32);
            let share = cover(20.0, u) * cover(-80.0, -u) * cover(20.0, v) * cover(-80.0, -v);
            *pixel = [(180.0 + (inside - 180.0) * share) as u8; 3];
        }
        picture
    }

    fn outline() -> Outline {
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
        let taught = places.iter().map(|place| Profile::of(place, &square(0.0, 1.0, 70.0))).collect();
        Outline { places, taught, first: Vec::new() }
    }

    /// By hand: 3 px to the right alone show on two of the four sides; with 4 px down as well it is 5 px away.
    #[test]
    fn a_panel_that_stands_elsewhere_is_told_from_one_in_its_place() {
        let outline = outline();
        let off = |picture: &ColorPicture| outline.off_px(picture);
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
        assert_eq!(away(14, 14), Some(f64::from(REACH_PX)), "farther than the profiles reach");
        dimmed.rgb.iter_mut().for_each(|pixel| *pixel = pixel.map(|gray| gray / 6));
        assert_eq!(off(&dimmed), None, "too dark to tell");
    }

    #[test]
    fn a_shift_and_a_blur_are_measured_whatever_the_film_inside() {
        let mut outline = outline();
        assert!(outline.begin(&square(0.0, 1.0, 70.0)).expect("contrast") > 0.4);
        for shift in [0.0, 0.4, 1.0, 3.0] {
            let found = outline.hold_against(&square(shift, 1.0, 42.0)).expect("contrast");
            assert!((found.moved_px - f64::from(shift)).abs() < 0.15, "{shift}: {found:?}");
            assert!(found.sharpness > 0.7, "{found:?}");
        }
        let blurred = outline.hold_against(&square(0.0, 6.0, 42.0)).expect("contrast");
        assert!(blurred.moved_px < 0.1 && blurred.sharpness < 0.4, "{blurred:?}");
    }

    /// By hand: 16 of 208 places see an edge 4 px farther in, which alone would be a move of 16 · 4/104 = 0.6 px.
    #[test]
    fn a_drop_at_the_edge_is_no_move_and_a_panel_that_is_gone_is_one() {
        let mut outline = outline();
        outline.begin(&square(0.0, 1.0, 70.0)).expect("contrast");
        let mut dented = square(0.0, 1.0, 70.0);
        for row in 60..76 {
            dented.rgb[row * 100 + 18..row * 100 + 24].fill([180; 3]);
        }
        assert!(outline.hold_against(&dented).expect("contrast").moved_px < 0.1);
        let gone = Steadiness { moved_px: f64::from(REACH_PX), sharpness: 0.0 };
        assert_eq!(outline.hold_against(&square(0.0, 1.0, 178.0)), Some(gone));
    }

    #[test]
    fn without_contrast_nothing_is_told() {
        let mut outline = outline();
        assert_eq!(outline.begin(&square(0.0, 1.0, 178.0)), None);
        assert_eq!(outline.hold_against(&square(0.0, 1.0, 70.0)), None);
    }
}
