//! Warnings about the control flow of a routine: local variables that may be read before they are assigned, functions
//! that may end without RETURN, and EthernetKRL buffers that are read directly after they were cleared. They are
//! warnings, because it is not known which paths the conditions exclude.
//!
//! A variable is treated as assigned if every path to this point assigns it, completely or in part. If a variable is
//! passed to a routine by reference, the routine is assumed to assign it; but EthernetKRL's read functions need a
//! variable that already has a value. A routine with labels is not checked, because GOTO can lead to a label from any
//! line.
//!
//! EKI_Get does not wait: directly after a buffer was cleared, it finds the buffer empty. This check examines one
//! block, statement by statement. It ends at a statement that may wait, or that is not supported.

use super::super::routines::Builtin::{EkiCheckBuffer, EkiClear, EkiClearBuffer, EkiClose};
use super::super::routines::{ArgumentPassing, Builtin, find_routine};
use super::super::syntax::{
    Action, Call, DeclarationContent, Expression, MotionStatement, Routine, Statement, Step, TriggerPlace,
    VariableRef,
};
use super::compiler::{Compiler, Signature};
use std::collections::BTreeMap;

/// The local variables that are assigned at one point of the program, by their indices; `None` if the point is never
/// reached.
type AssignedVariables = Option<VariableSet>;

/// A set of local variables, as a bit set.
#[derive(Debug, Clone, Default)]
struct VariableSet(Vec<u64>);

impl VariableSet {
    fn insert(&mut self, number: usize) {
        let word = number / 64;
        if self.0.len() <= word {
            self.0.resize(word + 1, 0);
        }
        self.0[word] |= 1 << (number % 64);
    }

    fn contains(&self, number: usize) -> bool {
        self.0.get(number / 64).is_some_and(|word| word >> (number % 64) & 1 == 1)
    }

    fn intersection(mut self, other: &VariableSet) -> VariableSet {
        self.0.truncate(other.0.len());
        self.0.iter_mut().zip(&other.0).for_each(|(one, other)| *one &= other);
        self
    }
}

struct FlowAnalysis<'a, 'b> {
    compiler: &'a mut Compiler<'b>,
    locals: BTreeMap<&'a str, usize>,
    reported: VariableSet,
    /// For each open loop, the variables that are assigned at each of its EXIT statements.
    exits: Vec<Vec<VariableSet>>,
}

pub(super) fn check_assignments(compiler: &mut Compiler<'_>, routine: &Routine, signature: &Signature) {
    // With GOTO any line may follow any other, so the check would report variables that are in fact assigned.
    if has_labels(&routine.body) {
        return;
    }
    let mut locals = BTreeMap::new();
    for declaration in &routine.declarations {
        if let DeclarationContent::Variables { items, .. } = &declaration.kind {
            for item in items.iter().filter(|item| item.value.is_none()) {
                let number = locals.len();
                locals.entry(item.name.as_str()).or_insert(number);
            }
        }
    }
    for argument in &signature.arguments {
        locals.remove(argument.name.as_str());
    }
    let mut flow = FlowAnalysis { compiler, locals, reported: VariableSet::default(), exits: Vec::new() };
    let ends = flow.block(&routine.body, Some(VariableSet::default()));
    if ends.is_some() && signature.returns.is_some() {
        compiler.line = routine.end_line;
        compiler.warn(&routine.name, "a path through this function may end without RETURN");
    }
}

fn has_labels(body: &[Statement]) -> bool {
    body.iter().any(|statement| {
        matches!(statement.action, Action::Label(_) | Action::Goto(_))
            || statement.action.statement_blocks().into_iter().any(has_labels)
    })
}

impl FlowAnalysis<'_, '_> {
    fn block(&mut self, statements: &[Statement], mut before: AssignedVariables) -> AssignedVariables {
        for statement in statements {
            self.compiler.line = statement.line;
            before = self.statement(statement, before);
        }
        before
    }

    fn statement(&mut self, statement: &Statement, before: AssignedVariables) -> AssignedVariables {
        let mut now = before?;
        match &statement.action {
            Action::Assign { to, value } => {
                self.read(value, &mut now);
                self.assign(to, &mut now);
            }
            Action::Call(call) => self.call(call, &mut now),
            Action::If { condition, then, otherwise } => {
                self.read(condition, &mut now);
                let one = self.block(then, Some(now.clone()));
                let other = self.block(otherwise, Some(now));
                return assigned_on_both(one, other);
            }
            Action::Switch { on, cases, default } => {
                self.read(on, &mut now);
                let mut after = match default {
                    Some(default) => self.block(default, Some(now.clone())),
                    None => Some(now.clone()),
                };
                for case in cases {
                    let of_case = self.block(&case.body, Some(now.clone()));
                    after = assigned_on_both(after, of_case);
                }
                return after;
            }
            Action::For { variable, from, to, step, body } => {
                for value in [Some(from), Some(to), step.as_ref()].into_iter().flatten() {
                    self.read(value, &mut now);
                }
                self.assign(variable, &mut now);
                return self.analyse_loop(body, now, true);
            }
            Action::While { condition, body } => {
                self.read(condition, &mut now);
                return self.analyse_loop(body, now, true);
            }
            Action::Loop { body } => return self.analyse_loop(body, now, false),
            Action::Repeat { body, until, .. } => {
                self.exits.push(Vec::new());
                let mut after = self.block(body, Some(now));
                if let Some(after) = &mut after {
                    self.read(until, after);
                }
                let exits = self.exits.pop().unwrap_or_default();
                return exits.into_iter().fold(after, |after, exit| assigned_on_both(after, Some(exit)));
            }
            Action::Spline { with, body } => {
                self.settings(with, &mut now);
                return self.block(body, Some(now));
            }
            Action::Exit => {
                if let Some(exits) = self.exits.last_mut() {
                    exits.push(now);
                }
                return None;
            }
            Action::Return(value) => {
                value.iter().for_each(|value| self.read(value, &mut now));
                return None;
            }
            Action::Resume => return None,
            Action::InterruptDeclaration { number, condition, call, .. } => {
                self.read(number, &mut now);
                self.read(condition, &mut now);
                self.call(call, &mut now);
            }
            Action::Trigger { at, delay, action, priority } => {
                let (TriggerPlace::Distance(at) | TriggerPlace::Path(at)) = at;
                for value in [Some(at), delay.as_ref(), priority.as_ref()].into_iter().flatten() {
                    self.read(value, &mut now);
                }
                return self.statement(action, Some(now));
            }
            Action::Motion(motion) => self.motion(motion, &mut now),
            Action::WaitSeconds(value) | Action::WaitFor(value) => self.read(value, &mut now),
            Action::InterruptSwitch { number, .. } => {
                number.iter().for_each(|number| self.read(number, &mut now));
            }
            Action::Checked { values, .. } => values.iter().for_each(|(value, _)| self.read(value, &mut now)),
            // A statement that was not parsed may have assigned any variable.
            Action::NotRead => (0..self.locals.len()).for_each(|number| now.insert(number)),
            Action::Brake { .. } | Action::Halt | Action::Continue | Action::Label(_) | Action::Goto(_) => {}
        }
        Some(now)
    }

