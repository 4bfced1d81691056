//! A panel on a base board under a camera, and its pictures: geometry, materials, exposure, mains flicker, noise.
//!
//! - Carbon fibre in epoxy: diffuse reflectance 0.03 to 0.07; red primer 0.35 / 0.06 / 0.05; a grey board 0.16 to 0.3
//!   (measured spectra: ECOSTRESS library, man-made materials).
//! - Mains: the brightness of a lamp on 50 Hz is 1 + m cos(2π 100 t + φ); an exposure of length T reduces m to m
//!   sinc(100 T). m is 0.1 to 0.4 and differs by channel, because red phosphors decay slowly and the blue diode does
//!   not (IEEE 1789-2015; Lehman and Wilkins 2014). The mains' frequency deviates by 0.02 % (ENTSO-E).
//! - A sensor's noise: variance 0.5 + 0.012 s levels² at s levels (EMVA 1288 data of 8-bit readouts, Sony IMX 2–5 MP).

use super::light::{Field, RESIN, Surroundings, WATER, fresnel, under_water, wet_diffuse};
use super::random::{Deviates, Random};
use super::sanding::{Appearance, Remains, Zone, look};
use super::water::{Place, SPRAY_FROM_S, Surface, WET_FROM_S, Water};
use crate::conditions::Conditions;
use crate::tally::contrast_to_noise;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep::geometry::{Base, Camera, ColorPicture, Mask, OrganizedCloud, Panel, PinholeCamera, Rigid};
use panelprep::panel::{GridId, TaughtPanel};
use panelprep::phase::Phase;
use panelprep::recipe::Recipe;
use rayon::prelude::*;

const DEPTH_MM: f64 = 800.0;
const BOARD_MM: f64 = 860.0;
/// Width of the weave's tows, mm.
const TOW_MM: f64 = 2.0;

/// The properties of a clip, drawn from its seed.
#[derive(Debug, Clone)]
pub struct Spec {
    pub name: &'static str,
    pub field: Field,
    pub red: bool,
    pub beat: bool,
    pub projector: bool,
    pub frames_per_second: f64,
    pub spots: usize,
}

impl Spec {
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, 1);
        let fields = [Field::Dark, Field::Bright, Field::Mixed];
        let kinds = ["dark", "bright", "mixed", "red", "beat", "slow"];
        let kind = (seed % 6) as usize;
        let field = if kind < 3 { fields[kind] } else { fields[(seed / 6 % 3) as usize] };
        let slow = [2.0, 3.0, 4.0][(seed / 6 % 3) as usize];
        Spec {
            name: kinds[kind],
            field: if kind == 3 { Field::Dark } else { field },
            red: kind == 3,
            beat: kind == 4,
            projector: kind == 5 && (seed / 6).is_multiple_of(2),
            frames_per_second: if kind == 5 { slow } else { 5.0 },
            spots: if (seed / 18 + seed / 6 + seed).is_multiple_of(3) {
                0
            } else {
                2 + (random.bits() % 4) as usize
            },
        }
    }
}

/// A pixel that is on the panel or on the panel's edge.
#[derive(Debug, Clone)]
struct Seen {
    index: usize,
    cover: f64,
    point: [f64; 3],
    /// Slopes of the surface's depth along x and y.
    slope: [f64; 2],
    weave: f64,
    rho: [f64; 3],
    lit: [f64; 3],
    /// Dry reflectance of the new panel, per channel.
    made: [f64; 3],
    /// Dry reflectance of the panel as it is now, per channel.
    dry: [f64; 3],
    /// Reflectance of the gloss under water, per channel.
    gloss_wet: [f64; 3],
    look: Appearance,
    place: Place,
    pixel_mm: f64,
}

/// The scene of one clip, from which its pictures are rendered.
pub struct Scene {
    pub spec: Spec,
    pub camera: PinholeCamera,
    pub taught: TaughtPanel,
    pub recipe: Recipe,
    pub camera_from_panel: Rigid<Camera, Panel>,
    above: Surroundings,
    water: Water,
    seen: Vec<Seen>,
    /// Pixels of the board around the panel: dry colour, wet colour, and distance from the panel, mm.
    board: Vec<([f32; 3], [f32; 3], f32)>,
    drip_mm: f64,
    scale: f64,
    drift: (f64, f64),
    beat: [(f64, f64); 3],
    mains_hz: f64,
    noise: Deviates,
    seed: u64,
    remains: Vec<Remains>,
    zones: Vec<Zone>,
    pub conditions: Conditions,
}

