//! `[part]`: the rules for the names of the part (serial number, order) that a start request states. Without the table,
//! names are optional and may have any form.

use panelprep_base::config::{Choice, Section};

/// Whether a start request must state the name.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum NameDemand {
    /// A start request may omit the name.
    #[default]
    Optional,
    /// A start request without the name is refused.
    Required,
}

impl Choice for NameDemand {
    const KEYWORDS: &'static [(&'static str, Self)] =
        &[("optional", NameDemand::Optional), ("required", NameDemand::Required)];
}

/// The rule for one name of a part.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NameRule {
    /// Whether a start request must state the name.
    pub demand: NameDemand,
    /// The pattern of the name: `#` is a digit, `?` one character, `*` any characters; `None` accepts any name.
    pub pattern: Option<String>,
}

/// The rules for the names of a part.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PartRules {
    /// The rule for the serial number.
    pub serial: NameRule,
    /// The rule for the work order.
    pub order: NameRule,
}

/// The reason why the names of a part are not accepted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PartNameError {
    /// A required name is missing.
    #[error("the start request states no {what}, but {required_by} requires one: enter the {what} and start again")]
    Missing {
        /// Which name: "serial number" or "work order".
        what: &'static str,
        /// The key that requires the name, with its table and file.
        required_by: String,
    },
    /// A name does not match its pattern.
    #[error(
        "the {what} \"{found}\" does not match the pattern \"{pattern}\" of {table} {key}_pattern (# is a digit, ? one \
         character, * any characters): check the {what} on the part, then start again with the recipe of this part"
    )]
    Form {
        /// Which name: "serial number" or "work order".
        what: &'static str,
        /// The table that states the form.
        table: &'static str,
        /// The name's key there.
        key: &'static str,
        /// The name in the start request.
        found: String,
        /// The pattern in the cell's file.
        pattern: String,
    },
}

impl NameRule {
    fn check(&self, (what, key): (&'static str, &'static str), name: Option<&str>) -> Result<(), PartNameError> {
        let Some(name) = name else {
            return match self.demand {
                NameDemand::Required => {
                    let required_by = format!("[part] {key} of the cell's file");
                    Err(PartNameError::Missing { what, required_by })
                }
                NameDemand::Optional => Ok(()),
            };
        };
        match &self.pattern {
            Some(pattern) => check_form(name, pattern, (what, "[part]", key)),
            None => Ok(()),
        }
    }
}

