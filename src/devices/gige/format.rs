//! The supported pixel formats, by their names in GenICam's Pixel Format Naming Convention.

use strum::{IntoStaticStr, VariantArray};

/// A format with one byte a pixel: brightness, or the one colour that the pixel's filter passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr, VariantArray)]
pub enum PixelFormat {
    /// Brightness.
    Mono8,
    /// Filters red, green in the first row; green, blue in the second.
    BayerRG8,
    /// Filters green, red in the first row; blue, green in the second.
    BayerGR8,
    /// Filters green, blue in the first row; red, green in the second.
    BayerGB8,
    /// Filters blue, green in the first row; green, red in the second.
    BayerBG8,
}

impl PixelFormat {
    /// All pixel formats.
    pub const ALL: &'static [PixelFormat] = <Self as VariantArray>::VARIANTS;

    /// The name, `BayerRG8`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the format's number in a frame's leader.
    pub fn code(self) -> u32 {
        match self {
            PixelFormat::Mono8 => 0x0108_0001,
            PixelFormat::BayerGR8 => 0x0108_0008,
            PixelFormat::BayerRG8 => 0x0108_0009,
            PixelFormat::BayerGB8 => 0x0108_000a,
            PixelFormat::BayerBG8 => 0x0108_000b,
        }
    }

    /// Returns the format with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|format| format.name() == name)
    }

    /// Returns a format's name by its code, according to GenICam's naming convention. This includes formats that
    /// this program does not accept.
    pub fn name_of_code(code: u32) -> String {
        let ours = Self::ALL.iter().copied().find(|format| format.code() == code).map(Self::name);
        let other = || match code {
            0x0110_0003 => Some("Mono10"),
            0x0110_0005 => Some("Mono12"),
            0x0110_0007 => Some("Mono16"),
            0x0110_000d => Some("BayerRG10"),
            0x0110_0011 => Some("BayerRG12"),
            0x0110_002f => Some("BayerRG16"),
            0x010c_0059 => Some("BayerRG12p"),
            0x0218_0014 => Some("RGB8"),
            _ => None,
        };
        ours.or_else(other).map_or_else(|| format!("format {code:#010x}"), str::to_owned)
    }

    /// Returns the colour that a pixel's filter passes: 0 red, 1 green, 2 blue. `None` if there is no filter.
    pub fn filter(self, column: usize, row: usize) -> Option<usize> {
        // Column and row of the first red pixel.
        let [red_column, red_row] = match self {
            PixelFormat::Mono8 => return None,
            PixelFormat::BayerRG8 => [0, 0],
            PixelFormat::BayerGR8 => [1, 0],
            PixelFormat::BayerGB8 => [0, 1],
            PixelFormat::BayerBG8 => [1, 1],
        };
        Some(usize::from(column % 2 != red_column) + usize::from(row % 2 != red_row))
    }
}
