//! Finds the areas around breaks, so that only these areas are sanded instead of whole grids.
//!
//! Each break is a connected component of pixels in the taught picture. Its area is the smallest box of the surface
//! along the region's columns and rows that contains the break's outline and a margin. Every pattern can be laid over a
//! box as over a grid. An area may contain more than the break, but never less. Areas that overlap or are close
//! together are merged if the merged area costs no more than the two areas; otherwise one area is cut at the border of
//! the other. An area ends at the region's border, and at the border of a grid that must not be sanded again.
//!
//! Breaks that share failed grids are one group. A group's grids are its failed grids, and those into which its breaks
//! extend farther than the disc reaches beyond the failed grids. If the areas of a group are not smaller than its
//! grids, the grids are treated completely.
//!
//! A break across several grids is one area; the record lists these grids for the area. A failed grid whose breaks do
//! not explain its broken area is treated completely: the position of the break is not known, so no part may be
//! omitted.
//!
//! The cost of a box is the surface over which the disc moves: the box with a margin of the disc's reach. Therefore one
//! box may cost less than two boxes, although it contains the surface between them; it costs more if the surface
//! without breaks predominates.

use super::areas::areas as rectangles;
use crate::surface::{BSplineSurface, Parameter, ParameterPatch, Treated};
use panelprep_base::geometry::{Mask, Pixel};
use panelprep_cell::panel::{GridId, Region};
use std::collections::BTreeSet;

/// Minimum length by which an area extends into a grid, mm. The grid's sample points are 1 mm apart, and a part of a
/// grid must contain some of them.
const MIN_PART_MM: f64 = 2.0;

/// Number of points along each side of a box at which the surface's scale is evaluated.
const SCALE_STEPS: usize = 4;
/// Minimum side of a part of a box, as a fraction of the region's sides; a narrower part is a rounding error.
const MIN_PART_SIDE: f64 = 1e-9;

/// The breaks of a film, and the grids that are treated because of the breaks.
#[derive(Debug, Clone, Copy)]
pub struct Breaks<'a> {
    /// Pixels of the taught picture at which the film broke.
    pub broken: &'a Mask,
    /// Grids that failed the water-break test and are treated.
    pub failed: &'a [GridId],
    /// The failed grids in which the positions of the breaks are not known well enough. These grids are treated
    /// completely, and so are failed grids without a broken pixel.
    pub whole: &'a [GridId],
    /// Grids that must not be sanded again.
    pub spared: &'a [GridId],
    /// Whether adjacent grids that are treated completely become one area.
    pub join_grids: bool,
}

/// The surface and the settings from which areas are computed.
#[derive(Clone, Copy)]
struct AreaSettings<'a> {
    surface: &'a BSplineSurface,
    region: &'a Region,
    distances: Distances,
    join_grids: bool,
}

/// Breaks that share failed grids.
#[derive(Debug, Clone, Default)]
struct Group {
    /// The box of each break, and each grid that must be treated completely.
    boxes: Vec<ParameterPatch>,
    /// The grids that would be treated instead of the boxes.
    grids: BTreeSet<GridId>,
}

impl Group {
    fn and(mut self, other: Group) -> Group {
        self.boxes.extend(other.boxes);
        self.grids.extend(other.grids);
        self
    }

    /// Returns the areas of the group's breaks: boxes around the breaks, or the group's whole grids if the boxes are
    /// not smaller.
    fn areas(&self, on: AreaSettings<'_>) -> Vec<ParameterPatch> {
        let boxes = arrange_boxes(on.surface, self.boxes.clone(), on.distances);
        on.cheaper_areas(boxes, &self.grids)
    }
}

impl AreaSettings<'_> {
    /// Returns `areas`, or the grids if the areas are not smaller and cheaper.
    fn cheaper_areas(&self, areas: Vec<ParameterPatch>, grids: &BTreeSet<GridId>) -> Vec<ParameterPatch> {
        let grids: Vec<GridId> = grids.iter().copied().collect();
        let grids = rectangles(self.region, &grids, self.join_grids);
        let grids: Vec<ParameterPatch> = grids.into_iter().map(|area| area.patch).collect();
        if is_less(self.surface, &areas, &grids, self.distances.reach_mm) { areas } else { grids }
    }
}

