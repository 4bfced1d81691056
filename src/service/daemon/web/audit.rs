//! The audit trail: who did what, when and from which address.

use super::answers;
use super::answers::{Answer, read_store};
use super::guard::VisitorExtension;
use super::layout::{Frame, local_time};
use super::state::Web;
use crate::daemon::operator_texts::command;
use axum::Extension;
use axum::extract::{Query, State};
use maud::html;
use panelprep_cell::accounts::{AuditEntry, Role};
use panelprep_cell::record::{Answer as Outcome, ProofsResult, RequestAuthor, RequestSource, RequestedAction};
use panelprep_store::history::Table;
use panelprep_store::store::{NumberedEntry, NumberedRequest, Store, StoreError, TrailPosition};
use serde::Deserialize;
use std::sync::Arc;

/// Number of lines on one page, and below it maximum number of lines in one file.
const PAGE_LINES: usize = 100;
const MAX_FILE_LINES: usize = 100_000;

/// The position before which a page begins: the last line of the previous page.
#[derive(Debug, Clone, Default, Deserialize)]
pub(super) struct Before {
    /// The time of this line, ms since 1970.
    before: Option<i64>,
    /// The label of this line. Without it, the page begins before the time.
    line: Option<String>,
}

impl Before {
    /// Returns the positions in the audit trail and among the requests. Within one millisecond, the requests come
    /// first.
    fn positions(&self) -> Option<(TrailPosition, TrailPosition)> {
        let label = self.line.as_deref().unwrap_or_default();
        let (audit, request) = match (label.parse::<i64>(), label.strip_prefix('R').map(str::parse::<i64>)) {
            (Ok(number), _) => (number, i64::MIN),
            (_, Some(Ok(number))) => (i64::MAX, number),
            _ => (i64::MIN, i64::MIN),
        };
        let at = |unix_ms| move |number| TrailPosition { unix_ms, number };
        self.before.map(at).map(|at| (at(audit), at(request)))
    }
}

/// A line of the page: an entry of the store's audit trail, or a request to the cell through any interface.
struct Line {
    is_request: bool,
    /// The number of the entry in its table of the store.
    number: i64,
    entry: AuditEntry,
}

impl Line {
    /// Returns the number of the entry, with an R before it for a request.
    fn label(&self) -> String {
        if self.is_request { format!("R{}", self.number) } else { self.number.to_string() }
    }
}

/// Returns the newest lines of both tables, ordered from new to old.
fn lines(store: &Store, before: &Before, most: usize) -> Result<Vec<Line>, StoreError> {
    let (audit, request) = before.positions().unzip();
    let of_people = store.audit(audit, most)?.into_iter();
    let of_people = of_people.map(|NumberedEntry { number, entry }| Line { is_request: false, number, entry });
    let requests = store.requests(request, most)?.into_iter().map(request_line);
    let mut lines: Vec<Line> = of_people.chain(requests).collect();
    lines.sort_by_key(|line| std::cmp::Reverse((line.entry.unix_ms, line.is_request, line.number)));
    lines.truncate(most);
    Ok(lines)
}

/// Returns the line of a request to the cell: what was requested, in which cycle, by whom, and its result.
fn request_line(NumberedRequest { number, cycle, request }: NumberedRequest) -> Line {
    let (what, of) = match &request.wanted {
        RequestedAction::For(asked) => (command(*asked), None),
        RequestedAction::NewDisc => ("new-disc", None),
        RequestedAction::Start { recipe } => ("start", Some(recipe.clone())),
        RequestedAction::Proofs { stage, by, result, .. } => {
            let what = match result {
                ProofsResult::Wrong => "proofs-wrong",
                ProofsResult::Proven => "proofs",
                ProofsResult::Signed => "proofs-signed",
            };
            (what, Some(format!("stage {stage}, by {by}")))
        }
    };
    let reasons: Vec<String> = request.reasons.iter().map(|reason| reason.message.clone()).collect();
    let reasons = Some(reasons.join("; ")).filter(|reasons| !reasons.is_empty());
    let in_cycle = cycle.map(|cycle| format!("cycle {cycle}"));
    let (remark, refused) = match request.answer {
        Some(Outcome::Done) => (reasons, None),
        Some(Outcome::Refused | Outcome::Failed) => (None, Some(reasons.unwrap_or_default())),
        None => (Some("its result was not recorded".to_owned()), None),
    };
    let (who, from) = match request.who {
        Some(RequestAuthor { user: Some(user), front, from, .. }) => (Some(user), (front, from)),
        Some(RequestAuthor { uid: Some(uid), front, from, .. }) => (Some(format!("user {uid}")), (front, from)),
        Some(RequestAuthor { front, from, .. }) => (None, (front, from)),
        None => (None, (RequestSource::Program, None)),
    };
    let subject: Vec<String> = in_cycle.into_iter().chain(of).chain(remark).collect();
    let from = [Some(source_label(from.0).to_owned()), from.1].into_iter().flatten().collect::<Vec<_>>().join(", ");
    let subject = Some(subject.join(": ")).filter(|subject| !subject.is_empty());
    let entry = AuditEntry {
        unix_ms: request.unix_ms,
        subject,
        refused,
        ..AuditEntry::for_completed_action(who, None, from, what)
    };
    Line { is_request: true, number, entry }
}

