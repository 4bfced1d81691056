//! What the stages found, as the record keeps it: each number with its unit and the limit that it was held to.

use super::Job;
use super::trace::Walked;
use crate::geometry::KukaPose;
use crate::inspect::{GridInspection, Inspection, MAX_OFF_PX};
use crate::locate::refine::{self, CornerReport, Refined};
use crate::locate::{self, gate};
use crate::panel::GridId;
use crate::path::dwell::Dwell;
use crate::path::panel_reach::{GridReach, Reached};
use crate::path::{MIN_COVERAGE, Plan, disc::DiscUse};
use crate::record::{Finding, Kind, Limit, Number, name};
use crate::surface::Deviation;
use crate::verdict::{Judgement, Reason};
use crate::words::apart;
use serde_json::json;

/// A result that is rejected for this reason, without numbers.
pub(super) fn rejected(kind: Kind, pass: u8, reason: Reason) -> Finding {
    Finding::new(kind, pass, Judgement::of(vec![reason], vec![]))
}

/// Where the 3D scan puts the panel; the gate's word came `elapsed_ms` after the scan.
pub(super) fn located(fit: Option<&locate::Fit>, judgement: Judgement, elapsed_ms: f64, job: &Job<'_>) -> Finding {
    let elapsed = Number::new(name::SCAN_TO_VERDICT, "ms", elapsed_ms);
    let finding = Finding::new(Kind::Locate, 0, judgement);
    let Some(fit) = fit else { return finding.with([elapsed]) };
    let limits = job.recipe.locate();
    let uncertainty_mm = fit.camera.map(|camera| camera.uncertainty_mm);
    let noticed_mm = uncertainty_mm.map(gate::noticed_mm);
    // Held to it where a fixture shows it, here or at teaching.
    let is_shown = gate::is_watched(uncertainty_mm) || gate::is_watched(fit.camera_at_teaching_mm);
    let noticed_limit = if is_shown { Limit::AtMost(gate::MAX_CAMERA_NOTICED_MM) } else { Limit::Unlimited };
    let at_most = |name: &str, unit: &str, value: f64, limit: f64| {
        Number::new(name, unit, value).within(Limit::AtMost(limit))
    };
    let at_least =
        |name: &str, value: Option<f64>, limit: f64| Number::new(name, "", value).within(Limit::AtLeast(limit));
    finding.detail("base_from_panel", json!(KukaPose::from_rigid(&fit.base_from_panel))).with([
        at_most("residual, point to plane, rms", "mm", fit.rms_mm, limits.max_rms_mm()),
        at_most("residual of the outline, rms", "px", fit.outline_rms_px, gate::MAX_OUTLINE_RMS_PX),
        at_least("overlap", Some(fit.overlap()), limits.min_overlap()),
        at_least("outline found", Some(fit.outline_found), gate::min_outline_found(limits)),
        at_most("last step of the fit", "mm", fit.last_step_mm, gate::MAX_LAST_STEP_MM),
        at_most("shift of the panel's centre", "mm", fit.shift_mm, limits.max_shift_mm()),
        at_most("turn in the panel's plane, either way", "°", fit.turn.0.abs(), limits.turn_limit_deg()),
        at_most("tilt of the panel's normal", "°", fit.tilt.0, limits.max_tilt_deg()),
        at_most("taught surface that is seen through", "", fit.seen_through, gate::MAX_SEEN_THROUGH),
        at_most("outline in view that is elsewhere", "", fit.outline_absent, gate::MAX_OUTLINE_ABSENT),
        at_least("panel in view that gave points", Some(fit.measured), gate::MIN_MEASURED),
        Number::new("edge wider than at teaching", "px", fit.blur_px()).within(Limit::AtMost(gate::MAX_BLUR_PX)),
        at_most("panel that is overexposed", "", fit.saturated, gate::MAX_SATURATED),
        at_most("fits from independent starts, apart", "mm", fit.agreement_mm, gate::MAX_DISAGREEMENT_MM),
        at_least(
            "for this placement against the next best, times",
            fit.rival.map(|rival| rival.margin()),
            gate::MIN_MARGIN,
        ),
        at_least(
            "fixture that stands where it stood",
            fit.camera.map(|camera| camera.same),
            gate::MIN_FIXTURE_SAME,
        ),
        Number::new(
            "camera has moved the panel since teaching, by the fixture",
            "mm",
            fit.camera.map(|it| it.moved_mm),
        ),
        Number::new("error of that, 95 %", "mm", uncertainty_mm),
        Number::new("motion less its error", "mm", fit.camera_moved_mm())
            .within(Limit::AtMost(gate::MAX_CAMERA_MOVED_MM)),
        Number::new("a camera is noticed that moves it by", "mm", noticed_mm).within(noticed_limit),
        at_most("error at the worst place, 95 %", "mm", fit.uncertainty_mm, gate::MAX_UNCERTAINTY_MM),
        Number::new("error along the weakest direction, 95 %", "mm", fit.weakest_mm),
        elapsed,
    ])
}

