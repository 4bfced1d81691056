//! Trials of a localization: a panel of any shape, anywhere in a search box, before a cluttered fixture; and what can be
//! wrong with such a scene. The calibration is the true one: what is measured is the localization.
//!
//! A good trial has the taught panel, dry, in the box, turned by up to ±180° about its normal and tilted by up to 30°, with
//! at most 20 % hidden behind things or outside of the picture. Glints leave points out and overexpose the picture.

use super::appearance::dry_and_wet;
use super::cast::{Rays, Sight, View};
use super::clutter::{Met, Slab};
use super::fixture::Background;
use super::noise::{LEVEL, Normal, PixelNoise, Purpose, Seed, ValueNoise, to_bytes};
use super::scanner::measured;
use super::scene;
use super::shape::{CENTRE_MM, Shape};
use super::truth::PlacementError;
use super::variety::{Panel, generator};
use crate::geometry::{Base, Camera, OrganizedCloud, PinholeCamera, Pixel, Rigid};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector2, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// The box in which a trial's panel stands, mm in the base frame; the fixture lies behind it.
pub const TRIAL_BOX_MM: [[f64; 3]; 2] = [[250.0, -420.0, 10.0], [640.0, 420.0, 720.0]];

/// The panel's points stay this far before the fixture, mm.
const FARTHEST_X_MM: f64 = 628.0;
const MAX_HIDDEN: f64 = 0.195;

/// What is wrong with a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrong {
    /// No panel: things alone.
    Nothing,
    /// Another panel.
    Another,
    /// Its mirror image.
    Mirror,
    /// Its back.
    Back,
    /// One that is 2 to 5 % larger or smaller.
    Size,
    /// One that is bent by 2 to 5 mm.
    Bent,
    /// One that has a strip of its length cut off.
    Trimmed,
    /// More than 40 % is hidden.
    Hidden,
    /// More than 35 % is outside of the picture.
    OutOfView,
    /// One that looks the same turned by half a turn.
    Symmetric,
    /// The camera has moved since teaching, by 1 to 10 mm.
    CameraMoved,
    /// Water on the panel: most points are missing, many are wrong.
    Wet,
    /// The panel moved during the scan: the picture is smeared.
    Smeared,
}

impl Wrong {
    /// Every kind.
    pub const ALL: [Wrong; 13] = [
        Wrong::Nothing,
        Wrong::Another,
        Wrong::Mirror,
        Wrong::Back,
        Wrong::Size,
        Wrong::Bent,
        Wrong::Trimmed,
        Wrong::Hidden,
        Wrong::OutOfView,
        Wrong::Symmetric,
        Wrong::CameraMoved,
        Wrong::Wet,
        Wrong::Smeared,
    ];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Wrong::Nothing => "no panel",
            Wrong::Another => "another panel",
            Wrong::Mirror => "mirror image",
            Wrong::Back => "its back",
            Wrong::Size => "2 to 5 % off in size",
            Wrong::Bent => "bent by 2 to 5 mm",
            Wrong::Trimmed => "a strip cut off",
            Wrong::Hidden => "over 40 % hidden",
            Wrong::OutOfView => "over 35 % out of view",
            Wrong::Symmetric => "symmetric",
            Wrong::CameraMoved => "camera moved",
            Wrong::Wet => "wet",
            Wrong::Smeared => "moved while scanned",
        }
    }
}

/// A scene with known truth.
#[derive(Debug, Clone)]
pub struct Trial {
    seed: Seed,
    taught: Shape,
    present: Option<Shape>,
    size_mm: [f64; 2],
    place: Rigid<Base, crate::geometry::Panel>,
    slabs: Vec<Slab>,
    glints: Vec<([f64; 2], f64)>,
    wet: bool,
    smear_px: usize,
    camera_now: Rigid<Base, Camera>,
    camera: PinholeCamera,
    rays: Rays,
    pixels: PixelNoise,
    hidden: f64,
}

