//! Tests who may log in, for how long a session is valid, and which of its data is recorded.

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
async fn a_session_counts_as_long_as_its_account_is_as_it_was() {
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
async fn wrong_passwords_are_counted_kept_and_pause_the_account() {
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
async fn no_client_without_an_account_is_let_in_unless_the_file_permits_it() {
    let anonymous = UserToken(opcua::server::ANONYMOUS_USER_TOKEN_ID.to_owned());
    for (setting, may) in [(AnonymousAccess::Nothing, false), (AnonymousAccess::Read, true)] {
        let (_folder, access) = access(setting);
        for mode in [MessageSecurityMode::None, MessageSecurityMode::SignAndEncrypt] {
            assert_eq!(access.authenticate_anonymous_token(&endpoint(mode)).await.is_ok(), may);
            assert_eq!(access.supports_anonymous(&endpoint(mode)), may);
            // No password is requested if it could be read during the transfer.
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
    assert_eq!(format_origin(&[address(1), address(2)]), "OPC UA, from one of the addresses 10.0.0.1, 10.0.0.2");
}
