//! The water on the panel, expressed as a time of the film.
//!
//! The film's own time begins dry; the film is sprayed from [`SPRAY_FROM_S`] and watched from [`WET_FROM_S`] on. If it
//! is sprayed for less than the time in between, the front of the water stays where it is. Longer spraying keeps the
//! film new until the water is off.

use panelprep_sim::{SPRAY_FROM_S, WET_FROM_S};

/// The last time that the water was on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LastWetting {
    pub on_ms: u64,
    pub off_ms: Option<u64>,
}

/// Calculates the film's time at this time of the cell, s. Before the first wetting it also advances, so that no two
/// pictures have the same noise.
pub(super) fn film_s(last: Option<LastWetting>, now_ms: u64) -> f64 {
    let Some(LastWetting { on_ms, off_ms }) = last else { return -seconds(now_ms) };
    let reached_s = SPRAY_FROM_S + seconds(off_ms.unwrap_or(now_ms).saturating_sub(on_ms));
    match off_ms {
        Some(off_ms) if reached_s >= WET_FROM_S => WET_FROM_S + seconds(now_ms.saturating_sub(off_ms)),
        _ => reached_s.min(WET_FROM_S),
    }
}

pub(super) fn seconds(ms: u64) -> f64 {
    ms as f64 / 1_000.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: the spray is watched from 1 s to 4 s of the film's time.
    #[test]
    fn three_seconds_of_water_make_a_film() {
        let sprayed = |off_ms| Some(LastWetting { on_ms: 10_000, off_ms });
        assert!(film_s(None, 20_000) < SPRAY_FROM_S);
        assert_eq!(film_s(sprayed(None), 10_000), 1.0);
        assert_eq!(film_s(sprayed(None), 12_000), 3.0);
        assert_eq!(film_s(sprayed(None), 19_000), 4.0, "new as long as water comes");
        assert_eq!(film_s(sprayed(Some(15_000)), 15_000), 4.0);
        assert_eq!(film_s(sprayed(Some(15_000)), 45_000), 34.0);
        assert_eq!(film_s(sprayed(Some(12_000)), 45_000), 3.0, "half-way down and no further");
    }
}
