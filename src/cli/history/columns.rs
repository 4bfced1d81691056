//! Formats the history for a person at a terminal: columns of words, the newest first.

use panelprep_base::number_text::{fixed_decimals, shortest_text, utc_text};
use panelprep_base::verdict::{Check, Limit, Reason, Verdict};
use panelprep_cell::record::PartNames;
use panelprep_service::report::format_value;
use panelprep_store::history::{Alarm, Comparison, HeatMap, Hits, Summary, Trend};

/// Placeholder for an empty value.
const EMPTY_PLACEHOLDER: &str = "–";

/// Formats rows as columns; each column has the width of its widest cell, except the last one.
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
pub(super) fn hits(hits: &Hits) -> Vec<String> {
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
pub(super) fn summary(summary: &Summary) -> Vec<String> {
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
        Some(check) => format!("{}{}", number(check.value, &check.unit), limit(check.limit)),
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

fn limit(limit: Limit) -> String {
    match limit {
        Limit::Unlimited => String::new(),
        Limit::AtMost(bound) => format!(", at most {}", shortest_text(bound)),
        Limit::AtLeast(bound) => format!(", at least {}", shortest_text(bound)),
        Limit::Below(bound) => format!(", below {}", shortest_text(bound)),
    }
}

/// Formats two cycles next to each other. Their inputs are shown only if they differ.
pub(super) fn comparison(comparison: &Comparison) -> Vec<String> {
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
        let limits = pair.limits.map(|one| one.map_or(String::new(), limit).trim_start_matches(", ").to_owned());
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
pub(super) fn trend(trend: &Trend) -> Vec<String> {
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
            limit(point.limit).trim_start_matches(", ").to_owned(),
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
        None => format!("fewer than {} values: no hints", panelprep_store::history::western_electric::MIN_VALUES),
    });
    words.extend((trend.without > 0).then(|| format!("{} more cycles do not have this value", trend.without)));
    words
}

/// Formats the heat map of all grids over many cycles.
pub(super) fn heat(map: &HeatMap) -> Vec<String> {
    let mut rows = vec![row(&["grid", "films", "breaks", "median time to break"])];
    rows.extend(map.grids.iter().map(|cell| {
        let time = text_or_placeholder(cell.median_s.map(|s| format!("{} s", fixed_decimals(s, 1))));
        vec![cell.grid.clone(), cell.films.to_string(), cell.breaks.to_string(), time]
    }));
    std::iter::once(format!("first films of {} cycles", map.films)).chain(columns(&rows)).collect()
}

/// Formats alarms, each with its remedy.
pub(super) fn alarms(alarms: &[Alarm]) -> Vec<String> {
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
