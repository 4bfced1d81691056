//! `clip.csv`: the capture time of each picture of a clip.
//!
//! The header is `file,time_s,phase`, or `file,time_s` if every picture shows the wet panel. A clip is evidence.
//! Therefore the times are those of the camera and must increase, and all files are in the clip's folder.

use panelprep_base::phase::Phase;
use std::collections::HashMap;

/// One picture of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipEntry {
    /// File name of the picture in the clip's folder.
    pub file: String,
    /// Capture time, s, from any zero.
    pub time_s: f64,
    /// The phase in which the picture was captured.
    pub phase: Phase,
}

/// The pictures of a clip, in the order of their capture times. At least one picture is in the phase wet.
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    shots: Vec<ClipEntry>,
}

/// The reason why a `clip.csv` was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ClipError {
    /// The header is not valid.
    #[error("line 1: found the header '{found}'; valid: file,time_s,phase or file,time_s")]
    Header {
        /// The header of the file.
        found: String,
    },
    /// A line is not valid.
    #[error("line {line}: {problem}")]
    Line {
        /// Line, from 1.
        line: u64,
        /// The problem in the line.
        problem: LineProblem,
    },
    /// The file lists no pictures.
    #[error("the clip is empty: no picture follows the header")]
    Empty,
    /// No picture is in the phase wet.
    #[error("none of the clip's {shots} pictures has the phase 'wet'; the water-break test needs wet pictures")]
    NoneWet {
        /// Number of pictures in the clip.
        shots: usize,
    },
}

/// The problem of a line of a `clip.csv`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineProblem {
    /// The line is not valid CSV.
    #[error("{0}")]
    Syntax(String),
    /// A file outside of the clip's folder.
    #[error("the file is '{0}'; valid: a name in the clip's folder, without / \\ or ..")]
    File(String),
    /// A picture is listed twice.
    #[error("the file '{file}' is already listed in line {first}")]
    Duplicate {
        /// File name of the picture.
        file: String,
        /// The line in which the picture is listed first.
        first: u64,
    },
    /// The time is not a number.
    #[error("time_s is '{0}'; valid: a finite number of seconds")]
    Time(String),
    /// The time is not later than that of the previous picture.
    #[error("time_s is {0}, which is not later than {1}, the time of the previous picture")]
    NotLater(String, String),
    /// The phase is unknown.
    #[error("the phase is '{0}'; valid: dry, spray or wet")]
    Phase(String),
}

impl Clip {
    /// Creates a clip from its entries after checking them.
    ///
    /// # Errors
    /// The errors of [`read_clip`], with the line numbers of the file that [`Clip::to_csv`] would return.
    pub fn new(shots: Vec<ClipEntry>) -> Result<Self, ClipError> {
        let lines = 2..;
        check_lines(lines.zip(shots).collect())
    }

    /// Returns the pictures in the order of their capture times.
    pub fn entries(&self) -> &[ClipEntry] {
        &self.shots
    }

    /// Returns the text of `clip.csv`; [`read_clip`] reads an equal clip from it.
    pub fn to_csv(&self) -> String {
        let mut text = "file,time_s,phase\n".to_owned();
        for ClipEntry { file, time_s, phase } in &self.shots {
            text += &format!("{},{time_s},{}\n", quote_csv(file), phase.keyword());
        }
        text
    }
}

/// Parses and checks a `clip.csv`.
///
/// # Errors
/// If the header, a file name, a time or a phase is invalid, or no picture is in the phase wet. Only the first problem
/// is reported.
pub fn read_clip(bytes: &[u8]) -> Result<Clip, ClipError> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).trim(csv::Trim::All).from_reader(bytes);
    let mut records = reader.records();
    let header: Vec<String> = match records.next() {
        Some(Ok(header)) => header.iter().map(str::to_owned).collect(),
        Some(Err(error)) => return Err(syntax_error(&error)),
        None => Vec::new(),
    };
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let has_phase = match header[..] {
        ["file", "time_s", "phase"] => true,
        ["file", "time_s"] => false,
        _ => return Err(ClipError::Header { found: header.join(",") }),
    };
    let mut shots = Vec::new();
    for record in records {
        let record = record.map_err(|error| syntax_error(&error))?;
        let line = record.position().map_or(0, csv::Position::line);
        let problem = |problem| ClipError::Line { line, problem };
        let field = |index| record.get(index).unwrap_or_default();
        let time_s = field(1).parse().map_err(|_| problem(LineProblem::Time(field(1).to_owned())))?;
        let word = if has_phase { field(2) } else { "wet" };
        let phase = word.parse().map_err(|_| problem(LineProblem::Phase(word.to_owned())))?;
        shots.push((line, ClipEntry { file: field(0).to_owned(), time_s, phase }));
    }
    check_lines(shots)
}

fn syntax_error(error: &csv::Error) -> ClipError {
    let line = error.position().map_or(0, csv::Position::line);
    let problem = match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("found {len} values, expected {expected_len}, one for each column")
        }
        _ => error.to_string(),
    };
    ClipError::Line { line, problem: LineProblem::Syntax(problem) }
}

