//! The supported pixel formats, by their names in GenICam's Pixel Format Naming Convention, and the conversion of one
//! colour per pixel to three, and back.
//!
//! Each pixel's filter blocks two colours. Linear filters estimate these from the neighbours: they add to the
//! bilinear mean a part of the known colour's curvature at that pixel:
//!     G at R = mean of 4 G + ½ ΔR,   R at B = mean of 4 R + ¾ ΔB,   R at G = mean of 2 R + ⅝ ΔG,             (1)
//! as 5×5 kernels in sixteenths. A grey ramp comes out unchanged. An edge keeps its position and its sharpness,
//! which the bilinear mean alone would blur. Beyond the picture's border its rows and columns are mirrored, which
//! keeps the filters' order. Values outside 0…255 are clipped. Source: Malvar, He, Cutler, High-quality linear
//! interpolation for demosaicing, ICASSP 2004.

use panelprep_base::geometry::ColorPicture;
use rayon::prelude::*;
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

/// Returns the raw pixels of a sensor with these filters for a picture: the inverse of [`demosaic`], except for what
/// (1) cannot restore.
pub fn mosaic(picture: &ColorPicture, format: PixelFormat) -> Vec<u8> {
    let gray = || picture.to_gray().gray;
    let pick = |(index, rgb): (usize, &[u8; 3])| {
        format.filter(index % picture.width, index / picture.width).map(|channel| rgb[channel])
    };
    let picked: Option<Vec<u8>> = picture.rgb.iter().enumerate().map(pick).collect();
    picked.unwrap_or_else(gray)
}

/// Returns the picture of a sensor's raw bytes, one per pixel, row by row. `None` if they are not `width` ×
/// `height`, or if a colour sensor has fewer than three columns or rows.
pub fn demosaic(raw: &[u8], [width, height]: [usize; 2], format: PixelFormat) -> Option<ColorPicture> {
    if raw.len() != width * height {
        return None;
    }
    if format == PixelFormat::Mono8 {
        return Some(ColorPicture { width, height, rgb: raw.iter().map(|&gray| [gray; 3]).collect() });
    }
    if width < 3 || height < 3 {
        return None;
    }
    let mut picture = ColorPicture::uniform(width, height, [0; 3]);
    let at_row = |row: usize, by: isize| {
        let row = mirrored_index(row, by, height);
        &raw[row * width..(row + 1) * width]
    };
    picture.rgb.par_chunks_mut(width).enumerate().for_each(|(row, colors)| {
        let rows = [-2, -1, 0, 1, 2].map(|by| at_row(row, by));
        for (column, color) in colors.iter_mut().enumerate() {
            let columns = [-2, -1, 0, 1, 2].map(|by| mirrored_index(column, by, width));
            let around = |across: usize, down: usize| i32::from(rows[down][columns[across]]);
            *color = interpolate_rgb(format, [column, row], around);
        }
    });
    Some(picture)
}

/// Returns the index of the pixel at this offset; beyond the border it is mirrored, and the border pixel is not
/// repeated.
fn mirrored_index(at: usize, by: isize, count: usize) -> usize {
    let to = at.saturating_add_signed(by);
    match to {
        _ if by < 0 && at < by.unsigned_abs() => by.unsigned_abs() - at,
        _ if to >= count => 2 * (count - 1) - to,
        _ => to,
    }
}

