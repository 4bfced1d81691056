//! Arguments of the service, of its worker, of its clients, and of the command for the accounts of the operator's page.

use super::simulation::Simulation;
use clap::{Args, Subcommand};
use panelprep_cell::accounts::Role;
use panelprep_cell::record::PartNames;
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
    /// Only for `cycle`.
    #[arg(long, conflicts_with = "serial")]
    pub on_foam: bool,
    /// The part in the cell: kept with the cycle and shown on its page.
    #[command(flatten)]
    pub part: PartArguments,
    /// What the operator states about earlier abrasions of the part.
    #[command(flatten)]
    pub count: CountArguments,
    /// Record the cycle in a new file, for `panelprep replay` and Foxglove; a minute of film needs a gigabyte at
    /// full size.
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
    Start {
        /// The panel's recipe.
        #[arg(long, value_name = "FILE")]
        recipe: PathBuf,
        /// Record the cycle for `panelprep replay` and Foxglove, in this new file, which the service writes;
        /// without a name in its store, as recordings/cycle-NNNNNN.mcap. The service never removes a recording: a
        /// minute of film needs a gigabyte at full size.
        #[arg(long, value_name = "FILE", num_args = 0..=1)]
        record: Option<Option<PathBuf>>,
        /// The part in the cell: kept with the cycle and shown on its page.
        #[command(flatten)]
        part: PartArguments,
        /// What the operator states about earlier abrasions of the part.
        #[command(flatten)]
        count: CountArguments,
        /// Wait for the cycle's end, report each change, and end with the cycle's exit code. While a cycle is held,
        /// the wait continues.
        #[arg(long)]
        wait: bool,
    },
    /// Stop the work in progress: no further waypoint, tool off, retract.
    Hold,
    /// Continue after a hold, with a new picture of the corner.
    Unhold {
        /// The panel is dry: locate the panel again.
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
    /// After an abort: confirm that the cause is removed and the pad is off the panel.
    Clear {
        /// The state on which the decision is based.
        #[command(flatten)]
        decision: Decision,
    },
    /// Change from stopped or complete to idle: all outputs are switched off and checked, without motion.
    Reset {
        /// Wait until the cell is idle, and end with exit code 3 if the cell does not become idle.
        #[arg(long)]
        wait: bool,
    },
    /// While a cycle is held for review: accept the result as good.
    Accept {
        /// The state on which the decision is based.
        #[command(flatten)]
        decision: Decision,
    },
    /// A new disc is mounted: its wear is counted from zero. Possible when the cell is at rest.
    NewDisc,
    /// The cell's status: state, panel, pass, phase, seconds of film, waypoint, the last page.
    State,
    /// Follow the cell until this command is interrupted: prints one line for each change, with --json one object for
    /// each line.
    Watch,
}

/// The state on which a person's decision is based.
#[derive(Debug, Clone, Copy, Args)]
pub struct Decision {
    /// The step that `panelprep ctl state` showed. If the cell has changed since this step, the decision is refused
    /// and the change is reported. Without this option the state is shown, and the person confirms it by typing its
    /// step.
    #[arg(long, value_name = "N")]
    pub step: Option<u64>,
}

/// Statements of a person about the abrasions of the part, given at a start.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct CountArguments {
    /// The part in the fixture is not the part of the cycles before: abrasions in cycles without a serial number do not
    /// count for it. Abrasions of the same serial number always count. This statement is stored with the cycle.
    #[arg(long)]
    pub another_part: bool,
    /// After a restore from a backup: how many passes this part had in the cycles that the restored store lacks, 0 if
    /// it had none. They count, and the statement is stored with the cycle. For a part with a serial number only this
    /// statement answers what happened in the missing cycles.
    #[arg(long, value_name = "NUMBER", conflicts_with = "another_part")]
    pub lost_passes: Option<u8>,
}

impl PartArguments {
    /// Returns the names as they are given, without any check.
    pub fn names(&self) -> PartNames {
        let PartArguments { serial, order, operator } = self.clone();
        PartNames { serial, order, operator }
    }
}

/// The names of a cycle's part, as far as they are stated.
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
    /// Add an account. The command asks for the password; if standard input is not a terminal, the first line of
    /// standard input is the password.
    Add {
        /// The name to log in with: a to z, 0 to 9, dot, hyphen, underscore.
        name: String,
        /// The role of the person, which determines the permitted actions.
        #[arg(long, value_enum)]
        role: Role,
        /// The person's printed name, as a signature shows it; without it, the name to log in with.
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
    /// Disable an account: the person may not log in any more. All records of the account's actions stay.
    Disable {
        /// The account's name.
        name: String,
    },
    /// Enable an account: the person may log in again.
    Enable {
        /// The account's name.
        name: String,
    },
    /// List all accounts.
    List,
}
