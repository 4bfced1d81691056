//! `panelprep history`: searches for cycles in the store, compares two cycles, shows trends of quantities, and lists
//! alarms. The same data are printed as a table for people, as JSON or as CSV. In a table the newest cycle comes first.

use super::args::{Common, EndName, History, HistoryTask, SearchArguments};
use super::fault::{Fault, RecordFault};
use super::output::Outcome;
use panelprep_base::config::nearest;
use panelprep_base::number_text::{fixed_decimals, shortest_text, utc_text};
use panelprep_base::verdict::{Check, Limit, Reason, Verdict};
use panelprep_cell::record::{CycleId, PartNames};
use panelprep_service::report::format_value;
use panelprep_service::setup::CellFiles;
use panelprep_store::history::{
    self, Alarm, Comparison, Edge, HeatMap, Hits, KnownQuantity, PastCycle, Quantity, Query, RequiredEnd, Summary,
    Table, Trend,
};
use panelprep_store::store::Store;
use serde::Serialize;
use serde_json::{Map, Value};

/// Runs one task of `panelprep history`.
///
/// # Errors
/// If a date, a panel or a quantity is not known, or there is no store to read.
pub fn run(args: &History, common: &Common) -> Result<Outcome, Fault> {
    let store = match &common.store {
        // A copy of the store in another folder can be read without a cell file.
        Some(folder) => Store::open(folder).map_err(Fault::stage)?,
        None => CellFiles::read(&common.paths())?.store()?,
    };
    if args.what.is_some() && args.search != SearchArguments::default() {
        return Err(RecordFault::SearchBesideTask.into());
    }
    let limit = usize::from(args.limit);
    match &args.what {
        None => search(&store, args),
        Some(HistoryTask::Show { cycle }) => {
            let summary = history::summary(&load_past_cycle(&store, *cycle)?);
            results_outcome(
                args,
                &summary,
                &history::summary_table(std::slice::from_ref(&summary)),
                summary_columns(&summary),
            )
        }
        Some(HistoryTask::Compare { first, second }) => {
            let comparison =
                history::compare(&load_past_cycle(&store, *first)?, &load_past_cycle(&store, *second)?);
            results_outcome(
                args,
                &comparison,
                &history::comparison_table(&comparison),
                comparison_columns(&comparison),
            )
        }
        Some(HistoryTask::Trend { panel, name }) => {
            let trend = trend(&store, (panel, name), limit)?;
            results_outcome(args, &trend, &history::trend_table(&trend), trend_columns(&trend))
        }
        Some(HistoryTask::Heat { panel }) => {
            let map = history::heat_map(&cycles(&store, panel, limit)?);
            results_outcome(args, &map, &history::heat_table(&map), heat_columns(&map))
        }
        Some(HistoryTask::Alarms { cycle }) => alarms(&store, args, cycle.map(CycleId)),
    }
}

/// Returns the results in the requested format; JSON is always one object with all results.
fn results_outcome(
    args: &History,
    data: &impl Serialize,
    table: &Table,
    words: Vec<String>,
) -> Result<Outcome, Fault> {
    let json = match serde_json::to_value(data).map_err(Fault::stage)? {
        Value::Object(object) => object,
        other => Map::from_iter([("rows".to_owned(), other)]),
    };
    let words = if args.csv { vec![table.csv().map_err(Fault::stage)?.trim_end().to_owned()] } else { words };
    Ok(Outcome { exit_code: 0, json, lines: words })
}

fn search(store: &Store, args: &History) -> Result<Outcome, Fault> {
    let hits = store.search(&query(&args.search, usize::from(args.limit))?).map_err(Fault::stage)?;
    results_outcome(args, &hits, &history::hits_table(&hits.hits), hit_columns(&hits))
}

fn query(search: &SearchArguments, limit: usize) -> Result<Query, Fault> {
    let date = |option: &'static str, text: &Option<String>, edge: Edge| {
        let read = text.as_ref().map(|text| history::unix_s(text, edge));
        read.transpose().map_err(|cause| Fault::from(RecordFault::Date { option, cause }))
    };
    Ok(Query {
        serial: search.part.clone(),
        order: search.order.clone(),
        panel: search.panel.clone(),
        operator: search.operator.clone(),
        from_unix_s: date("--from", &search.from, Edge::Start)?,
        until_unix_s: date("--to", &search.to, Edge::Behind)?,
        end: search.verdict.map(end),
        words: search.text.as_deref().unwrap_or_default().split_whitespace().map(str::to_owned).collect(),
        before_cycle: search.before.map(CycleId),
        limit,
    })
}

