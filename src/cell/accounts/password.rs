//! Password hashes, and the pause (lockout) of an account after several wrong passwords.
//!
//! Passwords are stored as argon2id hashes with the parameters that OWASP's cheat sheet requires (19 MiB, two passes,
//! one lane). During the pause no password is checked, so that guessing is useless; after the pause the person can log
//! in again.

use argon2::password_hash::phc::PasswordHash;
use argon2::password_hash::{PasswordHasher, PasswordVerifier};
use argon2::{Algorithm, Argon2, Params, Version};
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Minimum length of a password, characters. NIST SP 800-63B requires eight if the password is the only factor; here it
/// is also used to sign.
pub const MIN_PASSWORD_CHARACTERS: usize = 10;
/// Maximum length of a password, characters: hashing a very long password would keep the computer busy.
const MAX_PASSWORD_CHARACTERS: usize = 200;
/// Memory of argon2id, KiB.
const MEMORY_KIB: u32 = 19 * 1_024;
const HASH_PASSES: u32 = 2;

/// The reason why a password is not accepted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PasswordError {
    /// The password is too short or too long.
    #[error(
        "the password has {found} characters; the limits are {MIN_PASSWORD_CHARACTERS} to {MAX_PASSWORD_CHARACTERS}"
    )]
    Length {
        /// Number of characters in the password.
        found: usize,
    },
    /// The password is easy to guess: the account's name, or one repeated character.
    #[error(
        "the password is the account's name, or one repeated character; choose a password that is hard to guess"
    )]
    Obvious,
    /// The hash could not be computed.
    #[error("the password could not be hashed, so nothing was changed: {0}")]
    Hash(String),
}

/// Returns the argon2id hash of a new password with this salt.
///
/// # Errors
/// If the password is too short, too long or easy to guess, or cannot be hashed.
pub fn hash_password(password: &str, name: &str, salt: [u8; 16]) -> Result<String, PasswordError> {
    let found = password.chars().count();
    if !(MIN_PASSWORD_CHARACTERS..=MAX_PASSWORD_CHARACTERS).contains(&found) {
        return Err(PasswordError::Length { found });
    }
    let first = password.chars().next();
    let lower = password.to_lowercase();
    if lower.contains(&name.to_lowercase()) && found < name.chars().count() + MIN_PASSWORD_CHARACTERS
        || password.chars().all(|c| Some(c) == first)
    {
        return Err(PasswordError::Obvious);
    }
    let hash = password_hasher()?.hash_password_with_salt(password.as_bytes(), &salt);
    hash.map(|hash: PasswordHash| hash.to_string()).map_err(|error| PasswordError::Hash(error.to_string()))
}

/// Returns whether the password matches the hash. The check takes a fraction of a second, even if the hash is invalid.
pub fn is_correct_password(password: &str, hash: &str) -> bool {
    let Ok(hasher) = password_hasher() else { return false };
    let is_short = password.chars().count() <= MAX_PASSWORD_CHARACTERS;
    let bytes = if is_short { password.as_bytes() } else { b"" };
    match PasswordHash::new(hash) {
        Ok(hash) => hasher.verify_password(bytes, &hash).is_ok() && is_short,
        Err(_) => {
            // Hash the password even without a valid account: the response time must not reveal which accounts exist.
            let spent: Result<PasswordHash, _> = hasher.hash_password_with_salt(bytes, &[0; 16]);
            drop(spent);
            false
        }
    }
}

fn password_hasher() -> Result<Argon2<'static>, PasswordError> {
    let params = Params::new(MEMORY_KIB, HASH_PASSES, 1, None);
    let params = params.map_err(|error| PasswordError::Hash(error.to_string()))?;
    Ok(Argon2::new(Algorithm::Argon2id, Version::V0x13, params))
}

/// Number of consecutive wrong passwords after which an account is paused.
pub const MAX_ATTEMPTS: u32 = 5;
/// Duration of an account's first pause, s. It doubles after every further `MAX_ATTEMPTS` wrong passwords, up to one
/// hour.
pub const PAUSE_S: f64 = 60.0;
const MAX_PAUSE_S: f64 = 3_600.0;
/// Number of counters for names without an account. A hash of the name selects the counter. Therefore unknown names are
/// paused like accounts, but need no additional memory, and cannot end the pause of an account.
const UNKNOWN_NAME_COUNTER_COUNT: u64 = 256;

/// The counters of recent wrong passwords. All times are seconds of a monotonic clock.
#[derive(Debug, Default)]
pub struct Lockout(BTreeMap<LockoutKey, FailedAttempts>);

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum LockoutKey {
    Account(String),
    Bucket(u64),
}

impl LockoutKey {
    fn new(name: &str, is_account: bool) -> Self {
        if is_account {
            return LockoutKey::Account(name.to_owned());
        }
        let mut hasher = DefaultHasher::new();
        name.hash(&mut hasher);
        LockoutKey::Bucket(hasher.finish() % UNKNOWN_NAME_COUNTER_COUNT)
    }
}

#[derive(Debug, Clone, Copy)]
struct FailedAttempts {
    failures: u32,
    /// End of the pause, s; `None` if the last wrong password did not start a pause.
    until_s: Option<f64>,
}

/// Returns the duration of a pause, s, after `rows` times `MAX_ATTEMPTS` wrong passwords.
fn pause_duration_s(rows: u32) -> f64 {
    (PAUSE_S * f64::from(2_u32.saturating_pow(rows.saturating_sub(1).min(16)))).min(MAX_PAUSE_S)
}

