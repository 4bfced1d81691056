//! The command line, as `interfaces` fixes it for scripts.

mod backup;
mod new;
mod package_files;
mod simulation;

pub use backup::{Backup, BackupPart, Restore};
pub use new::{FlangeCameraKind, New, NewCell, NewFile, NewRecipe, RobotKindName, ScannerKind};
pub use package_files::PackageFiles;
use simulation::arm_error;
pub use simulation::{SceneName, Simulation};

use crate::devices::mock::FaultSpec;
use crate::sim::RealArm;
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
    #[arg(long, global = true, env = "PANELPREP_CELL", value_name = "FILE", default_value = "config/cell.toml")]
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
    /// Run one whole cycle on a simulated cell, write its page and pictures, and tell how far from the truth it was.
    #[command(after_help = "Example:\n  panelprep demo --seed 3 --out target/demo")]
    Demo(Demo),
    /// Write a simulated cell as files: calibrations, recipe, scans, pictures, a clip, and the truth in its own folder.
    #[command(
        after_help = "Examples, with the pictures for `panelprep calibrate`, and the same panel at another place:\n  \
        panelprep render --seed 1 --boards --out target/cell\n  \
        panelprep render --seed 1 --place 2 --out target/cell2"
    )]
    Render(Render),
    /// Run one cycle on the cell: locate, refine, wet, inspect, abrade what failed, until it passes or may not.
    #[command(
        after_help = "Example, after those of `panelprep teach --help` and `panelprep calibrate verify --help`:\n  \
        panelprep cycle --cell target/cell/cell.toml --recipe target/cell/recipe.toml --seed 1"
    )]
    Cycle(Cycle),
    /// Fly the planned path over all grids in the air: no water, the tool off, nothing touched.
    #[command(
        after_help = "Example, after those of `panelprep teach --help` and `panelprep calibrate verify --help`:\n  \
        panelprep air-run --cell target/cell/cell.toml --recipe target/cell/recipe.toml --seed 1"
    )]
    AirRun(Cycle),
    /// One function of the robot at a time, through every gate: for commissioning.
    #[command(
        after_help = "Examples, with the mock robot of config/cell.toml, which stands at its home pose anew each time:\n  \
        panelprep robot state\n  panelprep robot move-j ready\n  \
        panelprep robot move-lin --speed-mm-s 30 445,20,682,180,30,180 --json\n\
        To keep one standing between commands, run `panelprep mock-robot` and name it as an \"eki\" robot at 127.0.0.1."
    )]
    Robot(Robot),
    /// A stand-alone mock controller on the cell's ports, by the wall clock.
    #[command(after_help = format!(
        "Example:\n  panelprep mock-robot --config config/kuka --fault e-stop/5s@30s\n\
        A rehearsal: in a cell with simulated cameras set [robot] kind = \"eki\" and host = \"127.0.0.1\", start this with --cell, \
        and run `panelprep cycle` with the same cell.\n\n--fault SPEC:\n{}", FaultSpec::HELP
    ))]
    MockRobot(MockRobot),
    /// Serve the cell until told to stop: the service that `panelprep ctl` talks to.
    #[command(
        after_help = "Example, after those of `panelprep teach --help` and `panelprep calibrate verify --help`:\n  \
        panelprep run --cell target/cell/cell.toml"
    )]
    Run(Run),
    /// After an abort of a cell without a service: says that the cause is gone. Asks the robot whether it stands, and proves
    /// tool and water off. Beside a service it is `panelprep ctl clear`.
    #[command(after_help = "Example:\n  panelprep clear --cell target/cell/cell.toml")]
    Clear,
    /// Ask the service that runs on this cell: start a cycle, hold it, stop it, see how it stands.
    #[command(after_help = "Example, beside `panelprep run --cell target/cell/cell.toml`:\n  \
        panelprep ctl reset --cell target/cell/cell.toml\n  \
        panelprep ctl start --cell target/cell/cell.toml --recipe target/cell/recipe.toml\n  \
        panelprep ctl state --cell target/cell/cell.toml --json\n\
        And once that cycle is over, the next one, waiting for its end:\n  \
        panelprep ctl reset --cell target/cell/cell.toml\n  \
        panelprep ctl start --cell target/cell/cell.toml --recipe target/cell/recipe.toml --part SN-0017 --order W-4 --wait")]
    Ctl(Ctl),
    /// The 3D camera's worker: started by this program, with a socket as its standard input.
    #[command(name = super::zivid::ROLE, hide = true)]
    ZividWorker(ZividWorker),
    /// Manual pages and shell completions, for `make package`.
    #[command(hide = true)]
    PackageFiles(PackageFiles),
    /// Check configuration files: cell, recipe, calibrations, EthernetKRL channels, KRL programs and data lists.
    #[command(
        after_help = "Example:\n  panelprep check config/cell.toml config/panels/example.toml\n  panelprep check config/kuka/CELLCMD.xml config/kuka/CELLSTAT.xml\n  panelprep check --kss 8.5 config/kuka/*.src config/kuka/*.dat"
    )]
    Check(Check),
    /// Check the cell from the bottom up, and say what to do: libraries, disk, clock, store, calibrations, EthernetKRL
    /// files, cameras, robot.
    #[command(after_help = "Example:\n  panelprep doctor --cell config/cell.toml --kuka config/kuka")]
    Doctor(Doctor),
    /// Say what the code of a message means and what to do; without a code, list all codes.
    #[command(after_help = "Example:\n  panelprep explain low_overlap")]
    Explain(Explain),
    /// Calibrate lenses, camera mounts and tools, and say how good they are.
    Calibrate(super::calibrate::args::Calibrate),
    /// Learn a panel at its nominal place from a scan and corner pictures.
    #[command(after_help = "Example, after `panelprep render --out target/cell`:\n  \
        panelprep teach --cell target/cell/cell.toml --recipe target/cell/recipe.toml --scan target/cell/taught_scan.pcd \
        --corner target/cell/taught_corner.png --flange target/cell/taught_flange.json --pictures target/cell/pictures")]
    Teach(Teach),
    /// Take pictures and scans with the cell's cameras, outside of a cycle and without any calibration: for commissioning.
    #[command(after_help = "Examples, with the simulated cameras of config/cell.toml:\n  \
        panelprep shoot scan --out target/shots\n  \
        panelprep shoot corner --count 2 --out target/shots\n  \
        panelprep shoot film --seconds 2 --pictures-per-second 2 --out target/film\n\
        Files are numbered on, and none is written over. A film's clip.csv lists its pictures for `panelprep inspect`.")]
    Shoot(Shoot),
    /// Draw a scan with a pixel ruler and its missing points: where a recipe's region is read from.
    #[command(after_help = "Example, after `panelprep render --out target/cell`:\n  \
        panelprep look --scan target/cell/taught_scan.pcd --pictures target/cell/pictures")]
    Look(Look),
    /// Find where the panel stands now, from a scan.
    #[command(after_help = "Example, after the one of `panelprep teach --help`:\n  \
        panelprep locate --cell target/cell/cell.toml --recipe target/cell/recipe.toml --scan target/cell/scan.pcd \
        --out target/cell/located.json")]
    Locate(Locate),
    /// Correct the place found by what a corner picture shows.
    #[command(after_help = "Example, after the one of `panelprep locate --help`:\n  \
        panelprep refine --cell target/cell/cell.toml --recipe target/cell/recipe.toml --located target/cell/located.json \
        --corner target/cell/corner.png --flange target/cell/flange.json --out target/cell/refined.json")]
    Refine(Refine),
    /// Test a clip of the wet panel for broken film.
    #[command(after_help = "Example, after the one of `panelprep locate --help`:\n  \
        panelprep inspect --cell target/cell/cell.toml --recipe target/cell/recipe.toml --clip target/cell/clip \
        --located target/cell/located.json --pictures target/cell/pictures\n\
        A labelled set, after `panelprep render --clips 6 --out target/cell` and the examples up to `locate`:\n  \
        panelprep inspect --cell target/cell/cell.toml --recipe target/cell/recipe.toml --truth target/cell/set \
        --located target/cell/located.json")]
    Inspect(Inspect),
    /// From a clip, labelled or clean: how well channels and grids tell wet from dry, how even the light is, which breaks are
    /// surely found, and what fits the recipe's method (thesis 4.2, 4.3).
    #[command(after_help = "Example, after the one of `panelprep locate --help`:\n  \
        panelprep tune --cell target/cell/cell.toml --recipe target/cell/recipe.toml --clip target/cell/clip \
        --located target/cell/located.json --truth target/cell/truth")]
    Tune(Tune),
    /// Mark where and when the film broke in a clip, on a page in a browser on this computer. What is saved lies beside the clip, which is
    /// then its own truth for `panelprep inspect` and `panelprep tune`.
    #[command(
        after_help = "Example, after `panelprep render --out target/cell`; the page ends with its button:\n  \
        panelprep label --clip target/cell/clip\n\
        With the grids of a recipe, after the one of `panelprep locate --help`:\n  \
        panelprep label --cell target/cell/cell.toml --recipe target/cell/recipe.toml --clip target/cell/clip \
        --located target/cell/located.json\n\
        Afterwards: panelprep inspect with --clip target/cell/clip --truth target/cell/clip. The clip's folder then holds labels.json, \
        mask.png and times.png; each former labels.json is kept as labels.1.json, labels.2.json and so on."
    )]
    Label(Label),
    /// Plan the sanding path over grids.
    #[command(after_help = "Example, after the one of `panelprep teach --help`:\n  \
        panelprep plan --cell target/cell/cell.toml --recipe target/cell/recipe.toml --grids r1c1,r1c2 \
        --out target/cell/plan.json --pictures target/cell/pictures")]
    Plan(Plan),
    /// Make the page of a cycle again, from what the store keeps of it.
    #[command(after_help = "Example, after the one of `panelprep cycle --help`:\n  \
        panelprep page 1 --cell target/cell/cell.toml")]
    Page(PageOf),
    /// Look after the store: is everything in it what was written?
    #[command(after_help = "Example, after the one of `panelprep teach --help`, also while the service runs:\n  \
        panelprep store verify --cell target/cell/cell.toml")]
    Store(StoreCommand),
    /// Copy the store, the configuration and the calibrations into one archive that is read back and verified; also while the
    /// service runs.
    #[command(after_help = "Example, after the one of `panelprep teach --help`:\n  \
        panelprep backup target/cell.tar.zst --cell target/cell/cell.toml\n\
        The archive is a tar file compressed by zstd. It holds no recordings and no pages: pages are made again from the store. A \
        recipe is in it where it lies in the folder of the cell's file or up to two folders below.")]
    Backup(Backup),
    /// Bring a backup back. Everything is unpacked and verified beside its place first; where anything is wrong, all stays as it
    /// was. Nothing that is there is replaced unless it is named, and what is replaced is kept.
    #[command(
        after_help = "Example, after the one of `panelprep backup --help`, beside the cell that it was made of:\n  \
        panelprep restore target/cell.tar.zst --cell target/restored/cell.toml\n\
        In place of the one that is there, with the service stopped:\n  \
        panelprep restore target/cell.tar.zst --cell target/restored/cell.toml --only store --replace store\n\
        Exit codes: 0 restored, 1 the backup is damaged and nothing was changed, 2 something is there already or in use."
    )]
    Restore(Restore),
    /// Write a commented file for a new cell or a new panel, which `panelprep check` accepts: asks what matters, and looks what is
    /// connected.
    New(New),
    /// Run a recorded cycle again on what was recorded, without devices, and tell where it now decides otherwise.
    #[command(
        after_help = "Example:\n  panelprep demo --reduction 4 --out target/demo4 --record target/demo4.mcap\n  \
        panelprep replay target/demo4.mcap\n\
        The recording is an MCAP file: Foxglove and Lichtblick open it."
    )]
    Replay(Replay),
}