impl Trial {
    /// A good scene, with camera pictures `reduction` times smaller than the real ones.
    pub fn good(seed: u64, reduction: usize) -> Trial {
        Trial::new(Seed(seed), None, reduction)
    }

    /// A scene with something wrong.
    pub fn bad(seed: u64, wrong: Wrong, reduction: usize) -> Trial {
        Trial::new(Seed(seed), Some(wrong), reduction)
    }

    fn new(seed: Seed, wrong: Option<Wrong>, reduction: usize) -> Trial {
        let camera = scene::scanner(reduction);
        let mut random = generator(seed, 0);
        let panel =
            if wrong == Some(Wrong::Symmetric) { Panel::symmetric(&mut random) } else { Panel::any(&mut random) };
        let mut trial = Trial {
            seed,
            taught: panel.shape(),
            present: Some(panel.shape()),
            size_mm: panel.size_mm,
            place: scene::nominal(),
            slabs: Vec::new(),
            glints: Vec::new(),
            wet: wrong == Some(Wrong::Wet),
            smear_px: if wrong == Some(Wrong::Smeared) { (13 / reduction).max(5) } else { 0 },
            camera_now: scene::base_from_camera(),
            camera,
            rays: Rays::new(&camera),
            pixels: PixelNoise::new(seed),
            hidden: 0.0,
        };
        trial.put(&mut generator(seed, 1), wrong);
        if let Some(wrong) = wrong {
            trial.spoil(&panel, wrong, &mut generator(seed, 2));
        }
        trial
    }

    /// Draws places until one is as it must be: before the fixture, in the box, and seen as far as it should be.
    fn put(&mut self, random: &mut Pcg64, wrong: Option<Wrong>) {
        let share = match wrong {
            Some(Wrong::Hidden) => 0.42..0.65,
            Some(Wrong::OutOfView) => 0.36..0.6,
            // What is cut off must be seen to be missing.
            Some(Wrong::Trimmed) => 0.0..1e-9,
            _ => 0.0..MAX_HIDDEN,
        };
        let shape = self.taught.clone();
        let lattice = lattice(&shape);
        loop {
            let tilt_deg = random.random_range(0.0..30.0);
            let turn_deg = random.random_range(-180.0..180.0);
            let aside = if wrong == Some(Wrong::OutOfView) { 400.0 } else { 160.0 };
            let centre = Vector3::new(
                random.random_range(450.0..590.0),
                random.random_range(-aside..aside),
                360.0 + random.random_range(-aside / 1.6..aside / 1.6),
            );
            self.place = placed(centre, turn_deg, tilt_deg, random.random_range(0.0..std::f64::consts::TAU));
            let points: Vec<Point3<f64>> = lattice.iter().map(|&at| (self.place * shape.point(at)).mm).collect();
            let [low, high] = TRIAL_BOX_MM;
            // What is out of view may be out of the box as well.
            let axes = if wrong == Some(Wrong::OutOfView) { 0..1 } else { 0..3 };
            let stands = points.iter().all(|p| {
                p.x < FARTHEST_X_MM
                    && axes.clone().all(|axis| p[axis] > low[axis] + 4.0 && p[axis] < high[axis] - 4.0)
            });
            if !stands || !self.faces(&lattice) {
                continue;
            }
            self.slabs = beside(random, &self.place);
            let covers = match wrong {
                Some(Wrong::Hidden) => 2,
                Some(Wrong::OutOfView) => 0,
                _ => random.random_range(0..3),
            };
            for _ in 0..covers {
                self.slabs.push(self.before(random, &lattice, wrong == Some(Wrong::Hidden)));
            }
            self.hidden = self.hidden_share(&lattice);
            if share.contains(&self.hidden) {
                break;
            }
        }
        for _ in 0..random.random_range(0..3) {
            let place = lattice[random.random_range(0..lattice.len())];
            self.glints.push((place, random.random_range(3.0..9.0)));
        }
    }

