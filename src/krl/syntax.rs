//! The contents of a KRL file, as a tree. All names are in upper case; every part keeps its line, from 1.

use crate::config::Problem;

/// A file that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct File {
    /// As the user wrote its name.
    pub name: String,
    /// What a controller refuses in its text, in the order of the lines.
    pub problems: Vec<Problem>,
    /// The parts of the file that were not read, in the order of the lines.
    pub warnings: Vec<Problem>,
    /// It is written for EthernetKRL 6 (iiQKA.OS2).
    pub(super) of_ethernet_krl_6: bool,
    /// The name without folder and ending, in upper case.
    pub(super) module: String,
    /// The DEF and DEFFCT of a `.src` or `.sub`.
    pub(super) routines: Vec<Routine>,
    /// The DEFDAT of a `.dat`.
    pub(super) data: Option<Data>,
}

impl File {
    /// What the file holds, in a sentence.
    pub fn sentence(&self) -> String {
        let list = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        let Some(data) = &self.data else {
            let (seen, hidden): (Vec<&Routine>, Vec<&Routine>) =
                self.routines.iter().partition(|routine| routine.global || routine.name == self.module);
            let seen: Vec<&str> = seen.iter().map(|routine| routine.name.as_str()).collect();
            return format!(
                "a program: routines that other files see: {}; {} more for itself",
                list(seen),
                hidden.len()
            );
        };
        let (mut constants, mut variables, mut signals) = (0, 0, 0);
        for declaration in &data.declarations {
            match &declaration.kind {
                Declared::Variables { constant: true, items, .. } => constants += items.len(),
                Declared::Variables { items, .. } => variables += items.len(),
                Declared::Signal { .. } => signals += 1,
                _ => {}
            }
        }
        let signals = if signals > 0 { format!(", {signals} signals") } else { String::new() };
        format!("a data list: {constants} constants, {variables} variables{signals}")
    }
}

/// DEFDAT … ENDDAT.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Data {
    pub(super) line: usize,
    /// As DEFDAT has it; a controller wants the file's name.
    pub(super) name: String,
    pub(super) public: bool,
    pub(super) declarations: Vec<Declaration>,
    /// `NAME[1]=17` below the declarations.
    pub(super) values: Vec<Statement>,
}

/// DEF … END or DEFFCT … ENDFCT.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Routine {
    pub(super) name: String,
    pub(super) line: usize,
    pub(super) end_line: usize,
    pub(super) global: bool,
    /// For DEFFCT.
    pub(super) returns: Option<Returned>,
    pub(super) parameters: Vec<Parameter>,
    pub(super) declarations: Vec<Declaration>,
    pub(super) body: Vec<Statement>,
}

