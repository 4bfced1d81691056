//! The outline of a file: its declarations, its routines with their cases, the calls of its main routine, and the
//! numbers in a data list, each with its line. Other code can compare an outline with other files without executing the
//! program.

use super::syntax::{Action, DeclarationContent, Expression, File, Item, Statement, Step, Unary};
use std::fmt;

/// A variable that a data list declares.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeclaredVariable {
    /// The name of the variable, in upper case.
    pub name: String,
    /// Line, from 1.
    pub line: usize,
    /// The name of its type, in upper case.
    pub type_name: String,
    /// Whether the variable is GLOBAL: other files see it if the data list is PUBLIC.
    pub global: bool,
    /// CONST.
    pub constant: bool,
    /// The size of each dimension of an array; 0 if the size is not a plain number. Empty for a single variable.
    pub sizes: Vec<i32>,
}

/// Formats the declaration without its value, for example `DECL GLOBAL CONST INT N`.
impl fmt::Display for DeclaredVariable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = |has: bool, word: &'static str| if has { word } else { "" };
        let (global, constant) = (word(self.global, "GLOBAL "), word(self.constant, "CONST "));
        write!(f, "DECL {global}{constant}{} {}", self.type_name, self.name)?;
        let sizes: Vec<String> = self.sizes.iter().map(i32::to_string).collect();
        if sizes.is_empty() { Ok(()) } else { write!(f, "[{}]", sizes.join(",")) }
    }
}

/// A SWITCH statement of a routine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StatedSwitch {
    /// Line, from 1.
    pub line: usize,
    /// Whether the selector is the routine's first parameter alone.
    pub is_on_first_parameter: bool,
}

/// A CASE of a SWITCH whose value is a plain number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StatedCase {
    /// The number.
    pub value: i32,
    /// Line, from 1.
    pub line: usize,
    /// Whether the CASE contains no statement.
    pub is_empty: bool,
}

/// A routine of a program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatedRoutine {
    /// Line, from 1.
    pub line: usize,
    /// Whether the routine is visible in other files.
    pub global: bool,
    /// The number of the routine's parameters.
    pub parameters: usize,
    /// The SWITCH statements at the top level of the routine.
    pub switches: Vec<StatedSwitch>,
    /// The cases of the SWITCH statements whose selector is the first parameter.
    pub cases: Vec<StatedCase>,
}

/// A call in the main routine of a program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatedCall {
    /// The name of the called routine, in upper case.
    pub name: String,
    /// Line, from 1.
    pub line: usize,
    /// Whether the call is inside a loop.
    pub in_loop: bool,
}

impl File {
    /// Returns the line of DEFDAT, and whether it is PUBLIC; `None` for a program.
    pub fn data_list(&self) -> Option<(usize, bool)> {
        self.data.as_ref().map(|data| (data.line, data.public))
    }

    /// Returns the variables that the data list declares, in the order of the file.
    pub fn declared_variables(&self) -> Vec<DeclaredVariable> {
        let declarations = self.data.iter().flat_map(|data| &data.declarations);
        let of_each = declarations.filter_map(|declaration| match &declaration.kind {
            DeclarationContent::Variables { constant, type_name, items } => {
                Some((declaration, *constant, type_name, items))
            }
            _ => None,
        });
        of_each
            .flat_map(|(declaration, constant, type_name, items)| {
                items.iter().map(move |item| DeclaredVariable {
                    name: item.name.clone(),
                    line: declaration.line,
                    type_name: type_name.clone(),
                    global: declaration.global,
                    constant,
                    sizes: sizes(item),
                })
            })
            .collect()
    }

    /// Returns the routine with this name; the name must be in upper case.
    pub fn stated_routine(&self, name: &str) -> Option<StatedRoutine> {
        let place = self.routines.iter().position(|routine| routine.name == name)?;
        let routine = &self.routines[place];
        let first = routine.parameters.first().map(|parameter| parameter.name.as_str());
        let is_first = |on: &Expression| match on {
            Expression::Variable(on) => on.steps.is_empty() && Some(on.name.as_str()) == first,
            _ => false,
        };
        let switches = routine.body.iter().filter_map(|statement| match &statement.action {
            Action::Switch { on, .. } => {
                Some(StatedSwitch { line: statement.line, is_on_first_parameter: is_first(on) })
            }
            _ => None,
        });
        let cases = routine.body.iter().flat_map(|statement| match &statement.action {
            Action::Switch { on, cases, .. } if is_first(on) => cases.as_slice(),
            _ => &[],
        });
        let cases = cases.flat_map(|case| {
            let numbers = case.values.iter().filter_map(|value| match value {
                Expression::Int(value) => Some(*value),
                _ => None,
            });
            numbers.map(|value| StatedCase { value, line: case.line, is_empty: case.body.is_empty() })
        });
        Some(StatedRoutine {
            line: routine.line,
            // The first routine of a file is visible in all files.
            global: routine.global || place == 0,
            parameters: routine.parameters.len(),
            switches: switches.collect(),
            cases: cases.collect(),
        })
    }

