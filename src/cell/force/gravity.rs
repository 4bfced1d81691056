//! The effect of the weight of the parts on the tool, as a function of the tool's orientation.
//!
//! ```text
//! F_contact = F_actuator + m g (a · d)                                                       (1)
//! F_actuator = F_contact − m g (a · d)                                                       (2)
//! F_actuator = F_reading − zero                                                              (3)
//! ```
//!
//! `a` is the direction in which the tool presses, its own +Z, and `d` the direction of gravity, −Z of the robot's
//! base, both of length 1: the base must be level. If the tool points down (`a · d` = 1), the weight adds to the
//! force; if it points up, the weight reduces the force. The payload that is sent to the tool is 0 kg, so that nothing
//! is compensated twice.

use crate::cell::CompliantTool;
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Rigid, STANDARD_GRAVITY_M_S2, Tool, Vector};

/// The load on the actuator, and its sensor's reading without force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorLoad {
    /// Mass on the actuator: the sander with its disc, kg.
    pub payload_kg: f64,
    /// The sensor's reading when the actuator has no force, N.
    pub zero_n: f64,
}

impl SensorLoad {
    /// Returns the part of the contact force that comes from the weight, N; `downwards` is the cosine between the
    /// tool's +Z and gravity, −1…1.
    pub fn presses_n(&self, downwards: f64) -> f64 {
        self.payload_kg * STANDARD_GRAVITY_M_S2 * downwards
    }

    /// Returns the contact force of a reading, N: (1) with (3).
    pub fn contact_n(&self, reading_n: f64, downwards: f64) -> f64 {
        reading_n - self.zero_n + self.presses_n(downwards)
    }

    /// Returns the actuator's force for this contact force, N: (2).
    pub fn actuator_n(&self, contact_n: f64, downwards: f64) -> f64 {
        contact_n - self.presses_n(downwards)
    }
}

impl From<&CompliantTool> for SensorLoad {
    fn from(tool: &CompliantTool) -> Self {
        SensorLoad { payload_kg: tool.payload_kg, zero_n: tool.zero_n }
    }
}

/// Returns how far a tool points down: the cosine between its +Z and gravity.
pub fn down_cosine(base_from_tool: &Rigid<Base, Tool>) -> f64 {
    -(*base_from_tool * Vector::<Tool>::new(Vector3::z())).mm.z
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::KukaPose;

    fn turned(b_deg: f64) -> f64 {
        down_cosine(&KukaPose { b_deg, ..KukaPose::default() }.to_rigid())
    }

    /// By hand: 2 kg weigh 19.6133 N. Down: 20 N of contact need 0.3867 N from the actuator. Up: 39.6133 N. Level:
    /// 20 N. At 60° from down, half of the weight presses: 10.19335 N.
    #[test]
    fn weight_presses_by_the_attitude() {
        let weight = SensorLoad { payload_kg: 2.0, zero_n: 0.0 };
        for (b_deg, actuator_n) in [(180.0, 0.3867), (0.0, 39.6133), (90.0, 20.0), (120.0, 10.193_35)] {
            let found = weight.actuator_n(20.0, turned(b_deg));
            assert!((found - actuator_n).abs() < 1e-9, "{b_deg}: {found}");
        }
    }

    /// Calculated by hand: for a horizontal tool, a reading of 21.5 N with a zero of 1.5 N is a contact of 20 N;
    /// pointing down it is 39.6133 N.
    #[test]
    fn a_reading_is_a_contact_force() {
        let weight = SensorLoad { payload_kg: 2.0, zero_n: 1.5 };
        assert!((weight.contact_n(21.5, turned(90.0)) - 20.0).abs() < 1e-9);
        assert!((weight.contact_n(21.5, turned(180.0)) - 39.6133).abs() < 1e-9);
    }
}
