//! The numbers that a data list states, each with its line, so that another program can compare them without
//! executing anything.

use super::syntax::{Action, DeclarationContent, Expression, File, Step, Unary};

/// A number of a data list.
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

/// A value of a data list that is no plain number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnreadValue {
    /// The name of the variable, in upper case.
    pub name: String,
    /// The index in a one-dimensional array; `None` for a single variable, and for an index that is no plain number.
    pub index: Option<i32>,
    /// Line, from 1.
    pub line: usize,
}

impl File {
    /// Returns the values of the data list that are no plain numbers, in the order of the text: [`File::stated_values`]
    /// omits them, and each of them may replace a number that was stated before.
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

    /// Returns the numbers of the data list, in the order of the text; empty for a program. Values that are not
    /// plain numbers are omitted.
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

    /// Returns whether the data list declares this variable; the name is in upper case.
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
        // The number as it is written, and not as its 32-bit value.
        Expression::Real(value) => value.to_string().parse().ok(),
        Expression::Unary(Unary::Minus, value) => number(value).map(|value| -value),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse;

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
