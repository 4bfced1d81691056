//! The requests of a host to the cell, and the lines of the audit trail for what never reached the cell.

use crate::daemon::gateway::Gateway;
use crate::daemon::people::AccountService;
use crate::daemon::request::RequestKind;
use panelprep_cell::accounts::{AuditEntry, Role};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_interfaces::sparkplug::{AuditNote, NodeCommand};
use std::sync::Arc;

/// The destinations of commands and of lines of the audit trail.
#[derive(Clone)]
pub(super) struct HostRequests {
    pub gateway: Gateway,
    pub people: Arc<AccountService>,
    /// The origin of the commands, in the audit trail.
    pub origin: String,
}

impl HostRequests {
    /// Makes the request to the cell, by the same requests and gates as the operator's page. The loop records the
    /// request with its result; a line of the audit trail is written only for a request that the loop never received.
    pub async fn request_cell(self, command: NodeCommand, is_noted: bool) {
        let Some(request) = command.request() else { return };
        let from = Some(self.origin.clone());
        let who = RequestAuthor { from, ..RequestAuthor::from_source(RequestSource::Sparkplug) };
        let reply = self.gateway.request(RequestKind::Table(request), who).await;
        if is_noted && reply.may_be_unrecorded() {
            let refused = Some(reply.joined_reasons());
            self.write_audit(AuditNote { what: command.keyword().to_owned(), subject: None, refused }).await;
        }
    }

    /// Records a line of the audit trail, on a thread that may wait for the disk.
    pub async fn write_audit(self, note: AuditNote) {
        let AuditNote { what, subject, refused } = note;
        // The role that the cell's file gives to all hosts; it is not known which host made this request.
        let role = refused.is_none().then_some(Role::Operator);
        let entry = AuditEntry {
            subject,
            refused,
            ..AuditEntry::for_completed_action(None, role, self.origin.clone(), &what)
        };
        #[expect(
            clippy::let_underscore_must_use,
            reason = "an entry that cannot be stored is written to the service's log"
        )]
        let _ = tokio::task::spawn_blocking(move || self.people.audit(&entry)).await;
    }
}
