//! The phases of the water-break test: what is done to the panel while a picture is taken.

/// A phase of the test, in the order in which they follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Before the water.
    Dry,
    /// Under the spray: not yet fully wet, not examined.
    Spray,
    /// The water is off; the first such picture is the first fully wet one.
    Wet,
}

impl Phase {
    /// All of them, in order.
    pub const ALL: [Phase; 3] = [Phase::Dry, Phase::Spray, Phase::Wet];

    /// The word in `clip.csv`.
    pub fn word(self) -> &'static str {
        match self {
            Phase::Dry => "dry",
            Phase::Spray => "spray",
            Phase::Wet => "wet",
        }
    }
}

impl std::fmt::Display for Phase {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.word())
    }
}
