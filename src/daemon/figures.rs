//! The pictures of a cycle, drawn as it runs. They decide nothing: where one cannot be drawn, the bare picture stands.

use super::Job;
use super::ports::Figure;
use crate::geometry::{Base, Camera, ColorPicture, FlangeCamera, Panel, Point, Rigid};
use crate::imaging::ImagingError;
use crate::inspect::{Inspection, Step};
use crate::locate::{self, Fit, Prepared};
use crate::panel::Grid;
use crate::path::dwell::Dwell;
use crate::path::{Plan, ToolPath};
use crate::report::{
    CornerView, ReasonPicture, StripPicture, View, bounds, cut, dwell_map, film_strip, overlap_map,
    reason_pictures, strip_times_s, surface_map,
};
use crate::surface::DeviationMap;
use crate::verdict::Judgement;

/// The view of the 3D camera, with the panel where it stands.
pub(super) fn view<'a>(job: &'a Job<'_>, picture: &'a ColorPicture, place: Rigid<Base, Panel>) -> View<'a> {
    let camera_from_panel = job.calibrations.base_from_camera.inverse() * place;
    View { picture, camera: &job.calibrations.scanner, camera_from_panel }
}

/// A figure of what was drawn over `bare`.
pub(super) fn figure(
    (name, caption): (&str, &str),
    drawn: Result<ColorPicture, ImagingError>,
    bare: &ColorPicture,
) -> Figure {
    let (picture, caption) = match drawn {
        Ok(picture) => (picture, caption.to_owned()),
        Err(error) => (bare.clone(), format!("{caption}; nothing is drawn on it: {error}")),
    };
    Figure { name: name.to_owned(), caption, picture }
}

/// The scan with the taught outline and grids where the panel was found, or bare.
pub(super) fn located(job: &Job<'_>, scan: &ColorPicture, place: Option<Rigid<Base, Panel>>) -> Figure {
    match place {
        Some(place) => {
            let caption = "The scan's picture with the taught outline and grids at the place found";
            figure(("located", caption), view(job, scan, place).located(job.panel), scan)
        }
        None => figure(("located", "The scan's picture: no panel was found"), Ok(scan.clone()), scan),
    }
}

/// Where each reason of a localization's verdict shows in its scan.
pub(super) fn reasons(
    job: &Job<'_>,
    (prepared, seen, picture): (&Prepared<'_>, &locate::View<'_>, &ColorPicture),
    fit: Option<&Fit>,
    judgement: &Judgement,
) -> Vec<Figure> {
    if judgement.reasons.is_empty() {
        return Vec::new();
    }
    let drawn = reason_pictures(job.panel, (picture, seen), (&prepared.explain(fit), fit), judgement);
    let of = |it: ReasonPicture| figure((&format!("reason_{}", it.code), it.caption), it.picture, picture);
    drawn.into_iter().map(of).collect()
}

/// A corner as the flange camera saw it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    pub base_from_camera: Rigid<Base, FlangeCamera>,
    pub found_px: crate::geometry::Pixel,
    /// Where the corner was taught.
    pub corner: Point<Panel>,
}

/// The corner with where it was found and where a place puts it.
pub(super) fn corner(
    job: &Job<'_>,
    picture: &ColorPicture,
    (sighting, place): (Sighting, Rigid<Base, Panel>),
    (which, name, title): (usize, &str, &str),
) -> Option<Figure> {
    let camera = &job.calibrations.flange_camera;
    let in_camera = sighting.base_from_camera.inverse() * (place * sighting.corner);
    let view = CornerView {
        picture,
        expected_px: camera.project(in_camera)?,
        found_px: sighting.found_px,
        px_per_mm: camera.px_per_mm_at(in_camera.mm.z).0,
    };
    let caption =
        format!("The flange camera's picture of corner {which}, {title}: where it is expected and where it is");
    Some(figure((name, &caption), view.drawn(title), picture))
}

/// A picture in which a corner was looked for and not found.
pub(super) fn no_corner(which: usize, picture: &ColorPicture) -> Figure {
    let caption = format!("The flange camera's picture in which corner {which} was not found");
    figure(("no_corner", &caption), Ok(picture.clone()), picture)
}

/// The path over the panel as the last film showed it.
pub(super) fn planned(job: &Job<'_>, plan: &Plan, film: &ColorPicture, place: Rigid<Base, Panel>) -> Figure {
    let contact = |path: &ToolPath| -> Vec<Point<Panel>> {
        let on_panel = path.waypoints.iter().filter(|waypoint| waypoint.contact);
        on_panel.map(|waypoint| waypoint.panel_from_tool.origin()).collect()
    };
    let paths: Vec<_> = plan.paths.iter().map(contact).collect();
    let planned = |grid: &Grid| plan.paths.iter().any(|path| path.grids.contains(&grid.id));
    let drawn = view(job, film, place).planned(job.panel, &paths, &planned);
    figure(("planned", "The planned path of the tool over the panel"), drawn, film)
}

