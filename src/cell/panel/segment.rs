//! Segmentation of a scan into smooth objects: the connected piece around a seed, or the largest piece.
//!
//! Two neighbouring pixels belong to one object if the step in depth between them is smaller than any smooth panel
//! causes from one pixel to the next. No shape is assumed.

use panelprep_base::geometry::{DIRECT_NEIGHBOURS, Frame, Mask, OrganizedCloud, RasterSize, median};

/// Neighbouring points belong to two objects if their distance exceeds the usual distance by this factor. The
/// factor is larger than a steep panel causes, and far smaller than the gap between a panel and its fixture.
const MAX_STEPS: f64 = 6.0;

/// Returns the usual distance between neighbouring points, mm: the median along the rows.
fn usual_step_mm<F: Frame>(cloud: &OrganizedCloud<F>, free: &[bool]) -> Option<f64> {
    let pair = |index: usize| {
        let beside = index + 1;
        let pair = free[index] && !beside.is_multiple_of(cloud.width()) && free[beside];
        pair.then(|| Some(cloud.point_at(index)?.distance_mm(cloud.point_at(beside)?))).flatten()
    };
    let mut steps: Vec<f64> = (0..free.len() - 1).step_by(7).filter_map(pair).collect();
    median(&mut steps)
}

/// Returns the distance below which neighbouring points belong to one object, mm.
pub(super) fn max_step_mm<F: Frame>(cloud: &OrganizedCloud<F>, free: &[bool]) -> f64 {
    MAX_STEPS * usual_step_mm(cloud, free).unwrap_or_default()
}

/// Finds the connected pieces of a scan, each as its pixel indices, largest first.
pub fn find_pieces<F: Frame>(cloud: &OrganizedCloud<F>, inside: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let raster = RasterSize { width: cloud.width(), height: cloud.height() };
    let free: Vec<bool> =
        (0..raster.width * raster.height).map(|i| inside(i) && cloud.point_at(i).is_some()).collect();
    let max_step_mm = max_step_mm(cloud, &free);
    let near = |here: usize, there: usize| {
        let points = cloud.point_at(here).zip(cloud.point_at(there));
        points.is_some_and(|(here, there)| there.distance_mm(here) < max_step_mm)
    };
    let mut found = raster.joined_pieces(&DIRECT_NEIGHBOURS, |index| free[index], near);
    found.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    found
}

/// Converts a piece to a mask.
pub fn piece_to_mask<F: Frame>(cloud: &OrganizedCloud<F>, piece: &[usize]) -> Mask {
    let mut mask = Mask::all_outside(cloud.width(), cloud.height());
    for &index in piece {
        mask.inside[index] = true;
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Camera;

    /// A near block of 4 × 4 pixels in front of a wall 60 mm behind: two pieces, the wall first.
    #[test]
    fn a_gap_in_depth_parts_two_objects() {
        let point = |i: usize| {
            let (column, row) = (i % 10, i / 10);
            let near = (3..7).contains(&column) && (3..7).contains(&row);
            [column as f32 * 0.4, row as f32 * 0.4, if near { 700.0 } else { 760.0 }]
        };
        let cloud = OrganizedCloud::<Camera>::new(10, 10, (0..100).map(point).collect(), vec![[0; 3]; 100])
            .expect("counts agree");
        let pieces = find_pieces(&cloud, |_| true);
        assert_eq!(pieces.iter().map(Vec::len).collect::<Vec<_>>(), [84, 16]);
        assert!(piece_to_mask(&cloud, &pieces[1]).contains(4, 4));
    }
}
