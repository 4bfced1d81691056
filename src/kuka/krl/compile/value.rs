//! Compiles expressions, which push a value on the stack, and the operators between two values.

use super::super::code::{Cell, Op};
use super::super::syntax::{Binary, Expression, MAX_AGGREGATE_VALUES, Step, Unary, VariableRef};
use super::super::types::{Component, Type};
use super::compiler::{Compiler, cells_u32};

impl Compiler<'_> {
    /// Compiles an expression and returns its type. `wanted` is the expected type; it determines the enumeration of a
    /// constant, the structure of an aggregate, and whether a string of one character is a CHAR.
    pub(super) fn value(&mut self, expression: &Expression, wanted: Type) -> Type {
        match expression {
            Expression::Int(number) => self.push(Cell::Int(*number), Type::Int),
            Expression::Real(number) => self.push(Cell::Real(*number), Type::Real),
            Expression::Bool(value) => self.push(Cell::Bool(*value), Type::Bool),
            Expression::Text(text) => self.text_value(text, wanted),
            Expression::Word(word) => self.compile_constant(word, wanted),
            Expression::Variable(place) => self.variable_value(place),
            Expression::Call(call) => match self.call(call, wanted) {
                Some(kind) => kind,
                None => {
                    self.problem(&call.name, "this routine returns no value");
                    Type::Unknown
                }
            },
            Expression::Aggregate { type_name, parts } => self.aggregate(type_name.as_deref(), parts, wanted),
            Expression::Unary(operator, inner) => self.compile_unary(*operator, inner),
            Expression::Binary(operator, left, right) => self.binary(*operator, left, right),
            Expression::Channel => self.unknown("a channel"),
            Expression::NotRead => self.unknown("an expression that was not parsed"),
        }
    }

    fn push(&mut self, cell: Cell, kind: Type) -> Type {
        self.emit(Op::Push(cell));
        kind
    }

    /// Compiles a value of unknown type.
    fn unknown(&mut self, what: &str) -> Type {
        self.record_unexecuted(what);
        self.push(Cell::Unset, Type::Unknown)
    }

    fn text_value(&mut self, text: &str, wanted: Type) -> Type {
        if wanted == Type::Char
            && let (Some(character), true) = (text.bytes().next(), text.len() == 1)
        {
            return self.push(Cell::Char(character), Type::Char);
        }
        let place = self.text_index(text);
        self.push(Cell::Text(place), Type::Text)
    }

    fn text_index(&mut self, text: &str) -> u32 {
        if let Some(place) = self.text_places.get(text) {
            return *place;
        }
        let place = cells_u32(self.program.texts.len());
        self.program.texts.push(text.to_owned());
        self.text_places.insert(text.to_owned(), place);
        place
    }

    fn compile_constant(&mut self, word: &str, wanted: Type) -> Type {
        if wanted == Type::Unknown {
            return self.unknown("an enumeration constant that cannot be resolved");
        }
        match self.constant_index(word, wanted) {
            Some(place) => self.push(Cell::Word(place), wanted),
            None => self.unknown("an enumeration constant that cannot be resolved"),
        }
    }

    /// Returns the index of a constant in its enumeration; reports a problem if the enumeration has no such constant.
    pub(super) fn constant_index(&mut self, word: &str, kind: Type) -> Option<u16> {
        if kind == Type::Unknown {
            return None;
        }
        if let Some(place) = self.types.constant_index(kind, word) {
            return Some(place);
        }
        let (is_kukas, known) = self
            .types
            .enumeration(kind)
            .map_or((false, String::new()), |known| (known.kuka, known.describe_constants()));
        let (key, name) = (format!("#{word}"), self.types.name(kind));
        if is_kukas {
            self.warn_once(
                &key,
                format!("not checked: of the enumeration {name}, this program knows only the constants {known}"),
            );
        } else {
            let known = if known.is_empty() { String::new() } else { format!("; its constants are {known}") };
            self.problem(&key, format!("this is not a constant of the enumeration {name}{known}"));
        }
        None
    }

    fn variable_value(&mut self, place: &VariableRef) -> Type {
        let Some(found) = self.address(place) else { return Type::Unknown };
        if found.dimensions.is_empty() {
            self.load(found.kind);
            return found.kind;
        }
        if found.kind == Type::Char {
            self.record_unexecuted("a string in a variable");
            return Type::Text;
        }
        if found.kind != Type::Unknown {
            let is_written = place.steps.iter().any(|step| matches!(step, Step::Index(_)));
            let message = if is_written {
                "a whole array cannot be used as a value"
            } else {
                "a whole array cannot be used as a value; add an index"
            };
            self.problem(&place.name, message);
        }
        Type::Unknown
    }

    /// Infers the type of an aggregate from its components, for an aggregate without a stated or expected type.
    pub(super) fn infer_aggregate_type(&self, parts: &[(VariableRef, Expression)]) -> Type {
        let has = |name: &str| parts.iter().any(|(place, _)| place.name == name);
        let any = |names: &[&str]| names.iter().any(|name| has(name));
        let has_extra = any(&["E1", "E2", "E3", "E4", "E5", "E6"]);
        let name = if any(&["X", "Y", "Z", "A", "B", "C", "S", "T"]) {
            match (has_extra, any(&["S", "T"])) {
                (true, _) => "E6POS",
                (false, true) => "POS",
                (false, false) => "FRAME",
            }
        } else if has_extra {
            "E6AXIS"
        } else {
            "AXIS"
        };
        self.types.kuka_type(name)
    }

    fn aggregate(&mut self, type_name: Option<&str>, parts: &[(VariableRef, Expression)], wanted: Type) -> Type {
        let kind = type_name.map_or(wanted, |name| self.resolve_type(name));
        let Some(size) = self.types.structure(kind).map(|struc| struc.size.max(struc.components.len())) else {
            if kind != Type::Unknown {
                let name = self.types.name(kind);
                self.problem("{", format!("expected {name}, found components in braces"));
            }
            parts.iter().for_each(|(_, value)| {
                self.value(value, Type::Unknown);
            });
            return self.unknown("components of an unknown type");
        };
        let is_wide = size > MAX_AGGREGATE_VALUES;
        if is_wide {
            self.record_unexecuted("{…}");
        }
        for (place, value) in parts {
            let component = self.resolve_component(&place.name, kind, &place.name);
            if component.is_none() || !place.steps.is_empty() {
                self.record_unexecuted("{…}");
            }
            if let Some(Component { kind, dimensions, .. }) = component.filter(|_| is_wide) {
                self.part(place, value, kind, &dimensions);
            }
        }
        if is_wide {
            return kind;
        }
        let components = self.types.structure(kind).map(|struc| struc.components.clone()).unwrap_or_default();
        for component in &components {
            let given = parts.iter().find(|(place, _)| place.name == component.name);
            match given {
                Some((place, value)) => self.part(place, value, component.kind, &component.dimensions),
                None => {
                    for _ in 0..self.types.cells(component.kind, &component.dimensions) {
                        self.emit(Op::Push(Cell::Unset));
                    }
                }
            }
        }
        kind
    }

    /// Compiles one component of an aggregate, for example `X 1`, `NAME[] "abc"` or `LIST[2] 7`.
    fn part(&mut self, place: &VariableRef, value: &Expression, kind: Type, dimensions: &[usize]) {
        match place.steps.first() {
            None if dimensions.is_empty() => self.typed_value(value, kind, &place.name),
            Some(Step::Component(_)) => {
                self.value(value, Type::Unknown);
            }
            _ if kind == Type::Char => {
                self.record_unexecuted("a text in a component");
                let given = self.value(value, Type::Text);
                if ![Type::Text, Type::Char, Type::Int, Type::Unknown].contains(&given) {
                    self.report_type_mismatch(given, Type::Text, &place.name);
                }
            }
            _ => {
                self.record_unexecuted("{…}");
                self.typed_value(value, kind, &place.name);
            }
        }
    }

    fn compile_unary(&mut self, operator: Unary, inner: &Expression) -> Type {
        let kind = self.value(inner, Type::Unknown);
        let (op, sign, allowed): (Op, &str, &[Type]) = match operator {
            Unary::Minus => (Op::Negate, "-", &[Type::Int, Type::Real]),
            Unary::Not => (Op::Not, "NOT", &[Type::Bool]),
            Unary::BitNot => (Op::BitNot, "B_NOT", &[Type::Int, Type::Char]),
        };
        self.emit(op);
        if kind == Type::Char {
            self.record_unexecuted("a calculation with CHAR");
        }
        if kind != Type::Unknown && !allowed.contains(&kind) {
            let name = self.types.name(kind);
            self.problem(sign, format!("the operator {sign} is not valid for {name}"));
            return Type::Unknown;
        }
        kind
    }

    /// Compiles an expression that must have this type; INT and REAL are converted to each other, as KRL does.
    pub(super) fn typed_value(&mut self, expression: &Expression, wanted: Type, key: &str) {
        let found = self.value(expression, wanted);
        self.convert(found, wanted, key);
    }

    fn convert(&mut self, found: Type, wanted: Type, key: &str) {
        if found == Type::Unknown || wanted == Type::Unknown || self.types.are_same_type(found, wanted) {
            return;
        }
        match (found, wanted) {
            (Type::Int, Type::Real) => {
                self.emit(Op::ToReal(0));
            }
            (Type::Real, Type::Int) => {
                self.emit(Op::ToInt);
            }
            (Type::Int, Type::Char) | (Type::Char, Type::Int | Type::Real) | (Type::Text, Type::Char) => {
                self.record_unexecuted("a conversion between CHAR and another type");
            }
            // A single character is required, but the value is a string.
            (Type::Char, Type::Text) => self.record_unexecuted("a string in a variable"),
            _ if self.types.are_convertible(found, wanted) => self.resize(found, wanted),
            _ => self.report_type_mismatch(found, wanted, key),
        }
    }

    /// Converts a pose or axis position to another type. The components of the shorter type are the first components of
    /// the longer one.
    fn resize(&mut self, found: Type, wanted: Type) {
        let [from, to] = [found, wanted].map(|kind| cells_u32(self.types.size(kind)));
        if from > to {
            self.emit(Op::Keep { first: to, of: from });
        }
        for _ in from..to {
            self.emit(Op::Push(Cell::Unset));
        }
    }

    pub(super) fn report_type_mismatch(&mut self, found: Type, wanted: Type, key: &str) {
        let (found, wanted) = (self.types.name(found), self.types.name(wanted));
        self.problem(key, format!("expected {wanted}, found {found}"));
    }
}

