//! `panelprep robot prove`: goes through what the installation page requires to be proven on a controller, one
//! assumption after the other.
//!
//! It tests over the two ports what a client alone can see. For the rest it states what to do and what to expect,
//! and writes down what the person at the controller has seen. It causes no motion. The answers become a page to
//! sign.

mod page;
mod proof;
mod unattended;

use super::args::Prove;
use super::fault::{DeviceFault, Fault};
use super::live;
use super::load::CellFiles;
use super::outcome::Outcome;
use crate::cell::RobotKind;
use crate::requirements::Purpose;
use crate::verdict::{Judgement, Reason, Verdict};
use proof::{Assumption, Finding, Proof};
use serde_json::json;
use std::io::BufRead;
use unattended::ControllerKind;

/// The installation page with the table of assumptions to go through.
const INSTALLATION: &str = include_str!("../../config/kuka/README.md");
/// Rows of the table that need the tool in contact, or a panel: this command cannot prove them.
const IN_CONTACT: [u32; 5] = [20, 21, 22, 40, 51];

/// Goes through the table and writes the page.
///
/// # Errors
/// If the cell's robot is not a controller with two ports, another program holds the store, or the page exists
/// already or cannot be written.
pub fn run(args: &Prove, files: &CellFiles, tell: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    files.require(Purpose::Robot)?;
    if files.cell.robot().kind() != RobotKind::Eki {
        return Err(DeviceFault::NothingToProve.into());
    }
    let _store = files.settled_store()?;
    let (robot, _) = live::robot_alone(&files.cell)?;
    drop(robot);
    let mut controller = unattended::controller(&files.cell)?;
    let page = |proofs: &[Proof], controller| page::render(proofs, &args.by, (files.cell.robot(), controller));
    // The page is written before the first question: after a day's work at the controller, it must be possible to
    // store the answers.
    super::disk::write_new(&args.out, page(&[], controller))?;
    if controller == ControllerKind::Mock {
        tell(
            "a MOCK controller answered: this is a rehearsal, which proves nothing about a real controller; do not \
             sign its page",
        );
    }
    let mut answers = std::io::stdin().lock().lines().map_while(Result::ok);
    let mut proofs = Vec::new();
    for assumption in assumptions(INSTALLATION) {
        tell(&format!("{}. {}", assumption.number, assumption.assumed));
        let proof = match unattended::for_row(assumption.number) {
            Some(attempt) => {
                let (finding, evidence) = attempt(&files.cell)?;
                Proof { assumption, finding, evidence, tried: true }
            }
            None => ask(assumption, &mut answers, tell),
        };
        tell(&format!("   {}: {}", proof.finding.word(), proof.evidence));
        proofs.push(proof);
        super::disk::write(&args.out, page(&proofs, controller))?;
    }
    // The tests are valid only for the controller that also answers now: a controller may not have answered at first,
    // or another one may have replaced it.
    controller = controller.and(unattended::controller(&files.cell)?);
    super::disk::write(&args.out, page(&proofs, controller))?;
    let is_mock = controller == ControllerKind::Mock;
    let mut outcome = Outcome::from_judgement(&judgement(&proofs, controller != ControllerKind::Real));
    let rows: Vec<_> = proofs
        .iter()
        .map(|proof| {
            json!({
                "number": proof.assumption.number, "finding": proof.finding.word(),
                "evidence": proof.evidence, "tried": proof.tried
            })
        })
        .collect();
    outcome.put("proofs", json!(rows));
    outcome.put("mock", json!(is_mock));
    outcome.put("page", json!(args.out.display().to_string()));
    let page = args.out.display();
    outcome.add_line(match controller {
        ControllerKind::Mock => format!("page: {page}; from a rehearsal on a mock controller, do not sign the page"),
        ControllerKind::Unknown => {
            format!(
                "page: {page}; no controller answered at the beginning or at the end: do not sign the page; run the command again"
            )
        }
        ControllerKind::Real => format!("page: {page}; print it, sign it, and keep it with the cell's file"),
    });
    Ok(outcome)
}

