//! What a KRL file says, as a tree. All names are in upper case; every part keeps its line, from 1.

/// A file that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct File {
    /// As the user wrote its name.
    pub name: String,
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
        let (mut constants, mut variables) = (0, 0);
        for declaration in &data.declarations {
            if let Declared::Variables { constant, items, .. } = &declaration.kind {
                *(if *constant { &mut constants } else { &mut variables }) += items.len();
            }
        }
        format!("a data list: {constants} constants, {variables} variables")
    }
}

/// DEFDAT … ENDDAT.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Data {
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
    /// The type's name, for DEFFCT.
    pub(super) returns: Option<String>,
    pub(super) parameters: Vec<Parameter>,
    pub(super) declarations: Vec<Declaration>,
    pub(super) body: Vec<Statement>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parameter {
    pub(super) name: String,
    /// `:IN`, by value; else by reference, which is also what KRL takes where nothing is said.
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
    /// EXT and EXTFCT: a routine that is defined elsewhere.
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
    pub(super) arguments: Vec<Expression>,
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
    InterruptDeclaration {
        global: bool,
        number: Expression,
        condition: Expression,
        call: Call,
    },
    InterruptSwitch {
        on: bool,
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
        distance: Expression,
        delay: Expression,
        action: Box<Statement>,
        priority: Option<Expression>,
    },
    Motion {
        motion: Motion,
        target: Expression,
        approximates: Option<Approximation>,
    },
    WaitSeconds(Expression),
    WaitFor(Expression),
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Case {
    pub(super) line: usize,
    pub(super) values: Vec<Expression>,
    pub(super) body: Vec<Statement>,
}

/// A motion statement.
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
}

/// A variable and the way to a part of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VariableRef {
    pub(super) name: String,
    pub(super) steps: Vec<Step>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    Component(String),
    Index(Vec<Expression>),
    /// `[]`: the whole array.
    Whole,
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
    Aggregate { type_name: Option<String>, parts: Vec<(VariableRef, Expression)> },
    Unary(Unary, Box<Expression>),
    Binary(Binary, Box<Expression>, Box<Expression>),
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
