//! Compiles statements to steps, including motions, splines and triggers.

use super::super::code::{Cell, Op};
use super::super::syntax::{
    Action, Binary, Call, Case, Expression, InterruptSwitch, MotionStatement, PathKind, Statement, TriggerPlace,
    VariableRef,
};
use super::super::types::Type;
use super::compiler::{Compiler, cells_u32};
use std::collections::BTreeMap;

impl Compiler<'_> {
    pub(super) fn block(&mut self, statements: &[Statement]) {
        // The code after the block belongs to the enclosing statement again.
        let around = self.statement;
        for statement in statements {
            self.statement(statement);
        }
        self.statement = around;
    }

    fn statement(&mut self, statement: &Statement) {
        self.begin_statement(statement.line);
        match &statement.action {
            Action::Assign { to, value } => self.assign(to, value),
            Action::Call(call) => self.call_without_result(call),
            Action::If { condition, then, otherwise } => self.compile_if(condition, then, otherwise),
            Action::Switch { on, cases, default } => self.compile_switch(on, cases, default.as_deref()),
            Action::For { variable, from, to, step, body } => {
                self.compile_for(variable, [from, to], step.as_ref(), body, statement.line);
            }
            Action::While { condition, body } => {
                let start = self.next_step() - 1;
                let out = self.condition(condition);
                self.compile_loop(body, start, Some(out));
            }
            Action::Repeat { body, until, until_line } => {
                let start = self.next_step();
                self.exits.push(Vec::new());
                self.block(body);
                self.begin_statement(*until_line);
                let back = self.condition(until);
                if let Op::JumpIfNot(to) = &mut self.program.code[back] {
                    *to = start;
                }
                self.compile_exit();
            }
            Action::Loop { body } => {
                let start = self.next_step() - 1;
                self.compile_loop(body, start, None);
            }
            Action::Exit => {
                let jump = self.emit(Op::Jump(0));
                match self.exits.last_mut() {
                    Some(exits) => exits.push(jump),
                    None => self.problem("EXIT", "EXIT is valid only inside a loop"),
                }
            }
            Action::Return(value) => self.return_value(value.as_ref()),
            Action::Label(_) => {}
            Action::Goto(_) => self.record_unexecuted("GOTO"),
            Action::NotRead => self.record_unexecuted("a statement that was not parsed"),
            _ => self.compile_robot_action(&statement.action),
        }
    }

    fn compile_robot_action(&mut self, action: &Action) {
        match action {
            Action::InterruptDeclaration { global, with_brake, number, condition, call } => {
                if *with_brake {
                    self.record_unexecuted("INTERRUPT WITH BRAKE");
                }
                self.typed_value(number, Type::Int, "INTERRUPT DECL");
                let declaration = self.emit(Op::InterruptDeclaration { global: *global, call: 0, after: 0 });
                self.typed_value(condition, Type::Bool, "WHEN");
                self.emit(Op::EndCondition);
                let at = self.next_step();
                if let Op::InterruptDeclaration { call, .. } = &mut self.program.code[declaration] {
                    *call = at;
                }
                self.call_without_result(call);
                self.emit(Op::EndInterrupt);
                self.set_jump_target(declaration);
            }
            Action::InterruptSwitch { how, number } => self.interrupt_switch(*how, number.as_ref()),
            Action::Trigger { at, delay, action, priority } => {
                self.trigger(at, delay.as_ref(), action, priority.as_ref());
            }
            Action::Motion(motion) => self.motion(motion),
            Action::Spline { with, body } => self.spline(with, body),
            Action::WaitSeconds(seconds) => {
                self.typed_value(seconds, Type::Real, "WAIT SEC");
                self.emit(Op::WaitSeconds);
            }
            Action::WaitFor(condition) => {
                let start = self.next_step();
                self.typed_value(condition, Type::Bool, "WAIT FOR");
                self.emit(Op::WaitFor(start));
            }
            Action::Brake { fast } => {
                self.emit(Op::Brake { fast: *fast });
            }
            Action::Resume => {
                self.emit(Op::Resume);
            }
            Action::Halt => {
                self.emit(Op::Halt);
            }
            Action::Checked { word, values } => {
                for (value, type_name) in values {
                    let kind = self.types.kuka_type(type_name);
                    self.typed_value(value, kind, word);
                }
                self.record_unexecuted(word);
            }
            _ => {
                self.emit(Op::Continue);
            }
        }
    }

    fn interrupt_switch(&mut self, how: InterruptSwitch, number: Option<&Expression>) {
        let on = match how {
            InterruptSwitch::On => true,
            InterruptSwitch::Off => false,
            InterruptSwitch::Enable | InterruptSwitch::Disable => {
                self.record_unexecuted("INTERRUPT ENABLE and DISABLE");
                false
            }
        };
        match number {
            Some(number) => {
                self.typed_value(number, Type::Int, "INTERRUPT");
                self.emit(Op::InterruptSwitch { on });
            }
            None => {
                self.emit(Op::InterruptSwitchAll { on });
            }
        }
    }

    pub(super) fn assign(&mut self, to: &VariableRef, value: &Expression) {
        let Some(found) = self.address(to) else {
            self.value(value, Type::Unknown);
            return;
        };
        self.check_writable(
            &to.name,
            &found,
            "a program cannot write this variable: it is a constant, or read-only",
        );
        self.ranges.remove(&to.name);
        if !found.dimensions.is_empty() {
            return self.assign_array(to, value, &found.dimensions, found.kind);
        }
        self.typed_value(value, found.kind, &to.name);
        let size = cells_u32(self.types.size(found.kind));
        self.emit(match value {
            Expression::Aggregate { .. } => Op::StoreAggregate(size),
            _ if size == 1 => Op::Store,
            _ => Op::StoreBlock(size),
        });
    }

    /// Compiles the assignment of a string, `TEXT[]="abc"`; other arrays cannot be assigned as a whole.
    fn assign_array(&mut self, to: &VariableRef, value: &Expression, dimensions: &[usize], kind: Type) {
        let given = self.value(value, Type::Text);
        let is_text = [Type::Text, Type::Char, Type::Unknown].contains(&given);
        if kind == Type::Unknown {
            self.record_unexecuted(&to.name);
        } else if kind != Type::Char || !is_text {
            self.problem(&to.name, "a whole array cannot be assigned; add an index");
        }
        if given == Type::Char || to.steps.len() > 1 {
            self.record_unexecuted("a string in a variable");
        }
        let cells = cells_u32(self.types.cells(kind, dimensions));
        self.emit(Op::StoreText(cells));
    }

    fn call_without_result(&mut self, call: &Call) {
        if let Some(kind) = self.call(call, Type::Unknown)
            && kind != Type::Unknown
        {
            let cells = cells_u32(self.types.size(kind));
            self.emit(Op::Drop(cells));
        }
    }

    /// Compiles a condition, and a jump for the case that the condition is FALSE; returns the index of the jump.
    fn condition(&mut self, condition: &Expression) -> usize {
        let kind = self.value(condition, Type::Bool);
        if ![Type::Bool, Type::Unknown].contains(&kind) {
            let name = self.types.name(kind);
            self.problem("", format!("a condition must be BOOL, found {name}"));
        }
        self.emit(Op::JumpIfNot(0))
    }

    fn compile_if(&mut self, condition: &Expression, then: &[Statement], otherwise: &[Statement]) {
        let over = self.condition(condition);
        self.block(then);
        if otherwise.is_empty() {
            self.set_jump_target(over);
            return;
        }
        let end = self.emit(Op::Jump(0));
        self.set_jump_target(over);
        self.block(otherwise);
        self.set_jump_target(end);
    }

    fn compile_switch(&mut self, on: &Expression, cases: &[Case], default: Option<&[Statement]>) {
        // The selector is evaluated only once: a function that is called after SWITCH must not be called again for each
        // CASE.
        let selector = self.reserve(1);
        self.emit(Op::Local(selector));
        let kind = self.value(on, Type::Unknown);
        self.emit(Op::Store);
        if !matches!(kind, Type::Int | Type::Char | Type::Enumeration(_) | Type::Unknown) {
            let name = self.types.name(kind);
            self.problem("SWITCH", format!("SWITCH needs an INT, CHAR or ENUM value, found {name}"));
        }
        let mut ends = Vec::new();
        for case in cases {
            self.line = case.line;
            let mut hits = Vec::new();
            let mut next = None;
            for value in &case.values {
                if let Some(jump) = next.take() {
                    self.set_jump_target(jump);
                }
                self.emit(Op::LoadLocal(selector));
                self.typed_value(value, kind, "CASE");
                self.emit(Op::Binary(Binary::Equal));
                next = Some(self.emit(Op::JumpIfNot(0)));
                hits.push(self.emit(Op::Jump(0)));
            }
            for hit in hits {
                self.set_jump_target(hit);
            }
            self.block(&case.body);
            ends.push(self.emit(Op::Jump(0)));
            if let Some(jump) = next {
                self.set_jump_target(jump);
            }
        }
        self.block(default.unwrap_or_default());
        for end in ends {
            self.set_jump_target(end);
        }
    }

    fn compile_for(
        &mut self,
        variable: &VariableRef,
        [from, to]: [&Expression; 2],
        step: Option<&Expression>,
        body: &[Statement],
        line: usize,
    ) {
        let (last, by) = (self.reserve(1), self.reserve(1));
        self.assign(variable, from);
        // End value and step are evaluated once, at the start. So the number of iterations does not change if the body
        // changes these variables.
        for (place, value) in [(last, to), (by, step.unwrap_or(&Expression::Int(1)))] {
            self.emit(Op::Local(place));
            self.typed_value(value, Type::Int, "FOR");
            self.emit(Op::Store);
        }
        let is_int = |found: Type| found == Type::Int || found == Type::Unknown;
        let start = self.next_step();
        self.begin_statement(line);
        let kind = self.value(&Expression::Variable(variable.clone()), Type::Int);
        if !is_int(kind) {
            self.problem(&variable.name, "the counter of FOR must be an INT");
        }
        self.emit(Op::LoadLocal(last));
        self.emit(Op::LoadLocal(by));
        self.emit(Op::ForTest);
        let out = self.emit(Op::JumpIfNot(0));
        if let (Some(Cell::Int(from)), Some(Cell::Int(to)), None) = (self.evaluate_constant(from), self.evaluate_constant(to), step)
            // The range of the counter is known only under this condition. With a known range, array indices can be
            // checked before the program runs.
            && from <= to
        {
            self.ranges.insert(variable.name.clone(), (from, to));
        }
        self.exits.push(Vec::new());
        self.block(body);
        self.ranges.remove(&variable.name);
        self.address(variable);
        self.value(&Expression::Variable(variable.clone()), Type::Int);
        self.emit(Op::LoadLocal(by));
        self.emit(Op::Binary(Binary::Plus));
        self.emit(Op::Store);
        self.emit(Op::Jump(start));
        self.set_jump_target(out);
        self.compile_exit();
    }

    fn compile_loop(&mut self, body: &[Statement], start: u32, out: Option<usize>) {
        self.exits.push(Vec::new());
        self.block(body);
        self.emit(Op::Jump(start));
        if let Some(out) = out {
            self.set_jump_target(out);
        }
        self.compile_exit();
    }

    fn compile_exit(&mut self) {
        for exit in self.exits.pop().unwrap_or_default() {
            self.set_jump_target(exit);
        }
    }

    fn return_value(&mut self, value: Option<&Expression>) {
        match (value, self.returns) {
            (None, None) => {
                self.emit(Op::Return(0));
            }
            (Some(value), Some(kind)) => {
                self.typed_value(value, kind, "RETURN");
                if kind == Type::Text {
                    self.record_unexecuted("a string as the return value of a function");
                }
                let cells = cells_u32(self.types.size(kind));
                self.emit(Op::Return(cells));
            }
            (Some(_), None) => {
                self.problem("RETURN", "a DEF routine cannot return a value; define a function with DEFFCT")
            }
            (None, Some(_)) => {
                self.problem("RETURN", "RETURN needs a value, because this routine is a function (DEFFCT)")
            }
        }
    }
}

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

    /// Compiles the target of a motion, which leaves six numbers on the stack. Returns true if they are axis angles,
    /// false if they are a pose.
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

    /// Compiles the settings of a motion, such as `WITH $VEL.CP=0.2`; they are checked like assignments.
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
            Action::Call(call) => self.call_without_result(call),
            _ => {}
        }
        self.emit(Op::EndInterrupt);
        self.set_jump_target(trigger);
    }

    /// Checks that each GOTO has a label in the same routine, and that each label exists only once.
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