/// Calculates equation (1) at one pixel; `around(2, 2)` is the pixel itself.
fn interpolate_rgb(
    format: PixelFormat,
    [column, row]: [usize; 2],
    around: impl Fn(usize, usize) -> i32,
) -> [u8; 3] {
    let sum = |places: [[usize; 2]; 4]| places.into_iter().map(|[across, down]| around(across, down)).sum::<i32>();
    let own = around(2, 2);
    let (beside, above) = (around(1, 2) + around(3, 2), around(2, 1) + around(2, 3));
    let (far_beside, far_above) = (around(0, 2) + around(4, 2), around(2, 0) + around(2, 4));
    let diagonal = sum([[1, 1], [3, 1], [1, 3], [3, 3]]);
    let byte = |sixteenths: i32| ((sixteenths + 8) >> 4).clamp(0, 255) as u8;
    let own_byte = byte(16 * own);
    match format.filter(column, row) {
        Some(1) => {
            let along = byte(10 * own + 8 * beside - 2 * (far_beside + diagonal) + far_above);
            let across = byte(10 * own + 8 * above - 2 * (far_above + diagonal) + far_beside);
            // Distinguishes red from blue by the colour that shares this row with green.
            match format.filter(column + 1, row) {
                Some(0) => [along, own_byte, across],
                _ => [across, own_byte, along],
            }
        }
        Some(own_channel) => {
            let green = byte(8 * own + 4 * (beside + above) - 2 * (far_beside + far_above));
            let other = byte(12 * own + 4 * diagonal - 3 * (far_beside + far_above));
            if own_channel == 0 { [own_byte, green, other] } else { [other, green, own_byte] }
        }
        None => [own_byte; 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FORMATS: &[PixelFormat] = PixelFormat::ALL;

    fn picture(width: usize, height: usize, color: impl Fn(usize, usize) -> [u8; 3]) -> ColorPicture {
        let rgb = (0..width * height).map(|index| color(index % width, index / width)).collect();
        ColorPicture { width, height, rgb }
    }

    /// Calculated by hand, for red = 160 at the one red pixel of a dark 5×5 picture: green there is ½·160 = 80,
    /// blue ¾·160 = 120.
    #[test]
    fn a_single_pixel_shows_the_kernels() {
        let mut raw = vec![0; 25];
        raw[12] = 160;
        let seen = demosaic(&raw, [5, 5], PixelFormat::BayerRG8).expect("fits");
        assert_eq!(seen.rgb[12], [160, 80, 120]);
        // In the pixel beside the red one, green is half of the mean of two reds, 80; blue is clipped at zero.
        assert_eq!(seen.rgb[11], [80, 0, 0]);
        assert_eq!(PixelFormat::BayerRG8.filter(2, 2), Some(0));
        assert_eq!(PixelFormat::BayerGB8.filter(0, 0), Some(1));
        assert_eq!(PixelFormat::BayerGB8.filter(1, 0), Some(2));
    }

    #[test]
    fn pixels_of_a_wrong_number_give_no_picture() {
        assert_eq!(demosaic(&[0; 24], [5, 5], PixelFormat::BayerRG8), None);
        assert_eq!(demosaic(&[0; 8], [4, 2], PixelFormat::BayerRG8), None);
        assert_eq!(demosaic(&[7; 8], [4, 2], PixelFormat::Mono8).map(|seen| seen.rgb[0]), Some([7; 3]));
    }

    proptest! {
        /// A uniform colour stays the same; a grey ramp stays the same away from the border; the values that a filter
        /// passed stay exact.
        #[test]
        fn uniform_colour_and_grey_ramp_stay_unchanged(format in prop::sample::select(FORMATS.to_vec()), rgb in any::<[u8; 3]>(),
            size in (6usize..20, 6usize..20), slope in (0usize..4, 0usize..4)) {
            let (width, height) = size;
            let flat = picture(width, height, |_, _| rgb);
            let seen = demosaic(&mosaic(&flat, format), [width, height], format).expect("fits");
            if format != PixelFormat::Mono8 {
                prop_assert_eq!(&seen, &flat);
            }
            let ramp = picture(width, height, |column, row| [(40 + slope.0 * column + slope.1 * row) as u8; 3]);
            let raw = mosaic(&ramp, format);
            let seen = demosaic(&raw, [width, height], format).expect("fits");
            for row in 2..height - 2 {
                for column in 2..width - 2 {
                    prop_assert_eq!(seen.rgb[row * width + column], ramp.rgb[row * width + column]);
                }
            }
            prop_assert_eq!(mosaic(&seen, format), raw);
        }
    }
}