    /// Returns the calls in all routines except the main routine, in the order of the file.
    pub fn other_calls(&self) -> Vec<StatedCall> {
        let mut calls = Vec::new();
        for routine in self.routines.iter().skip(1) {
            collect_calls(&routine.body, false, &mut calls);
        }
        calls
    }

    /// Returns the calls in the main routine (the first of the file), in the order of the file.
    pub fn main_calls(&self) -> Vec<StatedCall> {
        let mut calls = Vec::new();
        if let Some(main) = self.routines.first() {
            collect_calls(&main.body, false, &mut calls);
        }
        calls
    }
}

fn sizes(item: &Item) -> Vec<i32> {
    let size = |dimension: &Option<Expression>| match dimension {
        Some(Expression::Int(size)) => *size,
        _ => 0,
    };
    item.dimensions.iter().map(size).collect()
}

fn collect_calls(body: &[Statement], in_loop: bool, calls: &mut Vec<StatedCall>) {
    for Statement { line, action } in body {
        if let Action::Call(call) = action {
            calls.push(StatedCall { name: call.name.clone(), line: *line, in_loop });
        }
        let repeats = matches!(
            action,
            Action::Loop { .. } | Action::While { .. } | Action::Repeat { .. } | Action::For { .. }
        );
        for block in action.statement_blocks() {
            collect_calls(block, in_loop || repeats, calls);
        }
    }
}

/// A variable or array element of a data list whose value is a plain number.
#[derive(Debug, Clone, PartialEq)]
pub struct StatedValue {
    /// The name of the variable, in upper case.
    pub name: String,
    /// The index in a one-dimensional array; `None` for a single variable.
    pub index: Option<i32>,
    /// Line, from 1.
    pub line: usize,
    /// The number.
    pub value: f64,
}

/// A variable or array element of a data list whose value is not a plain number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnreadValue {
    /// The name of the variable, in upper case.
    pub name: String,
    /// The index in a one-dimensional array; `None` for a single variable, and for an index that is not a plain number.
    pub index: Option<i32>,
    /// Line, from 1.
    pub line: usize,
}

impl File {
    /// Returns the entries of the data list whose values are not plain numbers, in the order of the file.
    /// [`File::stated_values`] omits them; each of them may replace a number of an earlier line.
    pub fn unread_values(&self) -> Vec<UnreadValue> {
        let Some(data) = &self.data else { return Vec::new() };
        let declared = data.declarations.iter().flat_map(|declaration| {
            let items = match &declaration.kind {
                DeclarationContent::Variables { items, .. } => items.as_slice(),
                _ => &[],
            };
            let unread =
                items.iter().filter(|item| item.value.as_ref().is_some_and(|value| number(value).is_none()));
            unread.map(move |item| UnreadValue { name: item.name.clone(), index: None, line: declaration.line })
        });
        let assigned = data.values.iter().filter_map(|statement| {
            let Action::Assign { to, value } = &statement.action else { return None };
            let (is_plain, index) = match to.steps.as_slice() {
                [] => (true, None),
                [Step::Index(places)] => match places.as_slice() {
                    [Some(Expression::Int(place))] => (true, Some(*place)),
                    _ => (false, None),
                },
                _ => (false, None),
            };
            let is_read = is_plain && number(value).is_some();
            (!is_read).then(|| UnreadValue { name: to.name.clone(), index, line: statement.line })
        });
        declared.chain(assigned).collect()
    }

