//! Boxes of the surface, along the region's columns and rows, that are treated together: their cost, and how they are
//! joined, or cut at each other.
//!
//! The cost of a box is the surface over which the disc moves: the box and the disc's reach around it. So one box may
//! cost less than two, although it contains what lies between them; and it costs more, if most of it is empty corners.

use crate::surface::{BSplineSurface, Parameter, ParameterPatch};

/// Places on each side of a box at which the surface's scale is measured.
const SCALE_STEPS: usize = 4;
/// A narrower part of a box is rounding, in units of the region's sides.
const NOTHING: f64 = 1e-9;

/// The distances by which boxes are laid, on the surface, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distances {
    /// By which breaks are widened.
    pub margin_mm: f64,
    /// Areas with a smaller gap may become one.
    pub join_mm: f64,
    /// Least side of an area: in a smaller one the pattern's border makes the time under the disc uneven.
    pub least_mm: f64,
    /// By which the disc surely reaches beyond an area.
    pub reach_mm: f64,
}

pub(super) fn union(a: ParameterPatch, b: ParameterPatch) -> ParameterPatch {
    ParameterPatch {
        low: Parameter { u: a.low.u.min(b.low.u), v: a.low.v.min(b.low.v) },
        high: Parameter { u: a.high.u.max(b.high.u), v: a.high.v.max(b.high.v) },
    }
}

pub(super) fn clipped(patch: ParameterPatch) -> ParameterPatch {
    let inside = |at: Parameter| Parameter { u: at.u.clamp(0.0, 1.0), v: at.v.clamp(0.0, 1.0) };
    ParameterPatch { low: inside(patch.low), high: inside(patch.high) }
}

/// Returns a box that is larger by this length on the surface on each side, mm; nowhere by less.
pub(super) fn grown(surface: &BSplineSurface, patch: ParameterPatch, by_mm: f64) -> ParameterPatch {
    let by = |scale: [f64; 2]| {
        let [by_u, by_v] = scale.map(|mm| by_mm / mm);
        ParameterPatch {
            low: Parameter { u: patch.low.u - by_u, v: patch.low.v - by_v },
            high: Parameter { u: patch.high.u + by_u, v: patch.high.v + by_v },
        }
    };
    // The second time with the scale of the larger box: beside a break the surface may be smaller.
    by(least_scale(surface, clipped(by(least_scale(surface, patch)))))
}

/// Returns the least length on the surface for one unit of u across the lines of constant u, and the same for v, mm.
pub(super) fn least_scale(surface: &BSplineSurface, patch: ParameterPatch) -> [f64; 2] {
    let share = |index: usize| index as f64 / SCALE_STEPS as f64;
    let count = SCALE_STEPS + 1;
    let at = |place: usize| patch.parameter_at(Parameter { u: share(place % count), v: share(place / count) });
    (0..count * count).map(at).fold([f64::INFINITY; 2], |[least_u, least_v], at| {
        let tangents = surface.tangents(at);
        // Across and not along: in slanted parameters a step along u leaves the line of constant u at an angle.
        let [across_u, across_v] =
            [&tangents.s_v, &tangents.s_u].map(|along| tangents.area_mm2() / along.mm.norm());
        [least_u.min(across_u), least_v.min(across_v)]
    })
}

/// Returns whether boxes have a smaller surface than others, and also cost less.
pub(super) fn is_less(
    surface: &BSplineSurface,
    boxes: &[ParameterPatch],
    others: &[ParameterPatch],
    reach_mm: f64,
) -> bool {
    let sum = |all: &[ParameterPatch]| all.iter().map(|patch| area_mm2(surface, *patch)).sum::<f64>();
    sum(boxes) < sum(others) && cost_mm2(surface, boxes, reach_mm) < cost_mm2(surface, others, reach_mm)
}

/// Returns the cost of boxes, mm²: the surface of each in the region with the disc's reach around it.
pub(super) fn cost_mm2(surface: &BSplineSurface, boxes: &[ParameterPatch], reach_mm: f64) -> f64 {
    boxes.iter().map(|patch| area_mm2(surface, clipped(grown(surface, *patch, reach_mm)))).sum()
}

fn area_mm2(surface: &BSplineSurface, patch: ParameterPatch) -> f64 {
    let share = |index: usize| (index as f64 + 0.5) / SCALE_STEPS as f64;
    let count = SCALE_STEPS * SCALE_STEPS;
    let at = |place: usize| Parameter { u: share(place % SCALE_STEPS), v: share(place / SCALE_STEPS) };
    let per_unit: f64 = (0..count).map(|place| surface.tangents(patch.parameter_at(at(place))).area_mm2()).sum();
    per_unit / count as f64 * (patch.high.u - patch.low.u) * (patch.high.v - patch.low.v)
}

/// Joins boxes and cuts them at each other, so that they overlap by no more than the disc reaches beyond them. Together
/// they contain all that they contained.
pub(super) fn laid(
    surface: &BSplineSurface,
    mut boxes: Vec<ParameterPatch>,
    distances: Distances,
) -> Vec<ParameterPatch> {
    loop {
        boxes = joined(surface, boxes, distances);
        match cut_apart(surface, boxes.iter().copied().enumerate().collect(), distances) {
            Ok(parts) => return parts,
            Err([one, other]) => {
                boxes[one] = union(boxes[one], boxes[other]);
                boxes.remove(other);
            }
        }
    }
}