/// Options of `store`.
#[derive(Debug, Clone, Args)]
pub struct StoreCommand {
    /// What to do with it.
    #[command(subcommand)]
    pub what: StoreTask,
}

/// What may be done with a store.
#[derive(Debug, Clone, Subcommand)]
pub enum StoreTask {
    /// Hold every row against the chain of hashes, the chain against its head outside of the database, and every file
    /// against its hash: name what was changed, deleted, put in, reordered or rolled back.
    #[command(after_help = "Example, of a copy:\n  panelprep store verify --store /media/copy/store --rows-only\n\
        Exit codes: 0 nothing was found, 1 something was found, 2 there is no store to read.")]
    Verify(VerifyStore),
}

/// Options of `store verify`.
#[derive(Debug, Clone, Args)]
pub struct VerifyStore {
    /// Leave out the files (scans, pictures), which takes most of the time.
    #[arg(long)]
    pub rows_only: bool,
}

/// Options of `explain`.
#[derive(Debug, Clone, Args)]
pub struct Explain {
    /// The word in parentheses behind a message.
    pub code: Option<String>,
}

/// Options of `replay`.
#[derive(Debug, Clone, Args)]
pub struct Replay {
    /// What `--record` wrote.
    pub recording: PathBuf,
}

/// `panelprep page`.
#[derive(Debug, Args)]
pub struct PageOf {
    /// The number of the cycle.
    pub cycle: i64,
    /// Where the page goes; without it, where the service writes it: `reports/` in the store.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// How hard the films of a simulated cell are to read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum FilmName {
    /// Steady light and no glints.
    Calm,
    /// A good cell on a common day, as the simulated cell has it: some drift, glints, drops.
    #[default]
    Usual,
    /// Drift, flicker, a shadow, glints, drops, a dark or bright exposure, as the seed has it.
    Hard,
}

