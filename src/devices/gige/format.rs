//! The supported pixel formats, by their names in GenICam's Pixel Format Naming Convention, and the conversion from a
//! Bayer pattern to RGB and back.
//!
//! A colour filter on each pixel passes one of three colours. The other two are interpolated by linear filters
//! (demosaicing), which add to the bilinear mean a fraction of the Laplacian of the measured colour at this pixel:
//!     G at R = mean of 4 G + ½ ΔR,   R at B = mean of 4 R + ¾ ΔB,   R at G = mean of 2 R + ⅝ ΔG,             (1)
//! as 5×5 kernels in sixteenths. A grey ramp is reproduced exactly. An edge keeps its position and its sharpness, while
//! the bilinear mean alone would blur it. Beyond the border, rows and columns are mirrored, so that the Bayer pattern
//! continues. Values outside 0…255 are clipped. Source: Malvar, He, Cutler, High-quality linear interpolation for
//! demosaicing, ICASSP 2004.

use panelprep_base::geometry::ColorPicture;
use rayon::prelude::*;
use strum::{IntoStaticStr, VariantArray};

/// A pixel format with one byte per pixel: the brightness, or the colour that the pixel's filter passes.
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

    /// Returns the code of the format in a frame's header (GVSP leader).
    pub fn code(self) -> u32 {
        match self {
            PixelFormat::Mono8 => 0x0108_0001,
            PixelFormat::BayerGR8 => 0x0108_0008,
            PixelFormat::BayerRG8 => 0x0108_0009,
            PixelFormat::BayerGB8 => 0x0108_000a,
            PixelFormat::BayerBG8 => 0x0108_000b,
        }
    }

    /// Returns the supported format with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|format| format.name() == name)
    }

    /// Returns the name of a pixel format from its code, according to GenICam's naming convention; also for formats
    /// that this program does not support.
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

    /// Returns the colour that the filter of a pixel passes: 0 is red, 1 is green, 2 is blue. `None` for a monochrome
    /// sensor.
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

/// Returns the raw pixels that a sensor with these filters would measure for a picture. It is the inverse of
/// [`demosaic`], except for details that equation (1) cannot restore.
pub fn mosaic(picture: &ColorPicture, format: PixelFormat) -> Vec<u8> {
    let gray = || picture.to_gray().gray;
    let pick = |(index, rgb): (usize, &[u8; 3])| {
        format.filter(index % picture.width, index / picture.width).map(|channel| rgb[channel])
    };
    let picked: Option<Vec<u8>> = picture.rgb.iter().enumerate().map(pick).collect();
    picked.unwrap_or_else(gray)
}

/// Converts the raw bytes of a sensor, row by row, to a colour picture. `None` if the number of bytes is not `width` ×
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

/// Returns the index of the pixel at the offset `by` from `at`; beyond the border it is mirrored without repeating the
/// border pixel.
fn mirrored_index(at: usize, by: isize, count: usize) -> usize {
    let to = at.saturating_add_signed(by);
    match to {
        _ if by < 0 && at < by.unsigned_abs() => by.unsigned_abs() - at,
        _ if to >= count => 2 * (count - 1) - to,
        _ => to,
    }
}

/// Evaluates equation (1) at one pixel; `around(2, 2)` is the value of the pixel itself.
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
            // At a green pixel, the other colour in its row is red or blue.
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

    /// Expected values, calculated by hand: a dark 5×5 picture has red = 160 at its only red pixel. There green is
    /// ½·160 = 80, and blue is ¾·160 = 120.
    #[test]
    fn a_single_pixel_shows_the_kernels() {
        let mut raw = vec![0; 25];
        raw[12] = 160;
        let seen = demosaic(&raw, [5, 5], PixelFormat::BayerRG8).expect("fits");
        assert_eq!(seen.rgb[12], [160, 80, 120]);
        // In the pixel beside the red one, red is the mean of 160 and 0, 80; green and blue are 0 or clipped to 0.
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
        /// A uniform colour is unchanged, a grey ramp is unchanged away from the border, and the measured values stay
        /// exact.
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
