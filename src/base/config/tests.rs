//! Tests of the reader with a small kind of file: its message for each possible mistake.

use super::*;
use proptest::prelude::*;

settings! {
    /// A table with one key of each kind.
    pub struct Locate {
        /// A length.
        max_shift_mm: f64, 0.0..=500.0, default 60.0;
        /// An angle.
        turn_limit_deg: f64, 0.0..=180.0, default 15.0;
        /// A short time.
        heartbeat_ms: usize, 10..=100, default 100;
        /// A list.
        corner_mm: [f64; 3], -10.0..=10.0, default [0.0; 3];
        /// A switch.
        outline: bool, (), default true;
    }
}

settings! {
    /// A required table.
    pub struct Region {
        /// Required.
        rows: usize, 1..=50, required;
        /// Required.
        columns: usize, 1..=50, required;
    }
}

type Checked = (String, Locate, Region, Vec<Region>);

fn parse(top: &Section<'_, '_>) -> Option<Checked> {
    let panel = top.parse::<String>("panel", (), None);
    let locate = Locate::parse(&top.section("locate"));
    let region = Region::parse(&top.section("region"));
    let extra: Vec<Option<Region>> = top.sections("extra").iter().map(Region::parse).collect();
    top.finish();
    Some((panel?, locate?, region?, extra.into_iter().collect::<Option<_>>()?))
}

/// Returns the messages for the problems of a text, without the file's name.
fn problems(text: &str) -> Vec<String> {
    match parse_file("f", text, parse) {
        Ok(_) => vec![],
        Err(problems) => {
            problems.to_string().lines().map(|line| line.trim_start_matches("f:").to_owned()).collect()
        }
    }
}

/// Returns the problems of a file with four correct lines followed by this text, which begins in line 5 inside
/// `[region]`.
fn problems_after_good_lines(text: &str) -> Vec<String> {
    problems(&format!("panel = 'door'\n[region]\nrows = 4\ncolumns = 6\n{text}"))
}

#[test]
fn a_correct_file_is_read_in_any_notation() {
    for text in [
        "panel = \"door\"\n[region]\nrows = 4\ncolumns = 6\n",
        "panel = 'door'\r\n[region]\r\nrows = 4\r\ncolumns = 6\r\n",
        "\u{feff}panel = 'door'\nregion = {rows = 4, columns = 6}\n",
        "panel = 'door'\nregion.rows = 0x4\nregion.columns = 6\n[locate]\nmax_shift_mm = 60 # a whole number will do\n",
    ] {
        let (panel, locate, region, extra) =
            parse_file("f", text, parse).unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!((panel.as_str(), region.rows(), region.columns(), extra.len()), ("door", 4, 6, 0));
        assert_eq!((locate.heartbeat_ms(), locate.outline()), (100, true));
        assert_eq!((locate.turn_limit_deg(), locate.corner_mm()), (15.0, [0.0; 3]));
    }
}