/// How the surface lies in the taught scan, pixel by pixel.
pub(super) fn surface(map: &DeviationMap) -> Figure {
    let caption = "The region's scan beside the fitted surface";
    figure(("surface", caption), surface_map(map), &ColorPicture::filled(1, 1, [245; 3]))
}

/// What the disc did, by the poses that the robot reported: how long, and how often.
pub(super) fn dwelt(job: &Job<'_>, dwell: &Dwell) -> [Figure; 2] {
    let region = &job.panel.region;
    let bare = ColorPicture::filled(1, 1, [225; 3]);
    let time = "How long each place was under the disc, by the poses that the robot reported";
    let often = "How often the disc passed each place, by the same poses";
    [
        figure(("executed", time), dwell_map(dwell, region), &bare),
        figure(("overlap", often), overlap_map(dwell, region), &bare),
    ]
}

/// Pictures of a film that a strip may show, cut to the region: evenly spread, and close together once it opens.
#[derive(Debug, Default)]
pub(super) struct Kept {
    bounds: Option<[(usize, usize); 2]>,
    opened_s: Option<f64>,
    cuts: Vec<(f64, ColorPicture)>,
}

impl Kept {
    /// Keeps the picture where the strip may want it.
    pub fn see(&mut self, job: &Job<'_>, place: Rigid<Base, Panel>, picture: &ColorPicture, step: &Step) {
        let Some(since_wet_s) = step.since_wet_s else { return };
        let opens = self.opened_s.is_none() && step.broken_mm2 > 0.0;
        if opens {
            self.opened_s = Some(since_wet_s);
        }
        let end_s = job.demands().observation_s;
        let wanted = strip_times_s(None, end_s).into_iter().chain(strip_times_s(self.opened_s, end_s));
        let last_s = self.cuts.last().map_or(f64::NEG_INFINITY, |(time_s, _)| *time_s);
        if !wanted.into_iter().any(|time_s| last_s < time_s - TICK_S && time_s - TICK_S <= since_wet_s) {
            return;
        }
        let bounds = *self.bounds.get_or_insert_with(|| region(job, place));
        let mask = crate::geometry::Mask::empty(picture.width, picture.height);
        self.cuts.push((since_wet_s, cut(picture, &mask, bounds).0));
    }

    /// The strip: each picture with what had broken by then.
    pub fn strip(&self, inspection: &Inspection, whole: &ColorPicture) -> Figure {
        let broke_s = inspection.breaks.iter().map(|found| found.first_seen_s).reduce(f64::min);
        let (end_s, bounds) = (inspection.observation.observed_s, self.bounds.unwrap_or_default());
        let pictures: Vec<StripPicture> = strip_times_s(broke_s, end_s)
            .into_iter()
            .map(|time_s| {
                let kept = self.cuts.iter().find(|(kept_s, _)| *kept_s >= time_s - TICK_S);
                // After the last that was kept there is the film's last picture.
                let shown_s = kept.map_or(end_s, |(kept_s, _)| *kept_s);
                let (last, broken) = cut(whole, &inspection.mask_at(shown_s), bounds);
                let picture = kept.map_or(last, |(_, picture)| picture.clone());
                StripPicture { picture, broken, label: format!("{shown_s:.1} s") }
            })
            .collect();
        let caption = "The film in time, seconds after the panel was wholly wet: broken film tinted yellow";
        figure(("film", caption), film_strip(&pictures), whole)
    }
}

/// Times this near are one, s.
const TICK_S: f64 = 1e-3;

/// The box around the region in the picture.
fn region(job: &Job<'_>, place: Rigid<Base, Panel>) -> [(usize, usize); 2] {
    let camera = &job.calibrations.scanner;
    let camera_from_panel: Rigid<Camera, Panel> = job.calibrations.base_from_camera.inverse() * place;
    let edges = job.panel.grids.iter().flat_map(|grid| &grid.edge);
    let pixels = edges.filter_map(|&point| camera.project(camera_from_panel * point));
    bounds(pixels, (camera.width_px, camera.height_px))
}

/// When everything broke.
pub(super) fn break_times(
    job: &Job<'_>,
    inspection: &Inspection,
    last: &ColorPicture,
    place: Rigid<Base, Panel>,
) -> Figure {
    let end_s = inspection.observation.observed_s;
    let time_s = |column: usize, row: usize| inspection.break_time_s(column, row);
    let drawn = view(job, last, place).break_times(job.panel, &time_s, end_s);
    figure(("break_times", "When the film broke, from the first fully wet picture on"), drawn, last)
}

/// Everything that broke, and the grids that failed.
pub(super) fn inspected(
    job: &Job<'_>,
    inspection: &Inspection,
    last: &ColorPicture,
    place: Rigid<Base, Panel>,
) -> Figure {
    let failed = |grid: &Grid| inspection.grids.iter().any(|found| found.id == grid.id && found.failed);
    let drawn = view(job, last, place).inspected(job.panel, &inspection.mask(), &failed);
    figure(("inspected", "Everything that broke by the end of the film, and the grids that failed"), drawn, last)
}
