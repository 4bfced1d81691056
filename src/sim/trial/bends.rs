//! Panels that were bent after they were taught, by a bow and a wave, and the ground truth for them.

use super::TrialScene;
use super::space::sheet_points;
use crate::shape::PanelBend;
use crate::{drawing, scene};
use panelprep_base::geometry::{Base, Drawing, Panel, Pixel, Point, Rigid, TriangleMesh, fit_rigid_motion};

impl TrialScene {
    /// Returns the same scene with its panel bent since it was taught.
    pub fn with_bend(self, bend: PanelBend) -> TrialScene {
        TrialScene { present: self.present.map(|shape| shape.with_bend(bend)), ..self }
    }

    /// The drawing of the taught panel, and the place of its frame while the panel is at its nominal place.
    pub fn drawing(&self) -> (TriangleMesh, Rigid<Base, Drawing>) {
        let base_from_drawing = scene::nominal().isometry() * self.taught.panel_from_sheet();
        (drawing::mesh(&self.taught), Rigid::from_isometry_unchecked(base_from_drawing))
    }

    /// A region in the middle of the taught scan's picture that covers this share of the panel's length and width:
    /// top left, top right, bottom right, bottom left.
    pub fn middle_px(&self, share: f64) -> [Pixel; 4] {
        let [s, t] = self.size_mm.map(|mm| share / 2.0 * mm);
        [[-s, t], [s, t], [s, -t], [-s, -t]].map(|at| {
            let seen = scene::base_from_camera().inverse() * (scene::nominal() * self.taught.point(at));
            self.camera.project(seen).unwrap_or_default()
        })
    }

    /// Returns how far a point lies in front of the surface of today's panel, along the surface's normal, mm; `None`
    /// without a panel.
    pub fn height_over_surface_mm(&self, point: Point<Base>) -> Option<f64> {
        Some(self.present.as_ref()?.nearest(self.place.inverse() * point).1)
    }

    /// Returns the pose that brings the taught panel nearest to today's panel, point by point. For a panel without
    /// a bend it is the panel's pose, for a bent panel it is the correct result. `None` without a panel.
    pub fn best_fit_pose(&self) -> Option<Rigid<Base, Panel>> {
        let present = self.present.as_ref()?;
        let pair = |at: [f64; 2]| (self.taught.point(at), self.place * present.point(at));
        fit_rigid_motion(&sheet_points(&self.taught).into_iter().map(pair).collect::<Vec<_>>())
    }

    /// Returns the largest distance of a point of the panel between a found pose and [`Trial::best_fit_pose`], in the
    /// panel's plane, mm.
    pub fn max_point_distance_mm(&self, found: &Rigid<Base, Panel>) -> Option<f64> {
        let right = self.best_fit_pose()?;
        let aside = |at: [f64; 2]| {
            let (point, normal) = (self.taught.point(at), right * self.taught.normal(at));
            let off = (*found * point - right * point).mm;
            (off - normal.mm * normal.mm.dot(&off)).norm()
        };
        Some(sheet_points(&self.taught).into_iter().map(aside).fold(0.0, f64::max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    /// The nearest pose of a panel that is not bent is its own pose; the middle of a bowed panel lies in front of
    /// its ends by the bow.
    #[test]
    fn a_bend_is_known() {
        let trial = TrialScene::good_scene(3, 8);
        let place = trial.base_from_panel();
        assert!(trial.error_mm(&trial.best_fit_pose().expect("a panel")).max_mm < 1e-9);
        let bow = PanelBend { bow_mm: 2.0, half_mm: 100.0, ..PanelBend::default() };
        let middle = place * trial.taught.point([0.0, 0.0]);
        let end = place * trial.taught.point([100.0, 0.0]);
        let bent = trial.clone().with_bend(bow);
        let before = |point| bent.height_over_surface_mm(point).expect("a panel");
        assert!(
            (before(middle) + 2.0).abs() < 0.25 && before(end).abs() < 1e-6,
            "{} {}",
            before(middle),
            before(end)
        );
        let right = bent.best_fit_pose().expect("a panel");
        let aside =
            right.followed_by_displacement(panelprep_base::geometry::Vector::new(Vector3::new(0.0, 0.3, 0.0)));
        let aside_mm = [right, aside].map(|found| bent.max_point_distance_mm(&found).expect("a panel"));
        assert!(aside_mm[0] < 1e-9 && (0.28..0.301).contains(&aside_mm[1]), "{aside_mm:?}");
    }
}
