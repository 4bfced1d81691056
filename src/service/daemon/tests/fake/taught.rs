//! The calibrations of the scripted cell, and its taught data.

use super::super::super::*;
use panelprep_base::geometry::KukaPose;
use panelprep_cell::cell::{self, LensExtent};
use panelprep_cell::panel::{CornerTeaching, TaughtCorner, TaughtPanel, panel_from_base_at_teaching};
use panelprep_cell::recipe::Recipe;
use panelprep_sim::{self as sim, PanelPosition, SEARCH_BOX_MM};
use panelprep_toolpath::removal::model::Model;
use std::sync::Arc;

pub type TaughtHere = (TaughtPanel, Vec<TaughtCorner>);

/// Returns the setup of a cycle of this cell.
pub fn setup(cell: &cell::Cell, recipe: &Recipe, taught: &TaughtHere, calibrations: Calibrations) -> CycleSetup {
    let cell = Arc::new(CellSetup::new(cell).expect("complete"));
    CycleSetup::new(cell, recipe.clone(), taught.clone(), (calibrations, LensExtent::default())).expect("a corner")
}

pub(super) fn taught(sim: &sim::Cell, (more_recipe, grids): (&str, Option<[usize; 2]>)) -> (TaughtHere, Recipe) {
    let region = sim.region();
    let [rows, columns] = grids.unwrap_or([region.rows, region.columns]);
    let text = format!(
        "panel = \"p\"\n[process]\nobservation_s = 40.0\nframes_per_second = 0.5\n\
         [corner]\nwhich = [\"top-left\", \"bottom-right\"]\nsettled_mm = 0.1\n\
         [region]\ncorners_px = {:?}\nrows = {}\ncolumns = {}\n[locate]\nbox_min_mm = {:?}\nbox_max_mm = {:?}\n\
         [inspect]\nmin_break_mm2 = 75.0 # a quarter of the pixels each way shows no smaller break surely\n{more_recipe}",
        region.corners_px.map(|px| [px.u, px.v]),
        rows,
        columns,
        SEARCH_BOX_MM[0],
        SEARCH_BOX_MM[1]
    );
    let recipe = Recipe::check("simulated.toml", &text).unwrap_or_else(|e| panic!("{e}"));
    let base_from_camera = sim.calibrated_base_from_camera();
    let panel = TaughtPanel::learn(&sim.taught_scan(), *sim.scanner(), base_from_camera, &recipe).expect("a panel");
    let camera = sim.flange_camera();
    let teach = |(index, view): (usize, sim::CornerView)| {
        let picture = sim.flange_picture(&view.base_from_flange, PanelPosition::Nominal).to_gray();
        let base_from_camera = view.base_from_flange * sim.calibrated_flange_from_camera();
        let panel_from_camera = panel.nominal_pose.inverse() * base_from_camera;
        // The simulator's panel frame is the base at the nominal place, whatever the recipe states.
        let corner = panel_from_base_at_teaching().inverse() * view.corner;
        let depth_mm = (base_from_camera.inverse() * corner).mm.z;
        let (settings, px_per_mm) = (recipe.corner(), camera.px_per_mm_at(depth_mm).0);
        let found = panelprep_vision::locate::corner::find(
            &picture,
            settings,
            settings.which().for_picture(index),
            px_per_mm,
        );
        let teaching = CornerTeaching { reference_px: found.expect("a corner").corner_px, panel_from_camera };
        panel.corner(teaching, camera).expect("on the panel")
    };
    let corners = sim.corner_views().into_iter().enumerate().map(teach).collect();
    ((panel, corners), recipe)
}

pub(super) fn calibrations(sim: &sim::Cell, removal: Option<Model>) -> Calibrations {
    Calibrations {
        scan_errors: panelprep_vision::locate::ScanErrors::default(),
        scanner: *sim.scanner(),
        base_from_camera: sim.calibrated_base_from_camera(),
        flange_camera: *sim.flange_camera(),
        flange_from_camera: sim.calibrated_flange_from_camera(),
        flange_from_tool: KukaPose { z_mm: 160.0, ..KukaPose::default() }.to_rigid(),
        hand_eye_mm: None,
        robot_mm: None,
        removal,
    }
}
