//! Detects a chessboard in a picture to about a pixel, with a computing time that does not depend on the content of the
//! picture.
//!
//! The picture is examined several times, at a small size first: a large board is found there, and the last pass
//! examines at most [`MAX_SEARCHED_PX`] pixels. Each pass joins crossings of edges to lattices (`crossings`). A lattice
//! with the columns and rows of the board is the board, even if a glare hides some of its corners. No further line of
//! corners may follow an outer line, since a part of a larger board is not the board. Neither a white rim nor light
//! around the board is needed. (`findChessboardCorners` combines contours: fine texture, or a glare, can occupy it for
//! minutes. `findChessboardCornersSB` misses boards in the dark, and with a glare; it is used for the last pass, at a
//! small size.)

use super::board::Board;
use super::crossings::{Crossing, Lattice, SmoothedPicture, crossings, extent, lattices, noise, trim_sparse_lines};
use super::{foreign, saddle};
use nalgebra::{Matrix3, Vector2, Vector3};
use panelprep_base::geometry::{GrayPicture, Pixel};
use panelprep_cell::imaging::ImagingError;

/// Maximum number of pixels of a picture that is searched. A larger picture is reduced by a power of two.
const MAX_SEARCHED_PX: usize = 3_400_000;
/// Minimum length of the longer side of a reduced picture, px.
const MIN_SIDE_PX: usize = 480;
/// Maximum number of pixels that the last pass, `findChessboardCornersSB`, examines.
const MAX_SECTOR_BASED_PX: usize = 850_000;
/// Minimum fraction of the corners of an outer line that must be detected; otherwise the line is removed. The three
/// values apply to a board with a glare near its rim, a board with a glare elsewhere, and a board with an object beside
/// it that looks like corners.
const MIN_OUTER_LINE_FRACTIONS: [f64; 3] = [0.2, 0.45, 0.65];
/// Minimum number of inner corners along a side of a chessboard.
const MIN_BOARD_CORNERS: usize = 3;
/// Minimum fraction of the corners of the board that must be detected.
const MIN_SEEN_FRACTION: f64 = 0.5;
/// Minimum fraction of the corners of another board that must be detected before that board is reported.
const MIN_OTHER_BOARD_FRACTION: f64 = 0.8;
/// Minimum fraction of a line beyond the board that consists of corners, for the line to belong to a larger board.
const MIN_NEXT_LINE_FRACTION: f64 = 0.4;
/// Minimum ratio of the contrast of a corner beyond an outer line to the contrast of the corner on this line.
const MIN_NEXT_CONTRAST_RATIO: f64 = 0.7;
/// Maximum distance of a corner from its predicted position, as a fraction of the distance to its neighbour.
const RELATIVE_WINDOW_SIZE: f64 = 0.3;

/// A corner of the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Node {
    /// Position of the corner in the picture.
    pub pixel: Pixel,
    /// Whether the corner was detected; otherwise it is predicted from its neighbours.
    pub is_seen: bool,
}

/// The result of the search in a picture.
#[derive(Debug, PartialEq)]
pub(super) enum Search {
    /// The board, with its corners row by row.
    Board(Vec<Node>),
    /// Another board, given by its numbers of inner corners, the longer side first.
    Other([usize; 2]),
    /// The picture shows no corners of a board.
    Nothing,
}

/// Searches a picture for a board.
pub(super) fn find(picture: &GrayPicture, board: &Board) -> Result<Search, ImagingError> {
    let (mut best, mut other): (Option<Grid>, Option<([usize; 2], usize)>) = (None, None);
    for times in reduction_factors(picture) {
        for found in detect_lattices(picture, times)? {
            let seen = found.seen_count();
            let own = found.rotated_to_size(board.columns(), board.rows());
            if let Some(grid) = own.filter(|grid| grid.share() >= MIN_SEEN_FRACTION) {
                if best.as_ref().is_none_or(|best| best.seen_count() < seen) && !extends_beyond(picture, &grid) {
                    best = Some(grid);
                }
            } else if found.columns.min(found.rows) >= MIN_BOARD_CORNERS
                && found.share() >= MIN_OTHER_BOARD_FRACTION
                && found.has_complete_sides()
                && other.is_none_or(|(_, most)| most < seen)
            {
                other = Some((found.sides(), seen));
            }
        }
        if best.as_ref().is_some_and(|best| best.seen_count() == board.count()) {
            break;
        }
    }
    Ok(match (best, other) {
        (Some(grid), _) => Search::Board(orient_corners(grid, picture, board)),
        (None, Some((sides, _))) => Search::Other(sides),
        (None, None) => sector_based(picture, board)?.map_or(Search::Nothing, Search::Board),
    })
}

