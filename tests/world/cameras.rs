//! The cameras of a world. Pictures are rendered once for each possible view and stored for all worlds of the process.
//! The key of a scan is the contents of the cell; that of a picture of the film, the greasy places and its time in
//! steps; that of a corner, the pose of the flange. Rendering takes most of a cycle's computing time, and two equal
//! views give equal pictures.

use super::fixture::{CellContents, Fixture};
use super::inside::{Inside, Shared};
use super::judges;
use super::script::CameraHarm;
use panelprep::cycle::Action;
use panelprep::daemon::{CameraAnswer, CameraCommand, CameraFault, Picture2d, Port};
use panelprep::devices::world::TouchedPoints;
use panelprep::geometry::{Base, Camera, ColorPicture, Flange, KukaPose, OrganizedCloud, Rigid};
use panelprep::sim::{Film, SPRAY_FROM_S, WET_FROM_S};
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

/// Minimum fraction of a greasy spot's area that the disc must cover to remove the spot.
const MIN_REMOVED_FRACTION: f64 = 0.9;
/// Interval between rendered pictures of the film, s.
const PICTURE_INTERVAL_S: f64 = 2.0;
/// Factor by which the films of this cell break faster than those of the renderer, so that five seconds show as much as
/// a minute.
const FILM_SPEED_FACTOR: f64 = 8.0;
/// Maximum number of stored pictures of each kind.
const MAX_CACHED_PICTURES: usize = 4_000;

/// For each greasy spot, whether it is removed.
type Healed = Vec<bool>;

/// Pictures that were already rendered.
#[derive(Default)]
struct Rendered {
    scans: BTreeMap<CellContents, Arc<OrganizedCloud<Camera>>>,
    films: BTreeMap<(CellContents, Healed), Arc<Film>>,
    film: BTreeMap<(CellContents, Healed, i64), Arc<ColorPicture>>,
    corners: BTreeMap<(CellContents, [i64; 6]), Arc<ColorPicture>>,
}

static RENDERED: LazyLock<Mutex<Rendered>> = LazyLock::new(Mutex::default);

fn rendered() -> MutexGuard<'static, Rendered> {
    RENDERED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A film in progress.
struct FilmInProgress {
    /// Time at which the film began, ms; `began_s` is this time on the camera's clock, s.
    began_ms: u64,
    began_s: f64,
    per_second: f64,
    taken: u32,
}

/// Number of parts into which the camera's clock divides a second. The pictures of a film are captured at these times,
/// at whole periods, so that the times between pictures are equal numbers in each film.
const CLOCK_PARTS: f64 = 64.0;

/// Returns the number of stored pictures that all worlds share, and their size, bytes.
pub fn stored_pictures() -> (usize, usize) {
    let rendered = rendered();
    let pictures = rendered.film.values().chain(rendered.corners.values());
    pictures.fold((0, 0), |(count, bytes), picture| (count + 1, bytes + 3 * picture.rgb.len()))
}

/// Both cameras as one port.
pub struct Cameras {
    world: Shared,
    film: Option<FilmInProgress>,
    healed: Healed,
    /// Time of the last wetting that `healed` takes into account, ms.
    healed_at_ms: Option<u64>,
    /// The last picture, which a frozen camera returns again.
    last: Option<Picture2d>,
}

impl Cameras {
    /// Returns the cameras of this world.
    pub fn new(world: Shared) -> Self {
        let spots = Fixture::shared().scene(CellContents::Greasy).spots().len();
        Cameras { world, film: None, healed: vec![false; spots], healed_at_ms: None, last: None }
    }

    /// Returns the scanner's picture of the present, or of this moment of a film.
    fn picture(&mut self, taken: Option<(u64, f64)>) -> Picture2d {
        let world = self.world.clone();
        let world = world.lock();
        let water = world.lock_around().water;
        if let Some((on_ms, _)) = water.filter(|(on_ms, _)| self.healed_at_ms != Some(*on_ms)) {
            self.heal(&world, on_ms);
        }
        let now_ms = world.now_ms();
        let (taken_ms, time_s) = taken.unwrap_or((now_ms, now_ms as f64 / 1e3));
        let step = (film_s(water, taken_ms) / PICTURE_INTERVAL_S).round() as i64;
        let picture = film_picture(world.stands.with_initial_appearance(), &self.healed, step);
        let picture = if world.is_dark() { black(&picture) } else { (*picture).clone() };
        Picture2d { picture, time_s }
    }

