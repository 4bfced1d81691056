//! Converts the result of a phase to a reply for the state table and to a finding for the record.

use super::error::DaemonError;
use super::ports::{CameraFault, Figure, Record};
use crate::stages::{ResultDrawing, not_executed_finding, rejected};
use panelprep_base::geometry::ColorPicture;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Answer, Grade, Trouble};
use panelprep_cell::record::Kind;

/// The reply if the result of an earlier action is required but missing.
pub(super) const MISSING: Answer = Answer::Failed(Trouble::Unexpected);

/// Returns a drawing for the record. No decision depends on the drawing: if it cannot be drawn, the picture `bare` is
/// recorded instead.
pub(super) fn figure(drawing: ResultDrawing, bare: &ColorPicture) -> Figure {
    let ResultDrawing { name, caption, picture } = drawing;
    match picture {
        Ok(picture) => Figure { name, caption, picture },
        Err(error) => {
            let caption = format!("{caption}; the overlay could not be drawn: {error}");
            Figure { name, caption, picture: bare.clone() }
        }
    }
}

/// Returns a drawing on an empty background, without a picture.
pub(super) fn figure_without_picture(drawing: ResultDrawing) -> Figure {
    figure(drawing, &ColorPicture::uniform(1, 1, [245; 3]))
}

/// Converts the judgement of a check to a grade for the state table.
pub(super) fn grade_judgement(judgement: &Judgement) -> Grade {
    match judgement.verdict {
        Verdict::Accept => Grade::Accept,
        Verdict::Review => Grade::Review,
        _ => Grade::Reject,
    }
}

pub(super) fn reason(code: &'static str, error: &dyn std::error::Error) -> Reason {
    Reason::new(code, error.to_string())
}

pub(super) fn camera_fault_answer(
    kind: Kind,
    pass: u8,
    error: &CameraFault,
    record: &mut dyn Record,
) -> Result<Answer, DaemonError> {
    record.finding(&not_executed_finding(kind, pass, reason("no_picture", error)))?;
    Ok(Answer::Failed(Trouble::Camera))
}

/// Records a picture that cannot be evaluated, and returns the reply. A picture after the scan rejects the panel. A
/// picture before contact or in a film requires a person to check the panel.
pub(super) fn unusable_picture_answer(
    kind: Kind,
    pass: u8,
    reason: Reason,
    record: &mut dyn Record,
) -> Result<Answer, DaemonError> {
    let found =
        if kind == Kind::Refine { rejected(kind, pass, reason) } else { not_executed_finding(kind, pass, reason) };
    record.finding(&found)?;
    let of_film = kind == Kind::Inspect;
    Ok(if of_film { Answer::Failed(Trouble::Picture) } else { Answer::Graded(Grade::Reject) })
}
