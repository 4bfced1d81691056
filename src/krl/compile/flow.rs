//! What a routine may read before it was assigned, and whether a function can end without RETURN.
//!
//! A variable counts as assigned where every way to the place has assigned it or a part of it. What is handed to a
//! routine as a variable counts as assigned by it; EthernetKRL's readers want a variable that holds a value already.

use super::super::syntax::{Action, Call, Declared, Expression, Routine, Statement, Step, VariableRef};
use super::super::system::{BUILTINS, Wants};
use super::compiler::{Compiler, Signature};
use std::collections::BTreeSet;

/// The names that are assigned; `None` where this place is never reached.
type Assigned = Option<BTreeSet<String>>;

struct Flow<'a, 'b> {
    compiler: &'a mut Compiler<'b>,
    locals: BTreeSet<String>,
    told: BTreeSet<String>,
    /// What holds where an EXIT leaves a loop.
    exits: Vec<Vec<BTreeSet<String>>>,
}

pub(super) fn check(compiler: &mut Compiler<'_>, routine: &Routine, signature: &Signature) {
    let mut locals = BTreeSet::new();
    for declaration in &routine.declarations {
        if let Declared::Variables { items, .. } = &declaration.kind {
            locals.extend(items.iter().map(|item| item.name.clone()));
        }
    }
    for argument in &signature.arguments {
        locals.remove(&argument.name);
    }
    let mut flow = Flow { compiler, locals, told: BTreeSet::new(), exits: Vec::new() };
    let ends = flow.block(&routine.body, Some(BTreeSet::new()));
    if ends.is_some() && signature.returns.is_some() {
        compiler.line = routine.end_line;
        compiler.problem(&routine.name, "a way through this function ends without RETURN");
    }
}

impl Flow<'_, '_> {
    fn block(&mut self, statements: &[Statement], mut before: Assigned) -> Assigned {
        for statement in statements {
            self.compiler.line = statement.line;
            before = self.statement(statement, before);
        }
        before
    }

    fn statement(&mut self, statement: &Statement, before: Assigned) -> Assigned {
        let mut now = before?;
        match &statement.action {
            Action::Assign { to, value } => {
                self.read(value, &mut now);
                self.read_indices(to, &mut now);
                now.insert(to.name.clone());
            }
            Action::Call(call) => self.call(call, &mut now),
            Action::If { condition, then, otherwise } => {
                self.read(condition, &mut now);
                let one = self.block(then, Some(now.clone()));
                let other = self.block(otherwise, Some(now));
                return both(one, other);
            }
            Action::Switch { on, cases, default } => {
                self.read(on, &mut now);
                let mut after = match default {
                    Some(default) => self.block(default, Some(now.clone())),
                    None => Some(now.clone()),
                };
                for case in cases {
                    let of_case = self.block(&case.body, Some(now.clone()));
                    after = both(after, of_case);
                }
                return after;
            }
            Action::For { variable, from, to, step, body } => {
                for value in [Some(from), Some(to), step.as_ref()].into_iter().flatten() {
                    self.read(value, &mut now);
                }
                now.insert(variable.name.clone());
                return self.looped(body, now, true);
            }
            Action::While { condition, body } => {
                self.read(condition, &mut now);
                return self.looped(body, now, true);
            }
            Action::Loop { body } => return self.looped(body, now, false),
            Action::Repeat { body, until, .. } => {
                self.exits.push(Vec::new());
                let mut after = self.block(body, Some(now));
                if let Some(after) = &mut after {
                    self.read(until, after);
                }
                let exits = self.exits.pop().unwrap_or_default();
                return exits.into_iter().fold(after, |after, exit| both(after, Some(exit)));
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
            Action::Trigger { distance, delay, action, priority } => {
                for value in [Some(distance), Some(delay), priority.as_ref()].into_iter().flatten() {
                    self.read(value, &mut now);
                }
                return self.statement(action, Some(now));
            }
            Action::Motion { target: value, .. } | Action::WaitSeconds(value) | Action::WaitFor(value) => {
                self.read(value, &mut now);
            }
            Action::InterruptSwitch { number, .. } => number.iter().for_each(|number| self.read(number, &mut now)),
            Action::Brake { .. } | Action::Halt | Action::Continue => {}
        }
        Some(now)
    }

    /// `may_skip` where the body may be left out, and the loop ends by itself.
    fn looped(&mut self, body: &[Statement], now: BTreeSet<String>, may_skip: bool) -> Assigned {
        self.exits.push(Vec::new());
        self.block(body, Some(now.clone()));
        let exits = self.exits.pop().unwrap_or_default();
        let after = may_skip.then_some(now);
        exits.into_iter().fold(after, |after, exit| both(after, Some(exit)))
    }

    fn read(&mut self, value: &Expression, now: &mut BTreeSet<String>) {
        match value {
            Expression::Variable(place) => {
                self.read_indices(place, now);
                self.want(&place.name, now);
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

    fn want(&mut self, name: &str, now: &BTreeSet<String>) {
        if self.locals.contains(name) && !now.contains(name) && self.told.insert(name.to_owned()) {
            self.compiler.problem(name, "this local variable may be read here before it was given a value");
        }
    }

    fn read_indices(&mut self, place: &VariableRef, now: &mut BTreeSet<String>) {
        for step in &place.steps {
            if let Step::Index(indices) = step {
                indices.iter().for_each(|index| self.read(index, now));
            }
        }
    }

    fn call(&mut self, call: &Call, now: &mut BTreeSet<String>) {
        let routine = self.compiler.routines.iter().find(|known| known.name == call.name);
        let by_value: Option<Vec<bool>> =
            routine.map(|routine| routine.arguments.iter().map(|argument| argument.by_value).collect());
        let wants = BUILTINS.iter().find(|(name, ..)| *name == call.name).map(|(_, _, wants, _)| *wants);
        for (index, argument) in call.arguments.iter().enumerate() {
            let is_written = match (&by_value, wants) {
                (Some(by_value), _) => by_value.get(index) == Some(&false),
                (None, Some(wants)) => matches!(wants.get(index), Some(Wants::Variable(_))),
                (None, None) => true,
            };
            match argument {
                Expression::Variable(place) if is_written => {
                    self.read_indices(place, now);
                    now.insert(place.name.clone());
                }
                _ => self.read(argument, now),
            }
        }
    }
}

/// What is assigned on both ways that meet here.
fn both(one: Assigned, other: Assigned) -> Assigned {
    match (one, other) {
        (Some(one), Some(other)) => Some(one.intersection(&other).cloned().collect()),
        (one, other) => one.or(other),
    }
}