#[test]
fn each_mistake_is_reported_with_line_key_and_valid_values() {
    let cases = [
        // Names.
        ("max_shfit_mm = 6", "6: locate.max_shfit_mm: unknown key; did you mean max_shift_mm?"),
        ("max_shift_cm = 6", "6: locate.max_shift_cm: unknown key; this length is in mm: write max_shift_mm"),
        (
            "turn_limit_rad = 1",
            "6: locate.turn_limit_rad: unknown key; this angle is in degrees: write turn_limit_deg",
        ),
        ("turn_limit = 1", "6: locate.turn_limit: unknown key; this angle is in degrees: write turn_limit_deg"),
        ("heartbeat_s = 0.1", "6: locate.heartbeat_s: unknown key; this time is in ms: write heartbeat_ms"),
        ("rows = 4", "6: locate.rows: unknown key here; did you mean extra[1].rows or region.rows?"),
        (
            "wavelength = 4",
            "6: locate.wavelength: unknown key; valid keys here: max_shift_mm, turn_limit_deg, heartbeat_ms, \
             corner_mm, outline",
        ),
        // Values.
        ("max_shift_mm = 501", "6: locate.max_shift_mm: found 501, valid: a number from 0 to 500"),
        ("max_shift_mm = -0.1", "6: locate.max_shift_mm: found -0.1, valid: a number from 0 to 500"),
        ("max_shift_mm = nan", "6: locate.max_shift_mm: found nan, valid: a number from 0 to 500"),
        ("max_shift_mm = +inf", "6: locate.max_shift_mm: found +inf, valid: a number from 0 to 500"),
        ("max_shift_mm = 1e999", "6: locate.max_shift_mm: found 1e999, valid: a number from 0 to 500"),
        ("max_shift_mm = '60'", "6: locate.max_shift_mm: found the text \"60\", valid: a number from 0 to 500"),
        ("max_shift_mm = {}", "6: locate.max_shift_mm: found a table, valid: a number from 0 to 500"),
        ("max_shift_mm.x = 1", "6: locate.max_shift_mm: found a table, valid: a number from 0 to 500"),
        ("heartbeat_ms = 50.0", "6: locate.heartbeat_ms: found 50.0, valid: a whole number from 10 to 100"),
        ("heartbeat_ms = -50", "6: locate.heartbeat_ms: found -50, valid: a whole number from 10 to 100"),
        (
            "heartbeat_ms = 0xffffffffffffffffffff",
            "6: locate.heartbeat_ms: found ffffffffffffffffffff, valid: a whole number from 10 to 100",
        ),
        ("corner_mm = [0, 1]", "6: locate.corner_mm: found a list of 2, valid: a list of 3 items"),
        ("corner_mm = [0, nan, 1]", "6: locate.corner_mm: item 2: found nan, valid: a number from -10 to 10"),
        ("outline = 1", "6: locate.outline: found 1, valid: true or false"),
        ("outline = 2026-05-31", "6: locate.outline: found a date, valid: true or false"),
        // Not TOML.
        ("max_shift_mm = = 3", "6: locate.max_shift_mm: not TOML: extra `=`, expected nothing"),
        ("max_shift_mm 3", "6: locate.max_shift_mm: not TOML: key with no value, expected `=`"),
        (
            "max_shift_mm = 6 mm",
            "6: locate.max_shift_mm: not TOML: string values must be quoted, expected literal string",
        ),
        ("max_shift_mm = 6,5", "6: locate.max_shift_mm: found 6,5; a number has a decimal point: write 6.5"),
        (
            "max_shift_mm = -0,25 # mm",
            "6: locate.max_shift_mm: found -0,25; a number has a decimal point: write -0.25",
        ),
        ("outline = true\noutline = true", "7: locate.outline: not TOML: duplicate key"),
        ("[region]", "6: region: not TOML: duplicate key"),
    ];
    for (mistake, message) in cases {
        assert_eq!(
            problems_after_good_lines(&format!("[locate]\n{mistake}\n[[extra]]\nrows = 1\ncolumns = 1")),
            [message],
            "{mistake}"
        );
    }
}

#[test]
fn a_missing_key_is_reported_once() {
    assert_eq!(
        problems(""),
        [
            "1: panel: is missing; this key has no default",
            "1: region: this table is missing; it needs rows, columns"
        ]
    );
    assert_eq!(
        problems("panel = ' '\n[region]\nrows = 4"),
        [
            "1: panel: found the text \" \", valid: a text that is not empty",
            "2: region.columns: is missing; this key has no default"
        ]
    );
    assert_eq!(
        problems_after_good_lines("[[extra]]\nrows = 1"),
        ["5: extra[1].columns: is missing; this key has no default"]
    );
}

/// A misspelt key is not also reported as missing, and the contents of a misspelt table are still checked.
#[test]
fn a_misspelt_name_is_not_also_reported_as_missing() {
    assert_eq!(
        problems("panel = 'door'\n[regoin]\nrows = 4\ncolumms = 6\n[locate]\nmax_shift_mm = 900"),
        [
            "2: regoin: unknown key; did you mean region?",
            "4: region.columms: unknown key; did you mean columns?",
            "6: locate.max_shift_mm: found 900, valid: a number from 0 to 500"
        ]
    );
    assert_eq!(
        problems("panel = 'door'\ncolumns = 6\n[region]\nrows = 4"),
        ["2: columns: unknown key here; did you mean region.columns?"]
    );
    assert_eq!(
        problems_after_good_lines("[regoin]\nrows = 99\n[locate]\nrows = 3"),
        [
            "5: regoin: unknown key; did you mean region?",
            "8: locate.rows: unknown key here; did you mean region.rows?"
        ],
        "the right table is there: it is the one that is read"
    );
    assert_eq!(
        problems("panel = 'door'\nregoin = {rows = 1, columns = 1}\nlocate.rows = 3"),
        [
            "2: regoin: unknown key; did you mean region?",
            "3: locate.rows: unknown key here; did you mean region.rows?"
        ]
    );
}

