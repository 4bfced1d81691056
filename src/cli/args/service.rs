//! Arguments of the service, its worker and its clients, and of the command for the accounts of the operator's page.

use super::simulation::Simulation;
use clap::{Args, Subcommand};
use panelprep_cell::accounts::Role;
use panelprep_cell::record::PartNames;
use panelprep_service::setup::PassStatement;
use std::path::PathBuf;

/// Options of `cycle` and `air-run`.
#[derive(Debug, Clone, Args)]
pub struct Cycle {
    /// The panel's recipe.
    #[arg(long, value_name = "FILE")]
    pub recipe: PathBuf,
    /// A new disc is mounted: its wear is counted from zero.
    #[arg(long)]
    pub new_disc: bool,
    /// A sheet of foam is in the cell instead of a panel: for stage C of `robot prove`, before `signed_stage` is "C".
    #[arg(long, conflicts_with = "serial")]
    pub on_foam: bool,
    /// The part in the cell; its names are stored with the cycle and shown on its page.
    #[command(flatten)]
    pub part: PartArguments,
    /// Statements of the operator about earlier sanding passes of the part.
    #[command(flatten)]
    pub count: CountArguments,
    /// Record the cycle in a new file, for `panelprep replay` and Foxglove; at full size, a minute of film needs a
    /// gigabyte.
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
}

/// Options of `run`.
#[derive(Debug, Clone, Args)]
pub struct Run {
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
}

/// Options of the 3D camera's worker.
#[derive(Debug, Clone, Args)]
pub struct ZividWorker {
    /// The path of the library `libpanelprep_zivid.so`.
    #[arg(long, value_name = "FILE")]
    pub library: PathBuf,
}

/// Options of `ctl`.
#[derive(Debug, Clone, Args)]
pub struct Ctl {
    /// The request.
    #[command(subcommand)]
    pub ask: CtlAsk,
}

/// The possible requests.
#[derive(Debug, Clone, Subcommand)]
pub enum CtlAsk {
    /// Start a cycle; the cell must be idle.
    Start(CtlStart),
    /// Stop the work in progress: no further waypoint, tool off, retract.
    Hold,
    /// Continue after a hold, with a new picture of the corner.
    Unhold {
        /// The panel is dry: locate it again.
        #[arg(long)]
        dried: bool,
        /// The state on which the decision is based.
        #[command(flatten)]
        decision: Decision,
    },
    /// End the cycle.
    Stop,
    /// Abort immediately: the arm stops, tool and water are switched off, and the cycle ends.
    Abort,
    /// After an abort: confirm that the cause is removed and that the pad is not on the panel.
    Clear {
        /// The state on which the decision is based.
        #[command(flatten)]
        decision: Decision,
    },
    /// Change from stopped or complete to idle: all outputs are switched off and checked, without motion.
    Reset {
        /// Wait until the cell is idle; exit with code 3 if it does not become idle.
        #[arg(long)]
        wait: bool,
    },
    /// Accept the result as good, while a cycle is held for review.
    Accept {
        /// The state on which the decision is based.
        #[command(flatten)]
        decision: Decision,
    },
    /// A new disc is mounted: its wear is counted from zero. Only possible while the cell is at rest.
    NewDisc,
    /// Show the status of the cell: state, panel, pass, phase, seconds of film, waypoint, the last page.
    State,
    /// Watch the cell until this command is interrupted: print one line for each change, with --json one object per
    /// line.
    Watch,
}

