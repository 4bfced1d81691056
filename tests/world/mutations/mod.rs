//! Changes of the product's sources that a world must detect: errors that a person who works on the sources might make.
//! The bench `mutations` makes each change, builds the world and runs it. Each change names a text that its file
//! contains exactly once, which `list.rs` checks.
//!
//! Not included: parts that no world has (the socket, pages, the names of recordings, inputs, supervision, a compliant
//! tool), and errors that are injected while a world runs (`sabotage`).

mod controller;
mod cycle;
mod daemon;
mod link;
mod programs;
mod store;

/// A change of the sources that violates a requirement.
#[derive(Debug, Clone, Copy)]
pub struct Mutation {
    /// The violated requirement.
    pub name: &'static str,
    /// The changed text.
    pub edit: Edit,
    /// A second change that belongs to the first.
    pub beside: Option<Edit>,
    /// The first seed, and the step to the next seed, because only some worlds execute the controller's programs.
    pub seeds: (u64, u64),
    /// The reason why no world detects the mutation, if this is the case.
    pub not_found: Option<&'static str>,
}

/// A replacement of one text by another.
#[derive(Debug, Clone, Copy)]
pub struct Edit {
    /// The path of the file, relative to the repository's folder.
    pub file: &'static str,
    /// The shipped text, which the file contains exactly once.
    pub ships: &'static str,
    /// The text that replaces the shipped text.
    pub changed: &'static str,
}

/// Returns all mutations.
pub fn all() -> impl Iterator<Item = &'static Mutation> {
    let lists: [&'static [Mutation]; 6] =
        [&store::ALL, &cycle::ALL, &link::ALL, &daemon::ALL, &controller::ALL, &programs::ALL];
    lists.into_iter().flatten()
}

const fn change(name: &'static str, file: &'static str, ships: &'static str, changed: &'static str) -> Mutation {
    Mutation { name, edit: Edit { file, ships, changed }, beside: None, seeds: (0, 1), not_found: None }
}

impl Mutation {
    /// Adds a second change.
    const fn and(self, file: &'static str, ships: &'static str, changed: &'static str) -> Self {
        Mutation { beside: Some(Edit { file, ships, changed }), ..self }
    }

    /// Marks a mutation of the controller's programs, which only one in eight worlds executes.
    const fn of_programs(self) -> Self {
        Mutation { seeds: (5, 8), ..self }
    }

    /// Marks a mutation that no world detects, with the reason.
    const fn not_found(self, why: &'static str) -> Self {
        Mutation { not_found: Some(why), ..self }
    }

    /// Returns the changes.
    pub fn edits(&self) -> impl Iterator<Item = &Edit> {
        std::iter::once(&self.edit).chain(&self.beside)
    }
}