#[test]
fn a_table_is_not_confused_with_a_value() {
    assert_eq!(problems("panel = 'door'\nregion = 3"), ["2: region: found 3, valid: a table; write [region]"]);
    assert_eq!(
        problems_after_good_lines("[extra]\nrows = 1"),
        ["5: extra: found a table, valid: a list of tables; write [[extra]]"]
    );
}

#[test]
fn line_numbers_are_correct_in_lists_and_inline_tables() {
    assert_eq!(
        problems_after_good_lines("[[extra]]\nrows = 1\ncolumns = 1\n[[extra]]\nrows = 0\ncolumns = 99"),
        [
            "9: extra[2].rows: found 0, valid: a whole number from 1 to 50",
            "10: extra[2].columns: found 99, valid: a whole number from 1 to 50"
        ]
    );
    assert_eq!(
        problems(
            "panel = 'door'\nextra = [\n  {rows = 1, columns = 1},\n  {rows = 1,\n   colums = 1},\n  7,\n]\nregion = {rows = 0, columns = 6}"
        ),
        [
            "5: extra[2].colums: unknown key; did you mean columns?",
            "6: extra[3]: found 7, valid: a table; write [[extra]]",
            "8: region.rows: found 0, valid: a whole number from 1 to 50"
        ]
    );
}

#[test]
fn all_problems_of_a_file_are_listed_in_the_order_of_lines() {
    let text =
        "panl = 'door'\r\n[locate]\r\nmax_shift_mm = nan\r\nturn_limit_rad = 0.1\r\n\r\n[region]\r\nrows = 51\r\n";
    assert_eq!(
        problems(text),
        [
            "1: panl: unknown key; did you mean panel?",
            "3: locate.max_shift_mm: found nan, valid: a number from 0 to 500",
            "4: locate.turn_limit_rad: unknown key; this angle is in degrees: write turn_limit_deg",
            "6: region.columns: is missing; this key has no default",
            "7: region.rows: found 51, valid: a whole number from 1 to 50"
        ]
    );
}

/// After a syntax error nothing is reported as missing, because the parser does not know the meaning of a broken line.
/// Other problems are still reported.
#[test]
fn a_syntax_error_neither_hides_nor_adds_other_problems() {
    assert_eq!(
        problems("[region\nrows = 99\ncolumns = 6\n[locate]\nmax_shift_mm = 900"),
        [
            "1: region: not TOML: unclosed table, expected `]`",
            "5: locate.max_shift_mm: found 900, valid: a number from 0 to 500"
        ]
    );
}

proptest! {
    #[test]
    fn any_text_gives_a_result_without_a_panic(text in "(?s).{0,200}") {
        let _ = parse_file("f", &text, parse);
        let _ = top_keys(&text);
    }

    /// Random texts of TOML elements reach deeper parts of the reader than texts of random letters.
    #[test]
    fn problems_of_any_text_of_toml_elements_name_existing_lines(
        words in prop::collection::vec(prop::sample::select(vec![
            "panel", "region", "rows", "columns", "extra", "locate", "max_shift_mm", "max_shift", "=", "[", "]", "{", "}", ",", "\n",
            "\r\n", "\"", "'", "nan", "-1", "4", "1e9", "'door'", "#", ".", "[[", "]]", " ", "true", "é",
        ]), 0..60),
    ) {
        let text = words.concat();
        if let Err(problems) = parse_file("f", &text, parse) {
            prop_assert!(!problems.list.is_empty());
            let lines = text.split('\n').count();
            prop_assert!(problems.list.iter().all(|problem| (1..=lines).contains(&problem.line)), "{problems}");
            prop_assert!(problems.list.windows(2).all(|pair| pair[0].line <= pair[1].line));
        }
    }

    #[test]
    fn a_number_is_read_exactly_or_refused(number in prop::num::f64::ANY) {
        let text = format!("panel = 'door'\nregion = {{rows = 4, columns = 6}}\nlocate.max_shift_mm = {number:?}");
        let text = text.replace("NaN", "nan");
        match parse_file("f", &text, parse) {
            Ok((_, locate, ..)) => prop_assert_eq!(locate.max_shift_mm().to_bits(), number.to_bits()),
            Err(_) => prop_assert!(!(0.0..=500.0).contains(&number)),
        }
    }
}
