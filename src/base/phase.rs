//! The phases of the water-break test: what is done to the panel while a picture is taken.

use strum::{Display, EnumString, IntoStaticStr, VariantArray};

/// A phase of the test, in the order of the test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Display, EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "lowercase")]
pub enum Phase {
    /// Before the water is on.
    Dry,
    /// Under the spray: not yet fully wet; such pictures are not examined.
    Spray,
    /// The water is off; the first such picture is the first fully wet one.
    Wet,
}

impl Phase {
    /// All phases, in order.
    pub const ALL: &'static [Phase] = <Self as VariantArray>::VARIANTS;

    /// Returns the phase's keyword in `clip.csv`.
    pub fn keyword(self) -> &'static str {
        self.into()
    }
}