    fn spoil(&mut self, panel: &Panel, wrong: Wrong, random: &mut Pcg64) {
        let sign = if random.random::<bool>() { 1.0 } else { -1.0 };
        self.present = match wrong {
            Wrong::Nothing => None,
            Wrong::Another => Some(Panel::any(random).shape()),
            Wrong::Mirror => Some(panel.mirrored().shape()),
            Wrong::Back => Some(panel.back().shape()),
            Wrong::Size => Some(panel.scaled(1.0 + sign * random.random_range(0.02..0.05)).shape()),
            Wrong::Bent => Some(panel.bent(sign * random.random_range(2.0..5.0)).shape()),
            Wrong::Trimmed => Some(panel.trimmed(random.random_range(12.0..60.0)).shape()),
            _ => self.present.take(),
        };
        if wrong == Wrong::CameraMoved {
            let axis = |random: &mut Pcg64| Vector3::from_fn(|_, _| random.random_range(-1.0..1.0f64)).normalize();
            let shift = axis(random) * random.random_range(1.0..10.0);
            let turn = axis(random) * random.random_range(0.0..0.01);
            let moved: Rigid<Camera, Camera> = Rigid::claim(Isometry3::new(shift, turn));
            self.camera_now = scene::base_from_camera() * moved;
        }
        if wrong == Wrong::Nothing {
            // Something of the panel's size, and flat.
            let [length, width] = self.size_mm;
            let centre = (self.place * self.taught.point([0.0, 0.0])).mm;
            let normal = (self.place * self.taught.normal([0.0, 0.0])).mm;
            let spin = random.random_range(0.0..3.0);
            if sign > 0.0 {
                self.slabs.push(Slab::facing(centre, normal, spin, [length / 2.0, width / 2.0], [90.0; 3]));
            }
        }
    }

    /// Does every place of the panel look at the camera?
    fn faces(&self, lattice: &[[f64; 2]]) -> bool {
        let eye = scene::base_from_camera().origin();
        lattice.iter().all(|&at| {
            let (point, normal) = (self.place * self.taught.point(at), self.place * self.taught.normal(at));
            let towards = (eye - point).mm;
            normal.mm.dot(&towards) > 0.3 * towards.norm()
        })
    }

    /// A slab somewhere between the camera and a place of the panel.
    fn before(&self, random: &mut Pcg64, lattice: &[[f64; 2]], large: bool) -> Slab {
        let eye = scene::base_from_camera().origin().mm;
        let at = lattice[random.random_range(0..lattice.len())];
        let point = (self.place * self.taught.point(at)).mm;
        let towards = (eye - point).normalize();
        let centre = point + towards * random.random_range(60.0..180.0);
        let size = if large { 40.0..130.0 } else { 6.0..55.0 };
        let half = [random.random_range(size.clone()), random.random_range(size)];
        let gray = random.random_range(40.0..190.0);
        Slab::facing(centre, towards, random.random_range(0.0..3.0), half, [gray, gray, gray * 0.95])
    }

    fn hidden_share(&self, lattice: &[[f64; 2]]) -> f64 {
        let base_from_camera = scene::base_from_camera();
        let eye = base_from_camera.origin().mm;
        let hidden = |&&at: &&[f64; 2]| {
            let point = self.place * self.taught.point(at);
            let out = self.camera.project_inside(base_from_camera.inverse() * point).is_none();
            let ray = point.mm - eye;
            out || self.slabs.iter().any(|slab| is_before(slab, &eye, &ray))
        };
        lattice.iter().filter(hidden).count() as f64 / lattice.len() as f64
    }

    /// The 3D camera.
    pub fn camera(&self) -> &PinholeCamera {
        &self.camera
    }

    /// Where it stands, as its calibration says.
    pub fn base_from_camera(&self) -> Rigid<Base, Camera> {
        scene::base_from_camera()
    }