/// The panel's shape: its depth and slopes.
struct Shape {
    half: [f64; 2],
    tilt: [f64; 2],
    bow: [f64; 2],
    bumps: Vec<([f64; 2], f64, f64)>,
}

impl Shape {
    fn depth(&self, [x, y]: [f64; 2]) -> f64 {
        let rise: f64 = self.bumps.iter().map(|(at, size, wide)| size * bell(x - at[0], y - at[1], *wide)).sum();
        let bow = self.bow[0] * (x / self.half[0]).powi(2) + self.bow[1] * (y / self.half[1]).powi(2);
        DEPTH_MM + self.tilt[0] * x + self.tilt[1] * y + bow - rise
    }

    fn slope(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        const D: f64 = 0.5;
        [
            (self.depth([x + D, y]) - self.depth([x - D, y])) / (2.0 * D),
            (self.depth([x, y + D]) - self.depth([x, y - D])) / (2.0 * D),
        ]
    }

    /// Returns the distance from the panel's edge, mm; negative on the panel. The corners are round.
    fn outside(&self, [x, y]: [f64; 2]) -> f64 {
        const ROUND: f64 = 18.0;
        let (dx, dy) = (x.abs() - self.half[0] + ROUND, y.abs() - self.half[1] + ROUND);
        dx.max(0.0).hypot(dy.max(0.0)) + dx.max(dy).min(0.0) - ROUND
    }
}

fn bell(dx: f64, dy: f64, wide: f64) -> f64 {
    (-(dx * dx + dy * dy) / (2.0 * wide * wide)).exp()
}

/// Returns the relative brightness of the upper yarn in a 2 × 2 twill, from −1 to 1, with less contrast if a pixel is
/// as wide as a tow.
fn weave([x, y]: [f64; 2], pixel_mm: f64) -> f64 {
    let (i, j) = ((x / TOW_MM).floor(), (y / TOW_MM).floor());
    let sign = if (i + j).rem_euclid(4.0) < 2.0 { 1.0 } else { -1.0 };
    sign / (1.0 + (1.5 * pixel_mm / TOW_MM).powi(2))
}

/// Number of rows and columns of grids.
const GRIDS: [usize; 2] = [3, 4];
/// Distance of the region from the panel's edge, mm.
const INSET_MM: f64 = 12.0;

/// Returns the grids, which are the same in every clip.
pub fn grid_ids() -> Vec<GridId> {
    let columns = |row| (1..=GRIDS[1]).map(move |column| GridId { row, column });
    (1..=GRIDS[0]).flat_map(columns).collect()
}

/// Returns the sanded zones: a rectangle for each sanded grid, widened by the distance by which the disc moved beyond
/// the grid.
fn zones(conditions: &Conditions, half: [f64; 2], random: &mut Random) -> Vec<Zone> {
    let mut zones = Vec::new();
    for pass in &conditions.sanded {
        let albedo = 0.4 * (1.8_f64 / 0.4).powf(random.between(0.0, 1.0));
        for id in pass {
            let side = |axis: usize, index: usize, of: usize| {
                let (low, size) = (INSET_MM - half[axis], 2.0 * (half[axis] - INSET_MM) / of as f64);
                let from = low + size * (index - 1) as f64;
                [from - conditions.beyond_mm, from + size + conditions.beyond_mm]
            };
            let (x, y) = (side(0, id.column, GRIDS[1]), side(1, id.row, GRIDS[0]));
            zones.push(Zone::new([x[0], y[0]], [x[1], y[1]], albedo, random));
        }
    }
    zones
}

