//! Declares STRUC and ENUM of all files. A structure may refer to a structure that is declared after it.

use super::super::limits::ARRAY_VALUES;
use super::super::syntax::{Data, Declaration, DeclarationContent, Item};
use super::super::types::{NewComponent, Scope};
use super::compiler::Compiler;
use std::collections::BTreeMap;

/// A structure that is still to be declared.
struct PendingStructure<'a> {
    file: usize,
    routine: Option<usize>,
    line: usize,
    scope: Scope,
    name: &'a str,
    components: &'a [(String, Item)],
}

impl<'a> Compiler<'a> {
    pub(super) fn declare_types(&mut self) {
        let files: &'a [_] = self.files;
        let mut waiting = Vec::new();
        let mut place = 0;
        for (file, read) in files.iter().enumerate() {
            if let Some(data) = &read.data {
                let of_list = (file, None);
                data.declarations
                    .iter()
                    .for_each(|declaration| self.collect(of_list, Some(data), declaration, &mut waiting));
            }
            for routine in &read.routines {
                let of_routine = (file, Some(place));
                routine
                    .declarations
                    .iter()
                    .for_each(|declaration| self.collect(of_routine, None, declaration, &mut waiting));
                place += 1;
            }
        }
        self.declare_strucs(&waiting);
        self.routine = None;
    }

    /// Declares an enumeration; a structure waits until all enumerations are known.
    fn collect(
        &mut self,
        (file, routine): (usize, Option<usize>),
        data: Option<&Data>,
        declaration: &'a Declaration,
        waiting: &mut Vec<PendingStructure<'a>>,
    ) {
        (self.file, self.routine, self.line) = (file, routine, declaration.line);
        let is_seen = declaration.global || data.is_some_and(is_visible_everywhere);
        let scope = match routine {
            _ if is_seen => Scope::Everywhere,
            Some(place) => Scope::Routine { file, place },
            None => Scope::Module(self.modules[file]),
        };
        match &declaration.kind {
            DeclarationContent::Enumeration { name, words } => {
                self.check_name(name);
                let is_free = self.types.add_enumeration(scope, name, words.clone());
                self.report_if_taken(is_free, name);
            }
            DeclarationContent::Struc { name, components } => {
                waiting.push(PendingStructure { file, routine, line: declaration.line, scope, name, components });
            }
            _ => {}
        }
    }

    fn report_if_taken(&mut self, is_free: bool, name: &str) {
        let in_own_list = self.files[self.file].data.as_ref().is_some_and(is_visible_everywhere);
        if !is_free && !in_own_list {
            self.problem(name, "a type of this name is already declared");
        }
    }

    /// Declares each structure after the structures to which it refers. The structures that remain refer to each other
    /// in a circle.
    fn declare_strucs(&mut self, waiting: &[PendingStructure<'_>]) {
        let mut by_name: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (place, struc) in waiting.iter().enumerate() {
            by_name.entry(struc.name).or_default().push(place);
        }
        // For each structure, the number of its referenced structures that are still to be declared, and the
        // structures that wait for it.
        let mut awaits = vec![0_usize; waiting.len()];
        let mut waiters: Vec<Vec<usize>> = vec![Vec::new(); waiting.len()];
        for (place, struc) in waiting.iter().enumerate() {
            for (type_name, _) in struc.components {
                for &other in by_name
                    .get(type_name.as_str())
                    .into_iter()
                    .flatten()
                    .filter(|other| self.is_visible_to(struc, &waiting[**other]))
                {
                    awaits[place] += 1;
                    waiters[other].push(place);
                }
            }
        }
        let mut ready: Vec<usize> = (0..waiting.len()).rev().filter(|place| awaits[*place] == 0).collect();
        let mut is_declared = vec![false; waiting.len()];
        while let Some(place) = ready.pop() {
            is_declared[place] = true;
            self.declare_struc(&waiting[place]);
            for &waiter in waiters[place].iter().rev() {
                awaits[waiter] -= 1;
                if awaits[waiter] == 0 {
                    ready.push(waiter);
                }
            }
        }
        for (struc, _) in waiting.iter().zip(is_declared).filter(|(_, is_declared)| !is_declared) {
            (self.file, self.routine, self.line) = (struc.file, struc.routine, struc.line);
            let named: Vec<&str> = struc.components.iter().map(|(type_name, _)| type_name.as_str()).collect();
            let mut named: Vec<&str> = named.into_iter().filter(|name| by_name.contains_key(name)).collect();
            named.dedup();
            let message =
                format!("structures must not contain each other: {} contains {}", struc.name, named.join(", "));
            self.problem(struc.name, message);
            self.types.add_struc(struc.scope, struc.name, Vec::new());
        }
    }

    /// Returns whether the second structure is known at the declaration of the first one.
    fn is_visible_to(&self, from: &PendingStructure<'_>, other: &PendingStructure<'_>) -> bool {
        other.scope == Scope::Everywhere
            || other.scope == Scope::Module(self.modules[from.file])
            || (other.file == from.file && other.routine == from.routine)
    }

    fn declare_struc(&mut self, struc: &PendingStructure<'_>) {
        (self.file, self.routine, self.line) = (struc.file, struc.routine, struc.line);
        self.check_name(struc.name);
        let mut placed: Vec<NewComponent> = Vec::new();
        for (type_name, item) in struc.components {
            let kind = self.resolve_type(type_name);
            let dimensions = item.dimensions.iter().map(|size| self.dimension(size.as_ref())).collect();
            placed.push(NewComponent { name: item.name.clone(), kind, dimensions });
        }
        let cells = placed
            .iter()
            .fold(0_usize, |sum, part| sum.saturating_add(self.types.cells(part.kind, &part.dimensions)));
        if cells > ARRAY_VALUES {
            self.problem(
                struc.name,
                format!("the structure has more than {ARRAY_VALUES} values, the limit of this program"),
            );
            placed.clear();
        }
        let is_free = self.types.add_struc(struc.scope, struc.name, placed);
        self.report_if_taken(is_free, struc.name);
    }
}

/// Returns whether a data list is visible everywhere. The controller's own data lists, `$config.dat` and others, are
/// visible in every program, even without PUBLIC and GLOBAL.
pub(super) fn is_visible_everywhere(data: &Data) -> bool {
    data.name.starts_with('$')
}
