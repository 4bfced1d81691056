//! Compares the detected breaks with a ground truth that the test did not use.

use super::Inspection;
use super::error::InspectError;
use panelprep_base::geometry::Mask;

/// Agreement of two masks, each value 0…1. If both masks are empty, all values are 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// Number of pixels in both masks, divided by the number of pixels in at least one of them.
    pub iou: f64,
    /// Number of pixels in both masks, divided by the number of detected pixels.
    pub precision: f64,
    /// Number of pixels in both masks, divided by the number of true pixels.
    pub recall: f64,
}

/// Number of grids for each combination of true state and result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Confusion {
    /// Grids with a break that failed.
    pub true_fail: usize,
    /// Grids without a break that failed: each costs an hour of sanding.
    pub false_fail: usize,
    /// Grids with a break that passed: the coating will peel off.
    pub false_pass: usize,
    /// Grids without a break that passed.
    pub true_pass: usize,
}

/// Compares a mask with the true mask, over the pixels of `region`.
///
/// # Errors
/// If the three masks differ in size.
pub fn score(mask: &Mask, truth: &Mask, region: &Mask) -> Result<Score, InspectError> {
    same_size(mask, region)?;
    same_size(truth, region)?;
    let (mut both, mut found, mut real) = (0usize, 0usize, 0usize);
    for index in (0..region.inside.len()).filter(|&index| region.inside[index]) {
        both += usize::from(mask.inside[index] && truth.inside[index]);
        found += usize::from(mask.inside[index]);
        real += usize::from(truth.inside[index]);
    }
    let share = |of: usize| if of == 0 { 1.0 } else { both as f64 / of as f64 };
    Ok(Score { iou: share(found + real - both), precision: share(found), recall: share(real) })
}

/// Compares like [`score`], but without the pixels within one pixel of the rim of the true mask: no picture shows the
/// position of a rim more exactly.
///
/// # Errors
/// If the three masks differ in size.
pub fn score_within(mask: &Mask, truth: &Mask, region: &Mask) -> Result<Score, InspectError> {
    same_size(truth, region)?;
    let mut within = region.clone();
    for row in 0..truth.height {
        for column in 0..truth.width {
            let own = truth.contains(column, row);
            let columns = column.saturating_sub(1)..(column + 2).min(truth.width);
            let mut rows = row.saturating_sub(1)..(row + 2).min(truth.height);
            if rows.any(|v| columns.clone().any(|u| truth.contains(u, v) != own)) {
                within.inside[row * truth.width + column] = false;
            }
        }
    }
    score(mask, truth, &within)
}

impl Inspection {
    /// Compares the grids that failed with the grids that the true mask would fail by the same rule.
    ///
    /// # Errors
    /// If the mask differs in size from the pictures.
    pub fn compare_with_truth(&self, truth: &Mask) -> Result<Confusion, InspectError> {
        same_size(truth, &self.footprint.region())?;
        let mut confusion = Confusion::default();
        for (grid, real_mm2) in self.grids.iter().zip(self.footprint.broken_mm2(truth)) {
            *match (real_mm2 >= self.observation.min_break_mm2, grid.failed) {
                (true, true) => &mut confusion.true_fail,
                (false, true) => &mut confusion.false_fail,
                (true, false) => &mut confusion.false_pass,
                (false, false) => &mut confusion.true_pass,
            } += 1;
        }
        Ok(confusion)
    }
}

fn same_size(mask: &Mask, region: &Mask) -> Result<(), InspectError> {
    if (mask.width, mask.height) == (region.width, region.height) {
        return Ok(());
    }
    Err(InspectError::PictureSize {
        found_width: mask.width,
        found_height: mask.height,
        width: region.width,
        height: region.height,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(flags: [u8; 6]) -> Mask {
        Mask { width: 3, height: 2, inside: flags.map(|flag| flag == 1).to_vec() }
    }

    /// Expected values, calculated by hand: of the five pixels of the region, 3 were detected, 2 are true and 1 is
    /// both, so the values are 1/4, 1/3 and 1/2.
    #[test]
    fn the_agreement_of_two_masks_equals_the_hand_calculation() {
        let region = mask([1, 1, 1, 1, 1, 0]);
        let score = score(&mask([1, 1, 1, 0, 0, 1]), &mask([0, 0, 1, 1, 0, 1]), &region).expect("one size");
        assert_eq!(score, Score { iou: 0.25, precision: 1.0 / 3.0, recall: 0.5 });
    }

    /// Expected result for one true pixel of 3 × 2 at the left: its column and the next one are the rim; the last
    /// column contains no true pixel.
    #[test]
    fn the_rim_is_excluded() {
        let (truth, region) = (mask([1, 0, 0, 0, 0, 0]), mask([1; 6]));
        let inner = score_within(&mask([0, 1, 0, 0, 0, 0]), &truth, &region).expect("one size");
        assert_eq!(inner.iou, 1.0);
        assert_eq!(score_within(&mask([1, 0, 1, 0, 0, 0]), &truth, &region).map(|score| score.iou), Ok(0.0));
    }

    #[test]
    fn two_empty_masks_agree() {
        let (none, region) = (mask([0; 6]), mask([1; 6]));
        assert_eq!(score(&none, &none, &region).map(|score| score.iou), Ok(1.0));
        assert_eq!(score(&none, &region, &region).map(|score| score.recall), Ok(0.0));
    }

    #[test]
    fn masks_of_different_sizes_are_refused() {
        assert!(score(&Mask::all_outside(2, 3), &mask([0; 6]), &mask([1; 6])).is_err());
    }
}
