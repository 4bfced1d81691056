//! Arguments of the command for the accounts of the operator's page.

use clap::{Args, Subcommand};
use panelprep_cell::accounts::Role;

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
