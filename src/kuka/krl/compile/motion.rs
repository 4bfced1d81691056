//! Compiles motions, splines and triggers to steps.

use super::super::code::Op;
use super::super::syntax::{Action, Expression, MotionStatement, PathKind, Statement, TriggerPlace, VariableRef};
use super::super::types::Type;
use super::compiler::{Compiler, cells_u32};
use std::collections::BTreeMap;

impl Compiler<'_> {
    pub(super) fn motion(&mut self, motion: &MotionStatement) {
        let is_submit = self.files[self.file].name.to_lowercase().ends_with(".sub");
        if is_submit {
            self.problem(motion.word, "a submit program must not move the robot");
        }
        self.settings(&motion.with);
        if let Some(auxiliary) = &motion.auxiliary {
            self.target(PathKind::Line, auxiliary);
        }
        if let Some(angle) = &motion.angle {
            self.typed_value(angle, Type::Real, "CA");
        }
        let axes = self.target(motion.path, &motion.target);
        match motion.executed() {
            Some(executed) => {
                let approximates = motion.approximates.first().copied();
                self.emit(Op::Motion { motion: executed, axes, approximates });
            }
            None => self.record_unexecuted(motion.word),
        }
    }

    /// Compiles a target, so that 6 numbers are on the stack. Returns true for axes, false for a pose.
    fn target(&mut self, path: PathKind, target: &Expression) -> bool {
        let wanted = match target {
            Expression::Aggregate { type_name: None, parts } => self.infer_aggregate_type(parts),
            _ => Type::Unknown,
        };
        let kind = self.value(target, wanted);
        let cells = cells_u32(self.types.size(kind));
        let axes = self.types.is_axes(kind);
        if cells > 6 {
            self.emit(Op::Keep { first: 6, of: cells });
        }
        if kind != Type::Unknown && !self.types.is_pose(kind) && !(axes && path == PathKind::Joint) {
            let name = self.types.name(kind);
            self.problem("", format!("{name} is not a valid target for this motion"));
        }
        axes
    }

    /// Compiles `WITH $VEL.CP=0.2`; these settings are checked as assignments.
    fn settings(&mut self, with: &[(VariableRef, Expression)]) {
        with.iter().for_each(|(to, value)| self.assign(to, value));
    }

    pub(super) fn spline(&mut self, with: &[(VariableRef, Expression)], body: &[Statement]) {
        self.record_unexecuted("SPLINE");
        self.settings(with);
        self.block(body);
    }

    pub(super) fn trigger(
        &mut self,
        at: &TriggerPlace,
        delay: Option<&Expression>,
        action: &Statement,
        priority: Option<&Expression>,
    ) {
        match at {
            TriggerPlace::Distance(distance) => self.typed_value(distance, Type::Int, "DISTANCE"),
            TriggerPlace::Path(path) => {
                self.typed_value(path, Type::Real, "PATH");
                self.record_unexecuted("TRIGGER WHEN PATH");
            }
        }
        self.typed_value(delay.unwrap_or(&Expression::Int(0)), Type::Real, "DELAY");
        self.typed_value(priority.unwrap_or(&Expression::Int(-1)), Type::Int, "PRIO");
        let trigger = self.emit(Op::Trigger { after: 0 });
        match &action.action {
            Action::Assign { to, value } => self.assign(to, value),
            Action::Call(call) => self.call_and_forget(call),
            _ => {}
        }
        self.emit(Op::EndInterrupt);
        self.set_jump_target(trigger);
    }

    /// Checks that each GOTO leads to a label of its own routine, and that each label exists once.
    pub(super) fn check_labels(&mut self, body: &[Statement]) {
        let (mut labels, mut jumps) = (Vec::new(), Vec::new());
        collect_labels(body, &mut labels, &mut jumps);
        let mut first: BTreeMap<&str, usize> = BTreeMap::new();
        for (name, line) in labels {
            if let Some(other) = first.get(name) {
                self.line = line;
                self.problem(name, format!("this label already exists: line {other}"));
            }
            first.entry(name).or_insert(line);
        }
        for (name, line) in jumps {
            if !first.contains_key(name) {
                self.line = line;
                self.problem(
                    name,
                    "GOTO needs a label in the same routine, but the routine has no label of this name",
                );
            }
        }
    }
}

type ComponentPositions<'a> = Vec<(&'a str, usize)>;

fn collect_labels<'a>(
    body: &'a [Statement],
    labels: &mut ComponentPositions<'a>,
    jumps: &mut ComponentPositions<'a>,
) {
    for statement in body {
        match &statement.action {
            Action::Label(name) => labels.push((name, statement.line)),
            Action::Goto(name) => jumps.push((name, statement.line)),
            other => other.statement_blocks().into_iter().for_each(|block| collect_labels(block, labels, jumps)),
        }
    }
}
