//! The interface between the interpreter and the controller around it, and the steps that use this interface: motions,
//! waiting, braking, the controller's own routines.

use super::interpreter::{Interpreter, Memory, StepError, StepFlow, Trigger};
use crate::krl::code::{Cell, MemoryAddress, Op, Program};
use crate::krl::routines::Builtin;
use crate::krl::syntax::{Approximation, Motion};

/// A motion that the program requests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionRequest {
    /// PTP or LIN.
    pub motion: Motion,
    /// Whether the target is given as axis angles; otherwise it is a pose.
    pub axes: bool,
    /// The target: axis angles in degrees, or a pose in mm and degrees.
    pub target: [f32; 6],
    /// How the end of the motion is approximated; `None` for an exact stop.
    pub approximates: Option<Approximation>,
}

/// The result of an EthernetKRL function: the components of `EKI_STATUS`, and the value that was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EkiAnswer {
    /// Number of values that remain in the buffer.
    pub buff: i32,
    /// Number of values that were read from the buffer.
    pub read: i32,
    /// The number of the error message; 0 if there is no error.
    pub msg_no: i32,
    /// Whether a client is connected.
    pub connected: bool,
    /// The counter of the message that contained the value.
    pub counter: i32,
    /// The value that was read: a simple value in the first cell, or six numbers.
    pub value: [Cell; 6],
}

/// The controller, as the interpreter uses it.
pub trait Host {
    /// Reads one cell of a system variable.
    ///
    /// # Errors
    /// If the controller would stop the program at this access.
    fn read(&mut self, variable: u16, offset: u32) -> Result<Cell, String>;

    /// Writes one cell of a system variable.
    ///
    /// # Errors
    /// If the value is not valid for the variable.
    fn write(&mut self, variable: u16, offset: u32, value: Cell) -> Result<(), String>;

    /// Returns the time since the start of the controller, ms.
    fn now_ms(&self) -> u64;

    /// Returns whether the arm is at rest and no motion is planned.
    fn is_arm_at_rest(&self) -> bool;

    /// Returns the number of planned motions, including the current one.
    fn planned_motions(&self) -> usize;

    /// Returns the value of `$ADVANCE`.
    fn advance(&self) -> usize;

    /// Plans a motion and returns its sequence number, with which its end is reported.
    ///
    /// # Errors
    /// If the controller cannot plan the motion.
    fn plan(&mut self, request: &MotionRequest, caller: &Caller<'_>) -> Result<u64, String>;

    /// Requests that all planned motions are executed to their end, because a statement waits for the arm.
    fn finish_motions(&mut self);

    /// Starts braking; the arm has stopped once [`Host::is_arm_at_rest`] is true.
    fn start_braking(&mut self, fast: bool);

    /// Discards the planned motions after a RESUME.
    fn discard(&mut self);

    /// Executes a function of EthernetKRL.
    ///
    /// # Errors
    /// If the controller would stop the program at this call.
    fn eki(&mut self, what: Builtin, channel: &str, tag: &str, value: &[Cell]) -> Result<EkiAnswer, String>;

    /// Executes CWRITE to the channel `$CMD`.
    ///
    /// # Errors
    /// If the command is not known.
    fn command(&mut self, text: &str) -> Result<(), String>;

    /// Sets speeds and accelerations to their defaults, as BAS(#INITMOV,…) does.
    fn init_motion(&mut self);

    /// Returns whether a value was assigned to a system variable.
    fn is_initialized(&mut self, name: &str) -> bool;
}

/// The call stack of the interpreter when it requests a motion, so that a log can state to which command the motion
/// belongs.
pub struct Caller<'a> {
    pub(super) program: &'a Program,
    pub(super) interpreter: &'a Interpreter,
    pub(super) memory: &'a Memory,
}

impl Caller<'_> {
    /// Returns the values of the innermost local variable with this name; `cells` is the variable's size.
    pub fn local_cells(&self, name: &str, cells: usize) -> Option<Vec<Cell>> {
        self.interpreter.local_cells(self.program, self.memory, name, cells)
    }
}

