//! Interrupts, triggers and RESUME. An interrupt is declared at a call level, detected at the rising edge of its
//! condition, and executed by priority.
//!
//! An interrupt with a smaller number has the higher priority. Triggers have the lowest priority.

use super::super::code::{Op, Program};
use super::host::Host;
use super::interpreter::{Frame, Interpreter, Interrupt, InterruptEntry, Memory, StepError, StepFlow};

/// The priority of a trigger with PRIO=-1; the controller assigns a priority that programs cannot use.
const TRIGGER_PRIORITY: i32 = 80;
/// Maximum number of interrupts that are declared at the same time.
pub const MAX_DECLARED_INTERRUPTS: usize = 32;

impl Interpreter {
    pub(super) fn declare(&mut self, number: i32, global: bool, call: u32) -> Result<(), StepError> {
        let allowed = (1..=39).contains(&number) || (81..=128).contains(&number);
        if !allowed {
            return Err(format!("interrupt {number} does not exist (valid: 1 to 39 and 81 to 128)").into());
        }
        let declared_in = self.frames.len() - 1;
        // A new declaration with the same number replaces the old one, as on the controller.
        self.interrupts.retain(|interrupt| interrupt.number != number);
        if self.interrupts.len() >= MAX_DECLARED_INTERRUPTS {
            return Err("more than 32 interrupts are declared".into());
        }
        self.interrupts.push(Interrupt {
            number,
            global,
            declared_in,
            condition: self.step_index + 1,
            call: call as usize,
            on: false,
            last_condition: false,
            pending: false,
        });
        // The number is the priority: of several pending interrupts, the one with the lowest number is executed first.
        self.interrupts.sort_by_key(|interrupt| interrupt.number);
        Ok(())
    }

    pub(super) fn switch(
        &mut self,
        number: Option<i32>,
        on: bool,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), StepError> {
        let is_meant = |of: &Interrupt| number.is_none_or(|number| of.number == number);
        if number.is_some() && !self.interrupts.iter().any(is_meant) {
            let number = number.unwrap_or_default();
            return Err(format!("interrupt {number} is not declared at this level").into());
        }
        for index in 0..self.interrupts.len() {
            if !is_meant(&self.interrupts[index]) {
                continue;
            }
            let was = on && self.condition(index, program, memory, host)?;
            let fires = was && !self.interrupts[index].on && self.meaning.on_fires_at_once;
            let interrupt = &mut self.interrupts[index];
            interrupt.pending = on && (interrupt.pending || fires);
            (interrupt.on, interrupt.last_condition) = (on, was);
        }
        Ok(())
    }