fn check_form(
    name: &str,
    pattern: &str,
    (what, table, key): (&'static str, &'static str, &'static str),
) -> Result<(), PartNameError> {
    if has_form(name, pattern) {
        return Ok(());
    }
    let (found, pattern) = (name.escape_debug().to_string(), pattern.to_owned());
    Err(PartNameError::Form { what, table, key, found, pattern })
}

/// Checks the serial number of a part by the form that the recipe of its panel states.
///
/// # Errors
/// If it is missing, so that the form shows nothing about the part. If it has another form: the part is another panel,
/// or the number was read wrongly.
pub fn check_serial_form(serial: Option<&str>, pattern: &str) -> Result<(), PartNameError> {
    let (what, table, key) = ("serial number", "the recipe's [panel]", "serial");
    let missing = || PartNameError::Missing { what, required_by: format!("{table} {key}_pattern") };
    check_form(serial.ok_or_else(missing)?, pattern, (what, table, key))
}

impl PartRules {
    /// Checks the names of a part in a start request.
    ///
    /// # Errors
    /// If a required name is missing, or a name does not match its pattern.
    pub fn check(&self, serial: Option<&str>, order: Option<&str>) -> Result<(), PartNameError> {
        self.serial.check(("serial number", "serial"), serial)?;
        self.order.check(("work order", "order"), order)
    }
}

/// Returns whether a name matches a pattern. The states are the positions in the pattern that can be reached with the
/// characters read so far; therefore the time is linear in the length of the name.
fn has_form(name: &str, pattern: &str) -> bool {
    let pattern: Vec<char> = pattern.chars().collect();
    let with_skipped = |places: Vec<bool>| {
        let mut places = places;
        for (at, sign) in pattern.iter().enumerate() {
            places[at + 1] |= places[at] && *sign == '*';
        }
        places
    };
    let mut first = vec![false; pattern.len() + 1];
    first[0] = true;
    let last = name.chars().fold(with_skipped(first), |places, letter| {
        let mut next = vec![false; pattern.len() + 1];
        for (at, sign) in pattern.iter().enumerate().filter(|(at, _)| places[*at]) {
            match sign {
                '*' => next[at] = true,
                '?' => next[at + 1] = true,
                '#' => next[at + 1] |= letter.is_ascii_digit(),
                exact => next[at + 1] |= *exact == letter,
            }
        }
        with_skipped(next)
    });
    last.last() == Some(&true)
}

/// Parses `[part]`, the rules for the names of the part.
pub(super) fn parse_part(section: &Section<'_, '_>) -> Option<PartRules> {
    let demand = |key| section.parse::<NameDemand>(key, (), Some(NameDemand::Optional));
    let pattern = |key| section.parse::<Option<String>>(key, (), Some(None));
    let (serial, serial_pattern) = (demand("serial"), pattern("serial_pattern"));
    let (order, order_pattern) = (demand("order"), pattern("order_pattern"));
    section.finish();
    Some(PartRules {
        serial: NameRule { demand: serial?, pattern: serial_pattern? },
        order: NameRule { demand: order?, pattern: order_pattern? },
    })
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    #[test]
    fn a_pattern_states_the_form_of_a_whole_name() {
        for (pattern, name, is_right) in [
            ("SN-####", "SN-0017", true),
            ("SN-####", "SN-017", false),
            ("SN-####", "SN-00171", false),
            ("SN-####", "SN-001x", false),
            ("SN-####", "sn-0017", false),
            ("SN-#*", "SN-1", true),
            ("SN-#*", "SN-", false),
            ("*-?", "a-b-c", true),
            ("*-?", "a-b-", false),
            ("*", "", true),
            ("**#", "12", true),
            ("#", "٣", false),
        ] {
            assert_eq!(has_form(name, pattern), is_right, "{name} as {pattern}");
        }
        assert!(!has_form(&"a".repeat(100_000), &format!("{}b", "*a".repeat(5))), "a long name needs no long time");
    }

    #[test]
    fn a_cell_requires_the_names_that_its_file_states() {
        let rules = |text: &str| {
            Cell::check("cell.toml", text).map(|cell| cell.part().clone()).map_err(|problems| problems.to_string())
        };
        assert_eq!(rules(""), Ok(PartRules::default()));
        assert_eq!(PartRules::default().check(None, None), Ok(()));
        let strict = rules("[part]\nserial = 'required'\nserial_pattern = 'SN-####'\norder_pattern = 'W-*'\n");
        let strict = strict.expect("right");
        assert_eq!(strict.check(Some("SN-0017"), None), Ok(()));
        let refused = |serial, order| strict.check(serial, order).expect_err("refused").to_string();
        assert!(refused(None, Some("W-1")).contains("states no serial number, but [part] serial"));
        assert!(refused(Some("W-4"), None).contains("\"W-4\" does not match the pattern \"SN-####\""));
        assert!(
            refused(Some("SN-0017"), Some("SN-0017")).contains("[part] order_pattern"),
            "the wrong code was read"
        );
        let of_recipe = |serial| check_serial_form(serial, "RH-*").map_err(|problem| problem.to_string());
        assert_eq!(of_recipe(Some("RH-4")), Ok(()));
        for (serial, words) in [
            (Some("SN-0017"), "pattern \"RH-*\" of the recipe's [panel] serial_pattern"),
            (None, "states no serial number, but the recipe's [panel] serial_pattern requires one: enter"),
        ] {
            assert!(of_recipe(serial).is_err_and(|problem| problem.contains(words)), "{serial:?}");
        }
        assert!(rules("[part]\nserial = 'always'").is_err_and(|told| told.contains("part.serial")));
    }
}
