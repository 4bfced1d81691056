//! The parts of the camera's picture: how many scans show the board there, and the residuals of its plane.

use super::plane_view::PlaneView;
use panelprep_base::geometry::FieldRectangle;

/// Number of parts of the picture, across and down.
const PARTS: [usize; 2] = [8, 6];
/// Fewer scans in a part give no information on it.
pub const MIN_SCANS: usize = 2;

/// One part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PicturePart {
    /// The direction of the part's middle, (X/Z, Y/Z).
    pub direction: [f64; 2],
    /// Number of scans that show the board there.
    pub scans: usize,
    /// Deviation of left-out scans from a plane there, rms, mm, after the correction if there is one; NaN without
    /// scans.
    pub residual_mm: f64,
}

/// All parts of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureParts {
    rectangle: FieldRectangle,
    parts: Vec<PicturePart>,
}

impl PictureParts {
    /// Returns the parts of a picture with these directions; `residuals_mm` are those of each view's blocks.
    pub(super) fn from_views(views: &[PlaneView], residuals_mm: &[Vec<f64>], over: FieldRectangle) -> Self {
        let mut scans = vec![0_usize; PARTS[0] * PARTS[1]];
        let mut sums = vec![(0.0, 0.0); scans.len()];
        for (view, residuals_mm) in views.iter().zip(residuals_mm) {
            let mut is_here = vec![false; scans.len()];
            for (block, residual_mm) in view.blocks.iter().zip(residuals_mm) {
                if let Some(part) = part(block.direction, &over) {
                    is_here[part] = true;
                    let (squares, count) = sums[part];
                    sums[part] = (squares + residual_mm * residual_mm, count + 1.0);
                }
            }
            scans.iter_mut().zip(is_here).for_each(|(scans, is_here)| *scans += usize::from(is_here));
        }
        let middle = |index: usize, axis: usize| {
            let share = (index as f64 + 0.5) / PARTS[axis] as f64;
            over.min[axis] + share * (over.max[axis] - over.min[axis])
        };
        let all = scans.into_iter().zip(sums).enumerate();
        let parts = all.map(|(index, (scans, (squares, count)))| PicturePart {
            direction: [middle(index % PARTS[0], 0), middle(index / PARTS[0], 1)],
            scans,
            residual_mm: (squares / count).sqrt(),
        });
        PictureParts { parts: parts.collect(), rectangle: over }
    }

    /// Row by row.
    pub fn iter(&self) -> impl Iterator<Item = &PicturePart> {
        self.parts.iter()
    }

    /// Returns the part with this direction; `None` outside of the picture.
    pub fn part_at(&self, direction: [f64; 2]) -> Option<&PicturePart> {
        self.parts.get(part(direction, &self.rectangle)?)
    }

    /// Returns the share of the parts in which enough scans show the board.
    pub(super) fn covered_share(&self) -> f64 {
        self.iter().filter(|part| part.has_enough_scans()).count() as f64 / self.parts.len() as f64
    }
}

impl PicturePart {
    /// Returns whether enough scans show the board in this part.
    pub fn has_enough_scans(&self) -> bool {
        self.scans >= MIN_SCANS
    }
}

fn part(direction: [f64; 2], over: &FieldRectangle) -> Option<usize> {
    let share = |axis: usize| {
        let share = (direction[axis] - over.min[axis]) / (over.max[axis] - over.min[axis]);
        (0.0..1.0).contains(&share).then(|| (share * PARTS[axis] as f64) as usize)
    };
    Some(share(1)? * PARTS[0] + share(0)?)
}
