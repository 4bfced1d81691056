//! The page to sign.

use super::super::calibrate::now_unix_s;
use super::{Finding, Proof};
use crate::cell::Robot;
use crate::report::{page::escaped, utc};
use std::fmt::Write;

const HEAD: &str = "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>Proven on the controller</title>\n<style>\
body{font:14px/1.4 sans-serif;max-width:1100px;margin:2em auto}table{border-collapse:collapse;width:100%}\
td,th{border:1px solid #999;padding:4px 6px;text-align:left;vertical-align:top}\
.wrong{border-left:.6em solid #d55e00}.open{border-left:.6em solid #e69f00}.proven{border-left:.6em solid #009e73}.sign{margin-top:3em}</style>\n";

/// All proofs, who did them, when, on which controller.
pub(super) fn of(proofs: &[Proof], by: &str, robot: &Robot) -> String {
    let count = |finding: Finding| proofs.iter().filter(|proof| proof.finding == finding).count();
    let mut page = HEAD.to_owned();
    // Writing into a text cannot fail.
    let _ = writeln!(
        page,
        "<h1>Proven on the controller</h1><p>Controller at {}, ports {} and {}. {}. By {}.</p>\n\
         <p>{} proven, {} wrong, {} open. While one is wrong or open, the robot stays in T1, the sanding tool without power and \
         the panel out of reach.</p>\n<table><tr><th>#<th>Assumption<th>Do, and expect<th>Found<th>Evidence<th>Seen by</tr>",
        escaped(robot.host()),
        robot.command_port(),
        robot.state_port(),
        utc(now_unix_s()),
        escaped(by),
        count(Finding::Proven),
        count(Finding::Wrong),
        count(Finding::Open)
    );
    for Proof { assumption, finding, evidence, tried } in proofs {
        let word = finding.word();
        let seen_by = if *tried { "this program".to_owned() } else { escaped(by) };
        let [assumed, to_do, evidence] =
            [&assumption.assumed, &assumption.to_do, evidence].map(|text| escaped(text));
        let number = assumption.number;
        let _ = writeln!(
            page,
            "<tr class=\"{word}\"><td>{number}<td>{assumed}<td>{to_do}<td>{word}<td>{evidence}<td>{seen_by}</tr>"
        );
    }
    page.push_str(
        "</table>\n<p class=\"sign\">Date, name, signature: ____________________________________________________</p>\n",
    );
    page
}
