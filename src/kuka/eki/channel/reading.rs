//! Reads a file's text: the values that it states, and its deviations from the manual.

use super::findings::Findings;
use super::manual;
use super::stated::StatedChannel;
use super::tree;
use panelprep_base::config::Problem;

/// Returns a file's statements, with everything that differs from the manual; `name` is the file's name.
///
/// # Errors
/// If the text is not XML or not a classic EthernetKRL file.
pub fn read(name: &str, text: &str) -> Result<(StatedChannel, Findings), Problem> {
    let root = tree::tree(text)?;
    manual::is_classic_dialect(&root)?;
    let mut found = Findings::default();
    manual::check_against_manual(&root, &mut found);
    let stated = StatedChannel::from_xml(name, &root, &mut found);
    Ok((stated, found))
}
