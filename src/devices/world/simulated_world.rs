//! The simulated world: its contents, its changes, and the views of its cameras.

use super::state::{SandedArea, Signal, SimulatedLine, Violation, WorldState, film_s, seconds};
use super::touch::TouchedPoints;
use crate::cameras::{CameraError, FlangePicture, Picture, Shot};
use crate::mock::{self, ChannelFile, ContactSample, Controller, Setup};
use panelprep_base::geometry::{Base, ColorPicture, Flange, Joints, Mask, OrganizedCloud, Rigid};
use panelprep_cell::cell::{self, Feedback, Output};
use panelprep_sim as sim;
use panelprep_sim::{CellTruth, Film, GreasySpot, SandingStrength, WET_FROM_S};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Minimum fraction of a spot's area that the disc must cover to remove the grease.
const MIN_REMOVED_FRACTION: f64 = 0.9;
/// Maximum deviation of an axis from its park angle at which the arm is treated as parked, degrees.
const MAX_PARK_DEVIATION_DEG: f64 = 0.1;

/// The reason why no simulated world can be created for a cell file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WorldError {
    /// The cell file has no number for an output or feedback.
    #[error("[io.{table}] {name} is missing; the simulated world needs its number")]
    Unnamed {
        /// `outputs` or `feedbacks`.
        table: &'static str,
        /// The name.
        name: &'static str,
    },
    /// The cell file has no park pose.
    #[error("[poses] park is missing; a 3D shot is taken only in this pose")]
    NoPark,
    /// The cell file does not name the signals of a production line.
    #[error("a simulated line needs all of its signals in the cell's file; the manual's page line.md lists them")]
    NoLine,
}

/// The state of the robot at one instant: time, pose and motion.
#[derive(Debug, Clone, Copy)]
pub struct RobotMoment {
    pub(super) time_ms: u64,
    pub(super) joints: Joints,
    pub(super) base_from_flange: Rigid<Base, Flange>,
    pub(super) moving: bool,
}

impl RobotMoment {
    /// Returns the time since the start of the controller, ms.
    pub fn time_ms(&self) -> u64 {
        self.time_ms
    }

    /// Returns the flange pose.
    pub fn base_from_flange(&self) -> Rigid<Base, Flange> {
        self.base_from_flange
    }

    /// Returns the current state of the robot from its controller.
    pub fn from_controller(controller: &Controller) -> Self {
        RobotMoment {
            time_ms: controller.time_ms(),
            joints: controller.joints(),
            base_from_flange: controller.flange_pose(),
            moving: controller.is_moving(),
        }
    }
}

/// The simulated world; all clones share the same world.
#[derive(Clone)]
pub struct SimulatedWorld {
    fixed: Arc<FixedWorld>,
    state: Arc<Mutex<WorldState>>,
}

struct FixedWorld {
    cell: sim::Cell,
    truth: CellTruth,
    park: Joints,
}

impl SimulatedWorld {
    /// Creates the world of this simulated cell, connected as the cell file states. Before a disc is mounted, nothing
    /// is sanded: see [`SimulatedWorld::mount_disc`].
    ///
    /// # Errors
    /// If the cell file has no number for an output or feedback of the process, or no park pose.
    pub fn new(simulated: sim::Cell, cell: &cell::Cell) -> Result<Self, WorldError> {
        let signal = |output: Output| {
            let unnamed = |table, name| WorldError::Unnamed { table, name };
            let number = cell.inputs_outputs().output(output).ok_or(unnamed("outputs", output.name()))?;
            let feedback = output.feedback();
            let feedback = cell.inputs_outputs().feedback(feedback).ok_or(unnamed("feedbacks", feedback.name()))?;
            Ok(Signal::new(output, number, feedback))
        };
        let signals = Output::ALL.iter().copied().map(signal).collect::<Result<Vec<Signal>, _>>()?;
        let park = cell.park_pose().ok_or(WorldError::NoPark)?;
        let truth = simulated.truth();
        let mut state = WorldState::new(signals, truth.spots.len());
        state.tool_stands = cell.inputs_outputs().feedback(Feedback::ToolStands);
        let fixed = FixedWorld { cell: simulated, truth, park };
        Ok(SimulatedWorld { fixed: Arc::new(fixed), state: Arc::new(Mutex::new(state)) })
    }

    /// Adds a production line to the cell, which brings this number of equal parts.
    ///
    /// # Errors
    /// If the cell file does not name the signals of the line.
    pub fn bring_parts(&self, parts: u32, cell: &cell::Cell) -> Result<(), WorldError> {
        self.lock().line = Some(SimulatedLine::new(cell.inputs_outputs(), parts).ok_or(WorldError::NoLine)?);
        Ok(())
    }

    /// Mounts a sanding disc of this diameter; from now on the disc sands the area that it covers.
    pub fn mount_disc(&self, diameter_mm: f64) {
        self.lock().disc_diameter_mm = diameter_mm;
    }