/// Asks the person for the observation: `y`, `n` or nothing, followed by the evidence.
fn ask(assumption: Assumption, answers: &mut dyn Iterator<Item = String>, tell: &dyn Fn(&str)) -> Proof {
    let contact = IN_CONTACT.contains(&assumption.number);
    tell(&format!("   {}", assumption.to_do));
    let (finding, evidence) = if contact {
        (
            Finding::Open,
            "needs the tool in contact with the panel: test by hand after all other tests are proven".to_owned(),
        )
    } else {
        tell(
            "   As expected? Type y or n, a space and the evidence (trace, film, figure); press Enter alone to leave the test open.",
        );
        answer(&answers.next().unwrap_or_default())
    };
    Proof { assumption, finding, evidence, tried: false }
}

fn answer(line: &str) -> (Finding, String) {
    let (word, evidence) = line.trim().split_once(' ').unwrap_or((line.trim(), ""));
    let evidence = evidence.trim();
    match word.to_ascii_lowercase().as_str() {
        "" => (Finding::Open, "not done".to_owned()),
        // Evidence that cannot be looked up later proves nothing.
        "y" if evidence.is_empty() => (Finding::Open, "reported as expected, without evidence".to_owned()),
        "y" => (Finding::Proven, evidence.to_owned()),
        "n" => (Finding::Wrong, if evidence.is_empty() { "not as expected" } else { evidence }.to_owned()),
        _ => (Finding::Open, format!("the answer \"{}\" is neither y nor n", line.trim())),
    }
}

fn judgement(proofs: &[Proof], is_mock: bool) -> Judgement {
    let of_mock = is_mock.then(|| {
        let message =
            "a mock controller answered: tests on a mock controller prove nothing about a real controller";
        Reason::new("mock_controller", message)
    });
    let of_proofs = proofs.iter().filter(|proof| proof.finding != Finding::Proven).map(|proof| {
        let number = proof.assumption.number;
        let message = format!("assumption {number} is {}: {}", proof.finding.word(), proof.evidence);
        Reason::new(if proof.finding == Finding::Wrong { "assumption_wrong" } else { "assumption_open" }, message)
    });
    let reasons: Vec<Reason> = of_mock.into_iter().chain(of_proofs).collect();
    let is_wrong = is_mock || proofs.iter().any(|proof| proof.finding == Finding::Wrong);
    let verdict = match (is_wrong, reasons.is_empty()) {
        (true, _) => Verdict::Reject,
        (false, false) => Verdict::Review,
        (false, true) => Verdict::Accept,
    };
    Judgement { verdict, reasons }
}

/// The rows of the table "To be proven".
fn assumptions(page: &str) -> Vec<Assumption> {
    let table = page.split("\n## To be proven\n").nth(1).and_then(|rest| rest.split("\n## ").next());
    let row = |line: &str| {
        let mut cells = line.trim().trim_matches('|').split(" | ").map(str::trim);
        let number = cells.next()?.parse().ok()?;
        Some(Assumption { number, assumed: cells.next()?.to_owned(), to_do: cells.next()?.to_owned() })
    };
    table.unwrap_or_default().lines().filter_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_of_the_page_is_gone_through() {
        let rows = assumptions(INSTALLATION);
        let numbers: Vec<u32> = rows.iter().map(|row| row.number).collect();
        assert!(numbers.len() >= 47, "{numbers:?}");
        assert_eq!(numbers, (1..=numbers.len() as u32).collect::<Vec<_>>());
        assert!(rows.iter().all(|row| !row.to_do.is_empty() && !row.to_do.ends_with('|')));
        assert!(IN_CONTACT.iter().all(|number| numbers.contains(number)));
    }

    #[test]
    fn an_answer_without_evidence_proves_nothing() {
        assert_eq!(answer("y film 12, 0.3 s"), (Finding::Proven, "film 12, 0.3 s".to_owned()));
        assert_eq!(answer("y").0, Finding::Open);
        assert_eq!(answer("N stops at the second").0, Finding::Wrong);
        assert_eq!(answer("  ").0, Finding::Open);
        assert_eq!(answer("perhaps").0, Finding::Open);
    }
}