    /// Marks the spots that the disc covered before this wetting: the film holds on them from now on.
    fn heal(&mut self, world: &Inside, on_ms: u64) {
        let fixture = Fixture::shared();
        let disc_mm = fixture.cycle.recipe.path().disc_diameter_mm();
        let touched = TouchedPoints::reached_by_disc(&world.trace(on_ms), fixture.truth(), disc_mm);
        let takes_off = world.stands != CellContents::Stubborn;
        let share = |spot| takes_off && touched.covered_share(spot) >= MIN_REMOVED_FRACTION;
        self.healed = fixture.truth().spots.iter().map(share).collect();
        self.healed_at_ms = Some(on_ms);
    }

    fn next_of_film(&mut self) -> CameraAnswer {
        let now_ms = self.world.lock().now_ms();
        let Some(FilmInProgress { began_ms, began_s, per_second, taken }) = &mut self.film else {
            return CameraAnswer::NoneDue;
        };
        let since_s = f64::from(*taken) / *per_second;
        let due_ms = *began_ms + (since_s * 1e3).ceil() as u64;
        if now_ms < due_ms {
            return CameraAnswer::NoneDue;
        }
        *taken += 1;
        let moment = (due_ms, *began_s + since_s);
        CameraAnswer::Picture(self.picture(Some(moment)))
    }

    fn scan(&self) -> OrganizedCloud<Camera> {
        let stands = self.world.lock().stands.with_initial_appearance();
        let render = || Arc::new(Fixture::shared().scan(stands));
        (**rendered().scans.entry(stands).or_insert_with(render)).clone()
    }

    fn corner(&self) -> ColorPicture {
        let world = self.world.lock();
        let pose = world.cell.controller.flange_pose();
        let picture = corner_picture(world.stands.with_initial_appearance(), &pose);
        let is_shut = world.lock_around().is_lens_shut(world.now_ms());
        if is_shut { black(&picture) } else { (*picture).clone() }
    }

    /// Returns the answer of a camera with this fault, if it differs from that of an intact camera.
    fn faulty_answer(
        &mut self,
        harm: CameraHarm,
        command: CameraCommand,
    ) -> Option<Result<CameraAnswer, CameraFault>> {
        let flange = matches!(command, CameraCommand::CornerPicture);
        let camera = if flange { "the flange camera" } else { "the scanner" };
        let fault = |why: &str| CameraFault { camera, why: why.to_owned() };
        let takes = !matches!(command, CameraCommand::BeginFilm(_) | CameraCommand::EndFilm | CameraCommand::Check);
        match harm {
            CameraHarm::Lost if command == CameraCommand::Check => {
                Some(Ok(CameraAnswer::Checked(vec![fault("it does not answer")])))
            }
            CameraHarm::Lost => Some(Err(fault("it does not answer"))),
            CameraHarm::Hot if takes => Some(Err(fault("its housing is at 71 °C, allowed are 60 °C"))),
            CameraHarm::WrongSize if takes && command != CameraCommand::Scan => {
                let picture = ColorPicture::uniform(7, 5, [90; 3]);
                Some(Ok(if flange {
                    CameraAnswer::Corner(picture)
                } else {
                    let time_s = self.world.lock().now_ms() as f64 / 1e3;
                    CameraAnswer::Picture(Picture2d { picture, time_s })
                }))
            }
            CameraHarm::Dark if flange => Some(Ok(CameraAnswer::Corner(black(&self.corner())))),
            CameraHarm::Dark if command == CameraCommand::Picture => {
                let Picture2d { picture, time_s } = self.picture(None);
                Some(Ok(CameraAnswer::Picture(Picture2d { picture: black(&picture), time_s })))
            }
            CameraHarm::Frozen if command == CameraCommand::Picture => {
                self.last.clone().map(|last| Ok(CameraAnswer::Picture(last)))
            }
            CameraHarm::Frozen if command == CameraCommand::NextOfFilm => {
                let answer = self.next_of_film();
                let (CameraAnswer::Picture(taken), Some(last)) = (&answer, &self.last) else {
                    return Some(Ok(answer));
                };
                let frozen = Picture2d { picture: last.picture.clone(), time_s: taken.time_s };
                Some(Ok(CameraAnswer::Picture(frozen)))
            }
            _ => None,
        }
    }
}