fn source_label(front: RequestSource) -> &'static str {
    match front {
        RequestSource::Socket => "socket",
        RequestSource::Page => "page",
        RequestSource::OpcUa => "OPC UA",
        RequestSource::Command => "command",
        RequestSource::Sparkplug => "MQTT Sparkplug",
        RequestSource::Line => "line",
        RequestSource::Signal => "signal",
        RequestSource::Program => "program",
    }
}

/// Shows the newest lines, or the lines before another line.
pub(super) async fn page(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    Query(before): Query<Before>,
) -> Answer {
    let lines = read_store(&web, &visitor, move |store| lines(store, &before, PAGE_LINES)).await?;
    let words = visitor.language();
    let word = |key| words.text(key);
    let older = lines.last().filter(|_| lines.len() == PAGE_LINES);
    let older = older.map(|line| format!("/audit?before={}&line={}", line.entry.unix_ms, line.label()));
    let body = html! {
        section.card {
            h2 { (word("audit.title")) }
            p { a href="/audit.csv" { "CSV" } }
            div.scroll tabindex="0" {
                table {
                    thead { tr {
                        @for key in ["audit.number", "audit.when", "audit.who", "audit.from", "audit.what", "audit.subject", "audit.before", "audit.after", "audit.refused"] {
                            th { (word(key)) }
                        }
                    } }
                    tbody { @for (line, entry) in lines.iter().map(|line| (line, &line.entry)) {
                        tr.refused[entry.refused.is_some()] {
                            td { (line.label()) }
                            td { (local_time(entry.unix_ms)) }
                            td { (entry.who.as_deref().unwrap_or("–")) @if let Some(role) = entry.role { " (" (role.keyword()) ")" } }
                            td { (entry.from) }
                            td { (entry.what) }
                            @for text in [&entry.subject, &entry.before, &entry.after, &entry.refused] { td { (text.as_deref().unwrap_or("")) } }
                        }
                    } }
                }
            }
            @if let Some(older) = older { p { a.button href=(older) { (word("older")) } } }
        }
    };
    let frame = Frame { visitor: &visitor, title: word("audit.title"), here: "/audit", scripts: &[] };
    Ok(frame.page(&body))
}

/// Returns the whole audit trail as a file.
pub(super) async fn csv(State(web): State<Arc<Web>>, Extension(visitor): VisitorExtension) -> Answer {
    let lines = read_store(&web, &visitor, |store| lines(store, &Before::default(), MAX_FILE_LINES)).await?;
    Ok(answers::csv(&visitor, "audit", &table(&lines)))
}

