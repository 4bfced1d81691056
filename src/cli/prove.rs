//! `panelprep robot prove`: guides a person through the acceptance tests of a controller, which the installation page
//! lists as assumptions to be proven.
//!
//! The command tests what a client can observe on the two ports. For the other tests it states what to do and what to
//! expect, and records what the person at the controller has observed. It causes no motion. The results are written to
//! a page to be signed; `--sign` stores the signature.

mod page;
mod table;
mod trial;
mod unattended;

use super::args::Prove;
use super::fault::{DeviceFault, Fault};
use super::live::{ControllerKind, ReportedController, identify};
use super::output::Outcome;
use page::{PageBasis, ProofPage};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::{ProofStage, RobotKind};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::ProofsResult;
use panelprep_kuka::eki::Mode;
use panelprep_service::daemon::current_user;
use panelprep_service::requirements::Purpose;
use panelprep_service::setup::CellFiles;
use panelprep_store::store::{ProofsPage, Store};
use serde_json::json;
use std::io::BufRead;
use table::{Assumption, Finding, INSTALLATION, Proof, assumptions};

/// Runs the acceptance tests of a stage and writes its page, or stores the signature of a page.
///
/// # Errors
/// If the robot of the cell has no real controller, the previous stage is not signed, the controller has another mode
/// or other programs than the stage requires, another program uses the store, or the page already exists or cannot be
/// written.
pub fn run(args: &Prove, files: &CellFiles, tell: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    files.require(Purpose::Robot)?;
    if files.cell.robot().kind() != RobotKind::Eki {
        return Err(DeviceFault::NothingToProve.into());
    }
    if args.sign {
        return page::sign(args, files);
    }
    // The store is closed while a person is asked, because the person uses other commands of this program meanwhile.
    drop(files.settled_store()?);
    let begin = identify(&files.cell)?;
    let stage = stage_to_prove(args, files, &begin)?;
    let mut run = ProofRun::begin(args, files, (stage, begin))?;
    if begin.kind == ControllerKind::Mock {
        tell(
            "a MOCK controller responded: this is a rehearsal, which is not valid for a real controller; do not sign \
             its page",
        );
    }
    tell(&format!("stage {}, {} rows; {}", stage.letter(), run.proofs.len(), stage.conditions()));
    run.run_tests(tell)?;
    run.end()
}

/// Returns the stage to be tested, if the controller is ready for it. A mock controller is always ready.
fn stage_to_prove(args: &Prove, files: &CellFiles, begin: &ReportedController) -> Result<ProofStage, Fault> {
    let robot = files.cell.robot();
    let stage = args.stage.unwrap_or_else(|| ProofStage::after(robot.signed_stage()));
    if begin.kind == ControllerKind::Mock {
        return Ok(stage);
    }
    let (Some(reported), Some(mode)) = (begin.programs_sum, begin.mode) else {
        return Err(DeviceFault::NoControllerToProve.into());
    };
    if let Some(before) = stage.before().filter(|before| robot.signed_stage() < Some(*before)) {
        return Err(DeviceFault::ProvenTooEarly { stage, before }.into());
    }
    let accepted = robot.programs_sum();
    if accepted != Some(reported) {
        return Err(DeviceFault::ProofsOfOtherPrograms { reported, accepted }.into());
    }
    if !is_mode_of(stage, mode) {
        return Err(DeviceFault::ProvenInOtherMode { stage, mode: mode.name() }.into());
    }
    Ok(stage)
}

/// Returns whether a stage is tested in this mode; in stage A a person holds the enabling switch.
fn is_mode_of(stage: ProofStage, mode: Mode) -> bool {
    match stage {
        ProofStage::A => mode == Mode::T1,
        ProofStage::B | ProofStage::C => matches!(mode, Mode::Automatic | Mode::External),
    }
}

/// A run of the acceptance tests of one stage.
struct ProofRun<'r> {
    args: &'r Prove,
    files: &'r CellFiles,
    stage: ProofStage,
    begin: ReportedController,
    /// All tests of the stage, in their order; a test is open until it was run.
    proofs: Vec<Proof>,
}

impl<'r> ProofRun<'r> {
    /// Starts a run and writes its page before the first question, so that a page that cannot be written is detected
    /// before the work begins.
    fn begin(
        args: &'r Prove,
        files: &'r CellFiles,
        (stage, begin): (ProofStage, ReportedController),
    ) -> Result<Self, Fault> {
        let rows = assumptions(INSTALLATION).into_iter().filter(|row| row.stage == stage);
        let run = ProofRun { args, files, stage, begin, proofs: rows.map(Proof::open).collect() };
        super::disk::write_new(&args.out, run.page(None).render())?;
        Ok(run)
    }