impl Scene {
    pub fn new(seed: u64, reduction: usize, observed_s: f64) -> Self {
        let spec = Spec::new(seed);
        let conditions = Conditions::new(seed, &grid_ids());
        let spec = Spec { frames_per_second: conditions.frames_per_second, ..spec };
        let mut random = Random::new(seed, 2);
        let (width, height) = (1944 / reduction, 1200 / reduction);
        let focal = 2100.0 / reduction as f64;
        let camera = PinholeCamera {
            width_px: width,
            height_px: height,
            fx_px: focal,
            fy_px: focal,
            cx_px: (width as f64 - 1.0) / 2.0,
            cy_px: (height as f64 - 1.0) / 2.0,
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        };
        let shape = Shape {
            half: [random.between(210.0, 250.0), random.between(130.0, 160.0)],
            tilt: [0, 1].map(|_| random.between(-0.04, 0.04)),
            bow: [0, 1].map(|_| random.between(-5.0, 8.0)),
            bumps: (0..3)
                .map(|_| {
                    let at = [random.between(-180.0, 180.0), random.between(-110.0, 110.0)];
                    (at, random.between(-2.5, 2.5), random.between(40.0, 90.0))
                })
                .collect(),
        };
        let above = Surroundings::new(spec.field, spec.projector, &mut random);
        let water = Water::new(shape.half, spec.spots, WET_FROM_S + 0.8 * observed_s, &mut random);
        let mut after = Random::new(seed, 3);
        let zones = zones(&conditions, shape.half, &mut after);
        let dense = after.between(0.0, 1.5);
        let remains: Vec<Remains> = (water.grease.iter())
            .map(|grease| Remains::new(grease.centre_mm, grease.radius_mm, dense, &mut after))
            .collect();
        let carbon = random.between(0.03, 0.07);
        let rho = if spec.red { [0.35, 0.06, 0.05] } else { [carbon * 1.05, carbon, carbon * 0.97] };
        let board = if spec.red { random.between(0.09, 0.13) } else { random.between(0.16, 0.3) };
        let rough = random.between(0.06, 0.45);
        let gloss = random.between(0.5, 1.0);
        let noise = Deviates::new(seed);
        let px_mm = DEPTH_MM / focal;
        let mut cloud = vec![[0.0_f32; 3]; width * height];
        let mut seen = Vec::new();
        let mut around = Vec::with_capacity(width * height);
        for (index, point) in cloud.iter_mut().enumerate() {
            let ray = [(index % width) as f64, (index / width) as f64];
            let ray = [(ray[0] - camera.cx_px) / focal, (ray[1] - camera.cy_px) / focal];
            let mut z = DEPTH_MM;
            (0..6).for_each(|_| z = shape.depth([ray[0] * z, ray[1] * z]));
            let at = [ray[0] * z, ray[1] * z];
            let outside = shape.outside(at);
            let cover = (0.5 - outside / px_mm).clamp(0.0, 1.0);
            let here = if cover >= 0.5 { z } else { BOARD_MM };
            let range = 0.06 * f64::from(noise.at(3 * index));
            *point = [ray[0] * here, ray[1] * here, here + range].map(|n| n as f32);
            let on_board = [ray[0] * BOARD_MM, ray[1] * BOARD_MM, BOARD_MM];
            let lit = above.irradiance(on_board);
            let grain = board * (1.0 + 0.05 * f64::from(noise.at(7 * index + 1)));
            around.push((
                lit.map(|lit| (lit * grain) as f32),
                lit.map(|lit| (lit * wet_diffuse(grain, 0.02)) as f32),
                outside as f32,
            ));
            if cover <= 0.0 {
                continue;
            }
            let down = (at[1] / shape.half[1] + 1.0) / 2.0;
            seen.push(Seen {
                index,
                cover,
                point: [at[0], at[1], z],
                slope: shape.slope(at),
                weave: weave(at, px_mm),
                rho,
                lit: above.irradiance([at[0], at[1], z]),
                made: [0.0; 3],
                dry: [0.0; 3],
                gloss_wet: [0.0; 3],
                look: look(&zones, at),
                place: water.place(at, down),
                pixel_mm: px_mm,
            });
        }
        for one in &mut seen {
            let cos = -one.view_dot(one.slope);
            let tow = one.weave * 0.05;
            let meets = one.mirrored([one.slope[0] + tow, one.slope[1] - tow], above.above_mm);
            let wide = 2.0 * (one.point[2] + above.above_mm);
            let lobe = above.blurred(meets, wide * rough);
            let share = gloss * fresnel(cos, RESIN);
            let yarn = 1.0 + 0.08 * one.weave;
            let stain = water.grease_at(&one.place).map_or(1.0, |(index, _)| remains[index].stain);
            one.made = std::array::from_fn(|i| one.rho[i] * stain * yarn * one.lit[i] + share * lobe[i]);
            // Deeper scratches scatter more light: a sanded point has a wider reflection lobe.
            let yarn = 1.0 + 0.08 * one.weave * one.look.weave;
            let (gloss, rough) = (gloss * one.look.gloss, rough.max(0.3 * (1.0 - one.look.gloss)));
            let lobe = above.blurred(meets, wide * rough);
            let rho: [f64; 3] = std::array::from_fn(|i| one.rho[i] * one.look.albedo[i] * stain * yarn);
            one.dry = std::array::from_fn(|i| rho[i] * one.lit[i] + share * one.look.gloss * lobe[i]);
            let lobe = above.blurred(meets, wide * rough * WATER);
            one.gloss_wet = lobe.map(|level| level * gloss * under_water() * (1.0 - fresnel(cos, WATER)).powi(2));
            one.weave *= one.look.weave;
            one.rho = rho;
        }
        // The exposure is set for the dry panel's brightest channel, and is limited so that the board is not
        // overexposed.
        let mean = |i: usize| seen.iter().map(|one| one.made[i]).sum::<f64>() / seen.len() as f64;
        let brightest = (0..3).map(mean).fold(0.0, f64::max);
        let most = around.iter().flat_map(|(dry, ..)| dry).fold(0.0_f32, |a, b| a.max(*b));
        let scale = (random.between(50.0, 110.0) / brightest).min(225.0 / f64::from(most));
        let region = Scene::region(&shape, &camera);
        let recipe = Scene::recipe(&region);
        let base_from_camera: Rigid<Base, Camera> = Rigid::from_isometry_unchecked(Isometry3::from_parts(
            Translation3::new(0.0, 0.0, DEPTH_MM),
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
        ));
        let depth_s = [0.0, random.between(0.02, 0.1)];
        let drift = (depth_s[1] * if random.chance(0.5) { 1.0 } else { -1.0 }, random.between(25.0, 90.0));
        let exposure_s = if spec.beat { random.between(0.0035, 0.0085) } else { 0.01 };
        let x = std::f64::consts::PI * 100.0 * exposure_s;
        let kept = (x.sin() / x).abs();
        let deep = random.between(0.1, 0.4);
        let beat = [0.5, 0.8, 1.0].map(|part| (deep * part * kept, random.between(0.0, 0.8)));
        let mut scene = Scene {
            camera,
            camera_from_panel: Rigid::from_isometry_unchecked(*base_from_camera.inverse().isometry()),
            // A placeholder: the panel is taught below, with a rendered picture.
            taught: Scene::teach(&camera, cloud.clone(), vec![[0; 3]; width * height], base_from_camera, &recipe),
            recipe,
            above,
            water,
            seen,
            board: around,
            drip_mm: random.between(10.0, 50.0),
            scale,
            drift,
            beat,
            mains_hz: 100.0 * (1.0 + random.between(-2e-4, 2e-4)),
            noise,
            seed,
            spec,
            remains,
            zones,
            conditions,
        };
        let colors = scene.picture(0.0).rgb;
        scene.taught = Scene::teach(&camera, cloud, colors, base_from_camera, &scene.recipe);
        scene
    }