/// Returns the areas around the breaks that lie in a failed grid or extend into one. The total surface of these areas
/// is not larger than that of the grids that they replace.
pub fn around_breaks(
    surface: &BSplineSurface,
    region: &Region,
    breaks: &Breaks<'_>,
    distances: Distances,
) -> Treated {
    let on = AreaSettings { surface, region, distances, join_grids: breaks.join_grids };
    let pieces = find_breaks(region, breaks);
    let in_pieces: BTreeSet<GridId> = pieces.iter().flatten().filter_map(|pixel| region.grid_at(*pixel)).collect();
    let is_whole = |id: &&GridId| breaks.whole.contains(id) || !in_pieces.contains(id);
    let whole = breaks.failed.iter().filter(is_whole).filter_map(|id| {
        Some(Group { boxes: vec![ParameterPatch::for_grid(region, *id)?], grids: BTreeSet::from([*id]) })
    });
    let of_piece = |pixels: &Vec<Pixel>| {
        let outline = pixel_corners(region, pixels);
        let wide = clip_to_region(enlarge_box(surface, bounds(&outline), distances.margin_mm));
        let wide = enlarge_to_side(surface, wide, distances.least_mm);
        let own = extend_to_whole_parts(surface, region, wide);
        Group { boxes: vec![own], grids: replaced_grids(on, pixels, breaks.failed) }
    };
    let groups = merge_groups(whole.chain(pieces.iter().map(of_piece)).collect(), |one, other| {
        !one.grids.is_disjoint(&other.grids)
    });
    let areas = arrange_groups(on, groups)
        .into_iter()
        .flat_map(|area| parts_not_spared(region, area, breaks.spared))
        .collect();
    let broken = pieces.iter().flatten().map(|pixel| parameter(region, *pixel)).collect();
    Treated::from_areas(region, areas, broken)
}

/// Returns the grids that would be treated instead of a box around this break.
fn replaced_grids(on: AreaSettings<'_>, pixels: &[Pixel], failed: &[GridId]) -> BTreeSet<GridId> {
    let region = on.region;
    let grids: BTreeSet<GridId> = pixels.iter().filter_map(|pixel| region.grid_at(*pixel)).collect();
    let (mut found, others): (BTreeSet<GridId>, BTreeSet<GridId>) =
        grids.into_iter().partition(|id| failed.contains(id));
    // Only grids that share a side are neighbours: the disc is round and does not reach a diagonal neighbour.
    let beside = |id: &GridId| {
        let own = ParameterPatch::for_grid(region, *id)?;
        let wide = enlarge_box(on.surface, own, on.distances.reach_mm);
        let by = |u: ParameterPatch, v: ParameterPatch| ParameterPatch {
            low: Parameter { u: u.low.u, v: v.low.v },
            high: Parameter { u: u.high.u, v: v.high.v },
        };
        Some([by(wide, own), by(own, wide)])
    };
    let reached: Vec<ParameterPatch> = found.iter().filter_map(beside).flatten().collect();
    let is_beyond = |pixel: &Pixel| !reached.iter().any(|patch| patch.holds(parameter(region, *pixel)));
    let beyond: BTreeSet<GridId> =
        pixels.iter().filter(|pixel| is_beyond(pixel)).filter_map(|pixel| region.grid_at(*pixel)).collect();
    found.extend(others.intersection(&beyond));
    found
}

/// Merges groups until `belong` is false for every pair of groups.
fn merge_groups(groups: Vec<Group>, belong: impl Fn(&Group, &Group) -> bool) -> Vec<Group> {
    let mut all: Vec<Group> = Vec::new();
    for mut next in groups {
        // The merged group is compared with all other groups again.
        while let Some(near) = all.iter().position(|other| belong(other, &next)) {
            next = all.remove(near).and(next);
        }
        all.push(next);
    }
    all
}

