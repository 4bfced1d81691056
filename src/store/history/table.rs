//! A table of cells for other programs: as CSV with every digit, with one line of names first.
//!
//! Spreadsheets execute a text that begins like a formula. People enter such texts, for example as serial numbers.
//! Such a text gets an apostrophe in front, as spreadsheets themselves write a text that is not a formula.

/// A cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A value that was not measured or not named.
    Empty,
    /// A text.
    Text(String),
    /// A number, written with the fewest digits that read back equal.
    Number(f64),
    /// A count or a time.
    Whole(i64),
    /// Yes or no.
    Flag(bool),
}

/// Rows below the names of their columns; units are in the names.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// The rows, each with as many cells as there are names.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Creates a table with these columns and no rows.
    pub fn new(columns: &[&str]) -> Self {
        Table { columns: columns.iter().map(|&name| name.to_owned()).collect(), rows: Vec::new() }
    }

    /// Returns the table with these rows.
    #[must_use]
    pub fn with_rows(self, rows: impl IntoIterator<Item = Vec<Cell>>) -> Self {
        Table { rows: rows.into_iter().collect(), ..self }
    }

    /// The table as CSV (RFC 4180), in UTF-8.
    ///
    /// # Errors
    /// If a row does not have as many cells as there are column names.
    pub fn csv(&self) -> Result<String, csv::Error> {
        let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::CRLF).from_writer(Vec::new());
        writer.write_record(&self.columns)?;
        for row in &self.rows {
            writer.write_record(row.iter().map(Cell::text))?;
        }
        let bytes = writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))?;
        // The bytes are valid text, since they were written from texts.
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }
}

impl Cell {
    fn text(&self) -> String {
        match self {
            Cell::Empty => String::new(),
            Cell::Text(text) if text.starts_with(['=', '+', '-', '@', '\t', '\r']) => format!("'{text}"),
            Cell::Text(text) => text.clone(),
            Cell::Number(number) => panelprep_base::number_text::shortest_text(*number),
            Cell::Whole(number) => number.to_string(),
            Cell::Flag(flag) => flag.to_string(),
        }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Cell::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Cell::Text(text)
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Self {
        Cell::Number(number)
    }
}

impl From<i64> for Cell {
    fn from(number: i64) -> Self {
        Cell::Whole(number)
    }
}

impl From<usize> for Cell {
    fn from(number: usize) -> Self {
        Cell::Whole(i64::try_from(number).unwrap_or(i64::MAX))
    }
}

impl From<bool> for Cell {
    fn from(flag: bool) -> Self {
        Cell::Flag(flag)
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Cell::Empty, Into::into)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_is_csv_that_reads_back_and_executes_nothing() {
        let row =
            vec![Cell::from("=HYPERLINK(\"x\")"), Cell::from(0.1 + 0.2), Cell::Empty, Cell::from("a, \"b\"\nc")];
        let table = Table::new(&["serial", "residual_mm", "error_mm", "reason"]).with_rows([row]);
        let text = table.csv().expect("written");
        assert_eq!(
            text,
            "serial,residual_mm,error_mm,reason\r\n\"'=HYPERLINK(\"\"x\"\")\",0.30000000000000004,,\"a, \"\"b\"\"\nc\"\r\n"
        );
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let read = reader.records().next().expect("a row").expect("CSV");
        assert_eq!(read.get(1).and_then(|cell| cell.parse().ok()), Some(0.1 + 0.2));
        assert!(Table::new(&["a", "b"]).with_rows([vec![Cell::Empty]]).csv().is_err(), "a row that is too short");
    }
}
