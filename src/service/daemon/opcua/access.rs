//! The log-in at the OPC UA server. Names and passwords are those of the operator's page. A session is valid only as
//! long as its account is unchanged since the log-in.

use super::connection_limit::ConnectionLimiter;
use crate::daemon::people::{AccountService, LoginResult, account_stamp};
use async_trait::async_trait;
use opcua::server::ServerEndpoint;
use opcua::server::address_space::AccessLevel;
use opcua::server::authenticator::{
    AuthManager, Password, UserToken, user_pass_security_policy_id, user_pass_security_policy_uri,
};
use opcua::types::{Error, MessageSecurityMode, NodeId, StatusCode, UAString, UserTokenPolicy, UserTokenType};
use panelprep_cell::accounts::{Account, AuditEntry, Permission, Role};
use panelprep_cell::cell::AnonymousAccess;
use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::{Arc, PoisonError, RwLock};

/// The policy ID that async-opcua uses for a log-in without an account.
const ANONYMOUS_POLICY: &str = "anonymous";

/// The client that calls a method or reads a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Caller {
    /// A client without an account.
    Anonymous,
    /// A person who logged in.
    Person {
        /// The account's name.
        name: String,
        /// The printed name.
        printed_name: String,
        /// The role now.
        role: Role,
    },
}

impl Caller {
    /// Returns the role of the caller; `None` for a caller without an account.
    pub fn role(&self) -> Option<Role> {
        match self {
            Caller::Anonymous => None,
            Caller::Person { role, .. } => Some(*role),
        }
    }

    /// The account's name.
    pub fn name(&self) -> Option<&str> {
        match self {
            Caller::Anonymous => None,
            Caller::Person { name, .. } => Some(name),
        }
    }
}

/// Returns the token of a session: the account's name, and a stamp of the account's state at the log-in. A new password
/// or a new role changes the token.
fn token(account: &Account) -> String {
    format!("{}#{}", account.name, account_stamp(account))
}

/// The accounts that may use the OPC UA server, with their permissions.
pub(super) struct Access {
    people: Arc<AccountService>,
    connections: Arc<ConnectionLimiter>,
    anonymous: AnonymousAccess,
    /// The valid tokens with their callers, as of the last update of the accounts.
    valid: RwLock<BTreeMap<String, Caller>>,
    /// The numbers of the secure channels on which each token was used.
    channels: RwLock<BTreeMap<String, Vec<u32>>>,
}

impl Access {
    pub fn new(people: Arc<AccountService>, door: Arc<ConnectionLimiter>, anonymous: AnonymousAccess) -> Self {
        Access { people, connections: door, anonymous, valid: RwLock::default(), channels: RwLock::default() }
    }

    /// Updates the accounts to their present state. Ends the connections of sessions whose account was changed or
    /// disabled.
    pub fn update_accounts(&self, accounts: &BTreeMap<String, Account>) {
        let enabled = accounts.values().filter(|account| account.is_enabled);
        let valid: BTreeMap<String, Caller> =
            enabled.map(|account| (token(account), caller_from_account(account))).collect();
        let mut channels = self.channels.write().unwrap_or_else(PoisonError::into_inner);
        channels.retain(|token, seen| {
            let still = valid.contains_key(token);
            if !still {
                seen.iter().for_each(|channel| self.connections.disconnect_channel(*channel));
            }
            still
        });
        drop(channels);
        *self.valid.write().unwrap_or_else(PoisonError::into_inner) = valid;
    }

    /// Returns the caller with this token; `None` if the token is not valid or has expired.
    pub fn caller_of_token(&self, token: &UserToken) -> Option<Caller> {
        if token.is_anonymous() {
            return (self.anonymous == AnonymousAccess::Read).then_some(Caller::Anonymous);
        }
        self.valid.read().unwrap_or_else(PoisonError::into_inner).get(&token.0).cloned()
    }

    /// Records that this token was used on this channel.
    pub fn remember_channel(&self, token: &UserToken, channel: u32) {
        if token.is_anonymous() {
            return;
        }
        let mut channels = self.channels.write().unwrap_or_else(PoisonError::into_inner);
        let seen = channels.entry(token.0.clone()).or_default();
        if !seen.contains(&channel) {
            seen.push(channel);
            seen.retain(|channel| self.connections.address_of_channel(*channel).is_some());
        }
    }

    /// Returns the accounts and their audit trail.
    pub fn accounts_with_audit(&self) -> &Arc<AccountService> {
        &self.people
    }

    /// Returns the origin of a session on this channel, as it is written in the audit trail.
    pub fn session_origin(&self, channel: u32) -> String {
        self.connections
            .address_of_channel(channel)
            .map_or_else(|| "OPC UA".to_owned(), |address| format!("OPC UA, {address}"))
    }

    /// Returns the possible addresses of a log-in: all connected addresses, because async-opcua does not report the
    /// connection of a log-in.
    pub fn addresses(&self) -> String {
        format_origin(&self.connections.addresses())
    }

