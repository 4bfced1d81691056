//! The measurements on one picture of the wet panel, before its pixels are judged.

/// The measurements of one picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PictureMeasurement {
    /// The light relative to the dry picture: the lamp's light if it is known, otherwise the median over the
    /// region's film.
    pub light: f64,
    /// Whether `light` is the lamp's light.
    pub is_lamp_known: bool,
    /// The share of the region that is overexposed.
    pub overexposed: f64,
    /// Whether the picture is bit-equal to the previous one: the camera sends one picture again and again.
    pub frozen: bool,
    /// τ, measured or assumed.
    pub film_transmission: f64,
    /// The flicker of the lamp, percent, if it is not known whether the lamp or water changed the surroundings;
    /// otherwise 0.
    pub flicker_percent: f64,
}