/// Options of `doctor`.
#[derive(Debug, Clone, Args)]
pub struct Doctor {
    /// Folder with the controller's CELLCMD.xml, CELLSTAT.xml and cell_data.dat, copied from it or to be copied to it.
    #[arg(long, value_name = "FOLDER")]
    pub kuka: Option<PathBuf>,
    /// Take 3D shots with a Zivid for ten minutes and follow its temperature: only then is it known to be warm.
    #[arg(long)]
    pub warm_up: bool,
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
    /// The simulated arm is off its drawing by so much at the tool, rms, mm, and is calibrated before the cycle; 0 is an arm as
    /// it is drawn.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = arm_error)]
    pub arm_error_mm: f64,
    /// Cameras and tool are calibrated, but the errors of the arm are not.
    #[arg(long, requires = "arm_error_mm")]
    pub uncorrected: bool,
    /// Record the cycle in a new file, for `panelprep replay` and Foxglove; a minute of film takes a gigabyte at full size.
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
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
    /// Which of the seed's places the panel stands at: the same panel with the same grease, displaced otherwise by each number;
    /// what it is taught by is the same for all of them.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub place: u32,
    /// Also pictures of boards, poses and touched points, for `panelprep calibrate`.
    #[arg(long)]
    pub boards: bool,
    /// How hard its films are to read.
    #[arg(long, value_enum, default_value_t)]
    pub film: FilmName,
    /// Add a labelled set of so many clips in `set`, of other grease each, every third one clean, for
    /// `panelprep inspect --truth`.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub clips: u32,
    /// Length of a wet film, s.
    #[arg(long, value_name = "S", default_value_t = 60, value_parser = clap::value_parser!(u32).range(5..=600))]
    pub seconds: u32,
    /// The folder to write; it must be empty, new, or one that `render` wrote.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Cameras with this many times fewer pixels each way; 1 is full size.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub reduction: u32,
    /// The simulated arm is off its drawing by so much at the tool, rms, mm; 0 is an arm as it is drawn.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = arm_error)]
    pub arm_error_mm: f64,
}