    async fn write_audit(&self, line: AuditEntry) {
        let people = self.people.clone();
        if tokio::task::spawn_blocking(move || people.audit(&line)).await.is_err() {
            tracing::warn!(
                "an entry of the audit trail is lost, because the thread that writes the entries has \
                            ended: restart the service and report this"
            );
        }
    }
}

fn format_origin(addresses: &[IpAddr]) -> String {
    match addresses {
        [] => "OPC UA".to_owned(),
        [one] => format!("OPC UA, {one}"),
        several => {
            let several: Vec<String> = several.iter().take(5).map(ToString::to_string).collect();
            format!("OPC UA, from one of the addresses {}", several.join(", "))
        }
    }
}

fn caller_from_account(account: &Account) -> Caller {
    let Account { name, printed_name, role, .. } = account;
    Caller::Person { name: name.clone(), printed_name: printed_name.clone(), role: *role }
}

#[async_trait]
impl AuthManager for Access {
    async fn authenticate_anonymous_token(&self, _: &ServerEndpoint) -> Result<(), Error> {
        match self.anonymous {
            AnonymousAccess::Read => Ok(()),
            AnonymousAccess::Nothing => Err(Error::new(
                StatusCode::BadIdentityTokenRejected,
                "log in with an account of the operator's page",
            )),
        }
    }

    async fn authenticate_username_identity_token(
        &self,
        _: &ServerEndpoint,
        name: &str,
        password: &Password,
    ) -> Result<UserToken, Error> {
        let line = |role| AuditEntry::for_completed_action(Some(name.to_owned()), role, self.addresses(), "log in");
        let (status, problem) = match self.people.attempt_login(name, password.get().to_owned()).await {
            LoginResult::Right(account) => {
                self.valid
                    .write()
                    .unwrap_or_else(PoisonError::into_inner)
                    .insert(token(&account), caller_from_account(&account));
                self.write_audit(line(Some(account.role))).await;
                return Ok(UserToken(token(&account)));
            }
            LoginResult::Wrong(why) => {
                let line = AuditEntry { refused: Some(why.to_owned()), ..line(None) };
                let people = self.people.clone();
                if tokio::task::spawn_blocking(move || people.audit_failed_login(&line)).await.is_err() {
                    tracing::warn!(
                        "an entry of the audit trail is lost, because the thread that writes the entries \
                                    has ended: restart the service and report this"
                    );
                }
                (
                    StatusCode::BadUserAccessDenied,
                    "name or password is wrong, or the account is disabled".to_owned(),
                )
            }
            LoginResult::Pauses(left_s) => {
                let problem = format!(
                    "the account is locked after too many wrong passwords; try again in {:.0} s",
                    left_s.ceil()
                );
                (StatusCode::BadUserAccessDenied, problem)
            }
            LoginResult::Unknown => (
                StatusCode::BadUserAccessDenied,
                "name or password is wrong, or the account is disabled".to_owned(),
            ),
        };
        Err(Error::new(status, problem))
    }

    fn effective_user_access_level(&self, token: &UserToken, level: AccessLevel, _: &NodeId) -> AccessLevel {
        let may_look = match self.caller_of_token(token) {
            Some(Caller::Anonymous) => true,
            Some(Caller::Person { role, .. }) => role.has_permission(Permission::View),
            None => false,
        };
        if may_look { level & AccessLevel::CURRENT_READ } else { AccessLevel::empty() }
    }

    fn user_token_policies(&self, endpoint: &ServerEndpoint) -> Vec<UserTokenPolicy> {
        let policy = |policy_id, token_type| UserTokenPolicy {
            policy_id,
            token_type,
            issued_token_type: UAString::null(),
            issuer_endpoint_url: UAString::null(),
            security_policy_uri: UAString::null(),
        };
        let mut policies = Vec::new();
        if self.anonymous == AnonymousAccess::Read {
            policies.push(policy(UAString::from(ANONYMOUS_POLICY), UserTokenType::Anonymous));
        }
        // A password is accepted only on an encrypted connection, so that others cannot read it.
        if endpoint.message_security_mode() == MessageSecurityMode::SignAndEncrypt {
            policies.push(UserTokenPolicy {
                security_policy_uri: user_pass_security_policy_uri(endpoint),
                ..policy(user_pass_security_policy_id(endpoint), UserTokenType::UserName)
            });
        }
        policies
    }
}

#[cfg(test)]
mod tests {
    //! Tests who may log in, how long a session is valid, and which data of a session are recorded.

    use super::*;
    use opcua::crypto::SecurityPolicy;
    use panelprep_cell::accounts;
    use panelprep_store::store::Store;
    use strum::VariantArray;
    use tempfile::TempDir;

    fn endpoint(mode: MessageSecurityMode) -> ServerEndpoint {
        let policy = match mode {
            MessageSecurityMode::None => SecurityPolicy::None,
            _ => SecurityPolicy::Basic256Sha256,
        };
        ServerEndpoint::new("/", policy, mode, &[])
    }

    fn ada(role: Role, password: &str) -> Account {
        let password_hash = accounts::hash_password(password, "ada", [7; 16]).expect("allowed");
        let (name, printed_name) = ("ada".to_owned(), "Ada B".to_owned());
        Account { name, printed_name, role, password_hash, is_enabled: true }
    }

