//! Calls: the number of arguments, their types, and whether they are handed over by value or as a variable.

use super::super::code::Op;
use super::super::syntax::{Call, Expression};
use super::super::system::{BUILTINS, Row, Wants, wanted_type};
use super::super::types::Type;
use super::compiler::{Argument, Compiler, cells_u32};

impl Compiler<'_> {
    /// Calls a routine; the type of what it gives back, `None` where it gives back nothing.
    pub(super) fn call(&mut self, call: &Call) -> Option<Type> {
        let own = self.routines.iter().position(|known| known.name == call.name && known.file == self.file);
        let any = || self.routines.iter().position(|known| known.name == call.name && known.global);
        if let Some(index) = own.or_else(any) {
            let signature = self.routines[index].clone();
            self.check_count(call, signature.arguments.len());
            for (given, wanted) in call.arguments.iter().zip(&signature.arguments) {
                self.argument(&call.name, given, wanted);
            }
            self.emit(Op::Call(cells_u32(index)));
            return signature.returns;
        }
        if let Some(row) = BUILTINS.iter().find(|(name, ..)| *name == call.name) {
            return self.call_builtin(call, row);
        }
        if self.routines.iter().any(|known| known.name == call.name) {
            self.problem(&call.name, "this routine is seen in its own file only; it needs GLOBAL before DEF");
        } else {
            self.warn(&call.name, "this routine is defined in none of the files named; name its file, too");
        }
        for given in &call.arguments {
            self.value(given, Type::Unknown);
        }
        Some(Type::Unknown)
    }

    fn check_count(&mut self, call: &Call, wanted: usize) {
        let given = call.arguments.len();
        if given != wanted {
            self.problem(&call.name, format!("{given} arguments are given, {wanted} are wanted"));
        }
    }

    fn argument(&mut self, routine: &str, given: &Expression, wanted: &Argument) {
        if wanted.by_value {
            return self.typed_value(given, wanted.kind, &wanted.name);
        }
        let Expression::Variable(place) = given else {
            return self.problem(
                &wanted.name,
                format!("{routine} takes this argument as a variable (:OUT); a value cannot be handed over"),
            );
        };
        let Some(found) = self.address(place) else { return };
        if !found.writable {
            self.problem(
                &place.name,
                format!("{routine} takes this argument as a variable; this one is never written"),
            );
        }
        if found.kind != wanted.kind && ![found.kind, wanted.kind].contains(&Type::Unknown) {
            let (given, wanted) = (self.types.name(found.kind), self.types.name(wanted.kind));
            self.problem(&place.name, format!("a variable of type {wanted} is wanted, this one is {given}"));
        }
        if found.dimensions.len() != wanted.dimensions.len() {
            self.problem(&place.name, "an array is handed over as NAME[ ], and only where one is wanted");
        }
    }

    fn call_builtin(&mut self, call: &Call, row: &Row) -> Option<Type> {
        let (_, builtin, wants, returns) = *row;
        let optional = usize::from(call.name == "EKI_CHECK" && call.arguments.len() == 3);
        self.check_count(call, wants.len() + optional);
        for (given, wanted) in call.arguments.iter().zip(wants) {
            self.builtin_argument(call, given, *wanted);
        }
        self.emit(Op::Builtin(builtin));
        if returns.is_empty() { None } else { self.types.find(returns) }
    }

    fn builtin_argument(&mut self, call: &Call, given: &Expression, wanted: Wants) {
        match wanted {
            Wants::Value("NUMBER") => {
                let kind = self.value(given, Type::Real);
                if kind == Type::Int {
                    self.emit(Op::ToReal(0));
                } else if ![Type::Real, Type::Unknown].contains(&kind) {
                    self.problem(&call.name, "a number is wanted");
                }
            }
            Wants::Value("FRAME") => {
                let frame = self.types.find("FRAME").unwrap_or(Type::Unknown);
                let kind = self.value(given, frame);
                let cells = cells_u32(self.types.size(kind));
                if self.types.is_pose(kind) {
                    self.emit(Op::Keep { first: 6, of: cells });
                } else if kind != Type::Unknown {
                    self.problem(&call.name, "a FRAME, POS or E6POS is wanted");
                }
            }
            Wants::Value(name) => {
                let kind = wanted_type(&self.types, name).unwrap_or(Type::Unknown);
                self.typed_value(given, kind, &call.name);
            }
            Wants::Variable(name) | Wants::Filled(name) => {
                let kind = wanted_type(&self.types, name).unwrap_or(Type::Unknown);
                let Expression::Variable(place) = given else {
                    return self.problem(&call.name, format!("a variable of type {name} is wanted"));
                };
                let Some(found) = self.address(place) else { return };
                if found.kind != kind && found.kind != Type::Unknown {
                    let given = self.types.name(found.kind);
                    self.problem(&place.name, format!("a variable of type {name} is wanted, this one is {given}"));
                }
                if !found.writable {
                    self.problem(&place.name, "this variable is never written, and the call writes it");
                }
            }
        }
    }
}
