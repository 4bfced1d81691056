//! The coordinate frames of the cell, as types.
//!
//! A frame is the reference of a measurement. Every point, direction and transform carries its frame, so that adding a
//! camera point to a base point does not compile. Types cannot distinguish the same frame at two times: if a person
//! bumps the panel, `Panel` before and after is one type but two poses. This is why tokens and Verify exist.

/// A coordinate frame; implemented only by the markers of this module.
pub trait Frame: Copy + std::fmt::Debug + PartialEq + Send + Sync + 'static {
    /// The name used in messages.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident = $text:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {}
        impl Frame for $name { const NAME: &'static str = $text; }
    )*};
}

frames! {
    /// The robot's base; the world, as in thesis 3.3. X forward, Z up, mm.
    Base = "base";
    /// The panel. At its nominal pose it coincides with `Base` (thesis 3.8).
    Panel = "panel";
    /// The fixed 3D camera: x right, y down, z out of the lens.
    Camera = "camera";
    /// The 2D camera on the flange: x right, y down, z out of the lens.
    FlangeCamera = "flange camera";
    /// The robot's mounting flange; Z away from the arm.
    Flange = "flange";
    /// The sanding tool; Z out of the pad, into the panel.
    Tool = "tool";
    /// The drawing of a panel: the frame of its file.
    Drawing = "drawing";
    /// A calibration board; origin in its first inner corner, Z away from the viewer.
    Board = "board";
}
