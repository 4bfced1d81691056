//! The syntax tree of a KRL file. All names are in upper case, and every node has its line number; the first line is 1.
//!
//! The limits below bound time, memory and recursion depth for any input. An input that exceeds a limit is reported
//! with its line.

use panelprep_base::config::Problem;

/// The maximum size of one file, bytes.
pub(super) const MAX_FILE_BYTES: usize = 16 << 20;
/// The maximum nesting depth of blocks (IF, LOOP, SPLINE …).
pub(super) const MAX_BLOCK_DEPTH: usize = 100;
/// The maximum nesting depth of brackets, braces and signs in one expression.
pub(super) const MAX_EXPRESSION_DEPTH: usize = 100;
/// The maximum number of operators between two values on one line.
pub(super) const MAX_OPERATORS: usize = 200;
/// The maximum number of values in one array or structure; a controller has no memory for more.
pub(super) const MAX_ARRAY_VALUES: usize = 10_000_000;
/// The maximum number of values for which memory is allocated, in all data lists together or in one routine.
pub(super) const MAX_MEMORY_VALUES: usize = 1_000_000;
/// The maximum size of a structure whose aggregates can be executed, in values and in components.
pub(super) const MAX_AGGREGATE_VALUES: usize = 256;
/// The maximum number of steps of an executable program; a larger program is only checked.
pub(super) const MAX_PROGRAM_STEPS: usize = 2_000_000;
/// The maximum number of reported problems, and of warnings, for one file.
pub(super) const MAX_REPORTS: usize = 1_000;
/// The maximum number of names that a message lists.
pub(super) const MAX_LISTED: usize = 20;

/// A parsed KRL file.
#[derive(Debug, Clone, PartialEq)]
pub struct File {
    /// The file's name as the user wrote it.
    pub name: String,
    /// The problems in the text because of which a controller refuses the file, in the order of the lines.
    pub problems: Vec<Problem>,
    /// The parts of the file that were not parsed, in the order of the lines.
    pub warnings: Vec<Problem>,
    /// Whether the file is written for EthernetKRL 6 (iiQKA.OS2).
    pub(super) of_ethernet_krl_6: bool,
    /// The file's name without folder and extension, in upper case.
    pub(super) module: String,
    /// The routines (DEF and DEFFCT) of a `.src` or `.sub` file.
    pub(super) routines: Vec<Routine>,
    /// The data list (DEFDAT) of a `.dat` file.
    pub(super) data: Option<Data>,
}

