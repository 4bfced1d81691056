//! Pictures as plain bytes: colour, grey and masks, row by row from the top left. Also the neighbours of a cell of such
//! a raster, and the connected components of its cells.

/// The offsets (column, row) of the four direct neighbours of a cell.
pub const DIRECT_NEIGHBOURS: [(isize, isize); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];
/// The offsets (column, row) of the eight neighbours of a cell.
pub const ALL_NEIGHBOURS: [(isize, isize); 8] =
    [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// The size of a raster. Its cells are numbered row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RasterSize {
    /// Number of cells in a row.
    pub width: usize,
    /// Number of rows of cells.
    pub height: usize,
}

impl RasterSize {
    /// Returns a cell's neighbours at these offsets, in the order of the offsets, without those outside of the raster.
    pub fn neighbours<'a>(
        self,
        index: usize,
        steps: &'a [(isize, isize)],
    ) -> impl Iterator<Item = usize> + use<'a> {
        let (column, row) = (index % self.width, index / self.width);
        steps.iter().filter_map(move |&(right, down)| {
            let (column, row) = (column.checked_add_signed(right)?, row.checked_add_signed(down)?);
            (column < self.width && row < self.height).then_some(row * self.width + column)
        })
    }

    /// Returns for each cell the side, in cells, of the largest square with this cell as its lower right corner in
    /// which `holds` is true everywhere; 0 if `holds` is false for the cell.
    pub fn largest_squares(self, holds: impl Fn(usize) -> bool) -> Vec<u32> {
        let width = self.width;
        let mut squares = vec![0_u32; width * self.height];
        for index in (0..squares.len()).filter(|&index| holds(index)) {
            let beside = if index % width > 0 && index >= width {
                squares[index - 1].min(squares[index - width]).min(squares[index - width - 1])
            } else {
                0
            };
            squares[index] = 1 + beside;
        }
        squares
    }

    /// Returns the connected components of the cells for which `holds` is true, ordered by their first cells. The cells
    /// of a component are in the order of a breadth-first search from its first cell.
    pub fn connected_components(self, steps: &[(isize, isize)], holds: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        self.joined_components(steps, holds, |_, _| true)
    }

    /// Returns the connected components as [`RasterSize::connected_components`] does, but two neighbours are connected
    /// only if `joined` is also true for the pair.
    pub fn joined_components(
        self,
        steps: &[(isize, isize)],
        holds: impl Fn(usize) -> bool,
        joined: impl Fn(usize, usize) -> bool,
    ) -> Vec<Vec<usize>> {
        let mut seen = vec![false; self.width * self.height];
        let mut found = Vec::new();
        for first in 0..seen.len() {
            if seen[first] || !holds(first) {
                continue;
            }
            seen[first] = true;
            let mut piece = vec![first];
            let mut at = 0;
            while let Some(&index) = piece.get(at) {
                at += 1;
                for next in self.neighbours(index, steps) {
                    if !seen[next] && holds(next) && joined(index, next) {
                        seen[next] = true;
                        piece.push(next);
                    }
                }
            }
            found.push(piece);
        }
        found
    }
}

/// A colour picture, 8 bits per channel, sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColorPicture {
    /// Width of the picture, px.
    pub width: usize,
    /// Height of the picture, px.
    pub height: usize,
    /// Red, green, blue of each pixel.
    pub rgb: Vec<[u8; 3]>,
}

impl ColorPicture {
    /// Creates a picture of one colour.
    pub fn uniform(width: usize, height: usize, rgb: [u8; 3]) -> Self {
        ColorPicture { width, height, rgb: vec![rgb; width * height] }
    }

    /// Converts the picture to grey with the weights of ITU-R BT.601, as `cv::cvtColor` does.
    pub fn to_gray(&self) -> GrayPicture {
        let gray = |&[r, g, b]: &[u8; 3]| {
            ((4_899 * u32::from(r) + 9_617 * u32::from(g) + 1_868 * u32::from(b) + 8_192) >> 14) as u8
        };
        GrayPicture { width: self.width, height: self.height, gray: self.rgb.iter().map(gray).collect() }
    }
}

