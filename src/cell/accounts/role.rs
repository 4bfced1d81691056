//! Roles, and what each of them may do.

use panelprep_base::config::Choice;
use serde::{Deserialize, Serialize};
use strum::VariantArray;

/// What a person may do at the cell.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Hash,
    Serialize,
    Deserialize,
    strum::IntoStaticStr,
    strum::EnumString,
    strum::VariantArray,
    clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Role {
    /// A screen on the wall: it looks, and its session does not end by itself.
    Display,
    /// May read everything and change nothing.
    Viewer,
    /// May run cycles.
    Operator,
    /// Judges results and signs records.
    Inspector,
    /// The process engineer: runs cycles and changes recipes.
    Engineer,
    /// May manage accounts.
    Administrator,
}

/// An action that a role may permit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, strum::VariantArray)]
pub enum Permission {
    /// To see states, records and trends.
    View,
    /// To start, hold, continue, clear and reset, and to state that a new disc is mounted.
    Operate,
    /// To accept a result that waits for a person.
    Accept,
    /// To acknowledge alarms.
    Acknowledge,
    /// To sign a record.
    Sign,
    /// To change and approve recipes.
    Configure,
    /// To read the audit trail.
    Audit,
    /// To add and change accounts.
    ManagePeople,
}

impl Role {
    /// Returns the roles that have this permission.
    pub fn roles_with_permission(permission: Permission) -> impl Iterator<Item = Role> {
        Role::VARIANTS.iter().copied().filter(move |role| role.has_permission(permission))
    }

    /// The role's keyword, as it is stored.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns whether this role has the permission.
    pub fn has_permission(self, permission: Permission) -> bool {
        use Permission::{Accept, Acknowledge, Audit, Configure, ManagePeople, Operate, Sign, View};
        match self {
            Role::Display | Role::Viewer => matches!(permission, View),
            // To accept a deviation is not the task of the person who runs the parts.
            Role::Operator => matches!(permission, View | Operate | Acknowledge),
            Role::Inspector => matches!(permission, View | Accept | Acknowledge | Sign | Audit),
            Role::Engineer => matches!(permission, View | Operate | Accept | Acknowledge | Configure | Audit),
            Role::Administrator => matches!(permission, View | Audit | ManagePeople),
        }
    }
}

impl Choice for Role {
    const KEYWORDS: &'static [(&'static str, Self)] = &[
        ("display", Role::Display),
        ("viewer", Role::Viewer),
        ("operator", Role::Operator),
        ("inspector", Role::Inspector),
        ("engineer", Role::Engineer),
        ("administrator", Role::Administrator),
    ];
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Duties are separate: the person who changes accounts neither runs the cell nor signs, and the person who
    /// signs neither runs cycles nor changes recipes.
    #[test]
    fn duties_are_separate() {
        let all =
            |permission| -> Vec<&str> { Role::roles_with_permission(permission).map(Role::keyword).collect() };
        assert_eq!(
            all(Permission::View),
            ["display", "viewer", "operator", "inspector", "engineer", "administrator"]
        );
        assert_eq!(all(Permission::Operate), ["operator", "engineer"]);
        assert_eq!(all(Permission::Accept), ["inspector", "engineer"]);
        assert_eq!(all(Permission::Acknowledge), ["operator", "inspector", "engineer"]);
        assert_eq!(all(Permission::Sign), ["inspector"]);
        assert_eq!(all(Permission::Configure), ["engineer"]);
        assert_eq!(all(Permission::Audit), ["inspector", "engineer", "administrator"]);
        assert_eq!(all(Permission::ManagePeople), ["administrator"]);
    }

    #[test]
    fn words_read_back() {
        for role in Role::VARIANTS {
            assert_eq!(role.keyword().parse(), Ok(*role));
            assert!(Role::KEYWORDS.contains(&(role.keyword(), *role)), "{role:?}");
        }
    }
}