    /// Dries the panel, as a person who wipes it does.
    pub fn dry_panel(&self) {
        self.lock().wetting = None;
    }

    /// Returns the configuration of a mock controller in this world: its inputs, its outputs and the output of the tool
    /// are those of the cell file, in the order of their numbers.
    pub fn mock_setup(&self, cell: &cell::Cell, commands: ChannelFile, states: ChannelFile) -> Setup {
        let numbers = |names: &std::collections::BTreeMap<String, u16>| {
            let mut numbers: Vec<u16> = names.values().copied().collect();
            numbers.sort_unstable();
            numbers
        };
        Setup {
            real_arm: self.fixed.cell.real_arm().cloned(),
            inputs: numbers(cell.inputs_outputs().feedbacks()),
            outputs: numbers(cell.inputs_outputs().outputs()),
            tool_output: cell.inputs_outputs().output(Output::Tool),
            off_delays_ms: (cell.inputs_outputs().off_delays_s().iter())
                .filter_map(|(name, after_s)| {
                    Some((*cell.inputs_outputs().outputs().get(name)?, 1_000 * u64::from(*after_s)))
                })
                .collect(),
            line_outputs: cell.inputs_outputs().line_outputs(),
            // Any flags are suitable, because nothing in this world reads them.
            mapped_inputs: (860..)
                .zip(cell.inputs_outputs().mapped_inputs().values())
                .map(|(flag, input)| (*input, flag))
                .collect(),
            ..Setup::new(commands, states)
        }
    }

    /// The controller's terminals.
    pub fn terminals(&self) -> Box<dyn mock::World> {
        Box::new(Terminals(self.clone()))
    }

    /// Returns the ground truth of the cell, only for scores.
    pub fn truth(&self) -> &CellTruth {
        &self.fixed.truth
    }

    /// Returns the ground truth, only for scores: the spots that were greasy at the last wetting, where no film holds.
    pub fn greasy_spots(&self) -> Vec<GreasySpot> {
        self.fixed.greasy_spots(&self.lock().removed_grease.1)
    }

    /// Returns the ground truth, only for scores: for each recorded wetting of this part, in order, the pixels at which
    /// the film was broken in the last picture.
    pub fn true_breaks(&self) -> Vec<Mask> {
        let watched = self.lock().watched_films.clone();
        watched.iter().map(|(_, film, film_s)| film.broken_pixels(*film_s)).collect()
    }

    /// Returns the violations of the process rules, each with the controller's time, ms.
    pub fn violations(&self) -> Vec<(u64, Violation)> {
        self.lock().violations.clone()
    }