/// Options of `cycle` and `air-run`.
#[derive(Debug, Clone, Args)]
pub struct Cycle {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// A new disc is mounted: its wear is counted from zero.
    #[arg(long)]
    pub new_disc: bool,
    /// Record the cycle in a new file, for `panelprep replay` and Foxglove; a minute of film takes a gigabyte at full size.
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// What a simulated cell shows.
    #[command(flatten)]
    pub simulation: Simulation,
}

/// What `shoot` takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Shot {
    /// A 3D scan: organised PCD and PLY, and its colours as PNG.
    Scan,
    /// A picture by the 3D camera's colour sensor, in the cell's own light.
    Picture,
    /// Such pictures one after the other.
    Film,
    /// A picture by the camera on the flange.
    Corner,
}

impl Shot {
    /// Is it taken in the cell's own light?
    pub fn needs_light(self) -> bool {
        matches!(self, Shot::Picture | Shot::Film)
    }

    /// Is it a 3D scan?
    pub fn is_scan(self) -> bool {
        self == Shot::Scan
    }
}

/// Options of `shoot`.
#[derive(Debug, Clone, Args)]
pub struct Shoot {
    /// What to take.
    #[arg(value_enum)]
    pub what: Shot,
    /// Folder for the files.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// How many, one after the other; a film is one.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    pub count: u32,
    /// Length of a film, s.
    #[arg(long, default_value_t = 10.0, value_parser = film_seconds)]
    pub seconds: f64,
    /// Pictures of a film that are asked for in a second, at most.
    #[arg(long, value_name = "N", default_value_t = 5.0, value_parser = film_rate)]
    pub pictures_per_second: f64,
    /// From this second on the film's pictures are marked as taken under the spray, those before as dry.
    #[arg(long, value_name = "S")]
    pub spray_from_s: Option<f64>,
    /// From this second on they are marked as wet; a film without water is marked so from its begin.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub wet_from_s: f64,
    /// What a simulated cell shows.
    #[command(flatten)]
    pub simulation: Simulation,
}

