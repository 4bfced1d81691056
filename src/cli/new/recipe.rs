//! `panelprep new recipe`: writes the sample recipe with the values of a panel.

use super::super::args::{Common, NewRecipe};
use super::super::disk;
use super::super::fault::Fault;
use super::super::output::Outcome;
use super::questions::{Asker, BoxMm, Question, Refusal, format_numbers, refusal, set};
use panelprep_base::config::{Problem, Problems};
use panelprep_base::number_text::shortest_text;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cell::Cell;
use panelprep_service::requirements::recipe_fits::{parse_plausible_recipe, unmet_demands};
use panelprep_service::requirements::to_problems;
use serde_json::json;
use toml_edit::{Array, DocumentMut, Value};

const SAMPLE: &str = include_str!("../../../config/panels/example.toml");
/// The corners of the region in the sample recipe, px; the next constant is its search box.
const CORNERS_PX: [f64; 8] = [700.0, 350.0, 1250.0, 350.0, 1250.0, 850.0, 700.0, 850.0];
const SAMPLE_BOX_MM: BoxMm = [[300.0, -400.0, 100.0], [700.0, 400.0, 800.0]];
/// The line with the force in the sample recipe, where it is a comment, and the same line without the comment mark:
/// only a recipe for a compliant tool states a force.
const FORCE_COMMENT: [&str; 2] = ["# force_n = 20.0                #", "force_n = 20.0                  #"];

/// Minimum and maximum number of rows, and of columns, of grids.
const GRID_COUNT_LIMITS: std::ops::RangeInclusive<u32> = 1..=50;

/// Asks the questions and writes the recipe.
pub(super) fn run(args: &NewRecipe, common: &Common) -> Result<Outcome, Fault> {
    if args.out.symlink_metadata().is_ok() {
        return Err(Fault::AlreadyExists { file: args.out.clone() });
    }
    let name = args.out.display().to_string();
    let cell = disk::read_text(&common.cell).ok();
    let cell = cell.and_then(|text| Cell::check(&common.cell.display().to_string(), &text).ok());
    let held = RecipeContext { name: &name, cell: cell.as_ref() };
    let answers = Answers::ask_questions(args, held, &mut Asker::for_terminal(args.yes))?;
    let text = text(&name, &answers)?;
    let problems = held.problems(&text);
    if !problems.list.is_empty() {
        return Err(problems.into());
    }
    disk::write_new(&args.out, &text)?;
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    outcome.lines = vec![format!("written: {name}; `panelprep check {name}` accepts it")];
    if cell.is_none() {
        let cell = common.cell.display();
        outcome.add_line(format!(
            "the recipe was not compared with a cell: {cell} does not exist or is not valid; `panelprep check {cell} {name}` compares both"
        ));
    }
    if args.corners_px.is_none() {
        outcome.add_line("compare the corners of the region with a scan of your panel: `panelprep look` draws the scan with a pixel ruler");
    }
    outcome.add_value("file", json!(args.out));
    Ok(outcome)
}

/// The context in which an answer is checked: the recipe with this answer, and the cell that will execute it.
#[derive(Clone, Copy)]
struct RecipeContext<'a> {
    /// The recipe's file.
    name: &'a str,
    /// The cell, if its file exists and is valid.
    cell: Option<&'a Cell>,
}

impl RecipeContext<'_> {
    /// Returns the problems that `panelprep check` finds in the recipe together with the cell.
    fn problems(&self, text: &str) -> Problems {
        let list = match (parse_plausible_recipe(self.name, text), self.cell) {
            (Err(problems), _) => return problems,
            (Ok(recipe), Some(cell)) => to_problems(text, unmet_demands(cell, &recipe, &disk::read_referenced)),
            (Ok(_), None) => vec![],
        };
        Problems { file: self.name.to_owned(), list }
    }

    /// Checks that the recipe with these answers has no problem at keys that begin with `keys`.
    fn check_recipe(&self, keys: &str, answers: &Answers) -> Refusal {
        let text = text(self.name, answers).map_err(|fault| fault.to_string())?;
        refusal(self.problems(&text).list, keys)
    }
}

/// The answers; initially the proposed values.
#[derive(Clone)]
struct Answers {
    panel: String,
    corners_px: [f64; 8],
    rows: f64,
    columns: f64,
    box_mm: BoxMm,
    disc_mm: f64,
    /// The force of the tool, N; only for a cell with a compliant tool.
    force_n: Option<f64>,
}

impl Answers {
    fn proposed_answers(cell: Option<&Cell>) -> Self {
        let is_compliant = cell.is_some_and(|cell| cell.tool().compliant().is_some());
        Answers {
            panel: "panel".to_owned(),
            corners_px: CORNERS_PX,
            rows: 4.0,
            columns: 6.0,
            box_mm: cell.and_then(cells_box).unwrap_or(SAMPLE_BOX_MM),
            disc_mm: 30.0,
            force_n: is_compliant.then_some(20.0),
        }
    }

