//! The defects that a trial's scene can have.

use strum::{IntoStaticStr, VariantArray};

/// Defects of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr, VariantArray)]
pub enum SceneDefect {
    /// No panel, only other objects.
    #[strum(serialize = "no panel")]
    Nothing,
    /// Another panel is in the fixture.
    #[strum(serialize = "another panel")]
    Another,
    /// The mirror image of the panel is in the fixture.
    #[strum(serialize = "mirror image")]
    Mirror,
    /// The panel shows its back.
    #[strum(serialize = "its back")]
    Back,
    /// A panel that is 2 to 5 % larger or smaller.
    #[strum(serialize = "2 to 5 % off in size")]
    Size,
    /// A panel that is bent by 2 to 5 mm.
    #[strum(serialize = "bent by 2 to 5 mm")]
    Bent,
    /// A panel from which a strip of its length is cut off.
    #[strum(serialize = "a strip cut off")]
    Trimmed,
    /// More than 40 % of the panel is hidden.
    #[strum(serialize = "over 40 % hidden")]
    Hidden,
    /// More than 35 % of the panel is outside the picture.
    #[strum(serialize = "over 35 % out of view")]
    OutOfView,
    /// A panel that looks the same after half a turn.
    #[strum(serialize = "symmetric")]
    Symmetric,
    /// The camera has moved since teaching, by 1 to 10 mm.
    #[strum(serialize = "camera moved")]
    CameraMoved,
    /// Water on the panel: most points are missing, many are wrong.
    #[strum(serialize = "wet")]
    Wet,
    /// The panel moved during the scan: the picture is smeared.
    #[strum(serialize = "moved while scanned")]
    Smeared,
    /// Two panels of the same kind are present.
    #[strum(serialize = "two panels")]
    TwoPanels,
    /// A flat panel, equal to its mirror image, that has the marks of its mirror image.
    #[strum(serialize = "mirrored marks")]
    MirroredMarks,
    /// A flat panel that is held at a side other than at teaching.
    #[strum(serialize = "holder moved")]
    HolderMoved,
    /// The panel's warp has grown by 1 to 2 mm.
    #[strum(serialize = "warp grown by 1 to 2 mm")]
    Warped,
}

impl SceneDefect {
    /// Every kind.
    pub const ALL: &'static [SceneDefect] = <Self as VariantArray>::VARIANTS;

    /// Returns the description for messages.
    pub fn describe(self) -> &'static str {
        self.into()
    }
}
