//! Wear of the sanding disc: the wear that a path causes, and the time at which the disc must be changed. The caller
//! stores the wear.

use super::planned::Plan;
use panelprep_base::verdict::{Check, LimitSource};
use panelprep_cell::recipe;

/// The wear of the discs by a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiscWearPlan {
    /// Area of the panel that the disc sweeps, mm²; an area that is swept twice counts twice.
    pub swept_mm2: f64,
    /// Wear of the present disc after the plan, mm²; more than a disc's life if the disc must be changed during the
    /// plan.
    pub wear_after_mm2: f64,
    /// Life of one disc, mm²; `None` if it is not in the recipe.
    pub life_mm2: Option<f64>,
}

impl DiscWearPlan {
    /// Calculates the wear by a plan that begins with a disc of this wear, mm².
    pub fn compute(plan: &Plan, settings: &recipe::Path, worn_mm2: f64) -> Self {
        let swept_mm2 = plan.contact_mm * settings.disc_diameter_mm();
        DiscWearPlan { swept_mm2, wear_after_mm2: worn_mm2 + swept_mm2, life_mm2: settings.disc_life_mm2() }
    }

    /// Returns the number of discs that the plan needs, including the fraction of the last one; `None` if the life of a
    /// disc is not in the recipe.
    pub fn discs(&self) -> Option<f64> {
        self.life_mm2.map(|life_mm2| self.swept_mm2 / life_mm2)
    }

    /// Returns whether the disc must be changed before this plan begins.
    pub fn is_change_needed(&self) -> bool {
        self.life_mm2.is_some_and(|life_mm2| self.wear_after_mm2 > life_mm2)
    }

    /// Checks the wear of the present disc after the work `what`. If the remaining life of the disc is too short, the
    /// check requests a new disc.
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