/// Searches a last time, with `findChessboardCornersSB`, which joins corners that are distorted or dirty. The picture
/// is reduced to a size at which this search takes a short time.
fn sector_based(picture: &GrayPicture, board: &Board) -> Result<Option<Vec<Node>>, ImagingError> {
    let small_enough = |times: &usize| picture.gray.len() / (times * times) <= MAX_SECTOR_BASED_PX;
    let Some(times) = reduction_factors(picture).into_iter().rfind(small_enough) else { return Ok(None) };
    let small = if times == 1 { None } else { Some(foreign::reduce_picture(picture, times)?) };
    let small = small.as_ref().unwrap_or(picture);
    let (across, down) = (picture.width as f64 / small.width as f64, picture.height as f64 / small.height as f64);
    let whole = |pixel: Pixel| Pixel::at((pixel.u + 0.5) * across - 0.5, (pixel.v + 0.5) * down - 0.5);
    let (columns, rows) = (board.columns(), board.rows());
    let Some(pixels) = foreign::chessboard(small, (columns, rows))? else { return Ok(None) };
    let nodes = pixels.into_iter().map(|pixel| Node { pixel: whole(pixel), is_seen: true });
    let grid = Grid { columns, rows, nodes: nodes.collect() };
    Ok((!extends_beyond(picture, &grid)).then(|| orient_corners(grid, picture, board)))
}

/// Returns the factors by which the picture is reduced for each pass; the first factor gives the smallest picture.
pub(super) fn reduction_factors(picture: &GrayPicture) -> Vec<usize> {
    let long = picture.width.max(picture.height);
    let times = (0..16).map(|power| 1usize << power);
    let mut all: Vec<usize> = times
        .take_while(|times| *times == 1 || long / times >= MIN_SIDE_PX)
        .filter(|times| picture.gray.len() / (times * times) <= MAX_SEARCHED_PX)
        .collect();
    all.reverse();
    all
}

/// Returns the lattices of a reduced picture, in pixels of the full-size picture.
pub(super) fn detect_lattices(picture: &GrayPicture, times: usize) -> Result<Vec<Grid>, ImagingError> {
    let small = if times == 1 { None } else { Some(foreign::reduce_picture(picture, times)?) };
    let small = small.as_ref().unwrap_or(picture);
    let (across, down) = (picture.width as f64 / small.width as f64, picture.height as f64 / small.height as f64);
    let whole = |pixel: Pixel| Pixel::at((pixel.u + 0.5) * across - 0.5, (pixel.v + 0.5) * down - 0.5);
    let smooth = SmoothedPicture::from_picture(small);
    let all = crossings(&smooth);
    let found = lattices(&smooth, &all);
    // An outer line with half of its corners missing may be partly hidden, or may be an object beside the board.
    let grids = found.into_iter().flat_map(|lattice| {
        let mut all = MIN_OUTER_LINE_FRACTIONS.map(|share| trim_sparse_lines(lattice.clone(), share)).to_vec();
        all.dedup_by_key(|lattice| lattice.len());
        all
    });
    let scaled = grids.filter_map(|lattice| Grid::from_lattice(&lattice, &all)).map(|mut grid| {
        grid.nodes.iter_mut().for_each(|node| node.pixel = whole(node.pixel));
        grid
    });
    Ok(scaled.collect())
}

/// A lattice of corners in rows and columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Grid {
    pub columns: usize,
    pub rows: usize,
    /// The corners, row by row.
    pub nodes: Vec<Node>,
}

