//! Accounts: who may log in, and with which role.

use super::answers::{Answer, panic_response, reading};
use super::guard::{VisitorExtension, refusal};
use super::layout::{Frame, Script};
use super::sessions::{Visitor, role_key};
use super::state::{Web, entry, hashing};
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use maud::{Markup, html};
use panelprep_base::random;
use panelprep_cell::accounts::{Account, AuditEntry, MAX_PRINTED, Permission, Role};
use panelprep_store::store::Store;
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::Arc;
use strum::VariantArray;

/// Shows all accounts, with a form for each.
pub(super) async fn page(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Answer {
    let accounts = reading(&web, &visitor, Store::accounts).await?;
    let words = visitor.language();
    let word = |key| words.text(key);
    let body = html! {
        section.card {
            h2 { (word("people.title")) }
            table {
                thead { tr { th { (word("login.name")) } th { (word("people.printed")) } th { (word("people.role")) } th { (word("people.enabled")) } td {} } }
                tbody {
                    @for account in accounts.values() {
                        tr {
                            td { (account.name) }
                            td { (account.printed_name) }
                            td { (word(role_key(account.role))) }
                            td { (word(if account.is_enabled { "yes" } else { "no" })) }
                            td { details { summary { (word("people.change")) } (account_form(&visitor, Some(account))) } }
                        }
                    }
                }
            }
        }
        section.card.narrow { h2 { (word("people.add")) } (account_form(&visitor, None)) }
    };
    let frame =
        Frame { visitor: &visitor, title: word("people.title"), here: "/people", scripts: &[Script::Forms] };
    Ok(frame.page(&body))
}

fn account_form(visitor: &Visitor, account: Option<&Account>) -> Markup {
    let words = visitor.language();
    let word = |key| words.text(key);
    let (name, printed) = account.map_or(("", ""), |account| (&account.name, &account.printed_name));
    html! {
        form data-post="/people" data-then="/people" {
            @match account {
                Some(_) => input type="hidden" name="name" value=(name);,
                None => {
                    input type="hidden" name="is_new" value="true";
                    label { (word("login.name")) input name="name" required maxlength="40" autocomplete="off"; }
                },
            }
            label { (word("people.printed")) input name="printed_name" value=(printed) required maxlength=(MAX_PRINTED) autocomplete="off"; }
            label { (word("people.role"))
                select name="role" {
                    @for role in Role::VARIANTS {
                        option value=(role.keyword()) selected[account.is_some_and(|account| account.role == *role)] { (word(role_key(*role))) }
                    }
                }
            }
            label { (word(if account.is_some() { "people.new_password" } else { "login.password" }))
                input name="password" type="password" autocomplete="new-password" required[account.is_none()] maxlength="200"; }
            @if let Some(account) = account {
                label.check { input type="checkbox" name="is_enabled" checked[account.is_enabled]; (word("people.enabled")) }
            } @else {
                input type="hidden" name="is_enabled" value="true";
            }
            p.told role="status" {}
            button.primary type="submit" { (word("save")) }
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AccountChange {
    /// Whether the account is to be added: one that exists is not changed.
    #[serde(default)]
    is_new: bool,
    name: String,
    printed_name: String,
    role: Role,
    #[serde(default)]
    password: String,
    is_enabled: bool,
}

/// Adds an account or changes one.
pub(super) async fn save(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Json(changed): Json<AccountChange>,
) -> Response {
    let (shared, line, name) = (web.clone(), entry(&visitor, "change account"), changed.name.clone());
    let exists = visitor.language().text("people.exists").to_owned();
    match hashing(&web, move || store_change(&shared, line, changed, exists)).await {
        Some(Ok(())) => {
            // The person's permissions have changed: the old role must not remain in use.
            web.sessions().end_account_sessions(&name);
            Json(json!({ "message": visitor.language().text("saved") })).into_response()
        }
        Some(Err(problem)) => refusal(StatusCode::UNPROCESSABLE_ENTITY, "account", &problem),
        None => panic_response(),
    }
}

fn store_change(web: &Web, line: AuditEntry, changed: AccountChange, exists: String) -> Result<(), String> {
    let accounts = web.read(|store| store.accounts()).map_err(|error| error.to_string())?;
    let former = accounts.get(&changed.name);
    if changed.is_new && former.is_some() {
        // Signatures under this name would belong to another person.
        return Err(exists);
    }
    let account = account(&changed, former)?;
    if removes_last_administrator(&accounts, &account) {
        return Err(
            "this account is the last enabled account that may manage accounts; create another administrator first"
                .to_owned(),
        );
    }
    let line = AuditEntry {
        subject: Some(account.name.clone()),
        before: former.map(Account::summary),
        after: Some(account.summary()),
        ..line
    };
    web.write(|store| store.store_account(&account, &line)).map_err(|error| error.to_string())
}

fn account(changed: &AccountChange, former: Option<&Account>) -> Result<Account, String> {
    let AccountChange { name, printed_name, role, password, is_enabled, .. } = changed;
    let salt = random::bytes().map_err(|error| format!("this computer has no random numbers: {error}"))?;
    let password = Some(password.as_str()).filter(|password| !password.is_empty());
    Account::create_validated((name, printed_name), (*role, *is_enabled), (password, salt), former)
}

/// Returns whether, after this change, no account would be left that may change accounts.
fn removes_last_administrator(accounts: &BTreeMap<String, Account>, changed: &Account) -> bool {
    let may = |account: &Account| account.is_enabled && account.role.has_permission(Permission::ManagePeople);
    !may(changed) && !accounts.values().any(|other| other.name != changed.name && may(other))
}
