//! Passwords: stored as argon2id hashes, as OWASP's cheat sheet requires (19 MiB, two passes, one lane).

use argon2::password_hash::phc::PasswordHash;
use argon2::password_hash::{PasswordHasher, PasswordVerifier};
use argon2::{Algorithm, Argon2, Params, Version};

/// The minimum length of a password (NIST SP 800-63B requires eight characters if it is the only factor; here the
/// password is also used to sign).
pub const MIN_CHARACTERS: usize = 10;
/// The maximum length, so that no one can keep the computer busy with one password.
const MAX_CHARACTERS: usize = 200;
/// Memory in KiB, and the number of passes.
const MEMORY_KIB: u32 = 19 * 1_024;
const PASSES: u32 = 2;

/// The reason why a password is not accepted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PasswordError {
    /// Too few characters, or far too many.
    #[error("the password has {found} characters; the limits are {MIN_CHARACTERS} to {MAX_CHARACTERS}")]
    Length {
        /// Number of characters found.
        found: usize,
    },
    /// A password that anyone would try.
    #[error(
        "the password is the account's name, or one repeated character; choose a password that is hard to guess"
    )]
    Obvious,
    /// The hash could not be computed.
    #[error("the password could not be hashed: {0}")]
    Hash(String),
}

/// Returns the hash of a new password, with this salt.
///
/// # Errors
/// If the password is too short, too long or obvious.
pub fn hash_password(password: &str, name: &str, salt: [u8; 16]) -> Result<String, PasswordError> {
    let found = password.chars().count();
    if !(MIN_CHARACTERS..=MAX_CHARACTERS).contains(&found) {
        return Err(PasswordError::Length { found });
    }
    let first = password.chars().next();
    let lower = password.to_lowercase();
    if lower.contains(&name.to_lowercase()) && found < name.chars().count() + MIN_CHARACTERS
        || password.chars().all(|c| Some(c) == first)
    {
        return Err(PasswordError::Obvious);
    }
    let hash = password_hasher()?.hash_password_with_salt(password.as_bytes(), &salt);
    hash.map(|hash: PasswordHash| hash.to_string()).map_err(|error| PasswordError::Hash(error.to_string()))
}

/// Returns whether this is the password. The check takes a fraction of a second, also if the hash is invalid.
pub fn is_correct_password(password: &str, hash: &str) -> bool {
    let Ok(hasher) = password_hasher() else { return false };
    let is_short = password.chars().count() <= MAX_CHARACTERS;
    let bytes = if is_short { password.as_bytes() } else { b"" };
    match PasswordHash::new(hash) {
        Ok(hash) => hasher.verify_password(bytes, &hash).is_ok() && is_short,
        Err(_) => {
            // The response time must not reveal which names are accounts.
            let spent: Result<PasswordHash, _> = hasher.hash_password_with_salt(bytes, &[0; 16]);
            drop(spent);
            false
        }
    }
}

fn password_hasher() -> Result<Argon2<'static>, PasswordError> {
    let params = Params::new(MEMORY_KIB, PASSES, 1, None);
    let params = params.map_err(|error| PasswordError::Hash(error.to_string()))?;
    Ok(Argon2::new(Algorithm::Argon2id, Version::V0x13, params))
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
    fn weak_ones_are_refused() {
        let of = |password: &str| hash_password(password, "anna", [7; 16]).map(drop);
        assert_eq!(of("short"), Err(PasswordError::Length { found: 5 }));
        assert_eq!(of(&"x1".repeat(101)), Err(PasswordError::Length { found: 202 }));
        assert_eq!(of("aaaaaaaaaaaa"), Err(PasswordError::Obvious));
        assert_eq!(of("Anna123456"), Err(PasswordError::Obvious));
        assert_eq!(of("anna and the horse"), Ok(()), "a phrase with the name in it is long enough");
    }
}