impl Grid {
    /// Completes a lattice with its missing corners; `None` if the lattice determines no plane.
    fn from_lattice(lattice: &Lattice, crossings: &[Crossing]) -> Option<Self> {
        let [(left, right), (low, high)] = extent(lattice);
        let (columns, rows) = ((right - left + 1) as usize, (high - low + 1) as usize);
        if columns < 2 || rows < 2 || columns * rows > 2 * lattice.len() {
            return None;
        }
        let (places, pixels): (Vec<[f64; 2]>, Vec<Pixel>) = lattice
            .iter()
            .map(|((column, row), index)| {
                ([f64::from(column - left), f64::from(row - low)], crossings[*index].pixel())
            })
            .unzip();
        let plane = if pixels.len() < columns * rows { Some(foreign::homography(&places, &pixels)?) } else { None };
        let node = |index: usize| {
            let (column, row) = (index % columns, index / columns);
            match (lattice.get(&(column as i32 + left, row as i32 + low)), &plane) {
                (Some(found), _) => Some(Node { pixel: crossings[*found].pixel(), is_seen: true }),
                (None, Some(plane)) => {
                    let pixel = predict_pixel(plane, [column as f64, row as f64], (&places, &pixels))?;
                    Some(Node { pixel, is_seen: false })
                }
                (None, None) => None,
            }
        };
        Some(Grid { columns, rows, nodes: (0..columns * rows).map(node).collect::<Option<_>>()? })
    }

    pub fn seen_count(&self) -> usize {
        self.nodes.iter().filter(|node| node.is_seen).count()
    }

    fn share(&self) -> f64 {
        self.seen_count() as f64 / self.nodes.len() as f64
    }

    /// Returns whether enough corners of each outer line were detected.
    fn has_complete_sides(&self) -> bool {
        let line = |first: usize, step: usize, count: usize| {
            let seen = (0..count).filter(|index| self.nodes[first + index * step].is_seen).count();
            seen as f64 >= MIN_SEEN_FRACTION * count as f64
        };
        let (columns, rows) = (self.columns, self.rows);
        line(0, 1, columns)
            && line((rows - 1) * columns, 1, columns)
            && line(0, columns, rows)
            && line(columns - 1, columns, rows)
    }

    /// Returns the numbers of inner corners along both sides, the longer side first.
    fn sides(&self) -> [usize; 2] {
        [self.columns.max(self.rows), self.columns.min(self.rows)]
    }

    /// Returns the grid with this number of columns and rows, rotated if needed; `None` if its numbers are different.
    fn rotated_to_size(&self, columns: usize, rows: usize) -> Option<Grid> {
        if (self.columns, self.rows) == (columns, rows) {
            return Some(self.clone());
        }
        let at = |row: usize, column: usize| self.nodes[column * self.columns + row];
        let across = || (0..rows).flat_map(|row| (0..columns).map(move |column| at(row, column))).collect();
        ((self.rows, self.columns) == (columns, rows)).then(|| Grid { columns, rows, nodes: across() })
    }
}

