//! Finds the known name that a user most probably meant.

/// Units at the end of a key, each with its quantity in words. Longer units come first, since `_mm_s` also ends in
/// `_s`.
const UNITS: [(&str, &str); 24] = [
    ("_mm_min", "this speed is in mm/min"),
    ("_m_min", "this speed is in m/min"),
    ("_mm_s", "this speed is in mm/s"),
    ("_cm_s", "this speed is in cm/s"),
    ("_m_s", "this speed is in m/s"),
    ("_deg_s", "this angular speed is in degrees/s"),
    ("_rad_s", "this angular speed is in radians/s"),
    ("_percent", "this share is in percent"),
    ("_inch", "this length is in inches"),
    ("_rad", "this angle is in radians"),
    ("_deg", "this angle is in degrees"),
    ("_mm2", "this area is in mm²"),
    ("_cm2", "this area is in cm²"),
    ("_min", "this time is in minutes"),
    ("_px2", "this area is in px²"),
    ("_mm", "this length is in mm"),
    ("_cm", "this length is in cm"),
    ("_um", "this length is in µm"),
    ("_px", "this length is in px"),
    ("_ms", "this time is in ms"),
    ("_in", "this length is in inches"),
    ("_m", "this length is in m"),
    ("_s", "this time is in seconds"),
    ("_h", "this time is in hours"),
];

/// Minimum similarity of two names, 0…1, for one to be proposed instead of the other.
const MIN_SIMILARITY: f64 = 0.8;

fn stem_and_unit(key: &str) -> (&str, Option<&'static str>) {
    let split = |(unit, rule): &(&str, &'static str)| key.strip_suffix(unit).map(|stem| (stem, Some(*rule)));
    UNITS.iter().find_map(split).unwrap_or((key, None))
}

/// The known name that the user most likely meant, with the unit of that name if only the unit is wrong.
pub fn nearest<'k>(unknown: &str, known: &[&'k str]) -> Option<(&'k str, Option<&'static str>)> {
    let written = unknown.to_lowercase().replace(['-', ' '], "_");
    let (stem, unit) = stem_and_unit(&written);
    let same_but_unit = known.iter().find_map(|&name| {
        let (name_stem, rule) = stem_and_unit(name);
        let same_stem = name_stem == stem && unit.is_some() || name_stem == written;
        (rule.is_some() && name != written && same_stem).then_some((name, rule))
    });
    let closeness = |name: &str| strsim::jaro_winkler(&written, name);
    let alike = || known.iter().copied().max_by(|a, b| closeness(a).total_cmp(&closeness(b)));
    same_but_unit.or_else(|| alike().filter(|name| closeness(name) > MIN_SIMILARITY).map(|name| (name, None)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_unit_is_distinguished_from_a_misspelling() {
        let known =
            ["max_shift_mm", "turn_limit_deg", "heartbeat_ms", "token_s", "feed_mm_s", "min_break_mm2", "rows"];
        for (written, name, unit) in [
            ("max_shift_cm", "max_shift_mm", Some("this length is in mm")),
            ("max_shift", "max_shift_mm", Some("this length is in mm")),
            ("turn_limit_rad", "turn_limit_deg", Some("this angle is in degrees")),
            ("heartbeat_s", "heartbeat_ms", Some("this time is in ms")),
            ("token_ms", "token_s", Some("this time is in seconds")),
            ("feed_m_s", "feed_mm_s", Some("this speed is in mm/s")),
            ("min_break_mm", "min_break_mm2", Some("this area is in mm²")),
            ("max-shift-mm", "max_shift_mm", None),
            ("Rows", "rows", None),
            ("rwos", "rows", None),
            ("max_shfit_mm", "max_shift_mm", None),
        ] {
            assert_eq!(nearest(written, &known), Some((name, unit)), "{written}");
        }
        assert_eq!(nearest("wavelength", &known), None);
        assert_eq!(nearest("", &known), None);
    }
}