/// Options of `ctl start`.
#[derive(Debug, Clone, Args)]
pub struct CtlStart {
    /// The panel's recipe. Without this option, the panel in the cell is compared with all taught panels, as by
    /// `panelprep identify`, and its recipe is proposed; the cycle starts after the panel's name is typed.
    #[arg(long, value_name = "FILE")]
    pub recipe: Option<PathBuf>,
    /// Record the cycle for `panelprep replay` and Foxglove, in this new file, which the service writes;
    /// without a name in its store, as recordings/cycle-NNNNNN.mcap. The service never removes a recording: a
    /// minute of film needs a gigabyte at full size.
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    pub record: Option<Option<PathBuf>>,
    /// The part in the cell: kept with the cycle and shown on its page.
    #[command(flatten)]
    pub part: PartArguments,
    /// What the operator states about earlier abrasions of the part.
    #[command(flatten)]
    pub count: CountArguments,
    /// Wait for the cycle's end, report each change, and end with the cycle's exit code. While a cycle is held,
    /// the wait continues.
    #[arg(long)]
    pub wait: bool,
}

/// The state on which a person's decision is based.
#[derive(Debug, Clone, Copy, Args)]
pub struct Decision {
    /// The step that `panelprep ctl state` showed. If the cell has changed since this step, the decision is refused and
    /// the change is reported. Without this option, the state is shown, and the person confirms it by typing its step.
    #[arg(long, value_name = "N")]
    pub step: Option<u64>,
}

/// Statements of a person about earlier sanding passes of the part, made at the start of a cycle.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct CountArguments {
    /// Another part is in the fixture than in the previous cycles: sanding passes of cycles without a serial number are
    /// not counted for this part. Passes with the same serial number are always counted. This statement is stored with
    /// the cycle.
    #[arg(long)]
    pub another_part: bool,
    /// After a restore from a backup: how many sanding passes this part had in the cycles that are missing in the
    /// restored store, 0 if none. They are counted, and the statement is stored with the cycle. For a part with a
    /// serial number, only this statement replaces the missing cycles.
    #[arg(long, value_name = "NUMBER", conflicts_with = "another_part")]
    pub lost_passes: Option<u8>,
}

impl CountArguments {
    /// Returns what these options state.
    pub fn statement(self) -> PassStatement {
        PassStatement { another_part: self.another_part, lost_passes: self.lost_passes }
    }
}

impl PartArguments {
    /// Returns the names of the part as given on the command line, without a check.
    pub fn names(&self) -> PartNames {
        let PartArguments { serial, order, operator } = self.clone();
        PartNames { serial, order, operator }
    }
}

/// The names of a cycle's part; each is optional.
#[derive(Debug, Clone, Args)]
pub struct PartArguments {
    /// The part's serial number.
    #[arg(long = "part", value_name = "SERIAL")]
    pub serial: Option<String>,
    /// The work order.
    #[arg(long, value_name = "WORK_ORDER")]
    pub order: Option<String>,
    /// The person who operates the cell.
    #[arg(long, value_name = "NAME")]
    pub operator: Option<String>,
}

/// Options of `user`.
#[derive(Debug, Clone, Args)]
pub struct User {
    /// What to do.
    #[command(subcommand)]
    pub what: UserTask,
}

/// The tasks of the account command.
#[derive(Debug, Clone, Subcommand)]
pub enum UserTask {
    /// Add an account. The command asks for the password; if standard input is not a terminal, its first line is the
    /// password.
    Add {
        /// The login name: a to z, 0 to 9, dot, hyphen, underscore.
        name: String,
        /// The role of the person, which determines the permitted actions.
        #[arg(long, value_enum)]
        role: Role,
        /// The printed name of the person for signatures; without this option, the login name.
        #[arg(long, value_name = "NAME")]
        printed_name: Option<String>,
    },
    /// Set a new password.
    Password {
        /// The account's name.
        name: String,
    },
    /// Change the role of a person.
    Role {
        /// The account's name.
        name: String,
        /// The new role of the person.
        #[arg(value_enum)]
        role: Role,
    },
    /// Disable an account: the person can no longer log in. All records of the person's actions are kept.
    Disable {
        /// The account's name.
        name: String,
    },
    /// Enable an account: the person can log in again.
    Enable {
        /// The account's name.
        name: String,
    },
    /// List all accounts.
    List,
}