impl Compiler<'_> {
    pub(super) fn binary(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        match operator {
            Binary::And | Binary::Or => self.compile_logical(operator, left, right),
            Binary::Geometric => self.compile_geometric(left, right),
            Binary::Equal | Binary::Unequal => {
                // A constant belongs to the enumeration of the other operand, and a string of one character is a CHAR
                // if the other operand is a CHAR.
                let is_of_other = matches!(left, Expression::Word(_) | Expression::Text(_));
                let (left, right) = if is_of_other { (right, left) } else { (left, right) };
                self.compare(operator, left, right)
            }
            Binary::Less | Binary::AtMost | Binary::Greater | Binary::AtLeast => {
                self.compare(operator, left, right)
            }
            Binary::Multiply | Binary::Divide | Binary::Plus | Binary::Minus => {
                let (left, right) = self.compile_operands(left, right);
                let kind = self.number(operator, left, right);
                self.emit(Op::Binary(operator));
                kind
            }
            Binary::Exor => self.compile_same_type(operator, left, right, Type::Bool),
            Binary::BitAnd | Binary::BitOr | Binary::BitExor => {
                self.compile_same_type(operator, left, right, Type::Int)
            }
        }
    }

    fn compile_operands(&mut self, left: &Expression, right: &Expression) -> (Type, Type) {
        let left = self.value(left, Type::Unknown);
        (left, self.value(right, left))
    }

    /// Compiles an arithmetic operator: INT with REAL gives REAL, and CHAR is a number from 0 to 255.
    fn number(&mut self, operator: Binary, left: Type, right: Type) -> Type {
        match (left, right) {
            (Type::Unknown, _) | (_, Type::Unknown) => Type::Unknown,
            (Type::Int, Type::Int) => Type::Int,
            (Type::Real, Type::Real) => Type::Real,
            (Type::Int, Type::Real) => {
                self.emit(Op::ToReal(1));
                Type::Real
            }
            (Type::Real, Type::Int) => {
                self.emit(Op::ToReal(0));
                Type::Real
            }
            (Type::Char | Type::Int | Type::Real, Type::Char | Type::Int | Type::Real) => {
                self.record_unexecuted("a calculation with CHAR");
                if left == Type::Real || right == Type::Real { Type::Real } else { Type::Int }
            }
            _ => self.report_operand_mismatch(operator, left, right),
        }
    }

    fn report_operand_mismatch(&mut self, operator: Binary, left: Type, right: Type) -> Type {
        let (left, right) = (self.types.name(left), self.types.name(right));
        let hint = match operator {
            Binary::And | Binary::Or | Binary::Exor => {
                "; in KRL, comparisons have a lower precedence: put each comparison in brackets"
            }
            _ => "",
        };
        self.problem(sign(operator), format!("this operator is not valid between {left} and {right}{hint}"));
        Type::Unknown
    }

    fn compile_same_type(&mut self, operator: Binary, left: &Expression, right: &Expression, wanted: Type) -> Type {
        let (left, right) = self.compile_operands(left, right);
        self.emit(Op::Binary(operator));
        if wanted == Type::Int && (left == Type::Char || right == Type::Char) {
            self.record_unexecuted("a calculation with CHAR");
        }
        let fits =
            |kind: Type| kind == wanted || kind == Type::Unknown || (wanted == Type::Int && kind == Type::Char);
        if fits(left) && fits(right) { wanted } else { self.report_operand_mismatch(operator, left, right) }
    }

    fn compile_logical(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        let kind = self.value(left, Type::Bool);
        let jump = self.emit(Op::JumpDecided { decided: operator == Binary::Or, to: 0 });
        let other = self.value(right, Type::Bool);
        self.emit(Op::Binary(operator));
        self.set_jump_target(jump);
        let fits = |kind: Type| matches!(kind, Type::Bool | Type::Unknown);
        if fits(kind) && fits(other) { Type::Bool } else { self.report_operand_mismatch(operator, kind, other) }
    }

    fn compare(&mut self, operator: Binary, left: &Expression, right: &Expression) -> Type {
        let (left, right) = self.compile_operands(left, right);
        let ordered = !matches!(operator, Binary::Equal | Binary::Unequal);
        match (left, right) {
            (Type::Struc(_), Type::Struc(_)) if !ordered && self.types.are_same_type(left, right) => {
                self.record_unexecuted("a comparison of structures");
            }
            (Type::Text | Type::Char, Type::Text) | (Type::Text, Type::Char) => {
                self.record_unexecuted("a comparison of texts");
            }
            _ if self.types.are_same_type(left, right)
                && (!ordered || matches!(left, Type::Int | Type::Real | Type::Char | Type::Enumeration(_))) => {}
            _ => {
                self.number(operator, left, right);
            }
        }
        self.emit(Op::Binary(operator));
        Type::Bool
    }

    /// Compiles the geometric operator, as in `POS:FRAME`: two operands of six numbers each give six numbers.
    fn compile_geometric(&mut self, left: &Expression, right: &Expression) -> Type {
        let frame = self.types.kuka_type("FRAME");
        let mut sides = [Type::Unknown; 2];
        for (side, expression) in sides.iter_mut().zip([left, right]) {
            *side = self.value(expression, frame);
            let cells = cells_u32(self.types.size(*side));
            if self.types.is_pose(*side) && cells > 6 {
                self.emit(Op::Keep { first: 6, of: cells });
            }
        }
        self.emit(Op::Geometric);
        let fits = |kind: Type| kind == Type::Unknown || self.types.is_pose(kind);
        if sides.into_iter().all(fits) {
            frame
        } else {
            self.report_operand_mismatch(Binary::Geometric, sides[0], sides[1])
        }
    }
}

fn sign(operator: Binary) -> &'static str {
    match operator {
        Binary::Multiply => "*",
        Binary::Divide => "/",
        Binary::Plus => "+",
        Binary::Minus => "-",
        Binary::Geometric => ":",
        Binary::And => "AND",
        Binary::Or => "OR",
        Binary::Exor => "EXOR",
        Binary::BitAnd => "B_AND",
        Binary::BitOr => "B_OR",
        Binary::BitExor => "B_EXOR",
        Binary::Equal => "==",
        Binary::Unequal => "<>",
        Binary::Less => "<",
        Binary::AtMost => "<=",
        Binary::Greater => ">",
        Binary::AtLeast => ">=",
    }
}
