//! Cameras that render the true state of the cell.

use super::super::super::*;
use super::Shared;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, ColorPicture, Rigid};
use panelprep_sim::WET_FROM_S;

pub struct FakeCameras {
    world: Shared,
    /// The time at which the film began, and how many of its pictures were taken.
    film: Option<(u64, f64, u32)>,
}

impl FakeCameras {
    pub(super) fn new(world: Shared) -> Self {
        FakeCameras { world, film: None }
    }
}

impl Port<CameraCommand> for FakeCameras {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        Ok(match command {
            CameraCommand::Scan => {
                let world = self.world.borrow();
                assert!(world.outputs.get(&1) != Some(&true), "the light is off");
                CameraAnswer::Scan(world.sim.scan())
            }
            CameraCommand::Picture => CameraAnswer::Picture(self.rendered()),
            CameraCommand::BeginFilm(pictures_per_second) => {
                let now_ms = self.world.borrow().time_ms;
                self.film = Some((now_ms, pictures_per_second, 0));
                self.world.borrow_mut().films_began_s.push(now_ms as f64 / 1e3);
                CameraAnswer::FilmBegan(now_ms as f64 / 1e3)
            }
            CameraCommand::NextOfFilm => {
                self.rendered_of_film().map_or(CameraAnswer::NoneDue, CameraAnswer::Picture)
            }
            CameraCommand::EndFilm => {
                self.film.take().expect("begun");
                CameraAnswer::FilmEnded(0)
            }
            CameraCommand::CornerPicture => CameraAnswer::Corner(self.rendered_corner()),
            CameraCommand::Check => CameraAnswer::Checked(vec![]),
        })
    }
}

impl FakeCameras {
    fn rendered_of_film(&mut self) -> Option<Picture2d> {
        let (began_ms, pictures_per_second, taken) = self.film.as_mut().expect("begun");
        let since_s = (self.world.borrow().time_ms - *began_ms) as f64 / 1e3;
        if since_s * *pictures_per_second < f64::from(*taken) {
            return None;
        }
        *taken += 1;
        Some(self.rendered())
    }

    fn rendered(&self) -> Picture2d {
        let world = self.world.borrow();
        assert_eq!(world.outputs.get(&1), Some(&true), "the light is on");
        let spots = if world.healed && !world.stays_greasy { Vec::new() } else { world.sim.spots().to_vec() };
        let film_s = match world.water_off_ms {
            0 => 0.0,
            off_ms => WET_FROM_S + (world.time_ms - off_ms) as f64 / 1_000.0,
        };
        let picture = world.sim.film_with_spots(&spots).picture(film_s);
        Picture2d { picture, time_s: world.time_ms as f64 / 1e3 }
    }

    fn rendered_corner(&self) -> ColorPicture {
        let world = self.world.borrow();
        let stands = world.sim.truth().base_from_panel;
        let turn_deg = if world.water_off_ms > 0 { world.turns_when_wet_deg } else { 0.0 };
        let about = (stands * world.sim.corner_views()[0].corner).mm;
        let turn = UnitQuaternion::from_scaled_axis(Vector3::x() * turn_deg.to_radians());
        let turned: Rigid<Base, Base> = Rigid::from_isometry_unchecked(Isometry3::from_parts(
            (about.coords - turn * about.coords).into(),
            turn,
        ));
        world.sim.flange_picture_at(&world.base_from_flange, &(turned * stands))
    }
}
