//! Panels that are bent since they were taught, by a bow and a wave, and what is known of them.

use super::Trial;
use super::space::lattice;
use crate::geometry::{Base, Panel, Pixel, Point, Rigid};
use crate::sim::scene;
use crate::sim::shape::Bend;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

impl Trial {
    /// The same scene with its panel bent since it was taught.
    pub fn bent_by(self, bend: Bend) -> Trial {
        Trial { present: self.present.map(|shape| shape.bent_by(bend)), ..self }
    }

    /// A region in the middle of the taught scan's picture that takes this share of the panel's length and width: top left, top right,
    /// bottom right, bottom left.
    pub fn middle_px(&self, share: f64) -> [Pixel; 4] {
        let [s, t] = self.size_mm.map(|mm| share / 2.0 * mm);
        [[-s, t], [s, t], [s, -t], [-s, -t]].map(|at| {
            let seen = scene::base_from_camera().inverse() * (scene::nominal() * self.taught.point(at));
            self.camera.project(seen).unwrap_or_default()
        })
    }

    /// How far a point lies before the surface of the panel as it stands there, along its normal, mm; `None` without a panel.
    pub fn before_surface_mm(&self, point: Point<Base>) -> Option<f64> {
        Some(self.present.as_ref()?.nearest(self.place.inverse() * point).1)
    }

    /// The pose that puts the taught panel nearest to the one that stands there, place by place (Kabsch, Acta Cryst. A 32, 1976): the place of a
    /// panel that is not bent, and what is right of one that is. `None` without a panel.
    pub fn nearest_pose(&self) -> Option<Rigid<Base, Panel>> {
        let present = self.present.as_ref()?;
        let pairs: Vec<[Point3<f64>; 2]> = lattice(&self.taught)
            .into_iter()
            .map(|at| [self.taught.point(at).mm, (self.place * present.point(at)).mm])
            .collect();
        let mean =
            |which: usize| pairs.iter().map(|pair| pair[which].coords).sum::<Vector3<f64>>() / pairs.len() as f64;
        let (taught, now) = (mean(0), mean(1));
        let scatter: Matrix3<f64> =
            pairs.iter().map(|[from, to]| (to.coords - now) * (from.coords - taught).transpose()).sum();
        let svd = scatter.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let handed = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * handed * v_t));
        Some(Rigid::claim(Isometry3::from_parts(Translation3::from(now - turn * taught), turn)))
    }

    /// How far a found place puts the outline from that of [`Trial::nearest_pose`], at most and in the panel's plane, mm.
    pub fn aside_mm(&self, found: &Rigid<Base, Panel>) -> Option<f64> {
        let right = self.nearest_pose()?;
        let aside = |at: [f64; 2]| {
            let (point, normal) = (self.taught.point(at), right * self.taught.normal(at));
            let off = (*found * point - right * point).mm;
            (off - normal.mm * normal.mm.dot(&off)).norm()
        };
        Some(lattice(&self.taught).into_iter().map(aside).fold(0.0, f64::max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A panel that is not bent is nearest where it stands; one that bows lies before its ends by the bow.
    #[test]
    fn a_bend_is_known() {
        let trial = Trial::good(3, 8);
        let place = trial.base_from_panel();
        assert!(trial.error_mm(&trial.nearest_pose().expect("a panel")).max_mm < 1e-9);
        let bow = Bend { bow_mm: 2.0, half_mm: 100.0, ..Bend::default() };
        let middle = place * trial.taught.point([0.0, 0.0]);
        let end = place * trial.taught.point([100.0, 0.0]);
        let bent = trial.clone().bent_by(bow);
        let before = |point| bent.before_surface_mm(point).expect("a panel");
        assert!(
            (before(middle) + 2.0).abs() < 0.25 && before(end).abs() < 1e-6,
            "{} {}",
            before(middle),
            before(end)
        );
        let right = bent.nearest_pose().expect("a panel");
        let aside = right.displaced(crate::geometry::Vector::new(Vector3::new(0.0, 0.3, 0.0)));
        let aside_mm = [right, aside].map(|found| bent.aside_mm(&found).expect("a panel"));
        assert!(aside_mm[0] < 1e-9 && (0.28..0.301).contains(&aside_mm[1]), "{aside_mm:?}");
    }
}