/// What a DEFFCT gives back: a type, or an array of CHAR.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Returned {
    pub(super) type_name: String,
    pub(super) dimensions: Vec<Option<Expression>>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parameter {
    pub(super) name: String,
    /// `:IN`, by value; otherwise by reference, which is also KRL's default.
    pub(super) by_value: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Declaration {
    pub(super) line: usize,
    pub(super) global: bool,
    pub(super) kind: Declared,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Declared {
    Variables {
        constant: bool,
        type_name: String,
        items: Vec<Item>,
    },
    /// Components with their types, in order.
    Struc {
        name: String,
        components: Vec<(String, Item)>,
    },
    Enumeration {
        name: String,
        words: Vec<String>,
    },
    /// A name for an input or output, or for several up to `to`; `None` for `SIGNAL NAME FALSE`.
    Signal {
        name: String,
        from: Option<VariableRef>,
        to: Option<VariableRef>,
    },
    /// `IMPORT INT NAME IS /R1/OTHER..NAME`: a variable of another data list.
    Import {
        type_name: String,
        name: String,
    },
    /// EXT and EXTFCT, a routine that is defined elsewhere, and CHANNEL.
    Foreign,
}

/// A variable or component: name, dimensions, first value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Item {
    pub(super) name: String,
    /// `None` for `[]`.
    pub(super) dimensions: Vec<Option<Expression>>,
    pub(super) value: Option<Expression>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Statement {
    pub(super) line: usize,
    pub(super) action: Action,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Call {
    pub(super) name: String,
    /// `None` for an argument that is left out: `F(1, ,3)`.
    pub(super) arguments: Vec<Option<Expression>>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Action {
    Assign {
        to: VariableRef,
        value: Expression,
    },
    Call(Call),
    If {
        condition: Expression,
        then: Vec<Statement>,
        otherwise: Vec<Statement>,
    },
    Switch {
        on: Expression,
        cases: Vec<Case>,
        default: Option<Vec<Statement>>,
    },
    For {
        variable: VariableRef,
        from: Expression,
        to: Expression,
        step: Option<Expression>,
        body: Vec<Statement>,
    },
    While {
        condition: Expression,
        body: Vec<Statement>,
    },
    Repeat {
        body: Vec<Statement>,
        until: Expression,
        until_line: usize,
    },
    Loop {
        body: Vec<Statement>,
    },
    Exit,
    Return(Option<Expression>),
    /// `NAME:`
    Label(String),
    Goto(String),
    InterruptDeclaration {
        global: bool,
        /// The arm is braked before the routine is called.
        with_brake: bool,
        number: Expression,
        condition: Expression,
        call: Call,
    },
    InterruptSwitch {
        how: InterruptSwitch,
        number: Option<Expression>,
    },
    Brake {
        fast: bool,
    },
    Resume,
    Halt,
    /// CONTINUE: the next line does not stop the advance run.
    Continue,
    Trigger {
        at: TriggerPlace,
        delay: Option<Expression>,
        action: Box<Statement>,
        priority: Option<Expression>,
    },
    Motion(Box<MotionStatement>),
    /// SPLINE or PTP_SPLINE … ENDSPLINE.
    Spline {
        with: Vec<(VariableRef, Expression)>,
        body: Vec<Statement>,
    },
    WaitSeconds(Expression),
    WaitFor(Expression),
    /// A statement that is never executed; only its expressions are checked. Its first word, and its values with
    /// the types that they must have.
    Checked {
        word: &'static str,
        values: Vec<(Expression, &'static str)>,
    },
    /// What was not read; it was reported.
    NotRead,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Case {
    pub(super) line: usize,
    pub(super) values: Vec<Expression>,
    pub(super) body: Vec<Statement>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum InterruptSwitch {
    On,
    Off,
    Enable,
    Disable,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum TriggerPlace {
    /// `DISTANCE=0` or `DISTANCE=1`: a motion's start or end.
    Distance(Expression),
    /// `PATH=-10`, mm from a motion's start or end.
    Path(Expression),
}

/// A motion as it is written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MotionStatement {
    /// Its first word.
    pub(super) word: &'static str,
    pub(super) path: PathKind,
    /// The point that a circle passes.
    pub(super) auxiliary: Option<Expression>,
    pub(super) target: Expression,
    /// `CA`, of a circle.
    pub(super) angle: Option<Expression>,
    pub(super) approximates: Vec<Approximation>,
    /// `WITH $VEL.CP=0.2`, of a spline motion.
    pub(super) with: Vec<(VariableRef, Expression)>,
}

impl MotionStatement {
    /// How it is executed; `None` if it is only checked.
    pub(super) fn executed(&self) -> Option<Motion> {
        let motion = match self.word {
            "PTP" => Motion::Ptp,
            "LIN" => Motion::Lin,
            _ => return None,
        };
        (self.approximates.len() < 2).then_some(motion)
    }
}

/// The path of a motion, whether it is absolute, relative or of a spline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PathKind {
    /// Axes together; the target may be axes or a pose.
    Joint,
    Line,
    Circle,
    /// SPL.
    Curve,
}

/// A motion that is executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Axes together.
    Ptp,
    /// The tool on a straight line.
    Lin,
}

/// How a motion's end is rounded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Approximation {
    /// C_PTP.
    Ptp,
    /// C_DIS.
    Distance,
    /// C_VEL.
    Velocity,
    /// C_ORI.
    Orientation,
    /// C_SPL.
    Spline,
}

/// A variable and the path to a part of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VariableRef {
    pub(super) name: String,
    pub(super) steps: Vec<Step>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    Component(String),
    /// `[1,2]`; an index is left out in `[]`, `[,]` and `[3,]`: the array as a whole, or one of its rows.
    Index(Vec<Option<Expression>>),
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Expression {
    Int(i32),
    Real(f32),
    Bool(bool),
    Text(String),
    Word(String),
    Variable(VariableRef),
    Call(Call),
    Aggregate {
        type_name: Option<String>,
        parts: Vec<(VariableRef, Expression)>,
    },
    Unary(Unary, Box<Expression>),
    Binary(Binary, Box<Expression>, Box<Expression>),
    /// `:SER_1`, a channel of COPEN.
    Channel,
    /// What was not read; it was reported.
    NotRead,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unary {
    Minus,
    Not,
    BitNot,
}

/// An operator between two values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Binary {
    /// `*`
    Times,
    /// `/`, which truncates between two INT.
    By,
    /// `+`
    Plus,
    /// `-`
    Minus,
    /// `:`, one frame in another.
    Geometric,
    /// AND
    And,
    /// OR
    Or,
    /// EXOR
    Exor,
    /// B_AND
    BitAnd,
    /// B_OR
    BitOr,
    /// B_EXOR
    BitExor,
    /// `==`
    Equal,
    /// `<>`
    Unequal,
    /// `<`
    Less,
    /// `<=`
    AtMost,
    /// `>`
    Greater,
    /// `>=`
    AtLeast,
}

impl Action {
    /// The blocks of statements inside.
    pub(super) fn blocks(&self) -> Vec<&[Statement]> {
        match self {
            Action::If { then, otherwise, .. } => vec![then, otherwise],
            Action::Switch { cases, default, .. } => {
                cases.iter().map(|case| case.body.as_slice()).chain(default.as_deref()).collect()
            }
            Action::For { body, .. }
            | Action::While { body, .. }
            | Action::Repeat { body, .. }
            | Action::Loop { body }
            | Action::Spline { body, .. } => vec![body],
            _ => Vec::new(),
        }
    }
}