/// Returns the areas of all groups. Two groups are merged if this costs less, or if their areas cannot be cut at each
/// other.
fn arrange_groups(on: AreaSettings<'_>, groups: Vec<Group>) -> Vec<ParameterPatch> {
    let cost = |areas: &[ParameterPatch]| cost_mm2(on.surface, areas, on.distances.reach_mm);
    let is_near = |one: &[ParameterPatch], other: &[ParameterPatch]| {
        one.iter().any(|one| other.iter().any(|other| is_near(on.surface, *one, *other, on.distances)))
    };
    let mut groups = merge_groups(groups, |one, other| {
        let [areas, others] = [one, other].map(|group| group.areas(on));
        let both = || one.clone().and(other.clone()).areas(on);
        is_near(&areas, &others) && cost(&both()) < cost(&areas) + cost(&others)
    });
    let areas = loop {
        let of_group = |(owner, group): (usize, &Group)| group.areas(on).into_iter().map(move |area| (owner, area));
        match cut_apart(on.surface, groups.iter().enumerate().flat_map(of_group).collect(), on.distances) {
            Ok(areas) => break areas,
            Err([one, other]) => {
                let last = groups.remove(other);
                groups[one] = std::mem::take(&mut groups[one]).and(last);
            }
        }
    };
    // Adjacent grids of different groups may cost less if they are treated together.
    on.cheaper_areas(areas, &groups.into_iter().flat_map(|group| group.grids).collect())
}

/// Returns the pixels of each break that concerns a failed grid, without the pixels of grids that are spared.
fn find_breaks(region: &Region, breaks: &Breaks<'_>) -> Vec<Vec<Pixel>> {
    let pixel =
        |index: usize| Pixel::at((index % breaks.broken.width) as f64, (index / breaks.broken.width) as f64);
    let of_grids = |piece: Vec<usize>| -> Vec<(GridId, Pixel)> {
        let located = piece.into_iter().filter_map(|index| Some((region.grid_at(pixel(index))?, pixel(index))));
        located.filter(|(grid, _)| !breaks.spared.contains(grid)).collect()
    };
    let all = breaks.broken.connected_components().into_iter().map(of_grids);
    let concerned = all.filter(|piece| piece.iter().any(|(grid, _)| breaks.failed.contains(grid)));
    concerned.map(|piece| piece.into_iter().map(|(_, pixel)| pixel).collect()).collect()
}

fn parameter(region: &Region, pixel: Pixel) -> Parameter {
    let unit = region.unit(pixel);
    Parameter { u: unit.x, v: unit.y }
}

/// Returns the corners of these pixels. A pixel is a square with sides of 1 px around its centre.
fn pixel_corners(region: &Region, pixels: &[Pixel]) -> Vec<Parameter> {
    let around = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
    let of_pixel = |pixel: &Pixel| around.map(|(u, v)| parameter(region, Pixel::at(pixel.u + u, pixel.v + v)));
    pixels.iter().flat_map(of_pixel).collect()
}

fn bounds(places: &[Parameter]) -> ParameterPatch {
    let (low, high) = (Parameter { u: 1.0, v: 1.0 }, Parameter { u: 0.0, v: 0.0 });
    places
        .iter()
        .fold(ParameterPatch { low, high }, |patch, at| union(patch, ParameterPatch { low: *at, high: *at }))
}

/// Enlarges a box inside of the region so that its sides have at least this length, mm. The box grows equally on both
/// sides; at the region's border it grows only inwards.
fn enlarge_to_side(surface: &BSplineSurface, patch: ParameterPatch, side_mm: f64) -> ParameterPatch {
    let [least_u, least_v] = least_scale(surface, patch).map(|mm| side_mm / mm);
    let side = |low: f64, high: f64, least: f64| {
        let by = ((least - (high - low)) / 2.0).max(0.0);
        let (low, high) = (low - by, high + by);
        // The length that would extend beyond one border is added on the opposite side.
        let (beyond_low, beyond_high) = ((-low).max(0.0), (high - 1.0).max(0.0));
        ((low - beyond_high).max(0.0), (high + beyond_low).min(1.0))
    };
    let (low_u, high_u) = side(patch.low.u, patch.high.u, least_u);
    let (low_v, high_v) = side(patch.low.v, patch.high.v, least_v);
    ParameterPatch { low: Parameter { u: low_u, v: low_v }, high: Parameter { u: high_u, v: high_v } }
}

