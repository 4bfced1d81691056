//! The faults of the records of cycles and parts, and of their history, that stop a command.

/// The reason why the records cannot answer, or do not accept a part.
#[derive(Debug, thiserror::Error)]
pub enum RecordFault {
    /// A text in a search that is not a date.
    #[error("{option}: {cause}")]
    Date {
        /// The option.
        option: &'static str,
        /// The problem of the date.
        cause: panelprep_store::history::DateError,
    },
    /// Conditions of a search together with another request to the history.
    #[error(
        "conditions such as --part are valid only for the search, `panelprep history` without a subcommand; remove them"
    )]
    SearchBesideTask,
    /// No cycle in the store treated this panel.
    #[error("the store contains no cycle of panel {panel}; {}", describe_panels(panels))]
    NoCyclesOf {
        /// The panel as the user named it.
        panel: String,
        /// The panels that were treated by cycles.
        panels: Vec<String>,
    },
    /// The panel's cycles have no quantity of this name.
    #[error(
        "no cycle of panel {panel} has a quantity {found}{}; valid: {}; or, in quotes, the name of a check on the page of a \
         cycle",
        nearest.as_ref().map_or(String::new(), |nearest| format!(": did you mean {nearest}?")), words.join(", ")
    )]
    NoSuchNumber {
        /// The name as the user typed it.
        found: String,
        /// The panel.
        panel: String,
        /// The existing name that is most similar.
        nearest: Option<String>,
        /// The keywords of the quantities that exist.
        words: Vec<&'static str>,
    },
    /// A part that may not be abraded any more.
    #[error(
        "{part} has reached the limit of {most} passes ([process] max_passes_per_part): {history}; take \
         the part out, and let the inspector decide about the part with the pages of these cycles"
    )]
    PartUsedUp {
        /// The part in words, with its serial number if it has one.
        part: String,
        /// Maximum number of passes.
        most: usize,
        /// The cycles, with the number of passes in each.
        history: String,
    },
    /// The names of a part that the cell does not accept.
    #[error("{0}")]
    PartNames(panelprep_cell::cell::PartNameError),
    /// A part whose abrasions cannot be counted, because the store was restored from a backup.
    #[error("{0}")]
    CountUnknown(panelprep_store::store::LostCount),
    /// A cycle with an unsigned record.
    #[error(
        "the record of cycle {cycle} is not signed: the cycle has not ended, or signing failed; `panelprep store verify` \
         reports details"
    )]
    NotSigned {
        /// The cycle.
        cycle: i64,
    },
    /// There is no public key for the verification.
    #[error(
        "no public key for the verification ({problem}): name the cell's public key with --public-key FILE; `panelprep record export` writes this file"
    )]
    NoPublicKey {
        /// The reason why the cell's own store has no public key.
        problem: String,
    },
    /// A name of the part that is not valid.
    #[error("{option} \"{found}\": {problem}; give the text as it must appear on the cycle's page")]
    PartName {
        /// The option.
        option: &'static str,
        /// The name as given.
        found: String,
        /// The problem.
        problem: String,
    },
}

fn describe_panels(panels: &[String]) -> String {
    match panels {
        [] => "the store contains no cycles".to_owned(),
        _ => format!("panels in the store: {}", panels.join(", ")),
    }
}