    fn ask_questions(args: &NewRecipe, held: RecipeContext<'_>, asker: &mut Asker<'_>) -> Result<Self, Fault> {
        let mut answers = Answers::proposed_answers(held.cell);
        let question =
            Question::new("the panel's name, under which it is taught", "--panel", args.panel.as_deref());
        answers.panel = asker.ask_text(&question, |panel| {
            held.check_recipe("panel", &Answers { panel: panel.clone(), ..answers.clone() })
        })?;
        let question = Question::new("rows of grids in the region", "--rows", args.rows.as_deref());
        answers.rows = asker.count(&question.with_proposal(shortest_text(answers.rows)), GRID_COUNT_LIMITS)?;
        let question = Question::new("columns of grids in the region", "--columns", args.columns.as_deref());
        answers.columns =
            asker.count(&question.with_proposal(shortest_text(answers.columns)), GRID_COUNT_LIMITS)?;
        let words =
            "the region's four corners in the scan's picture, px, as `panelprep look` shows them: u,v u,v u,v u,v";
        let question = Question::new(words, "--corners-px", args.corners_px.as_deref());
        let proposal: Vec<String> = answers.corners_px.chunks(2).map(format_numbers).collect();
        answers.corners_px = asker.numbers(&question.with_proposal(proposal.join(" ")), |corners_px| {
            held.check_recipe("region", &Answers { corners_px: *corners_px, ..answers.clone() })
        })?;
        let [least, greatest] = answers.box_mm.map(|corner| format_numbers(&corner));
        let words = "minimum corner of the box in which the panel is searched, mm in the robot's base: x,y,z";
        let corners = [
            Question::new(words, "--box-min-mm", args.box_min_mm.as_deref()).with_proposal(least),
            Question::new("maximum corner of this box: x,y,z", "--box-max-mm", args.box_max_mm.as_deref())
                .with_proposal(greatest),
        ];
        answers.box_mm = asker.box_mm(corners, |box_mm| {
            held.check_recipe("locate", &Answers { box_mm: *box_mm, ..answers.clone() })
        })?;
        let words = "diameter of the sanding disc's contact, mm";
        let question = Question::new(words, "--disc-diameter-mm", args.disc_diameter_mm.as_deref());
        [answers.disc_mm] =
            asker.numbers(&question.with_proposal(shortest_text(answers.disc_mm)), |[disc_mm]| {
                held.check_recipe("path.disc_diameter_mm", &Answers { disc_mm: *disc_mm, ..answers.clone() })
            })?;
        if answers.force_n.is_some() || args.force_n.is_some() {
            let words = "force with which the cell's compliant tool presses, N";
            let question = Question::new(words, "--force-n", args.force_n.as_deref());
            let [force_n] = asker.numbers(&question.with_proposal("20"), |[force_n]| {
                held.check_recipe("path.force_n", &Answers { force_n: Some(*force_n), ..answers.clone() })
            })?;
            answers.force_n = Some(force_n);
        }
        Ok(answers)
    }
}

/// Returns the box of the cell in which the TCP must stay.
fn cells_box(cell: &Cell) -> Option<BoxMm> {
    let workspace = cell.limits().workspace()?;
    Some([workspace.min, workspace.max].map(|corner| [corner.mm.x, corner.mm.y, corner.mm.z]))
}

/// Returns the sample recipe with these answers.
fn text(name: &str, answers: &Answers) -> Result<String, Fault> {
    let Answers { panel, corners_px, rows, columns, box_mm: [least, greatest], disc_mm, force_n } = answers;
    let [as_comment, as_key] = FORCE_COMMENT;
    let mut recipe = match force_n {
        Some(_) => parse_document(name, &SAMPLE.replacen(as_comment, as_key, 1))?,
        None => parse_document(name, SAMPLE)?,
    };
    set(&mut recipe, "", "panel", panel.as_str());
    let corners = corners_px.chunks(2).map(|corner| Value::Array(corner.iter().copied().collect::<Array>()));
    set(&mut recipe, "region", "corners_px", corners.collect::<Array>());
    let whole = |number: f64| if number.fract() == 0.0 { Value::from(number as i64) } else { Value::from(number) };
    set(&mut recipe, "region", "rows", whole(*rows));
    set(&mut recipe, "region", "columns", whole(*columns));
    set(&mut recipe, "locate", "box_min_mm", least.iter().copied().collect::<Array>());
    set(&mut recipe, "locate", "box_max_mm", greatest.iter().copied().collect::<Array>());
    set(&mut recipe, "path", "disc_diameter_mm", *disc_mm);
    if let Some(force_n) = force_n {
        set(&mut recipe, "path", "force_n", *force_n);
    }
    // The comment on this line of the sample names the last grid.
    let grids = format!("r{}c{}", shortest_text(*rows), shortest_text(*columns));
    Ok(recipe.to_string().replace("r1c1 … r4c6", &format!("r1c1 … {grids}")))
}

/// Parses a text as a TOML document.
pub(super) fn parse_document(name: &str, text: &str) -> Result<DocumentMut, Fault> {
    text.parse().map_err(|error: toml_edit::TomlError| {
        let problem = Problem { line: 1, key: String::new(), message: error.to_string() };
        Problems { file: name.to_owned(), list: vec![problem] }.into()
    })
}
