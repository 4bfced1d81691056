//! Checks the ends of the lines of a path: the arm must end at the point that was sent, with the base and the tool that
//! were sent in its epoch, whatever base and tool the controller reports.

use panelprep::devices::mock::ExecutedMotion;
use panelprep::eki::{CommandId, Epoch, MoveLin};
use panelprep::geometry::{Base, Flange, KukaPose, Panel, Rigid, Tool};
use std::collections::BTreeMap;

/// Maximum error of the end of a line, mm: single precision and the rotation of the controller's own frames.
const MAX_END_ERROR_MM: f64 = 0.05;

/// The required end of a line: the tool's pose, the tool's frame on the flange, and the maximum rounding, mm.
type Aim = (Rigid<Base, Tool>, Rigid<Flange, Tool>, f64);

/// The motions that were sent, and the number of executed motions that were already checked.
#[derive(Debug, Default)]
pub struct Aims {
    pub base: Option<KukaPose>,
    pub tool: Option<KukaPose>,
    aims: BTreeMap<(u32, u32), Aim>,
    looked: usize,
    /// The epoch and the ID of the last executed motion.
    last: (u32, u32),
}

impl Aims {
    /// Adds a queued path whose last point has this ID.
    pub fn queued(&mut self, epoch: Epoch, last: CommandId, points: &[MoveLin]) {
        let (Some(base), Some(tool)) = (self.base, self.tool) else { return };
        let first = last.0 + 1 - points.len() as u32;
        for (point, id) in points.iter().zip(first..) {
            let target = base.to_rigid::<Base, Panel>() * point.pose.to_rigid::<Panel, Tool>();
            self.aims.insert((epoch.0, id), (target, tool.to_rigid(), point.blend_mm));
        }
    }

    /// Checks the lines executed since the last call. Returns a line that ended at a wrong place, and a line that was
    /// executed although the line before it was omitted.
    pub fn look(&mut self, executed: &[ExecutedMotion]) -> [Option<String>; 2] {
        let fresh = executed.get(self.looked..).unwrap_or_default();
        self.looked = executed.len();
        [self.off(fresh), self.first_missing_point(fresh)]
    }

    /// A path with a missing point is worse than a stop, because the arm cuts an unplanned corner.
    fn first_missing_point(&mut self, fresh: &[ExecutedMotion]) -> Option<String> {
        let mut found = None;
        for step in fresh {
            let (epoch, id) = (step.epoch.cast_unsigned(), step.id.cast_unsigned());
            let before = (epoch, id.saturating_sub(1));
            let is_within = self.aims.contains_key(&(epoch, id)) && self.aims.contains_key(&before);
            if is_within && self.last != before {
                let (last_epoch, last) = self.last;
                found.get_or_insert_with(|| {
                    format!("line {id} of epoch {epoch} was executed behind {last} of epoch {last_epoch}")
                });
            }
            self.last = (epoch, id);
        }
        found
    }

    fn off(&self, fresh: &[ExecutedMotion]) -> Option<String> {
        fresh.iter().find_map(|step| {
            let key = (step.epoch.cast_unsigned(), step.id.cast_unsigned());
            let (target, tool, blend_mm) = self.aims.get(&key)?;
            let off_mm = (step.base_from_flange * *tool).origin().distance_mm(target.origin());
            let (epoch, id) = key;
            (off_mm > blend_mm + MAX_END_ERROR_MM)
                .then(|| format!("command {id} of epoch {epoch} ended {off_mm:.3} mm off its point"))
        })
    }
}
