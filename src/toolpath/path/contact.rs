//! How a path approaches the panel, stays in contact and retracts.
//!
//! The tool moves through the air to a place beside the first contact place and down to the landing height. Then it
//! moves along the surface to the first contact place while it descends the last millimetres: the disc is already
//! moving when it touches. The retraction is the same in reverse. The landing runs over the area's own middle, so
//! nothing outside the area is touched. Over a hole the path continues at the landing height. In contact the tool's
//! point goes into the panel by the press-in, which the pad absorbs. In contact the feed makes the times under the
//! disc even; in the air it is the recipe's feed. The feed is lower if the controller could not plan such short lines
//! in time (`eki` 4.2). Corners are rounded by a fraction of the shorter adjacent line, and never by more than half of
//! that line. A path stops only at its ends, and on the panel if it comes straight down.

use super::orientation::{OrientationError, ToolOrientation, panel_from_tool};
use super::piece::Piece;
use super::planned::{ToolPath, Waypoint};
use super::raster::{intermediate_points, interpolate};
use crate::surface::{BSplineSurface, Parameter};
use panelprep_base::geometry::{Panel, Rigid, Tool};
use panelprep_cell::recipe;

/// A place of the tool on the path.
#[derive(Clone, Copy)]
struct Station {
    at: Parameter,
    height_mm: f64,
    contact: bool,
    /// The highest feed on the way to this point, mm/s.
    feed_mm_s: f64,
}

/// Returns the path over one area's lines, and its end. The feeds apply on the way to each place of its track. The
/// path begins above the end of the previous path.
pub(super) fn tool_path(
    surface: &BSplineSurface,
    (piece, feeds_mm_s): (&Piece, &[f64]),
    before: Option<Parameter>,
    settings: &recipe::Path,
) -> Result<(ToolPath, Option<Parameter>), OrientationError> {
    let grids = piece.area.grids.clone();
    let (Some(first), Some(last)) = (piece.track.first().copied(), piece.track.last().copied()) else {
        return Ok((ToolPath { grids, waypoints: Vec::new() }, before));
    };
    let (down, up) =
        (landing_point(surface, piece, first, settings), landing_point(surface, piece, last, settings));
    let lifted =
        |at: Parameter, height_mm: f64| Station { at, height_mm, contact: false, feed_mm_s: settings.feed_mm_s() };
    let air = |at: Parameter| lifted(at, settings.approach_mm());
    let low = |at: Parameter| lifted(at, settings.landing_height_mm());
    let on = |((at, contact), feed_mm_s): ((&Parameter, &bool), &f64)| match contact {
        true => Station { at: *at, height_mm: -settings.press_in_mm(), contact: true, feed_mm_s: *feed_mm_s },
        false => low(*at),
    };
    let mut stations: Vec<Station> = Vec::with_capacity(piece.track.len() + 8);
    let flown = before
        .into_iter()
        .flat_map(|from| intermediate_points(surface, from, down.unwrap_or(first), piece.spacing_mm));
    stations.extend(flown.map(air));
    // The first station is in air, since the interlocks start the tool there.
    stations.push(air(down.unwrap_or(first)));
    stations.extend(down.map(low));
    stations.extend(piece.track.iter().zip(&piece.contact).zip(feeds_mm_s).map(on));
    stations.extend(up.map(low));
    stations.push(air(up.unwrap_or(last)));
    Ok((ToolPath { grids, waypoints: waypoints(surface, &stations, settings)? }, Some(up.unwrap_or(last))))
}

/// Returns a place at the landing's length from an end of the track, towards the middle of the area; if the end lies
/// in the middle, towards the farthest corner. `None` if the recipe lands straight down.
fn landing_point(
    surface: &BSplineSurface,
    piece: &Piece,
    end: Parameter,
    settings: &recipe::Path,
) -> Option<Parameter> {
    let landing_mm = settings.landing_mm();
    let from = surface.point(end);
    let corners = [(0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    let places = corners.map(|(u, v)| piece.area.patch.parameter_at(Parameter { u, v }));
    let away = |at: &Parameter| surface.point(*at).distance_mm(from);
    let middle = places.first().filter(|middle| away(middle) >= landing_mm);
    let farthest = || places.iter().max_by(|a, b| away(a).total_cmp(&away(b)));
    let target = *middle.or_else(farthest)?;
    let share = (landing_mm / away(&target).max(1e-9)).min(1.0);
    (landing_mm > 0.0).then(|| interpolate(end, target, share))
}

fn waypoints(
    surface: &BSplineSurface,
    stations: &[Station],
    settings: &recipe::Path,
) -> Result<Vec<Waypoint>, OrientationError> {
    let stance = ToolOrientation::from_settings(settings);
    let pose = |station: &Station| panel_from_tool(surface, station.at, station.height_mm, stance);
    let poses = stations.iter().map(pose).collect::<Result<Vec<Rigid<Panel, Tool>>, _>>()?;
    let lengths_mm: Vec<f64> =
        poses.windows(2).map(|pair| pair[0].origin().distance_mm(pair[1].origin())).collect();
    let planning_s = settings.planning_time_ms() / 1_000.0;
    let waypoint = |(index, station): (usize, &Station)| {
        let before_mm = index.checked_sub(1).and_then(|before| lengths_mm.get(before)).copied();
        let after_mm = lengths_mm.get(index).copied();
        // The controller plans one line at a time: a line that is executed faster than that would stop the tool on the
        // panel.
        let feed_mm_s = before_mm.map_or(station.feed_mm_s, |mm| station.feed_mm_s.min(mm / planning_s));
        let touches_down = |other: Option<&Station>| other.is_some_and(|other| other.contact != station.contact);
        // Without a landing slope the corner at the panel is exact: rounded, the pad would touch before its place, with
        // a sideways motion.
        let straight_down = settings.landing_mm() == 0.0
            && station.contact
            && (touches_down(index.checked_sub(1).and_then(|n| stations.get(n)))
                || touches_down(stations.get(index + 1)));
        let blend_mm = match (before_mm, after_mm) {
            (Some(before), Some(after)) if !straight_down => settings.blend_share() * before.min(after),
            _ => 0.0,
        };
        Waypoint { panel_from_tool: poses[index], contact: station.contact, feed_mm_s, blend_mm }
    };
    Ok(stations.iter().enumerate().map(waypoint).collect())
}
