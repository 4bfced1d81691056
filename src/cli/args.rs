//! The command line, as `interfaces` fixes it for scripts.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Finds a composite panel, tests it for grease with water, plans where to sand.
#[derive(Debug, Parser)]
#[command(name = "panelprep", version, arg_required_else_help = true)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// What every command takes.
    #[command(flatten)]
    pub common: Common,
}

/// What every command takes.
#[derive(Debug, Clone, Args)]
pub struct Common {
    /// The cell: cameras, robot, calibrations, limits.
    #[arg(long, global = true, value_name = "FILE", default_value = "config/cell.toml")]
    pub cell: PathBuf,
    /// Folder that keeps what was taught; without it, the cell's `store`.
    #[arg(long, global = true, value_name = "FOLDER")]
    pub store: Option<PathBuf>,
    /// Print one JSON object on standard output and nothing else there.
    #[arg(long, global = true)]
    pub json: bool,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a cell, locate the panel, inspect its film and plan the path, all on files, and write one page.
    #[command(after_help = "Example:\n  panelprep demo --seed 3 --out target/demo")]
    Demo(Demo),
    /// Write a simulated cell as files: calibrations, recipe, scans, pictures, a clip, and the truth in its own folder.
    #[command(after_help = "Example:\n  panelprep render --seed 1 --out target/cell")]
    Render(Render),
    /// Run one cycle on a simulated cell: locate, refine, wet, inspect, abrade what failed, until it passes or may not.
    #[command(after_help = "Example, after the one of `panelprep teach --help`:\n  \
        panelprep cycle --cell target/cell/cell.toml --recipe target/cell/recipe.toml --seed 1")]
    Cycle(Cycle),
    /// Check configuration files: cell, recipe, calibrations.
    #[command(after_help = "Example:\n  panelprep check config/cell.toml config/panels/example.toml")]
    Check(Check),
    /// Calibrate lenses, camera mounts and tools, and say how good they are.
    Calibrate(super::calibrate::args::Calibrate),
    /// Learn a panel at its nominal place from a scan and corner pictures.
    #[command(after_help = "Example, after `panelprep render --out target/cell`:\n  \
        panelprep teach --cell target/cell/cell.toml --recipe target/cell/recipe.toml --scan target/cell/taught_scan.pcd \
        --corner target/cell/taught_corner.png --flange target/cell/taught_flange.json --pictures target/cell/pictures")]
    Teach(Teach),
    /// Find where the panel stands now, from a scan.
    #[command(after_help = "Example, after the one of `panelprep teach --help`:\n  \
        panelprep locate --cell target/cell/cell.toml --recipe target/cell/recipe.toml --scan target/cell/scan.pcd --json")]
    Locate(Locate),
    /// Correct the place found by what a corner picture shows.
    #[command(
        after_help = "Example, after the one of `panelprep locate --help` with `> target/cell/located.json`:\n  \
        panelprep refine --cell target/cell/cell.toml --recipe target/cell/recipe.toml --located target/cell/located.json \
        --corner target/cell/corner.png --flange target/cell/flange.json"
    )]
    Refine(Refine),
    /// Test a clip of the wet panel for broken film.
    #[command(
        after_help = "Example, after the one of `panelprep locate --help` with `> target/cell/located.json`:\n  \
        panelprep inspect --cell target/cell/cell.toml --recipe target/cell/recipe.toml --clip target/cell/clip \
        --located target/cell/located.json --pictures target/cell/pictures"
    )]
    Inspect(Inspect),
    /// Plan the sanding path over grids.
    #[command(after_help = "Example, after the one of `panelprep teach --help`:\n  \
        panelprep plan --cell target/cell/cell.toml --recipe target/cell/recipe.toml --grids r1c1,r1c2 \
        --out target/cell/plan.json --pictures target/cell/pictures")]
    Plan(Plan),
}

/// What the simulated cell shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum SceneName {
    /// The right panel, displaced, with greasy spots.
    #[default]
    Good,
    /// The right panel without grease.
    Clean,
    /// The fixture alone.
    NoPanel,
    /// Another panel.
    WrongPanel,
}

/// Options of `demo`.
#[derive(Debug, Clone, Args)]
pub struct Demo {
    /// Everything random comes from this number.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// What stands in the cell.
    #[arg(long, value_enum, default_value_t)]
    pub scene: SceneName,
    /// Where pictures, files and the page go.
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
    pub out: PathBuf,
    /// Cameras with this many times fewer pixels each way; 1 is full size.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub reduction: u32,
}

/// Options of `render`.
#[derive(Debug, Clone, Args)]
pub struct Render {
    /// Everything random comes from this number.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// What stands in the cell.
    #[arg(long, value_enum, default_value_t)]
    pub scene: SceneName,
    /// The folder to write; it must be empty, new, or one that `render` wrote.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Cameras with this many times fewer pixels each way; 1 is full size.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub reduction: u32,
}

/// Options of `cycle`.
#[derive(Debug, Clone, Args)]
pub struct Cycle {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// Everything random in the simulated cell comes from this number.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// What stands in the simulated cell.
    #[arg(long, value_enum, default_value_t)]
    pub scene: SceneName,
}

/// Options of `check`.
#[derive(Debug, Clone, Args)]
pub struct Check {
    /// The files.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
}

/// Options of `teach`.
#[derive(Debug, Clone, Args)]
pub struct Teach {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// The scan at the nominal place: organised PCD or PLY.
    #[arg(long, value_name = "FILE")]
    pub scan: PathBuf,
    /// A corner picture at the nominal place; repeatable, each with its `--flange`.
    #[arg(long, value_name = "FILE")]
    pub corner: Vec<PathBuf>,
    /// The flange's pose at that picture.
    #[arg(long, value_name = "POSE.json")]
    pub flange: Vec<PathBuf>,
    /// Folder for pictures of what was learnt.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `locate`.
#[derive(Debug, Clone, Args)]
pub struct Locate {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// The scan: organised PCD or PLY.
    #[arg(long, value_name = "FILE")]
    pub scan: PathBuf,
    /// Folder for a picture of the place found.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `refine`.
#[derive(Debug, Clone, Args)]
pub struct Refine {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// A pose, or what `locate` printed.
    #[arg(long, value_name = "POSE.json")]
    pub located: PathBuf,
    /// A corner picture; repeatable in the order of teaching, each with its `--flange`.
    #[arg(long, value_name = "FILE", required = true)]
    pub corner: Vec<PathBuf>,
    /// The flange's pose at that picture.
    #[arg(long, value_name = "POSE.json", required = true)]
    pub flange: Vec<PathBuf>,
    /// Folder for pictures of the corner before and after.
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
    #[arg(long, value_name = "DIR")]
    pub clip: PathBuf,
    /// A pose, or what `locate` or `refine` printed; without it the panel stands at its nominal place.
    #[arg(long, value_name = "POSE.json")]
    pub located: Option<PathBuf>,
    /// Folder with the true mask, to score against; it changes no result.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Folder for the mask, the overlay and the film strip.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `plan`.
#[derive(Debug, Clone, Args)]
pub struct Plan {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// A pose, or what `locate` or `refine` printed; without it the panel stands at its nominal place.
    #[arg(long, value_name = "POSE.json")]
    pub located: Option<PathBuf>,
    /// The grids to abrade, `r1c1,r1c2`; without it all of them.
    #[arg(long, value_name = "ID,…", value_delimiter = ',')]
    pub grids: Vec<String>,
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