/// Predicts the pixel of a position by a homography, and corrects it by the deviations of the nearest corners, which
/// contain the distortion of the lens.
fn predict_pixel(
    plane: &Matrix3<f64>,
    place: [f64; 2],
    (places, pixels): (&[[f64; 2]], &[Pixel]),
) -> Option<Pixel> {
    let at = |[x, y]: [f64; 2]| {
        let p = plane * Vector3::new(x, y, 1.0);
        (p.z.abs() > 1e-12).then(|| Vector2::new(p.x / p.z, p.y / p.z))
    };
    let mut near: Vec<(f64, usize)> =
        places.iter().enumerate().map(|(i, p)| ((p[0] - place[0]).hypot(p[1] - place[1]), i)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (mut sum, mut weights) = (Vector2::zeros(), 0.0);
    for (away, index) in near.into_iter().take(6) {
        let weight = away.max(0.5).powi(-2);
        sum += (Vector2::new(pixels[index].u, pixels[index].v) - at(places[index])?) * weight;
        weights += weight;
    }
    let there = at(place)? + sum / weights;
    Some(Pixel::at(there.x, there.y))
}

/// Returns whether more corners of squares follow beyond one of the outer lines.
fn extends_beyond(picture: &GrayPicture, grid: &Grid) -> bool {
    let at = |column: usize, row: usize| {
        let pixel = grid.nodes[row * grid.columns + column].pixel;
        Vector2::new(pixel.u, pixel.v)
    };
    let (columns, rows) = (grid.columns, grid.rows);
    let noise = noise(picture);
    // Three corners of each line across, from the outer one inwards, and the neighbour along the outer line.
    let inwards = |column: usize, row: usize, side: usize| match side {
        0 => [at(0, row), at(1, row), at(2, row)],
        1 => [at(columns - 1, row), at(columns - 2, row), at(columns - 3, row)],
        2 => [at(column, 0), at(column, 1), at(column, 2)],
        _ => [at(column, rows - 1), at(column, rows - 2), at(column, rows - 3)],
    };
    let is_corner = |side: usize, index: usize| {
        let [outer, second, third] = inwards(index, index, side);
        let next = match side {
            0 | 1 => {
                at(if side == 0 { 0 } else { columns - 1 }, if index + 1 < rows { index + 1 } else { index - 1 })
            }
            _ => at(if index + 1 < columns { index + 1 } else { index - 1 }, if side == 2 { 0 } else { rows - 1 }),
        };
        let beyond = outer * 3.0 - second * 3.0 + third;
        let edges = [outer - second, next - outer];
        let window = RELATIVE_WINDOW_SIZE * edges[0].norm().min(edges[1].norm());
        let fit = |at: Vector2<f64>| {
            saddle::refine(picture, Pixel::at(at.x, at.y), edges, window.clamp(3.0, 11.0) as usize, noise)
        };
        // If only one black square ends at this position, the contrast is half that of a corner.
        match (fit(outer), fit(beyond)) {
            (Some(own), Some(next)) => {
                next.contrast * own.contrast < -MIN_NEXT_CONTRAST_RATIO * own.contrast.powi(2)
            }
            _ => false,
        }
    };
    (0..4).any(|side| {
        let count = if side < 2 { rows } else { columns };
        let corners = (0..count).filter(|index| is_corner(side, *index)).count();
        corners as f64 >= MIN_NEXT_LINE_FRACTION * count as f64
    })
}

/// Returns the corners in the order of the board, never mirrored. A board with a unique first corner begins with the
/// black outer square. A square board begins in the upper left, any other board with its upper end.
fn orient_corners(grid: Grid, picture: &GrayPicture, board: &Board) -> Vec<Node> {
    let (columns, rows, mut corners) = (grid.columns, grid.rows, grid.nodes);
    let [first, right, below] = [0, columns - 1, (rows - 1) * columns].map(|index| corners[index].pixel);
    let turn = (right.u - first.u) * (below.v - first.v) - (right.v - first.v) * (below.u - first.u);
    if turn < 0.0 {
        corners.chunks_mut(columns).for_each(<[Node]>::reverse);
    }
    if columns == rows {
        return upper_left_first(corners, columns);
    }
    let is_upside_down = match board.is_unique() {
        true => is_first_square_white(&corners, columns, picture),
        false => corners[corners.len() - 1].pixel.v < corners[0].pixel.v,
    };
    if is_upside_down {
        corners.reverse();
    }
    corners
}

/// Returns the corners of a square grid in that one of four rotations in which the first corner is nearest to the upper
/// left of the picture.
fn upper_left_first(corners: Vec<Node>, side: usize) -> Vec<Node> {
    let turned = |corners: &Vec<Node>| -> Vec<Node> {
        let at = |index: usize| corners[(side - 1 - index % side) * side + index / side];
        (0..side * side).map(at).collect()
    };
    let mut all = vec![corners];
    (0..3).for_each(|turn| all.push(turned(&all[turn])));
    let away = |corners: &Vec<Node>| corners[0].pixel.u + corners[0].pixel.v;
    all.into_iter().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or_default()
}

/// Returns whether the outer square at the first corner is white, determined from all squares between detected corners.
fn is_first_square_white(corners: &[Node], columns: usize, picture: &GrayPicture) -> bool {
    // Sum and count of the squares with the colour of the outer square, and of the other squares.
    let mut sums = [(0.0, 0.0); 2];
    for index in (0..corners.len() - columns).filter(|index| index % columns + 1 < columns) {
        let around = [index, index + 1, index + columns, index + columns + 1].map(|index| corners[index]);
        let middle = |of: fn(&Node) -> f64| around.iter().map(of).sum::<f64>() / 4.0;
        let gray = gray_at(picture, Pixel::at(middle(|n| n.pixel.u), middle(|n| n.pixel.v)));
        let (Some(gray), true) = (gray, around.iter().all(|node| node.is_seen)) else { continue };
        let sum = &mut sums[(index % columns + index / columns) % 2];
        *sum = (sum.0 + gray, sum.1 + 1.0);
    }
    let [same, others] = sums.map(|(sum, count)| sum / f64::max(count, 1.0));
    same > others
}

/// Returns the mean grey level of the nine pixels around a pixel.
fn gray_at(picture: &GrayPicture, at: Pixel) -> Option<f64> {
    let (column, row) = at.nearest_whole(picture.width, picture.height)?;
    let columns = column.saturating_sub(1)..(column + 2).min(picture.width);
    let rows = row.saturating_sub(1)..(row + 2).min(picture.height);
    let pixels = rows.flat_map(|row| columns.clone().map(move |column| row * picture.width + column));
    let (sum, count) = pixels.fold((0.0, 0.0), |(sum, n), i| (sum + f64::from(picture.gray[i]), n + 1.0));
    Some(sum / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: 2592 px are halved to 1296 px and 648 px; 5.0 megapixels are more than the
    /// maximum of one pass. A small picture is examined at its full size.
    #[test]
    fn the_last_search_pass_is_limited_and_the_first_one_is_small() {
        let all = |width: usize, height: usize| reduction_factors(&GrayPicture::uniform(width, height, 0));
        assert_eq!(all(1944, 1200), [4, 2, 1]);
        assert_eq!(all(2592, 1944), [4, 2]);
        assert_eq!(all(640, 480), [1]);
        assert_eq!(all(300, 200), [1]);
    }

    /// Expected result for a grid of 2 columns and 3 rows, seen mirrored, transposed and upside down: the corner in
    /// column c and row r has the pixel (u, v) = (c, r).
    #[test]
    fn corners_in_any_order_are_put_into_the_board_s_order() {
        let node = |(u, v): (usize, usize)| Node { pixel: Pixel::at(u as f64, v as f64), is_seen: true };
        let grid = |columns: usize, rows: usize, corners: &[(usize, usize)]| Grid {
            columns,
            rows,
            nodes: corners.iter().copied().map(node).collect(),
        };
        let right: Vec<Node> = (0..12).map(|i| node((i % 4, i / 4))).collect();
        let turned = grid(3, 4, &[0, 1, 2, 3].map(|u| [0, 1, 2].map(|v| (u, v))).concat());
        assert_eq!(turned.rotated_to_size(4, 3).map(|grid| grid.nodes), Some(right.clone()));
        assert_eq!(turned.rotated_to_size(5, 3), None);
        let picture = GrayPicture::uniform(8, 8, 0);
        // Both sides are even: the upper end comes first, independent of the order in which the corners were found.
        let board = Board::parse("6x4", 1.0).expect("a board");
        let upright: Vec<(usize, usize)> = (0..24).map(|i| (i % 6, i / 6)).collect();
        let expected: Vec<Node> = upright.iter().copied().map(node).collect();
        let mirrored: Vec<_> = upright.iter().map(|&(u, v)| (5 - u, v)).collect();
        let upside: Vec<_> = upright.iter().rev().copied().collect();
        for found in [upright.clone(), mirrored, upside] {
            assert_eq!(orient_corners(grid(6, 4, &found), &picture, &board), expected, "{found:?}");
        }
        let square: Vec<(usize, usize)> = (0..9).map(|i| (2 - i / 3, i % 3)).collect();
        let expected: Vec<Node> = (0..9).map(|i| node((i % 3, i / 3))).collect();
        let board = Board::parse("3x3", 1.0).expect("a board");
        assert_eq!(orient_corners(grid(3, 3, &square), &picture, &board), expected);
    }
}