    fn page(&self, end: Option<ReportedController>) -> ProofPage<'_> {
        ProofPage {
            stage: self.stage,
            proofs: &self.proofs,
            by: &self.args.by,
            robot: self.files.cell.robot(),
            reports: (self.begin, end),
        }
    }

    /// Runs the tests in their order. This program's own tests come first: in T1 a person holds the Start key during
    /// these tests only.
    fn run_tests(&mut self, tell: &dyn Fn(&str)) -> Result<(), Fault> {
        let mut answers = std::io::stdin().lock().lines().map_while(Result::ok);
        let is_tried =
            |place: &usize| unattended::find_test_for_row(self.proofs[*place].assumption.number).is_some();
        let (tried, asked): (Vec<usize>, Vec<usize>) = (0..self.proofs.len()).partition(is_tried);
        for place in tried.into_iter().chain(asked) {
            let assumption = self.proofs[place].assumption.clone();
            tell(&format!("{}. {}", assumption.number, assumption.assumed));
            let proof = match unattended::find_test_for_row(assumption.number) {
                Some(attempt) => {
                    let (finding, evidence) = run_attempt(self.files, attempt)?;
                    Proof { assumption, finding, evidence, tried: true }
                }
                None => ask_observation(assumption, &mut answers, tell),
            };
            tell(&format!("   {}: {}", proof.finding.keyword(), proof.evidence));
            let is_wrong = proof.finding == Finding::Wrong;
            self.proofs[place] = proof;
            super::disk::write(&self.args.out, self.page(None).render())?;
            if is_wrong {
                self.store_wrong_row()?;
            }
        }
        Ok(())
    }

    /// Immediately stores that a test failed on a real controller, so that an interrupted run does not lose this
    /// result.
    fn store_wrong_row(&self) -> Result<(), Fault> {
        let (ControllerKind::Real, Some(programs_sum)) = (self.begin.kind, self.begin.programs_sum) else {
            return Ok(());
        };
        let page_sha256 = content_hash(&super::disk::read(&self.args.out)?);
        self.store_page(ProofsPage {
            stage: self.stage,
            programs_sum,
            page_sha256,
            by: self.args.by.clone(),
            result: ProofsResult::Wrong,
        })
    }

    fn store_page(&self, page: ProofsPage) -> Result<(), Fault> {
        Store::store_proofs_in(self.files.store_folder(), &page, current_user()).map_err(Fault::stage)
    }

    /// Writes the final page, and stores it if every test has passed. The results are valid only if the same
    /// controller, with the same programs, still responds at the end.
    fn end(self) -> Result<Outcome, Fault> {
        // If no link can be started at the end, the page is still written, because it contains a day's work, but it
        // cannot be signed.
        let end = identify(&self.files.cell).unwrap_or(ReportedController::UNKNOWN);
        let page = self.page(Some(end));
        let text = page.render();
        super::disk::write(&self.args.out, &text)?;
        if let Some(programs_sum) = end.programs_sum.filter(|_| page.is_signable()) {
            let (page_sha256, by) = (content_hash(text.as_bytes()), self.args.by.clone());
            let result = ProofsResult::Proven;
            self.store_page(ProofsPage { stage: self.stage, programs_sum, page_sha256, by, result })?;
        }
        Ok(self.outcome(&page))
    }

    fn outcome(&self, page: &ProofPage<'_>) -> Outcome {
        let basis = page.basis();
        let mut outcome = Outcome::from_judgement(&judgement(&self.proofs, basis));
        let row = |proof: &Proof| {
            json!({
                "number": proof.assumption.number, "finding": proof.finding.keyword(),
                "evidence": proof.evidence, "tried": proof.tried
            })
        };
        outcome.add_value("proofs", json!(self.proofs.iter().map(row).collect::<Vec<_>>()));
        outcome.add_value("stage", json!(self.stage.letter()));
        outcome.add_value("mock", json!(basis == PageBasis::Mock));
        outcome.add_value("page", json!(self.args.out.display().to_string()));
        outcome.add_line(describe_end(page, &self.args.out.display().to_string()));
        outcome
    }
}