/// Enlarges a box so that it extends into each of its grids by at least [`MIN_PART_MM`], and leaves either at least
/// this length of a grid or nothing. If the box is cut at its border later, the parts in the grids are then not
/// narrower either.
fn extend_to_whole_parts(surface: &BSplineSurface, region: &Region, patch: ParameterPatch) -> ParameterPatch {
    let [least_u, least_v] = least_scale(surface, patch).map(|mm| MIN_PART_MM / mm);
    let low = |at: f64, count: usize, least: f64| {
        let [before, after] = [(at * count as f64).floor(), (at * count as f64).ceil()].map(|n| n / count as f64);
        match (at - before < least, after - at < least) {
            (true, _) => before,
            (_, true) => (after - least).max(0.0),
            _ => at,
        }
    };
    let high = |at: f64, count: usize, least: f64| {
        let [before, after] = [(at * count as f64).floor(), (at * count as f64).ceil()].map(|n| n / count as f64);
        match (after - at < least, at - before < least) {
            (true, _) => after,
            (_, true) => (before + least).min(1.0),
            _ => at,
        }
    };
    ParameterPatch {
        low: Parameter { u: low(patch.low.u, region.columns, least_u), v: low(patch.low.v, region.rows, least_v) },
        high: Parameter {
            u: high(patch.high.u, region.columns, least_u),
            v: high(patch.high.v, region.rows, least_v),
        },
    }
}

/// Returns the parts of an area in the grids that are not spared; the whole area if none of its grids is spared.
fn parts_not_spared(region: &Region, area: ParameterPatch, spared: &[GridId]) -> Vec<ParameterPatch> {
    let spared: BTreeSet<GridId> = spared.iter().copied().collect();
    let parts: Vec<(GridId, ParameterPatch)> =
        region.ids().filter_map(|id| Some((id, area.part_in(region, id)?))).collect();
    if parts.iter().all(|(id, _)| !spared.contains(id)) {
        return vec![area];
    }
    parts.into_iter().filter(|(id, _)| !spared.contains(id)).map(|(_, part)| part).collect()
}

/// The distances from which boxes are computed, measured on the surface, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distances {
    /// Margin that is added around a break.
    pub margin_mm: f64,
    /// Maximum gap between areas that may be merged.
    pub join_mm: f64,
    /// Minimum side of an area: in a smaller area the dwell time would not be uniform because of the ends of the
    /// pattern.
    pub least_mm: f64,
    /// Distance by which the disc always reaches beyond an area.
    pub reach_mm: f64,
}

fn union(a: ParameterPatch, b: ParameterPatch) -> ParameterPatch {
    ParameterPatch {
        low: Parameter { u: a.low.u.min(b.low.u), v: a.low.v.min(b.low.v) },
        high: Parameter { u: a.high.u.max(b.high.u), v: a.high.v.max(b.high.v) },
    }
}

fn clip_to_region(patch: ParameterPatch) -> ParameterPatch {
    let inside = |at: Parameter| Parameter { u: at.u.clamp(0.0, 1.0), v: at.v.clamp(0.0, 1.0) };
    ParameterPatch { low: inside(patch.low), high: inside(patch.high) }
}

/// Returns a box, enlarged on each side by at least this length on the surface, mm.
fn enlarge_box(surface: &BSplineSurface, patch: ParameterPatch, by_mm: f64) -> ParameterPatch {
    let by = |scale: [f64; 2]| {
        let [by_u, by_v] = scale.map(|mm| by_mm / mm);
        ParameterPatch {
            low: Parameter { u: patch.low.u - by_u, v: patch.low.v - by_v },
            high: Parameter { u: patch.high.u + by_u, v: patch.high.v + by_v },
        }
    };
    // The scale is evaluated again over the larger box, because the surface beside a break may be smaller per unit of
    // the parameters.
    by(least_scale(surface, clip_to_region(by(least_scale(surface, patch)))))
}

