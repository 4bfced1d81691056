//! `panelprep robot prove`: goes through what the installation page requires to be proven on a controller, one
//! assumption after the other.
//!
//! It tests over the two ports what a client alone can see. For the rest it states what to do and what to expect,
//! and writes down what the person at the controller has seen. It causes no motion. The answers become a page to
//! sign.

mod page;
mod proof;
mod raw_client;
mod table;
mod unattended;

use super::args::Prove;
use super::fault::{DeviceFault, Fault};
use super::live;
use super::load::CellFiles;
use super::outcome::Outcome;
use crate::cell::{ProofStage, RobotKind};
use crate::requirements::Purpose;
use crate::verdict::{Judgement, Reason, Verdict};
use proof::{Assumption, Finding, Proof};
use serde_json::json;
use std::io::BufRead;
use table::{INSTALLATION, assumptions};
use unattended::ControllerKind;

/// Goes through the rows of a stage and writes its page.
///
/// # Errors
/// If the cell's robot is not a controller with two ports, the stage before is not signed, another program holds the
/// store, or the page exists already or cannot be written.
pub fn run(args: &Prove, files: &CellFiles, tell: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    files.require(Purpose::Robot)?;
    if files.cell.robot().kind() != RobotKind::Eki {
        return Err(DeviceFault::NothingToProve.into());
    }
    // The store is free while a person is asked: that person uses other commands of this program meanwhile.
    drop(files.settled_store()?);
    let (robot, _) = live::robot_alone(&files.cell)?;
    drop(robot);
    let mut controller = unattended::controller(&files.cell)?;
    let signed = files.cell.robot().signed_stage();
    let stage = args.stage.unwrap_or_else(|| ProofStage::after(signed));
    if let Some(before) =
        stage.before().filter(|before| signed < Some(*before) && controller != ControllerKind::Mock)
    {
        return Err(DeviceFault::ProvenTooEarly { stage, before }.into());
    }
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
    let rows: Vec<Assumption> = assumptions(INSTALLATION).into_iter().filter(|row| row.stage == stage).collect();
    tell(&format!("stage {}, {} rows; {}", stage.letter(), rows.len(), stage.conditions()));
    let mut answers = std::io::stdin().lock().lines().map_while(Result::ok);
    let mut proofs: Vec<Proof> = Vec::new();
    // The trials of this program come first: in T1 a person holds the start key during them, and not afterwards.
    let (tried, asked): (Vec<_>, Vec<_>) =
        rows.into_iter().partition(|row| unattended::for_row(row.number).is_some());
    for assumption in tried.into_iter().chain(asked) {
        tell(&format!("{}. {}", assumption.number, assumption.assumed));
        let proof = match unattended::for_row(assumption.number) {
            Some(attempt) => {
                let (finding, evidence) = attempted(files, attempt)?;
                Proof { assumption, finding, evidence, tried: true }
            }
            None => ask_observation(assumption, &mut answers, tell),
        };
        tell(&format!("   {}: {}", proof.finding.keyword(), proof.evidence));
        proofs.push(proof);
        proofs.sort_by_key(|proof| proof.assumption.number);
        super::disk::write(&args.out, page(&proofs, controller))?;
    }
    // The tests are valid only for the controller that also answers now: a controller may not have answered at first,
    // or another one may have replaced it.
    controller = controller.combine(unattended::controller(&files.cell)?);
    super::disk::write(&args.out, page(&proofs, controller))?;
    let is_mock = controller == ControllerKind::Mock;
    let mut outcome = Outcome::from_judgement(&judgement(&proofs, controller != ControllerKind::Real));
    let rows: Vec<_> = proofs
        .iter()
        .map(|proof| {
            json!({
                "number": proof.assumption.number, "finding": proof.finding.keyword(),
                "evidence": proof.evidence, "tried": proof.tried
            })
        })
        .collect();
    outcome.add_value("proofs", json!(rows));
    outcome.add_value("stage", json!(stage.letter()));
    outcome.add_value("mock", json!(is_mock));
    outcome.add_value("page", json!(args.out.display().to_string()));
    let page = args.out.display();
    let unproven = proofs.iter().filter(|proof| proof.finding != Finding::Proven).count();
    outcome.add_line(match controller {
        ControllerKind::Real if unproven > 0 => {
            let stage = stage.letter();
            format!("page: {page}; stage {stage} cannot be signed: {unproven} rows are wrong or open")
        }
        ControllerKind::Mock => format!("page: {page}; from a rehearsal on a mock controller, nothing to sign"),
        ControllerKind::Unknown => {
            format!(
                "page: {page}; no controller answered at the beginning or at the end: do not sign the page; run the command again"
            )
        }
        ControllerKind::Real => format!(
            "page: {page}; print it, sign it, and keep it with the cell's file; then set signed_stage = \"{}\" in [robot]",
            stage.letter()
        ),
    });
    Ok(outcome)
}

/// Tries a row, with the store held, so that no other program of this cell uses the controller meanwhile.
fn attempted(files: &CellFiles, attempt: unattended::Attempt) -> Result<(Finding, String), Fault> {
    match files.settled_store() {
        Ok(_store) => attempt(&files.cell),
        Err(fault) => Ok((Finding::Open, fault.to_string())),
    }
}

/// Asks the person for the observation: `y`, `n` or nothing, followed by the evidence.
fn ask_observation(
    assumption: Assumption,
    answers: &mut dyn Iterator<Item = String>,
    tell: &dyn Fn(&str),
) -> Proof {
    tell(&format!("   Do: {}", assumption.to_do));
    tell(&format!("   See: {}", assumption.to_see));
    tell("   Seen as expected? y or n, then a space and the evidence (trace, film, figure); Enter leaves it open.");
    let (finding, evidence) = parse_observation(&answers.next().unwrap_or_default());
    Proof { assumption, finding, evidence, tried: false }
}

fn parse_observation(line: &str) -> (Finding, String) {
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
        let message = format!("assumption {number} is {}: {}", proof.finding.keyword(), proof.evidence);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_without_evidence_proves_nothing() {
        assert_eq!(parse_observation("y film 12, 0.3 s"), (Finding::Proven, "film 12, 0.3 s".to_owned()));
        assert_eq!(parse_observation("y").0, Finding::Open);
        assert_eq!(parse_observation("N stops at the second").0, Finding::Wrong);
        assert_eq!(parse_observation("  ").0, Finding::Open);
        assert_eq!(parse_observation("perhaps").0, Finding::Open);
    }
}
