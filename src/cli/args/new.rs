//! Arguments of `new`.

use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Options of `new`.
#[derive(Debug, Clone, Args)]
pub struct New {
    /// The kind of file.
    #[command(subcommand)]
    pub what: NewFile,
}

/// The kinds of files that can be created.
#[derive(Debug, Clone, Subcommand)]
pub enum NewFile {
    /// A cell's file: cameras, robot, store, park pose of the arm. Tables with numbers of the sample are marked "TO
    /// CHECK" in the file.
    #[command(after_help = "Examples, a simulated cell and a real one, without questions:\n  \
        panelprep new cell --yes --no-search --scanner simulated --flange-camera simulated --robot mock --out target/new/cell.toml\n  \
        panelprep new cell --yes --no-search --scanner zivid --flange-camera gige --flange-camera-serial 221600123 --robot eki \
        --host 172.31.1.147 --out target/new/real.toml\n\
        Without --yes the command asks on the terminal.")]
    Cell(NewCell),
    /// A recipe for a kind of panel.
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
    /// Do not search for cameras and for the controller.
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
    /// Address of the GigE Vision camera, in place of the serial number: then no camera is searched for.
    #[arg(long, value_name = "ADDRESS")]
    pub flange_camera_address: Option<String>,
    /// The robot's controller.
    #[arg(long, value_enum)]
    pub robot: Option<RobotKindName>,
    /// The controller's address.
    #[arg(long, value_name = "ADDRESS")]
    pub host: Option<String>,
    /// For a real cell, the axis angles of the arm's park pose, degrees: "a1,a2,a3,a4,a5,a6".
    #[arg(long, value_name = "ANGLES", allow_hyphen_values = true)]
    pub park_deg: Option<String>,
    /// For a real cell, the minimum corner of the box in which the tool's tip must stay, mm: "x,y,z" in the robot's
    /// base.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub box_min_mm: Option<String>,
    /// Its greatest corner.
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
    /// The four corners of the region in the scan's picture, px: "u,v u,v u,v u,v".
    #[arg(long, value_name = "CORNERS")]
    pub corners_px: Option<String>,
    /// Rows of grids in the region.
    #[arg(long, value_name = "N")]
    pub rows: Option<String>,
    /// Columns of grids in the region.
    #[arg(long, value_name = "N")]
    pub columns: Option<String>,
    /// Minimum corner of the box in which the panel is searched, in the robot's base: "x,y,z".
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub box_min_mm: Option<String>,
    /// Its greatest corner.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub box_max_mm: Option<String>,
    /// Diameter of the sanding disc's contact, mm.
    #[arg(long, value_name = "MM")]
    pub disc_diameter_mm: Option<String>,
    /// Force with which the cell's compliant tool presses, N; needed if the cell's file has such a tool.
    #[arg(long, value_name = "N", allow_hyphen_values = true)]
    pub force_n: Option<String>,
}

/// Kinds of 3D cameras that a new cell may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ScannerKind {
    /// Rendered by this program.
    Simulated,
    /// A Zivid camera.
    Zivid,
}

/// Kinds of flange cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FlangeCameraKind {
    /// Rendered by this program.
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