fn end(name: EndName) -> RequiredEnd {
    RequiredEnd::With(match name {
        EndName::Running => return RequiredEnd::Running,
        EndName::Pass => Verdict::Pass,
        EndName::Fail => Verdict::Fail,
        EndName::Invalid => Verdict::Invalid,
        EndName::Review => Verdict::Review,
        EndName::Reject => Verdict::Reject,
        EndName::Accept => Verdict::Accept,
        EndName::Aborted => Verdict::Aborted,
    })
}

fn load_past_cycle(store: &Store, cycle: i64) -> Result<PastCycle, Fault> {
    store.past_cycle(CycleId(cycle)).map_err(Fault::stage)
}

/// Returns the newest finished cycles of a panel, the oldest of them first.
fn cycles(store: &Store, panel: &str, limit: usize) -> Result<Vec<PastCycle>, Fault> {
    let panels = store.cycle_panels().map_err(Fault::stage)?;
    if !panels.iter().any(|name| name == panel) {
        return Err(RecordFault::NoCyclesOf { panel: panel.to_owned(), panels }.into());
    }
    store.past_cycles(panel, limit).map_err(Fault::stage)
}

fn trend(store: &Store, (panel, name): (&str, &str), limit: usize) -> Result<Trend, Fault> {
    let quantity = Quantity::from_keyword(name);
    if let Quantity::Known(known) = &quantity
        && let Some(subject) = known.verified_subject()
    {
        let (title, unit) = known.title_and_unit();
        let points = store.verification_points(subject, limit).map_err(Fault::stage)?;
        return Ok(Trend::from_points((title.to_owned(), unit.to_owned()), points, 0));
    }
    let cycles = cycles(store, panel, limit)?;
    let trend = history::trend(&quantity, &cycles);
    if matches!(quantity, Quantity::Check(_)) && trend.points.is_empty() {
        let names = check_names(&cycles);
        let known: Vec<&str> =
            KnownQuantity::keywords().into_iter().chain(names.iter().map(String::as_str)).collect();
        let nearest = nearest(name, &known).map(|(name, _)| name.to_owned());
        return Err(RecordFault::NoSuchNumber {
            found: name.to_owned(),
            panel: panel.to_owned(),
            nearest,
            words: KnownQuantity::keywords(),
        }
        .into());
    }
    Ok(trend)
}

/// Returns the names of all checks of these cycles.
fn check_names(cycles: &[PastCycle]) -> std::collections::BTreeSet<String> {
    let findings = cycles.iter().flat_map(|past| &past.record.findings);
    findings.flat_map(|finding| &finding.checks).map(|check| check.name.clone()).collect()
}

fn alarms(store: &Store, args: &History, cycle: Option<CycleId>) -> Result<Outcome, Fault> {
    let ids = match cycle {
        Some(id) => vec![id],
        None => {
            let query = Query { limit: usize::from(args.limit), ..Query::default() };
            store.search(&query).map_err(Fault::stage)?.hits.into_iter().map(|hit| hit.cycle).collect()
        }
    };
    let mut all = Vec::new();
    for id in ids {
        all.extend(store.alarms(id).map_err(Fault::stage)?);
    }
    all.sort_by_key(|alarm| std::cmp::Reverse((alarm.raised_unix_ms, alarm.cycle)));
    let words = alarm_columns(&all);
    results_outcome(args, &serde_json::json!({ "alarms": all }), &history::alarm_table(&all), words)
}

/// Placeholder for an empty cell of a table.
const EMPTY_PLACEHOLDER: &str = "–";

/// Formats rows as columns; each column except the last is as wide as its widest cell.
fn columns(rows: &[Vec<String>]) -> Vec<String> {
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    let wide = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..count).map(wide).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, wide)| format!("{cell:<wide$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    rows.iter().map(line).collect()
}

fn row(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|&cell| cell.to_owned()).collect()
}

fn text_or_placeholder(text: Option<String>) -> String {
    text.unwrap_or_else(|| EMPTY_PLACEHOLDER.to_owned())
}

fn describe_end(verdict: Option<Verdict>, is_air_run: bool) -> String {
    let word = verdict.map_or("running", Verdict::keyword);
    if is_air_run { format!("{word} (air-run)") } else { word.to_owned() }
}

fn codes(reasons: &[Reason]) -> String {
    reasons.iter().map(|reason| &*reason.code).collect::<Vec<_>>().join(", ")
}

