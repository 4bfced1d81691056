//! Compiles calls of routines, and checks the number of arguments, their types, and how they are passed (by value or by
//! reference).

use super::super::code::Op;
use super::super::routines::{ArgumentPassing, Builtin, KnownRoutine, find_routine};
use super::super::syntax::{Call, Expression, VariableRef};
use super::super::types::Type;
use super::compiler::{Argument, Compiler, cells_u32};

impl Compiler<'_> {
    /// Compiles a call and returns the type of the routine's result; `None` if it has no result. `wanted` is the type
    /// that the caller expects.
    pub(super) fn call(&mut self, call: &Call, wanted: Type) -> Option<Type> {
        if let Some(index) = self.visible_routine(&call.name) {
            return self.call_routine(call, index);
        }
        if let Some(known) = find_routine(&call.name) {
            return self.compile_builtin_call(call, known, wanted);
        }
        self.record_unexecuted(&call.name);
        if let Some(other) = self.routine_places.get(&call.name).and_then(|places| places.first()) {
            let file = &self.files[self.routines[*other].file].name;
            let message = format!(
                "this routine is local to {file}; to call it from other files, write GLOBAL before its DEF"
            );
            self.warn_once(&call.name, message);
        } else {
            self.warn_once(&call.name, "this routine is defined in none of the given files; add its file");
        }
        call.arguments.iter().flatten().for_each(|given| self.compile_untyped_argument(given));
        Some(Type::Unknown)
    }

    /// Returns the routine with this name that is visible in this file: a local one, or else a global one.
    pub(super) fn visible_routine(&self, name: &str) -> Option<usize> {
        let places = self.routine_places.get(name)?;
        let own = places.iter().find(|place| self.routines[**place].file == self.file);
        own.or_else(|| places.iter().find(|place| self.routines[**place].global)).copied()
    }

    fn call_routine(&mut self, call: &Call, index: usize) -> Option<Type> {
        let signature = &self.routines[index];
        let (given, wanted, returns) = (call.arguments.len(), signature.arguments.len(), signature.returns);
        if given > wanted {
            self.problem(&call.name, format!("found {given} arguments, expected {wanted}"));
        }
        if given != wanted || call.arguments.contains(&None) {
            // The routine calls VARSTATE to find out which arguments were passed.
            self.record_unexecuted(&call.name);
        }
        for (place, given) in call.arguments.iter().enumerate() {
            let Some(given) = given else { continue };
            if let Some(wanted) = self.routines[index].arguments.get(place).cloned() {
                self.argument(&call.name, given, &wanted);
            }
        }
        self.emit(Op::Call(cells_u32(index)));
        returns
    }

    /// Compiles an argument whose expected type is unknown: a value, a variable or an array.
    fn compile_untyped_argument(&mut self, given: &Expression) {
        if let Expression::Variable(place) = given {
            self.address(place);
        } else {
            self.value(given, Type::Unknown);
        }
    }

    fn argument(&mut self, routine: &str, given: &Expression, wanted: &Argument) {
        if !wanted.dimensions.is_empty() && (wanted.by_value || !matches!(given, Expression::Variable(_))) {
            return self.array_by_value(given, wanted);
        }
        if wanted.by_value {
            return self.typed_value(given, wanted.kind, &wanted.name);
        }
        let Expression::Variable(place) = given else {
            let message = format!("{routine} needs a variable for this argument (:OUT), found a value");
            self.warn(&wanted.name, message);
            self.record_unexecuted(routine);
            self.value(given, wanted.kind);
            return;
        };
        let Some(found) = self.address(place) else { return };
        if !found.writable {
            // This is only a warning, because it is not checked whether the routine writes the argument.
            self.warn(
                &place.name,
                format!(
                    "{routine} needs a variable for this argument, but this variable is a constant or read-only"
                ),
            );
            self.record_unexecuted(routine);
        }
        self.same_variable(place, found.kind, wanted.kind);
        if found.dimensions.len() != wanted.dimensions.len() {
            self.problem(&place.name, "pass an array as NAME[ ], and only to an array parameter");
        }
    }

    /// Compiles an argument that is passed by value and is a string or a whole array.
    fn array_by_value(&mut self, given: &Expression, wanted: &Argument) {
        self.record_unexecuted("an array that is passed by value");
        let found = match given {
            Expression::Variable(place) => match self.address(place) {
                Some(found) if found.dimensions.is_empty() && found.kind != Type::Unknown => {
                    return self.problem(&place.name, "expected an array; pass it as NAME[ ]");
                }
                Some(found) => found.kind,
                None => return,
            },
            _ => self.value(given, Type::Text),
        };
        let is_text = wanted.kind == Type::Char && matches!(found, Type::Text | Type::Char);
        let is_known = found != Type::Unknown && wanted.kind != Type::Unknown;
        if is_known && !is_text && !self.types.are_same_type(found, wanted.kind) {
            self.report_type_mismatch(found, wanted.kind, &wanted.name);
        }
    }

    /// Checks that a variable that is passed by reference has the expected type, or a type that the controller converts
    /// to it.
    fn same_variable(&mut self, place: &VariableRef, found: Type, wanted: Type) {
        if found == Type::Unknown || wanted == Type::Unknown || self.types.are_same_type(found, wanted) {
            return;
        }
        self.record_unexecuted(&place.name);
        let (given, needed) = (self.types.name(found), self.types.name(wanted));
        let message = format!("expected a variable of type {needed}, found {given}");
        let is_number = |kind: Type| matches!(kind, Type::Int | Type::Real | Type::Char);
        if self.types.are_convertible(found, wanted) || (is_number(found) && is_number(wanted)) {
            self.warn(&place.name, message);
        } else {
            self.problem(&place.name, message);
        }
    }

    fn compile_builtin_call(&mut self, call: &Call, known: &'static KnownRoutine, wanted: Type) -> Option<Type> {
        if known.of_ethernet_krl_6 {
            self.warn_once(
                &call.name,
                "this name belongs to EthernetKRL 6 (iiQKA.OS2) and does not exist in KSS 8",
            );
        }
        let (given, accepted) = (call.arguments.len(), known.argument_passing.len());
        if given > accepted && !known.accepts_more {
            self.problem(&call.name, format!("found {given} arguments, expected {accepted}"));
        } else if given < known.min_arguments {
            self.warn(&call.name, format!("found {given} arguments, expected {}", known.min_arguments));
        }
        for (place, given) in call.arguments.iter().enumerate() {
            let Some(given) = given else { continue };
            match known.argument_passing.get(place) {
                Some(wants) => self.compile_builtin_argument(call, given, *wants),
                None => self.compile_untyped_argument(given),
            }
        }
        self.check_varstate_text(call, known);
        match known.builtin {
            Some(builtin)
                if executed_argument_count(builtin, known) == given && !call.arguments.contains(&None) =>
            {
                self.emit(Op::Builtin(builtin));
            }
            _ => self.record_unexecuted(&call.name),
        }
        let returns = known.returns.map(|name| self.types.kuka_type(name));
        let of_6 = self.files[self.file].of_ethernet_krl_6;
        if known.returns == Some("EKI_STATUS") && (of_6 || wanted == Type::Int) {
            if !of_6 {
                let message = "this function returns an INT only in EthernetKRL 6 (iiQKA.OS2); in KSS 8, it returns an \
                               EKI_STATUS";
                self.warn_once(&call.name, message);
            }
            self.record_unexecuted(&call.name);
            return Some(Type::Unknown);
        }
        returns
    }

    /// Checks the argument of VARSTATE: it must be the name of a variable, and an index in it must be a number.
    fn check_varstate_text(&mut self, call: &Call, known: &KnownRoutine) {
        let Some(Some(Expression::Text(text))) = call.arguments.first() else { return };
        let index = text.split_once('[').and_then(|(_, behind)| behind.split_once(']')).map(|(index, _)| index);
        let is_number = |index: &str| index.chars().all(|c| c.is_ascii_digit() || matches!(c, ',' | ' '));
        if known.builtin == Some(Builtin::Varstate) && index.is_some_and(|index| !is_number(index)) {
            let message = format!(
                "VARSTATE takes the name of a variable, and \"{text}\" contains an expression: write the index as a \
                 number"
            );
            self.problem(&call.name, message);
        }
    }

    fn compile_builtin_argument(&mut self, call: &Call, given: &Expression, wanted: ArgumentPassing) {
        match wanted {
            ArgumentPassing::Any => {
                self.compile_untyped_argument(given);
                self.record_unexecuted(&call.name);
            }
            ArgumentPassing::Value("NUMBER") => {
                let kind = self.value(given, Type::Real);
                if kind == Type::Int {
                    self.emit(Op::ToReal(0));
                } else if ![Type::Real, Type::Unknown].contains(&kind) {
                    self.problem(&call.name, "a number is expected");
                }
            }
            ArgumentPassing::Value("FRAME") => {
                let frame = self.types.kuka_type("FRAME");
                let kind = self.value(given, frame);
                let cells = cells_u32(self.types.size(kind));
                if self.types.is_pose(kind) {
                    self.emit(Op::Keep { first: 6, of: cells });
                } else if kind != Type::Unknown {
                    self.problem(&call.name, "expected a FRAME, POS or E6POS");
                }
            }
            ArgumentPassing::Value(name) => {
                let kind = self.types.kuka_type(name);
                self.typed_value(given, kind, &call.name);
            }
            ArgumentPassing::Variable(name) | ArgumentPassing::Filled(name) => {
                self.compile_builtin_variable(call, given, name)
            }
        }
    }

    fn compile_builtin_variable(&mut self, call: &Call, given: &Expression, name: &str) {
        let kind = self.types.kuka_type(name);
        let Expression::Variable(place) = given else {
            let message = format!("expected a variable of type {name}");
            self.value(given, kind);
            return self.problem(&call.name, message);
        };
        let Some(found) = self.address(place) else { return };
        if kind == Type::Text {
            self.record_unexecuted("a text in a variable");
            if ![Type::Char, Type::Unknown].contains(&found.kind) {
                self.report_type_mismatch(found.kind, Type::Char, &place.name);
            }
        } else {
            self.same_variable(place, found.kind, kind);
        }
        self.check_writable(
            &place.name,
            &found,
            "the call writes this variable, but the variable is a constant or read-only",
        );
    }
}

/// Returns the number of arguments of a controller routine that the interpreter uses.
fn executed_argument_count(builtin: Builtin, known: &KnownRoutine) -> usize {
    match builtin {
        Builtin::Bas => 2,
        _ => known.min_arguments,
    }
}