    fn motion(&mut self, motion: &MotionStatement, now: &mut VariableSet) {
        self.settings(&motion.with, now);
        let values = [motion.auxiliary.as_ref(), Some(&motion.target), motion.angle.as_ref()];
        values.into_iter().flatten().for_each(|value| self.read(value, now));
    }

    fn settings(&mut self, with: &[(VariableRef, Expression)], now: &mut VariableSet) {
        for (to, value) in with {
            self.read(value, now);
            self.assign(to, now);
        }
    }

    /// Analyses a loop. `may_skip` is true if the loop can end without EXIT, so that its body may not be executed at
    /// all.
    fn analyse_loop(&mut self, body: &[Statement], now: VariableSet, may_skip: bool) -> AssignedVariables {
        self.exits.push(Vec::new());
        self.block(body, Some(now.clone()));
        let exits = self.exits.pop().unwrap_or_default();
        // Assignments in the body are ignored after the loop, because the body may not be executed at all.
        let after = may_skip.then_some(now);
        exits.into_iter().fold(after, |after, exit| assigned_on_both(after, Some(exit)))
    }

    fn assign(&mut self, to: &VariableRef, now: &mut VariableSet) {
        self.analyse_indices(to, now);
        if let Some(number) = self.locals.get(to.name.as_str()) {
            now.insert(*number);
        }
    }

    fn read(&mut self, value: &Expression, now: &mut VariableSet) {
        match value {
            Expression::Variable(place) => {
                self.analyse_indices(place, now);
                self.require_assigned(&place.name, now);
            }
            Expression::Call(call) => self.call(call, now),
            Expression::Aggregate { parts, .. } => parts.iter().for_each(|(_, value)| self.read(value, now)),
            Expression::Unary(_, inner) => self.read(inner, now),
            Expression::Binary(_, left, right) => {
                self.read(left, now);
                self.read(right, now);
            }
            _ => {}
        }
    }

    fn require_assigned(&mut self, name: &str, now: &VariableSet) {
        let Some(number) = self.locals.get(name).copied() else { return };
        if !now.contains(number) && !self.reported.contains(number) {
            // Each variable is reported once, because its other uses have the same cause.
            self.reported.insert(number);
            self.compiler.warn(name, "this local variable may be read here before a value is assigned to it");
        }
    }

    fn analyse_indices(&mut self, place: &VariableRef, now: &mut VariableSet) {
        for step in &place.steps {
            if let Step::Index(indices) = step {
                indices.iter().flatten().for_each(|index| self.read(index, now));
            }
        }
    }

    fn call(&mut self, call: &Call, now: &mut VariableSet) {
        let routine = self.compiler.visible_routine(&call.name);
        let wants = find_routine(&call.name).map(|known| &known.argument_passing);
        for (index, argument) in call.arguments.iter().enumerate() {
            let Some(argument) = argument else { continue };
            let is_written = match (routine, wants) {
                (Some(routine), _) => {
                    let wanted = self.compiler.routines[routine].arguments.get(index);
                    wanted.is_some_and(|wanted| !wanted.by_value)
                }
                (None, Some(wants)) => {
                    !matches!(wants.get(index), Some(ArgumentPassing::Value(_) | ArgumentPassing::Filled(_)))
                }
                (None, None) => true,
            };
            match argument {
                Expression::Variable(place) if is_written => self.assign(place, now),
                _ => self.read(argument, now),
            }
        }
    }
}

/// Returns the variables that are assigned on both of two paths that join.
fn assigned_on_both(one: AssignedVariables, other: AssignedVariables) -> AssignedVariables {
    match (one, other) {
        (Some(one), Some(other)) => Some(one.intersection(&other)),
        (one, other) => one.or(other),
    }
}

/// The buffer of a tag, or of a whole channel, that was cleared.
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
                // An assignment without a call takes almost no time, so the buffer is still empty.
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

/// Returns whether a buffer is still empty after this routine. This is not the case after EKI_CheckBuffer, which
/// reports whether data has arrived, and after routines that open or send, which take time.
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

/// Returns whether a tag is the cleared tag or below it.
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
