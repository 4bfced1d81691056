//! The phases of a film and the times at which they begin.

/// The phase of the film at one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum Phase {
    /// Before the spray.
    Dry,
    /// Water runs down over the panel.
    Spray,
    /// Water has reached the whole panel; the film is watched.
    Wet,
}

impl Phase {
    /// The phase's keyword in `clip.csv`.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}

/// Time from which the panel is fully wet and its film is watched, s.
pub const WET_FROM_S: f64 = 4.0;
/// Time at which the spray begins, s.
pub const SPRAY_FROM_S: f64 = 1.0;