fn film_seconds(text: &str) -> Result<f64, String> {
    let allowed = || "allowed are 0.1 to 600 s".to_owned();
    text.parse().ok().filter(|seconds| (0.1..=600.0).contains(seconds)).ok_or_else(allowed)
}

fn film_rate(text: &str) -> Result<f64, String> {
    let allowed = || "allowed are 0.1 to 60 a second".to_owned();
    text.parse().ok().filter(|rate| (0.1..=60.0).contains(rate)).ok_or_else(allowed)
}

/// The simulated arm of this seed; `None` where it is as it is drawn.
pub fn real_arm(seed: u64, error_mm: f64) -> Option<RealArm> {
    (error_mm > 0.0).then(|| RealArm::new(seed, error_mm))
}

/// Options of `robot`.
#[derive(Debug, Clone, Args)]
pub struct Robot {
    /// Which function.
    #[command(subcommand)]
    pub function: RobotFunction,
}

/// The functions of thesis Table 3.1. Each has an epoch of its own: base, tool and speed hold within it only.
#[derive(Debug, Clone, Subcommand)]
pub enum RobotFunction {
    /// get_current_state: what the controller says of itself.
    State,
    /// move_j: each axis to its angle.
    MoveJ {
        /// A name of the cell's [poses], or the six angles A1,…,A6 in degrees.
        #[arg(value_name = "NAME|A1,…,A6", allow_hyphen_values = true)]
        to: String,
        /// Share of the axes' full speed, %.
        #[arg(long, value_name = "PERCENT", default_value_t = 10, value_parser = clap::value_parser!(u8).range(1..=100))]
        axis_speed_percent: u8,
    },
    /// move_lin: the tip in a straight line, cut into steps that the gate sees.
    MoveLin {
        /// X,Y,Z,A,B,C in mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        to: String,
        /// The base that the pose is in, for example what `locate` printed; without it the robot's own.
        #[arg(long, value_name = "POSE", allow_hyphen_values = true)]
        base: Option<String>,
        /// What the tip is.
        #[arg(long, value_enum, default_value_t)]
        tool: TipName,
        /// Speed of the tip, mm/s; at most the cell's.
        #[arg(long, value_name = "MM/S", default_value_t = 50.0)]
        speed_mm_s: f64,
    },
    /// set_base: sets a base and reads it back.
    SetBase {
        /// X,Y,Z,A,B,C in mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        base: String,
    },
    /// set_tcp: sets a tool and reads it back.
    SetTcp {
        /// X,Y,Z,A,B,C of the tip in the flange, mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        flange_from_tool: String,
    },
    /// set_acc_speed: speeds of what follows in the same epoch; shows whether the controller takes them.
    SetSpeed {
        /// Speed of the tip, mm/s.
        speed_mm_s: f64,
        /// Acceleration of the tip, m/s².
        #[arg(long, value_name = "M/S2", default_value_t = 1.0)]
        acceleration_m_s2: f64,
        /// Share of the axes' full speed, %.
        #[arg(long, value_name = "PERCENT", default_value_t = 10, value_parser = clap::value_parser!(u8).range(1..=100))]
        axis_percent: u8,
    },
    /// set_digout: an output by its name in the cell's [io.outputs], where its interlocks hold.
    SetOut {
        /// The name, `light`.
        name: String,
        /// On or off.
        #[arg(value_enum)]
        value: OnOff,
        /// Wait so long before the epoch ends; the tool goes off with it.
        #[arg(long, value_name = "SECONDS", default_value_t = 0)]
        keep_s: u16,
    },
    /// set_digin: refused, since inputs of a KRC are read-only, unless the cell's [io.mapped_inputs] names it.
    SetIn {
        /// The number of the input.
        number: u16,
        /// On or off.
        #[arg(value_enum)]
        value: OnOff,
    },
    /// call_subroutine: one of the controller's own list.
    Call {
        /// Its index there.
        index: u16,
    },
    /// None of the nine: goes through what the installation page asks to be proven on the controller, and writes a page to
    /// sign. Tries what a client can try, asks for the rest; nothing moves by it.
    Prove(Prove),
}

