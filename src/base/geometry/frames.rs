//! Frames, angles and pixels as types, so that no public function accepts two bare numbers side by side.
//!
//! A frame is the reference of a measurement. Every point, direction and transform carries its frame, so that adding a
//! camera point to a base point does not compile. Types cannot distinguish the same frame at two times: if a person
//! bumps the panel, `Panel` before and after is one type but two poses. This is why tokens and Verify exist.
//!
//! Lengths are `f64` in mm with the unit in their name, inside tagged points and transforms. Angles cross every
//! boundary in degrees; [`Degrees::to_rad`] is the only conversion to radians for a kernel.

use serde::{Deserialize, Serialize};

/// A coordinate frame; implemented only by the markers of this module.
pub trait Frame: Copy + std::fmt::Debug + PartialEq + Send + Sync + 'static {
    /// The name used in messages.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident = $text:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {}
        impl Frame for $name { const NAME: &'static str = $text; }
    )*};
}

frames! {
    /// The robot's base; the world, as in thesis 3.3. X forward, Z up, mm.
    Base = "base";
    /// The panel. At its nominal pose it coincides with `Base` (thesis 3.8).
    Panel = "panel";
    /// The fixed 3D camera: x right, y down, z out of the lens.
    Camera = "camera";
    /// The 2D camera on the flange: x right, y down, z out of the lens.
    FlangeCamera = "flange camera";
    /// The robot's mounting flange; Z away from the arm.
    Flange = "flange";
    /// The sanding tool; Z out of the pad, into the panel.
    Tool = "tool";
    /// The drawing of a panel: the frame of its file.
    Drawing = "drawing";
    /// A calibration board; origin in its first inner corner, Z away from the viewer.
    Board = "board";
}

/// Standard gravity, m/s²: a mass of 1 kg has a weight of 9.80665 N.
pub const STANDARD_GRAVITY_M_S2: f64 = 9.806_65;

/// An angle in degrees.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Degrees(pub f64);

impl Degrees {
    /// Returns the angle in radians, for use in numerical code.
    pub fn to_rad(self) -> f64 {
        self.0.to_radians()
    }

    /// Creates an angle from radians that numerical code has computed.
    pub fn from_rad(angle_rad: f64) -> Self {
        Degrees(angle_rad.to_degrees())
    }
}

impl std::fmt::Display for Degrees {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}°", crate::number_text::fixed_decimals(self.0, 3))
    }
}

/// A position in a picture, px. Whole numbers are pixel centres, as in OpenCV; u to the right, v down.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pixel {
    /// Column, px.
    pub u: f64,
    /// Row, px.
    pub v: f64,
}

impl Pixel {
    /// Creates the pixel at column `u`, row `v`.
    pub fn at(u: f64, v: f64) -> Self {
        Pixel { u, v }
    }

    /// Calculates the distance to another pixel, px.
    pub fn distance_px(self, other: Pixel) -> f64 {
        (self.u - other.u).hypot(self.v - other.v)
    }

    /// The nearest whole pixel in a picture of this size; `None` outside of the picture.
    pub fn nearest_whole(self, width: usize, height: usize) -> Option<(usize, usize)> {
        let (column, row) = (self.u.round(), self.v.round());
        let inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
        inside.then_some((column as usize, row as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 180° is π.
    #[test]
    fn degrees_become_radians_and_back() {
        assert!((Degrees(180.0).to_rad() - std::f64::consts::PI).abs() < 1e-15);
        assert!((Degrees::from_rad(std::f64::consts::FRAC_PI_6).0 - 30.0).abs() < 1e-12);
    }

    /// Pixel (−0.4, 1.6) is column 0, row 2; half a pixel beyond the last column is outside.
    #[test]
    fn whole_pixels_end_half_a_pixel_outside_the_centres() {
        assert_eq!(Pixel::at(-0.4, 1.6).nearest_whole(4, 3), Some((0, 2)));
        assert_eq!(Pixel::at(3.6, 1.0).nearest_whole(4, 3), None);
        assert_eq!(Pixel::at(f64::NAN, 1.0).nearest_whole(4, 3), None);
    }
}