    fn lock(&self) -> MutexGuard<'_, WorldState> {
        // The lock is used even after a panic. Otherwise the failure of a test that holds the lock would be hidden by a
        // second failure here.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn record_violation(&self, now: &RobotMoment, violation: Violation) {
        self.lock().violations.push((now.time_ms, violation));
    }

    /// Captures a 3D scan.
    ///
    /// # Errors
    /// If the arm is not parked, or moves.
    pub fn scan(&self, now: &RobotMoment) -> Result<Shot, CameraError> {
        let axis_off_deg = now.joints.max_difference_deg(&self.fixed.park);
        if now.moving || axis_off_deg > MAX_PARK_DEVIATION_DEG {
            self.record_violation(now, Violation::ArmInView);
            return Err(CameraError::ArmInView { axis_off_deg, moving: now.moving });
        }
        if self.lock().signal(Output::Light).on {
            self.record_violation(now, Violation::LightDuring3d);
        }
        let (shot, covered) = {
            let mut state = self.lock();
            state.shots += 1;
            (state.shots - 1, state.signal(Output::LensShutter).is_running(now.time_ms))
        };
        let cloud = self.fixed.cell.scan_at(&self.fixed.truth.base_from_panel, shot);
        Ok(Shot { cloud: if covered { black_shot(cloud) } else { cloud }, time_s: seconds(now.time_ms) })
    }

    /// Returns the time up to which sanding must be applied before the next picture: the time at which the water was
    /// last switched on. `None` if it was already applied.
    pub fn abrasion_due_until(&self) -> Option<u64> {
        let state = self.lock();
        state.wetting.map(|wetting| wetting.on_ms).filter(|on_ms| state.removed_grease.0 != Some(*on_ms))
    }

    /// Applies the motions of the trace. After the next wetting, the film holds on the spots that the disc has covered.
    /// The dry appearance of the panel changes where the disc was since the previous wetting.
    pub fn abrade(&self, trace: &[ContactSample]) {
        let FixedWorld { cell, truth, .. } = &*self.fixed;
        let (disc_diameter_mm, since_ms, mut sanded) = {
            let state = self.lock();
            (state.disc_diameter_mm, state.part_since_ms, state.sanded.clone())
        };
        let from = |time_ms: u64| &trace[trace.partition_point(|sample| sample.time_ms < time_ms)..];
        let touched = TouchedPoints::reached_by_disc(from(since_ms), truth, disc_diameter_mm);
        let healed = truth.spots.iter().map(|spot| touched.covered_share(spot) >= MIN_REMOVED_FRACTION).collect();
        let new = TouchedPoints::reached_by_disc(from(sanded.until_ms.max(since_ms)), truth, disc_diameter_mm);
        sanded.until_ms = trace.last().map_or(sanded.until_ms, |last| last.time_ms + 1);
        if !new.centres().is_empty() && disc_diameter_mm > 0.0 {
            let sanding = Arc::make_mut(&mut sanded.sanding);
            cell.sand(sanding, new.centres(), disc_diameter_mm / 2.0, SandingStrength::TYPICAL);
            sanded.passes += 1;
        }
        let mut state = self.lock();
        state.removed_grease = (state.wetting.map(|wetting| wetting.on_ms), healed);
        state.sanded = sanded;
    }

    /// Captures a colour picture with the fixed camera.
    pub fn picture(&self, now: &RobotMoment) -> Picture {
        let (wetting, light) = {
            let state = self.lock();
            let covered = state.signal(Output::LensShutter).is_running(now.time_ms);
            let light = if covered { 0.0 } else { state.signal(Output::Light).share(now.time_ms) };
            (state.wetting, light)
        };
        let (film, film_s) = (self.film(), film_s(wetting, now.time_ms));
        if let Some(wetting) = wetting.filter(|_| film_s >= WET_FROM_S) {
            let mut state = self.lock();
            state.watched_films.pop_if(|(on_ms, ..)| *on_ms == wetting.on_ms);
            state.watched_films.push((wetting.on_ms, film.clone(), film_s));
        }
        let mut picture = film.picture(film_s);
        dim_picture(&mut picture, light);
        Picture { picture, time_s: seconds(now.time_ms) }
    }

    /// Returns the film for the current greasy spots and the current appearance of the panel. It is computed only if
    /// one of them has changed. The world is not locked during the computation, because a controller must not wait for
    /// it.
    fn film(&self) -> Arc<Film> {
        let (healed, SandedArea { sanding, passes, .. }, last) = {
            let state = self.lock();
            (state.removed_grease.1.clone(), state.sanded.clone(), state.film.clone())
        };
        let of = (healed, passes);
        if let Some((_, film)) = last.filter(|(known, _)| *known == of) {
            return film;
        }
        let greasy = self.fixed.greasy_spots(&of.0);
        let film = Arc::new(match passes {
            0 => self.fixed.cell.film_with_spots(&greasy),
            _ => self.fixed.cell.sanded_film(&greasy, &sanding, passes),
        });
        self.lock().film = Some((of, film.clone()));
        film
    }

    /// Captures a picture with the flange camera, from the true pose of the arm.
    ///
    /// # Errors
    /// If the arm moves.
    pub fn flange_picture(&self, now: &RobotMoment) -> Result<FlangePicture, CameraError> {
        if now.moving {
            self.record_violation(now, Violation::ArmMoves);
            return Err(CameraError::ArmMoves);
        }
        let FixedWorld { cell, truth, .. } = &*self.fixed;
        let mut picture = cell.flange_picture_at(&now.base_from_flange, &truth.base_from_panel);
        if self.lock().signal(Output::LensShutter).is_running(now.time_ms) {
            dim_picture(&mut picture, 0.0);
        }
        Ok(FlangePicture { picture, base_from_flange: Some(now.base_from_flange), time_s: seconds(now.time_ms) })
    }
}

impl FixedWorld {
    fn greasy_spots(&self, healed: &[bool]) -> Vec<GreasySpot> {
        let left = self.cell.spots().iter().zip(healed).filter(|(_, healed)| !**healed);
        left.map(|(spot, _)| spot.clone()).collect()
    }
}

/// The devices of this world that are connected to the controller's inputs and outputs.
struct Terminals(SimulatedWorld);

impl mock::World for Terminals {
    fn on_output(&mut self, number: u16, value: bool, time_ms: u64) {
        self.0.lock().process_output(number, value, time_ms);
    }

    fn input(&self, number: u16, time_ms: u64) -> Option<bool> {
        self.0.lock().input(number, time_ms)
    }
}

/// Multiplies the brightness of the picture by this fraction of the light, 0 to 1.
fn dim_picture(picture: &mut ColorPicture, light: f64) {
    if light < 1.0 {
        picture.rgb.as_flattened_mut().iter_mut().for_each(|gray| *gray = (f64::from(*gray) * light) as u8);
    }
}

/// Returns the scan with the lens cover closed: black, without any point.
fn black_shot<F: panelprep_base::geometry::Frame>(cloud: OrganizedCloud<F>) -> OrganizedCloud<F> {
    let (width, height) = (cloud.width(), cloud.height());
    OrganizedCloud::new(width, height, vec![[f32::NAN; 3]; width * height], vec![[0; 3]; width * height])
        .unwrap_or(cloud)
}

#[cfg(test)]
mod tests;
