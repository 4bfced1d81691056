//! What one picture of the wet panel gives, before its pixels are judged.

/// The measurements of one picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PictureMeasurement {
    /// The light against the dry picture's; the region's median.
    pub light: f64,
    /// The share of the region whose light agrees with the prediction from its state.
    pub told: f64,
    /// The share of the region that glints and overexposure hide.
    pub hidden: f64,
    /// Bit-equal to the picture before: the camera stands still.
    pub frozen: bool,
    /// τ, read from the clip or assumed.
    pub film_left: f64,
    /// By how much the lamp flickers, where it or water changed the surroundings and nobody knows which; else 0. Percent.
    pub flicker_percent: f64,
}
