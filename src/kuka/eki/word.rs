//! Fixed keywords of messages, read from a recording.

use serde::{Deserialize, Deserializer, de::Error};
use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// A keyword from this program's own text.
pub(super) type Keyword = &'static str;

/// Length of the longest keyword.
const MAX_BYTES: usize = 100;

/// Reads a keyword from a recording. Each keyword is stored once until the program ends: there are some tens.
pub(super) fn intern_keyword<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Keyword, D::Error> {
    static KNOWN_KEYWORDS: Mutex<BTreeSet<Keyword>> = Mutex::new(BTreeSet::new());
    let text = String::deserialize(deserializer)?;
    if text.len() > MAX_BYTES {
        return Err(D::Error::custom(format!("the text has {} bytes (limit {MAX_BYTES} bytes)", text.len())));
    }
    let mut known = KNOWN_KEYWORDS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(word) = known.get(text.as_str()) {
        return Ok(word);
    }
    let word: Keyword = text.leak();
    known.insert(word);
    Ok(word)
}