    fn keep(folder: &TempDir, account: &Account) {
        let mut store = Store::open_for_accounts(&folder.path().join("store")).expect("open");
        let entry = AuditEntry::for_completed_action(None, None, "terminal".to_owned(), "change account");
        store.store_account(account, &entry).expect("kept");
    }

    fn access(anonymous: AnonymousAccess) -> (TempDir, Access) {
        let folder = tempfile::tempdir().expect("a folder");
        drop(Store::create(&folder.path().join("store")).expect("a store"));
        keep(&folder, &ada(Role::Operator, "correct horse"));
        let people = Arc::new(AccountService::new(folder.path().join("store")));
        (folder, Access::new(people, Arc::default(), anonymous))
    }

    async fn log_in(access: &Access, name: &str, password: &str) -> Result<UserToken, Error> {
        let secure = endpoint(MessageSecurityMode::SignAndEncrypt);
        access.authenticate_username_identity_token(&secure, name, &Password::new(password.to_owned())).await
    }

    fn read(access: &Access, token: &UserToken) -> bool {
        let asked = AccessLevel::CURRENT_READ | AccessLevel::CURRENT_WRITE;
        let given = access.effective_user_access_level(token, asked, &NodeId::null());
        assert!(!given.contains(AccessLevel::CURRENT_WRITE), "nothing is written");
        given.contains(AccessLevel::CURRENT_READ)
    }

    #[tokio::test]
    async fn a_session_is_valid_while_its_account_is_unchanged() {
        let (_folder, access) = access(AnonymousAccess::Nothing);
        let token = log_in(&access, "ada", "correct horse").await.expect("right");
        assert_eq!(access.caller_of_token(&token).and_then(|caller| caller.role()), Some(Role::Operator));
        assert!(read(&access, &token));
        let same = ada(Role::Operator, "correct horse");
        let learn =
            |account: &Account| access.update_accounts(&BTreeMap::from([(account.name.clone(), account.clone())]));
        for changed in [
            ada(Role::Viewer, "correct horse"),
            ada(Role::Operator, "another horse"),
            Account { is_enabled: false, ..same.clone() },
        ] {
            learn(&same);
            assert!(read(&access, &token));
            learn(&changed);
            assert_eq!(access.caller_of_token(&token), None, "{changed:?}");
            assert!(!read(&access, &token));
        }
        access.update_accounts(&BTreeMap::new());
        assert_eq!(access.caller_of_token(&token), None);
    }

    #[tokio::test]
    async fn wrong_passwords_are_counted_recorded_and_block_the_account() {
        let (_folder, access) = access(AnonymousAccess::Nothing);
        for _ in 0..accounts::MAX_ATTEMPTS {
            assert!(log_in(&access, "ada", "wrong horse").await.is_err());
        }
        let paused = log_in(&access, "ada", "correct horse").await.expect_err("it pauses");
        assert!(paused.to_string().contains("try again in"), "{paused}");
        assert!(log_in(&access, "nobody", "correct horse").await.is_err());
        assert!(log_in(&access, "Ada' --", "correct horse").await.is_err());
        let audit = access.people.read(|store| store.audit(None, 100)).expect("read");
        let wrong = audit.iter().filter(|line| line.entry.what == "log in" && line.entry.refused.is_some()).count();
        assert_eq!(wrong, accounts::MAX_ATTEMPTS as usize + 1, "{audit:#?}");
    }

    #[tokio::test]
    async fn no_client_without_an_account_is_accepted_unless_the_file_permits_it() {
        let anonymous = UserToken(opcua::server::ANONYMOUS_USER_TOKEN_ID.to_owned());
        for (setting, may) in [(AnonymousAccess::Nothing, false), (AnonymousAccess::Read, true)] {
            let (_folder, access) = access(setting);
            for mode in [MessageSecurityMode::None, MessageSecurityMode::SignAndEncrypt] {
                assert_eq!(access.authenticate_anonymous_token(&endpoint(mode)).await.is_ok(), may);
                assert_eq!(access.supports_anonymous(&endpoint(mode)), may);
                // No password is requested on a connection on which others could read it.
                assert_eq!(access.supports_user_pass(&endpoint(mode)), mode != MessageSecurityMode::None);
                assert!(!access.supports_x509(&endpoint(mode)) && !access.supports_issued_token(&endpoint(mode)));
            }
            assert_eq!(read(&access, &anonymous), may);
            assert_eq!(access.caller_of_token(&anonymous).and_then(|caller| caller.role()), None);
        }
        assert!(Role::VARIANTS.iter().all(|role| role.has_permission(Permission::View)), "every role looks");
    }

    #[test]
    fn a_log_in_is_reported_to_come_from_connected_users() {
        let address = |last| IpAddr::from([10, 0, 0, last]);
        assert_eq!(format_origin(&[]), "OPC UA");
        assert_eq!(format_origin(&[address(1)]), "OPC UA, 10.0.0.1");
        assert_eq!(
            format_origin(&[address(1), address(2)]),
            "OPC UA, from one of the addresses 10.0.0.1, 10.0.0.2"
        );
    }
}
