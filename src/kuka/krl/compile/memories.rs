//! Warns if a memory of EthernetKRL is read directly after it was cleared: EKI_Get does not wait, and would find the
//! memory empty.
//!
//! The check examines one block, statement by statement. It ends at any statement that may wait, or that is not known.

use super::super::routines::Builtin::{EkiCheckBuffer, EkiClear, EkiClearBuffer, EkiClose};
use super::super::routines::{Builtin, find_routine};
use super::super::syntax::{Action, Call, Expression, Statement};
use super::compiler::Compiler;

/// A memory, or a whole channel, that was cleared.
struct ClearedMemory<'a> {
    channel: &'a str,
    tag: Option<&'a str>,
    by: &'a str,
    line: usize,
}

impl Compiler<'_> {
    pub(super) fn check_memories(&mut self, body: &[Statement]) {
        let mut cleared: Vec<ClearedMemory<'_>> = Vec::new();
        for statement in body {
            match &statement.action {
                Action::Assign { value: Expression::Call(call), .. } | Action::Call(call) => {
                    self.check_call(call, statement.line, &mut cleared);
                }
                // A plain assignment takes almost no time.
                Action::Assign { value, .. } if !calls(value) => {}
                action => {
                    cleared.clear();
                    action.statement_blocks().into_iter().for_each(|block| self.check_memories(block));
                }
            }
        }
    }

    fn check_call<'a>(&mut self, call: &'a Call, line: usize, cleared: &mut Vec<ClearedMemory<'a>>) {
        let text = |place: usize| match call.arguments.get(place) {
            Some(Some(Expression::Text(text))) => Some(text.as_str()),
            _ => None,
        };
        let builtin = find_routine(&call.name).and_then(|known| known.builtin);
        let reads = call.name.starts_with("EKI_GET");
        match (builtin, text(0)) {
            (Some(EkiClear | EkiClose), Some(channel)) => {
                cleared.push(ClearedMemory { channel, tag: None, by: &call.name, line });
            }
            (Some(EkiClearBuffer), Some(channel)) if text(1).is_some() => {
                cleared.push(ClearedMemory { channel, tag: text(1), by: &call.name, line });
            }
            (_, Some(channel)) if reads => {
                let tag = text(1).unwrap_or_default();
                let found =
                    cleared.iter().find(|cleared| cleared.channel == channel && is_part_of_tag(tag, cleared.tag));
                if let Some(ClearedMemory { by, line: cleared_at, .. }) = found {
                    self.line = line;
                    let message = format!(
                        "{by} (line {cleared_at}) emptied the memory that is read here, and the program does not wait \
                         for new data in between: wait for the flag of the element, or call EKI_CheckBuffer"
                    );
                    self.problem(&call.name, message);
                }
            }
            (Some(builtin), _) if is_instant(builtin) => {}
            _ => cleared.clear(),
        }
    }
}

/// Returns whether a memory is still empty after this routine: not after EKI_CheckBuffer, which reports whether
/// something has arrived, and not after routines that open or send, which need time.
fn is_instant(builtin: Builtin) -> bool {
    use Builtin::{
        Bas, Cwrite, EkiCheck, EkiClear, EkiClearBuffer, EkiInit, EkiLock, EkiOpen, EkiSend, EkiUnlock, IrStopm,
    };
    !matches!(
        builtin,
        EkiCheckBuffer
            | EkiOpen
            | EkiInit
            | EkiSend
            | EkiLock
            | EkiUnlock
            | EkiCheck
            | EkiClear
            | EkiClearBuffer
            | Bas
            | Cwrite
            | IrStopm
    )
}

/// Returns whether a tag is the cleared tag, or a part of the cleared tag.
fn is_part_of_tag(tag: &str, cleared: Option<&str>) -> bool {
    cleared.is_none_or(|cleared| {
        tag.strip_prefix(cleared).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    })
}

fn calls(value: &Expression) -> bool {
    match value {
        Expression::Call(_) => true,
        Expression::Unary(_, inner) => calls(inner),
        Expression::Binary(_, left, right) => calls(left) || calls(right),
        Expression::Aggregate { parts, .. } => parts.iter().any(|(_, value)| calls(value)),
        _ => false,
    }
}
