//! Writes the figures that benches reported into the table of `tests/bench/README.md`: `make bench-table`. `GOALS`
//! names the file to which the benches wrote their `GOAL` lines; its name is the commit that was measured. The file is
//! removed afterwards.

#[path = "table/rows.rs"]
mod rows;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(goals) = std::env::var_os("GOALS").map(PathBuf::from) else {
        eprintln!("GOALS names no file with figures. Run `make bench-table`.");
        return ExitCode::FAILURE;
    };
    match written(&goals) {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Writes the figures of this file into the page; returns a summary, or the error.
fn written(goals: &Path) -> Result<String, String> {
    let at = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
    if !goals.exists() {
        return Ok(format!("{}: no figures were measured at this commit; the table stays", goals.display()));
    }
    let commit = goals.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    let hash = commit.split(' ').next().unwrap_or_default();
    if hash.len() < 7 || !hash.chars().all(|c| c.is_ascii_hexdigit()) {
        return Err(format!(
            "{}: the name states no commit. Measure in a clone of the repository.",
            goals.display()
        ));
    }
    let output = std::fs::read_to_string(goals).map_err(|error| at(goals, error))?;
    let measured = rows::parse(&output).map_err(|error| format!("{}: {error}", goals.display()))?;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bench/README.md");
    let page = std::fs::read_to_string(&path).map_err(|error| at(&path, error))?;
    let renewed =
        rows::replaced(&page, &measured, commit).map_err(|error| format!("{}: {error}", path.display()))?;
    std::fs::write(&path, renewed).map_err(|error| at(&path, error))?;
    std::fs::remove_file(goals).map_err(|error| at(goals, error))?;
    Ok(format!("{} figures of commit {commit} are in {}", measured.len(), path.display()))
}
