//! Arguments of the command about people at the operator's page.

use crate::accounts::Role;
use clap::{Args, Subcommand};

/// Options of `user`.
#[derive(Debug, Clone, Args)]
pub struct User {
    /// What to do.
    #[command(subcommand)]
    pub what: UserTask,
}

/// What may be done with accounts.
#[derive(Debug, Clone, Subcommand)]
pub enum UserTask {
    /// Add an account. The command asks for the password; if standard input is not a terminal, its first line is
    /// the password.
    Add {
        /// The name to log in with: a to z, 0 to 9, dot, hyphen, underscore.
        name: String,
        /// What the person may do.
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
    /// Change what a person may do.
    Role {
        /// The account's name.
        name: String,
        /// What the person may do from now on.
        #[arg(value_enum)]
        role: Role,
    },
    /// The person may not log in any more. What the account did stays in every record.
    Disable {
        /// The account's name.
        name: String,
    },
    /// The person may log in again.
    Enable {
        /// The account's name.
        name: String,
    },
    /// List all accounts.
    List,
}