impl Interpreter {
    pub(super) fn robot_op(
        &mut self,
        op: &Op,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<StepFlow, StepError> {
        // The submit interpreter runs in parallel to the robot program, even while the drives are off.
        if !self.moves && !matches!(op, Op::WaitSeconds | Op::Continue) {
            return Err("motions and interrupts are not valid in the submit interpreter".into());
        }
        match *op {
            Op::WaitSeconds => return self.wait_seconds(host),
            Op::WaitFor(start) => {
                if self.stops_advance_run(host) {
                    return Ok(StepFlow::Wait);
                }
                if !self.pop_bool()? {
                    self.step_index = start as usize;
                    return Ok(StepFlow::Wait);
                }
            }
            Op::Motion { motion, axes, approximates } => {
                if !self.planned {
                    // The advance run plans at most `$ADVANCE` motions beyond the current one. Without this limit the
                    // simulated blending would be better than on a controller.
                    if host.planned_motions() > host.advance() {
                        return Ok(StepFlow::Wait);
                    }
                    if self.is_in_interrupt() {
                        return Err("this interpreter does not support a motion in an interrupt program".into());
                    }
                    let target = numbers(self.pop_block()?)?;
                    let request = MotionRequest { motion, axes, target, approximates };
                    let planned = host.plan(&request, &Caller { program, interpreter: self, memory });
                    if planned.is_err() {
                        // After a restart the program executes this motion again, so its target is pushed back on the
                        // stack.
                        self.stack.extend(target.map(Cell::Real));
                    }
                    let sequence = planned?;
                    self.attach_triggers(sequence);
                    self.planned = true;
                }
                if host.advance() == 0 && !host.is_arm_at_rest() {
                    host.finish_motions();
                    return Ok(StepFlow::Wait);
                }
            }
            Op::InterruptDeclaration { global, call, after } => {
                let number = self.pop_int()?;
                self.declare(number, global, call)?;
                self.step_index = after as usize;
                return Ok(StepFlow::Next);
            }
            Op::InterruptSwitch { on } => {
                let number = self.pop_int()?;
                self.switch(Some(number), on, program, memory, host)?;
            }
            Op::InterruptSwitchAll { on } => self.switch(None, on, program, memory, host)?,
            Op::Trigger { after } => {
                let (_priority, delay, distance) = (self.pop_int()?, self.pop_real()?, self.pop_int()?);
                // Other triggers are an error and are not approximated, because a trigger at another time switches the
                // tool at another position.
                if distance != 1 || delay != 0.0 {
                    return Err("this interpreter supports only TRIGGER WHEN DISTANCE=1 DELAY=0".into());
                }
                let base = self.frames.last().map_or(0, |frame| frame.base);
                self.armed.push(Trigger { sequence: None, call: self.step_index + 1, base });
                self.step_index = after as usize;
                return Ok(StepFlow::Next);
            }
            Op::EndInterrupt => return self.end_interrupt(),
            Op::Brake { fast } => {
                if !self.is_in_interrupt() {
                    return Err("BRAKE is valid only in an interrupt program".into());
                }
                if self.braked.is_none() {
                    self.braked = Some(!host.is_arm_at_rest());
                    host.start_braking(fast);
                }
                if !host.is_arm_at_rest() {
                    return Ok(StepFlow::Wait);
                }
            }
            Op::Resume => return self.resume(host),
            Op::Halt => {
                return Err(
                    "HALT: the program waits for the Start key, which this interpreter does not support".into()
                );
            }
            Op::Continue => self.continue_statement = Some(program.statements[self.statement].line),
            _ => return Err("internal error of the KRL interpreter: an unknown operation".into()),
        }
        self.step_index += 1;
        Ok(StepFlow::Next)
    }

    fn wait_seconds(&mut self, host: &mut dyn Host) -> Result<StepFlow, StepError> {
        if self.waits_until_ms.is_none() {
            if self.stops_advance_run(host) {
                return Ok(StepFlow::Wait);
            }
            let seconds = self.pop_real()?;
            let wait_ms = (f64::from(seconds.max(0.0)) * 1000.0).ceil() as u64;
            self.waits_until_ms = Some(host.now_ms() + wait_ms);
        }
        if self.waits_until_ms.is_some_and(|until_ms| host.now_ms() < until_ms) {
            return Ok(StepFlow::Wait);
        }
        self.waits_until_ms = None;
        self.step_index += 1;
        Ok(StepFlow::Next)
    }

    pub(super) fn controller_call(
        &mut self,
        builtin: Builtin,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), StepError> {
        match builtin {
            Builtin::InvPos => {
                let frame = numbers(self.pop_block()?)?;
                self.stack.extend(inverse(frame).map(Cell::Real));
            }
            Builtin::Bas => {
                self.pop_real()?;
                let what = self.pop()?;
                if what != Cell::Word(0) {
                    return Err("this interpreter supports only BAS(#INITMOV,0)".into());
                }
                host.init_motion();
            }
            Builtin::IrStopm => {}
            Builtin::ErrClear => {
                self.pop_address()?;
            }
            Builtin::OnErrorProceed => self.error_suppression = 2,
            Builtin::Varstate => {
                let name = self.pop_text(program)?.to_uppercase();
                let known = name.starts_with('$') && host.is_initialized(&name);
                self.stack.push(Cell::Word(if known { 1 } else { 0 }));
            }
            Builtin::Cwrite => {
                let text = self.pop_text(program)?;
                let mode = self.pop_address()?;
                self.pop_address()?;
                self.pop()?;
                if self.read(mode, memory, host)? == Cell::Unset {
                    return Err("the argument MODE of CWRITE was never assigned a value".into());
                }
                host.command(text)?;
            }
            _ => self.eki(builtin, program, memory, host)?,
        }
        Ok(())
    }

    fn eki(
        &mut self,
        builtin: Builtin,
        program: &Program,
        memory: &mut Memory,
        host: &mut dyn Host,
    ) -> Result<(), StepError> {
        use Builtin::*;
        let mut into: Option<MemoryAddress> = None;
        let mut value = [Cell::Unset; 6];
        match builtin {
            EkiGetBool | EkiGetInt | EkiGetReal | EkiGetFrame => {
                let address = self.pop_address()?;
                // EthernetKRL refuses a variable without a value. If it were accepted here, the program would still
                // stop on the controller.
                if self.read(address, memory, host)? == Cell::Unset {
                    return Err("a variable must have a value before it is passed to an EKI_Get function".into());
                }
                into = Some(address);
            }
            EkiSetFrame => value = self.pop_block()?,
            EkiSetBool | EkiSetInt | EkiSetReal => value[0] = self.pop()?,
            EkiCheck => {
                self.pop()?;
                let _: [Cell; 5] = self.pop_block()?;
                return Ok(());
            }
            _ => {}
        }
        let has_tag = !matches!(builtin, EkiInit | EkiOpen | EkiClose | EkiClear | EkiLock | EkiUnlock);
        let tag = if has_tag { Some(self.pop_text_index()?) } else { None };
        let channel = self.pop_text_index()?;
        let text = |index: usize| program.texts.get(index).map_or("", String::as_str);
        let answer = host.eki(builtin, text(channel), tag.map_or("", text), &value)?;
        // After an error the variable keeps its old value, which the program must not use as a received value.
        if let Some(address) = into.filter(|_| answer.msg_no == 0) {
            let cells = if builtin == EkiGetFrame { 6 } else { 1 };
            for (offset, cell) in (address.offset..).zip(answer.value.into_iter().take(cells)) {
                self.write(MemoryAddress { offset, ..address }, cell, memory, host)?;
            }
        }
        self.stack.extend([
            Cell::Int(answer.buff),
            Cell::Int(answer.read),
            Cell::Int(answer.msg_no),
            Cell::Bool(answer.connected),
            Cell::Int(answer.counter),
        ]);
        Ok(())
    }
}

/// Converts six cells to REAL numbers.
///
/// # Errors
/// If a cell was never assigned a value.
pub(super) fn numbers(cells: [Cell; 6]) -> Result<[f32; 6], StepError> {
    let mut found = [0.0; 6];
    for (number, cell) in found.iter_mut().zip(cells) {
        match cell {
            Cell::Real(value) => *number = value,
            _ => return Err("a component of the frame or of the axes was never assigned a value".into()),
        }
    }
    Ok(found)
}

type Matrix = nalgebra::Isometry3<f64>;

fn frame_to_isometry(frame: [f32; 6]) -> Matrix {
    let [x, y, z, a, b, c] = frame.map(f64::from);
    // KUKA's angles are intrinsic rotations: A about Z, then B about the rotated Y, then C about the rotated X.
    let turn = nalgebra::UnitQuaternion::from_euler_angles(c.to_radians(), b.to_radians(), a.to_radians());
    Matrix::from_parts(nalgebra::Translation3::new(x, y, z), turn)
}

fn frame(isometry: &Matrix) -> [f32; 6] {
    let (c, b, a) = isometry.rotation.euler_angles();
    let at = isometry.translation.vector;
    [at.x, at.y, at.z, a.to_degrees(), b.to_degrees(), c.to_degrees()].map(|number| number as f32)
}

/// Computes `left:right`.
pub(super) fn compose_frames(left: [f32; 6], right: [f32; 6]) -> [f32; 6] {
    frame(&(frame_to_isometry(left) * frame_to_isometry(right)))
}

fn inverse(of: [f32; 6]) -> [f32; 6] {
    frame(&frame_to_isometry(of).inverse())
}