impl Port<CameraCommand> for Cameras {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        let harm = {
            let world = self.world.lock();
            let flange = matches!(command, CameraCommand::CornerPicture);
            let now_ms = world.now_ms();
            world.cameras[usize::from(flange)].filter(|(_, until_ms)| now_ms < *until_ms)
        };
        if let Some(answer) = harm.and_then(|(harm, _)| self.faulty_answer(harm, command)) {
            return answer;
        }
        let answer = match command {
            CameraCommand::Scan => CameraAnswer::Scan(self.scan()),
            CameraCommand::Picture => CameraAnswer::Picture(self.picture(None)),
            CameraCommand::BeginFilm(per_second) => {
                let now_ms = self.world.lock().now_ms();
                let began_s = (now_ms as f64 / 1e3 * CLOCK_PARTS).ceil() / CLOCK_PARTS;
                self.film = Some(FilmInProgress { began_ms: now_ms, began_s, per_second, taken: 0 });
                CameraAnswer::FilmBegan(began_s)
            }
            CameraCommand::NextOfFilm => self.next_of_film(),
            CameraCommand::EndFilm => {
                self.film = None;
                CameraAnswer::FilmEnded(0)
            }
            CameraCommand::CornerPicture => CameraAnswer::Corner(self.corner()),
            CameraCommand::Check => CameraAnswer::Checked(vec![]),
        };
        if let CameraAnswer::Picture(picture) = &answer {
            self.last = Some(picture.clone());
        }
        Ok(answer)
    }
}

/// Returns the time in the film. It also increases before there is water, so that no two pictures have the same noise.
fn film_s(water: Option<(u64, Option<u64>)>, now_ms: u64) -> f64 {
    let seconds = |ms: u64| ms as f64 / 1e3;
    let Some((on_ms, off_ms)) = water else { return -1.0 - seconds(now_ms % 4_000) };
    let reached_s = SPRAY_FROM_S + seconds(off_ms.unwrap_or(now_ms).saturating_sub(on_ms));
    match off_ms {
        Some(off_ms) if reached_s >= WET_FROM_S => {
            WET_FROM_S + FILM_SPEED_FACTOR * seconds(now_ms.saturating_sub(off_ms))
        }
        _ => reached_s.min(WET_FROM_S),
    }
}

fn film_picture(stands: CellContents, healed: &Healed, step: i64) -> Arc<ColorPicture> {
    let mut rendered = rendered();
    let key = (stands, healed.clone(), step);
    if let Some(picture) = rendered.film.get(&key) {
        return picture.clone();
    }
    let scene = Fixture::shared().scene(stands);
    let film = rendered.films.entry((stands, healed.clone())).or_insert_with(|| {
        let left = scene.spots().iter().zip(healed).filter(|(_, healed)| !**healed).map(|(spot, _)| spot.clone());
        Arc::new(scene.film_with_spots(&left.collect::<Vec<_>>()))
    });
    let picture = Arc::new(film.picture(step as f64 * PICTURE_INTERVAL_S));
    if rendered.film.len() < MAX_CACHED_PICTURES {
        rendered.film.insert(key, picture.clone());
    }
    picture
}

fn corner_picture(stands: CellContents, base_from_flange: &Rigid<Base, Flange>) -> Arc<ColorPicture> {
    let key = (stands, rounded(base_from_flange));
    let mut rendered = rendered();
    if let Some(picture) = rendered.corners.get(&key) {
        return picture.clone();
    }
    let place = Fixture::shared().truth().base_from_panel;
    // The picture is rendered from the rounded pose in the key, so that it does not depend on which caller is first.
    let [x_mm, y_mm, z_mm, a_deg, b_deg, c_deg] = key.1.map(|number| number as f64 / 1e3);
    let from = KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg }.to_rigid();
    let picture = Arc::new(Fixture::shared().scene(stands).flange_picture_at(&from, &place));
    if rendered.corners.len() < MAX_CACHED_PICTURES {
        rendered.corners.insert(key, picture.clone());
    }
    picture
}

/// Returns a pose in thousandths of a millimetre and of a degree.
fn rounded(base_from_flange: &Rigid<Base, Flange>) -> [i64; 6] {
    let pose = KukaPose::from_rigid(base_from_flange);
    let numbers = [pose.x_mm, pose.y_mm, pose.z_mm, pose.a_deg, pose.b_deg, pose.c_deg];
    numbers.map(|number| (number * 1e3).round() as i64)
}

/// Returns a hash of the pictures that this world's cameras would capture, to find results that were computed before.
/// `None` if one of the cameras has a fault.
pub fn view_hash(world: &Shared, act: Action) -> Option<u64> {
    let mut world = world.lock();
    let now_ms = world.now_ms();
    if act == Action::Locate {
        judges::scans(&mut world);
    }
    if world.cameras.iter().flatten().any(|(_, until_ms)| now_ms < *until_ms) {
        return None;
    }
    let is_shut = world.lock_around().is_lens_shut(now_ms);
    let mut hasher = DefaultHasher::new();
    (world.stands.with_initial_appearance(), is_shut).hash(&mut hasher);
    if matches!(act, Action::Refine { .. } | Action::Verify { .. }) {
        rounded(&world.cell.controller.flange_pose()).hash(&mut hasher);
    }
    Some(hasher.finish())
}

fn black(picture: &ColorPicture) -> ColorPicture {
    ColorPicture::uniform(picture.width, picture.height, [0; 3])
}