fn check_lines(lines: Vec<(u64, ClipEntry)>) -> Result<Clip, ClipError> {
    let mut first_lines: HashMap<&str, u64> = HashMap::new();
    let mut last_s: Option<f64> = None;
    for (line, shot) in &lines {
        let refuse = |problem| Err(ClipError::Line { line: *line, problem });
        if !is_plain_name(&shot.file) {
            return refuse(LineProblem::File(shot.file.clone()));
        }
        if let Some(first) = first_lines.insert(&shot.file, *line) {
            return refuse(LineProblem::Duplicate { file: shot.file.clone(), first });
        }
        if !shot.time_s.is_finite() {
            return refuse(LineProblem::Time(shot.time_s.to_string()));
        }
        if let Some(last_s) = last_s.filter(|last_s| shot.time_s <= *last_s) {
            return refuse(LineProblem::NotLater(shot.time_s.to_string(), last_s.to_string()));
        }
        last_s = Some(shot.time_s);
    }
    let shots: Vec<ClipEntry> = lines.into_iter().map(|(_, shot)| shot).collect();
    if shots.is_empty() {
        return Err(ClipError::Empty);
    }
    if !shots.iter().any(|shot| shot.phase == Phase::Wet) {
        return Err(ClipError::NoneWet { shots: shots.len() });
    }
    Ok(Clip { shots })
}

/// Returns whether the name is a plain file name on every system, and stays unchanged when it is written and read.
fn is_plain_name(file: &str) -> bool {
    let is_separator = |c: char| matches!(c, '/' | '\\' | ':') || c.is_control();
    !(file.is_empty() || file == "." || file.contains("..") || file.contains(is_separator) || file.trim() != file)
}

fn quote_csv(file: &str) -> String {
    match file.contains(['"', ',']) {
        true => format!("\"{}\"", file.replace('"', "\"\"")),
        false => file.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = "file,time_s,phase\n000.png,-0.5,dry\n001.png,0.0,spray\n002.png,0.2,wet\n003.png,0.4,wet\n";

    fn refusal(text: &str) -> String {
        read_clip(text.as_bytes()).expect_err("refused").to_string()
    }

    #[test]
    fn a_clip_reads_unchanged() {
        let clip = read_clip(GOOD.as_bytes()).expect("good");
        let third = ClipEntry { file: "002.png".to_owned(), time_s: 0.2, phase: Phase::Wet };
        assert_eq!((clip.entries().len(), &clip.entries()[2]), (4, &third));
        assert_eq!(clip.entries()[0].phase, Phase::Dry);
        assert_eq!(clip.entries()[1].phase, Phase::Spray);
    }

    #[test]
    fn without_phases_all_are_wet() {
        let clip = read_clip(b"file,time_s\r\na.png, 0\r\nb.png, 0.2\r\n").expect("good");
        assert!(clip.entries().iter().all(|shot| shot.phase == Phase::Wet));
    }

    #[test]
    fn each_refusal_names_the_line() {
        let cases = [
            (
                GOOD.replace("time_s", "time_ms"),
                "line 1: found the header 'file,time_ms,phase'; valid: file,time_s",
            ),
            (String::new(), "line 1: found the header ''"),
            ("file,time_s,phase\n".to_owned(), "the clip is empty"),
            (GOOD.replace("spray", "moist"), "line 3: the phase is 'moist'; valid: dry, spray or wet"),
            (GOOD.replace("wet", "dry"), "none of the clip's 4 pictures has the phase 'wet'"),
            (GOOD.replace("0.2", "NaN"), "line 4: time_s is 'NaN'; valid: a finite number"),
            (GOOD.replace("0.2", "inf"), "line 4: time_s is 'inf'"),
            (GOOD.replace("0.2", "0,2"), "line 4: found 4 values, expected 3"),
            (GOOD.replace("0.2", ""), "line 4: time_s is ''"),
            (GOOD.replace("0.4", "0.2"), "line 5: time_s is 0.2, which is not later than 0.2"),
            (GOOD.replace("003", "001"), "line 5: the file '001.png' is already listed in line 3"),
            (GOOD.replace("003", "../003"), "line 5: the file is '../003.png'; valid: a name in the clip's folder"),
            (GOOD.replace("003", "/003"), "line 5: the file is '/003.png'"),
            (GOOD.replace("003", "C:\\003"), "line 5: the file is"),
            (GOOD.replace("003.png", ".."), "line 5: the file is '..'"),
            (GOOD.replace("003.png", ""), "line 5: the file is ''"),
        ];
        for (text, expected) in cases {
            let found = refusal(&text);
            assert!(found.contains(expected), "{found}\nshould say: {expected}");
        }
        assert!(read_clip(b"file,time_s\n\xff.png,1\n").expect_err("no text").to_string().starts_with("line 2"));
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(
            steps_s in prop::collection::vec((1e-6..1e3_f64, 0_usize..3), 1..20), names in "[ a-z\",ä'#]{0,9}",
        ) {
            let mut time_s = -7.0;
            let mut shots: Vec<ClipEntry> = steps_s.iter().enumerate().map(|(index, (step_s, phase))| {
                time_s += step_s;
                ClipEntry { file: format!("{index}{names}.png"), time_s, phase: Phase::ALL[*phase] }
            }).collect();
            shots[0].phase = Phase::Wet;
            let clip = Clip::new(shots).expect("good");
            prop_assert_eq!(read_clip(clip.to_csv().as_bytes()), Ok(clip));
        }

        #[test]
        fn no_text_panics(text in "(file,time_s(,phase)?\n)?[a-z0-9,.\"\n/-]{0,80}") {
            if let Ok(clip) = read_clip(text.as_bytes()) {
                prop_assert!(clip.entries().windows(2).all(|pair| pair[0].time_s < pair[1].time_s));
            }
        }
    }
}