impl File {
    /// Returns one sentence that describes the content of the file.
    pub fn sentence(&self) -> String {
        let list = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        let Some(data) = &self.data else {
            let (seen, hidden): (Vec<&Routine>, Vec<&Routine>) =
                self.routines.iter().partition(|routine| routine.global || routine.name == self.module);
            let seen: Vec<&str> = seen.iter().map(|routine| routine.name.as_str()).collect();
            return format!(
                "a program: routines visible to other files: {}; {} local routines",
                list(seen),
                hidden.len()
            );
        };
        let (mut constants, mut variables, mut signals) = (0, 0, 0);
        for declaration in &data.declarations {
            match &declaration.kind {
                DeclarationContent::Variables { constant: true, items, .. } => constants += items.len(),
                DeclarationContent::Variables { items, .. } => variables += items.len(),
                DeclarationContent::Signal { .. } => signals += 1,
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
    /// The name after DEFDAT; a controller requires that it is the file's name.
    pub(super) name: String,
    pub(super) public: bool,
    pub(super) declarations: Vec<Declaration>,
    /// The assignments below the declarations, such as `NAME[1]=17`.
    pub(super) values: Vec<Statement>,
}

/// A routine: DEF … END or DEFFCT … ENDFCT.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Routine {
    pub(super) name: String,
    pub(super) line: usize,
    pub(super) end_line: usize,
    pub(super) global: bool,
    /// For DEFFCT.
    pub(super) returns: Option<ReturnType>,
    pub(super) parameters: Vec<Parameter>,
    pub(super) declarations: Vec<Declaration>,
    pub(super) body: Vec<Statement>,
}

/// The return type of a function (DEFFCT): a type, or an array of CHAR.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReturnType {
    pub(super) type_name: String,
    pub(super) dimensions: Vec<Option<Expression>>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parameter {
    pub(super) name: String,
    /// Whether the parameter is passed by value (`:IN`); the default in KRL is by reference.
    pub(super) by_value: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Declaration {
    pub(super) line: usize,
    pub(super) global: bool,
    pub(super) kind: DeclarationContent,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum DeclarationContent {
    Variables {
        constant: bool,
        type_name: String,
        items: Vec<Item>,
    },
    /// A structure (STRUC) with its components and their types.
    Struc {
        name: String,
        components: Vec<(String, Item)>,
    },
    Enumeration {
        name: String,
        words: Vec<String>,
    },
    /// A signal: the name of one input or output, or of a range that ends at `to`. Both are `None` for `SIGNAL NAME
    /// FALSE`.
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
    /// A declaration of a routine of another file (EXT, EXTFCT), or of a CHANNEL.
    Foreign,
}

/// A declared variable or component: its name, dimensions and initial value.
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
    /// The arguments; `None` for an omitted argument, as in `F(1, ,3)`.
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
        /// Whether the arm is braked before the routine is called.
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
    /// A spline block: SPLINE or PTP_SPLINE … ENDSPLINE.
    Spline {
        with: Vec<(VariableRef, Expression)>,
        body: Vec<Statement>,
    },
    WaitSeconds(Expression),
    WaitFor(Expression),
    /// A statement that cannot be executed; only its expressions are checked. Contains its first word, and its values
    /// with their required types.
    Checked {
        word: &'static str,
        values: Vec<(Expression, &'static str)>,
    },
    /// A statement that was not parsed, and was reported.
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
    /// `DISTANCE=0` or `DISTANCE=1`: the trigger fires at the start or the end of the motion.
    Distance(Expression),
    /// `PATH=-10`: the trigger fires at this distance from the start or the end of the motion, mm.
    Path(Expression),
}

/// A motion statement of the program.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MotionStatement {
    /// The first keyword of the motion.
    pub(super) word: &'static str,
    pub(super) path: PathKind,
    /// The auxiliary point through which a circle passes.
    pub(super) auxiliary: Option<Expression>,
    pub(super) target: Expression,
    /// `CA`: the angle of a circular motion.
    pub(super) angle: Option<Expression>,
    pub(super) approximates: Vec<Approximation>,
    /// The settings of a spline motion, such as `WITH $VEL.CP=0.2`.
    pub(super) with: Vec<(VariableRef, Expression)>,
}

impl MotionStatement {
    /// Returns the motion if the interpreter can execute it; `None` if the statement is only checked.
    pub(super) fn executed(&self) -> Option<Motion> {
        let motion = match self.word {
            "PTP" => Motion::Ptp,
            "LIN" => Motion::Lin,
            _ => return None,
        };
        (self.approximates.len() < 2).then_some(motion)
    }
}

/// The shape of a motion's path, and whether the motion is absolute, relative or part of a spline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PathKind {
    /// A synchronous motion of all axes; the target may be axis angles or a pose.
    Joint,
    Line,
    Circle,
    /// SPL.
    Curve,
}

/// A motion that the interpreter can execute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Axes together.
    Ptp,
    /// A motion of the TCP on a straight line.
    Lin,
}

/// The criterion by which the end of a motion is approximated.
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

/// A reference to a variable, or to a component or element of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VariableRef {
    pub(super) name: String,
    pub(super) steps: Vec<Step>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    Component(String),
    /// The indices of an element, `[1,2]`. An omitted index selects the whole array (`[]`, `[,]`) or a row of it
    /// (`[3,]`).
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
    /// A channel of COPEN, such as `:SER_1`.
    Channel,
    /// An expression that was not parsed, and was reported.
    NotRead,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unary {
    Minus,
    Not,
    BitNot,
}

/// A binary operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Binary {
    /// `*`
    Multiply,
    /// `/`: division; if both operands are INT, the result is truncated.
    Divide,
    /// `+`
    Plus,
    /// `-`
    Minus,
    /// `:`: the geometric operator, which combines two frames.
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
    /// Returns the nested blocks of this statement.
    pub(super) fn statement_blocks(&self) -> Vec<&[Statement]> {
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
