//! Arguments of the commands that check and evaluate files, and of `new` and `package-files`, which write files.

use super::simulation::Simulation;
use clap::{Args, Subcommand, ValueEnum};
use panelprep_base::geometry::LengthUnit;
use std::path::PathBuf;

/// Options of `doctor`.
#[derive(Debug, Clone, Args)]
pub struct Doctor {
    /// Folder with CELLCMD.xml, CELLSTAT.xml and cell_data.dat, copied from the controller or to be copied to it.
    #[arg(long, value_name = "FOLDER")]
    pub kuka: Option<PathBuf>,
    /// Accept the controller's programs: if the files of --kuka agree with the cell file and the controller reports
    /// their checksum, print the line programs_sum for the cell file. Nothing is written.
    #[arg(long, requires = "kuka")]
    pub accept: bool,
    /// Capture 3D scans with a Zivid camera for ten minutes, and check by its temperature that the camera is warm.
    #[arg(long)]
    pub warm_up: bool,
}

/// Options of `check`.
#[derive(Debug, Clone, Args)]
pub struct Check {
    /// The files to check. KRL files that belong together must be named in one command.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The lowest version of KUKA System Software for which the KRL files are written, 8.2 to 8.7. The use of a
    /// function that this version does not have is an error.
    #[arg(long, value_name = "VERSION")]
    pub kss: Option<panelprep_kuka::krl::Kss>,
    /// The purpose for which a cell file must be complete, including the files that it names. Without this option, it
    /// must be complete for a cycle, but its calibration files may be missing.
    #[arg(long = "for", value_name = "PURPOSE", value_enum)]
    pub purpose: Option<PurposeName>,
}

/// The purpose for which a cell file must be complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PurposeName {
    /// Commands that use only files: entries that exist must be valid, but no entry is required.
    Files,
    /// Commands that execute one function of the robot.
    Robot,
    /// `cycle`, `air-run` and `run`: calibrations and camera settings must exist and be valid.
    Cycle,
}

