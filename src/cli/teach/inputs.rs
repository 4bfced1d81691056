//! The inputs of `teach`: captured now, or computed from the drawing of the panel.
//!
//! With `--live`, the scan and the corner pictures are captured now, and the region is drawn on the scan's picture in a
//! browser. If the panel is taught from its drawing, scan and corner pictures are rendered as the cell's cameras would
//! see the drawing at the nominal pose.

use super::super::args::{Shot, Teach};
use super::super::fault::{DeviceFault, Fault, TeachingFault};
use super::super::flange_pose::FlangePoses;
use super::super::load;
use super::super::output::{Outcome, read_answer_line, write_progress};
use super::super::shoot::opening::{self, RequestedShot};
use super::super::{disk, live};
use panelprep_base::geometry::{
    Base, Camera, ColorPicture, Drawing, Flange, FlangeCamera, OrganizedCloud, PinholeCamera, Point, Rigid,
};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::Reason;
use panelprep_cell::files;
use panelprep_cell::recipe::{self, Recipe, with_shapes};
use panelprep_interfaces::page::LocalServer;
use panelprep_interfaces::page::drawing::{self, DrawingSheet, canvas};
use panelprep_service::daemon::service_state;
use panelprep_service::setup::CellFiles;
use panelprep_sim as sim;
use panelprep_sim::PanelPosition;
use panelprep_store::store::TaughtCorner;
use panelprep_vision::nominal::{NominalError, Part, PartEdges, PartRays, PartView, UnseenFractions};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Deviation of the drawing's triangles from the surface above which a warning is printed, mm: a tenth of the smallest
/// deviation of the panel that a scan can measure.
const FACET_DEVIATION_WARNING_MM: f64 = 0.01;
/// Deviation of the drawing's triangles from the surface above which the result is for review, mm: the contact error
/// after a good localization.
const MAX_FACET_DEVIATION_MM: f64 = 0.15;
/// Maximum distance of a corner of the region from the surface of the drawing, along the camera's ray, mm.
const MAX_REGION_DISTANCE_MM: f64 = 1.0;
/// Fraction of the surface outside of the picture above which the result is for review.
const MAX_OUTSIDE_FRACTION: f64 = 0.001;

/// A drawing with its views: the scan and the pictures that the cameras would capture.
pub struct ViewedDrawing {
    /// The rendered scan of the 3D camera.
    pub scan: OrganizedCloud<Camera>,
    /// The rendered scan as a file, in the form in which it is stored.
    pub scan_file: Vec<u8>,
    /// The rendered pictures of the flange camera, from the flange poses that the command line names.
    pub corners: Vec<TaughtCorner>,
    hash: String,
    unit: &'static str,
    part: String,
    triangles: usize,
    is_closed: bool,
    facet_error_mm: f64,
    residual_mm: Option<f64>,
    not_seen: UnseenFractions,
    /// Whether the part reaches the rim of the picture.
    reaches_rim: bool,
}

/// The flange camera of the cell.
struct FlangeView {
    camera: PinholeCamera,
    flange_from_camera: Rigid<Flange, FlangeCamera>,
    /// Grey levels of panel and background in the rendered pictures.
    grays: [u8; 2],
}

