//! What `panelprep identify`, `panelprep ctl start` and `panelprep teach` print about the panels that a scan may show.

use super::fault::Fault;
use super::output::Outcome;
use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::Recipe;
use panelprep_service::setup::{self, CellFiles, PanelProposal};
use panelprep_vision::locate::ScanView;
use panelprep_vision::locate::identify::{ComparedPanel, FoundPanel};
use serde_json::{Value, json};

/// Reports the proposed panel, and each panel with the evidence for it.
pub fn report(proposal: &PanelProposal) -> Outcome {
    let mut outcome = Outcome::from_judgement(&proposal.judgement);
    let identified = &proposal.identified;
    outcome.add_value("panel", json!(identified.best()));
    outcome.add_value("margin_mm", json!(identified.margin_mm()));
    if let Some(name) = identified.best() {
        outcome.add_line(format!("panel {name}"));
        let mut recipes = Vec::new();
        for recipe in &proposal.recipes {
            let (file, sha256) = (&recipe.name, recipe.sha256());
            outcome.add_line(format!("recipe {file}, SHA-256 {sha256}"));
            recipes.push(json!({"file": file, "sha256": sha256}));
        }
        outcome.add_value("recipes", json!(recipes));
    }
    identified.compared.iter().for_each(|compared| outcome.add_line(describe(compared)));
    outcome.add_value("panels", identified.compared.iter().map(to_json).collect());
    let unusable = proposal.unusable.iter().map(|panel| json!({"panel": panel.name, "cause": panel.cause}));
    outcome.add_value("not_compared", unusable.collect());
    outcome.add_value("elapsed_ms", json!(proposal.elapsed_ms));
    outcome
}

/// Describes the result for one panel, for a person.
fn describe(compared: &ComparedPanel) -> String {
    let result = match &compared.located {
        Ok(found) => describe_found(found),
        Err(error) => error.to_string(),
    };
    format!("  {}: {result}", compared.name)
}

fn describe_found(found: &FoundPanel) -> String {
    let fit = &found.fit;
    let number = |value: f64, decimals: usize| fixed_decimals(value, decimals).to_string();
    let seen = format!(
        "{} (outline {} mm, surface {} mm rms, bend {} mm; {} % of the outline and {} % of the surface found)",
        found.judgement.verdict.keyword(),
        number(fit.outline_rms_mm, 2),
        number(fit.rms_mm, 2),
        fit.deviation_mm.map_or_else(|| "unknown".to_owned(), |bend_mm| number(bend_mm, 2)),
        number(100.0 * fit.outline_found, 0),
        number(100.0 * fit.overlap(), 0)
    );
    let Some(difference) = found.difference else { return format!("the best, {seen}") };
    format!(
        "{seen}; where it differs from the best, {} mm support only the best, {} mm only this one, {} mm are not seen: {}",
        number(difference.for_first_mm, 0),
        number(difference.for_second_mm, 0),
        number(difference.unseen_mm, 0),
        found.distinction.map_or_else(
            || "not distinguished".to_owned(),
            |distinction| format!("distinguished by {}", <&str>::from(distinction))
        )
    )
}

/// Returns the result for one panel, for scripts.
fn to_json(compared: &ComparedPanel) -> Value {
    let mut object = match &compared.located {
        Err(error) => json!({"cause": error.to_string()}),
        Ok(found) => json!({
            "verdict": found.judgement.verdict,
            "reasons": found.judgement.reasons,
            "outline_rms_mm": found.fit.outline_rms_mm,
            "rms_mm": found.fit.rms_mm,
            "deviation_mm": found.fit.deviation_mm,
            "outline_found": found.fit.outline_found,
            "overlap": found.fit.overlap(),
            "contradiction_mm": found.contradiction_mm,
            "for_best_mm": found.difference.map(|difference| difference.for_first_mm),
            "for_this_mm": found.difference.map(|difference| difference.for_second_mm),
            "unseen_mm": found.difference.map(|difference| difference.unseen_mm),
            "distinguished_by": found.distinction.map(<&str>::from),
        }),
    };
    object["panel"] = json!(compared.name);
    object["is_undecided"] = json!(compared.is_undecided());
    object
}

/// Compares a panel that is taught, in its own scan, with the other panels of the store. Returns the warnings.
///
/// # Errors
/// If the store or the recipes' folder cannot be read.
pub fn report_alike_panels(
    taught: (&TaughtPanel, &Recipe),
    view: &ScanView<'_>,
    files: &CellFiles,
    outcome: &mut Outcome,
) -> Result<Vec<String>, Fault> {
    let setup::AlikePanels { compared, alike, unusable } = setup::find_alike_panels(taught, view, files)?;
    let unknown = unusable.iter().map(|other| {
        format!("it is not known whether a scan distinguishes this panel from \"{}\": {}", other.name, other.cause)
    });
    let warnings = unknown.chain(alike.iter().flatten().map(describe_alike)).collect();
    outcome.add_value("compared_panels", json!(compared));
    outcome.add_value("alike", json!(alike.ok().map(|alike| alike.iter().map(to_json).collect::<Vec<_>>())));
    Ok(warnings)
}

fn describe_alike(other: &ComparedPanel) -> String {
    let evidence = match &other.located {
        Err(error) => error.to_string(),
        Ok(found) => {
            let difference = found.difference.unwrap_or_default();
            let mm = |value: f64| fixed_decimals(value, 0);
            let bend = found.fit.deviation_mm.map_or_else(
                || "its bend is unknown".to_owned(),
                |mm| format!("a bend of {} mm makes one of the other", fixed_decimals(mm, 2)),
            );
            format!(
                "{} mm of outline and surface show only this panel, {} mm only the other, {} mm are not seen, and {bend}",
                mm(difference.for_first_mm),
                mm(difference.for_second_mm),
                mm(difference.unseen_mm)
            )
        }
    };
    format!(
        "a scan cannot distinguish this panel from \"{}\": {evidence}; `panelprep identify` will ask a person to decide",
        other.name
    )
}