/// Options of `teach`.
#[derive(Debug, Clone, Args)]
pub struct Teach {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// The scan of the panel at its nominal pose: an organised cloud as PCD or PLY.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["live", "nominal"])]
    pub scan: Option<PathBuf>,
    /// The drawing of the panel as a mesh, instead of a scan: STL, PLY or OBJ. The recipe's [nominal] states its pose.
    /// With `--flange` alone, the corner pictures are also computed from the drawing.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scan", "live", "corner"])]
    pub nominal: Option<PathBuf>,
    /// The unit of the drawing, if its file states none: mm, in or m.
    #[arg(long, value_name = "UNIT", requires = "nominal", value_parser = unit)]
    pub unit: Option<LengthUnit>,
    /// The part of the drawing that is the panel, if the drawing has several parts.
    #[arg(long, value_name = "NAME", requires = "nominal")]
    pub part: Option<String>,
    /// Capture the scan and the corner pictures now with the cell's cameras, and keep them in this folder. After the
    /// scan, a person draws the region in a browser.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scan", "corner", "flange"])]
    pub live: Option<PathBuf>,
    /// Draw the region, its grids and the masked areas on the picture of the scan, in a browser on this computer. They
    /// are written to the recipe file, whose comments are kept.
    #[arg(long)]
    pub draw: bool,
    /// With --live: do not draw the region, because the recipe already contains it.
    #[arg(long, requires = "live", conflicts_with = "draw")]
    pub no_draw: bool,
    /// Address of the page for drawing: a loopback address; port 0 selects a free port.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub listen: std::net::SocketAddr,
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
    /// A picture of a corner of the panel at its nominal pose. Repeat the option for each picture, each time with
    /// `--flange`.
    #[arg(long, value_name = "FILE")]
    pub corner: Vec<PathBuf>,
    /// The flange pose of the corner picture.
    #[arg(long, value_name = "POSE.json")]
    pub flange: Vec<PathBuf>,
    /// Folder for pictures of the taught data or, if teaching failed, of the input.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

fn unit(word: &str) -> Result<LengthUnit, String> {
    let known = LengthUnit::ALL.into_iter().find(|(unit, _)| unit.abbreviation() == word);
    known.map(|(unit, _)| unit).ok_or_else(|| "valid: mm, in or m".to_owned())
}

/// Options of `look`.
#[derive(Debug, Clone, Args)]
pub struct Look {
    /// The scan: an organised cloud as PCD or PLY.
    #[arg(long, value_name = "FILE")]
    pub scan: PathBuf,
    /// Folder for the picture.
    #[arg(long, value_name = "DIR")]
    pub pictures: PathBuf,
}

/// Options of `identify`.
#[derive(Debug, Clone, Args)]
pub struct Identify {
    /// The scan: organised cloud as PCD or PLY.
    #[arg(long, value_name = "FILE", required_unless_present = "live")]
    pub scan: Option<PathBuf>,
    /// Take the scan now, with the cell's 3D camera.
    #[arg(long, conflicts_with = "scan")]
    pub live: bool,
    /// Compare only the panels of the recipes in this folder; without this option, all panels that were taught in this
    /// cell.
    #[arg(long, value_name = "DIR")]
    pub panels: Option<PathBuf>,
    /// The panel that the order names: if the scan shows another one, a person decides.
    #[arg(long, value_name = "PANEL")]
    pub expect: Option<String>,
    /// The part's serial number or barcode: if it does not have the form that the panel's recipe states, a person
    /// decides.
    #[arg(long, value_name = "SERIAL")]
    pub part: Option<String>,
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
}

/// Options of `locate`.
#[derive(Debug, Clone, Args)]
pub struct Locate {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// The scan: an organised cloud as PCD or PLY.
    #[arg(long, value_name = "FILE")]
    pub scan: PathBuf,
    /// File for the located pose, in the format of `--json`. It is the input for `--located` of other commands.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Folder for a picture of the panel at the located pose.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `refine`.
#[derive(Debug, Clone, Args)]
pub struct Refine {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// The pose of the panel, or the output of `locate`.
    #[arg(long, value_name = "POSE.json")]
    pub located: PathBuf,
    /// A corner picture. Repeat the option in the order of teaching, each time with `--flange`.
    #[arg(long, value_name = "FILE", required = true)]
    pub corner: Vec<PathBuf>,
    /// The flange pose of the corner picture.
    #[arg(long, value_name = "POSE.json", required = true)]
    pub flange: Vec<PathBuf>,
    /// File for the corrected pose, in the format of `--json`. It is the input for `--located` of other commands.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Folder for pictures of the corner before and after the correction.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `inspect`.
#[derive(Debug, Clone, Args)]
pub struct Inspect {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// Folder with numbered pictures and `clip.csv`.
    #[arg(long, value_name = "DIR", required_unless_present = "truth")]
    pub clip: Option<PathBuf>,
    /// The pose of the panel, or the output of `locate` or `refine`. Without this option, the panel must be at its
    /// nominal pose; if the dry picture shows it elsewhere, the test is invalid.
    #[arg(long, value_name = "POSE.json")]
    pub located: Option<PathBuf>,
    /// Grids that were sanded after the dry picture, such as `r2c5,r2c6`, or `all`: where the disc may have touched the
    /// panel, only the wet appearance is compared. All other grids are assumed to be unchanged.
    #[arg(long, value_name = "GRIDS", value_delimiter = ',')]
    pub abraded: Vec<String>,
    /// Folder with the true mask, to score the result; the result itself does not change. A labelled clip contains its
    /// own true mask. Without `--clip`, the folder is a labelled set: a folder of clips, each with its own `truth` or
    /// its own labels, which is scored as a whole.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Folder for the mask, the overlay, the film strip and the page to be signed; for a set, folder for its plots.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `tune`.
#[derive(Debug, Clone, Args)]
pub struct Tune {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// Folder with numbered pictures and `clip.csv`; at least one picture must be dry.
    #[arg(long, value_name = "DIR")]
    pub clip: PathBuf,
    /// The pose of the panel, or the output of `locate` or `refine`. Without this option, the panel must be at its
    /// nominal pose; if the dry picture shows it elsewhere, the test is invalid.
    #[arg(long, value_name = "POSE.json")]
    pub located: Option<PathBuf>,
    /// Folder with the true mask at the end of the clip; a labelled clip contains its own true mask.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
}

/// Options of `label`.
#[derive(Debug, Clone, Args)]
pub struct Label {
    /// Folder with numbered pictures and `clip.csv`; the labels are saved in this folder.
    #[arg(long, value_name = "DIR")]
    pub clip: PathBuf,
    /// The recipe of the panel, whose grids are drawn over the pictures. The panel must have been taught.
    #[arg(long, value_name = "FILE")]
    pub recipe: Option<PathBuf>,
    /// The pose of the panel at which the grids are drawn, or the output of `locate` or `refine`. Without this option,
    /// the nominal pose is used.
    #[arg(long, value_name = "POSE.json", requires = "recipe")]
    pub located: Option<PathBuf>,
    /// Address of the page: a loopback address; port 0 selects a free port.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub listen: std::net::SocketAddr,
}

/// Options of `plan`.
#[derive(Debug, Clone, Args)]
pub struct Plan {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// The pose of the panel, or the output of `locate` or `refine`. Without this option, the nominal pose is used.
    #[arg(long, value_name = "POSE.json")]
    pub located: Option<PathBuf>,
    /// The grids to be sanded, for example `r1c1,r1c2`; without this option all grids.
    #[arg(long, value_name = "ID,…", value_delimiter = ',')]
    pub grids: Vec<String>,
    /// Mask of the breaks of a water film (`mask.png`), as `inspect --pictures` writes it, with the pose of the panel
    /// in this film as `--located`. The grids that failed are planned. If the recipe's `[treat]` has `by = "break"`,
    /// only areas around the breaks are planned.
    #[arg(long, value_name = "MASK.png")]
    pub broken: Option<PathBuf>,
    /// File for the plan as JSON.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// File for the same path as a KRL program.
    #[arg(long, value_name = "FILE")]
    pub krl: Option<PathBuf>,
    /// Folder for a picture of the path over the panel.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `package-files`.
#[derive(Debug, Clone, Args)]
pub struct PackageFiles {
    /// The folder for `man/` and `completions/`.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Options of `new`.
#[derive(Debug, Clone, Args)]
pub struct New {
    /// The kind of file to write.
    #[command(subcommand)]
    pub what: NewFile,
}

/// The kinds of files that can be created.
#[derive(Debug, Clone, Subcommand)]
pub enum NewFile {
    /// A cell file: cameras, robot, store, park pose of the arm. Tables with values from the sample file are marked "TO
    /// CHECK" in the file.
    #[command(after_help = "Examples, a simulated cell and a real one, without questions:\n  \
        panelprep new cell --yes --no-search --scanner simulated --flange-camera simulated --robot mock --out target/new/cell.toml\n  \
        panelprep new cell --yes --no-search --scanner zivid --flange-camera gige --flange-camera-serial 221600123 --robot eki \
        --host 172.31.1.147 --out target/new/real.toml\n\
        Without --yes the command asks on the terminal.")]
    Cell(NewCell),
    /// A recipe for one type of panel.
    #[command(
        after_help = "Example, with the sample's numbers for everything that is not given:\n  panelprep new \
                            recipe --yes --panel door-skin-right --out target/new/door-skin-right.toml\nThe \
                            corners of the region are read from the picture of `panelprep look`."
    )]
    Recipe(NewRecipe),
}

/// Options of `new cell`.
#[derive(Debug, Clone, Args)]
pub struct NewCell {
    /// The file to write; it must not exist.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Accept the proposed answer to each question that no option answers.
    #[arg(long)]
    pub yes: bool,
    /// Do not search for cameras and the controller.
    #[arg(long)]
    pub no_search: bool,
    /// The fixed 3D camera.
    #[arg(long, value_enum)]
    pub scanner: Option<ScannerKind>,
    /// Serial number of the Zivid camera.
    #[arg(long, value_name = "SERIAL")]
    pub scanner_serial: Option<String>,
    /// The camera on the flange.
    #[arg(long, value_enum)]
    pub flange_camera: Option<FlangeCameraKind>,
    /// Serial number of the GigE Vision camera.
    #[arg(long, value_name = "SERIAL", conflicts_with = "flange_camera_address")]
    pub flange_camera_serial: Option<String>,
    /// Address of the GigE Vision camera, instead of its serial number. With an address, the command does not search
    /// for the camera.
    #[arg(long, value_name = "ADDRESS")]
    pub flange_camera_address: Option<String>,
    /// The robot's controller.
    #[arg(long, value_enum)]
    pub robot: Option<RobotKindName>,
    /// The controller's address.
    #[arg(long, value_name = "ADDRESS")]
    pub host: Option<String>,
    /// For a real cell: the axis angles of the arm's park pose, degrees: "a1,a2,a3,a4,a5,a6".
    #[arg(long, value_name = "ANGLES", allow_hyphen_values = true)]
    pub park_deg: Option<String>,
    /// For a real cell: the minimum corner of the box in which the TCP must stay, mm: "x,y,z" in the robot's base.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub box_min_mm: Option<String>,
    /// Maximum corner of this box, mm: "x,y,z" in the robot's base.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub box_max_mm: Option<String>,
}

/// Options of `new recipe`.
#[derive(Debug, Clone, Args)]
pub struct NewRecipe {
    /// The file to write; it must not exist.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Accept the proposed answer to each question that no option answers.
    #[arg(long)]
    pub yes: bool,
    /// The name under which the panel is taught.
    #[arg(long, value_name = "NAME")]
    pub panel: Option<String>,
    /// The four corners of the region in the picture of the scan, px: "u,v u,v u,v u,v".
    #[arg(long, value_name = "CORNERS")]
    pub corners_px: Option<String>,
    /// Number of rows of grids in the region.
    #[arg(long, value_name = "N")]
    pub rows: Option<String>,
    /// Number of columns of grids in the region.
    #[arg(long, value_name = "N")]
    pub columns: Option<String>,
    /// Minimum corner of the box in which the panel is searched, mm: "x,y,z" in the robot's base.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub box_min_mm: Option<String>,
    /// Maximum corner of this box, mm: "x,y,z" in the robot's base.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub box_max_mm: Option<String>,
    /// Diameter of the contact area of the sanding disc, mm.
    #[arg(long, value_name = "MM")]
    pub disc_diameter_mm: Option<String>,
    /// Force with which the cell's compliant tool presses, N; required if the cell file has a compliant tool.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    pub force_n: Option<String>,
}

/// The kind of 3D camera of a new cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ScannerKind {
    /// A simulated camera, whose scans this program renders.
    Simulated,
    /// A Zivid camera.
    Zivid,
}

/// The kind of flange camera of a new cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FlangeCameraKind {
    /// A simulated camera, whose pictures this program renders.
    Simulated,
    /// A GigE Vision camera.
    Gige,
}

/// Kinds of robots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RobotKindName {
    /// A mock controller inside this program.
    Mock,
    /// A KUKA controller over EthernetKRL.
    Eki,
}