impl ViewedDrawing {
    /// Renders the drawing that the command line names, as the cameras would see it; `None` if it names none.
    ///
    /// # Errors
    /// If the recipe does not state the pose of the drawing, the file does not describe one unambiguous surface, or a
    /// camera does not see the drawing.
    pub fn view_drawing(args: &Teach, cell: &CellFiles) -> Result<Option<ViewedDrawing>, Fault> {
        let recipe = load::read_recipe(&args.recipe)?;
        let (file, nominal) = match (&args.nominal, recipe.nominal()) {
            (None, None) => return Ok(None),
            (Some(file), Some(nominal)) => (file, nominal),
            (Some(_), None) => return Err(TeachingFault::NoNominalPlace { recipe: args.recipe.clone() }.into()),
            (None, Some(_)) => return Err(TeachingFault::NominalByScan { recipe: args.recipe.clone() }.into()),
        };
        let refuse = |error: NominalError| Fault::file_fault(file, error);
        let bytes = disk::read(file)?;
        let hash = files::content_hash(&bytes);
        let mesh = files::read_mesh(&bytes).map_err(|error| Fault::file_fault(file, error))?;
        drop(bytes);
        let unit = mesh.unit.or(args.unit).map_or("", |unit| unit.abbreviation());
        let part = Part::choose(mesh, args.unit, args.part.as_deref()).map_err(refuse)?;
        let edges = PartEdges::find(&part).map_err(refuse)?;
        let base_from_drawing = nominal.base_from_drawing();
        let camera = cell.scanner()?.value;
        let camera_from_drawing = cell.base_from_camera()?.value.inverse() * base_from_drawing;
        let (name, triangles) = (part.name.clone(), part.triangles.len());
        let spare = (!args.flange.is_empty()).then(|| part.clone());
        let search_box_mm = [recipe.locate().box_min_mm(), recipe.locate().box_max_mm()];
        part.check_in_search_box(&base_from_drawing, search_box_mm).map_err(refuse)?;
        let [min_mm, max_mm] = part.box_mm(&base_from_drawing);
        let not_there = NominalError::NotSeen { min_mm, max_mm };
        let rays = PartRays::new(part, &camera_from_drawing);
        rays.check_crossings(&edges, &camera_from_drawing).map_err(refuse)?;
        let seen = PartView::view_part(&rays, &camera).map_err(refuse)?;
        let reaches_rim = seen.as_ref().is_some_and(PartView::reaches_rim);
        let scan = seen.and_then(|seen| seen.cloud()).ok_or_else(|| refuse(not_there))?;
        if let Some(corners) = nominal.region_mm() {
            let corners = corners.map(|corner| camera_from_drawing * corner);
            set_region(args, &recipe, region_px(&corners, &scan, &camera)?)?;
        }
        let is_closed = edges.borders.is_empty();
        let not_seen = UnseenFractions::find(&rays, &camera, is_closed);
        let corners = match spare {
            Some(part) => corners(args, cell, (&part, &base_from_drawing), &recipe)?,
            None => vec![],
        };
        let origin = format!("the view of part \"{name}\" of the drawing with SHA-256 {hash}, unit {unit}");
        Ok(Some(ViewedDrawing {
            scan_file: files::write_pcd_from(&scan, &origin),
            scan,
            corners,
            hash,
            unit,
            part: name,
            triangles,
            is_closed,
            facet_error_mm: edges.facet_error_mm,
            residual_mm: nominal.residual_mm(),
            not_seen,
            reaches_rim,
        }))
    }

    /// Returns the reasons for which a panel that is taught from this drawing needs a review.
    pub fn reasons(&self) -> Vec<Reason> {
        let outside = self.not_seen.outside;
        let message = || {
            // A triangle that is partly outside is counted as outside or inside as a whole, so the fraction alone does
            // not show whether the picture cuts the panel off.
            let found = match outside > MAX_OUTSIDE_FRACTION {
                true => format!(
                    "{} % of the drawing's surface lies outside of the 3D camera's picture",
                    fixed_decimals(100.0 * outside, 1)
                ),
                false => "the drawing reaches the rim of the 3D camera's picture".to_owned(),
            };
            format!(
                "{found}: the camera does not see this part of the panel and its edge; check [nominal], or move the camera"
            )
        };
        let coarse = || {
            let [found, limit] = distinguishable_texts(self.facet_error_mm, MAX_FACET_DEVIATION_MM, 3);
            format!(
                "on curved surfaces, the drawing's triangles deviate from the surface by about {found} mm (limit \
                 {limit} mm), and the measured deviation of the panel would contain this error; export the drawing \
                 with a deviation of 0.01 mm, unless the panel has an edge of less than 31° there"
            )
        };
        let is_cut = outside > MAX_OUTSIDE_FRACTION || self.reaches_rim;
        let cut = is_cut.then(|| Reason::new("drawing_outside", message()));
        let coarse =
            (self.facet_error_mm > MAX_FACET_DEVIATION_MM).then(|| Reason::new("drawing_coarse", coarse()));
        cut.into_iter().chain(coarse).collect()
    }

