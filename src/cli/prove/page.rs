//! The page of proofs to sign.

use super::super::calibrate::now_unix_s;
use super::proof::{Finding, Proof};
use super::unattended::ControllerKind;
use crate::cell::{ProofStage, Robot};
use crate::number_text::utc_text;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = "body{font:14px/1.4 sans-serif;max-width:1100px;margin:2em auto}table{border-collapse:collapse;width:100%}\
td,th{border:1px solid #999;padding:4px 6px;text-align:left;vertical-align:top}\
.wrong{border-left:.6em solid #d55e00}.open{border-left:.6em solid #e69f00}.proven{border-left:.6em solid #009e73}.sign{margin-top:3em}";

/// Renders a stage, which is signed by itself: only if each of its rows is proven, on a real controller.
fn part(stage: ProofStage, proofs: &[&Proof], by: &str, controller: ControllerKind) -> Markup {
    let open = proofs.iter().filter(|proof| proof.finding != Finding::Proven).count();
    html! {
        h2 { "Stage " (stage.letter()) ": " (stage.conditions()) }
        table {
            tr {
                @for head in ["#", "Assumption", "Do", "See", "Otherwise", "Found", "Evidence", "Seen by"] { th { (head) } }
            }
            @for Proof { assumption, finding, evidence, tried } in proofs {
                tr class=(finding.keyword()) {
                    td { (assumption.number) }
                    td { (assumption.assumed) }
                    td { (assumption.to_do) }
                    td { (assumption.to_see) }
                    td { (assumption.otherwise) }
                    td { (finding.keyword()) }
                    td { (evidence) }
                    td { @if *tried { "this program" } @else { (by) } }
                }
            }
        }
        @if controller == ControllerKind::Real && open > 0 {
            p.sign { "Stage " (stage.letter()) " cannot be signed: " (open) " rows are wrong or open." }
        } @else if controller == ControllerKind::Real {
            p.sign {
                "Stage " (stage.letter()) " permits " (stage.permits()) ". Date, name, signature: \
                 ____________________________________________________"
            }
            p { "Then set signed_stage = \"" (stage.letter()) "\" in [robot] of the cell's file." }
        }
    }
}

/// Renders all proofs, with the person, the date and the controller.
///
/// For a mock controller, and for a controller that did not answer, nothing is proven, and the page cannot be
/// signed.
pub(super) fn render(proofs: &[Proof], by: &str, (robot, controller): (&Robot, ControllerKind)) -> String {
    let title = match controller {
        ControllerKind::Mock => "Rehearsed on a mock controller: proves nothing about a real controller",
        ControllerKind::Unknown => "No controller answered: proves nothing",
        ControllerKind::Real => "Proven on the controller",
    };
    let count = |finding: Finding| proofs.iter().filter(|proof| proof.finding == finding).count();
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
                    "Controller at " (robot.host()) ", ports " (robot.command_port()) " and " (robot.state_port()) ". "
                    (utc_text(now_unix_s())) ". By " (by) "."
                }
                p {
                    (count(Finding::Proven)) " proven, " (count(Finding::Wrong)) " wrong, " (count(Finding::Open))
                    " open. While any assumption is wrong or open, keep the robot in T1, the sanding tool without power and the \
                     panel out of reach."
                }
                @for stage in ProofStage::ALL {
                    @let of_stage: Vec<&Proof> = proofs.iter().filter(|proof| proof.assumption.stage == stage).collect();
                    @if !of_stage.is_empty() { (part(stage, &of_stage, by, controller)) }
                }
            }
        }
    };
    page.into_string() + "\n"
}
