//! `panelprep user`: manages the accounts of the operator's page, from a terminal of the cell's computer. The first
//! administrator is created with this command.

use super::args::{Common, User, UserTask};
use super::fault::Fault;
use super::output::Outcome;
use panelprep_base::random;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::accounts::{Account, AuditEntry, Role};
use panelprep_service::daemon::current_user;
use panelprep_service::setup::CellFiles;
use panelprep_store::store::Store;
use serde_json::json;
use std::io::{BufRead, IsTerminal};
use std::path::Path;

/// Runs one task of `panelprep user`.
///
/// # Errors
/// If the cell file has problems, the task is not possible for the account, or the store cannot be written.
pub fn run(args: &User, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    // Listing needs no right to write. Only a new account may create a store: the other tasks must not create one in a
    // mistyped folder.
    let store = match &args.what {
        UserTask::List => files.store()?,
        UserTask::Add { .. } => Store::open_for_accounts(files.store_folder()).map_err(Fault::stage)?,
        _ => {
            drop(files.store()?);
            Store::open_for_accounts(files.store_folder()).map_err(Fault::stage)?
        }
    };
    let mut people = UserAccounts { store };
    match &args.what {
        UserTask::Add { name, role, printed_name } => {
            people.add(name, *role, printed_name.as_deref().unwrap_or(name), &read_new_password(name)?)
        }
        UserTask::Password { name } => {
            let former = people.account(name)?;
            let account = check_account((name, &former.printed_name), former.role, &read_new_password(name)?)?;
            let account = Account { is_enabled: former.is_enabled, ..account };
            people.store_account(account, Some(&former), "password changed")
        }
        UserTask::Role { name, role } => {
            let former = people.account(name)?;
            people.store_account(Account { role: *role, ..former.clone() }, Some(&former), "role changed")
        }
        UserTask::Disable { name } => {
            let former = people.account(name)?;
            people.store_account(
                Account { is_enabled: false, ..former.clone() },
                Some(&former),
                "may no longer log in",
            )
        }
        UserTask::Enable { name } => {
            let former = people.account(name)?;
            people.store_account(Account { is_enabled: true, ..former.clone() }, Some(&former), "may log in again")
        }
        UserTask::List => people.list(),
    }
}

/// Adds an account with this password to the store of a demo cell.
///
/// # Errors
/// The errors of [`run`].
pub fn add(folder: &Path, (name, role): (&str, Role), password: &str) -> Result<(), Fault> {
    UserAccounts { store: Store::open_for_accounts(folder).map_err(Fault::stage)? }
        .add(name, role, name, password)
        .map(drop)
}

struct UserAccounts {
    store: Store,
}

impl UserAccounts {
    fn account(&self, name: &str) -> Result<Account, Fault> {
        let mut all = self.store.accounts().map_err(Fault::stage)?;
        let known: Vec<String> = all.keys().cloned().collect();
        all.remove(name).ok_or_else(|| Fault::Account {
            name: name.to_owned(),
            problem: match known.is_empty() {
                true => "no account exists yet; create one with `panelprep user add`".to_owned(),
                false => format!("the account does not exist; existing accounts: {}", known.join(", ")),
            },
        })
    }

    fn add(&mut self, name: &str, role: Role, printed_name: &str, password: &str) -> Result<Outcome, Fault> {
        let account = check_account((name, printed_name), role, password)?;
        if self.store.accounts().map_err(Fault::stage)?.contains_key(name) {
            let problem = "the account already exists; `panelprep user password` sets a new password";
            return Err(Fault::Account { name: name.to_owned(), problem: problem.to_owned() });
        }
        self.store_account(account, None, "added")
    }

    fn store_account(&mut self, account: Account, former: Option<&Account>, done: &str) -> Result<Outcome, Fault> {
        let who = current_user();
        let entry = AuditEntry {
            subject: Some(format!("{}: {done}", account.name)),
            before: former.map(Account::summary),
            after: Some(account.summary()),
            ..AuditEntry::for_completed_action(Some(who.to_string()), None, "terminal".to_owned(), "change account")
        };
        self.store.store_account(&account, &entry).map_err(Fault::stage)?;
        let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
        outcome.add_line(format!("account {}: {done} ({})", account.name, account.summary()));
        Ok(outcome)
    }

    fn list(&self) -> Result<Outcome, Fault> {
        let all = self.store.accounts().map_err(Fault::stage)?;
        let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
        for Account { name, printed_name, role, is_enabled, .. } in all.values() {
            let disabled = if *is_enabled { "" } else { ", may not log in" };
            outcome.add_line(format!("{name}: {printed_name}, {}{disabled}", role.keyword()));
        }
        let listed = |account: &Account| json!({"name": account.name, "printed_name": account.printed_name, "role": account.role, "is_enabled": account.is_enabled});
        outcome.add_value("accounts", json!(all.values().map(listed).collect::<Vec<_>>()));
        Ok(outcome)
    }
}

pub(super) fn check_account(
    (name, printed_name): (&str, &str),
    role: Role,
    password: &str,
) -> Result<Account, Fault> {
    let problem = |problem: String| Fault::Account { name: name.to_owned(), problem };
    let salt = random::bytes()
        .map_err(|error| problem(format!("the operating system returned no random numbers: {error}")))?;
    Account::create_validated((name, printed_name), (role, true), (Some(password), salt), None).map_err(problem)
}

/// Asks twice for the password at a terminal; if standard input is not a terminal, reads one line.
pub(super) fn read_new_password(name: &str) -> Result<String, Fault> {
    let problem = |problem: String| Fault::Account { name: name.to_owned(), problem };
    let stdin = std::io::stdin();
    if !stdin.is_terminal() {
        let mut line = String::new();
        stdin
            .lock()
            .read_line(&mut line)
            .map_err(|error| problem(format!("the password could not be read: {error}")))?;
        return Ok(line.trim_end_matches(['\r', '\n']).to_owned());
    }
    let ask = |words: &str| {
        rpassword::prompt_password(words)
            .map_err(|error| problem(format!("the password could not be read: {error}")))
    };
    let first = ask(&format!("Password of {name}: "))?;
    match ask("Repeat the password: ")? == first {
        true => Ok(first),
        false => Err(problem("the two passwords differ; nothing was changed".to_owned())),
    }
}