/// Joins boxes that overlap, or between which the gap is small, if the joined box costs no more than they do.
fn joined(surface: &BSplineSurface, boxes: Vec<ParameterPatch>, distances: Distances) -> Vec<ParameterPatch> {
    let cost = |boxes: &[ParameterPatch]| cost_mm2(surface, boxes, distances.reach_mm);
    let is_joined = |one: ParameterPatch, other: ParameterPatch| {
        is_near(surface, one, other, distances) && cost(&[union(one, other)]) <= cost(&[one, other])
    };
    let mut all: Vec<ParameterPatch> = Vec::new();
    for mut next in boxes {
        // A box that took in another may reach a third one.
        while let Some(near) = all.iter().position(|other| is_joined(*other, next)) {
            next = union(next, all.swap_remove(near));
        }
        all.push(next);
    }
    all
}

/// Returns whether the gap between two boxes is so small that they may become one.
pub(super) fn is_near(
    surface: &BSplineSurface,
    one: ParameterPatch,
    other: ParameterPatch,
    distances: Distances,
) -> bool {
    meets(grown(surface, one, distances.join_mm), other)
}

fn meets(a: ParameterPatch, b: ParameterPatch) -> bool {
    a.low.u < b.high.u && b.low.u < a.high.u && a.low.v < b.high.v && b.low.v < a.high.v
}

/// Cuts boxes at each other. Boxes of the same owner do not overlap.
///
/// # Errors
/// The two owners, the lower one first, if their boxes cannot be cut so that no part is too narrow for the disc.
pub(super) fn cut_apart(
    surface: &BSplineSurface,
    mut all: Vec<(usize, ParameterPatch)>,
    distances: Distances,
) -> Result<Vec<ParameterPatch>, [usize; 2]> {
    let overlap = |all: &[(usize, ParameterPatch)]| {
        let pairs = (0..all.len()).flat_map(|one| (one + 1..all.len()).map(move |other| [one, other]));
        pairs
            .filter(|[one, other]| all[*one].0 != all[*other].0)
            .find(|[one, other]| is_deep(surface, all[*one].1, all[*other].1, distances.reach_mm))
    };
    while let Some([one, other]) = overlap(&all) {
        let (owners, boxes) = ([all[one].0, all[other].0], [all[one].1, all[other].1]);
        let least_mm = distances.least_mm / 2.0;
        let Some((is_first_cut, parts)) = cut(surface, boxes, least_mm) else {
            return Err([owners[0].min(owners[1]), owners[0].max(owners[1])]);
        };
        let (cut, owner) = if is_first_cut { (one, owners[0]) } else { (other, owners[1]) };
        all.remove(cut);
        all.extend(parts.into_iter().map(|part| (owner, part)));
    }
    Ok(all.into_iter().map(|(_, patch)| patch).collect())
}

/// Returns whether two boxes overlap by more than this on both sides, mm.
fn is_deep(surface: &BSplineSurface, a: ParameterPatch, b: ParameterPatch, reach_mm: f64) -> bool {
    meets(a, b) && {
        let both = ParameterPatch {
            low: Parameter { u: a.low.u.max(b.low.u), v: a.low.v.max(b.low.v) },
            high: Parameter { u: a.high.u.min(b.high.u), v: a.high.v.min(b.high.v) },
        };
        least_side_mm(surface, both) > reach_mm
    }
}

fn least_side_mm(surface: &BSplineSurface, patch: ParameterPatch) -> f64 {
    let [scale_u, scale_v] = least_scale(surface, patch);
    (scale_u * (patch.high.u - patch.low.u)).min(scale_v * (patch.high.v - patch.low.v))
}

/// Returns whether the first of two boxes is cut at the second one, and its parts beside the second one; otherwise the
/// second one is cut. `None` if each way leaves a part with a side below this, mm.
fn cut(
    surface: &BSplineSurface,
    [first, second]: [ParameterPatch; 2],
    least_mm: f64,
) -> Option<(bool, Vec<ParameterPatch>)> {
    let ways = [(false, second, first), (true, first, second)]
        .into_iter()
        .flat_map(|(is_first, own, other)| [true, false].map(|by_rows| (is_first, beside(own, other, by_rows))));
    let least = |parts: &[ParameterPatch]| {
        parts.iter().map(|part| least_side_mm(surface, *part)).fold(f64::INFINITY, f64::min)
    };
    let best = ways.map(|way| (least(&way.1), way)).max_by(|a, b| a.0.total_cmp(&b.0));
    best.filter(|(side_mm, _)| *side_mm >= least_mm).map(|(_, way)| way)
}

/// Returns the parts of a box that lie beside another one: `by_rows` first those above and below over the whole width,
/// otherwise first those on the left and on the right over the whole height.
fn beside(own: ParameterPatch, other: ParameterPatch, by_rows: bool) -> Vec<ParameterPatch> {
    let within = |low: f64, high: f64, at: f64| at.max(low).min(high);
    let [u_low, u_high] = [other.low.u, other.high.u].map(|u| within(own.low.u, own.high.u, u));
    let [v_low, v_high] = [other.low.v, other.high.v].map(|v| within(own.low.v, own.high.v, v));
    let part = |[low_u, high_u]: [f64; 2], [low_v, high_v]: [f64; 2]| ParameterPatch {
        low: Parameter { u: low_u, v: low_v },
        high: Parameter { u: high_u, v: high_v },
    };
    let sides_u = if by_rows { [v_low, v_high] } else { [own.low.v, own.high.v] };
    let sides_v = if by_rows { [own.low.u, own.high.u] } else { [u_low, u_high] };
    let parts = [
        part([own.low.u, u_low], sides_u),
        part([u_high, own.high.u], sides_u),
        part(sides_v, [own.low.v, v_low]),
        part(sides_v, [v_high, own.high.v]),
    ];
    let is_there = |part: &ParameterPatch| part.high.u - part.low.u > NOTHING && part.high.v - part.low.v > NOTHING;
    parts.into_iter().filter(is_there).collect()
}
