//! The page of proofs to sign.

use super::super::calibrate::now_unix_s;
use super::proof::{Finding, Proof};
use super::unattended::ControllerKind;
use crate::cell::Robot;
use crate::number_text::utc;
use maud::{DOCTYPE, PreEscaped, html};

const STYLE: &str = "body{font:14px/1.4 sans-serif;max-width:1100px;margin:2em auto}table{border-collapse:collapse;width:100%}\
td,th{border:1px solid #999;padding:4px 6px;text-align:left;vertical-align:top}\
.wrong{border-left:.6em solid #d55e00}.open{border-left:.6em solid #e69f00}.proven{border-left:.6em solid #009e73}.sign{margin-top:3em}";

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
                    (utc(now_unix_s())) ". By " (by) "."
                }
                p {
                    (count(Finding::Proven)) " proven, " (count(Finding::Wrong)) " wrong, " (count(Finding::Open))
                    " open. While any assumption is wrong or open, keep the robot in T1, the sanding tool without power and the \
                     panel out of reach."
                }
                table {
                    tr { @for head in ["#", "Assumption", "Do, and expect", "Found", "Evidence", "Seen by"] { th { (head) } } }
                    @for Proof { assumption, finding, evidence, tried } in proofs {
                        tr class=(finding.word()) {
                            td { (assumption.number) }
                            td { (assumption.assumed) }
                            td { (assumption.to_do) }
                            td { (finding.word()) }
                            td { (evidence) }
                            td { @if *tried { "this program" } @else { (by) } }
                        }
                    }
                }
                @if controller == ControllerKind::Real {
                    p.sign { "Date, name, signature: ____________________________________________________" }
                }
            }
        }
    };
    page.into_string() + "\n"
}
