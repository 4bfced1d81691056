//! A corrected pose, and what each corner contributes to it.

use panelprep_base::geometry::{Base, Degrees, Panel, Pixel, Rigid};

/// The result of one corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerReport {
    /// Number of the corner among the taught corners, from 0.
    pub corner: usize,
    /// The expected position of the corner.
    pub expected_px: Pixel,
    /// Distance between the found and the expected position, px.
    pub error_px: f64,
    /// The shift that this corner alone indicates, along its camera's X and Y, mm.
    pub shift_mm: [f64; 2],
    /// The part of this shift that remains after the common correction, mm.
    pub remaining_shift_mm: f64,
}

impl CornerReport {
    /// The size of the shift of the panel that this corner alone indicates, mm.
    pub fn indicated_shift_mm(&self) -> f64 {
        self.shift_mm[0].hypot(self.shift_mm[1])
    }
}

/// A corrected pose and the data on which it is based.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedPose {
    /// The panel's pose.
    pub base_from_panel: Rigid<Base, Panel>,
    /// The correction along X and Y of the first camera, mm.
    pub shift_mm: [f64; 2],
    /// Angle by which the panel was turned, if there are two or more corners at different places.
    pub rotation: Degrees,
    /// The largest distance between found and expected corner, px.
    pub error_px: f64,
    /// Each corner, in the order of the views.
    pub corners: Vec<CornerReport>,
}