/// What the corner pictures after `moves` ask for; `step_mm` is how far a corner stands from where it was looked for, and
/// the last picture must say that it is near.
pub(super) fn refined(
    whole: &Refined,
    judgement: Judgement,
    (moves, step_mm, is_last): (u8, f64, bool),
    left_out: &[String],
    job: &Job<'_>,
) -> Finding {
    let limits = job.recipe.corner();
    let [x_mm, y_mm] = whole.shift_mm;
    let first = whole.corners.first().map_or(String::new(), |corner| format!("corner {}", corner.corner + 1));
    let step = Number::new("corner from where it was looked for", "mm", step_mm);
    // One that asks for more leads to a move and another picture.
    let step = if is_last { step.within(Limit::AtMost(limits.settled_mm())) } else { step };
    let several = whole.corners.len() > 1;
    let corner = |corner: &CornerReport| {
        let [asked, in_picture, left] = of_corner(
            corner,
            ["from where the scan puts it", "from there in the picture", "off after the correction"],
        );
        let left_mm = several.then_some(corner.left_mm);
        [
            Number::new(asked, "mm", corner.asked_mm()).within(Limit::AtMost(limits.max_correction_mm())),
            Number::new(in_picture, "px", corner.error_px),
            Number::new(left, "mm", left_mm).within(Limit::AtMost(refine::MAX_LEFT_MM)),
        ]
    };
    let finding = Finding::new(Kind::Refine, 0, judgement)
        .detail("base_from_panel", json!(KukaPose::from_rigid(&whole.base_from_panel)))
        .with(in_order(whole).into_iter().flat_map(corner))
        .with([
            Number::new(format!("correction along the camera's x at {first}"), "mm", x_mm),
            Number::new(format!("correction along the camera's y at {first}"), "mm", y_mm),
            Number::new("turned by two corners", "°", several.then_some(whole.turned.0)),
            step,
            Number::new(name::MOVES, "", f64::from(moves)).within(Limit::AtMost(limits.max_moves() as f64)),
            Number::new(name::CORNERS, "", whole.corners.len() as f64),
        ]);
    if left_out.is_empty() { finding } else { finding.detail("corners_left_out", json!(left_out)) }
}

/// How far the corners stand from where the localization puts them, just before contact; the last view must have seen so many.
pub(super) fn verified(
    seen: &Refined,
    judgement: Judgement,
    (pass, needed): (u8, Option<usize>),
    job: &Job<'_>,
) -> Finding {
    let verify_mm = job.recipe.corner().verify_mm();
    let corner = |corner: &CornerReport| {
        let [off, x, y] = of_corner(
            corner,
            ["from where the localization puts it", "along the camera's x", "along the camera's y"],
        );
        let [x_mm, y_mm] = corner.shift_mm;
        [
            Number::new(off, "mm", corner.asked_mm()).within(Limit::AtMost(verify_mm)),
            Number::new(x, "mm", x_mm),
            Number::new(y, "mm", y_mm),
        ]
    };
    let finding = Finding::new(Kind::Verify, pass, judgement).with(in_order(seen).into_iter().flat_map(corner));
    let limit = needed.map_or(Limit::Unlimited, |needed| Limit::AtLeast(needed as f64));
    finding.with([Number::new(name::CORNERS, "", seen.corners.len() as f64).within(limit)])
}