/// Formats the results of a search.
fn hit_columns(hits: &Hits) -> Vec<String> {
    if hits.hits.is_empty() {
        return vec!["no cycle matches the search".to_owned()];
    }
    let mut rows = vec![row(&["cycle", "began", "panel", "part", "order", "operator", "verdict", "reasons"])];
    rows.extend(hits.hits.iter().map(|hit| {
        let PartNames { serial, order, operator } = hit.part.clone();
        vec![
            hit.cycle.to_string(),
            utc_text(hit.started_unix_s),
            hit.panel.clone(),
            text_or_placeholder(serial),
            text_or_placeholder(order),
            text_or_placeholder(operator),
            describe_end(hit.verdict, hit.is_air_run),
            codes(&hit.reasons),
        ]
    }));
    let mut words = columns(&rows);
    words.extend(hits.next.map(|next| format!("more cycles exist: search with --before {next}")));
    words
}

/// Formats the summary of one cycle.
fn summary_columns(summary: &Summary) -> Vec<String> {
    let PartNames { serial, order, operator } = summary.part.clone();
    let grids = |grids: &Option<Vec<String>>| match grids {
        None => "no valid film".to_owned(),
        Some(grids) if grids.is_empty() => "none".to_owned(),
        Some(grids) => grids.join(", "),
    };
    let number = |value: Option<f64>, unit: &str| {
        value.map_or("not measured".to_owned(), |value| format!("{} {unit}", format_value(value)).trim().to_owned())
    };
    let check = |check: &Option<Check>| match check {
        None => "not measured".to_owned(),
        Some(check) => format!("{}{}", number(check.value, &check.unit), limit_text(check.limit)),
    };
    let end = summary.ended_unix_s.map_or("not over".to_owned(), utc_text);
    let rows = vec![
        row(&["cycle", &summary.cycle.to_string()]),
        row(&["began", &utc_text(summary.started_unix_s)]),
        row(&["ended", &end]),
        row(&["panel", &summary.panel]),
        row(&["serial number", &text_or_placeholder(serial)]),
        row(&["work order", &text_or_placeholder(order)]),
        row(&["operator", &text_or_placeholder(operator)]),
        row(&["verdict", &describe_end(summary.verdict, summary.is_air_run)]),
        row(&[
            "films",
            &format!(
                "{} valid, {} invalid, {}",
                summary.films.valid,
                summary.films.invalid,
                number(summary.films.watched_s, "s")
            ),
        ]),
        row(&["failed first", &grids(&summary.films.failed_first)]),
        row(&["failed at the end", &grids(&summary.films.failed_at_end)]),
        row(&["passes", &summary.passes.to_string()]),
        row(&["localization, residual", &check(&summary.localization_residual)]),
        row(&["localization, outline", &check(&summary.outline_residual)]),
        row(&["localization, error 95 %", &check(&summary.localization_error)]),
        row(&["error at the tool, 95 %", &number(summary.budget_total_mm, "mm")]),
        row(&["cycle time", &number(summary.cycle_time_s.map(|s| s as f64), "s")]),
        row(&["simulated time", &number(summary.simulated_s, "s")]),
        row(&["disc, swept", &number(summary.disc.map(|disc| disc.swept_mm2), "mm²")]),
        row(&["disc, worn", &number(summary.disc.map(|disc| disc.worn_mm2), "mm²")]),
    ];
    let reasons = summary.reasons.iter().map(|reason| format!("  {} ({})", reason.message, reason.code));
    columns(&rows).into_iter().chain(reasons).collect()
}

fn limit_text(limit: Limit) -> String {
    match limit {
        Limit::Unlimited => String::new(),
        Limit::AtMost(bound) => format!(", at most {}", shortest_text(bound)),
        Limit::AtLeast(bound) => format!(", at least {}", shortest_text(bound)),
        Limit::Below(bound) => format!(", below {}", shortest_text(bound)),
    }
}

