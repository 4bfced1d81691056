//! Twenty simulated curved panels, with a k that deviates by up to 30 % and is known only from twelve coupons, discs
//! that wear, and a force with noise. The plan uses the results of the coupons, and the removal follows from the true
//! values.

use super::goal::Figure;
use super::scene::{FORCE_N, ORBIT, PAD, PRESTON_MM2_PER_N, bent, disc, recipe};
use super::{held, most, reached};
use panelprep::geometry::{Panel, Point};
use panelprep::panel::{GridId, Region};
use panelprep::path::dwell::{self, ExecutedPose};
use panelprep::path::{Plan, plan, plan_beyond_borders};
use panelprep::recipe::Recipe;
use panelprep::removal::coupons::{Coupon, CouponTool, Lines};
use panelprep::removal::fit::fit;
use panelprep::removal::map::{RemovalMap, removed};
use panelprep::removal::model::Model;
use panelprep::removal::schedule::{RemovalTarget, schedule};
use panelprep::removal::track::{Disc, path_stretches};
use panelprep::stages::removal::contact_moves;
use panelprep::surface::{BSplineSurface, HoleMap, Parameter, Treated};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const PANELS: u64 = 20;
const SIDES_MM: [f64; 2] = [320.0, 240.0];
pub const TARGET_UM: f64 = 30.0;
const MAX_UM: f64 = 45.0;
/// Maximum deviation from the target depth, percent.
const WITHIN_PERCENT: f64 = 10.0;
const SHARE: f64 = 0.95;
const STATED_FRACTION_RANGE: [f64; 2] = [0.90, 0.99];
const COUPONS: usize = 12;
/// Relative standard deviation of k from piece to piece (coupon or panel).
const PIECE_DEVIATION: f64 = 0.02;
/// Relative standard deviation of a measured depth.
const MEASURED_DEVIATION: f64 = 0.022;
/// Relative standard deviation of the force's bias from panel to panel.
const FORCE_BIAS: f64 = 0.015;
/// Relative standard deviation of the force's noise from pose to pose.
const FORCE_NOISE: f64 = 0.04;
/// The relative 95 % uncertainty of the force in the recipe.
const RELATIVE_FORCE_ERROR_95: f64 = 0.04;

/// The true values, which are not known at the cell.
struct Truth {
    preston_mm2_per_n: f64,
    decay_per_mm2: f64,
    worn_mm2: f64,
    /// Ratio of k on this panel to the disc's k on an average piece.
    piece: f64,
}

pub fn measure() -> usize {
    let settings = path_recipe("");
    let region = Region::new(settings.region()).expect("convex");
    let (mut scheduled, mut constant, mut within, mut alike, mut beyond) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), 0);
    println!(
        "   panel   k true / by coupons   worn m²   within ±10 %: scheduled  constant   deepest µm   95 % held"
    );
    for seed in 0..PANELS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let bends = [0, 1].map(|_| random.random_range(-1.0 / 900.0..1.0 / 600.0));
        let surface = bent(SIDES_MM, bends);
        let truth = Truth {
            preston_mm2_per_n: PRESTON_MM2_PER_N * random.random_range(0.7..1.3),
            decay_per_mm2: random.random_range(0.4e-6..1.2e-6),
            worn_mm2: random.random_range(0.0..300_000.0),
            piece: (PIECE_DEVIATION * normal(&mut random)).exp(),
        };
        let model = fit_model_from_coupons(&truth, &mut random);
        let run = |plan: &Plan, random: &mut Pcg64Mcg| {
            let poses = dwell::timed_poses(plan);
            let expected = map((&surface, &region), plan, &poses, (&model, truth.worn_mm2));
            let pressed = with_force_noise(&poses, random);
            let exact = Model {
                preston_mm2_per_n: truth.preston_mm2_per_n * truth.piece,
                decay_per_mm2: truth.decay_per_mm2,
                ..model
            };
            (expected, map((&surface, &region), plan, &pressed, (&exact, truth.worn_mm2)))
        };
        let by_schedule =
            run(&scheduled_plan((&surface, &region), &settings, (&model, truth.worn_mm2)), &mut random);
        let by_constant = run(&constant_plan((&surface, &region), &model, &truth), &mut random);
        let share = |map: &RemovalMap| share_within(map);
        let [deepest, held, _] = compared(&by_schedule.0, &by_schedule.1, 1.0);
        alike.push(compared(&by_schedule.0, &by_schedule.1, 1.0 / truth.piece));
        beyond += usize::from(deepest > MAX_UM);
        println!(
            "   {seed:5}   {:.3} / {:.3}      {:10.1}   {:.2}      {:20.3}  {:8.3}   {deepest:10.1}   {held:8.3}",
            1e4 * truth.preston_mm2_per_n,
            1e4 * model.preston_mm2_per_n,
            100.0 * (truth.piece - 1.0),
            truth.worn_mm2 / 1e6,
            share(&by_schedule.1),
            share(&by_constant.1),
        );
        scheduled.push(share(&by_schedule.1));
        constant.push(share(&by_constant.1));
        within.push(held);
    }
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    println!(
        "   a constant feed, tuned in the mean: {:.3} of the treated area within ±{WITHIN_PERCENT} %",
        mean(&constant)
    );
    let [held_alike, within_alike] =
        [1, 2].map(|number| mean(&alike.iter().map(|panel: &[f64; 3]| panel[number]).collect::<Vec<_>>()));
    println!(
        "   if all pieces were equal and coupons differed only by their measurement: {within_alike:.3} within, {held_alike:.3} held"
    );
    let [area, stated] = [mean(&scheduled), mean(&within)];
    let goal = format!("{} %", 100.0 * SHARE);
    Figure("removal: treated area within ±10 %").report(&goal, &format!("{:.1} %", 100.0 * area), area >= SHARE);
    most(Figure("removal: panels deeper than 45 µm"), beyond as f64, 0.0, "");
    let found = format!("{:.1} %", 100.0 * stated);
    Figure("removal: stated 95 % held").report(
        "90–99 %",
        &found,
        (STATED_FRACTION_RANGE[0]..=STATED_FRACTION_RANGE[1]).contains(&stated),
    );
    let mut missed =
        reached("scheduled, of the treated area within ±10 % of the target, mean", mean(&scheduled), SHARE, "");
    missed += held("panels with a place deeper than max_um", beyond as f64, 0.0, "");
    missed += reached("stated 95 % held", mean(&within), STATED_FRACTION_RANGE[0], "");
    missed + held("stated 95 % held", mean(&within), STATED_FRACTION_RANGE[1], "")
}

