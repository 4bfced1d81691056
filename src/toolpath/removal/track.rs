//! The segments of a path in contact: the position of the disc, its pressure, and the length that a grain rubs in each.
//!
//! A path consists of poses with their times, planned or as the robot reported them. Each line between two poses is
//! divided into segments of at most half of the disc's radius; for a whole segment, the contact at its middle is used.
//! A pose that is marked as in contact counts as in contact if its tip is not higher above the surface than `dwell`
//! states. The area that the disc has swept grows by its diameter times the length, as the store counts it.

use super::pad::{ContactGeometry, PadWithDisc, SupportMask};
use super::speed::Orbit;
use super::stroke::DiscStroke;
use super::tangent_frame::TangentFrame;
use crate::surface::dwell::{CONTACT_MM, ExecutedPose, surface_foot};
use crate::surface::{BSplineSurface, Parameter};
use nalgebra::Vector2;
use panelprep_base::geometry::{Panel, Point};
use std::f64::consts::TAU;

/// Largest length of a segment, in radii of the disc.
const STRETCH_RADII: f64 = 0.5;
/// Number of directions in which places on the rim, and half-way to the rim, show whether the whole disc has panel
/// below it.
const RIM_SAMPLES: usize = 16;

/// A function that returns whether there is panel at this place of the surface.
pub type IsPanelAt<'a> = &'a (dyn Fn(Parameter) -> bool + Sync);

/// The disc of a tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Disc and pad.
    pub pad: PadWithDisc,
    /// Its orbit.
    pub orbit: Orbit,
    /// Whether the rim moves on the orbit; otherwise the pressure is calculated without an orbit, as in simpler
    /// models.
    pub rim_orbits: bool,
    /// Area that the disc has swept before this path, mm².
    pub swept_mm2: f64,
}

impl Disc {
    /// Returns the radius of the circle on which the rim moves, mm.
    fn rim_orbit_mm(&self) -> f64 {
        if self.rim_orbits { self.orbit.diameter_mm / 2.0 } else { 0.0 }
    }
}

/// A short straight motion of the disc in contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiscStretch {
    /// The tangent frame of the surface at the segment's middle.
    pub frame: TangentFrame,
    /// The contact at the segment's middle, and the motion.
    pub stroke: DiscStroke,
    /// Length of the segment, mm.
    pub length_mm: f64,
    /// Length that a grain rubs during the segment, mm.
    pub rubbed_mm: f64,
    /// The pose at the end of the segment, counted from 0.
    pub pose: usize,
    /// Area that the disc has swept by the segment's middle, mm².
    pub swept_mm2: f64,
}

/// Returns the segments of a path. If the force of a pose was not measured, the tool presses with `nominal_n`, N, on
/// the motion to this pose.
pub fn path_stretches(
    surface: &BSplineSurface,
    executed: &[ExecutedPose],
    (disc, nominal_n): (&Disc, f64),
    ground: IsPanelAt<'_>,
) -> Vec<DiscStretch> {
    let mut all = Vec::new();
    let (mut guess, mut swept_mm2) = (Parameter { u: 0.5, v: 0.5 }, disc.swept_mm2);
    for (index, pair) in executed.windows(2).enumerate().filter(|(_, pair)| pair[1].contact) {
        let (from, to) = (pair[0].panel_from_tool.origin(), pair[1].panel_from_tool.origin());
        let way_mm = from.distance_mm(to);
        let count = (way_mm / (STRETCH_RADII * disc.pad.radius_mm)).ceil().max(1.0);
        let (length_mm, seconds) = (way_mm / count, pair[1].seconds / count);
        let force_n = pair[1].force_n.unwrap_or(nominal_n);
        let at = |share: f64| from + (to - from) * (share / count);
        for step in 0..count as usize {
            swept_mm2 += length_mm * disc.pad.radius_mm;
            let ends = [at(step as f64), at(step as f64 + 1.0)];
            let Some(frame) = surface_frame_below(surface, &mut guess, at(step as f64 + 0.5)) else { continue };
            let tool = pair[if 2 * step < count as usize { 0 } else { 1 }].panel_from_tool;
            let seat =
                frame.tilt(&tool).map(|tilt| ContactGeometry { tilt, curvature_per_mm: frame.curvature_per_mm });
            let pressed = seat.and_then(|seat| contact(&frame, seat, (disc, force_n), ground));
            if let Some(contact) = pressed {
                let ends_mm = ends.map(|end| frame.offset_mm(end));
                let stroke = DiscStroke::new(contact, ends_mm, (disc.rim_orbit_mm(), all.len()));
                let rubbed_mm = rubbed_mm(&disc.orbit, length_mm, seconds);
                all.push(DiscStretch { frame, stroke, length_mm, rubbed_mm, pose: index + 1, swept_mm2 });
            }
            swept_mm2 += length_mm * disc.pad.radius_mm;
        }
    }
    all
}

/// Calculates the length that a grain rubs in this time on a motion of this length, mm.
fn rubbed_mm(orbit: &Orbit, length_mm: f64, seconds: f64) -> f64 {
    // If no time has passed, the disc cannot have moved: the same report came twice.
    if seconds > 0.0 { orbit.grain_mm_s(length_mm / seconds) * seconds } else { length_mm }
}

