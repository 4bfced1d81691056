//! Checks whether a place that is as bright as the dry panel has the dry panel's colour, too.
//!
//! A film that mirrors something white adds the same amount to each channel. On a coloured panel such a place may
//! be as bright as the dry one and not have its colour. With the channels' levels s, the dry ones d, the lamp's
//! tint t and the place's own light r,
//!     e = s − r t d,  r = Σ s / Σ t d,        of the dry colour:  max e − min e ≤ 6 levels + max d / 16.       (1)
//! The bound is four times a camera's noise. On a grey panel (1) always holds: colour gives no information there.

/// The error in (1) that noise causes, in grey levels and as a fraction of the brightest channel.
const NOISE_LEVELS: f64 = 6.0;
const NOISE_SHARE: f64 = 1.0 / 16.0;

/// Returns the result of (1) for a place's channels now and when it was dry.
pub(super) fn has_dry_colour_ratio(now: [u8; 3], dry: [u8; 3], tint: [f64; 3]) -> bool {
    let [now, dry] = [now, dry].map(|rgb| rgb.map(f64::from));
    let lit: [f64; 3] = std::array::from_fn(|i| tint[i] * dry[i]);
    let light = now.iter().sum::<f64>() / lit.iter().sum::<f64>().max(1.0);
    let off: [f64; 3] = std::array::from_fn(|i| now[i] - light * lit[i]);
    let [most, least] = [f64::max, f64::min].map(|of| off.into_iter().reduce(of).unwrap_or(0.0));
    most - least <= NOISE_LEVELS + NOISE_SHARE * dry.into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a film changes a red primer of (100, 35, 35) to (58, 13, 13). With 25 levels of a white reflection
    /// it is (83, 38, 38), r = 159/170, e = −10.5, 5.3, 5.3. The distance is 15.8 (limit 12.25). On grey the
    /// same film has no other colour.
    #[test]
    fn a_white_reflection_on_red_has_not_the_dry_colour() {
        let red = [100, 35, 35];
        let none = [1.0; 3];
        assert!(has_dry_colour_ratio([103, 34, 37], red, none) && has_dry_colour_ratio([80, 28, 28], red, none));
        assert!(!has_dry_colour_ratio([83, 38, 38], red, none));
        assert!(has_dry_colour_ratio([57; 3], [57; 3], none));
        // A lamp that is now a fifth redder turns dry red into (120, 35, 35).
        assert!(has_dry_colour_ratio([120, 35, 35], red, [1.2, 1.0, 1.0]));
    }
}