impl Lockout {
    /// Returns the remaining pause of this name, s; `None` if its password may be checked. `is_account` is whether an
    /// account with this name exists.
    pub fn pauses_s(&self, (name, is_account): (&str, bool), now_s: f64) -> Option<f64> {
        let left_s = self.0.get(&LockoutKey::new(name, is_account))?.until_s? - now_s;
        (left_s > 0.0).then_some(left_s)
    }

    /// Counts a wrong password and returns whether a pause begins now. Wrong passwords during a pause are not counted,
    /// and do not end it.
    pub fn record_failure(&mut self, (name, is_account): (&str, bool), now_s: f64) -> bool {
        if self.pauses_s((name, is_account), now_s).is_some() {
            return true;
        }
        let who = LockoutKey::new(name, is_account);
        let former = self.0.get(&who).map_or(0, |tried| tried.failures);
        let wrong = former.saturating_add(1);
        let until_s = wrong.is_multiple_of(MAX_ATTEMPTS).then(|| now_s + pause_duration_s(wrong / MAX_ATTEMPTS));
        self.0.insert(who, FailedAttempts { failures: wrong, until_s });
        until_s.is_some()
    }

    /// Clears the wrong passwords of this name after a correct one.
    pub fn record_success(&mut self, name: &str) {
        self.0.remove(&LockoutKey::new(name, true));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_is_kept_as_a_salted_hash() {
        let of = |salt| hash_password("correct horse", "anna", [salt; 16]).expect("allowed");
        let hash = of(1);
        assert!(hash.starts_with("$argon2id$v=19$m=19456,t=2,p=1$"), "{hash}");
        assert_ne!(of(2), hash, "the salt is part of it");
        assert!(is_correct_password("correct horse", &hash));
        assert!(!is_correct_password("correct horse ", &hash) && !is_correct_password("", &hash));
        assert!(!is_correct_password("correct horse", "none") && !is_correct_password("correct horse", ""));
    }

    #[test]
    fn weak_passwords_are_refused() {
        let of = |password: &str| hash_password(password, "anna", [7; 16]).map(drop);
        assert_eq!(of("short"), Err(PasswordError::Length { found: 5 }));
        assert_eq!(of(&"x1".repeat(101)), Err(PasswordError::Length { found: 202 }));
        assert_eq!(of("aaaaaaaaaaaa"), Err(PasswordError::Obvious));
        assert_eq!(of("Anna123456"), Err(PasswordError::Obvious));
        assert_eq!(of("anna and the horse"), Ok(()), "a phrase with the name in it is long enough");
    }

    const ANNA: (&str, bool) = ("anna", true);

    #[test]
    fn five_wrong_passwords_pause_an_account_for_longer_each_time() {
        let mut lockout = Lockout::default();
        let mut now_s = 0.0;
        // Expected pauses, calculated by hand: 60 s, 120 s, 240 s, and so on, at most one hour.
        for pause_duration_s in [60.0, 120.0, 240.0, 480.0, 960.0, 1_920.0, 3_600.0, 3_600.0] {
            for n in 1..=5 {
                assert_eq!(lockout.pauses_s(ANNA, now_s), None);
                assert_eq!(lockout.record_failure(ANNA, now_s), n == 5);
            }
            assert_eq!(lockout.pauses_s(ANNA, now_s + 1.0), Some(pause_duration_s - 1.0));
            assert_eq!(lockout.pauses_s(("ben", true), now_s), None, "another account continues");
            now_s += pause_duration_s;
        }
        lockout.record_success("anna");
        assert!(!lockout.record_failure(ANNA, now_s), "counted from the beginning");
    }

    /// A password check that was still running when the pause began neither shortens nor lengthens the pause.
    #[test]
    fn a_wrong_password_during_the_pause_does_not_lift_it() {
        let mut lockout = Lockout::default();
        for _ in 0..5 {
            lockout.record_failure(ANNA, 0.0);
        }
        for n in 1..200 {
            assert!(lockout.record_failure(ANNA, f64::from(n) / 10.0));
            assert!(lockout.pauses_s(ANNA, f64::from(n) / 10.0).is_some());
        }
        assert_eq!(lockout.pauses_s(ANNA, 59.0), Some(1.0));
        assert_eq!(lockout.pauses_s(ANNA, 60.0), None);
        assert!(!lockout.record_failure(ANNA, 60.0), "the first of the next row");
    }

    /// The pauses of an account become longer, no matter how many unknown names are tried in between. Unknown names
    /// need no additional memory.
    #[test]
    fn invented_names_end_no_pause_and_need_no_memory() {
        let mut lockout = Lockout::default();
        let engineer = ("engineer", true);
        for _ in 0..5 {
            lockout.record_failure(engineer, 0.0);
        }
        for n in 0..3_000 {
            lockout.record_failure((&format!("n{n}"), false), 1.0);
        }
        assert_eq!(lockout.pauses_s(engineer, 1.0), Some(59.0), "not evicted");
        assert!(lockout.0.len() <= UNKNOWN_NAME_COUNTER_COUNT as usize + 1, "{}", lockout.0.len());
        for _ in 0..5 {
            lockout.record_failure(engineer, 61.0);
        }
        assert_eq!(lockout.pauses_s(engineer, 61.0), Some(120.0), "the second row counts as one");
        assert_eq!(lockout.pauses_s(("ben", true), 1.0), None, "an account pauses by its own passwords alone");
        assert!(
            lockout.pauses_s(("n7", false), 1.0).is_some(),
            "a name without an account cannot be told from one"
        );
    }
}