    /// The rectangle that the taught panel was cut from: length and width, mm.
    pub fn size_mm(&self) -> [f64; 2] {
        self.size_mm
    }

    /// The share of the panel that is hidden or out of view.
    pub fn hidden(&self) -> f64 {
        self.hidden
    }

    /// Where the panel stands.
    pub fn base_from_panel(&self) -> Rigid<Base, crate::geometry::Panel> {
        self.place
    }

    /// A region in the middle of the taught scan's picture: top left, top right, bottom right, bottom left.
    pub fn region_px(&self) -> [Pixel; 4] {
        let [s, t] = self.size_mm.map(|mm| 0.2 * mm);
        [[-s, t], [s, t], [s, -t], [-s, -t]].map(|at| {
            let seen = scene::base_from_camera().inverse() * (scene::nominal() * self.taught.point(at));
            self.camera.project(seen).unwrap_or_default()
        })
    }

    /// How far a found place puts the panel's surface from where it is.
    pub fn error_mm(&self, found: &Rigid<Base, crate::geometry::Panel>) -> PlacementError {
        let points = lattice(&self.taught);
        let errors = points.iter().map(|&at| self.place.distance_at_mm(*found, self.taught.point(at)));
        let (sum_mm, max_mm) = errors.fold((0.0, 0.0_f64), |(sum, max), error| (sum + error, max.max(error)));
        PlacementError { mean_mm: sum_mm / points.len() as f64, max_mm }
    }

    /// The scan that teaches the panel, at its nominal place and without clutter.
    pub fn taught_scan(&self) -> OrganizedCloud<Camera> {
        let nominal = scene::nominal();
        let base_from_camera = scene::base_from_camera();
        let view = View::new(&self.camera, &self.rays, &base_from_camera, Some((&self.taught, &nominal)));
        self.capture(&view, &base_from_camera, (&[], &[], false, 0), 0)
    }

    /// The scan of the scene.
    pub fn scan(&self) -> OrganizedCloud<Camera> {
        let panel = self.present.as_ref().map(|shape| (shape, &self.place));
        let view = View::new(&self.camera, &self.rays, &self.camera_now, panel);
        self.capture(&view, &self.camera_now, (&self.slabs, &self.glints, self.wet, self.smear_px), 1)
    }