    fn teach(
        camera: &PinholeCamera,
        points: Vec<[f32; 3]>,
        colors: Vec<[u8; 3]>,
        base_from_camera: Rigid<Base, Camera>,
        recipe: &Recipe,
    ) -> TaughtPanel {
        let cloud =
            OrganizedCloud::<Camera>::new(camera.width_px, camera.height_px, points, colors).expect("counts");
        TaughtPanel::learn(&cloud, *camera, base_from_camera, recipe).expect("a panel to learn")
    }

    /// Returns the corners of the region, which is the panel without a border of 12 mm.
    fn region(shape: &Shape, camera: &PinholeCamera) -> [[f64; 2]; 4] {
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[a, b]| {
            let (x, y) = (a * (shape.half[0] - INSET_MM), b * (shape.half[1] - INSET_MM));
            let z = shape.depth([x, y]);
            [camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px]
        })
    }

    fn recipe(corners: &[[f64; 2]; 4]) -> Recipe {
        let more = std::env::var("INSPECT").unwrap_or_default();
        let text = format!(
            "panel = \"optics\"\n[locate]\nbox_min_mm = [-400, -300, -50]\nbox_max_mm = [400, 300, 60]\n\
             [region]\ncorners_px = {corners:?}\nrows = {}\ncolumns = {}\n[inspect]\n{more}\n",
            GRIDS[0], GRIDS[1],
        );
        Recipe::check("optics.toml", &text).expect("a valid recipe")
    }

    pub fn phase(time_s: f64) -> Phase {
        if time_s < SPRAY_FROM_S {
            Phase::Dry
        } else if time_s < WET_FROM_S {
            Phase::Spray
        } else {
            Phase::Wet
        }
    }

    /// Returns the brightness of each channel at this time, relative to the lamp's mean.
    fn lamp(&self, time_s: f64) -> [f64; 3] {
        let drift = 1.0 + self.drift.0 * (std::f64::consts::TAU * time_s / self.drift.1).sin();
        // The camera's clock is not synchronized with the mains: each exposure begins at a random time within a fifth
        // of a period.
        let mut random = Random::new(self.seed, 1000 + (time_s * 1000.0) as u64);
        let begins_s = time_s + random.between(0.0, 0.002);
        let turns = (self.mains_hz * begins_s).fract() * std::f64::consts::TAU;
        self.beat.map(|(depth, phase)| drift * (1.0 + depth * (turns + phase).cos()))
    }

    pub fn picture(&self, time_s: f64) -> ColorPicture {
        let (width, height) = (self.camera.width_px, self.camera.height_px);
        let mut picture = ColorPicture::uniform(width, height, [0; 3]);
        let lamp = self.lamp(time_s).map(|gain| gain * self.scale);
        let mut random = Random::new(self.seed, 5_000_000 + (time_s * 1000.0) as u64);
        let from = random.bits() as usize % 60_000;
        let sprayed = ((time_s - SPRAY_FROM_S) / 3.0).clamp(0.0, 1.0) * self.drip_mm;
        let exposed = |rgb: [f64; 3], index: usize| -> [u8; 3] {
            std::array::from_fn(|i| {
                let level = rgb[i] * lamp[i];
                let sigma = (0.5 + 0.012 * level).sqrt();
                let noise = f64::from(self.noise.at(from + 3 * index + i + index / width * 977));
                (level + sigma * noise).round().clamp(0.0, 255.0) as u8
            })
        };
        let ground = |index: usize| {
            let (dry, wet, outside) = &self.board[index];
            let rgb = if f64::from(*outside) < sprayed { wet } else { dry };
            rgb.map(f64::from)
        };
        picture.rgb.par_iter_mut().enumerate().for_each(|(index, pixel)| *pixel = exposed(ground(index), index));
        let on_panel: Vec<(usize, [u8; 3])> = (self.seen.par_iter())
            .map(|one| {
                let own = if time_s < SPRAY_FROM_S {
                    one.made
                } else {
                    self.radiance(one, &self.surface(one, time_s), time_s)
                };
                let behind = ground(one.index);
                let rgb = std::array::from_fn(|i| behind[i] + (own[i] - behind[i]) * one.cover);
                (one.index, exposed(rgb, one.index))
            })
            .collect();
        on_panel.into_iter().for_each(|(index, rgb)| picture.rgb[index] = rgb);
        picture
    }

    /// Returns the water at a point, including the droplets that stay after the film has opened.
    fn surface(&self, one: &Seen, time_s: f64) -> Surface {
        let surface = self.water.at(&one.place, time_s, one.pixel_mm);
        let droplet = (self.water.grease_at(&one.place).filter(|_| surface.wet < 1.0 && time_s > WET_FROM_S))
            .and_then(|(index, at)| self.remains[index].droplet(at, one.pixel_mm));
        match droplet {
            Some((share, slope)) if share > surface.wet => Surface { wet: share, slope, shows_weave: 0.0 },
            _ => surface,
        }
    }

    /// Returns the radiance of a point of the panel in the direction of the camera.
    fn radiance(&self, one: &Seen, surface: &Surface, time_s: f64) -> [f64; 3] {
        // A spot on which the film has opened is damp.
        let damp = (self.water.grease_at(&one.place).filter(|_| self.water.opens_s(&one.place) < time_s))
            .map_or(1.0, |(index, _)| self.remains[index].damp);
        let bare = one.dry.map(|level| level * damp);
        if surface.wet <= 0.0 {
            return bare;
        }
        let tow = one.weave * 0.05 * surface.shows_weave;
        let slope = [one.slope[0] + surface.slope[0] + tow, one.slope[1] + surface.slope[1] - tow];
        let f = fresnel(-one.view_dot(slope), WATER);
        let mirrored = self.above.radiance(one.mirrored(slope, self.above.above_mm));
        std::array::from_fn(|i| {
            let wet = f * mirrored[i] + wet_diffuse(one.rho[i], f) * one.lit[i] + one.gloss_wet[i];
            bare[i] + (wet - bare[i]) * surface.wet
        })
    }

    /// Returns the pixels of the sanded areas and of a margin around them. The panel is at its taught pose in the clip.
    pub fn sanded_in_taught(&self, margin_mm: f64) -> Mask {
        let mut mask = Mask::all_outside(self.camera.width_px, self.camera.height_px);
        for one in &self.seen {
            let at = [one.point[0], one.point[1]];
            mask.inside[one.index] = self.zones.iter().any(|zone| zone.depth(at) > -margin_mm);
        }
        mask
    }

    /// Returns the ground truth: the pixels at which the film is open at this time.
    pub fn broken(&self, time_s: f64) -> Mask {
        let mut mask = Mask::all_outside(self.camera.width_px, self.camera.height_px);
        for one in &self.seen {
            mask.inside[one.index] = self.water.opens_s(&one.place) <= time_s;
        }
        mask
    }

    /// Returns the true contrast: the difference between a calm film and a break at each pixel, as a multiple of the
    /// pixel's noise.
    pub fn contrast(&self) -> Vec<f64> {
        let mut times = vec![0.0; self.camera.width_px * self.camera.height_px];
        for one in &self.seen {
            let looks =
                [one.dry, self.radiance(one, &Water::CALM, 0.0)].map(|rgb| rgb.map(|level| level * self.scale));
            times[one.index] = contrast_to_noise(looks, |level| (0.5 + 0.012 * level).sqrt());
        }
        times
    }

    /// Returns the ground truth: the time of the clip at which the film opens at each pixel, s; infinite if it does not
    /// open.
    pub fn opens_s(&self) -> Vec<f64> {
        let mut times_s = vec![f64::INFINITY; self.camera.width_px * self.camera.height_px];
        self.seen.iter().for_each(|one| times_s[one.index] = self.water.opens_s(&one.place));
        times_s
    }
}

impl Seen {
    /// Returns the dot product of the unit vector to the camera and the unit normal of a surface with these slopes of
    /// depth.
    fn view_dot(&self, slope: [f64; 2]) -> f64 {
        let [x, y, z] = self.point;
        let (far, long) = ((x * x + y * y + z * z).sqrt(), (slope[0].powi(2) + slope[1].powi(2) + 1.0).sqrt());
        (x * slope[0] + y * slope[1] - z) / (far * long)
    }

    /// Returns the point at which the mirrored view ray intersects the plane above.
    fn mirrored(&self, slope: [f64; 2], above_mm: f64) -> [f64; 2] {
        let [x, y, z] = self.point;
        let n = [slope[0], slope[1], -1.0];
        let nn = slope[0].powi(2) + slope[1].powi(2) + 1.0;
        let vn = 2.0 * (x * n[0] + y * n[1] - z) / nn;
        let r = [x - vn * n[0], y - vn * n[1], z - vn * n[2]];
        let t = -(above_mm + z) / r[2].min(-1e-6);
        [x + t * r[0], y + t * r[1]]
    }
}
