//! The sender of a request to the page: a person with a role, or a visitor who is not logged in.

use super::page_texts::{Language, Translations};
use panelprep_cell::accounts::{Permission, Role};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use std::sync::Arc;

/// The sender of a request.
#[derive(Debug, Clone)]
pub(super) struct Visitor {
    /// Address of the client.
    pub from: String,
    /// The person, if one is logged in.
    pub person: Option<Person>,
    /// Whether the browser has the cookie of a session that is no longer valid.
    pub has_ended: bool,
    /// The language that was chosen; the next field has the languages that the browser prefers.
    pub chosen: Option<String>,
    pub accepted: Option<String>,
    pub words: Arc<Translations>,
}

/// A person who is logged in.
#[derive(Debug, Clone)]
pub(super) struct Person {
    pub name: String,
    pub printed_name: String,
    pub role: Role,
    /// The stamp of the account when the person logged in.
    pub stamp: String,
    pub csrf: String,
    pub token: String,
}

impl Visitor {
    /// Returns the words of the visitor's language.
    pub fn language(&self) -> Language<'_> {
        self.words.language(self.chosen.as_deref(), self.accepted.as_deref())
    }

    /// Returns the visitor in the form in which the service records the author of a request.
    pub fn as_requester(&self) -> RequestAuthor {
        let user = self.person.as_ref().map(|person| person.name.clone());
        RequestAuthor { front: RequestSource::Page, uid: None, user, from: Some(self.from.clone()) }
    }

    /// Returns whether the visitor's role has this permission; a visitor who is not logged in has none.
    pub fn has_permission(&self, permission: Permission) -> bool {
        self.person.as_ref().is_some_and(|person| person.role.has_permission(permission))
    }
}

/// Returns the key of a role's word.
pub(super) fn role_key(role: Role) -> &'static str {
    match role {
        Role::Display => "role.display",
        Role::Viewer => "role.viewer",
        Role::Operator => "role.operator",
        Role::Inspector => "role.inspector",
        Role::Engineer => "role.engineer",
        Role::Administrator => "role.administrator",
    }
}
