//! Compares the declarations of the cell engineer's data list with those of this program's own file: an engineer
//! changes the numbers, never the names, types and visibility, which the controller's programs need.

use super::difference::Differences;
use super::names::CONFIG;
use super::stated::DataList;
use panelprep_kuka::krl::DeclaredVariable;
use std::collections::BTreeSet;

/// This program's own file.
const SHIPPED: &str = include_str!("../../../config/kuka/cell_config.dat");
/// Maximum number of names that one message lists.
const MAX_LISTED: usize = 8;

/// Notes each declaration that differs, and returns the names that the list neither declares nor gives a value: they
/// have one message together.
pub(super) fn declarations(config: &DataList, found: &mut Differences) -> BTreeSet<String> {
    if let Some((line, false)) = config.list {
        let message = "is not PUBLIC: the other programs would not find its variables, and the controller would refuse \
                       them; write `DEFDAT CELL_CONFIG PUBLIC`";
        found.note(CONFIG, line, "DEFDAT", message);
    }
    let shipped = DataList::parse(CONFIG, SHIPPED);
    let mut missing = Vec::new();
    for expected in &shipped.declared {
        match config.declared.iter().find(|declared| declared.name == expected.name) {
            Some(declared) if !is_same(declared, expected) => {
                let message = format!(
                    "is declared as `{declared}`, and must be `{expected}`: the controller's programs need it so; only \
                     numbers may be changed"
                );
                found.note(CONFIG, declared.line, &*expected.name, message);
            }
            Some(_) => {}
            None => match config.first_line_of(&expected.name) {
                Some(line) => {
                    let message = format!(
                        "has a value and no declaration: the controller refuses the list; write `{expected}` above it"
                    );
                    found.note(CONFIG, line, &*expected.name, message);
                }
                None => missing.push(expected),
            },
        }
    }
    note_missing(&missing, found);
    missing.into_iter().map(|expected| expected.name.clone()).collect()
}

/// Notes the missing names once: a file without several of them is of an earlier release.
fn note_missing(missing: &[&DeclaredVariable], found: &mut Differences) {
    match missing {
        [] => {}
        [only] => {
            let message =
                format!("is not declared, and the programs need it: `{only}`, as in this program's own file");
            found.note(CONFIG, 1, &*only.name, message);
        }
        several => {
            let mut names: Vec<&str> = several.iter().take(MAX_LISTED).map(|it| it.name.as_str()).collect();
            let more = format!("{} more", several.len().saturating_sub(MAX_LISTED));
            if several.len() > MAX_LISTED {
                names.push(&more);
            }
            let message = format!(
                "of an earlier release: {} are not there, and the programs of this release need them; copy {CONFIG} \
                 of this program's config/kuka and enter the numbers of this cell there",
                names.join(", ")
            );
            found.note(CONFIG, 1, "DEFDAT", message);
        }
    }
}

fn is_same(one: &DeclaredVariable, other: &DeclaredVariable) -> bool {
    let what = |it: &DeclaredVariable| (it.global, it.constant, it.type_name.clone(), it.sizes.clone());
    what(one) == what(other)
}
