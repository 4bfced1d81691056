//! The areas around breaks, so that only what broke is abraded.
//!
//! Each connected break of the taught picture becomes the smallest box of the surface, along the region's columns and
//! rows, that contains its outline and the margin around it. So every pattern can be laid over an area as over a grid,
//! and an area contains more than the break and never less. Areas that overlap or nearly touch become one if this costs
//! no more than both; otherwise one is cut at the other. An area ends at the region's border, and at the border of a grid
//! that must not be abraded again.
//!
//! Breaks that share failed grids are one group. If the areas of a group are not smaller than its grids, the grids are
//! treated as a whole. The group's grids are the failed ones, and those into which its breaks extend farther than the
//! disc reaches beyond the failed ones.
//!
//! A break across several grids is one area; these grids stay its address in the record. A failed grid whose breaks do
//! not account for its broken surface is treated as a whole: without evidence of the place nothing is left out.

use super::areas::areas as rectangles;
pub use super::boxes::Distances;
use super::boxes::{clipped, cost_mm2, cut_apart, grown, is_less, is_near, laid, least_scale, union};
use crate::surface::{BSplineSurface, Parameter, ParameterPatch, Treated};
use panelprep_base::geometry::{Mask, Pixel};
use panelprep_cell::panel::{GridId, Region};
use std::collections::BTreeSet;

/// An area extends into a grid by at least this, mm: the grid's samples are 1 mm apart, and a part of a grid needs some.
const LEAST_PART_MM: f64 = 2.0;

/// The broken places of a film, and the grids that are to be treated because of them.
#[derive(Debug, Clone, Copy)]
pub struct Breaks<'a> {
    /// Pixels of the taught picture that broke.
    pub broken: &'a Mask,
    /// Grids that failed and are to be treated.
    pub failed: &'a [GridId],
    /// Those of them of which the breaks are not known well enough: they are treated as a whole, as are those without
    /// any broken pixel.
    pub whole: &'a [GridId],
    /// Grids that must not be abraded again.
    pub spared: &'a [GridId],
    /// Whether neighbouring grids that are treated as a whole become one area.
    pub join_grids: bool,
}

/// Where areas are laid.
#[derive(Clone, Copy)]
struct On<'a> {
    surface: &'a BSplineSurface,
    region: &'a Region,
    distances: Distances,
    join_grids: bool,
}

/// Breaks that share failed grids.
#[derive(Debug, Clone, Default)]
struct Group {
    /// A box around each break, and each grid that must be treated as a whole.
    boxes: Vec<ParameterPatch>,
    /// The grids that would be treated instead.
    grids: BTreeSet<GridId>,
}

impl Group {
    fn and(mut self, other: Group) -> Group {
        self.boxes.extend(other.boxes);
        self.grids.extend(other.grids);
        self
    }

    /// Returns the areas of these breaks: boxes around them, or whole grids if they are not larger.
    fn areas(&self, on: On<'_>) -> Vec<ParameterPatch> {
        let boxes = laid(on.surface, self.boxes.clone(), on.distances);
        on.lesser(boxes, &self.grids)
    }
}

impl On<'_> {
    /// Returns these areas, or the grids if they are not larger.
    fn lesser(&self, areas: Vec<ParameterPatch>, grids: &BTreeSet<GridId>) -> Vec<ParameterPatch> {
        let grids: Vec<GridId> = grids.iter().copied().collect();
        let grids = rectangles(self.region, &grids, self.join_grids);
        let grids: Vec<ParameterPatch> = grids.into_iter().map(|area| area.patch).collect();
        if is_less(self.surface, &areas, &grids, self.distances.reach_mm) { areas } else { grids }
    }
}

/// Returns the areas around the breaks that lie in a failed grid or extend into it. Together they are not larger than
/// the grids that they replace.
pub fn around_breaks(
    surface: &BSplineSurface,
    region: &Region,
    breaks: &Breaks<'_>,
    distances: Distances,
) -> Treated {
    let on = On { surface, region, distances, join_grids: breaks.join_grids };
    let pieces = pieces(region, breaks);
    let in_pieces: BTreeSet<GridId> = pieces.iter().flatten().filter_map(|pixel| region.grid_at(*pixel)).collect();
    let is_whole = |id: &&GridId| breaks.whole.contains(id) || !in_pieces.contains(id);
    let whole = breaks.failed.iter().filter(is_whole).filter_map(|id| {
        Some(Group { boxes: vec![ParameterPatch::for_grid(region, *id)?], grids: BTreeSet::from([*id]) })
    });
    let of_piece = |pixels: &Vec<Pixel>| {
        let outline = corners(region, pixels);
        let wide = clipped(grown(surface, bounds(&outline), distances.margin_mm));
        let wide = at_least(surface, wide, distances.least_mm);
        let own = with_whole_parts(surface, region, wide);
        Group { boxes: vec![own], grids: replaced(on, pixels, breaks.failed) }
    };
    let groups = merged(whole.chain(pieces.iter().map(of_piece)).collect(), |one, other| {
        !one.grids.is_disjoint(&other.grids)
    });
    let areas = arranged(on, groups).into_iter().flat_map(|area| without(region, area, breaks.spared)).collect();
    let broken = pieces.iter().flatten().map(|pixel| parameter(region, *pixel)).collect();
    Treated::from_areas(region, areas, broken)
}

