//! Passwords: kept as argon2id hashes, as OWASP's cheat sheet asks (19 MiB, two passes, one lane). One is computed at a time, in memory
//! that the process keeps: the C library would otherwise keep a piece of 19 MiB for each thread that ever checked one, and many sign-ins
//! at once would take the memory and the processors of the cell.

use argon2::password_hash::phc::{Output, ParamsString, PasswordHash, Salt};
use argon2::{Algorithm, Argon2, Block, Params, Version};
use std::sync::{Mutex, PoisonError};

/// The fewest characters of a password (NIST SP 800-63B asks for eight where it is the only factor; here it also signs).
pub const LEAST_CHARACTERS: usize = 10;
/// The most, so that nobody keeps the computer busy by one.
const MOST_CHARACTERS: usize = 200;
/// Memory, KiB, and passes.
const MEMORY_KIB: u32 = 19 * 1_024;
const PASSES: u32 = 2;

/// What a hash is computed in.
static WORK_SPACE: Mutex<Vec<Block>> = Mutex::new(Vec::new());

/// Why a password is not taken.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PasswordError {
    /// Too few characters, or far too many.
    #[error("the password has {found} characters; allowed are {LEAST_CHARACTERS} to {MOST_CHARACTERS}")]
    Length {
        /// Its characters.
        found: usize,
    },
    /// Anybody would try it.
    #[error(
        "the password is the account's name, or one character again and again; choose words that nobody would try"
    )]
    Obvious,
    /// The hash could not be computed.
    #[error("the password could not be hashed: {0}")]
    Hash(String),
}

/// The hash of a new password, with this salt.
///
/// # Errors
/// Where the password is too short, too long or obvious.
pub fn hashed(password: &str, name: &str, salt: [u8; 16]) -> Result<String, PasswordError> {
    let found = password.chars().count();
    if !(LEAST_CHARACTERS..=MOST_CHARACTERS).contains(&found) {
        return Err(PasswordError::Length { found });
    }
    let first = password.chars().next();
    let lower = password.to_lowercase();
    if lower.contains(&name.to_lowercase()) && found < name.chars().count() + LEAST_CHARACTERS
        || password.chars().all(|c| Some(c) == first)
    {
        return Err(PasswordError::Obvious);
    }
    let params = own_params()?;
    let output = computed(password.as_bytes(), &salt, params.clone())?;
    let of = |error: &dyn std::fmt::Display| PasswordError::Hash(error.to_string());
    let hash = PasswordHash {
        algorithm: Algorithm::Argon2id.ident(),
        version: Some(Version::V0x13.into()),
        params: ParamsString::try_from(&params).map_err(|error| of(&error))?,
        salt: Some(Salt::new(&salt).map_err(|error| of(&error))?),
        hash: Some(output),
    };
    Ok(hash.to_string())
}

/// Whether this is the password. It takes a fraction of a second, the same for a hash that is no hash.
pub fn is_right(password: &str, hash: &str) -> bool {
    let is_short = password.chars().count() <= MOST_CHARACTERS;
    let bytes = if is_short { password.as_bytes() } else { b"" };
    match parts(hash) {
        Some((params, salt, kept)) => computed(bytes, &salt, params).is_ok_and(|found| found == kept) && is_short,
        None => {
            // Who tries names must not hear by the time which of them are accounts.
            drop(own_params().and_then(|params| computed(bytes, &[0; 16], params)));
            false
        }
    }
}

/// Parameters, salt and output of a hash that this module wrote, with its own parameters or those of another version of the program.
fn parts(hash: &str) -> Option<(Params, Salt, Output)> {
    let hash = PasswordHash::new(hash).ok()?;
    let is_ours = hash.algorithm == Algorithm::Argon2id.ident() && hash.version == Some(Version::V0x13.into());
    Some((Params::try_from(&hash).ok()?, hash.salt?, hash.hash?)).filter(|_| is_ours)
}

fn own_params() -> Result<Params, PasswordError> {
    Params::new(MEMORY_KIB, PASSES, 1, Some(Params::DEFAULT_OUTPUT_LEN))
        .map_err(|error| PasswordError::Hash(error.to_string()))
}

/// The output of argon2id. It compares with another one in constant time.
fn computed(password: &[u8], salt: &[u8], params: Params) -> Result<Output, PasswordError> {
    let mut output = [0; Params::DEFAULT_OUTPUT_LEN];
    let mut work_space = WORK_SPACE.lock().unwrap_or_else(PoisonError::into_inner);
    work_space.resize(params.block_count(), Block::new());
    Argon2::new(Algorithm::Argon2id, Version::V0x13, params)
        .hash_password_into_with_memory(password, salt, &mut output, &mut work_space[..])
        .map_err(|error| PasswordError::Hash(error.to_string()))?;
    Output::new(&output).map_err(|error| PasswordError::Hash(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_is_kept_as_a_salted_hash() {
        let of = |salt| hashed("correct horse", "anna", [salt; 16]).expect("allowed");
        let hash = of(1);
        assert!(hash.starts_with("$argon2id$v=19$m=19456,t=2,p=1$"), "{hash}");
        assert_ne!(of(2), hash, "the salt is part of it");
        assert!(is_right("correct horse", &hash));
        assert!(!is_right("correct horse ", &hash) && !is_right("", &hash));
        assert!(!is_right("correct horse", "none") && !is_right("correct horse", ""));
    }

    #[test]
    fn a_hash_of_the_library_s_own_way_is_right() {
        // Made by `Argon2::hash_password_with_salt` with m = 64 KiB, t = 1, as another version of the program might have kept it.
        use argon2::password_hash::PasswordHasher;
        let params = Params::new(64, 1, 1, None).expect("allowed");
        let library = Argon2::new(Algorithm::Argon2id, Version::V0x13, params);
        let hash: PasswordHash = library.hash_password_with_salt(b"correct horse", &[3; 16]).expect("computed");
        assert!(is_right("correct horse", &hash.to_string()) && !is_right("correct horse!", &hash.to_string()));
        let same = Argon2::new(Algorithm::Argon2id, Version::V0x13, own_params().expect("allowed"));
        let same: PasswordHash = same.hash_password_with_salt(b"correct horse", &[3; 16]).expect("computed");
        assert_eq!(hashed("correct horse", "anna", [3; 16]), Ok(same.to_string()));
        let other = hash.to_string().replace("argon2id", "argon2d");
        assert!(!is_right("correct horse", &other), "another algorithm is not asked");
    }

    #[test]
    fn weak_ones_are_refused() {
        let of = |password: &str| hashed(password, "anna", [7; 16]).map(drop);
        assert_eq!(of("short"), Err(PasswordError::Length { found: 5 }));
        assert_eq!(of(&"x1".repeat(101)), Err(PasswordError::Length { found: 202 }));
        assert_eq!(of("aaaaaaaaaaaa"), Err(PasswordError::Obvious));
        assert_eq!(of("Anna123456"), Err(PasswordError::Obvious));
        assert_eq!(of("anna and the horse"), Ok(()), "a phrase with the name in it is long enough");
    }
}
