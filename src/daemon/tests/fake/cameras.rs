//! Cameras that render what is true of the cell.

use super::super::super::*;
use super::Shared;
use crate::geometry::{Base, ColorPicture, OrganizedCloud};
use crate::sim::WET_FROM_S;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

pub struct FakeEyes(pub(super) Shared);

impl Eyes for FakeEyes {
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError> {
        assert!(self.0.borrow().outputs.get(&1) != Some(&true), "the light is off");
        Ok(self.0.borrow().sim.scan())
    }

    fn picture(&mut self) -> Result<ColorPicture, SightError> {
        let world = self.0.borrow();
        assert_eq!(world.outputs.get(&1), Some(&true), "the light is on");
        let spots = if world.healed { Vec::new() } else { world.sim.spots().to_vec() };
        let film_s = match world.water_off_ms {
            0 => 0.0,
            off_ms => WET_FROM_S + (world.time_ms - off_ms) as f64 / 1_000.0,
        };
        Ok(world.sim.film_of(&spots).picture(film_s))
    }

    fn corner_picture(&mut self) -> Result<ColorPicture, SightError> {
        let world = self.0.borrow();
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
