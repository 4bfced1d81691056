//! Names of accounts: short, plain, and the same in a log, a table and an address.

/// The longest name, in characters.
const MAX_CHARACTERS: usize = 40;

/// The longest printed name, in characters.
pub const MAX_PRINTED: usize = 80;

/// The reason why a text is not a valid account name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "\"{}\" is not a valid account name; valid: 1 to 40 of the characters a to z, 0 to 9, dot, hyphen and \
     underscore, beginning with a letter",
    found.escape_debug()
)]
pub struct NameError {
    /// The name as it was given.
    pub found: String,
}

/// Checks a name and returns it unchanged.
///
/// # Errors
/// If it contains characters that are not allowed, or is empty or too long.
pub fn checked_name(name: &str) -> Result<&str, NameError> {
    let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '.' | '-' | '_');
    let begins = name.starts_with(|c: char| c.is_ascii_lowercase());
    if begins && name.len() <= MAX_CHARACTERS && name.chars().all(is_plain) {
        return Ok(name);
    }
    Err(NameError { found: name.chars().take(2 * MAX_CHARACTERS).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_plain() {
        for name in ["a", "anna", "anna.b-2_c", &"x".repeat(40)] {
            assert_eq!(checked_name(name), Ok(name));
        }
        for name in ["", "Anna", "2anna", ".a", "a b", "änna", "a\n", "<b>", &"x".repeat(41)] {
            assert!(checked_name(name).is_err(), "{name}");
        }
    }
}
