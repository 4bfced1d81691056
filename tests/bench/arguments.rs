//! Command line arguments of a bench, in the form `name=value`.

/// Returns the value of the argument with this name, as text.
pub fn argument(name: &str) -> Option<String> {
    std::env::args().skip(1).find_map(|argument| Some(argument.strip_prefix(name)?.strip_prefix('=')?.to_owned()))
}

/// Returns the value of the argument with this name, as a number.
///
/// # Panics
/// If the value is not a number; the message contains the argument.
pub fn number(name: &str) -> Option<u64> {
    argument(name).map(|text| text.parse().unwrap_or_else(|error| panic!("{name}={text}: {error}")))
}
