//! The data of an entry for people: poses and findings, as text. None of it is read back.

use super::entry::Entry;
use super::topic::Topic;
use super::well_known::LogLevel;
use panelprep_base::geometry::{Base, Flange, KukaPose, PinholeCamera, Rigid, Tool};
use panelprep_base::verdict::Verdict;
use panelprep_cell::record::Finding;
use panelprep_kuka::eki::{Report, State};
use serde::Deserialize;

/// The pose of one frame in another, mm and degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FramePose {
    /// The frame of reference: `base`, `flange`.
    pub parent: &'static str,
    /// The frame.
    pub child: &'static str,
    /// Pose of the child frame in the parent frame.
    pub pose: KukaPose,
}

/// A camera's lens, and the topic and frame of its pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// [`Topic::ScannerLens`] or [`Topic::FlangeLens`].
    pub topic: Topic,
    /// The calibrated camera.
    pub camera: PinholeCamera,
}

impl Lens {
    /// The frame of the lens's pictures and points.
    pub(super) fn frame(&self) -> &'static str {
        if self.topic == Topic::FlangeLens { FLANGE_FRAME } else { SCANNER_FRAME }
    }
}

/// Name of the frame of the 3D camera's pictures; the next constant is the name for the flange camera's pictures.
pub(super) const SCANNER_FRAME: &str = "scanner";
pub(super) const FLANGE_FRAME: &str = "flange_camera";

/// The text at the beginning of each recording.
pub(super) const UNITS: &str = "all lengths in this recording are mm: a viewer that reads them as metres shows the \
                                scene 1000 times too large";

/// Form in which an entry is shown.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ShownText {
    Status(FramePose),
    Note { level: LogLevel, message: String },
}

pub(super) fn entry_texts(entry: &Entry) -> Vec<ShownText> {
    match entry.topic {
        Topic::Report => {
            Report::deserialize(&entry.reply).map_or_else(|_| Vec::new(), |report| robot_texts(&report))
        }
        Topic::Finding => {
            Finding::deserialize(&entry.action).map_or_else(|_| Vec::new(), |finding| finding_texts(&finding))
        }
        _ => Vec::new(),
    }
}

fn robot_texts(report: &Report) -> Vec<ShownText> {
    match report {
        Report::Connected { state } | Report::State(state) | Report::Rebooted { state } => vec![flange(state)],
        Report::LinkLost { why } => vec![ShownText::Note { level: LogLevel::Warning, message: why.to_string() }],
        _ => Vec::new(),
    }
}

fn flange(state: &State) -> ShownText {
    let base: Rigid<Base, Base> = state.active_base.to_rigid();
    let tip: Rigid<Base, Tool> = state.base_from_tcp.to_rigid();
    let tool: Rigid<Flange, Tool> = state.flange_from_tool.to_rigid();
    let pose = KukaPose::from_rigid(&(base * tip * tool.inverse()));
    ShownText::Status(FramePose { parent: "base", child: "flange", pose })
}

fn finding_texts(finding: &Finding) -> Vec<ShownText> {
    let judgement = &finding.judgement;
    let level = match judgement.verdict {
        Verdict::Accept | Verdict::Pass => LogLevel::Info,
        _ => LogLevel::Warning,
    };
    let reasons = judgement.reasons.iter().map(|reason| format!("; {}", reason.message));
    let message =
        format!("{}: {}{}", finding.kind.keyword(), judgement.verdict.keyword(), reasons.collect::<String>());
    let place = finding.details.get("base_from_panel").and_then(|pose| KukaPose::deserialize(pose).ok());
    let stands = place.map(|pose| ShownText::Status(FramePose { parent: "base", child: "panel", pose }));
    std::iter::once(ShownText::Note { level, message }).chain(stands).collect()
}
