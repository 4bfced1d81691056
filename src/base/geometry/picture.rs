//! Pictures as plain bytes: colour, grey and masks, row by row from the top left.

use super::raster::{ALL_NEIGHBOURS, RasterSize};

/// A colour picture, 8 bits a channel, sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColorPicture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue of each pixel.
    pub rgb: Vec<[u8; 3]>,
}

impl ColorPicture {
    /// Creates a picture of one colour.
    pub fn uniform(width: usize, height: usize, rgb: [u8; 3]) -> Self {
        ColorPicture { width, height, rgb: vec![rgb; width * height] }
    }

    /// Calculates the brightness with the weights of ITU-R BT.601, as `cv::cvtColor` does.
    pub fn to_gray(&self) -> GrayPicture {
        let gray = |&[r, g, b]: &[u8; 3]| {
            ((4_899 * u32::from(r) + 9_617 * u32::from(g) + 1_868 * u32::from(b) + 8_192) >> 14) as u8
        };
        GrayPicture { width: self.width, height: self.height, gray: self.rgb.iter().map(gray).collect() }
    }
}

/// A grey picture, 8 bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GrayPicture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Brightness of each pixel.
    pub gray: Vec<u8>,
}

impl GrayPicture {
    /// Returns the grey picture as a colour picture.
    pub fn to_color(&self) -> ColorPicture {
        ColorPicture {
            width: self.width,
            height: self.height,
            rgb: self.gray.iter().map(|&gray| [gray; 3]).collect(),
        }
    }

    /// Creates a picture of one brightness.
    pub fn uniform(width: usize, height: usize, gray: u8) -> Self {
        GrayPicture { width, height, gray: vec![gray; width * height] }
    }
}

/// The pixels that belong to a region.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// One flag a pixel.
    pub inside: Vec<bool>,
}

impl Mask {
    /// Returns the mask's connected pieces, as indices of pixels; pixels that touch at a corner belong to the same
    /// piece.
    pub fn connected_pieces(&self) -> Vec<Vec<usize>> {
        RasterSize { width: self.width, height: self.height }
            .connected_pieces(&ALL_NEIGHBOURS, |index| self.inside[index])
    }

    /// Creates a mask without any pixel inside.
    pub fn all_outside(width: usize, height: usize) -> Self {
        Mask { width, height, inside: vec![false; width * height] }
    }

    /// Number of pixels inside.
    pub fn count(&self) -> usize {
        self.inside.iter().filter(|&&inside| inside).count()
    }

    /// Returns whether this pixel is inside.
    pub fn contains(&self, column: usize, row: usize) -> bool {
        self.inside[row * self.width + column]
    }

    /// Returns a picture that is white inside, black outside.
    pub fn to_gray(&self) -> GrayPicture {
        let gray = self.inside.iter().map(|&inside| if inside { 255 } else { 0 }).collect();
        GrayPicture { width: self.width, height: self.height, gray }
    }

    /// Creates a mask of the pixels whose brightness is at least half of the maximum.
    pub fn from_gray(picture: &GrayPicture) -> Self {
        let inside = picture.gray.iter().map(|&gray| gray >= 128).collect();
        Mask { width: picture.width, height: picture.height, inside }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 0.299·255 = 76.2, 0.587·255 = 149.7, 0.114·255 = 29.1.
    #[test]
    fn gray_weighs_green_most() {
        let picture = ColorPicture { width: 3, height: 1, rgb: vec![[255, 0, 0], [0, 255, 0], [0, 0, 255]] };
        assert_eq!(picture.to_gray().gray, [76, 150, 29]);
    }
}