/// The corners in the order of teaching.
fn in_order(seen: &Refined) -> Vec<&CornerReport> {
    let mut corners: Vec<&CornerReport> = seen.corners.iter().collect();
    corners.sort_by_key(|corner| corner.corner);
    corners
}

fn of_corner<const N: usize>(corner: &CornerReport, words: [&str; N]) -> [String; N] {
    words.map(|words| format!("corner {} {words}", corner.corner + 1))
}

/// What was counted beside a film.
#[derive(Debug, Clone, Copy)]
pub(super) struct Counted {
    /// From a decoded picture to its result, median.
    pub ms_per_picture: Option<f64>,
    /// Pictures that the camera took and nobody took over in time, where it tells.
    pub dropped: Option<u64>,
}

/// What a film said.
pub(super) fn filmed(inspection: &Inspection, pass: u8, counted: Counted, job: &Job<'_>) -> Finding {
    let (demands, observation) = (job.demands(), &inspection.observation);
    let least = |name: &str, unit: &str, value: f64, limit: f64| {
        Number::new(name, unit, value).within(Limit::AtLeast(limit))
    };
    let (quality, settings) = (&observation.quality, job.recipe.inspect());
    let at_most = |name: &str, unit: &str, value: f64, limit: f64| {
        Number::new(name, unit, value).within(Limit::AtMost(limit))
    };
    let (usable, [darker, brighter]) =
        (demands.min_usable(observation.frames), observation.light_limits_percent(settings));
    let percent = |share: f64| Some(100.0 * (share - 1.0)).filter(|percent| percent.is_finite());
    let closed = inspection.breaks.iter().filter(|found| found.closed_again()).count();
    let numbers = [
        least(name::WATCHED, "s", observation.observed_s, demands.min_observed_s()),
        least("wet pictures", "", observation.frames as f64, demands.min_frames()),
        Number::new("longest time between two of them", "s", observation.longest_gap_s)
            .within(Limit::AtMost(demands.max_gap_s())),
        Number::new("pictures that were dropped", "", counted.dropped.map(|count| count as f64)),
        Number::new("pictures that could be judged by", "", quality.usable as f64).within(Limit::AtLeast(usable)),
        Number::new("longest time without one", "s", quality.longest_unseen_s)
            .within(Limit::AtMost(demands.max_gap_s())),
        at_most(
            "region that was wet in no picture",
            "%",
            observation.never_wet_percent,
            settings.max_never_wet_percent(),
        ),
        Number::new("change of the light, least", "%", percent(quality.light[0])).within(Limit::AtLeast(-darker)),
        Number::new("change of the light, most", "%", percent(quality.light[1])).within(Limit::AtMost(brighter)),
        Number::new("panel moved in the picture", "px", quality.moved_px),
        Number::new("least sharpness against the dry picture", "", quality.sharpness),
        Number::new("the film leaves of the dry brightness", "", observation.film_left),
        at_most(
            "smallest break that is surely found",
            "mm²",
            observation.detection_limit_mm2,
            observation.min_break_mm2,
        ),
        Number::new("outline from where the panel was found, in the dry picture", "px", quality.off_px)
            .within(Limit::AtMost(MAX_OFF_PX)),
        Number::new("places where the film broke", "", inspection.breaks.len() as f64),
        Number::new("of these, closed again", "", closed as f64),
        Number::new(name::PER_PICTURE, "ms", counted.ms_per_picture),
    ];
    let failed: Vec<GridId> = inspection.grids.iter().filter(|grid| grid.failed).map(|grid| grid.id).collect();
    let process = job.recipe.process();
    let temperature = process.water_temperature_c().map(|celsius| format!("{celsius} °C"));
    let water: Vec<String> = process.water().into_iter().chain(temperature).collect();
    let mut finding = Finding::new(Kind::Inspect, pass, inspection.judgement.clone());
    if !water.is_empty() {
        finding = finding.detail(name::WATER, water.join(", "));
    }
    if let Some(lamp) = process.lamp() {
        finding = finding.detail(name::LAMP, lamp);
    }
    finding
        .detail("failed", names(&failed))
        .with(numbers)
        .with(inspection.grids.iter().flat_map(|grid| broken(grid, observation.min_break_mm2)))
}

