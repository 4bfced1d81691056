//! `panelprep new recipe`: the sample recipe with a panel's own numbers.

use super::super::args::{Common, NewRecipe};
use super::super::disk;
use super::super::fault::Fault;
use super::super::outcome::Outcome;
use super::ask::{Asker, Question};
use super::setting::set;
use crate::cell::Cell;
use crate::check::check_files;
use crate::config::{Problem, Problems};
use crate::recipe::Recipe;
use crate::verdict::{Judgement, Verdict};
use crate::words::plain;
use serde_json::json;
use toml_edit::{Array, DocumentMut, Value};

const SAMPLE: &str = include_str!("../../../config/panels/example.toml");
/// As the sample has them.
const CORNERS_PX: &str = "700,350 1250,350 1250,850 700,850";
const BOX_MM: BoxMm = [[300.0, -400.0, 100.0], [700.0, 400.0, 800.0]];
/// The sample's force, which stands there as a comment: only a recipe for a compliant tool has one.
const FORCE_COMMENT: [&str; 2] = ["# force_n = 20.0                #", "force_n = 20.0                  #"];

/// How many rows, and how many columns, a recipe may have.
const GRIDS: std::ops::RangeInclusive<u32> = 1..=50;

/// A box: its least and its greatest corner, mm in the robot's base.
type BoxMm = [[f64; 3]; 2];

/// Asks, and writes the file.
pub(super) fn run(args: &NewRecipe, common: &Common) -> Result<Outcome, Fault> {
    if args.out.symlink_metadata().is_ok() {
        return Err(Fault::IsThere { file: args.out.clone() });
    }
    let cell = cell_here(common);
    let answers = Answers::of(args, cell.as_ref().map(|(_, cell)| cell), &mut Asker::on_terminal(args.yes))?;
    let name = args.out.display().to_string();
    let text = text(&name, &answers)?;
    Recipe::check(&name, &text)?;
    if let Some((cell, _)) = &cell {
        fits((&common.cell.display().to_string(), cell), (&name, &text))?;
    }
    disk::write_new(&args.out, &text)?;
    let mut outcome = Outcome::of(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    outcome.words = vec![format!("written: {name}; `panelprep check {name}` accepts it")];
    if args.corners_px.is_none() {
        outcome.say("hold the corners of its region against a scan of your panel: `panelprep look` shows it with a pixel ruler");
    }
    outcome.put("file", json!(args.out));
    Ok(outcome)
}

/// What was answered.
struct Answers {
    panel: String,
    corners_px: [f64; 8],
    rows: f64,
    columns: f64,
    box_mm: BoxMm,
    disc_mm: f64,
    /// Of a cell whose tool presses by itself.
    force_n: Option<f64>,
}

impl Answers {
    fn of(args: &NewRecipe, cell: Option<&Cell>, asker: &mut Asker<'_>) -> Result<Self, Fault> {
        let question =
            Question::new("the panel's name, under which it is taught", "--panel", args.panel.as_deref());
        let panel = asker.words(&question)?;
        let question = Question::new("rows of grids in the region", "--rows", args.rows.as_deref());
        let rows = asker.count(&question.proposing("4"), GRIDS)?;
        let question = Question::new("columns of grids in the region", "--columns", args.columns.as_deref());
        let columns = asker.count(&question.proposing("6"), GRIDS)?;
        let words =
            "the region's four corners in the scan's picture, px, as `panelprep look` shows them: u,v u,v u,v u,v";
        let question = Question::new(words, "--corners-px", args.corners_px.as_deref());
        let corners_px = asker.numbers(&question.proposing(CORNERS_PX))?;
        let [least, greatest] =
            cell.and_then(cells_box).unwrap_or(BOX_MM).map(|corner| corner.map(plain).join(","));
        let words = "least corner of the box in which the panel is searched, mm in the robot's base: x,y,z";
        let question = Question::new(words, "--box-min-mm", args.box_min_mm.as_deref());
        let box_min = asker.numbers(&question.proposing(least))?;
        let question = Question::new("its greatest corner: x,y,z", "--box-max-mm", args.box_max_mm.as_deref());
        let box_max = asker.numbers(&question.proposing(greatest))?;
        let words = "diameter of the sanding disc's contact, mm";
        let question = Question::new(words, "--disc-diameter-mm", args.disc_diameter_mm.as_deref());
        let [disc_mm] = asker.numbers(&question.proposing("30"))?;
        let is_compliant = cell.is_some_and(|cell| cell.tool().compliant().is_some());
        let force_n = if is_compliant || args.force_n.is_some() {
            let words = "force with which the cell's compliant tool presses, N";
            let question = Question::new(words, "--force-n", args.force_n.as_deref());
            let [force_n] = asker.numbers(&question.proposing("20"))?;
            Some(force_n)
        } else {
            None
        };
        Ok(Answers { panel, corners_px, rows, columns, box_mm: [box_min, box_max], disc_mm, force_n })
    }
}

/// The cell's file with its text, where there is one that is right.
fn cell_here(common: &Common) -> Option<(String, Cell)> {
    let text = disk::read_text(&common.cell).ok()?;
    let cell = Cell::check(&common.cell.display().to_string(), &text).ok()?;
    Some((text, cell))
}

/// Whether the cell can do what the recipe asks for, as `panelprep check` sees it.
fn fits(cell: (&str, &str), recipe: (&str, &str)) -> Result<(), Fault> {
    let report = check_files(&[cell, recipe], None).pop();
    let problems = Problems { file: recipe.0.to_owned(), list: report.map_or(vec![], |report| report.problems) };
    if problems.list.is_empty() { Ok(()) } else { Err(Fault::Configuration(problems)) }
}

/// The box of the cell in which the tool's tip stays.
fn cells_box(cell: &Cell) -> Option<BoxMm> {
    let workspace = cell.limits().workspace()?;
    Some([workspace.min, workspace.max].map(|corner| [corner.mm.x, corner.mm.y, corner.mm.z]))
}

/// The sample with these answers.
fn text(name: &str, answers: &Answers) -> Result<String, Fault> {
    let Answers { panel, corners_px, rows, columns, box_mm: [least, greatest], disc_mm, force_n } = answers;
    let [as_comment, as_key] = FORCE_COMMENT;
    let mut recipe = match force_n {
        Some(_) => parsed(name, &SAMPLE.replacen(as_comment, as_key, 1))?,
        None => parsed(name, SAMPLE)?,
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
    // The comment beside it names the last grid.
    let grids = format!("r{}c{}", plain(*rows), plain(*columns));
    Ok(recipe.to_string().replace("r1c1 … r4c6", &format!("r1c1 … {grids}")))
}

/// The text as a document.
pub(super) fn parsed(name: &str, text: &str) -> Result<DocumentMut, Fault> {
    text.parse().map_err(|error: toml_edit::TomlError| {
        let problem = Problem { line: 1, key: String::new(), message: error.to_string() };
        Fault::Configuration(Problems { file: name.to_owned(), list: vec![problem] })
    })
}