/// Options of `robot prove`.
#[derive(Debug, Clone, Args)]
pub struct Prove {
    /// The page, HTML.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Who stands at the controller.
    #[arg(long, value_name = "NAME")]
    pub by: String,
}

/// What the tip is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum TipName {
    /// The flange itself.
    #[default]
    Flange,
    /// The flange camera, as calibrated.
    Camera,
    /// The sanding tool, as calibrated.
    Sanding,
}

/// A signal's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OnOff {
    /// On.
    On,
    /// Off.
    Off,
}

/// Options of `mock-robot`.
#[derive(Debug, Clone, Args)]
pub struct MockRobot {
    /// Folder with CELLCMD.xml and CELLSTAT.xml; without it the ones this program was built with, on the cell's ports.
    #[arg(long, value_name = "DIR")]
    pub config: Option<PathBuf>,
    /// What goes wrong, and when: see below.
    #[arg(long, value_name = "SPEC")]
    pub fault: Option<FaultSpec>,
    /// Execute the controller's KRL programs as they ship, in place of the model of them.
    #[arg(long)]
    pub programs: bool,
    /// Address to listen at.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    pub host: std::net::IpAddr,
}

/// Options of `run`.
#[derive(Debug, Clone, Args)]
pub struct Run {
    /// What a simulated cell shows.
    #[command(flatten)]
    pub simulation: Simulation,
}

