//! The problems of a configuration file, for a person with an editor.

/// One problem: its place, what was found, and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Problem {
    /// Line in the file, from 1; 1 if the file as a whole is meant.
    pub line: usize,
    /// The key with its tables, `locate.max_shift_mm`; empty if the file as a whole is meant.
    pub key: String,
    /// The value that was found, what is allowed, and what to do.
    pub message: String,
}

/// All problems of one file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Problems {
    /// The file's name as the user wrote it.
    pub file: String,
    /// The problems, in the order of their lines.
    pub list: Vec<Problem>,
}

impl std::fmt::Display for Problems {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, problem) in self.list.iter().enumerate() {
            let (end_of_last, colon) =
                (if index > 0 { "\n" } else { "" }, if problem.key.is_empty() { "" } else { ": " });
            write!(f, "{end_of_last}{}:{}: {}{colon}{}", self.file, problem.line, problem.key, problem.message)?;
        }
        Ok(())
    }
}