    /// Reports the drawing from which the panel was taught.
    pub fn report(&self, file: &Path, outcome: &mut Outcome) {
        let kind = if self.is_closed { "a closed body" } else { "an open surface" };
        outcome.add_line(format!(
            "taught from the drawing {}, part \"{}\": {kind} of {} triangles, unit {}",
            file.display(),
            self.part,
            self.triangles,
            self.unit
        ));
        let hidden = fixed_decimals(100.0 * self.not_seen.hidden, 1);
        outcome.add_line(format!(
            "{hidden} % of the surface that faces the 3D camera is hidden behind other parts of the surface"
        ));
        if let Some(residual_mm) = self.residual_mm {
            outcome.add_line(format!("the datum points fit the drawing to {} mm", fixed_decimals(residual_mm, 2)));
        }
        outcome.add_value(
            "drawing",
            json!({
                "sha256": self.hash, "part": self.part, "unit": self.unit, "triangles": self.triangles, "closed": self.is_closed,
                "facet_error_mm": self.facet_error_mm, "hidden": self.not_seen.hidden, "outside": self.not_seen.outside,
                "datum_residual_mm": self.residual_mm,
            }),
        );
    }

    /// Returns the warnings for the operator.
    pub fn warnings(&self) -> Option<String> {
        (self.facet_error_mm > FACET_DEVIATION_WARNING_MM).then(|| {
            format!(
                "on curved surfaces, the drawing's triangles deviate from the surface by about {} mm (better: \
                 {FACET_DEVIATION_WARNING_MM} mm or less); export the drawing with a smaller deviation",
                fixed_decimals(self.facet_error_mm, 3)
            )
        })
    }
}

/// Returns the corners of the region as pixels of the 3D camera's picture.
fn region_px(
    corners: &[Point<Camera>; 4],
    scan: &OrganizedCloud<Camera>,
    camera: &PinholeCamera,
) -> Result<[[f64; 2]; 4], Fault> {
    let mut corners_px = [[0.0; 2]; 4];
    for (index, (corner, px)) in corners.iter().zip(&mut corners_px).enumerate() {
        let number = index + 1;
        let seen = camera.project_inside(*corner).and_then(|pixel| {
            let (column, row) = pixel.nearest_whole(scan.width(), scan.height())?;
            Some((pixel, scan.point(column, row)?))
        });
        let (pixel, point) = seen.ok_or(TeachingFault::RegionOffDrawing { number })?;
        // Only the distance along the ray is compared, because perpendicular to it the pixel's point may be up to half
        // a pixel away.
        let away_mm = (point.mm.coords.norm() - corner.mm.coords.norm()).abs();
        if away_mm > MAX_REGION_DISTANCE_MM {
            return Err(
                TeachingFault::RegionBesideDrawing { number, away_mm, limit_mm: MAX_REGION_DISTANCE_MM }.into()
            );
        }
        // The pixels are rounded to the number of digits that the drawing page writes.
        *px = [pixel.u, pixel.v].map(|px| (px * 10.0).round() / 10.0);
    }
    Ok(corners_px)
}

/// Writes the corners of the region to the recipe file, if they have changed.
fn set_region(args: &Teach, recipe: &Recipe, corners_px: [[f64; 2]; 4]) -> Result<(), Fault> {
    if args.draw {
        return Err(TeachingFault::RegionInDrawing { recipe: args.recipe.clone() }.into());
    }
    if recipe.region().corners_px() == corners_px {
        return Ok(());
    }
    let text = disk::read_text(&args.recipe)?;
    let changed = with_shapes(&text, &recipe::DrawnShapes { corners_px, ..canvas::recipe_shapes(recipe) })
        .map_err(Fault::stage)?;
    disk::write_durable(&args.recipe, changed)?;
    write_progress(&format!("{}: [region] corners_px is set from [nominal] region_mm", args.recipe.display()));
    Ok(())
}

