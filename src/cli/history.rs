//! `panelprep history`: searches the cycles of the store, compares two, shows trends of quantities, lists alarms. It
//! prints the same data as a table for people, as JSON or as CSV.

mod columns;

use super::args::{Common, EndName, History, HistoryTask, SearchArguments};
use super::fault::{Fault, RecordFault};
use super::load::CellFiles;
use super::outcome::Outcome;
use panelprep_base::config::nearest;
use panelprep_base::verdict::Verdict;
use panelprep_cell::record::CycleId;
use panelprep_store::history::{self, Edge, KnownQuantity, PastCycle, Quantity, Query, RequiredEnd, Table, Trend};
use panelprep_store::store::Store;
use serde::Serialize;
use serde_json::{Map, Value};

/// Runs the requested task.
///
/// # Errors
/// If a date, a panel or a quantity is not known, or there is no store to read.
pub fn run(args: &History, common: &Common) -> Result<Outcome, Fault> {
    let store = match &common.store {
        // A copy of the store in another folder needs no cell's file.
        Some(folder) => Store::open(folder).map_err(Fault::stage)?,
        None => CellFiles::read(common)?.store()?,
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
                columns::summary(&summary),
            )
        }
        Some(HistoryTask::Compare { first, second }) => {
            let comparison =
                history::compare(&load_past_cycle(&store, *first)?, &load_past_cycle(&store, *second)?);
            results_outcome(
                args,
                &comparison,
                &history::comparison_table(&comparison),
                columns::comparison(&comparison),
            )
        }
        Some(HistoryTask::Trend { panel, name }) => {
            let trend = trend(&store, (panel, name), limit)?;
            results_outcome(args, &trend, &history::trend_table(&trend), columns::trend(&trend))
        }
        Some(HistoryTask::Heat { panel }) => {
            let map = history::heat_map(&cycles(&store, panel, limit)?);
            results_outcome(args, &map, &history::heat_table(&map), columns::heat(&map))
        }
        Some(HistoryTask::Alarms { cycle }) => alarms(&store, args, cycle.map(CycleId)),
    }
}

/// The results in the requested form; JSON is always one object with all of them.
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
    results_outcome(args, &hits, &history::hits_table(&hits.hits), columns::hits(&hits))
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

/// Returns the newest finished cycles of a panel, in order from the oldest to the newest.
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

/// The names of all checks of these cycles.
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
    let words = columns::alarms(&all);
    results_outcome(args, &serde_json::json!({ "alarms": all }), &history::alarm_table(&all), words)
}
