//! Tests whole cycles at the request of a production line: a simulated line beside the simulated cell, which uses only
//! the signals of the controller.

use super::commands::json;
use super::commands::taught::{LINE_INPUTS, LINE_OUTPUTS};
use super::service::{Service, taught};
use panelprep::cycle::Request;
use panelprep::record::{Answer, Kind, PartNames, RequestAuthor, RequestSource, RequestedAction};
use panelprep::store::Store;
use panelprep::verdict::Verdict;
use std::path::Path;

const LINE: &str = "
[line]
recipe = 'recipe.toml'
order = 'WO 7'
operator = 'Line 2'
";

fn with_line(folder: &Path) {
    let file = folder.join("cell/cell.toml");
    let text = std::fs::read_to_string(&file).expect("a cell");
    let text = text.replace(LINE_INPUTS[0], LINE_INPUTS[1]);
    std::fs::write(file, text + LINE_OUTPUTS + LINE).expect("written");
}

/// After one reset by a person, the line has two parts prepared, each greasy on arrival, without any further action of
/// a person. A third start, while the recipe is missing, is refused and reported, and the line does not request it
/// again.
#[test]
fn a_line_has_its_parts_prepared() {
    let folder = taught("good");
    let folder = folder.path();
    let (exit, reported) = json(folder, "run --cell cell/cell.toml --seed 3 --line-parts 1");
    assert!(exit == 2 && reported.to_string().contains("needs all of its signals"), "{reported}");

    with_line(folder);
    let service = Service::start_simulating(folder, &["--line-parts", "3"]);
    service.reset();
    let store = || Store::open(&folder.join("cell/store")).expect("the store opens");
    let recipe = folder.join("cell/recipe.toml");
    service.wait("the second cycle", |_| store().ended_cycles().expect("read").len() == 2);
    std::fs::rename(&recipe, folder.join("gone.toml")).expect("away");
    service
        .wait("a third start is refused", |service| service.log().contains("requested a start, which was refused"));
    service.reach("idle");
    std::fs::rename(folder.join("gone.toml"), &recipe).expect("back");
    // This time is longer than the time after which the line would repeat a request.
    std::thread::sleep(std::time::Duration::from_secs(4));
    assert_eq!(service.state(), "idle");

    let store = store();
    let ended = store.ended_cycles().expect("read");
    assert_eq!(ended.len(), 2);
    for id in ended {
        let record = store.cycle(id).expect("its record");
        assert_eq!(record.judgement.map(|judged| judged.verdict), Some(Verdict::Pass));
        assert!(record.findings.iter().any(|finding| finding.kind == Kind::Abrade), "it was greasy");
        let names = PartNames { serial: None, order: Some("WO 7".to_owned()), operator: Some("Line 2".to_owned()) };
        assert_eq!(store.cycle_part(id).expect("read"), Some(names));
    }
    // Each request of the line is recorded once with its result, among the requests to the cell.
    let of_line = |who: &RequestAuthor| who.front == RequestSource::Line;
    let asked: Vec<(String, bool)> = store
        .requests(None, 100)
        .expect("read")
        .into_iter()
        .map(|numbered| numbered.request)
        .filter(|asked| asked.who.as_ref().is_some_and(of_line))
        .map(|asked| (word(&asked.wanted).to_owned(), asked.answer != Some(Answer::Done)))
        .rev()
        .collect();
    let [start, reset] = ["start", "reset"].map(|what| (what.to_owned(), false));
    assert_eq!(asked, [start.clone(), reset.clone(), start, reset, ("start".to_owned(), true)]);
    let beside = store.audit(None, 100).expect("read");
    assert!(beside.iter().all(|line| !["start", "reset"].contains(&&*line.entry.what)), "{beside:#?}");
}

fn word(wanted: &RequestedAction) -> &'static str {
    match wanted {
        RequestedAction::Start { .. } | RequestedAction::For(Request::Start { .. }) => "start",
        RequestedAction::For(Request::Reset) => "reset",
        _ => "other",
    }
}
