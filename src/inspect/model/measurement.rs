//! What one picture of the wet panel gives, before its pixels are judged.

/// The measurements of one picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PictureMeasurement {
    /// The light against the dry picture's: the lamp's, if it is known, else the median over the region's film.
    pub light: f64,
    /// Is it the lamp's?
    pub is_lamp_known: bool,
    /// The share of the region that is overexposed.
    pub overexposed: f64,
    /// Bit-equal to the picture before: the camera sends one picture again and again.
    pub frozen: bool,
    /// τ, measured or assumed.
    pub film_left: f64,
    /// By how much the lamp flickers, if it or water changed the surroundings and it is not known which; else 0. Percent.
    pub flicker_percent: f64,
}
