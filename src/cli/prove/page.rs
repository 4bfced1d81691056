//! The page of the acceptance tests that is to be signed, and the signature of a page on which every test has passed.

use super::super::args::Prove;
use super::super::disk;
use super::super::fault::{DeviceFault, Fault};
use super::super::live::{ControllerKind, ReportedController};
use super::super::output::Outcome;
use super::table::{Finding, Proof};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use panelprep_base::number_text::utc_text;
use panelprep_base::verdict::Judgement;
use panelprep_cell::cell::{ProofStage, Robot};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::ProofsResult;
use panelprep_service::daemon::current_user;
use panelprep_service::setup::{CellFiles, clock::now_unix_s};
use panelprep_store::store::{ProofsPage, Store};
use serde_json::json;

const STYLE: &str = "body{font:14px/1.4 sans-serif;max-width:1100px;margin:2em auto}table{border-collapse:collapse;width:100%}\
td,th{border:1px solid #999;padding:4px 6px;text-align:left;vertical-align:top}\
.wrong{border-left:.6em solid #d55e00}.open{border-left:.6em solid #e69f00}.proven{border-left:.6em solid #009e73}.sign{margin-top:3em}";

/// The controller for which the results on a page are valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PageBasis {
    /// The same real controller, with the same programs, from the first test to the last.
    Real,
    /// A mock controller.
    Mock,
    /// The controller is not confirmed yet, because the run has not ended.
    Unconfirmed,
    /// No controller responded at the end of the run.
    Unknown,
    /// At the end of the run the controller reported other programs than at its start.
    OtherPrograms,
}

impl PageBasis {
    /// Determines for which controller the results are valid, from the controller's reports at the start of the run
    /// and, if it has ended, at its end.
    pub(super) fn from_reports(begin: &ReportedController, end: Option<&ReportedController>) -> Self {
        let is_mock = |controller: &ReportedController| controller.kind == ControllerKind::Mock;
        let Some(end) = end else {
            return if is_mock(begin) { PageBasis::Mock } else { PageBasis::Unconfirmed };
        };
        match (begin.kind, end.kind) {
            _ if is_mock(begin) || is_mock(end) => PageBasis::Mock,
            (ControllerKind::Real, ControllerKind::Real) if begin.programs_sum == end.programs_sum => {
                PageBasis::Real
            }
            (ControllerKind::Real, ControllerKind::Real) => PageBasis::OtherPrograms,
            _ => PageBasis::Unknown,
        }
    }

    /// Returns the title of the page.
    fn title(self) -> &'static str {
        match self {
            PageBasis::Real => "Tested on the controller",
            PageBasis::Mock => "Rehearsal with a mock controller: not valid for a real controller",
            PageBasis::Unconfirmed => "Not finished: the results are not valid yet",
            PageBasis::Unknown => "No controller responded at the end: the results are not valid",
            PageBasis::OtherPrograms => {
                "The controller's programs changed during the tests: the results are not valid"
            }
        }
    }
}

/// The page of a stage: its tests, and the data of the run.
pub(super) struct ProofPage<'p> {
    pub(super) stage: ProofStage,
    /// All tests of the stage; a test that was not run is open.
    pub(super) proofs: &'p [Proof],
    pub(super) by: &'p str,
    pub(super) robot: &'p Robot,
    /// The controller's reports at the start and at the end of the run.
    pub(super) reports: (ReportedController, Option<ReportedController>),
}

