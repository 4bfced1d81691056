//! Neighbouring cells of a raster, and connected components of its cells.

/// The steps, column and row, to the four direct neighbours of a cell.
pub const DIRECT_NEIGHBOURS: [(isize, isize); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];
/// The steps, column and row, to the eight cells around a cell.
pub const ALL_NEIGHBOURS: [(isize, isize); 8] =
    [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// The size of a raster whose cells are counted row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RasterSize {
    /// Number of cells in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl RasterSize {
    /// Returns a cell's neighbours by these steps, in the order of the steps.
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

    /// Returns for each cell the side of the largest square that has this cell as its lower right corner and in which
    /// `holds` is true everywhere; 0 if it is false for the cell itself.
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

    /// Returns the connected pieces of the cells for which `holds` is true, ordered by their first cells. Each
    /// piece is in the order of a breadth-first search from its first cell.
    pub fn connected_pieces(self, steps: &[(isize, isize)], holds: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        self.joined_pieces(steps, holds, |_, _| true)
    }

    /// Returns the connected pieces as [`RasterSize::connected_pieces`] does, but two neighbours for which `holds` is true are
    /// connected only if `joined` is also true for the pair.
    pub fn joined_pieces(
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

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: RasterSize = RasterSize { width: 4, height: 3 };

    /// By hand, `#` holds:
    /// ```text
    /// # . # #
    /// . # . .
    /// . . . #
    /// ```
    #[test]
    fn pieces_touch_beside_or_at_a_corner() {
        let holds = |index: usize| [0, 2, 3, 5, 11].contains(&index);
        assert_eq!(SMALL.connected_pieces(&DIRECT_NEIGHBOURS, holds), [vec![0], vec![2, 3], vec![5], vec![11]]);
        assert_eq!(SMALL.connected_pieces(&ALL_NEIGHBOURS, holds), [vec![0, 5, 2, 3], vec![11]]);
        assert_eq!(
            SMALL.joined_pieces(&ALL_NEIGHBOURS, holds, |from, to| from + to != 7),
            [vec![0, 5], vec![2, 3], vec![11]]
        );
    }
}
