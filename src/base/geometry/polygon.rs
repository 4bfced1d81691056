//! Plane polygons of pixels: whether a point is inside, signed area, crossing sides, distance to a side.

use super::picture::Mask;
use super::rigid::Pixel;

/// Returns whether a point is inside of the polygon by the even–odd rule.
///
/// Repeated corners are allowed; the last corner is connected with the first one.
pub fn contains(polygon: &[Pixel], point: Pixel) -> bool {
    let mut inside = false;
    for (a, b) in edges(polygon) {
        if (a.v > point.v) != (b.v > point.v) && point.u < a.u + (point.v - a.v) / (b.v - a.v) * (b.u - a.u) {
            inside = !inside;
        }
    }
    inside
}

/// Returns the mask of the pixels whose centres lie inside of the polygon by the even–odd rule, for a picture of this
/// size.
pub fn fill_polygon(polygon: &[Pixel], width: usize, height: usize) -> Mask {
    let mut mask = Mask::all_outside(width, height);
    for row in 0..height {
        let v = row as f64;
        let mut crossings: Vec<f64> = edges(polygon)
            .filter(|(a, b)| (a.v > v) != (b.v > v))
            .map(|(a, b)| a.u + (v - a.v) / (b.v - a.v) * (b.u - a.u))
            .collect();
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let from = pair[0].ceil().max(0.0) as usize;
            let to = (pair[1].ceil().max(0.0) as usize).min(width);
            mask.inside[row * width..][..width].iter_mut().take(to).skip(from).for_each(|inside| *inside = true);
        }
    }
    mask
}

/// Returns the polygon's area, px², positive if the corners run clockwise as seen on a screen (v down).
pub fn signed_area_px2(polygon: &[Pixel]) -> f64 {
    edges(polygon).map(|(a, b)| (a.u * b.v - b.u * a.v) / 2.0).sum()
}

/// Finds two sides that meet at a point other than a common corner. A side has the number of its first corner, from 0.
/// Returns `None` for a simple polygon.
pub fn crossing_sides(polygon: &[Pixel]) -> Option<[usize; 2]> {
    let count = polygon.len();
    let side = |i: usize| (polygon[i], polygon[(i + 1) % count]);
    let pairs = (0..count).flat_map(|i| (i + 2..count).map(move |j| [i, j]));
    pairs.filter(|[i, j]| (j + 1) % count != *i).find(|&[i, j]| do_segments_cross(side(i), side(j)))
}

/// Returns the distance of a point from the nearest side of the polygon, px.
pub fn distance_to_side_px(polygon: &[Pixel], point: Pixel) -> f64 {
    let to_side = |(a, b): (Pixel, Pixel)| {
        let (du, dv) = (b.u - a.u, b.v - a.v);
        let length2 = du * du + dv * dv;
        let share = ((point.u - a.u) * du + (point.v - a.v) * dv) / length2;
        let share = if length2 > 0.0 { share.clamp(0.0, 1.0) } else { 0.0 };
        point.distance_px(Pixel::at(a.u + share * du, a.v + share * dv))
    };
    edges(polygon).map(to_side).fold(f64::INFINITY, f64::min)
}

/// Returns whether two line segments have a point in common.
fn do_segments_cross((a, b): (Pixel, Pixel), (c, d): (Pixel, Pixel)) -> bool {
    let side = |p: Pixel, q: Pixel, r: Pixel| (q.u - p.u) * (r.v - p.v) - (q.v - p.v) * (r.u - p.u);
    let [c_side, d_side, a_side, b_side] = [side(a, b, c), side(a, b, d), side(c, d, a), side(c, d, b)];
    let beside = |p: Pixel, q: Pixel, r: Pixel| {
        (p.u.min(q.u)..=p.u.max(q.u)).contains(&r.u) && (p.v.min(q.v)..=p.v.max(q.v)).contains(&r.v)
    };
    let touches = [(c_side, a, b, c), (d_side, a, b, d), (a_side, c, d, a), (b_side, c, d, b)];
    c_side * d_side < 0.0 && a_side * b_side < 0.0
        || touches.into_iter().any(|(side, p, q, r)| side == 0.0 && beside(p, q, r))
}

fn edges(polygon: &[Pixel]) -> impl Iterator<Item = (Pixel, Pixel)> + '_ {
    polygon.iter().copied().zip(polygon.iter().copied().cycle().skip(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected value, calculated by hand: a right triangle of 4 × 2 px has 4 px².
    #[test]
    fn triangle() {
        let triangle = [Pixel::at(0.0, 0.0), Pixel::at(4.0, 0.0), Pixel::at(0.0, 2.0)];
        assert!((signed_area_px2(&triangle) - 4.0).abs() < 1e-12);
        assert!(contains(&triangle, Pixel::at(1.0, 0.5)));
        assert!(!contains(&triangle, Pixel::at(3.0, 1.5)));
    }

    /// Expected values, calculated by hand: sides 0 and 2 of an hourglass cross in its middle. A side that touches a
    /// corner is a crossing. The point (2, 1) is 1 px from the upper side of a rectangle of 4 × 4 px, and (6, 7) is
    /// √(2² + 3²) px from its corner.
    #[test]
    fn crossing_sides_and_distances_agree_with_hand_calculation() {
        let of = |corners: &[[f64; 2]]| corners.iter().map(|&[u, v]| Pixel::at(u, v)).collect::<Vec<_>>();
        let square = of(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
        assert_eq!(crossing_sides(&square), None);
        assert_eq!(crossing_sides(&of(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]])), Some([0, 2]));
        assert_eq!(
            crossing_sides(&of(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 0.0], [0.0, 4.0]])),
            Some([0, 2])
        );
        assert!((distance_to_side_px(&square, Pixel::at(2.0, 1.0)) - 1.0).abs() < 1e-12);
        assert!((distance_to_side_px(&square, Pixel::at(6.0, 7.0)) - 13f64.sqrt()).abs() < 1e-12);
    }
}