    /// Returns the numbers of the data list, in the order of the file; empty for a program. Values that are not plain
    /// numbers are omitted.
    pub fn stated_values(&self) -> Vec<StatedValue> {
        let Some(data) = &self.data else { return Vec::new() };
        let mut all = Vec::new();
        for declaration in &data.declarations {
            let DeclarationContent::Variables { items, .. } = &declaration.kind else { continue };
            let stated = items.iter().filter_map(|item| {
                let value = number(item.value.as_ref()?)?;
                Some(StatedValue { name: item.name.clone(), index: None, line: declaration.line, value })
            });
            all.extend(stated);
        }
        all.extend(data.values.iter().filter_map(|statement| {
            let Action::Assign { to, value } = &statement.action else { return None };
            let index = match to.steps.as_slice() {
                [] => None,
                [Step::Index(places)] => match places.as_slice() {
                    [Some(Expression::Int(place))] => Some(*place),
                    _ => return None,
                },
                _ => return None,
            };
            Some(StatedValue { name: to.name.clone(), index, line: statement.line, value: number(value)? })
        }));
        all
    }

    /// Returns whether the data list declares this variable; the name must be in upper case.
    pub fn declares_variable(&self, name: &str) -> bool {
        let declarations = self.data.iter().flat_map(|data| &data.declarations);
        let mut items = declarations.flat_map(|declaration| match &declaration.kind {
            DeclarationContent::Variables { items, .. } => items.as_slice(),
            _ => &[],
        });
        items.any(|item| item.name == name)
    }
}

fn number(value: &Expression) -> Option<f64> {
    match value {
        Expression::Int(value) => Some(f64::from(*value)),
        // The number is converted through its decimal text, so that it equals the number in the file instead of its
        // 32-bit value.
        Expression::Real(value) => value.to_string().parse().ok(),
        Expression::Unary(Unary::Minus, value) => number(value).map(|value| -value),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse;

    #[test]
    fn declarations_are_read_as_they_are_written() {
        let text = "DEFDAT A\nDECL GLOBAL CONST INT N=2\nREAL B[3],C\nENDDAT\n";
        let file = parse("a.dat", text);
        let found: Vec<String> = file.declared_variables().iter().map(ToString::to_string).collect();
        assert_eq!(found, ["DECL GLOBAL CONST INT N", "DECL REAL B[3]", "DECL REAL C"]);
        assert_eq!(file.data_list(), Some((1, false)));
    }

    #[test]
    fn cases_and_calls_are_read_with_their_lines() {
        let text = "DEF A( )\nB(1)\nLOOP\nIF TRUE THEN\nC( )\nENDIF\nENDLOOP\nEND\n\
                    DEF B(N:IN)\nDECL INT N\nSWITCH N\nCASE 0,1\nA( )\nCASE 2\nENDSWITCH\nEND\n";
        let file = parse("a.src", text);
        let calls: Vec<_> =
            file.main_calls().into_iter().map(|call| (call.name, call.line, call.in_loop)).collect();
        assert_eq!(calls, [("B".to_owned(), 2, false), ("C".to_owned(), 5, true)]);
        let b = file.stated_routine("B").expect("there");
        let cases: Vec<_> = b.cases.iter().map(|case| (case.value, case.line, case.is_empty)).collect();
        assert_eq!(cases, [(0, 12, false), (1, 12, false), (2, 14, true)]);
        assert_eq!((b.line, b.global, b.parameters), (9, false, 1));
        assert!(b.switches.iter().map(|it| (it.line, it.is_on_first_parameter)).eq([(11, true)]));
        let other = parse("a.src", &text.replace("SWITCH N", "SWITCH M")).stated_routine("B").expect("there");
        assert!(other.cases.is_empty() && !other.switches[0].is_on_first_parameter);
        let calls: Vec<_> = file.other_calls().into_iter().map(|call| (call.name, call.line)).collect();
        assert_eq!(calls, [("A".to_owned(), 13)]);
    }

    #[test]
    fn numbers_are_read_with_their_lines() {
        let text = "DEFDAT A PUBLIC\nDECL GLOBAL CONST INT N=2\nDECL GLOBAL REAL B[3]\nB[1]=-0.5 ; half\nB[2]=N\nDECL INT M\nENDDAT\n";
        let file = parse("a.dat", text);
        let found: Vec<_> =
            file.stated_values().into_iter().map(|it| (it.name, it.index, it.line, it.value)).collect();
        assert_eq!(found, [("N".to_owned(), None, 2, 2.0), ("B".to_owned(), Some(1), 4, -0.5)]);
        let unread: Vec<_> = file.unread_values().into_iter().map(|it| (it.name, it.index, it.line)).collect();
        assert_eq!(unread, [("B".to_owned(), Some(2), 5)]);
        assert!(file.declares_variable("M") && !file.declares_variable("K"));
    }
}
