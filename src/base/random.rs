//! Random bytes of the operating system, for keys, salts and tokens.

use rustix::rand::{GetRandomFlags, getrandom};
use std::io::{Error, ErrorKind};

/// Returns `N` random bytes.
///
/// # Errors
/// If the operating system cannot provide random bytes yet, or provides fewer than `N`.
pub fn bytes<const N: usize>() -> std::io::Result<[u8; N]> {
    let mut bytes = [0; N];
    match getrandom(&mut bytes, GetRandomFlags::empty())? {
        count if count == N => Ok(bytes),
        _ => Err(Error::new(
            ErrorKind::UnexpectedEof,
            "the operating system returned too few random bytes; try \
            again",
        )),
    }
}

/// Returns a token that cannot be guessed: 64 hexadecimal digits.
///
/// # Errors
/// The errors of [`bytes`].
pub fn token() -> std::io::Result<String> {
    Ok(bytes::<32>()?.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_random_tokens_differ() {
        let [one, other] = [token().expect("bytes"), token().expect("bytes")];
        assert_eq!((one.len(), other.len()), (64, 64));
        assert_ne!(one, other);
        assert_ne!(bytes::<16>().expect("bytes"), [0; 16]);
    }
}
