//! The command line: commands, options and their help texts. Scripts use the names of commands and options, so these
//! must not change.

mod files;
mod robot;
mod service;
mod simulation;
mod storage;

pub use files::{
    Check, Doctor, FlangeCameraKind, Identify, Inspect, Label, Locate, Look, New, NewCell, NewFile, NewRecipe,
    PackageFiles, Plan, PurposeName, Refine, RobotKindName, ScannerKind, Teach, Tune,
};
pub use robot::{OnOff, Prove, Robot, RobotFunction, Shoot, Shot, TipName};
pub use service::{
    CountArguments, Ctl, CtlAsk, CtlStart, Cycle, Decision, PartArguments, Run, User, UserTask, ZividWorker,
};
pub use simulation::{
    Demo, FilmName, MockRobot, Render, SceneName, Simulation, ToolName, TreatName, real_arm, scanner_distortion,
};
pub use storage::{
    Archive, ArchiveAccount, ArchiveTask, Backup, BackupPart, CheckArchive, EndName, Explain, ExportRecord, Fleet,
    HeadOfRecords, History, HistoryTask, MeaningName, OfferRecipe, PageOf, RecordCommand, RecordTask, RenewStore,
    Replay, Restore, RunArchive, SearchArguments, SignRecord, StoreCommand, StoreTask, VerifyRecord, VerifyStore,
    parse_non_empty,
};

use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use panelprep_devices::mock::FaultSpec;
use panelprep_service::setup::CellPaths;
use std::path::PathBuf;

/// Finds a composite panel, tests it for grease with water, and plans where to sand.
#[derive(Debug, Parser)]
#[command(name = "panelprep", version, arg_required_else_help = true)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Options that every command has.
    #[command(flatten)]
    pub common: Common,
}

impl Arguments {
    /// Parses the command line. If it has an error or requests help, prints a message and ends the program.
    pub fn parse_command_line() -> Self {
        let matches = accept_negative_numbers(Self::command()).get_matches();
        Self::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
    }
}

/// Makes the parser accept a negative number as the value of each option. Otherwise the parser would report an unknown
/// option instead of the valid values.
fn accept_negative_numbers(command: clap::Command) -> clap::Command {
    let takes = |arg: clap::Arg| match arg.get_action().takes_values() {
        true => arg.allow_negative_numbers(true),
        false => arg,
    };
    command.mut_args(takes).mut_subcommands(accept_negative_numbers)
}

/// Options that every command has.
#[derive(Debug, Clone, Args)]
pub struct Common {
    /// The cell file: cameras, robot, calibrations, limits.
    #[arg(long, global = true, env = "PANELPREP_CELL", value_name = "FILE", default_value = "config/cell.toml")]
    pub cell: PathBuf,
    /// Folder of the store with taught panels and cycles; without this option, the `store` of the cell file.
    #[arg(long, global = true, value_name = "FOLDER")]
    pub store: Option<PathBuf>,
    /// Print only one JSON object on standard output.
    #[arg(long, global = true)]
    pub json: bool,
}