pub fn path_recipe(more: &str) -> Recipe {
    let removal = format!(
        "[removal]\nmethod = \"scheduled\"\ntarget_um = {TARGET_UM}\nmax_um = {MAX_UM}\nforce_n = {FORCE_N}\n"
    );
    recipe([6, 8], &format!("{removal}[path]\nstep_over_mm = 9\nwaypoint_spacing_mm = 10\nfeed_mm_s = 120\n{more}"))
}

fn outline() -> Vec<Point<Panel>> {
    // The outline is so far outside of the region that no disc reaches it.
    let [w, h] = SIDES_MM.map(|side| 0.5 * side + 60.0);
    [(-w, -h), (w, -h), (w, h), (-w, h)].map(|(x, y)| Point::at(x, y, 0.0)).to_vec()
}

/// Returns the plan with scheduled feeds, as the stage computes it.
pub fn scheduled_plan(
    (surface, region): (&BSplineSurface, &Region),
    recipe: &Recipe,
    (model, worn_mm2): (&Model, f64),
) -> Plan {
    let grids: Vec<GridId> = region.ids().collect();
    let (settings, asked) = (recipe.path(), recipe.removal().expect("stated"));
    let laid = beyond(surface, region, &grids, recipe);
    let all: Vec<_> = laid.paths.iter().flat_map(|path| path.waypoints.iter().copied()).collect();
    let moves = contact_moves(&all, asked, settings);
    let ground = |_: Parameter| true;
    let disc = Disc { swept_mm2: worn_mm2, ..disc(true) };
    let on = path_stretches(surface, &dwell::timed_poses(&laid), (&disc, FORCE_N), &ground);
    let wanted = RemovalTarget { target_um: asked.target_um(), acceleration_mm_s2: settings.acceleration_mm_s2() };
    let found = schedule((surface, region, &ground), &laid.treated, (&on, &moves), model, &wanted);
    let mut feeds_mm_s: Vec<f64> = all.iter().map(|waypoint| waypoint.feed_mm_s).collect();
    moves.iter().zip(&found).for_each(|(own, feed)| feeds_mm_s[own.pose] = *feed);
    laid.with_feeds(&feeds_mm_s, settings)
}

/// Returns a plan whose lines extend beyond the border as far as in the stage's plan.
pub fn beyond(surface: &BSplineSurface, region: &Region, grids: &[GridId], recipe: &Recipe) -> Plan {
    let beyond_mm = 0.4 * PAD.radius_mm;
    let holes = HoleMap::empty(region);
    plan_beyond_borders(
        surface,
        region,
        &Treated::from_grids(grids),
        (&outline(), &holes),
        (recipe.path(), beyond_mm),
    )
    .expect("a plan")
}

/// Returns a plan with a constant feed, which is chosen such that the mean removal is the target.
fn constant_plan((surface, region): (&BSplineSurface, &Region), model: &Model, truth: &Truth) -> Plan {
    let grids: Vec<GridId> = region.ids().collect();
    let recipe = path_recipe("");
    let laid = plan(surface, region, &grids, &outline(), recipe.path()).expect("a plan");
    let map = map((surface, region), &laid, &dwell::timed_poses(&laid), (model, truth.worn_mm2));
    let depths = map.grids.iter().flat_map(|grid| &grid.depth_um);
    let mean = depths.clone().map(|depth| f64::from(*depth)).sum::<f64>() / depths.count() as f64;
    let all = laid.paths.iter().flat_map(|path| &path.waypoints);
    let feeds_mm_s: Vec<f64> = all.map(|waypoint| waypoint.feed_mm_s * mean / TARGET_UM).collect();
    laid.with_feeds(&feeds_mm_s, recipe.path())
}

