//! Parsers for option values that several commands read in the same way.

/// Accepts a text from a person, without the blanks around it.
///
/// # Errors
/// If it is empty.
pub fn parse_non_empty(text: &str) -> Result<String, String> {
    match text.trim() {
        "" => Err("must not be empty".to_owned()),
        text => Ok(text.to_owned()),
    }
}