impl ProofPage<'_> {
    /// Returns the controller for which the results are valid.
    pub(super) fn basis(&self) -> PageBasis {
        PageBasis::from_reports(&self.reports.0, self.reports.1.as_ref())
    }

    /// Returns the number of tests that failed or are open.
    pub(super) fn failed_or_open_count(&self) -> usize {
        self.proofs.iter().filter(|proof| !proof.is_proven()).count()
    }

    /// Returns whether the page can be signed: every test has passed, on the same real controller.
    pub(super) fn is_signable(&self) -> bool {
        self.basis() == PageBasis::Real && !self.proofs.is_empty() && self.failed_or_open_count() == 0
    }

    /// Returns why the page of a real controller cannot be signed, and what this means for earlier signatures of the
    /// stage.
    pub(super) fn describe_unproven(&self) -> String {
        let letter = self.stage.letter();
        let remedy = match self.count(Finding::Wrong) {
            0 => String::new(),
            _ => format!(
                " Earlier signatures of stage {letter} and of the stages after it are no longer valid: test the stage \
                 again."
            ),
        };
        format!(
            "Stage {letter} cannot be signed: {} tests have failed or are open.{remedy}",
            self.failed_or_open_count()
        )
    }

    fn count(&self, finding: Finding) -> usize {
        self.proofs.iter().filter(|proof| proof.finding == finding).count()
    }

    /// Returns a text with the modes and the checksums that the controller reported.
    fn reported(&self) -> String {
        let words = |controller: &ReportedController| {
            let sum = controller.programs_sum.map_or("unknown".to_owned(), |sum| sum.to_string());
            let mode = controller.mode.map_or("unknown", |mode| mode.name());
            format!("mode {mode}, checksum of the programs {sum}")
        };
        let end = self.reports.1.as_ref().map_or("not reached".to_owned(), words);
        format!("Reported at the beginning: {}; at the end: {end}.", words(&self.reports.0))
    }

    fn rows(&self) -> Markup {
        html! {
            table {
                tr {
                    @for head in ["#", "Assumption", "Do", "See", "Otherwise", "Found", "Evidence", "Seen by"] { th { (head) } }
                }
                @for Proof { assumption, finding, evidence, tried } in self.proofs {
                    tr class=(finding.keyword()) {
                        td { (assumption.number) }
                        td { (assumption.assumed) }
                        td { (assumption.to_do) }
                        td { (assumption.to_see) }
                        td { (assumption.otherwise) }
                        td { (finding.keyword()) }
                        td { (evidence) }
                        td { @if *tried { "this program" } @else if *finding != Finding::Open { (self.by) } }
                    }
                }
            }
        }
    }

    /// Renders the field for the signature, or the reason why the page cannot be signed.
    fn end(&self) -> Markup {
        let letter = self.stage.letter();
        html! {
            @if self.is_signable() {
                p.sign {
                    "Stage " (letter) " permits " (self.stage.permits()) ". Date, name, signature: \
                                                                          ____________________________________________________"
                }
                p {
                    "Then store the signature with panelprep robot prove --stage " (letter) " --sign --out FILE --by \
                                                                                             NAME, and set \
                                                                                             signed_stage = \
                                                                                             \"" (letter) "\" in [robot] of the cell's file. This page must not be changed before."
                }
            } @else if self.basis() == PageBasis::Real {
                p.sign { (self.describe_unproven()) }
            }
        }
    }

    /// Renders the page as HTML: all tests, with the person, the date and the controller.
    ///
    /// It has a field for the signature only if the run has ended and every test has passed on the same real
    /// controller.
    pub(super) fn render(&self) -> String {
        let title = match self.basis() {
            PageBasis::Real if !self.is_signable() => "Tested on the controller: not passed",
            basis => basis.title(),
        };
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    title { (title) }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    h1 { (title) }
                    p {
                        "Controller at " (self.robot.host()) ", ports " (self.robot.command_port()) " and "
                        (self.robot.state_port()) ". " (utc_text(now_unix_s())) ". By " (self.by) ". " (self.reported())
                    }
                    p {
                        (self.count(Finding::Proven)) " proven, " (self.count(Finding::Wrong)) " wrong, "
                        (self.count(Finding::Open)) " open. While any assumption is wrong or open, keep the robot in \
                                                     T1, the sanding tool without power and the panel out of reach."
                    }
                    h2 { "Stage " (self.stage.letter()) ": " (self.stage.conditions()) }
                    (self.rows())
                    (self.end())
                }
            }
        };
        page.into_string() + "\n"
    }
}