/// Options of the 3D camera's worker.
#[derive(Debug, Clone, Args)]
pub struct ZividWorker {
    /// `libpanelprep_zivid.so`.
    #[arg(long, value_name = "FILE")]
    pub library: PathBuf,
}

/// Options of `ctl`.
#[derive(Debug, Clone, Args)]
pub struct Ctl {
    /// What to ask.
    #[command(subcommand)]
    pub ask: CtlAsk,
}

/// What may be asked.
#[derive(Debug, Clone, Subcommand)]
pub enum CtlAsk {
    /// Begin a cycle, from idle.
    Start {
        /// The panel's recipe.
        #[arg(long, value_name = "FILE")]
        recipe: PathBuf,
        /// Record the cycle for `panelprep replay` and Foxglove, in this new file, which the service writes; without a
        /// name in its store, as recordings/cycle-NNNNNN.mcap. Nobody but you removes it: a minute of film takes a
        /// gigabyte at full size.
        #[arg(long, value_name = "FILE", num_args = 0..=1)]
        record: Option<Option<PathBuf>>,
        /// The part that stands in the cell: kept with the cycle and shown on its page.
        #[command(flatten)]
        part: PartArguments,
        /// Wait for the cycle's end, tell each change, and end with the cycle's exit code. A cycle that is held waits on.
        #[arg(long)]
        wait: bool,
    },
    /// Leave what is going on: no further waypoint, tool off, retract.
    Hold,
    /// Go on after a hold, through a look at the corner.
    Unhold {
        /// The panel is dry: locate it again.
        #[arg(long)]
        dried: bool,
    },
    /// End the cycle.
    Stop,
    /// End everything at once.
    Abort,
    /// After an abort: the cause is gone and the pad is off the panel.
    Clear,
    /// From stopped or complete to idle: everything off and tested, no motion.
    Reset {
        /// Wait until the cell is idle, and end with 3 where it does not get there.
        #[arg(long)]
        wait: bool,
    },
    /// Held for review: the result is good.
    Accept,
    /// A new disc is mounted: its wear is counted from zero. Where the cell rests.
    NewDisc,
    /// How the cell stands: state, panel, pass, phase, seconds of film, waypoint, the last page.
    State,
    /// Follow the cell until this command is interrupted: a line for each change, with --json one object a line.
    Watch,
}

/// Which part a cycle is about, as far as it is told.
#[derive(Debug, Clone, Args)]
pub struct PartArguments {
    /// The part's serial number.
    #[arg(long = "part", value_name = "SERIAL")]
    pub serial: Option<String>,
    /// The work order.
    #[arg(long, value_name = "WORK_ORDER")]
    pub order: Option<String>,
    /// Who operates the cell.
    #[arg(long, value_name = "NAME")]
    pub operator: Option<String>,
}

/// Options of `check`.
#[derive(Debug, Clone, Args)]
pub struct Check {
    /// The files. KRL files that belong together are named together.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The lowest version of KUKA System Software that the KRL files are for, 8.2 to 8.7.
    #[arg(long, value_name = "VERSION", default_value_t = crate::krl::LOWEST_KSS)]
    pub kss: crate::krl::Kss,
    /// What a cell's file must be complete for.
    #[arg(long = "for", value_name = "PURPOSE", value_enum, default_value_t)]
    pub purpose: PurposeName,
}

/// What a cell's file must be complete for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum PurposeName {
    /// Commands on files alone: what is there must be right, nothing must be there.
    Files,
    /// One function of the robot at a time.
    Robot,
    /// `cycle`, `air-run` and `run`.
    #[default]
    Cycle,
}

