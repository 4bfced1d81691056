//! Checks that the list of mutations still fits the sources.

use crate::world_mutations::{Mutation, all};
use std::collections::BTreeSet;
use std::path::Path;

#[test]
fn each_mutation_names_text_that_its_file_contains_once() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (mutation, edit) in all().flat_map(|mutation| mutation.edits().map(move |edit| (mutation, edit))) {
        let Mutation { name, .. } = mutation;
        let text =
            std::fs::read_to_string(repository.join(edit.file)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(text.matches(edit.ships).count(), 1, "{name}: {}", edit.file);
        assert_ne!(edit.ships, edit.changed, "{name}");
    }
}

#[test]
fn each_change_has_a_name_of_its_own() {
    let names: BTreeSet<&str> = all().map(|mutation| mutation.name).collect();
    assert_eq!(names.len(), all().count());
}
