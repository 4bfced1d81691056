//! Values of options that several commands read alike.

/// Words that somebody said, without space around them.
///
/// # Errors
/// Where they are empty.
pub fn said(text: &str) -> Result<String, String> {
    match text.trim() {
        "" => Err("must not be empty".to_owned()),
        text => Ok(text.to_owned()),
    }
}