    /// Evaluates the condition of an interrupt and returns its value.
    fn condition(
        &mut self,
        index: usize,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<bool, StepError> {
        let (at, height) = (self.step_index, self.stack.len());
        let interrupt = &self.interrupts[index];
        let (start, level) = (interrupt.condition, interrupt.declared_in);
        // A condition uses the local variables of the routine that declared the interrupt.
        self.condition_base = self.frames.get(level).map(|frame| (frame.base, self.frames.len()));
        self.step_index = start;
        let value = loop {
            match program.code.get(self.step_index) {
                Some(Op::EndCondition) => break self.pop_bool(),
                Some(op) => match self.condition_op(op, program, memory, host) {
                    Ok(()) => {}
                    Err(message) => break Err(message),
                },
                None => break Err("internal error of the KRL interpreter: a condition has no end".into()),
            }
        };
        self.condition_base = None;
        self.stack.truncate(height);
        self.step_index = at;
        value
    }

    fn condition_op(
        &mut self,
        op: &Op,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), StepError> {
        if self.run_condensed(program, memory, host)? {
            return Ok(());
        }
        if let Op::Load = op {
            // While a condition is evaluated, reading a variable never waits for the arm.
            let address = self.pop_address()?;
            let cell = self.read(address, memory, host)?;
            self.stack.push(cell);
            self.step_index += 1;
            return Ok(());
        }
        match self.run_op(op, program, memory, host)? {
            StepFlow::Next => Ok(()),
            StepFlow::Wait | StepFlow::Ended => Err("the condition of an interrupt must not wait".into()),
        }
    }

    /// Evaluates the conditions of all interrupts. A detected edge stays pending until the interrupt program can run.
    ///
    /// # Errors
    /// If a condition cannot be evaluated.
    pub fn evaluate_conditions(
        &mut self,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), String> {
        for index in 0..self.interrupts.len() {
            if !self.interrupts[index].on {
                continue;
            }
            let now = self.condition(index, program, memory, host)?;
            let interrupt = &mut self.interrupts[index];
            interrupt.pending |= now && !interrupt.last_condition;
            interrupt.last_condition = now;
        }
        Ok(())
    }

    /// Calls the interrupt program if an interrupt with a higher priority is pending; returns whether it was called.
    pub fn run_pending_interrupt(&mut self) -> bool {
        let current = self.priority();
        let found = self.interrupts.iter().position(|it| it.on && it.pending && it.number < current);
        let Some(index) = found else { return false };
        let interrupt = &mut self.interrupts[index];
        interrupt.pending = false;
        let (priority, declared_in, call) = (interrupt.number, interrupt.declared_in, interrupt.call);
        let base = self.frames.get(declared_in).map_or(0, |frame| frame.base);
        self.push_break(priority, declared_in, call, base);
        true
    }

    /// Fires the triggers of a motion whose end, or the middle of whose blend, was passed. Returns false if a trigger
    /// must wait, so that the function must be called again for this motion; otherwise true.
    pub fn fire_triggers(&mut self, sequence: u64) -> bool {
        if self.priority() <= TRIGGER_PRIORITY {
            return false;
        }
        let Some(index) = self.armed.iter().position(|trigger| trigger.sequence == Some(sequence)) else {
            return true;
        };
        let trigger = self.armed.remove(index);
        let declared_in = self.frames.len().saturating_sub(1);
        self.push_break(TRIGGER_PRIORITY, declared_in, trigger.call, trigger.base);
        true
    }

    pub(super) fn attach_triggers(&mut self, sequence: u64) {
        for trigger in &mut self.armed {
            trigger.sequence.get_or_insert(sequence);
        }
    }

    fn push_break(&mut self, priority: i32, declared_in: usize, call: usize, base: usize) {
        let broke_in = InterruptEntry {
            priority,
            declared_in,
            waits_until_ms: self.waits_until_ms.take(),
            braked: self.braked.take(),
        };
        let routine = self.frames.last().map_or(0, |frame| frame.routine);
        let frame = Frame {
            routine,
            return_to: self.step_index,
            base,
            height: self.stack.len(),
            interrupt_entry: Some(broke_in),
        };
        self.saved.push((self.planned, self.continue_statement.take(), self.statement));
        self.frames.push(frame);
        self.step_index = call;
    }

    /// Returns the priority of the code that is currently executed; the program itself has a lower priority than all
    /// interrupts.
    fn priority(&self) -> i32 {
        let broke_in = self.frames.iter().rev().find_map(|frame| frame.interrupt_entry.as_ref());
        broke_in.map_or(i32::MAX, |broke_in| broke_in.priority)
    }

    pub(super) fn is_in_interrupt(&self) -> bool {
        self.frames.iter().any(|frame| frame.interrupt_entry.is_some())
    }

    pub(super) fn end_interrupt(&mut self) -> Result<StepFlow, StepError> {
        if self.braked == Some(true) {
            return Err(
                "an interrupt program ended after BRAKE without RESUME; this interpreter does not support continuing \
                 the braked motion"
                    .into(),
            );
        }
        let frame = self.frames.pop().ok_or("no interrupt runs")?;
        self.stack.truncate(frame.height);
        self.step_index = frame.return_to;
        self.restore(frame.interrupt_entry);
        Ok(StepFlow::Next)
    }

    fn restore(&mut self, broke_in: Option<InterruptEntry>) {
        if let Some(broke_in) = broke_in {
            (self.waits_until_ms, self.braked) = (broke_in.waits_until_ms, broke_in.braked);
        }
        if let Some((planned, keeps_going, statement)) = self.saved.pop() {
            (self.planned, self.continue_statement, self.statement) = (planned, keeps_going, statement);
        }
    }

    /// Removes all frames above the level that declared the interrupt, and continues at that level.
    pub(super) fn resume(&mut self, host: &mut dyn Host) -> Result<StepFlow, StepError> {
        let innermost = self.frames.iter().rposition(|frame| frame.interrupt_entry.is_some());
        let innermost = innermost.ok_or("RESUME is valid only in an interrupt program")?;
        let declared_in =
            self.frames[innermost].interrupt_entry.as_ref().map_or(0, |broke_in| broke_in.declared_in);
        if self.meaning.resume_needs_advance_0 && host.advance() != 0 {
            return Err("RESUME needs $ADVANCE = 0".into());
        }
        let below = self.frames.get(declared_in + 1).filter(|frame| frame.interrupt_entry.is_none()).cloned();
        let below = below.ok_or(
            "RESUME is not valid at the level that declared the interrupt, only in a routine called from there",
        )?;
        let broken = self.frames[declared_in + 1..].iter().filter(|frame| frame.interrupt_entry.is_some()).count();
        self.frames.truncate(declared_in + 1);
        self.saved.truncate(self.saved.len().saturating_sub(broken));
        self.stack.truncate(below.height);
        self.cells.truncate(below.base);
        self.step_index = below.return_to;
        (self.waits_until_ms, self.braked, self.planned, self.continue_statement) = (None, None, false, None);
        self.armed.clear();
        let level = self.frames.len();
        self.interrupts.retain(|interrupt| interrupt.global || interrupt.declared_in < level);
        // The planned motions belong to the removed routines and must not be executed.
        host.discard();
        Ok(StepFlow::Next)
    }

    /// Removes the triggers of this motion, so that they do not fire.
    pub fn forget_triggers(&mut self, sequence: u64) {
        self.armed.retain(|trigger| trigger.sequence != Some(sequence));
    }

    /// Returns whether a trigger of this motion has not fired yet.
    pub fn has_trigger(&self, sequence: u64) -> bool {
        self.armed.iter().any(|trigger| trigger.sequence == Some(sequence))
    }
}
