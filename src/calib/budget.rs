//! The error at the tool, from its parts: each a radius that holds the error with 95 %, mm.
//!
//! The parts are independent, so that their squares add. A part that was not measured makes the whole unmeasured.

/// The parts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Budget {
    /// The camera's mount, at the panel.
    pub hand_eye_mm: Option<f64>,
    /// The panel's place.
    pub locate_mm: Option<f64>,
    /// The fitted surface.
    pub fit_mm: Option<f64>,
    /// The robot and its tool: what the tool's calibration and a touch check leave.
    pub robot_mm: Option<f64>,
}

impl Budget {
    /// All parts together; `None` while one is not measured.
    pub fn total_mm(&self) -> Option<f64> {
        let parts = [self.hand_eye_mm?, self.locate_mm?, self.fit_mm?, self.robot_mm?];
        let total = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
        // A NaN part is not measured.
        total.is_finite().then_some(total)
    }

    /// The part that counts most, by its name in reports.
    pub fn largest(&self) -> Option<&'static str> {
        let parts = [
            ("hand_eye", self.hand_eye_mm),
            ("locate", self.locate_mm),
            ("fit", self.fit_mm),
            ("robot", self.robot_mm),
        ];
        let known = parts.into_iter().filter_map(|(name, part)| Some((name, part?)));
        known.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(name, _)| name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 0.1² + 0.2² + 0.2² + 0.4² = 0.25.
    #[test]
    fn squares_add() {
        let budget =
            Budget { hand_eye_mm: Some(0.1), locate_mm: Some(0.2), fit_mm: Some(0.2), robot_mm: Some(0.4) };
        assert!((budget.total_mm().expect("measured") - 0.5).abs() < 1e-12);
        assert_eq!(budget.largest(), Some("robot"));
        assert_eq!(Budget { fit_mm: None, ..budget }.total_mm(), None);
        assert_eq!(Budget { fit_mm: Some(f64::NAN), ..budget }.total_mm(), None);
    }
}
