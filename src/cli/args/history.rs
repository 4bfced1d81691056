//! Arguments of `history`: the search, and the questions about the cycles that it finds.

use clap::{Args, Subcommand, ValueEnum};

/// Options of `history`.
#[derive(Debug, Clone, Args)]
pub struct History {
    /// The task; without a task, cycles are searched.
    #[command(subcommand)]
    pub what: Option<HistoryTask>,
    /// What is searched.
    #[command(flatten)]
    pub search: SearchArguments,
    /// Maximum number of cycles: for a search, of cycles found; for a trend, a heat map and alarms, the newest
    /// cycles.
    #[arg(long, global = true, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u16).range(1..=1_000))]
    pub limit: u16,
    /// Print comma-separated values (CSV) on standard output, for a spreadsheet.
    #[arg(long, global = true, conflicts_with = "json")]
    pub csv: bool,
}

/// Conditions of a search. In names `*` matches any characters; without it, the whole name must match.
#[derive(Debug, Clone, Default, PartialEq, Eq, Args)]
pub struct SearchArguments {
    /// Serial number of the part.
    #[arg(long, value_name = "SERIAL")]
    pub part: Option<String>,
    /// Work order.
    #[arg(long, value_name = "ORDER")]
    pub order: Option<String>,
    /// Name of the panel in the recipe.
    #[arg(long, value_name = "PANEL")]
    pub panel: Option<String>,
    /// Operator, as named at the start.
    #[arg(long, value_name = "NAME")]
    pub operator: Option<String>,
    /// Only cycles that began at this time or later, UTC: 2026-05-31 or 2026-05-31T09:00.
    #[arg(long, value_name = "DATE")]
    pub from: Option<String>,
    /// Only cycles that began before this time, UTC; a date without a time includes the whole day.
    #[arg(long, value_name = "DATE")]
    pub to: Option<String>,
    /// How the cycle ended.
    #[arg(long, value_name = "VERDICT")]
    pub verdict: Option<EndName>,
    /// Words that must all occur in the reasons of the verdict, in codes or sentences.
    #[arg(long, value_name = "WORDS")]
    pub text: Option<String>,
    /// Only cycles with a smaller number than this cycle: the next part of a long search result.
    #[arg(long, value_name = "N")]
    pub before: Option<i64>,
}

/// How a cycle ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[expect(missing_docs, reason = "these are the words of the verdicts")]
pub enum EndName {
    Pass,
    Fail,
    Invalid,
    Review,
    Reject,
    Accept,
    Aborted,
    /// The cycle has not ended yet.
    Running,
}

/// Questions to the history.
#[derive(Debug, Clone, Subcommand)]
pub enum HistoryTask {
    /// Summary of one cycle: part, verdict, grids, residuals and errors, times, disc.
    Show {
        /// The number of the cycle.
        cycle: i64,
    },
    /// Two cycles side by side: their inputs, every check with its difference and limit, every grid.
    Compare {
        /// The number of one cycle.
        first: i64,
        /// The number of the other cycle.
        second: i64,
    },
    /// The trend of a quantity of a panel over its cycles, with its limits, and with hints by the rules of Western
    /// Electric.
    #[command(after_help = format!("NAME is one of these words:\n  {}\nor, in quotes, the name of a check on the page of a cycle.",
        panelprep_store::history::KnownQuantity::keywords().join("\n  ")))]
    Trend {
        /// The panel, by its name in the recipe.
        panel: String,
        /// The quantity: a keyword of the list below, or the name of a check.
        name: String,
    },
    /// How often the film broke on each grid of a panel, and after which time, over all parts of this kind.
    Heat {
        /// The panel, by its name in the recipe.
        panel: String,
    },
    /// The alarms of the newest cycles, or of one cycle: when raised, when gone, cause and remedy.
    Alarms {
        /// The number of the cycle.
        cycle: Option<i64>,
    },
}
