//! The permissions of users in the socket's group: the cell's file gives these users one role.
//!
//! The user who runs the service, and root, may request everything: they can do it without the socket as well. Every
//! person who has access to the cell may request stop and abort.

use crate::daemon::request::{RecipeTextPermission, RequestKind};
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts::{Permission, Role};
use panelprep_cell::cycle::Request;
use panelprep_cell::record::RequestAuthor;

/// A rule for the requests of a role.
#[derive(Debug, Clone, Copy)]
pub(super) struct AccessRule {
    /// The role of the socket's users; without a role they may request everything.
    pub role: Option<Role>,
    /// The user who runs the service.
    pub service_uid: u32,
}

impl AccessRule {
    /// Returns whether this user's start may contain a recipe that is not in the folder. This requires the permission
    /// to change the folder.
    pub fn recipe_text_permission(self, who: &RequestAuthor) -> RecipeTextPermission {
        match self.limiting_role(who) {
            Some(role) if !role.has_permission(Permission::Configure) => RecipeTextPermission::Refused,
            _ => RecipeTextPermission::Allowed,
        }
    }

    /// Returns the role that limits this user; `None` if the user has no limits.
    fn limiting_role(self, who: &RequestAuthor) -> Option<Role> {
        self.role.filter(|_| who.uid.is_none_or(|uid| uid != 0 && uid != self.service_uid))
    }

    /// Returns why this user may not request it; `None` if it is allowed.
    pub fn refusal(self, who: &RequestAuthor, what: &RequestKind) -> Option<Reason> {
        let role = self.limiting_role(who)?;
        let needed = needed_permission(what)?;
        if role.has_permission(needed) {
            return None;
        }
        let may: Vec<&str> = Role::roles_with_permission(needed).map(Role::keyword).collect();
        let message = format!(
            "\"{}\" is not permitted through the socket: its users have the role {} (socket_role in the cell's \
             file); permitted roles: {}",
            what.describe(),
            role.keyword(),
            may.join(", ")
        );
        Some(Reason::new("not_permitted", message))
    }
}

/// Returns the permission that a role needs for this request; `None` if every user may make it.
fn needed_permission(what: &RequestKind) -> Option<Permission> {
    match what {
        RequestKind::Table(Request::Stop | Request::Abort) => None,
        RequestKind::State => Some(Permission::View),
        RequestKind::Table(Request::Accept)
        | RequestKind::Decided { request: Request::Accept, .. }
        | RequestKind::Outdated { request: Request::Accept, .. } => Some(Permission::Accept),
        RequestKind::Decided { .. } | RequestKind::Outdated { .. } => Some(Permission::Operate),
        RequestKind::Start(_)
        | RequestKind::Begin(_)
        | RequestKind::Refused { .. }
        | RequestKind::NewDisc
        | RequestKind::Shoot(_)
        | RequestKind::Hold { .. }
        | RequestKind::Leave
        | RequestKind::Table(
            Request::Start { .. }
            | Request::AirRun { .. }
            | Request::Hold
            | Request::Unhold { .. }
            | Request::Clear
            | Request::Reset,
        ) => Some(Permission::Operate),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::record::RequestSource;
    use strum::VariantArray;

    const SERVICE: u32 = 990;

    fn refusal(role: Option<Role>, who: &RequestAuthor, what: &RequestKind) -> Option<Reason> {
        AccessRule { role, service_uid: SERVICE }.refusal(who, what)
    }

    fn who(uid: u32) -> RequestAuthor {
        RequestAuthor { front: RequestSource::Socket, uid: Some(uid), user: None, from: None }
    }

    /// Every role with every request of the protocol: a viewer reads, stops and aborts, an inspector also accepts, an
    /// operator does everything except accept, and an engineer does everything.
    #[test]
    fn the_group_may_what_its_role_may() {
        let table = |request: Request| match request.is_operator_decision() {
            true => RequestKind::Decided { request, step: 3 },
            false => RequestKind::Table(request),
        };
        let all = || {
            let unhold = Request::Unhold { dried: true };
            let rows = [
                Request::Stop,
                Request::Abort,
                Request::Accept,
                Request::Hold,
                unhold,
                Request::Clear,
                Request::Reset,
            ];
            rows.into_iter().map(table).chain([RequestKind::State, RequestKind::NewDisc])
        };
        for (role, allowed) in [
            (Role::Viewer, vec!["stop", "abort", "state"]),
            (Role::Administrator, vec!["stop", "abort", "state"]),
            (Role::Inspector, vec!["stop", "abort", "accept", "state"]),
            (
                Role::Operator,
                vec!["stop", "abort", "hold", "unhold --dried", "clear", "reset", "state", "new-disc"],
            ),
        ] {
            let open = all().filter(|what| refusal(Some(role), &who(1_001), what).is_none());
            assert_eq!(open.map(|what| what.describe()).collect::<Vec<_>>(), allowed, "{role:?}");
        }
        for role in [Some(Role::Engineer), None] {
            assert!(all().all(|what| refusal(role, &who(1_001), &what).is_none()), "{role:?}");
        }
        for uid in [0, SERVICE] {
            assert!(all().all(|what| refusal(Some(Role::Viewer), &who(uid), &what).is_none()), "{uid}");
        }
        let unknown = RequestAuthor { front: RequestSource::Socket, uid: None, user: None, from: None };
        assert!(
            refusal(Some(Role::Viewer), &unknown, &RequestKind::NewDisc).is_some(),
            "an unknown user is not root"
        );
        let reported =
            refusal(Some(Role::Viewer), &who(1_001), &RequestKind::Table(Request::Hold)).expect("refused");
        assert!(
            reported.code == "not_permitted" && reported.message.contains("permitted roles: operator, engineer"),
            "{reported:?}"
        );
        assert_eq!(Role::VARIANTS.len(), 6);
    }

    /// An operator, or a person with a role that permits less, can only start recipes of the folder.
    #[test]
    fn a_text_of_ones_own_needs_a_role_that_may_change_the_folder() {
        let own = |role, uid| AccessRule { role, service_uid: SERVICE }.recipe_text_permission(&who(uid));
        for role in Role::VARIANTS.iter().copied() {
            let expected =
                if role == Role::Engineer { RecipeTextPermission::Allowed } else { RecipeTextPermission::Refused };
            assert_eq!(own(Some(role), 1_001), expected, "{role:?}");
            assert_eq!(own(Some(role), 0), RecipeTextPermission::Allowed, "root can do it without the socket");
        }
        assert_eq!(own(None, 1_001), RecipeTextPermission::Allowed, "the cell's file sets no limit");
    }
}
