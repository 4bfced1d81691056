//! What is wrong with a configuration file, for a person with an editor.

/// One problem: where it stands, and what was found and is allowed.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Problem {
    /// Line in the file, from 1; 0 where the problem has no line.
    pub line: usize,
    /// The key with its tables, `locate.max_shift_mm`; empty where the file as a whole is meant.
    pub key: String,
    /// What was found, what is allowed, what to do.
    pub message: String,
}

/// All problems of one file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Problems {
    /// The file's name as the user wrote it.
    pub file: String,
    /// The problems, in the order of their lines.
    pub list: Vec<Problem>,
}

impl std::fmt::Display for Problems {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, problem) in self.list.iter().enumerate() {
            if index > 0 {
                writeln!(f)?;
            }
            write!(
                f,
                "{}:{}: {}{}{}",
                self.file,
                problem.line,
                problem.key,
                if problem.key.is_empty() { "" } else { ": " },
                problem.message
            )?;
        }
        Ok(())
    }
}

/// Units that end a key, with what they measure.
const UNITS: [(&str, &str); 15] = [
    ("m", "lengths are in mm"),
    ("cm", "lengths are in mm"),
    ("mm", "lengths are in mm"),
    ("um", "lengths are in mm"),
    ("inch", "lengths are in mm"),
    ("in", "lengths are in mm"),
    ("rad", "angles are in degrees"),
    ("deg", "angles are in degrees"),
    ("s", "times are in seconds"),
    ("ms", "times are in seconds"),
    ("min", "times are in seconds"),
    ("percent", "shares are in percent"),
    ("px", "picture sizes are in px"),
    ("mm2", "areas are in mm²"),
    ("cm2", "areas are in mm²"),
];

fn stem_and_unit(key: &str) -> (&str, Option<&'static str>) {
    key.rsplit_once('_')
        .and_then(|(stem, end)| UNITS.iter().find(|(unit, _)| *unit == end).map(|(_, rule)| (stem, Some(*rule))))
        .unwrap_or((key, None))
}

/// The known name that the user most likely meant, with the rule about units where only the unit is wrong.
pub fn nearest<'k>(unknown: &str, known: &[&'k str]) -> Option<(&'k str, Option<&'static str>)> {
    let (stem, unit) = stem_and_unit(unknown);
    for &name in known {
        let (name_stem, rule) = stem_and_unit(name);
        if rule.is_some() && name_stem == stem && (unit.is_some() || stem == unknown) {
            return Some((name, rule));
        }
    }
    let closeness = |name: &str| strsim::jaro_winkler(unknown, name);
    known
        .iter()
        .copied()
        .max_by(|a, b| closeness(a).total_cmp(&closeness(b)))
        .filter(|name| closeness(name) > 0.75)
        .map(|name| (name, None))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_unit_is_told_from_a_misspelling() {
        let known = ["max_shift_mm", "turn_limit_deg", "rows"];
        assert_eq!(nearest("max_shift_cm", &known), Some(("max_shift_mm", Some("lengths are in mm"))));
        assert_eq!(nearest("turn_limit_rad", &known), Some(("turn_limit_deg", Some("angles are in degrees"))));
        assert_eq!(nearest("turn_limit", &known), Some(("turn_limit_deg", Some("angles are in degrees"))));
        assert_eq!(nearest("rwos", &known), Some(("rows", None)));
        assert_eq!(nearest("wavelength", &known), None);
    }
}