fn table(lines: &[Line]) -> Table {
    let columns = ["number", "unix_ms", "who", "role", "from", "what", "subject", "before", "after", "refused"];
    Table::new(&columns).with_rows(lines.iter().map(|line| {
        let entry = &line.entry;
        vec![
            line.label().into(),
            entry.unix_ms.into(),
            entry.who.clone().into(),
            entry.role.map(Role::keyword).into(),
            entry.from.as_str().into(),
            entry.what.as_str().into(),
            entry.subject.clone().into(),
            entry.before.clone().into(),
            entry.after.clone().into(),
            entry.refused.clone().into(),
        ]
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::Reason;
    use panelprep_cell::cycle::Request;
    use panelprep_cell::record::RequestRecord;

    #[test]
    fn a_line_is_a_csv_row_and_never_a_formula() {
        let entry = AuditEntry {
            unix_ms: 7,
            who: Some("anna".to_owned()),
            role: Some(Role::Operator),
            from: "10.0.0.1".to_owned(),
            what: "log in".to_owned(),
            subject: Some("=cmd()".to_owned()),
            before: None,
            after: Some("a,\"b\"".to_owned()),
            refused: None,
        };
        let csv = table(&[Line { is_request: false, number: 3, entry }]).csv().expect("written");
        let row = csv.lines().nth(1).map(str::to_owned);
        assert_eq!(row.as_deref(), Some("3,7,anna,operator,10.0.0.1,log in,'=cmd(),,\"a,\"\"b\"\"\","));
    }
    #[test]
    fn a_request_to_the_cell_is_a_line_with_its_author_address_and_outcome() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::create(&folder.path().join("store")).expect("a store");
        let who = |front, user: Option<&str>| RequestAuthor {
            user: user.map(str::to_owned),
            from: Some("10.0.0.7".to_owned()),
            ..RequestAuthor::from_source(front)
        };
        let request = |wanted, who, answer, reasons: &[&str]| RequestRecord {
            unix_ms: 0,
            wanted,
            who: Some(who),
            answer: Some(answer),
            reasons: reasons.iter().map(|words| Reason::new("held_by", *words)).collect(),
            findings: None,
        };
        let page = |user| who(RequestSource::Page, user);
        for kept in [
            request(RequestedAction::For(Request::Abort), page(None), Outcome::Done, &[]),
            request(RequestedAction::For(Request::Hold), page(Some("anna")), Outcome::Done, &["a hair"]),
            request(
                RequestedAction::For(Request::Reset),
                who(RequestSource::OpcUa, Some("plc")),
                Outcome::Refused,
                &["not now"],
            ),
        ] {
            store.store_request(&kept, None, None).expect("kept");
        }
        store
            .store_audit(&AuditEntry::for_completed_action(None, None, "terminal".to_owned(), "log out"))
            .expect("kept");
        let reported = lines(&store, &Before::default(), 10).expect("read");
        let reported: Vec<_> = reported
            .iter()
            .map(|Line { entry: line, .. }| {
                (&*line.what, line.who.as_deref(), &*line.from, line.subject.as_deref(), line.refused.as_deref())
            })
            .collect();
        for line in [
            ("abort", None, "page, 10.0.0.7", None, None),
            ("hold", Some("anna"), "page, 10.0.0.7", Some("a hair"), None),
            ("reset", Some("plc"), "OPC UA, 10.0.0.7", None, Some("not now")),
            ("log out", None, "terminal", None, None),
        ] {
            assert!(reported.contains(&line), "{line:?}: {reported:?}");
        }
        let newest = lines(&store, &Before::default(), 2).expect("read");
        assert_eq!(newest.len(), 2);
        let before_1970 = Before { before: Some(0), line: None };
        assert!(lines(&store, &before_1970, 10).expect("read").is_empty(), "nothing before 1970");
    }

    /// Three requests and two entries within one millisecond: two-line pages contain each of the five lines once.
    #[test]
    fn pages_contain_each_line_of_one_millisecond_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::create(&folder.path().join("store")).expect("a store");
        let at = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(2_000);
        panelprep_store::store::testing::set_clock(&mut store, at);
        let request = RequestRecord {
            unix_ms: 0,
            wanted: RequestedAction::NewDisc,
            who: None,
            answer: Some(Outcome::Done),
            reasons: vec![],
            findings: None,
        };
        (0..3).for_each(|_| store.store_request(&request, None, None).expect("kept"));
        let line = AuditEntry::for_completed_action(None, None, "terminal".to_owned(), "log in");
        (0..2).for_each(|_| store.store_audit(&line).expect("kept"));
        let (mut before, mut pages) = (Before::default(), Vec::new());
        loop {
            let page = lines(&store, &before, 2).expect("read");
            let Some(last) = page.last() else { break };
            before = Before { before: Some(last.entry.unix_ms), line: Some(last.label()) };
            pages.push(page.iter().map(Line::label).collect::<Vec<_>>());
        }
        assert_eq!(pages, [vec!["R3", "R2"], vec!["R1", "2"], vec!["1"]]);
    }
}