/// Returns the flange camera's view of the drawing from each flange pose that the command line names.
fn corners(
    args: &Teach,
    cell: &CellFiles,
    (part, base_from_drawing): (&Part, &Rigid<Base, Drawing>),
    recipe: &Recipe,
) -> Result<Vec<TaughtCorner>, Fault> {
    // The recipe's limits are between 0 and 255, so their mean fits into a byte.
    let gray = ((recipe.corner().panel_gray_min() + recipe.corner().panel_gray_max()) / 2) as u8;
    let view = FlangeView {
        camera: cell.flange_camera()?.value,
        flange_from_camera: cell.flange_from_camera()?.value,
        grays: [gray, if gray < 128 { u8::MAX } else { 0 }],
    };
    let corner = |file: &std::path::PathBuf| {
        let base_from_flange = load::flange_file(cell, file)?;
        let base_from_camera: Rigid<Base, FlangeCamera> = base_from_flange.to_rigid() * view.flange_from_camera;
        let rays = PartRays::new(part.clone(), &(base_from_camera.inverse() * *base_from_drawing));
        let seen = PartView::view_part(&rays, &view.camera).map_err(|error| Fault::file_fault(file, error))?;
        let seen = seen.ok_or_else(|| TeachingFault::DrawingNotSeen { flange: file.clone() })?;
        let [panel, beside] = view.grays;
        let picture = files::write_color_png(&seen.picture(panel, beside)).map_err(Fault::stage)?;
        Ok(TaughtCorner { picture, base_from_flange })
    };
    args.flange.iter().map(corner).collect()
}

/// Returns the arguments with existing files: those that the command line names, or those that were captured now. The
/// region is drawn on the picture of the scan or of the drawing.
///
/// # Errors
/// If a camera delivers no picture, a question is not answered, the page cannot be served, or writing to the disk
/// fails.
pub fn with_files(args: &Teach, cell: &CellFiles, drawn: Option<&OrganizedCloud<Camera>>) -> Result<Teach, Fault> {
    let mut ready = args.clone();
    let world = simulated_cell(args, cell)?;
    if let Some(folder) = &args.live {
        ready.scan = Some(scan(args, (cell, world.as_ref()), folder)?);
    }
    if args.draw || args.live.is_some() && !args.no_draw {
        let picture = match (drawn, &ready.scan) {
            (Some(drawn), _) => drawn.picture(),
            (None, Some(scan)) => load::scan(scan, &cell.scanner()?.value)?.picture(),
            (None, None) => return Err(TeachingFault::NoScan.into()),
        };
        draw(args, &picture)?;
    }
    if let Some(folder) = args.live.as_ref().filter(|_| args.corner.is_empty()) {
        let calibration = cell.cell.calibration();
        if calibration.flange_camera.is_some() && calibration.flange_from_camera.is_some() {
            (ready.corner, ready.flange) = take_corners(args, (cell, world.as_ref()), folder)?;
        }
    }
    Ok(ready)
}

/// Returns the simulated cell, if its cameras are used and free. A simulated person puts the panel at its nominal pose.
fn simulated_cell(args: &Teach, cell: &CellFiles) -> Result<Option<sim::Cell>, Fault> {
    let is_simulated =
        [cell.cell.scanner().is_simulated(), cell.cell.flange_camera().is_simulated()].contains(&true);
    if args.live.is_none() || !is_simulated || service_state(&cell.socket()).is_some() {
        return Ok(None);
    }
    Ok(Some(live::simulated_cell(&cell.scanner()?.value, args.simulation)?))
}

fn scan(args: &Teach, (cell, world): (&CellFiles, Option<&sim::Cell>), folder: &Path) -> Result<PathBuf, Fault> {
    let file = folder.join("taught_scan.pcd");
    let cloud = match world.filter(|_| cell.cell.scanner().is_simulated()) {
        Some(world) => world.taught_scan(),
        None => {
            let wanted = RequestedShot { shot: Shot::Scan, simulation: args.simulation };
            let mut opened = opening::scanner(cell, &wanted, &write_progress)?;
            opened.camera.capture_3d().map_err(Fault::stage)?.cloud
        }
    };
    disk::write(&file, files::write_pcd(&cloud))?;
    write_progress(&format!("{}: the scan from which the panel is taught", file.display()));
    Ok(file)
}

