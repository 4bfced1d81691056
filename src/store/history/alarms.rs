//! The alarms of a cycle: which alarms were raised and when, when their cause disappeared, and who acknowledged them.
//!
//! A reason in a finding raises an alarm, which lasts until the same phase gives a finding without this reason. Alarms
//! for the reasons of the verdict last until a person resets or clears the cell, or until the next cycle begins; all
//! other alarms end with the cycle. The alarm for a refused request ends immediately. An acknowledgement changes
//! neither the alarm nor the cell.

use super::codes::{Priority, code};
use panelprep_base::verdict::Reason;
use panelprep_cell::record::{Answer, CycleId, CycleRecord, Kind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// An alarm with its times.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alarm {
    /// The cycle of the alarm; `None` for an alarm between cycles.
    pub cycle: Option<CycleId>,
    /// The alarm's code, such as `low_overlap`.
    pub code: String,
    /// Urgency of the alarm.
    pub priority: Priority,
    /// The message of the last finding with this code.
    pub message: String,
    /// The meaning of the code; empty if the table of codes does not contain the code.
    pub cause: String,
    /// What to do; empty if the table of codes does not contain the code.
    pub remedy: String,
    /// The phase that raised the alarm; `None` for a refused request, and for a reason that only the verdict contains.
    pub phase: Option<Kind>,
    /// Time at which the alarm was raised, ms since 1970.
    pub raised_unix_ms: i64,
    /// Time at which the cause disappeared, ms since 1970; `None` while the alarm is active.
    pub gone_unix_ms: Option<i64>,
    /// The first acknowledgement, if there is one.
    pub acknowledged: Option<Acknowledgement>,
}

/// Times that are not part of the cycle's record.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AlarmTimes {
    /// Time at which each finding was stored, ms since 1970, in their order.
    pub findings_unix_ms: Vec<i64>,
    /// Time at which a person first reset or cleared the cell after the end, or the next cycle began, ms since 1970;
    /// `None` if neither has happened yet.
    pub settled_unix_ms: Option<i64>,
}

/// The acknowledgement of an alarm by a person.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Acknowledgement {
    /// Time at which the alarm was acknowledged, ms since 1970.
    pub unix_ms: i64,
    /// The cycle of the alarm; `None` for an alarm between cycles.
    pub cycle: Option<CycleId>,
    /// The alarm's code, such as `low_overlap`.
    pub code: String,
    /// Time at which the alarm was raised, ms since 1970. If the same code is raised again, it is another alarm.
    pub raised_unix_ms: i64,
    /// The name of the person, as recorded at that time.
    pub who: String,
}

impl Alarm {
    /// Returns whether the alarm is active.
    pub fn is_active(&self) -> bool {
        self.gone_unix_ms.is_none()
    }

    /// Creates an active alarm that was raised at this time, between cycles.
    pub fn new_between_cycles(reason: &Reason, raised_unix_ms: i64) -> Self {
        Self::new(None, reason, None, raised_unix_ms)
    }

    fn new(cycle: Option<CycleId>, reason: &Reason, phase: Option<Kind>, raised_unix_ms: i64) -> Self {
        let known = code(&reason.code);
        Alarm {
            cycle,
            code: reason.code.clone().into_owned(),
            // An unknown code gets medium priority, so that it is not overlooked.
            priority: known.map_or(Priority::Medium, |known| known.priority),
            message: reason.message.clone(),
            cause: known.map_or(String::new(), |known| known.cause.clone().into_owned()),
            remedy: known.map_or(String::new(), |known| known.remedy.clone().into_owned()),
            phase,
            raised_unix_ms,
            gone_unix_ms: None,
            acknowledged: None,
        }
    }
}

/// Returns the alarms of a cycle in the order in which they were raised.
pub fn alarms(record: &CycleRecord, times: &AlarmTimes, acknowledgements: &[Acknowledgement]) -> Vec<Alarm> {
    let mut all = alarms_from_findings(record, times);
    end_alarms(record, times, &mut all);
    all.extend(refused_requests(record));
    all.sort_by_key(|alarm| alarm.raised_unix_ms);
    for alarm in &mut all {
        let is_meant = |one: &&Acknowledgement| {
            one.cycle == alarm.cycle && one.code == alarm.code && one.raised_unix_ms == alarm.raised_unix_ms
        };
        alarm.acknowledged = acknowledgements.iter().find(is_meant).cloned();
    }
    all
}

fn alarms_from_findings(record: &CycleRecord, times: &AlarmTimes) -> Vec<Alarm> {
    let mut all: Vec<Alarm> = Vec::new();
    for (finding, &at) in record.findings.iter().zip(&times.findings_unix_ms) {
        let given = |alarm: &Alarm| finding.judgement.reasons.iter().any(|reason| reason.code == alarm.code);
        let lasting = |alarm: &&mut Alarm| alarm.phase == Some(finding.kind) && alarm.is_active();
        for alarm in all.iter_mut().filter(lasting).filter(|alarm| !given(alarm)) {
            alarm.gone_unix_ms = Some(at);
        }
        // Each code has one alarm, with the message of the first reason with this code.
        let mut spoken = BTreeSet::new();
        for reason in finding.judgement.reasons.iter().filter(|reason| spoken.insert(&reason.code)) {
            let raised = all
                .iter_mut()
                .find(|alarm| alarm.is_active() && alarm.phase == Some(finding.kind) && alarm.code == reason.code);
            match raised {
                // The alarm stays active, but the place that its message names may have changed.
                Some(alarm) => alarm.message.clone_from(&reason.message),
                None => all.push(Alarm::new(Some(record.id), reason, Some(finding.kind), at)),
            }
        }
    }
    all
}

/// Applies the end of the cycle: alarms for the reasons of the verdict stay active, all others end.
fn end_alarms(record: &CycleRecord, times: &AlarmTimes, all: &mut Vec<Alarm>) {
    let (Some(judgement), Some(ended_unix_s)) = (&record.judgement, record.ended_unix_s) else { return };
    let ended_unix_ms = ended_unix_s * 1_000;
    for reason in &judgement.reasons {
        if !all.iter().any(|alarm| alarm.is_active() && alarm.code == reason.code) {
            all.push(Alarm::new(Some(record.id), reason, None, ended_unix_ms));
        }
    }
    for alarm in all.iter_mut().filter(|alarm| alarm.is_active()) {
        let lasts = judgement.reasons.iter().any(|reason| reason.code == alarm.code);
        // The end of the cycle is stored in whole seconds, and an alarm may have been raised later in the same second.
        let gone = if lasts { times.settled_unix_ms } else { Some(ended_unix_ms) };
        alarm.gone_unix_ms = gone.map(|gone| gone.max(alarm.raised_unix_ms));
    }
}

fn refused_requests(record: &CycleRecord) -> impl Iterator<Item = Alarm> {
    let refused =
        record.asked.iter().filter(|asked| matches!(asked.answer, Some(Answer::Refused | Answer::Failed)));
    refused.flat_map(|asked| {
        asked.reasons.iter().map(|reason| Alarm {
            gone_unix_ms: Some(asked.unix_ms),
            ..Alarm::new(Some(record.id), reason, None, asked.unix_ms)
        })
    })
}