/// Formats the comparison of two cycles. Their inputs are shown only if they differ.
fn comparison_columns(comparison: &Comparison) -> Vec<String> {
    let [first, second] = &comparison.cycles;
    let mut words = vec![match comparison.is_same_part {
        Some(true) => format!("part {}", text_or_placeholder(first.part.serial.clone())),
        Some(false) => "the parts differ".to_owned(),
        None => "the part is not stated in at least one of the cycles".to_owned(),
    }];
    let head = [format!("cycle {}", first.cycle), format!("cycle {}", second.cycle)];
    let mut rows = vec![row(&["", &head[0], &head[1], "difference", "limit"])];
    rows.push(row(&[
        "verdict",
        &describe_end(first.verdict, first.is_air_run),
        &describe_end(second.verdict, second.is_air_run),
    ]));
    rows.extend(comparison.inputs.iter().filter(|input| !input.is_same).map(|input| {
        let short = |value: &Option<String>| {
            text_or_placeholder(value.as_ref().map(|value| value.chars().take(16).collect()))
        };
        vec![input.name.clone(), short(&input.values[0]), short(&input.values[1]), "differs".to_owned()]
    }));
    rows.extend(comparison.checks.iter().map(|pair| {
        let value = |value: Option<f64>| text_or_placeholder(value.map(format_value));
        let limits =
            pair.limits.map(|one| one.map_or(String::new(), limit_text).trim_start_matches(", ").to_owned());
        let limit = if pair.is_limit_different() { limits.join(" | ") } else { limits[0].clone() };
        let pass = if pair.pass == 0 { String::new() } else { format!(" {}", pair.pass) };
        let unit = if pair.unit.is_empty() { String::new() } else { format!(" [{}]", pair.unit) };
        vec![
            format!("{}{pass}: {}{unit}", pair.kind.keyword(), pair.name),
            value(pair.values[0]),
            value(pair.values[1]),
            value(pair.difference),
            limit,
        ]
    }));
    words.extend(columns(&rows));
    let grids: Vec<_> = comparison.grids.iter().filter(|pair| pair.cycles[0] != pair.cycles[1]).collect();
    words.extend(grids.iter().map(|pair| {
        let reported = pair
            .cycles
            .each_ref()
            .map(|past| past.as_ref().map_or("not seen".to_owned(), panelprep_store::history::GridPast::describe));
        format!("{}: {} | {}", pair.grid, reported[0], reported[1])
    }));
    words
}

/// Formats the trend of a quantity over time.
fn trend_columns(trend: &Trend) -> Vec<String> {
    let unit = if trend.unit.is_empty() { String::new() } else { format!(" [{}]", trend.unit) };
    let mut words = vec![format!("{}{unit}", trend.title)];
    let mut rows = vec![row(&["cycle", "at", "part", "value", "limit", "hint"])];
    rows.extend(trend.points.iter().enumerate().map(|(at, point)| {
        let hints = trend.hints.iter().filter(|hint| hint.at == at).map(|hint| hint.rule.describe());
        vec![
            text_or_placeholder(point.cycle.map(|cycle| cycle.to_string())),
            utc_text(point.at_unix_s),
            text_or_placeholder(point.serial.clone()),
            format_value(point.value),
            limit_text(point.limit).trim_start_matches(", ").to_owned(),
            hints.collect::<Vec<_>>().join("; "),
        ]
    }));
    words.extend(columns(&rows));
    words.push(match trend.usual {
        Some(usual) => format!(
            "usual: {} ± {} (mean and one standard deviation); hints follow the Western Electric rules and are not verdicts",
            format_value(usual.mean),
            format_value(usual.sigma)
        ),
        None => format!("no hints: there are fewer than {} \
                         values", panelprep_store::history::western_electric::MIN_VALUES),
    });
    words.extend((trend.without > 0).then(|| format!("{} more cycles do not have this value", trend.without)));
    words
}

/// Formats the heat map of a panel's grids over many cycles.
fn heat_columns(map: &HeatMap) -> Vec<String> {
    let mut rows = vec![row(&["grid", "films", "breaks", "median time to break"])];
    rows.extend(map.grids.iter().map(|cell| {
        let time = text_or_placeholder(cell.median_s.map(|s| format!("{} s", fixed_decimals(s, 1))));
        vec![cell.grid.clone(), cell.films.to_string(), cell.breaks.to_string(), time]
    }));
    std::iter::once(format!("first films of {} cycles", map.films)).chain(columns(&rows)).collect()
}

/// Formats alarms, each with its remedy.
fn alarm_columns(alarms: &[Alarm]) -> Vec<String> {
    if alarms.is_empty() {
        return vec!["no alarms".to_owned()];
    }
    let describe = |alarm: &Alarm| {
        let gone = match alarm.gone_unix_ms {
            None => "lasts".to_owned(),
            Some(gone) => format!("gone {}", utc_text(gone.div_euclid(1_000))),
        };
        let seen =
            alarm.acknowledged.as_ref().map_or(String::new(), |seen| format!(", acknowledged by {}", seen.who));
        let raised = utc_text(alarm.raised_unix_ms.div_euclid(1_000));
        let (priority, code, cycle) = (alarm.priority.keyword(), &alarm.code, alarm.cycle);
        let cycle = cycle.map_or("between cycles".to_owned(), |cycle| format!("cycle {cycle}"));
        let head = format!("{raised}  {priority}  {code}  {cycle}, {gone}{seen}");
        [head, format!("  {}", alarm.message), format!("  What to do: {}", alarm.remedy)]
    };
    alarms.iter().flat_map(describe).collect()
}