/// Returns the frame of the surface below a point in contact.
fn surface_frame_below(
    surface: &BSplineSurface,
    guess: &mut Parameter,
    point: Point<Panel>,
) -> Option<TangentFrame> {
    let at = surface_foot(surface, *guess, point)?;
    *guess = at;
    let normal = surface.normal(at)?;
    let height_mm = normal.mm.dot(&(point - surface.point(at)).mm);
    if height_mm > CONTACT_MM { None } else { TangentFrame::compute(surface, at) }
}

/// Calculates the contact at a frame; parts of the disc beyond the panel carry no force.
fn contact(
    frame: &TangentFrame,
    seat: ContactGeometry,
    (disc, force_n): (&Disc, f64),
    ground: IsPanelAt<'_>,
) -> Option<super::pad::Contact> {
    let has_panel = |offset: Vector2<f64>| ground(frame.parameter(offset));
    let look = |index: usize, share: f64| {
        let angle = TAU * index as f64 / RIM_SAMPLES as f64;
        has_panel(Vector2::new(angle.cos(), angle.sin()) * (share * disc.pad.radius_mm))
    };
    let is_whole =
        has_panel(Vector2::zeros()) && (0..RIM_SAMPLES).all(|index| look(index, 1.0) && look(index, 0.5));
    let below: SupportMask<'_> = &has_panel;
    // The closed form holds for a whole disc; only at the edge is the pressure summed over the part on the panel.
    disc.pad.contact_at_force(force_n, seat, (!is_whole).then_some(below))
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::examples::MODEL;
    use super::*;
    use crate::surface::KnotVector;
    use panelprep_base::geometry::KukaPose;

    pub(in crate::removal) const DISC: Disc = Disc {
        pad: PadWithDisc { radius_mm: 15.0, stiffness_n_mm3: 0.05 },
        orbit: MODEL.orbit,
        rim_orbits: false,
        swept_mm2: 0.0,
    };

    /// Returns a level square with sides of this length, mm.
    pub(in crate::removal) fn level(side_mm: f64) -> BSplineSurface {
        let knots = || KnotVector::uniform(1, 1, 0.0..=1.0).expect("knots");
        let corner = |(x, y): (f64, f64)| Point::at(x * side_mm, y * side_mm, 0.0);
        let controls = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].map(corner);
        BSplineSurface::new([knots(), knots()], controls.to_vec(), Point::at(0.0, 0.0, 500.0)).expect("a surface")
    }

    /// Returns a pose with the tool's point at this position and the pad down.
    pub(in crate::removal) fn pose([x_mm, y_mm, z_mm]: [f64; 3], seconds: f64) -> ExecutedPose {
        let tool = KukaPose { x_mm, y_mm, z_mm, c_deg: 180.0, ..KukaPose::default() };
        ExecutedPose { panel_from_tool: tool.to_rigid(), seconds, contact: true, force_n: None }
    }

    /// Calculated by hand: 60 mm in 1 s are 8 segments of 7.5 mm; a grain rubs 2618.3 mm during this time; the disc of
    /// 30 mm sweeps 1800 mm².
    #[test]
    fn a_line_is_cut_into_stretches() {
        let line = [pose([20.0, 50.0, 0.0], 0.0), pose([80.0, 50.0, 0.0], 1.0)];
        let all = path_stretches(&level(100.0), &line, (&DISC, 20.0), &|_| true);
        assert_eq!((all.len(), all[0].pose), (8, 1));
        let sum = |of: fn(&DiscStretch) -> f64| all.iter().map(of).sum::<f64>();
        assert!((sum(|stretch| stretch.rubbed_mm) - 2_618.34).abs() < 0.01, "{}", sum(|s| s.rubbed_mm));
        assert!((all[7].swept_mm2 - 1_800.0 * 7.5 / 8.0).abs() < 0.1, "{}", all[7].swept_mm2);
        assert!((all[3].stroke.contact.depth_mm - 0.565_884).abs() < 1e-4);
    }

    #[test]
    fn what_is_lifted_or_without_force_removes_nothing() {
        let surface = level(100.0);
        let count = |z: f64, forces_n: [Option<f64>; 2]| {
            let line = [pose([20.0, 50.0, z], 0.0), pose([80.0, 50.0, z], 1.0)];
            let line = [0, 1].map(|index| ExecutedPose { force_n: forces_n[index], ..line[index] });
            path_stretches(&surface, &line, (&DISC, 20.0), &|_| true).len()
        };
        assert_eq!([count(1.5, [None; 2]), count(0.5, [None; 2])], [0, 8]);
        // The force on the motion to a pose is the force of this pose.
        assert_eq!([count(0.0, [Some(0.0), Some(20.0)]), count(0.0, [Some(20.0), Some(0.0)])], [8, 0]);
    }

    /// Calculated by hand: with the disc's middle above the panel's edge, half of the disc carries the whole force.
    #[test]
    fn beyond_the_edge_the_rest_bears_the_force() {
        let line = [pose([20.0, 50.0, 0.0], 0.0), pose([80.0, 50.0, 0.0], 1.0)];
        let all = path_stretches(&level(100.0), &line, (&DISC, 20.0), &|at| at.v < 0.5);
        assert!(
            (all[0].stroke.contact.depth_mm / 1.131_768 - 1.0).abs() < 0.03,
            "{}",
            all[0].stroke.contact.depth_mm
        );
    }
}