/// A grey picture, 8 bits per pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GrayPicture {
    /// Width of the picture, px.
    pub width: usize,
    /// Height of the picture, px.
    pub height: usize,
    /// Grey level of each pixel.
    pub gray: Vec<u8>,
}

impl GrayPicture {
    /// Returns the grey picture as a colour picture with three equal channels.
    pub fn to_color(&self) -> ColorPicture {
        ColorPicture {
            width: self.width,
            height: self.height,
            rgb: self.gray.iter().map(|&gray| [gray; 3]).collect(),
        }
    }

    /// Creates a picture of one grey level.
    pub fn uniform(width: usize, height: usize, gray: u8) -> Self {
        GrayPicture { width, height, gray: vec![gray; width * height] }
    }
}

/// A mask: the pixels of a picture that belong to a region.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Width of the mask, px.
    pub width: usize,
    /// Height of the mask, px.
    pub height: usize,
    /// One flag per pixel: true inside of the region.
    pub inside: Vec<bool>,
}

impl Mask {
    /// Returns the mask's connected components, as indices of pixels; pixels that touch only at a corner are connected.
    pub fn connected_components(&self) -> Vec<Vec<usize>> {
        RasterSize { width: self.width, height: self.height }
            .connected_components(&ALL_NEIGHBOURS, |index| self.inside[index])
    }

    /// Creates a mask without any pixel inside.
    pub fn all_outside(width: usize, height: usize) -> Self {
        Mask { width, height, inside: vec![false; width * height] }
    }

    /// Returns the number of pixels inside.
    pub fn count(&self) -> usize {
        self.inside.iter().filter(|&&inside| inside).count()
    }

    /// Returns whether this pixel is inside.
    pub fn contains(&self, column: usize, row: usize) -> bool {
        self.inside[row * self.width + column]
    }

    /// Returns the mask as a picture that is white inside and black outside.
    pub fn to_gray(&self) -> GrayPicture {
        let gray = self.inside.iter().map(|&inside| if inside { 255 } else { 0 }).collect();
        GrayPicture { width: self.width, height: self.height, gray }
    }

    /// Creates a mask of the pixels whose grey level is at least half of the maximum.
    pub fn from_gray(picture: &GrayPicture) -> Self {
        let inside = picture.gray.iter().map(|&gray| gray >= 128).collect();
        Mask { width: picture.width, height: picture.height, inside }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: 0.299·255 = 76.2, 0.587·255 = 149.7, 0.114·255 = 29.1.
    #[test]
    fn the_gray_value_has_the_weights_of_bt_601() {
        let picture = ColorPicture { width: 3, height: 1, rgb: vec![[255, 0, 0], [0, 255, 0], [0, 0, 255]] };
        assert_eq!(picture.to_gray().gray, [76, 150, 29]);
    }

    const SMALL: RasterSize = RasterSize { width: 4, height: 3 };

    /// Expected components, determined by hand; `holds` is true for the cells with `#`:
    /// ```text
    /// # . # #
    /// # . # .
    /// . . . #
    /// ```
    #[test]
    fn components_connect_at_sides_or_also_at_corners() {
        let holds = |index: usize| [0, 2, 3, 5, 11].contains(&index);
        assert_eq!(SMALL.connected_components(&DIRECT_NEIGHBOURS, holds), [vec![0], vec![2, 3], vec![5], vec![11]]);
        assert_eq!(SMALL.connected_components(&ALL_NEIGHBOURS, holds), [vec![0, 5, 2, 3], vec![11]]);
        assert_eq!(
            SMALL.joined_components(&ALL_NEIGHBOURS, holds, |from, to| from + to != 7),
            [vec![0, 5], vec![2, 3], vec![11]]
        );
    }
}
