//! The profile of a picture across one place on an outline, and the edge in it.
//!
//! The edge lies at the centre of the profile's gradient; the height of the gradient's peak measures the sharpness.

use nalgebra::Vector2;
use panelprep_base::geometry::ColorPicture;

/// The length of a profile to each side, px.
pub(super) const REACH_PX: i32 = 8;
const COUNT: usize = 2 * REACH_PX as usize + 1;
/// The minimum contrast with which a profile carries information, levels.
pub(super) const MIN_CONTRAST: f32 = 12.0;
/// The part of a profile's gradient below this fraction of its largest step is noise.
const NOISE_SHARE: f32 = 0.25;

/// The views of a pixel: the mean of its channels, and each of the channels.
pub(super) const VIEWS: usize = 4;
pub(super) const GRAY: usize = 0;

/// One place on the outline.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeLocation {
    pub(super) at: Vector2<f32>,
    pub(super) normal: Vector2<f32>,
}

/// An edge in one profile.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    /// Distance of the edge from the profile's middle along the normal, px.
    pub(super) offset_px: f32,
    /// The largest step as a fraction of the edge's contrast.
    pub(super) sharpness: f32,
    pub(super) contrast: f32,
}

/// The profile of a picture across one place.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Profile {
    pub(super) edge: Option<Edge>,
    /// Mean level along the profile; `None` outside of the picture.
    pub(super) mean: Option<f32>,
}

/// The levels across a place in one view; `None` if the profile leaves the picture.
fn read_profile(place: &EdgeLocation, picture: &ColorPicture, view: usize) -> Option<[f32; COUNT]> {
    let mut profile = [0.0_f32; COUNT];
    for (value, step) in profile.iter_mut().zip(-REACH_PX..) {
        *value = level(picture, place.at + place.normal * step as f32, view)?;
    }
    Some(profile)
}

pub(super) fn profiles(place: &EdgeLocation, picture: &ColorPicture) -> [Profile; VIEWS] {
    std::array::from_fn(|view| {
        let mean = read_profile(place, picture, view).map(|profile| profile.iter().sum::<f32>() / COUNT as f32);
        Profile { edge: edge(place, picture, view), mean }
    })
}

pub(super) fn edges(place: &EdgeLocation, picture: &ColorPicture) -> [Option<Edge>; VIEWS] {
    std::array::from_fn(|view| edge(place, picture, view))
}

pub(super) fn edge(place: &EdgeLocation, picture: &ColorPicture, view: usize) -> Option<Edge> {
    let profile = read_profile(place, picture, view)?;
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

/// Interpolates one view between four pixels; `None` outside of the picture.
fn level(picture: &ColorPicture, at: Vector2<f32>, view: usize) -> Option<f32> {
    let within = |at: f32, length: usize| at >= 0.0 && at < length as f32 - 1.0;
    if !within(at.x, picture.width) || !within(at.y, picture.height) {
        return None;
    }
    let (column, row) = (at.x as usize, at.y as usize);
    let (across, down) = (at.x - column as f32, at.y - row as f32);
    let value = |rgb: [u8; 3]| match view {
        GRAY => f32::from(rgb.iter().map(|&level| u16::from(level)).sum::<u16>()) / 3.0,
        _ => f32::from(rgb[view - 1]),
    };
    let mix = |row: usize| {
        let pixels = &picture.rgb[row * picture.width + column..][..2];
        value(pixels[0]) * (1.0 - across) + value(pixels[1]) * across
    };
    Some(mix(row) * (1.0 - down) + mix(row + 1) * down)
}
