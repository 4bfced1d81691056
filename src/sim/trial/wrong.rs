//! The defects that a trial's scene can have.

/// What is wrong with a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrong {
    /// No panel: things alone.
    Nothing,
    /// Another panel.
    Another,
    /// Its mirror image.
    Mirror,
    /// Its back.
    Back,
    /// One that is 2 to 5 % larger or smaller.
    Size,
    /// One that is bent by 2 to 5 mm.
    Bent,
    /// One that has a strip of its length cut off.
    Trimmed,
    /// More than 40 % is hidden.
    Hidden,
    /// More than 35 % is outside of the picture.
    OutOfView,
    /// One that looks the same turned by half a turn.
    Symmetric,
    /// The camera has moved since teaching, by 1 to 10 mm.
    CameraMoved,
    /// Water on the panel: most points are missing, many are wrong.
    Wet,
    /// The panel moved during the scan: the picture is smeared.
    Smeared,
}

impl Wrong {
    /// Every kind.
    pub const ALL: [Wrong; 13] = [
        Wrong::Nothing,
        Wrong::Another,
        Wrong::Mirror,
        Wrong::Back,
        Wrong::Size,
        Wrong::Bent,
        Wrong::Trimmed,
        Wrong::Hidden,
        Wrong::OutOfView,
        Wrong::Symmetric,
        Wrong::CameraMoved,
        Wrong::Wet,
        Wrong::Smeared,
    ];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Wrong::Nothing => "no panel",
            Wrong::Another => "another panel",
            Wrong::Mirror => "mirror image",
            Wrong::Back => "its back",
            Wrong::Size => "2 to 5 % off in size",
            Wrong::Bent => "bent by 2 to 5 mm",
            Wrong::Trimmed => "a strip cut off",
            Wrong::Hidden => "over 40 % hidden",
            Wrong::OutOfView => "over 35 % out of view",
            Wrong::Symmetric => "symmetric",
            Wrong::CameraMoved => "camera moved",
            Wrong::Wet => "wet",
            Wrong::Smeared => "moved while scanned",
        }
    }
}