/// Serves the page for drawing the region until the person ends it.
fn draw(args: &Teach, picture: &ColorPicture) -> Result<(), Fault> {
    let recipe = args.recipe.clone();
    let sheet = DrawingSheet {
        recipe: args.recipe.clone(),
        picture_png: files::write_color_png(picture).map_err(Fault::stage)?,
        size_px: [picture.width, picture.height],
        write: Box::new(move |text| disk::write_durable(&recipe, text).map_err(|fault| fault.to_string())),
    };
    let local = LocalServer::listen(args.listen).map_err(Fault::stage)?;
    write_progress(&format!(
        "Draw the region and the masked areas: open {} in a browser on this computer.",
        local.url()
    ));
    let saved = drawing::serve(local, sheet).map_err(Fault::stage)?;
    let words = if saved == 0 { "nothing was saved: the recipe is unchanged" } else { "saved" };
    write_progress(&format!("{}: {words}", args.recipe.display()));
    Ok(())
}

/// Captures the corner pictures with their flange poses, in the order of the recipe.
fn take_corners(
    args: &Teach,
    (cell, world): (&CellFiles, Option<&sim::Cell>),
    folder: &Path,
) -> Result<(Vec<PathBuf>, Vec<PathBuf>), Fault> {
    let names = load::read_recipe(&args.recipe)?.corner().which().keywords();
    let world = world.filter(|_| cell.cell.flange_camera().is_simulated());
    let mut camera = match world {
        Some(_) => None,
        None => {
            let wanted = RequestedShot { shot: Shot::Corner, simulation: args.simulation };
            Some(opening::flange_camera(cell, &wanted, &write_progress)?.camera)
        }
    };
    let poses = FlangePoses::new(cell);
    let (mut pictures, mut flanges) = (Vec::new(), Vec::new());
    for (index, name) in names.iter().enumerate() {
        let number = index + 1;
        let (picture, reported) = loop {
            write_progress(&format!(
                "Move the camera on the flange until it sees the {name} corner of the panel, as far away as in a \
                 cycle, and press Enter."
            ));
            if read_answer_line()?.is_none() {
                return Err(TeachingFault::NoAnswer.into());
            }
            let before = poses.now();
            let (picture, from_camera) = match (world, &mut camera) {
                (Some(world), _) => simulated_corner_view(world, index)?,
                (None, Some(camera)) => {
                    let taken = camera.capture().map_err(Fault::stage)?;
                    (taken.picture, taken.base_from_flange)
                }
                (None, None) => return Err(DeviceFault::NoWorld.into()),
            };
            if let Some(flange) = poses.combine_or_ask(before, from_camera)? {
                break (picture, flange);
            }
        };
        let (file, flange) =
            (folder.join(format!("taught_corner{number}.png")), folder.join(format!("taught_flange{number}.json")));
        disk::write(&file, files::write_color_png(&picture).map_err(Fault::stage)?)?;
        disk::write(&flange, files::write_reported_flange(&reported))?;
        write_progress(&format!("{}, {}: the {name} corner", file.display(), flange.display()));
        pictures.push(file);
        flanges.push(flange);
    }
    Ok((pictures, flanges))
}

/// Returns the simulated view of a corner, from the pose to which the simulated person has moved the flange.
fn simulated_corner_view(
    world: &sim::Cell,
    index: usize,
) -> Result<(ColorPicture, Option<Rigid<Base, Flange>>), Fault> {
    let views = world.corner_views();
    let view = views.get(index).ok_or(DeviceFault::NoWorld)?;
    Ok((world.flange_picture(&view.base_from_flange, PanelPosition::Nominal), Some(view.base_from_flange)))
}
