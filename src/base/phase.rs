//! The phases of the water-break test: the state of the panel while a picture is captured.

use strum::{Display, EnumString, IntoStaticStr, VariantArray};

/// A phase of the test, in the order of the test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Display, EnumString, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "lowercase")]
pub enum Phase {
    /// Before the water is turned on.
    Dry,
    /// The water spray is on and the panel is not yet fully wet; pictures of this phase are not examined.
    Spray,
    /// The water is off; the first picture of this phase is the first one with a fully wet panel.
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