/// Options of `teach`.
#[derive(Debug, Clone, Args)]
pub struct Teach {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// The scan at the nominal place: organised PCD or PLY.
    #[arg(long, value_name = "FILE", required_unless_present = "live")]
    pub scan: Option<PathBuf>,
    /// Take the scan and the corner pictures now, by the cell's cameras, and keep them in this folder; the region is drawn in a
    /// browser between them.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scan", "corner", "flange"])]
    pub live: Option<PathBuf>,
    /// Draw the region, its grids and what is masked on the scan's picture, in a browser on this computer; they are written into
    /// the recipe's file, its comments stay.
    #[arg(long)]
    pub draw: bool,
    /// With --live: the region is in the recipe already.
    #[arg(long, requires = "live", conflicts_with = "draw")]
    pub no_draw: bool,
    /// Where the page to draw on is served: a loopback address; port 0 takes a free one.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub listen: std::net::SocketAddr,
    /// What a simulated cell shows.
    #[command(flatten)]
    pub simulation: Simulation,
    /// A corner picture at the nominal place; repeatable, each with its `--flange`.
    #[arg(long, value_name = "FILE")]
    pub corner: Vec<PathBuf>,
    /// The flange's pose at that picture.
    #[arg(long, value_name = "POSE.json")]
    pub flange: Vec<PathBuf>,
    /// Folder for pictures of what was learnt; where nothing could be, of what was given.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `look`.
#[derive(Debug, Clone, Args)]
pub struct Look {
    /// The scan: organised PCD or PLY.
    #[arg(long, value_name = "FILE")]
    pub scan: PathBuf,
    /// Folder for the picture.
    #[arg(long, value_name = "DIR")]
    pub pictures: PathBuf,
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
    /// File for the place found, as `--json` prints it: what `--located` of other commands takes.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
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
    /// File for the corrected place, as `--json` prints it: what `--located` of other commands takes.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
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
    #[arg(long, value_name = "DIR", required_unless_present = "truth")]
    pub clip: Option<PathBuf>,
    /// A pose, or what `locate` or `refine` printed; without it the panel must stand in its nominal place, and where the dry
    /// picture shows it elsewhere the test is invalid.
    #[arg(long, value_name = "POSE.json")]
    pub located: Option<PathBuf>,
    /// Folder with the true mask, to score against; it changes no result. A clip that was labelled is its own truth. Without `--clip`
    /// a labelled set: a folder of clips, each with its own `truth` or labelled itself, is scored as a whole.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Folder for the mask, the overlay, the film strip and the page to sign; of a set, for its plots.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `tune`.
#[derive(Debug, Clone, Args)]
pub struct Tune {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// Folder with numbered pictures and `clip.csv`, a dry one among them.
    #[arg(long, value_name = "DIR")]
    pub clip: PathBuf,
    /// A pose, or what `locate` or `refine` printed; without it the panel must stand in its nominal place, and where the dry
    /// picture shows it elsewhere the test is invalid.
    #[arg(long, value_name = "POSE.json")]
    pub located: Option<PathBuf>,
    /// Folder with the true mask of the clip's end; a clip that was labelled is its own truth.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
}

/// Options of `label`.
#[derive(Debug, Clone, Args)]
pub struct Label {
    /// Folder with numbered pictures and `clip.csv`; the labels are kept in it.
    #[arg(long, value_name = "DIR")]
    pub clip: PathBuf,
    /// The panel's recipe: its grids are drawn over the pictures. The panel must have been taught.
    #[arg(long, value_name = "FILE")]
    pub recipe: Option<PathBuf>,
    /// A pose, or what `locate` or `refine` printed: where the panel of the grids stands; without it they are drawn at its nominal place.
    #[arg(long, value_name = "POSE.json", requires = "recipe")]
    pub located: Option<PathBuf>,
    /// Where the page is served: a loopback address; port 0 takes a free one.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub listen: std::net::SocketAddr,
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
