//! Wear of the sanding disc: how much a path wears the disc, and when the disc must be changed. The caller stores the
//! previous wear.

use super::planned::Plan;
use panelprep_base::verdict::{Check, LimitSource};
use panelprep_cell::recipe;

/// The wear of the discs that a plan causes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiscWearPlan {
    /// Area of the panel that the disc sweeps, where overlaps count each time, mm².
    pub swept_mm2: f64,
    /// Wear of the disc in use once the plan is done, mm²; more than a disc's life if the disc must be changed during
    /// the plan.
    pub wear_after_mm2: f64,
    /// Life of one disc, mm²; `None` if the recipe does not state it.
    pub life_mm2: Option<f64>,
}

impl DiscWearPlan {
    /// Calculates the wear that the plan causes on a disc with this previous wear, mm².
    pub fn compute(plan: &Plan, settings: &recipe::Path, worn_mm2: f64) -> Self {
        let swept_mm2 = plan.contact_mm * settings.disc_diameter_mm();
        DiscWearPlan { swept_mm2, wear_after_mm2: worn_mm2 + swept_mm2, life_mm2: settings.disc_life_mm2() }
    }

    /// Returns the number of discs that the plan wears, with the fraction of the last one; `None` if the recipe does
    /// not state a disc's life.
    pub fn discs(&self) -> Option<f64> {
        self.life_mm2.map(|life_mm2| self.swept_mm2 / life_mm2)
    }

    /// Returns whether the disc must be changed before this plan begins.
    pub fn is_change_needed(&self) -> bool {
        self.life_mm2.is_some_and(|life_mm2| self.wear_after_mm2 > life_mm2)
    }

    /// Checks the wear of the disc in use once `what` is done; a new disc is requested if this one would not last.
    pub fn check_wear(&self, name: &'static str, what: &str) -> Check {
        let Some(life_mm2) = self.life_mm2 else { return Check::new(name, "mm²", None) };
        let check = Check::new(name, "mm²", self.wear_after_mm2);
        check.with_max(life_mm2, LimitSource::recipe("path.disc_life_mm2")).or_review("disc_worn", || {
            let left_mm2 = (life_mm2 - (self.wear_after_mm2 - self.swept_mm2)).max(0.0);
            format!(
                "the disc has {left_mm2:.0} mm² of its life of {life_mm2:.0} mm² left (disc_life_mm2), but {what} \
                 needs {:.0} mm²; change the disc, report this with `panelprep ctl new-disc`, and accept",
                self.swept_mm2
            )
        })
    }
}
