//! The phases of a film and the times at which they begin.

/// What happens to the panel at a time of the film.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum Phase {
    /// Before the spray.
    Dry,
    /// Water runs down over the panel.
    Spray,
    /// The whole panel has been reached; the film is watched.
    Wet,
}

impl Phase {
    /// The word in `clip.csv`.
    pub fn word(self) -> &'static str {
        self.into()
    }
}

/// When the panel is fully wet and its film is watched from, s.
pub const WET_FROM_S: f64 = 4.0;
/// When the spray begins, s.
pub const SPRAY_FROM_S: f64 = 1.0;