    fn capture(
        &self,
        view: &View<'_>,
        base_from_camera: &Rigid<Base, Camera>,
        (slabs, glints, wet, smear_px): (&[Slab], &[([f64; 2], f64)], bool, usize),
        shot: u64,
    ) -> OrganizedCloud<Camera> {
        let seed = self.seed.child(Purpose::Trial, 10 + shot);
        let (width, height) = (view.width(), view.height());
        let mut points = vec![[f32::NAN; 3]; width * height];
        let mut colors = vec![[0_u8; 3]; width * height];
        let lattice_mm = seed.stream(Purpose::Scan, 0).random_range(50.0..85.0);
        let correlated = ValueNoise::new(seed.stream(Purpose::Scan, 1), lattice_mm, 260.0);
        let puddles = ValueNoise::new(seed.stream(Purpose::Scan, 2), 14.0, 260.0);
        let (eye, turn) = (base_from_camera.origin().mm, base_from_camera.rotation());
        let pixel_rad = 1.0 / self.camera.fx_px;
        let rows = points.par_chunks_mut(width).zip(colors.par_chunks_mut(width)).enumerate();
        rows.for_each(|(row, (points, colors))| {
            let mut normal = Normal::new(seed.stream(Purpose::ScanRow, row as u64));
            let mut chance = seed.stream(Purpose::Trial, row as u64);
            let noise = self.pixels.row(seed, row, width);
            let mut line = vec![[0_u16; 3]; width];
            view.look_along_row(row, |column, sight| {
                let ray = turn * sight.ray;
                let met: Vec<Met> = slabs.iter().filter_map(|slab| slab.look(&eye, &ray, pixel_rad)).collect();
                let (sight, veil) = among(sight, &met);
                let (dry, film) = dry_and_wet(&sight);
                line[column] = if wet { film } else { dry };
                let glint = sight.panel.is_some_and(|panel| {
                    glints.iter().any(|(at, r)| (panel.place[0] - at[0]).hypot(panel.place[1] - at[1]) < *r)
                });
                if glint {
                    line[column] = [255 * LEVEL as u16; 3];
                }
                let mut point = measured(&sight, &correlated, &mut normal);
                let lucky = chance.random::<f64>();
                if veil.is_some_and(|share| (0.05..0.95).contains(&share)) && lucky < 0.75 || glint && lucky < 0.8 {
                    point = None;
                } else if glint {
                    point = point.map(|p| p.map(|x| x * 0.996));
                }
                if let (true, Some(panel)) = (wet, sight.panel) {
                    let film = puddles.at(panel.place);
                    if film > -0.1 && lucky < 0.85 {
                        point = None;
                    } else if film > -0.4 {
                        point = point.map(|p| p.map(|x| x * (1.0 + 0.002 * film as f32)));
                    }
                }
                points[column] = point.unwrap_or([f32::NAN; 3]);
            });
            for (column, color) in colors.iter_mut().enumerate() {
                *color = to_bytes(smeared(&line, column, smear_px), noise, column);
            }
        });
        match OrganizedCloud::new(width, height, points, colors) {
            Ok(cloud) => cloud,
            Err(error) => unreachable!("one point and one colour a pixel were made: {error}"),
        }
    }
}

/// The mean of a pixel and its neighbours along the row.
fn smeared(line: &[[u16; 3]], column: usize, smear_px: usize) -> [u16; 3] {
    let (from, to) = (column.saturating_sub(smear_px / 2), (column + smear_px / 2).min(line.len() - 1));
    let count = (to - from + 1) as u32;
    std::array::from_fn(|channel| {
        (line[from..=to].iter().map(|c| u32::from(c[channel])).sum::<u32>() / count) as u16
    })
}

/// What a pixel sees with slabs before and behind the panel; and the share that the nearest slab before it fills.
fn among(mut sight: Sight, met: &[Met]) -> (Sight, Option<f64>) {
    let panel_mm = sight.panel.map_or(f64::INFINITY, |panel| panel.depth_mm);
    let paint = |under: [f64; 3], slab: &Met| {
        std::array::from_fn(|channel| under[channel] + slab.share * (slab.color[channel] - under[channel]))
    };
    let mut veil: Option<f64> = None;
    // Far ones first, so that near ones are painted over them.
    let mut sorted: Vec<&Met> = met.iter().collect();
    sorted.sort_by(|a, b| b.depth_mm.total_cmp(&a.depth_mm));
    for slab in sorted {
        let behind = slab.depth_mm > panel_mm;
        let farther = sight.background.depth_mm.is_some_and(|depth_mm| depth_mm < slab.depth_mm);
        if behind && farther {
            continue;
        }
        if !behind {
            veil = Some(slab.share);
            // A pixel that is half slab shows one of the two, and the slab's colour over what is behind.
            if slab.share < 0.5 {
                continue;
            }
            sight.panel = None;
        }
        let color = paint(sight.background.color, slab);
        sight.background = if slab.share >= 0.5 {
            Background { depth_mm: Some(slab.depth_mm), cos_incidence: slab.cos_incidence, color }
        } else {
            Background { color, ..sight.background }
        };
    }
    (sight, veil)
}

/// Does a slab stand between the eye and the end of a ray?
fn is_before(slab: &Slab, eye: &Point3<f64>, ray: &Vector3<f64>) -> bool {
    let length_mm = ray.norm();
    let met = slab.look(eye, &(ray / length_mm), 1e-6);
    met.is_some_and(|met| met.share > 0.5 && met.depth_mm < length_mm - 1.0)
}