fn broken(grid: &GridInspection, min_break_mm2: f64) -> impl Iterator<Item = Number> + use<> {
    let id = grid.id;
    let area = grid.seen.then_some(grid.broken_mm2);
    let area = Number::new(format!("broken film in {id}"), "mm²", area).within(Limit::Below(min_break_mm2));
    let when = grid.time_to_break_s;
    std::iter::once(area).chain(when.map(|time_s| Number::new(format!("{id} failed after"), "s", time_s)))
}

/// The surface of the region, and what of it the arm reaches, grid by grid.
pub(super) fn surveyed(
    deviation: &Deviation,
    grids: &[GridReach],
    (pass, judgement): (u8, Judgement),
    job: &Job<'_>,
) -> Finding {
    let reached = grids.iter().filter_map(|grid| grid.outcome.as_ref().ok());
    let missed: Vec<GridId> = grids.iter().filter(|grid| grid.outcome.is_err()).map(|grid| grid.id).collect();
    let least_deg = reached.clone().copied().reduce(f64::min);
    let all = job.panel.region.ids().count() as f64;
    let finding = Finding::new(Kind::Reach, pass, judgement).with(surface(deviation, job)).with([
        Number::new("grids within the arm's reach", "", reached.count() as f64).within(Limit::AtLeast(all)),
        Number::new("room beyond the arm's margins, at least", "°", least_deg),
    ]);
    if missed.is_empty() { finding } else { finding.detail("out_of_reach", names(&missed)) }
}

/// How the surface lies in the scan.
fn surface(deviation: &Deviation, job: &Job<'_>) -> [Number; 5] {
    let limits = job.recipe.surface();
    let at_most = |name: &str, unit: &str, value: f64, limit: f64| {
        Number::new(name, unit, value).within(Limit::AtMost(limit))
    };
    [
        at_most("residual of the surface, rms", "mm", deviation.rms_mm, limits.max_rms_mm()),
        Number::new("residual of the surface, 95 %", "mm", deviation.p95_mm),
        Number::new("the scan's white noise", "mm", deviation.noise_mm),
        at_most("region without points that fit", "%", deviation.missing_percent, limits.max_missing_percent()),
        at_most("largest hole in the region", "mm", deviation.largest_hole_mm, limits.max_hole_mm()),
    ]
}

