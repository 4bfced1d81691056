//! Where in the text a syntax error stands.

use super::problem::Problem;

/// The line of an offset, from 1.
pub(super) fn line_of(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}

/// A syntax error as a problem.
pub(super) fn problem_of(text: &str, error: &toml::de::Error) -> Problem {
    let offset = error.span().map_or(0, |span| span.start);
    let line = line_of(text, offset);
    Problem { line, key: key_at(text, line).unwrap_or_default(), message: format!("not TOML: {}", error.message()) }
}

/// The key that a line begins with, under the last table header above it. The tree cannot tell: what is broken
/// or there twice is not in it.
fn key_at(text: &str, line: usize) -> Option<String> {
    let header = |line: &str| Some(line.trim().strip_prefix('[')?.trim_matches(['[', ']', ' ']).to_owned());
    let written = text.lines().nth(line - 1)?;
    if let Some(table) = header(written) {
        return Some(table);
    }
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    let key = written.split(['=', ' ']).find(|word| !word.is_empty())?.trim();
    let table = text.lines().take(line - 1).filter_map(header).last();
    key.chars().all(is_plain).then(|| table.map_or(key.to_owned(), |table| format!("{table}.{key}")))
}
