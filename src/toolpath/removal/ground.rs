//! Determines the points below the disc at which there is panel material: inside of the outline, by the pixel rows of
//! the taught picture.
//!
//! Inside of the region there is material except in the holes that the fit found. Outside of the region the outline
//! decides. For each pixel row, the positions at which the outline crosses the row are stored in order, so that a point
//! is checked without a search through the whole outline.

use crate::surface::Parameter;
use nalgebra::Point2;
use panelprep_base::geometry::Pixel;
use panelprep_cell::panel::Region;

/// The points of the panel's surface at which there is material below the disc.
#[derive(Debug, Clone)]
pub struct PanelGround {
    region: Region,
    top: i64,
    /// For each row, the positions at which the outline crosses the row's middle, px.
    crossings: Vec<Vec<f64>>,
}

impl PanelGround {
    /// Creates the ground from the closed outline in the taught picture; without an outline there is material
    /// everywhere.
    pub fn new(region: &Region, outline_px: &[Pixel]) -> Self {
        let (low, high) = outline_px
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), pixel| (low.min(pixel.v), high.max(pixel.v)));
        let (top, rows) = if low > high { (0, 0) } else { (low.floor() as i64, (high - low).ceil() as usize + 2) };
        let mut crossings = vec![Vec::new(); rows];
        for (a, b) in outline_px.iter().zip(outline_px.iter().cycle().skip(1)) {
            let (first, last) = (a.v.min(b.v).ceil() as i64, a.v.max(b.v).ceil() as i64);
            for row in first..last {
                let share = (row as f64 - a.v) / (b.v - a.v);
                if let Some(row) = usize::try_from(row - top).ok().and_then(|row| crossings.get_mut(row)) {
                    row.push(a.u + share * (b.u - a.u));
                }
            }
        }
        crossings.iter_mut().for_each(|row| row.sort_unstable_by(f64::total_cmp));
        PanelGround { region: region.clone(), top, crossings }
    }

    /// Returns whether there is material at this point; holes are ignored.
    pub fn is_panel(&self, at: Parameter) -> bool {
        let in_region = (0.0..=1.0).contains(&at.u) && (0.0..=1.0).contains(&at.v);
        if in_region || self.crossings.is_empty() {
            return true;
        }
        let pixel = self.region.pixel(Point2::new(at.u, at.v));
        let row = usize::try_from(pixel.v.round() as i64 - self.top).ok().and_then(|row| self.crossings.get(row));
        row.is_some_and(|row| row.partition_point(|crossing| *crossing <= pixel.u) % 2 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::map::tests::region;
    use super::*;

    /// The region is 0 to 60 px in both directions; the outline lies 10 px outside of the region, with a notch on the
    /// right.
    #[test]
    fn beside_the_region_the_outline_determines_the_panel() {
        let corners =
            [(-10.0, -10.0), (70.0, -10.0), (70.0, 20.0), (62.0, 30.0), (70.0, 40.0), (70.0, 70.0), (-10.0, 70.0)];
        let outline: Vec<Pixel> = corners.iter().map(|(u, v)| Pixel::at(*u, *v)).collect();
        let ground = PanelGround::new(&region(2, 2), &outline);
        let at = |u: f64, v: f64| ground.is_panel(Parameter { u: u / 60.0, v: v / 60.0 });
        assert!(at(30.0, 30.0) && at(-9.0, 30.0) && at(69.0, 10.0) && at(61.0, 30.0));
        assert!(!at(-11.0, 30.0) && !at(71.0, 10.0) && !at(66.0, 30.0) && !at(30.0, 72.0) && !at(30.0, -400.0));
        assert!(PanelGround::new(&region(2, 2), &[]).is_panel(Parameter { u: 9.0, v: 9.0 }), "no outline, no edge");
    }
}