/// A place by the panel's centre, its turn about the normal, and its tilt about a direction in the plane.
fn placed(
    centre: Vector3<f64>,
    turn_deg: f64,
    tilt_deg: f64,
    about_rad: f64,
) -> Rigid<Base, crate::geometry::Panel> {
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), turn_deg.to_radians());
    let axis = Unit::new_normalize(Vector3::new(0.0, about_rad.cos(), about_rad.sin()));
    let rotation =
        UnitQuaternion::from_rotation_matrix(&(Rotation3::from_axis_angle(&axis, tilt_deg.to_radians()) * turn));
    Rigid::claim(Isometry3::from_parts(Translation3::from(centre - rotation * Vector3::from(CENTRE_MM)), rotation))
}

/// Things beside and behind the panel, in the box, none of which hides it.
fn beside(random: &mut Pcg64, place: &Rigid<Base, crate::geometry::Panel>) -> Vec<Slab> {
    let middle = place.isometry() * Point3::from(CENTRE_MM);
    let count = random.random_range(2..6);
    (0..count)
        .map(|_| {
            let angle = random.random_range(0.0..std::f64::consts::TAU);
            let away = random.random_range(150.0..330.0);
            let centre = Point3::new(
                random.random_range(540.0..632.0),
                middle.y + away * angle.cos(),
                middle.z + away * angle.sin(),
            );
            let normal = Vector3::new(-1.0, random.random_range(-0.7..0.7), random.random_range(-0.7..0.7));
            let half = [random.random_range(8.0..60.0), random.random_range(8.0..60.0)];
            let gray = random.random_range(30.0..200.0);
            Slab::facing(centre, normal.normalize(), random.random_range(0.0..3.0), half, [gray, gray, 0.9 * gray])
        })
        .collect()
}

/// Places of the sheet on the panel, 8 mm apart.
fn lattice(shape: &Shape) -> Vec<[f64; 2]> {
    let places = (-26..=26).flat_map(|j| (-26..=26).map(move |i| [f64::from(i) * 8.0, f64::from(j) * 8.0]));
    places.filter(|&at| shape.outline().distance(Vector2::from(at)).0 < 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A good panel stands in the box, before the fixture, and most of it is seen; the scan has points where it stands.
    #[test]
    fn good_trials_are_good() {
        for seed in 0..6 {
            let trial = Trial::good(seed, 4);
            assert!(trial.hidden() < 0.2, "{}", trial.hidden());
            let scan = trial.scan();
            let camera_from_base = trial.base_from_camera().inverse();
            let (mut near, mut seen) = (0, 0);
            for at in lattice(&trial.taught) {
                let point = camera_from_base * (trial.base_from_panel() * trial.taught.point(at));
                let Some(pixel) = trial.camera().project_inside(point) else { continue };
                let Some((column, row)) = pixel.whole(scan.width(), scan.height()) else { continue };
                seen += 1;
                near += usize::from(scan.point(column, row).is_some_and(|p| (p.mm.z - point.mm.z).abs() < 2.0));
            }
            assert!(near as f64 > 0.7 * f64::from(seen), "seed {seed}: {near} of {seen}");
        }
    }

    #[test]
    fn bad_trials_are_bad() {
        assert!(Trial::bad(1, Wrong::Hidden, 8).hidden() > 0.4);
        assert!(Trial::bad(1, Wrong::OutOfView, 8).hidden() > 0.35);
        let wet = Trial::bad(1, Wrong::Wet, 8).scan().valid().count();
        assert!(wet < Trial::good(1, 8).scan().valid().count());
        let moved = Trial::bad(1, Wrong::CameraMoved, 8);
        assert!((moved.camera_now.origin() - moved.base_from_camera().origin()).mm.norm() > 0.9);
    }
}
