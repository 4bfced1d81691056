//! Cameras that render what is true of the cell.

use super::super::super::*;
use super::Shared;
use crate::geometry::{Base, ColorPicture, OrganizedCloud};
use crate::sim::WET_FROM_S;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

pub struct FakeEyes {
    world: Shared,
    /// When the film began, and how many of its pictures were taken.
    film: Option<(u64, f64, u32)>,
}

impl FakeEyes {
    pub(super) fn new(world: Shared) -> Self {
        FakeEyes { world, film: None }
    }
}

impl Eyes for FakeEyes {
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError> {
        assert!(self.world.borrow().outputs.get(&1) != Some(&true), "the light is off");
        Ok(self.world.borrow().sim.scan())
    }

    fn begin_film(&mut self, pictures_per_second: f64) -> Result<f64, SightError> {
        let now_ms = self.world.borrow().time_ms;
        self.film = Some((now_ms, pictures_per_second, 0));
        Ok(now_ms as f64 / 1e3)
    }

    fn next_of_film(&mut self) -> Result<Option<Picture2d>, SightError> {
        let (began_ms, pictures_per_second, taken) = self.film.as_mut().expect("begun");
        let since_s = (self.world.borrow().time_ms - *began_ms) as f64 / 1e3;
        if since_s * *pictures_per_second < f64::from(*taken) {
            return Ok(None);
        }
        *taken += 1;
        self.picture().map(Some)
    }

    fn end_film(&mut self) -> Result<u64, SightError> {
        self.film.take().expect("begun");
        Ok(0)
    }

    fn picture(&mut self) -> Result<Picture2d, SightError> {
        let world = self.world.borrow();
        assert_eq!(world.outputs.get(&1), Some(&true), "the light is on");
        let spots = if world.healed { Vec::new() } else { world.sim.spots().to_vec() };
        let film_s = match world.water_off_ms {
            0 => 0.0,
            off_ms => WET_FROM_S + (world.time_ms - off_ms) as f64 / 1_000.0,
        };
        let picture = world.sim.film_of(&spots).picture(film_s);
        Ok(Picture2d { picture, time_s: world.time_ms as f64 / 1e3 })
    }

    fn corner_picture(&mut self) -> Result<ColorPicture, SightError> {
        let world = self.world.borrow();
        let stands = world.sim.truth().base_from_panel;
        let turn_deg = if world.water_off_ms > 0 { world.turns_when_wet_deg } else { 0.0 };
        let about = (stands * world.sim.corner_views()[0].corner).mm;
        let turn = UnitQuaternion::from_scaled_axis(Vector3::x() * turn_deg.to_radians());
        let turned: Rigid<Base, Base> =
            Rigid::claim(Isometry3::from_parts((about.coords - turn * about.coords).into(), turn));
        Ok(world.sim.flange_picture_at(&world.base_from_flange, &(turned * stands)))
    }

    fn check(&mut self) -> Vec<SightError> {
        Vec::new()
    }
}