/// Returns the minimum length on the surface per unit of u, perpendicular to the lines of constant u, and the same for
/// v, mm.
fn least_scale(surface: &BSplineSurface, patch: ParameterPatch) -> [f64; 2] {
    let share = |index: usize| index as f64 / SCALE_STEPS as f64;
    let count = SCALE_STEPS + 1;
    let at = |place: usize| patch.parameter_at(Parameter { u: share(place % count), v: share(place / count) });
    (0..count * count).map(at).fold([f64::INFINITY; 2], |[least_u, least_v], at| {
        let tangents = surface.tangents(at);
        // The length is measured perpendicular to the line, because with slanted parameter lines a step along u is not
        // perpendicular to the line of constant u.
        let [across_u, across_v] =
            [&tangents.s_v, &tangents.s_u].map(|along| tangents.area_mm2() / along.mm.norm());
        [least_u.min(across_u), least_v.min(across_v)]
    })
}

/// Returns whether `boxes` have a smaller area than `others` and also cost less.
fn is_less(surface: &BSplineSurface, boxes: &[ParameterPatch], others: &[ParameterPatch], reach_mm: f64) -> bool {
    let sum = |all: &[ParameterPatch]| all.iter().map(|patch| area_mm2(surface, *patch)).sum::<f64>();
    sum(boxes) < sum(others) && cost_mm2(surface, boxes, reach_mm) < cost_mm2(surface, others, reach_mm)
}

/// Returns the cost of boxes, mm²: the surface of each box with a margin of the disc's reach, inside of the region.
fn cost_mm2(surface: &BSplineSurface, boxes: &[ParameterPatch], reach_mm: f64) -> f64 {
    boxes.iter().map(|patch| area_mm2(surface, clip_to_region(enlarge_box(surface, *patch, reach_mm)))).sum()
}

fn area_mm2(surface: &BSplineSurface, patch: ParameterPatch) -> f64 {
    let share = |index: usize| (index as f64 + 0.5) / SCALE_STEPS as f64;
    let count = SCALE_STEPS * SCALE_STEPS;
    let at = |place: usize| Parameter { u: share(place % SCALE_STEPS), v: share(place / SCALE_STEPS) };
    let per_unit: f64 = (0..count).map(|place| surface.tangents(patch.parameter_at(at(place))).area_mm2()).sum();
    per_unit / count as f64 * (patch.high.u - patch.low.u) * (patch.high.v - patch.low.v)
}

/// Merges boxes and cuts them at each other, so that they overlap by at most the disc's reach. Together they contain
/// all original boxes.
pub(super) fn arrange_boxes(
    surface: &BSplineSurface,
    mut boxes: Vec<ParameterPatch>,
    distances: Distances,
) -> Vec<ParameterPatch> {
    loop {
        boxes = merge_near_boxes(surface, boxes, distances);
        match cut_apart(surface, boxes.iter().copied().enumerate().collect(), distances) {
            Ok(parts) => return parts,
            Err([one, other]) => {
                boxes[one] = union(boxes[one], boxes[other]);
                boxes.remove(other);
            }
        }
    }
}

/// Merges boxes that overlap or are close together if the merged box costs no more than the two boxes.
fn merge_near_boxes(
    surface: &BSplineSurface,
    boxes: Vec<ParameterPatch>,
    distances: Distances,
) -> Vec<ParameterPatch> {
    let cost = |boxes: &[ParameterPatch]| cost_mm2(surface, boxes, distances.reach_mm);
    let is_joined = |one: ParameterPatch, other: ParameterPatch| {
        is_near(surface, one, other, distances) && cost(&[union(one, other)]) <= cost(&[one, other])
    };
    let mut all: Vec<ParameterPatch> = Vec::new();
    for mut next in boxes {
        // The merged box is compared with all other boxes again.
        while let Some(near) = all.iter().position(|other| is_joined(*other, next)) {
            next = union(next, all.swap_remove(near));
        }
        all.push(next);
    }
    all
}

