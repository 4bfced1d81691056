//! The time of a break as a colour in `times.png`.
//!
//! A pixel that broke has blue 255; red · 256 + green is the time in hundredths of a second since the first fully
//! wet picture. Any other pixel is black.

/// Converts a time to a colour.
pub fn time_to_color(since_wet_s: Option<f64>) -> [u8; 3] {
    since_wet_s.map_or([0; 3], |since_wet_s| {
        let [red, green] = ((since_wet_s * 100.0).round().clamp(0.0, 65_535.0) as u16).to_be_bytes();
        [red, green, 255]
    })
}

/// The time that a colour encodes; `None` if the pixel did not break.
pub fn decoded([red, green, blue]: [u8; 3]) -> Option<f64> {
    (blue == 255).then(|| f64::from(u16::from_be_bytes([red, green])) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_survive_their_colour() {
        for time_s in [None, Some(0.0), Some(0.25), Some(59.99), Some(600.0)] {
            assert_eq!(decoded(time_to_color(time_s)), time_s);
        }
    }
}