/// A path over these grids, as far as the arm follows it.
pub(super) fn planned(
    (plan, reached, disc): (&Plan, Option<&Reached>, &DiscUse),
    grids: &[GridId],
    (pass, judgement): (u8, Judgement),
    job: &Job<'_>,
) -> Finding {
    let settings = job.recipe.path();
    let least_covered = plan.grids.iter().map(|grid| grid.share()).fold(1.0, f64::min);
    let waypoints: usize = plan.paths.iter().map(|path| path.waypoints.len()).sum();
    let steps = plan.step_over_mm;
    Finding::new(Kind::Plan, pass, judgement).detail("grids", names(grids)).with([
        Number::new("coverage of these grids", "", plan.coverage),
        Number::new("coverage of the worst of them", "", least_covered).within(Limit::AtLeast(MIN_COVERAGE)),
        Number::new("step-over, smallest", "mm", steps.map(|step| step.min_mm)),
        Number::new("step-over, largest", "mm", steps.map(|step| step.max_mm))
            .within(Limit::AtMost(settings.step_over_mm())),
        Number::new("time under the disc, 5 % of the treated area", "s", plan.dwell.map(|dwell| dwell.low_s)),
        Number::new("time under the disc, 95 % of the treated area", "s", plan.dwell.map(|dwell| dwell.high_s)),
        Number::new(
            "their ratio, all together or the worst grid's",
            "",
            plan.dwell_ratio().map(|(ratio, _)| ratio),
        )
        .within(Limit::AtMost(settings.max_dwell_ratio())),
        Number::new("disc beyond the panel's outline", "mm", plan.overhang.largest_mm)
            .within(Limit::AtMost(settings.edge_overhang_mm())),
        Number::new("paths", "", plan.paths.len() as f64),
        Number::new(name::PLANNED, "", waypoints as f64),
        Number::new("length", "mm", plan.length_mm),
        Number::new("time at the recipe's feed", "s", plan.duration_s),
        Number::new("turn of the tool about its axis, for reach", "°", reached.map(|reached| reached.spin.0)),
        Number::new("room beyond the arm's margins", "°", reached.map(|reached| reached.travel.room_deg)),
        Number::new("swept by the disc", "mm²", disc.swept_mm2),
        Number::new("worn of the disc afterwards", "mm²", disc.life_mm2.map(|_| disc.worn_after_mm2))
            .within(disc.life_mm2.map_or(Limit::Unlimited, Limit::AtMost)),
    ])
}

/// What the robot executed of a contact path; all of it is a pass.
pub(super) fn abraded(
    (pass, most_passes): (u8, usize),
    (waypoints, done): (u32, u32),
    (whole, begun): (&[GridId], &[GridId]),
    (walked, dwell): (&Walked, &Dwell),
    off_limit_mm: f64,
) -> Finding {
    let mut doubts = Vec::new();
    if done < waypoints {
        let message = format!("the robot executed {done} of {waypoints} waypoints; the rest is left");
        doubts.push(Reason::new("part", message));
    } else if !begun.is_empty() {
        let message = format!(
            "by the poses that the robot reported the disc did not reach all that was planned of {}; the film will tell",
            names(begun).join(", ")
        );
        doubts.push(Reason::new("not_covered", message));
    }
    if walked.off_mm > off_limit_mm {
        let [off, allowed] = apart(walked.off_mm, off_limit_mm, 2);
        let message = format!("the robot reported a pose {off} mm off the planned path, allowed are {allowed}");
        doubts.push(Reason::new("off_path", message));
    }
    let spread = dwell.spread();
    let finding =
        Finding::new(Kind::Abrade, pass, Judgement::of(vec![], doubts)).detail("grids", names(whole)).with([
            Number::new(name::EXECUTED, "", f64::from(done)).within(Limit::AtLeast(f64::from(waypoints))),
            Number::new("pass", "", f64::from(pass)).within(Limit::AtMost(most_passes as f64)),
            Number::new("poses reported on the way", "", walked.reports as f64),
            Number::new("farthest of them from the planned path", "mm", walked.off_mm)
                .within(Limit::AtMost(off_limit_mm)),
            Number::new("way in contact", "mm", walked.contact_mm),
            Number::new("time under the disc, 5 % of the treated area", "s", spread.map(|spread| spread.low_s)),
            Number::new("time under the disc, 95 % of the treated area", "s", spread.map(|spread| spread.high_s)),
        ]);
    let finding = finding.with(dwell.grids.iter().flat_map(|grid| {
        let id = grid.id;
        [
            Number::new(format!("share of {id} under the disc"), "", grid.share()),
            Number::new(format!("of {id} left"), "mm²", grid.left_mm2()),
        ]
    }));
    if begun.is_empty() { finding } else { finding.detail("grids_in_part", names(begun)) }
}

fn names(grids: &[GridId]) -> Vec<String> {
    grids.iter().map(ToString::to_string).collect()
}