/// Returns whether the gap between two boxes is small enough for a merge.
fn is_near(surface: &BSplineSurface, one: ParameterPatch, other: ParameterPatch, distances: Distances) -> bool {
    do_boxes_meet(enlarge_box(surface, one, distances.join_mm), other)
}

fn do_boxes_meet(a: ParameterPatch, b: ParameterPatch) -> bool {
    a.low.u < b.high.u && b.low.u < a.high.u && a.low.v < b.high.v && b.low.v < a.high.v
}

/// Cuts boxes of different owners at each other. Boxes of one owner do not overlap.
///
/// # Errors
/// Returns the two owners, the lower one first, if a cut would leave a part that is too narrow for the disc.
fn cut_apart(
    surface: &BSplineSurface,
    mut all: Vec<(usize, ParameterPatch)>,
    distances: Distances,
) -> Result<Vec<ParameterPatch>, [usize; 2]> {
    let overlap = |all: &[(usize, ParameterPatch)]| {
        let pairs = (0..all.len()).flat_map(|one| (one + 1..all.len()).map(move |other| [one, other]));
        pairs
            .filter(|[one, other]| all[*one].0 != all[*other].0)
            .find(|[one, other]| overlaps_beyond_reach(surface, all[*one].1, all[*other].1, distances.reach_mm))
    };
    while let Some([one, other]) = overlap(&all) {
        let (owners, boxes) = ([all[one].0, all[other].0], [all[one].1, all[other].1]);
        let least_mm = distances.least_mm / 2.0;
        let Some((is_first_cut, parts)) = cut_one_box(surface, boxes, least_mm) else {
            return Err([owners[0].min(owners[1]), owners[0].max(owners[1])]);
        };
        let (cut, owner) = if is_first_cut { (one, owners[0]) } else { (other, owners[1]) };
        all.remove(cut);
        all.extend(parts.into_iter().map(|part| (owner, part)));
    }
    Ok(all.into_iter().map(|(_, patch)| patch).collect())
}

/// Returns whether two boxes overlap by more than this distance on both sides, mm.
fn overlaps_beyond_reach(surface: &BSplineSurface, a: ParameterPatch, b: ParameterPatch, reach_mm: f64) -> bool {
    do_boxes_meet(a, b) && {
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

/// Decides which of two overlapping boxes is cut: true for the first, false for the second. Also returns the parts of
/// the cut box beside the other box. `None` if each cut leaves a part with a side below this length, mm.
fn cut_one_box(
    surface: &BSplineSurface,
    [first, second]: [ParameterPatch; 2],
    least_mm: f64,
) -> Option<(bool, Vec<ParameterPatch>)> {
    let ways = [(false, second, first), (true, first, second)].into_iter().flat_map(|(is_first, own, other)| {
        [true, false].map(|by_rows| (is_first, parts_beside(own, other, by_rows)))
    });
    let least = |parts: &[ParameterPatch]| {
        parts.iter().map(|part| least_side_mm(surface, *part)).fold(f64::INFINITY, f64::min)
    };
    let best = ways.map(|way| (least(&way.1), way)).max_by(|a, b| a.0.total_cmp(&b.0));
    best.filter(|(side_mm, _)| *side_mm >= least_mm).map(|(_, way)| way)
}

/// Returns the parts of a box beside another box. With `by_rows`, the parts above and below have the full width;
/// otherwise the parts on the left and on the right have the full height.
fn parts_beside(own: ParameterPatch, other: ParameterPatch, by_rows: bool) -> Vec<ParameterPatch> {
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
    let is_there = |part: &ParameterPatch| {
        part.high.u - part.low.u > MIN_PART_SIDE && part.high.v - part.low.v > MIN_PART_SIDE
    };
    parts.into_iter().filter(is_there).collect()
}