/// Returns the model that is fitted to coupons sanded with this sander.
fn fit_model_from_coupons(truth: &Truth, random: &mut Pcg64Mcg) -> Model {
    let tool = CouponTool { pad: PAD, orbit: ORBIT };
    let coupons: Vec<Coupon> = (0..COUPONS)
        .map(|index| {
            let (passes, worn_mm2) = ([1.0, 2.0, 4.0][index % 3], 120_000.0 * (index / 3) as f64);
            let (line, name, lines) = (index as u64 + 2, format!("C{index}"), Lines::One);
            let coupon = Coupon {
                line,
                name,
                disc: None,
                force_n: FORCE_N,
                feed_mm_s: 60.0,
                passes,
                lines,
                worn_mm2,
                depth_um: 0.0,
            };
            let k = truth.preston_mm2_per_n * (-truth.decay_per_mm2 * worn_mm2).exp();
            let differs = PIECE_DEVIATION.hypot(MEASURED_DEVIATION) * normal(random);
            let depth_um = 1_000.0 * k * coupon.exposure_n_mm(&tool) * differs.exp();
            Coupon { depth_um, ..coupon }
        })
        .collect();
    let found = fit(&coupons, &tool).expect("a model");
    Model {
        preston_mm2_per_n: found.preston_mm2_per_n,
        decay_per_mm2: found.decay_per_mm2,
        covariance: found.covariance,
        coupon_deviation: found.coupon_deviation,
        disc_deviation: 0.0,
        redundancy: found.redundancy(),
        orbit: ORBIT,
        pad_n_mm3: PAD.stiffness_n_mm3,
        forces_n: Some([FORCE_N; 2]),
        force_power: found.powers.force,
    }
}

fn normal(random: &mut Pcg64Mcg) -> f64 {
    // Normal deviates by the method of Box and Muller.
    let (a, b): (f64, f64) = (random.random_range(1e-12..1.0), random.random_range(0.0..std::f64::consts::TAU));
    (-2.0 * a.ln()).sqrt() * b.cos()
}

/// Returns the same poses with a force that has a bias for the panel, and noise that is constant over some poses.
fn with_force_noise(poses: &[ExecutedPose], random: &mut Pcg64Mcg) -> Vec<ExecutedPose> {
    let bias = FORCE_BIAS * normal(random);
    let (mut slow, keep) = (0.0, 0.8_f64);
    let mut press = |pose: &ExecutedPose| {
        slow = keep * slow + (1.0 - keep * keep).sqrt() * FORCE_NOISE * normal(random);
        ExecutedPose { force_n: Some(FORCE_N * (1.0 + bias + slow)), ..*pose }
    };
    poses.iter().map(&mut press).collect()
}

fn map(
    (surface, region): (&BSplineSurface, &Region),
    plan: &Plan,
    poses: &[ExecutedPose],
    (model, worn_mm2): (&Model, f64),
) -> RemovalMap {
    let ground = |_: Parameter| true;
    let disc = Disc { swept_mm2: worn_mm2, ..disc(true) };
    let all = path_stretches(surface, poses, (&disc, FORCE_N), &ground);
    removed((surface, region, &ground), &plan.treated, &all, (model, RELATIVE_FORCE_ERROR_95), 2.0)
}

fn share_within(map: &RemovalMap) -> f64 {
    panelprep::removal::figures::MapFigures::share_within(map, TARGET_UM, WITHIN_PERCENT)
}

/// Returns three results for the true depths, multiplied by `times`: the largest depth, µm, the fraction of points
/// whose depth is within the stated limits, and the fraction of the treated area within ±10 % of the target.
fn compared(expected: &RemovalMap, truth: &RemovalMap, times: f64) -> [f64; 3] {
    let (mut deepest, mut held, mut all, mut within, mut treated) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (grid, exact) in expected.grids.iter().zip(&truth.grids) {
        for (index, depth_um) in grid.depth_um.iter().enumerate() {
            let found = times * f64::from(exact.depth_um[index]);
            let half = expected.quantile_95 * f64::from(grid.deviation[index]);
            deepest = f64::max(deepest, found);
            all += 1.0;
            held += f64::from(u8::from((found / f64::from(*depth_um)).ln().abs() <= half));
            let area = f64::from(grid.area_mm2[index]) * f64::from(u8::from(grid.is_treated[index]));
            treated += area;
            within += area * f64::from(u8::from((found / TARGET_UM - 1.0).abs() <= WITHIN_PERCENT / 100.0));
        }
    }
    [deepest, held / all, within / treated]
}