impl Common {
    /// Returns the places of the cell's data.
    pub fn paths(&self) -> CellPaths {
        CellPaths { cell: self.cell.clone(), store: self.store.clone() }
    }
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run one complete cycle on a simulated cell, write its page and pictures, and report its errors relative to the
    /// true values.
    #[command(after_help = "Example:\n  panelprep demo --seed 3 --out target/demo")]
    Demo(Demo),
    /// Write a simulated cell as files: calibrations, recipe, scans, pictures, a clip, and the true values in a
    /// separate folder.
    #[command(
        after_help = "Examples, with the pictures for `panelprep calibrate`, the same panel at another pose, and a 3D camera with its own errors:\n  \
        panelprep render --seed 1 --boards --out target/cell\n  \
        panelprep render --seed 1 --place 2 --out target/cell2\n  \
        panelprep render --seed 1 --board-scans 16 --scanner-error-mm 1 --out target/cell3"
    )]
    Render(Render),
    /// Run one cycle on the cell: locate the panel, refine its pose, wet it, inspect it, and sand the failed grids,
    /// until the panel passes or the maximum number of passes is reached.
    #[command(
        after_help = "Example, after the examples of `panelprep teach --help` and `panelprep calibrate verify --help`:\n  \
        panelprep cycle --cell target/cell/cell.toml --recipe target/cell/recipe.toml --seed 1"
    )]
    Cycle(Cycle),
    /// Move along the planned path over all grids above the panel: no water, tool off, no contact.
    #[command(
        after_help = "Example, after the examples of `panelprep teach --help` and `panelprep calibrate verify --help`:\n  \
        panelprep air-run --cell target/cell/cell.toml --recipe target/cell/recipe.toml --seed 1"
    )]
    AirRun(Cycle),
    /// Execute one function of the robot at a time, for commissioning. Each command is checked as in a cycle.
    #[command(
        after_help = "Examples, with the mock robot of config/cell.toml, which starts at its home pose each \
                      time:\n  panelprep robot state\n  panelprep robot move-j ready\n  panelprep robot move-lin \
                      --speed-mm-s 30 445,20,682,180,30,180 --json\nTo keep the mock controller running between \
                      commands, run `panelprep mock-robot` and set [robot] kind = \"eki\" and host = \"127.0.0.1\"."
    )]
    Robot(Robot),
    /// Run a mock controller as a separate program on the cell's ports, in real time.
    #[command(after_help = format!(
        "Example:\n  panelprep mock-robot --config config/kuka --fault e-stop/5s@30s\n\
        A rehearsal: in a cell with simulated cameras set [robot] kind = \"eki\" and host = \"127.0.0.1\", start this command with \
        --cell, and run `panelprep cycle` with the same cell.\n\n--fault SPEC:\n{}", FaultSpec::HELP
    ))]
    MockRobot(MockRobot),
    /// Run the service of the cell, which processes the requests of `panelprep ctl`, until it is stopped.
    #[command(
        after_help = "Example, after the examples of `panelprep teach --help` and `panelprep calibrate verify --help`:\n  \
        panelprep run --cell target/cell/cell.toml"
    )]
    Run(Run),
    /// After an abort in a cell without a service: confirm that the cause is removed. Checks that the robot is at rest
    /// and that tool and water are off. With a service, use `panelprep ctl clear`.
    #[command(after_help = "Example:\n  panelprep clear --cell target/cell/cell.toml")]
    Clear,
    /// Send a request to the running service of this cell: start a cycle, hold or stop it, show the state.
    #[command(after_help = "Example, while `panelprep run --cell target/cell/cell.toml` runs:\n  \
        panelprep ctl reset --cell target/cell/cell.toml\n  \
        panelprep ctl start --cell target/cell/cell.toml --recipe target/cell/recipe.toml\n  \
        panelprep ctl state --cell target/cell/cell.toml --json\n\
        After the end of that cycle, start the next cycle and wait for its end:\n  \
        panelprep ctl reset --cell target/cell/cell.toml\n  \
        panelprep ctl start --cell target/cell/cell.toml --recipe target/cell/recipe.toml --part SN-0017 --order W-4 --wait")]
    Ctl(Ctl),
    /// The worker process of the 3D camera: started by this program, with a socket as its standard input.
    #[command(name = panelprep_service::setup::cameras::ZIVID_ROLE, hide = true)]
    ZividWorker(ZividWorker),
    /// Write the manual pages and shell completions, for `make package`.
    #[command(hide = true)]
    PackageFiles(PackageFiles),
    /// Check configuration files: cell, recipe, calibrations, EthernetKRL channels, KRL programs and data lists.
    #[command(
        after_help = "Example:\n  panelprep check config/cell-example.toml config/panels/example.toml\n  panelprep check config/kuka/CELLCMD.xml config/kuka/CELLSTAT.xml\n  panelprep check --kss 8.5 config/kuka/*.src config/kuka/*.dat"
    )]
    Check(Check),
    /// Check the whole cell and report what to do: libraries, disk, clock, store, calibrations, EthernetKRL files,
    /// cameras, robot.
    #[command(after_help = "Example:\n  panelprep doctor --cell config/cell.toml --kuka config/kuka")]
    Doctor(Doctor),
    /// Explain the code of a message and what to do; without a code, list all codes.
    #[command(after_help = "Example:\n  panelprep explain low_overlap")]
    Explain(Explain),
    /// Calibrate lenses, camera mounts, the arm and tools, and report their uncertainty.
    Calibrate(super::calibrate::args::Calibrate),
    /// Teach a panel at its nominal pose, from a scan and corner pictures, or from its drawing.
    #[command(after_help = "Example, after `panelprep render --out target/cell`:\n  \
        panelprep teach --cell target/cell/cell.toml --recipe target/cell/recipe.toml --scan target/cell/taught_scan.pcd \
        --corner target/cell/taught_corner.png --flange target/cell/taught_flange.json --pictures target/cell/pictures\n  \
        From the drawing, after `panelprep render --drawing --out target/cell`, with these options instead: --recipe target/cell/recipe_drawing.toml --nominal target/cell/drawing.stl \
        --flange target/cell/taught_flange.json --pictures target/cell/pictures")]
    Teach(Teach),
    /// Capture pictures and scans with the cell's cameras, outside of a cycle and without a calibration: for
    /// commissioning.
    #[command(after_help = "Examples, with the simulated cameras of config/cell.toml:\n  \
        panelprep shoot scan --out target/shots\n  \
        panelprep shoot corner --count 2 --out target/shots\n  \
        panelprep shoot film --seconds 2 --pictures-per-second 2 --out target/film\n\
        File numbers continue after those of existing files, and no file is overwritten. A film's clip.csv lists its pictures for `panelprep inspect`.")]
    Shoot(Shoot),
    /// Draw a scan with a pixel ruler and its missing points, to read the pixel coordinates of a region's corners for a
    /// recipe.
    #[command(after_help = "Example, after `panelprep render --out target/cell`:\n  \
        panelprep look --scan target/cell/taught_scan.pcd --pictures target/cell/pictures")]
    Look(Look),
    /// Compare a scan with all taught panels and propose the panel that it shows; nothing starts by itself.
    #[command(after_help = "Example, after the example of `panelprep teach --help`:\n  \
        panelprep identify --cell target/cell/cell.toml --scan target/cell/scan.pcd")]
    Identify(Identify),
    /// Find the panel's present pose from a scan.
    #[command(after_help = "Example, after the example of `panelprep teach --help`:\n  \
        panelprep locate --cell target/cell/cell.toml --recipe target/cell/recipe.toml --scan target/cell/scan.pcd \
        --out target/cell/located.json")]
    Locate(Locate),
    /// Correct the panel's pose with corner pictures.
    #[command(after_help = "Example, after the example of `panelprep locate --help`:\n  \
        panelprep refine --cell target/cell/cell.toml --recipe target/cell/recipe.toml --located target/cell/located.json \
        --corner target/cell/corner.png --flange target/cell/flange.json --out target/cell/refined.json")]
    Refine(Refine),
    /// Inspect a clip of the wet panel for breaks of the water film.
    #[command(after_help = "Example, after the example of `panelprep locate --help`:\n  \
        panelprep inspect --cell target/cell/cell.toml --recipe target/cell/recipe.toml --clip target/cell/clip \
        --located target/cell/located.json --pictures target/cell/pictures\n\
        A labelled set, after `panelprep render --clips 6 --out target/cell` and the examples up to `locate`:\n  \
        panelprep inspect --cell target/cell/cell.toml --recipe target/cell/recipe.toml --truth target/cell/set \
        --located target/cell/located.json")]
    Inspect(Inspect),
    /// Report from a clip, with or without labels: how well each channel and grid distinguishes wet from dry, how
    /// uniform the light is, which breaks are found reliably, and which values to use in the recipe's method (thesis
    /// 4.2, 4.3).
    #[command(after_help = "Example, after the example of `panelprep locate --help`:\n  \
        panelprep tune --cell target/cell/cell.toml --recipe target/cell/recipe.toml --clip target/cell/clip \
        --located target/cell/located.json --truth target/cell/truth")]
    Tune(Tune),
    /// Mark where and when the film broke in a clip, on a page in a browser on this computer. The marks are saved in
    /// the folder of the clip, which then contains its own true mask for `panelprep inspect` and `panelprep tune`.
    #[command(
        after_help = "Example, after `panelprep render --out target/cell`; end the page with its button:\n  \
                      panelprep label --clip target/cell/clip\nWith the grids of a recipe, after the example of \
                      `panelprep locate --help`:\n  panelprep label --cell target/cell/cell.toml --recipe \
                      target/cell/recipe.toml --clip target/cell/clip --located \
                      target/cell/located.json\nAfterwards: panelprep inspect with --clip target/cell/clip --truth \
                      target/cell/clip. The clip's folder then contains labels.json, mask.png and times.png; each \
                      former labels.json is kept as labels.1.json, labels.2.json and so on."
    )]
    Label(Label),
    /// Plan the sanding path over grids.
    #[command(after_help = "Example, after the example of `panelprep teach --help`:\n  \
        panelprep plan --cell target/cell/cell.toml --recipe target/cell/recipe.toml --grids r1c1,r1c2 \
        --out target/cell/plan.json --pictures target/cell/pictures")]
    Plan(Plan),
    /// Create the page of a cycle again, from the data of the cycle in the store.
    #[command(after_help = "Example, after the example of `panelprep cycle --help`:\n  \
        panelprep page 1 --cell target/cell/cell.toml")]
    Page(PageOf),
    /// Search the cycles of the store, compare two cycles, show trends over many cycles, list alarms.
    #[command(
        after_help = "Examples, after the example of `panelprep cycle --help`, also while the service runs:\n  \
        panelprep history --verdict pass --from 2026-01-01 --cell target/cell/cell.toml\n  \
        panelprep history show 1 --cell target/cell/cell.toml\n  \
        panelprep history trend simulated-panel localization-residual --cell target/cell/cell.toml\n\
        With --csv each command prints a table for a spreadsheet, with --json one object. Times are in UTC."
    )]
    History(History),
    /// Sign, export and verify the records of cycles, and show the head of their hash chain.
    Record(RecordCommand),
    /// Verify that the content of the store was not changed or damaged.
    #[command(
        after_help = "Example, after the example of `panelprep teach --help`, also while the service runs:\n  \
        panelprep store verify --cell target/cell/cell.toml"
    )]
    Store(StoreCommand),
    /// Run or check the archive of the office server, which stores the records of all cells and can prove that they are
    /// complete.
    Archive(Archive),
    /// Serve the web page of the office server: state, cycles, statistics, verifications and recipes of all cells, from
    /// the archive.
    #[command(after_help = "Example, while `panelprep archive run` runs with the same settings:\n  \
        panelprep fleet --settings /etc/panelprep/archive.toml")]
    Fleet(Fleet),
    /// Manage the accounts of the operator's page: who may log in, and with which role. Create the first administrator
    /// with this command.
    #[command(
        after_help = "Example, after the example of `panelprep teach --help`, also while the service runs:\n  \
        panelprep user list --cell target/cell/cell.toml\n\
        And with the password as the first line of standard input:\n  \
        echo 'a long password' | panelprep user add anna --role administrator --cell target/cell/cell.toml"
    )]
    User(User),
    /// Copy the store, the configuration and the calibrations into one archive file, and verify the copy. This also
    /// works while the service runs.
    #[command(after_help = "Example, after the example of `panelprep teach --help`:\n  panelprep backup \
                            target/cell.tar.zst --cell target/cell/cell.toml\nThe archive is a tar file compressed \
                            by zstd. The archive contains no recordings and no pages: pages are made again from the \
                            store. The archive contains a recipe if the recipe is in the folder of the cell's file \
                            or up to two folders below.")]
    Backup(Backup),
    /// Restore a backup. It is first unpacked and verified next to its final path; if there is any error, nothing is
    /// changed. Existing parts are replaced only if they are named, and the replaced parts are kept.
    #[command(
        after_help = "Example, after the example of `panelprep backup --help`, next to the original cell:\n  \
                      panelprep restore target/cell.tar.zst --cell target/restored/cell.toml --last-cycle 2\nTo replace \
                      the existing store, with the service stopped:\n  panelprep restore target/cell.tar.zst \
                      --cell target/restored/cell.toml --only store --replace store\nExit codes: 0 restored, 1 the \
                      backup is damaged and nothing was changed, 2 something already exists or is in use."
    )]
    Restore(Restore),
    /// Write a file with comments for a new cell or a new panel, which `panelprep check` accepts. The command asks for
    /// the important values and detects connected devices.
    New(New),
    /// Run a recorded cycle again with the recorded data, without devices, and report each decision that has changed.
    #[command(
        after_help = "Example:\n  panelprep demo --reduction 4 --out target/demo4 --record target/demo4.mcap\n  \
        panelprep replay target/demo4.mcap\n\
        The recording is an MCAP file: Foxglove and Lichtblick can open this file."
    )]
    Replay(Replay),
}
