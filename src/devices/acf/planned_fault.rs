//! A fault of the simulated tool that begins during a path: `silent@40`, from the 40th waypoint in contact on.

use super::mock::ToolFault;
use std::str::FromStr;

/// Delay of an answer if no time is named, ms, and error of the force, N.
const DEFAULT_DELAY_MS: u64 = 130;
const DEFAULT_FORCE_ERROR_N: f64 = 12.0;

/// A fault, and the number of waypoints after which the tool has the fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedToolFault {
    /// The fault.
    pub fault: ToolFault,
    /// Number of waypoints in contact that were executed before.
    pub from: u32,
}

/// The error of a fault specification.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found \"{found}\"; valid: {}", PlannedToolFault::HELP)]
pub struct PlannedToolFaultError {
    found: String,
}

impl PlannedToolFault {
    /// The syntax of a fault.
    pub const HELP: &'static str = "NAME[=VALUE]@N, N being a waypoint in contact from 1 on: link-cut, silent, late=MS, garbage, \
                                    other-id, errors=BITS, force=N, no-contact, stuck; for example silent@40 or force=-12@3";
}

impl FromStr for PlannedToolFault {
    type Err = PlannedToolFaultError;

    fn from_str(text: &str) -> Result<Self, PlannedToolFaultError> {
        read(text).ok_or_else(|| PlannedToolFaultError { found: text.to_owned() })
    }
}

fn read(text: &str) -> Option<PlannedToolFault> {
    let (what, from) = text.split_once('@')?;
    let (name, value) = what.split_once('=').map_or((what, None), |(name, value)| (name, Some(value)));
    let fault = match (name, value) {
        ("link-cut", None) => ToolFault::LinkCut,
        ("silent", None) => ToolFault::Silent,
        ("late", ms) => ToolFault::Late(ms.map_or(Some(DEFAULT_DELAY_MS), |ms| ms.parse().ok())?),
        ("garbage", None) => ToolFault::Garbage,
        ("other-id", None) => ToolFault::OtherId,
        ("errors", bits) => ToolFault::Errors(bits.map_or(Some(1), |bits| bits.parse().ok())?),
        ("force", off) => ToolFault::ForceOff(off.map_or(Some(DEFAULT_FORCE_ERROR_N), parse_finite)?),
        ("no-contact", None) => ToolFault::NoContact,
        ("stuck", None) => ToolFault::Stuck,
        _ => return None,
    };
    Some(PlannedToolFault { fault, from: from.parse().ok().filter(|from| *from > 0)? })
}

fn parse_finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_read_with_its_waypoint() {
        let of = |text: &str| text.parse::<PlannedToolFault>().map(|planned| (planned.fault, planned.from));
        assert_eq!(of("silent@40"), Ok((ToolFault::Silent, 40)));
        assert_eq!(of("force=-12.5@3"), Ok((ToolFault::ForceOff(-12.5), 3)));
        assert_eq!(of("late@1"), Ok((ToolFault::Late(130), 1)));
        assert_eq!(of("errors=2@7"), Ok((ToolFault::Errors(2), 7)));
        for wrong in ["silent", "silent@0", "silent@x", "mute@4", "silent=3@4", "force=nan@4", ""] {
            let told = of(wrong).expect_err("no fault").to_string();
            assert!(told.starts_with(&format!("found \"{wrong}\"")) && told.contains("silent@40"), "{told}");
        }
    }
}