/// Returns the line about the page, with what to do next.
fn describe_end(page: &ProofPage<'_>, file: &str) -> String {
    let stage = page.stage.letter();
    match page.basis() {
        PageBasis::Real if page.is_signable() => format!(
            "page: {file}; print it, sign it, and keep it with the cell's file; then store the signature with \
             `panelprep robot prove --stage {stage} --sign --out {file} --by NAME` and set signed_stage = \"{stage}\" \
             in [robot]"
        ),
        PageBasis::Real => format!("page: {file}. {}", page.describe_unproven()),
        PageBasis::Mock => format!("page: {file}; from a rehearsal on a mock controller, nothing to sign"),
        PageBasis::Unknown | PageBasis::Unconfirmed => {
            format!("page: {file}; no controller responded at the end: do not sign the page; run the command again")
        }
        PageBasis::OtherPrograms => format!(
            "page: {file}; the controller's programs changed during the tests: do not sign the page; accept the \
             programs (`panelprep doctor --kuka DIR --accept`), then run the command again"
        ),
    }
}

/// Runs a test of this program. The store is locked during the test, so that no other program of this cell uses the
/// controller.
fn run_attempt(files: &CellFiles, attempt: unattended::Attempt) -> Result<(Finding, String), Fault> {
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

/// Minimum length of the evidence, characters: the shortest text that can name a trace, a film or a figure.
const MIN_EVIDENCE_CHARS: usize = 3;

fn parse_observation(line: &str) -> (Finding, String) {
    let (word, evidence) = line.trim().split_once(' ').unwrap_or((line.trim(), ""));
    let evidence = evidence.trim();
    match word.to_ascii_lowercase().as_str() {
        "" => (Finding::Open, "not done".to_owned()),
        // Evidence that no person can look up afterwards is not accepted.
        "y" if evidence.chars().count() < MIN_EVIDENCE_CHARS => {
            (Finding::Open, "reported as expected, without evidence".to_owned())
        }
        "y" => (Finding::Proven, evidence.to_owned()),
        "n" => (Finding::Wrong, if evidence.is_empty() { "not as expected" } else { evidence }.to_owned()),
        _ => (Finding::Open, format!("the answer \"{}\" is neither y nor n", line.trim())),
    }
}

fn judgement(proofs: &[Proof], basis: PageBasis) -> Judgement {
    let of_basis = match basis {
        PageBasis::Real => None,
        PageBasis::Mock => {
            Some(("mock_controller", "a mock controller responded: its tests are not valid for a real controller"))
        }
        PageBasis::Unknown | PageBasis::Unconfirmed => {
            Some(("no_controller", "no controller responded at the end of the tests: their results are not valid"))
        }
        PageBasis::OtherPrograms => Some((
            "other_programs",
            "the controller's programs changed during the tests: their results are not valid",
        )),
    };
    let of_proofs = proofs.iter().filter(|proof| !proof.is_proven()).map(|proof| {
        let number = proof.assumption.number;
        let message = format!("assumption {number} is {}: {}", proof.finding.keyword(), proof.evidence);
        Reason::new(if proof.finding == Finding::Wrong { "assumption_wrong" } else { "assumption_open" }, message)
    });
    let is_wrong = of_basis.is_some() || proofs.iter().any(|proof| proof.finding == Finding::Wrong);
    let of_basis = of_basis.map(|(code, message)| Reason::new(code, message));
    let reasons: Vec<Reason> = of_basis.into_iter().chain(of_proofs).collect();
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
        for without in ["y", "y y", "y ok", "  ", "perhaps"] {
            assert_eq!(parse_observation(without).0, Finding::Open, "{without}");
        }
        assert_eq!(parse_observation("N stops at the second").0, Finding::Wrong);
    }

    #[test]
    fn each_stage_is_proven_in_its_mode() {
        let modes = [Mode::T1, Mode::T2, Mode::Automatic, Mode::External];
        for (stage, expected) in [
            (ProofStage::A, [true, false, false, false]),
            (ProofStage::B, [false, false, true, true]),
            (ProofStage::C, [false, false, true, true]),
        ] {
            assert_eq!(modes.map(|mode| is_mode_of(stage, mode)), expected, "{stage:?}");
        }
    }

    /// A run without tests, with an open test, or without a confirmed controller at its end is not accepted.
    #[test]
    fn only_proven_rows_on_a_confirmed_controller_are_accepted() {
        let row = assumptions(INSTALLATION).remove(0);
        let proven = Proof { finding: Finding::Proven, evidence: "trace 1".to_owned(), ..Proof::open(row.clone()) };
        assert_eq!(judgement(std::slice::from_ref(&proven), PageBasis::Real).verdict, Verdict::Accept);
        assert_eq!(judgement(&[proven.clone(), Proof::open(row)], PageBasis::Real).verdict, Verdict::Review);
        for basis in [PageBasis::Mock, PageBasis::Unknown, PageBasis::Unconfirmed, PageBasis::OtherPrograms] {
            assert_eq!(judgement(std::slice::from_ref(&proven), basis).verdict, Verdict::Reject, "{basis:?}");
        }
    }
}