/// Stores that a person signed the page, with the stage, the person, the date and the checksum of the programs.
///
/// # Errors
/// If the previous stage is not signed, the page is not the newest one on which every test has passed, the cell was
/// accepted with other programs, or the store cannot be read or written.
pub(super) fn sign(args: &Prove, files: &CellFiles) -> Result<Outcome, Fault> {
    let robot = files.cell.robot();
    let stage = args.stage.unwrap_or_else(|| ProofStage::after(robot.signed_stage()));
    if let Some(before) = stage.before().filter(|before| robot.signed_stage() < Some(*before)) {
        return Err(DeviceFault::ProvenTooEarly { stage, before }.into());
    }
    let page_sha256 = content_hash(&disk::read(&args.out)?);
    let pages = files.store()?.proofs().map_err(Fault::stage)?;
    let newest = pages.into_iter().find(|page| page.result != ProofsResult::Signed && page.stage == stage);
    let is_this = |page: &ProofsPage| page.result == ProofsResult::Proven && page.page_sha256 == page_sha256;
    let Some(proven) = newest.filter(is_this) else {
        return Err(DeviceFault::PageNotProven { page: args.out.clone(), stage }.into());
    };
    let (reported, accepted) = (proven.programs_sum, robot.programs_sum());
    if accepted != Some(reported) {
        return Err(DeviceFault::ProofsOfOtherPrograms { reported, accepted }.into());
    }
    let signature = ProofsPage { by: args.by.clone(), result: ProofsResult::Signed, ..proven };
    Store::store_proofs_in(files.store_folder(), &signature, current_user()).map_err(Fault::stage)?;
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    let letter = stage.letter();
    outcome.add_line(format!(
        "the signature of stage {letter} by {} is stored, for programs with the checksum {reported}; now set \
         signed_stage = \"{letter}\" in [robot] of the cell's file",
        args.by
    ));
    outcome.add_value("stage", json!(letter));
    outcome.add_value("programs_sum", json!(reported));
    outcome.add_value("page", json!(args.out.display().to_string()));
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::super::table::{INSTALLATION, assumptions};
    use super::*;
    use panelprep_cell::cell::Cell;
    use panelprep_kuka::eki::Mode;

    fn reported(kind: ControllerKind, sum: i32) -> ReportedController {
        ReportedController { kind, programs_sum: Some(sum), mode: Some(Mode::T1) }
    }

    fn proven(number: usize) -> Vec<Proof> {
        let rows = assumptions(INSTALLATION).into_iter().filter(|row| row.stage == ProofStage::A);
        let mut proofs: Vec<Proof> = rows.map(Proof::open).collect();
        for proof in proofs.iter_mut().take(number) {
            (proof.finding, proof.evidence) = (Finding::Proven, "trace 1".to_owned());
        }
        proofs
    }

    fn with_page<T>(
        proofs: &[Proof],
        end: Option<ReportedController>,
        read: impl FnOnce(&ProofPage<'_>) -> T,
    ) -> T {
        let cell = Cell::check("cell.toml", "[robot]\nkind = 'eki'\nhost = 'krc'").expect("good");
        let reports = (reported(ControllerKind::Real, 7), end);
        read(&ProofPage { stage: ProofStage::A, proofs, by: "Ada", robot: cell.robot(), reports })
    }

    fn is_signable(proofs: &[Proof], end: Option<ReportedController>) -> bool {
        with_page(proofs, end, |page| is_page_signable(page, proofs.len()))
    }

    fn is_page_signable(page: &ProofPage<'_>, rows: usize) -> bool {
        let text = page.render();
        assert_eq!(text.matches("<tr class=").count(), rows, "each row is on the page");
        assert_eq!(text.contains("name, signature"), page.is_signable());
        assert_eq!(text.contains("<h1>Tested on the controller</h1>"), page.is_signable());
        page.is_signable()
    }

    /// On the first page all tests are open. The page of a run that was interrupted, or whose end does not confirm the
    /// controller, has no field for a signature.
    #[test]
    fn only_a_whole_run_on_one_controller_can_be_signed() {
        let all = proven(usize::MAX);
        let end = Some(reported(ControllerKind::Real, 7));
        assert!(all.len() > 20 && is_signable(&all, end));
        assert!(!is_signable(&proven(0), end));
        assert!(!is_signable(&proven(all.len() - 1), end));
        assert!(!is_signable(&[], end), "no row proves nothing");
        for wrong in [
            None,
            Some(ReportedController::UNKNOWN),
            Some(reported(ControllerKind::Mock, 7)),
            Some(reported(ControllerKind::Real, 8)),
        ] {
            assert!(!is_signable(&all, wrong), "{wrong:?}");
        }
        // The page states that an earlier signature of the stage is no longer valid.
        let mut wrong = all.clone();
        wrong[0].finding = Finding::Wrong;
        let words = |proofs: &[Proof]| with_page(proofs, end, |page| page.describe_unproven());
        assert!(words(&wrong).ends_with("are no longer valid: test the stage again."), "{}", words(&wrong));
        assert!(words(&proven(0)).ends_with("tests have failed or are open."), "{}", words(&proven(0)));
        let mut empty = all;
        empty[0].evidence.clear();
        assert!(!is_signable(&empty, end), "without evidence");
    }
}
