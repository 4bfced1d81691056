//! What many clips say together.

use panelprep::geometry::Mask;
use panelprep::inspect::Inspection;
use panelprep::sim::{Film, WET_FROM_S};

/// Numbers of all clips.
#[derive(Debug, Default)]
pub struct Tally {
    pub iou: Vec<f64>,
    pub iou_within: Vec<f64>,
    pub thesis_iou: Vec<f64>,
    pub spots: usize,
    pub missed: Vec<f64>,
    /// Area and whether it was found, of every spot.
    pub by_size: Vec<(f64, bool)>,
    pub time_errors_s: Vec<f64>,
    pub false_pass: usize,
    pub false_fail: usize,
    pub clean_grids: usize,
    pub broken_grids: usize,
    pub spray_wrong: usize,
    pub wrong_verdicts: usize,
}

impl Tally {
    /// Takes every spot of a clip: areas of those that were missed, and how late or early 10 mm² of each were broken.
    pub fn spots_of(&mut self, inspection: &Inspection, film: &Film, truth: &Mask) -> (Vec<f64>, Vec<f64>) {
        let (footprint, region) = (&inspection.footprint, inspection.footprint.region());
        let true_s = film.break_times_s();
        let (mut missed, mut errors) = (Vec::new(), Vec::new());
        let inside = truth.inside.iter().zip(&region.inside).map(|(truly, inside)| *truly && *inside).collect();
        for piece in (Mask { inside, ..*truth }).pieces() {
            let mut mask = Mask::empty(truth.width, truth.height);
            piece.iter().for_each(|&index| mask.inside[index] = true);
            let area_mm2: f64 = footprint.broken_mm2(&mask).iter().sum();
            let mut real: Vec<f64> = piece.iter().map(|&i| (f64::from(true_s[i]) - WET_FROM_S).max(0.0)).collect();
            let mut found: Vec<f64> =
                piece.iter().filter_map(|&i| inspection.break_time_s(i % truth.width, i / truth.width)).collect();
            let is_found = found.len() * 2 >= piece.len();
            self.spots += 1;
            self.by_size.push((area_mm2, is_found));
            if !is_found {
                missed.push(area_mm2);
            }
            let tenth = (10.0 / area_mm2 * piece.len() as f64).ceil() as usize;
            real.sort_by(f64::total_cmp);
            found.sort_by(f64::total_cmp);
            if let (Some(real_s), Some(found_s)) = (real.get(tenth), found.get(tenth)) {
                errors.push(found_s - real_s);
            }
        }
        self.missed.extend(missed.iter().filter(|area_mm2| **area_mm2 >= 25.0));
        self.time_errors_s.extend(&errors);
        (missed, errors)
    }

    pub fn print(&self) {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
        let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
        println!("\nintersection over union on {} clips with breaks (mean, least):", self.iou.len());
        println!(
            "  without ±1 px of rim  {:.4}  {:.4}   (needed 0.95)",
            mean(&self.iou_within),
            least(&self.iou_within)
        );
        println!("  with the rim          {:.4}  {:.4}   (needed 0.90)", mean(&self.iou), least(&self.iou));
        println!(
            "  the thesis's pipeline, default thresholds, on {} of them: {:.4}  {:.4}",
            self.thesis_iou.len(),
            mean(&self.thesis_iou),
            least(&self.thesis_iou)
        );
        println!(
            "spots: {}; missed of those from 25 mm² on: {} {:.0?}",
            self.spots,
            self.missed.len(),
            self.missed
        );
        for (low, high) in [(0.0, 5.0), (5.0, 25.0), (25.0, 50.0), (50.0, 200.0), (200.0, f64::INFINITY)] {
            let of: Vec<bool> = self.by_size.iter().filter(|(a, _)| (low..high).contains(a)).map(|s| s.1).collect();
            println!(
                "  {low:4.0} to {high:4.0} mm²: {} of {} missed",
                of.iter().filter(|found| !**found).count(),
                of.len()
            );
        }
        println!(
            "grids: {} broken, {} of them passed (needed 0); {} clean, {} of them failed: {:.2} % (needed 0.5 %)",
            self.broken_grids,
            self.false_pass,
            self.clean_grids,
            self.false_fail,
            100.0 * self.false_fail as f64 / self.clean_grids.max(1) as f64
        );
        let near = self.time_errors_s.iter().filter(|error| error.abs() <= 0.5).count();
        println!(
            "time to break, from 10 mm²: {:.1} % of {} within 0.5 s (needed 95 %)",
            100.0 * near as f64 / self.time_errors_s.len().max(1) as f64,
            self.time_errors_s.len()
        );
        println!("grease that breaks under the spray: {} clips not failed (needed 0)", self.spray_wrong);
        println!("verdicts that are wrong: {}", self.wrong_verdicts);
    }
}