/// Returns the grids that would be treated instead of a box around this break.
fn replaced(on: On<'_>, pixels: &[Pixel], failed: &[GridId]) -> BTreeSet<GridId> {
    let region = on.region;
    let grids: BTreeSet<GridId> = pixels.iter().filter_map(|pixel| region.grid_at(*pixel)).collect();
    let (mut found, others): (BTreeSet<GridId>, BTreeSet<GridId>) =
        grids.into_iter().partition(|id| failed.contains(id));
    // Not beyond a grid's corner: the disc is round.
    let beside = |id: &GridId| {
        let own = ParameterPatch::for_grid(region, *id)?;
        let wide = grown(on.surface, own, on.distances.reach_mm);
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

/// Merges groups until no two of them belong together.
fn merged(groups: Vec<Group>, belong: impl Fn(&Group, &Group) -> bool) -> Vec<Group> {
    let mut all: Vec<Group> = Vec::new();
    for mut next in groups {
        // A group that took in another may belong to a third one.
        while let Some(near) = all.iter().position(|other| belong(other, &next)) {
            next = all.remove(near).and(next);
        }
        all.push(next);
    }
    all
}

/// Returns the areas of all groups. Groups are merged if this costs less, or if their areas cannot be cut at each other.
fn arranged(on: On<'_>, groups: Vec<Group>) -> Vec<ParameterPatch> {
    let cost = |areas: &[ParameterPatch]| cost_mm2(on.surface, areas, on.distances.reach_mm);
    let is_near = |one: &[ParameterPatch], other: &[ParameterPatch]| {
        one.iter().any(|one| other.iter().any(|other| is_near(on.surface, *one, *other, on.distances)))
    };
    let mut groups = merged(groups, |one, other| {
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
    // Neighbouring grids of different groups cost less together.
    on.lesser(areas, &groups.into_iter().flat_map(|group| group.grids).collect())
}

/// Returns the pixels of each break that concerns a failed grid; pixels of grids that are spared are left out.
fn pieces(region: &Region, breaks: &Breaks<'_>) -> Vec<Vec<Pixel>> {
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

/// Returns the corners of these pixels, each of which is a square of 1 px around its middle.
fn corners(region: &Region, pixels: &[Pixel]) -> Vec<Parameter> {
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

/// Returns a box with sides of at least this length, mm, inside of the region: it grows on both sides alike, or inwards
/// at the region's border.
fn at_least(surface: &BSplineSurface, patch: ParameterPatch, side_mm: f64) -> ParameterPatch {
    let [least_u, least_v] = least_scale(surface, patch).map(|mm| side_mm / mm);
    let side = |low: f64, high: f64, least: f64| {
        let by = ((least - (high - low)) / 2.0).max(0.0);
        let (low, high) = (low - by, high + by);
        // What lies beyond one border is added on the other side.
        let (beyond_low, beyond_high) = ((-low).max(0.0), (high - 1.0).max(0.0));
        ((low - beyond_high).max(0.0), (high + beyond_low).min(1.0))
    };
    let (low_u, high_u) = side(patch.low.u, patch.high.u, least_u);
    let (low_v, high_v) = side(patch.low.v, patch.high.v, least_v);
    ParameterPatch { low: Parameter { u: low_u, v: low_v }, high: Parameter { u: high_u, v: high_v } }
}

/// Returns a box that extends into each of its grids by at least [`LEAST_PART_MM`], and leaves at least this of it or
/// nothing: a box that is cut at it then also has no narrower part in a grid.
fn with_whole_parts(surface: &BSplineSurface, region: &Region, patch: ParameterPatch) -> ParameterPatch {
    let [least_u, least_v] = least_scale(surface, patch).map(|mm| LEAST_PART_MM / mm);
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

/// Returns the parts of a box in the grids that are not spared; the box itself if none of its grids is spared.
fn without(region: &Region, area: ParameterPatch, spared: &[GridId]) -> Vec<ParameterPatch> {
    let spared: BTreeSet<GridId> = spared.iter().copied().collect();
    let parts: Vec<(GridId, ParameterPatch)> =
        region.ids().filter_map(|id| Some((id, area.part_in(region, id)?))).collect();
    if parts.iter().all(|(id, _)| !spared.contains(id)) {
        return vec![area];
    }
    parts.into_iter().filter(|(id, _)| !spared.contains(id)).map(|(_, part)| part).collect()
}
