//! Finds the line of a key in a file that was read without problems.

use super::syntax::line_number;
use toml::de::{DeTable, DeValue};

/// Returns the line of a key, `poses.park.a1_deg`. If the key does not exist, the line of its table, or 1.
pub fn key_line(text: &str, key: &str) -> usize {
    let (root, _) = DeTable::parse_recoverable(text);
    let (mut table, mut line) = (Some(root.get_ref()), 1);
    for part in key.split('.') {
        let Some((name, value)) = table.and_then(|table| table.get_key_value(part)) else { break };
        line = line_number(text, name.span().start);
        table = match value.get_ref() {
            DeValue::Table(inner) => Some(inner),
            _ => None,
        };
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_where_it_is_written_or_where_it_belongs() {
        let text = "store = 'a'\n\n[poses]\npark = { a1_deg = 1.0 }\n[poses.ready]\na1_deg = 2.0\n[io.outputs]\nlight = 1\n";
        for (key, line) in [
            ("store", 1),
            ("poses.park.a1_deg", 4),
            ("poses.ready.a1_deg", 6),
            ("poses.ready.a2_deg", 5),
            ("io.outputs.spray", 7),
            ("limits.box_min_mm", 1),
        ] {
            assert_eq!(key_line(text, key), line, "{key}");
        }
    }
}
