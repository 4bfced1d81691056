//! The page and its annex as PDF/A-3, with the signed record attached, so that this one file contains everything that
//! was signed.
//!
//! First, the position of each text, rectangle and picture is computed: a list of elements for each page, with
//! positions in points from the upper left corner of the page. Then the elements are drawn.

use super::sheet::RecordSheet;
use super::tables::{Block, GridMap, GridState};
use crate::report::page::Figure;
use krilla::color::rgb;
use krilla::configure::{Archival, ConfigurationBuilder};
use krilla::embed::{AssociationKind, EmbeddedFile, MimeType};
use krilla::error::KrillaError;
use krilla::geom::{PathBuilder, Point, Rect, Size, Transform};
use krilla::image::Image;
use krilla::metadata::{DateTime, Metadata};
use krilla::page::PageSettings;
use krilla::paint::{Fill, Stroke};
use krilla::surface::Surface;
use krilla::text::{Font, TextDirection};
use krilla::{Document, SerializeSettings};
use panelprep_base::number_text::utc_text;
use ttf_parser::{Face, FaceParsingError};

/// A file attached to the PDF.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttachedFile {
    /// Its name.
    pub name: String,
    /// Text that describes the content of the file.
    pub description: String,
    /// The type of the file, such as `application/json`.
    pub mime_type: &'static str,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// The reason why the PDF cannot be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the record cannot be written as PDF/A-3: {problem}")]
pub struct PdfError {
    /// Description of the problem.
    pub problem: String,
}

impl PdfError {
    fn from_krilla(error: &KrillaError) -> Self {
        match error {
            KrillaError::Validation(broken) => {
                PdfError { problem: format!("{} rules of the standard are violated", broken.len()) }
            }
            KrillaError::Font(_, why) => PdfError { problem: format!("a font: {why}") },
            KrillaError::Image(_, _, why) => PdfError { problem: format!("a picture: {why}") },
            KrillaError::Limit(_) => PdfError::new("the document is too large"),
            _ => PdfError::new("two parts of the document have the same name"),
        }
    }

    fn new(problem: &str) -> Self {
        PdfError { problem: problem.to_owned() }
    }
}

/// Returns the PDF. `unix_s` is the time at which the record was created, s since 1970. The same record always gives
/// the same bytes.
///
/// # Errors
/// If a picture is not a JPEG, or the file would not be valid PDF/A-3.
pub fn pdf(
    sheet: &RecordSheet,
    figures: &[Figure],
    attached: &[AttachedFile],
    unix_s: i64,
) -> Result<Vec<u8>, PdfError> {
    let faces = FontFaces::new().map_err(|error| PdfError::new(&error.to_string()))?;
    let fonts = [dejavu::sans_condensed::regular(), dejavu::sans_condensed::bold()];
    let [regular, bold] = fonts.map(|bytes| Font::new(bytes.into(), 0));
    let fonts = regular.zip(bold).ok_or_else(|| PdfError::new("a font of the program cannot be read"))?;
    let image = |figure: &Figure| {
        Image::from_jpeg(figure.jpeg.clone().into(), false).map_err(|error| PdfError::new(&error))
    };
    let images: Vec<Image> = figures.iter().map(image).collect::<Result<_, _>>()?;
    let shown = figures.iter().zip(&images);
    let shown: Vec<AnnexPicture<'_>> = shown
        .map(|(figure, image)| AnnexPicture { caption: &figure.caption, size_px: image.size().into() })
        .collect();
    let (laid, _) = pages(sheet, &shown, &faces);
    let archival = ConfigurationBuilder::new().with_archival_validator(Archival::A3_B).finish();
    let settings = SerializeSettings {
        configuration: archival.map_err(|_| PdfError::new("the PDF library does not support the standard"))?,
        ..SerializeSettings::default()
    };
    let mut document = Document::new_with(settings);
    let date = date(unix_s).ok_or_else(|| PdfError::new("the time of the record is not a valid date"))?;
    document.set_metadata(
        Metadata::new()
            .title(sheet.title.clone())
            .description(sheet.disposition.clone())
            .creator(format!("panelprep {}", env!("CARGO_PKG_VERSION")))
            .language("en".to_owned())
            .creation_date(date),
    );
    let size = PageSettings::from_wh(PAGE_SIZE_PT[0], PAGE_SIZE_PT[1])
        .ok_or_else(|| PdfError::new("the page size is not valid"))?;
    for marks in &laid {
        let mut page = document.start_page_with(size.clone());
        let mut surface = page.surface();
        marks.iter().for_each(|mark| draw(&mut surface, mark, &fonts, &images));
        surface.finish();
        page.finish();
    }
    for file in attached {
        let embedded =
            embed_file(file, date).ok_or_else(|| PdfError::new("the type of an attached file is unknown"))?;
        document.embed_file(embedded).ok_or_else(|| PdfError::new("two attached files have the same name"))?;
    }
    document.finish().map_err(|error| PdfError::from_krilla(&error))
}

fn embed_file(file: &AttachedFile, date: DateTime) -> Option<EmbeddedFile> {
    Some(EmbeddedFile {
        path: file.name.clone(),
        mime_type: Some(MimeType::new(file.mime_type)?),
        description: Some(file.description.clone()),
        association_kind: AssociationKind::Source,
        data: file.bytes.clone().into(),
        modification_date: Some(date),
        compress: Some(true),
        location: None,
    })
}

fn to_fill([red, green, blue]: [u8; 3]) -> Fill {
    Fill { paint: rgb::Color::new(red, green, blue).into(), ..Fill::default() }
}

fn to_stroke(width: f32) -> Stroke {
    Stroke { paint: rgb::Color::new(60, 60, 60).into(), width, ..Stroke::default() }
}

fn draw(surface: &mut Surface<'_>, mark: &PageElement, fonts: &(Font, Font), images: &[Image]) {
    match mark {
        PageElement::Text { at: [x, y], size_pt, bold, colour, text } => {
            let font = if *bold { fonts.1.clone() } else { fonts.0.clone() };
            surface.set_stroke(None);
            surface.set_fill(Some(to_fill(*colour)));
            surface.draw_text(Point::from_xy(*x, *y), font, *size_pt, text, false, TextDirection::LeftToRight);
        }
        PageElement::Line { from, to, width_pt } => {
            let mut path = PathBuilder::new();
            path.move_to(from[0], from[1]);
            path.line_to(to[0], to[1]);
            surface.set_fill(None);
            surface.set_stroke(Some(to_stroke(*width_pt)));
            if let Some(path) = path.finish() {
                surface.draw_path(&path);
            }
        }
        PageElement::Cell { at: [x, y], side_pt, colour } => {
            let mut path = PathBuilder::new();
            if let Some(rect) = Rect::from_xywh(*x, *y, *side_pt, *side_pt) {
                path.push_rect(rect);
            }
            surface.set_fill(Some(to_fill(*colour)));
            surface.set_stroke(Some(to_stroke(0.4)));
            if let Some(path) = path.finish() {
                surface.draw_path(&path);
            }
        }
        PageElement::Picture { at: [x, y], size: [width, height], number } => {
            if let (Some(image), Some(size)) = (images.get(*number), Size::from_wh(*width, *height)) {
                surface.push_transform(&Transform::from_translate(*x, *y));
                surface.draw_image(image.clone(), size);
                surface.pop();
            }
        }
    }
}

/// Converts a time to the date format of PDF, from the text that people read.
fn date(unix_s: i64) -> Option<DateTime> {
    let words = utc_text(unix_s);
    let numbers: Vec<u16> =
        words.split(|sign: char| !sign.is_ascii_digit()).filter_map(|part| part.parse().ok()).collect();
    let [year, month, day, hour, minute, second] = numbers.try_into().ok()?;
    let byte = |number: u16| u8::try_from(number).ok();
    let date = DateTime::new(year).month(byte(month)?).day(byte(day)?).hour(byte(hour)?).minute(byte(minute)?);
    Some(date.second(byte(second)?).utc_offset_hour(0).utc_offset_minute(0))
}

/// A4, points.
const PAGE_SIZE_PT: [f32; 2] = [595.0, 842.0];
const MARGIN_PT: f32 = 34.0;
const TEXT_PT: f32 = 7.0;
const LINE_HEIGHT_FACTOR: f32 = 1.28;
const HEADING_PT: f32 = 8.2;
const TITLE_PT: f32 = 13.0;
/// Maximum length of the longer side of the map, pt.
const MAX_MAP_SIDE_PT: f32 = 150.0;
/// Maximum side of a grid's cell in the map, pt.
const MAX_CELL_SIDE_PT: f32 = 18.0;
const GREY: [u8; 3] = [90, 90, 90];
const BLACK: [u8; 3] = [0, 0, 0];

/// An element of a page.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum PageElement {
    /// A line of text; the position is the left end of its baseline.
    Text { at: [f32; 2], size_pt: f32, bold: bool, colour: [u8; 3], text: String },
    /// A line.
    Line { from: [f32; 2], to: [f32; 2], width_pt: f32 },
    /// A filled rectangle with its outline.
    Cell { at: [f32; 2], side_pt: f32, colour: [u8; 3] },
    /// The picture with this index, scaled to this box.
    Picture { at: [f32; 2], size: [f32; 2], number: usize },
}

/// A picture of the annex.
#[derive(Debug, Clone, Copy)]
pub(super) struct AnnexPicture<'p> {
    /// Caption of the picture.
    pub caption: &'p str,
    /// Its size, px.
    pub size_px: [u32; 2],
}

/// The two fonts from which the widths of texts are computed.
pub(super) struct FontFaces {
    regular: Face<'static>,
    bold: Face<'static>,
}

impl FontFaces {
    pub fn new() -> Result<Self, FaceParsingError> {
        Ok(FontFaces {
            regular: Face::parse(dejavu::sans_condensed::regular(), 0)?,
            bold: Face::parse(dejavu::sans_condensed::bold(), 0)?,
        })
    }

    fn font_face(&self, bold: bool) -> &Face<'static> {
        if bold { &self.bold } else { &self.regular }
    }

    fn width(&self, text: &str, (size_pt, bold): (f32, bool)) -> f32 {
        let face = self.font_face(bold);
        let advance = |sign| face.glyph_index(sign).and_then(|glyph| face.glyph_hor_advance(glyph)).unwrap_or(0);
        let units: f32 = text.chars().map(|sign| f32::from(advance(sign))).sum();
        units * size_pt / f32::from(face.units_per_em())
    }

    /// Returns the text in which each character that is missing in the font is replaced by its Unicode number.
    fn printable(&self, text: &str) -> String {
        let mut printable = String::with_capacity(text.len());
        for sign in text.chars() {
            match sign {
                sign if sign.is_whitespace() => printable.push(' '),
                sign if self.regular.glyph_index(sign).is_some() && self.bold.glyph_index(sign).is_some() => {
                    printable.push(sign);
                }
                sign => printable += &format!("[U+{:04X}]", u32::from(sign)),
            }
        }
        printable
    }

    /// Splits a text into lines of at most this width; a word that is wider is split as well.
    fn wrap_text(&self, text: &str, style: (f32, bool), width_pt: f32) -> Vec<String> {
        let mut lines = vec![String::new()];
        for word in self.printable(text).split(' ').filter(|word| !word.is_empty()) {
            let line = lines.last().cloned().unwrap_or_default();
            let joined = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
            if self.width(&joined, style) <= width_pt {
                lines.pop();
                lines.push(joined);
                continue;
            }
            if line.is_empty() {
                lines.pop();
            }
            lines.push(String::new());
            for sign in word.chars() {
                let line = lines.last().cloned().unwrap_or_default();
                let longer = format!("{line}{sign}");
                if self.width(&longer, style) > width_pt && !line.is_empty() {
                    lines.push(sign.to_string());
                } else {
                    lines.pop();
                    lines.push(longer);
                }
            }
        }
        lines
    }
}

/// The pages of the layout in progress, and the vertical position of the next element.
struct PageLayout<'f> {
    faces: &'f FontFaces,
    pages: Vec<Vec<PageElement>>,
    y: f32,
}

/// Returns the elements of each page, and the number of pages before the annex.
pub(super) fn pages(
    sheet: &RecordSheet,
    pictures: &[AnnexPicture<'_>],
    faces: &FontFaces,
) -> (Vec<Vec<PageElement>>, usize) {
    let mut laying = PageLayout { faces, pages: vec![vec![]], y: MARGIN_PT };
    laying.text(&sheet.title, (TITLE_PT, true), BLACK);
    laying.text(&sheet.disposition, (HEADING_PT, true), BLACK);
    laying.facts(&sheet.facts);
    match &sheet.map {
        Ok(map) => laying.map(map),
        Err(why) => laying.text(&format!("No map of the panel: {why}."), (TEXT_PT, false), GREY),
    }
    sheet.blocks.iter().for_each(|block| laying.table(block));
    let first = laying.pages.len();
    if !sheet.annex.is_empty() || !pictures.is_empty() {
        laying.begin_page();
        laying.text(&format!("Annex: {}", sheet.title), (TITLE_PT, true), BLACK);
    }
    sheet.annex.iter().for_each(|block| laying.table(block));
    for (number, shown) in pictures.iter().enumerate() {
        laying.picture(number, shown);
    }
    laying.add_page_footers(&sheet.title);
    (laying.pages, first)
}

impl PageLayout<'_> {
    fn add_element(&mut self, mark: PageElement) {
        if let Some(page) = self.pages.last_mut() {
            page.push(mark);
        }
    }

    fn begin_page(&mut self) {
        self.pages.push(Vec::new());
        self.y = MARGIN_PT;
    }

    /// Begins a new page if less than this height is left on the current page.
    fn ensure_height(&mut self, height_pt: f32) {
        if self.y + height_pt > PAGE_SIZE_PT[1] - MARGIN_PT && self.y > MARGIN_PT {
            self.begin_page();
        }
    }

    fn text(&mut self, text: &str, (size_pt, bold): (f32, bool), colour: [u8; 3]) {
        for text in self.faces.wrap_text(text, (size_pt, bold), PAGE_SIZE_PT[0] - 2.0 * MARGIN_PT) {
            self.ensure_height(size_pt * LINE_HEIGHT_FACTOR);
            self.y += size_pt * LINE_HEIGHT_FACTOR;
            self.add_element(PageElement::Text {
                at: [MARGIN_PT, self.y - 0.25 * size_pt],
                size_pt,
                bold,
                colour,
                text,
            });
        }
    }

    /// Adds cells side by side, each with its text wrapped to the width of its column: x, width, colour, text.
    fn row(&mut self, cells: &[(f32, f32, [u8; 3], &str)], style: (f32, bool)) {
        let wrapped: Vec<Vec<String>> =
            cells.iter().map(|(_, width, _, text)| self.faces.wrap_text(text, style, width - 4.0)).collect();
        let lines = wrapped.iter().map(Vec::len).max().unwrap_or(1);
        let line_pt = style.0 * LINE_HEIGHT_FACTOR;
        self.ensure_height(lines as f32 * line_pt + 2.0);
        for ((x, _, colour, _), texts) in cells.iter().zip(wrapped) {
            for (index, text) in texts.into_iter().enumerate() {
                let y = self.y + (index + 1) as f32 * line_pt - 0.25 * style.0;
                self.add_element(PageElement::Text {
                    at: [*x, y],
                    size_pt: style.0,
                    bold: style.1,
                    colour: *colour,
                    text,
                });
            }
        }
        self.y += lines as f32 * line_pt + 1.0;
        let (from, to) = ([MARGIN_PT, self.y], [PAGE_SIZE_PT[0] - MARGIN_PT, self.y]);
        self.add_element(PageElement::Line { from, to, width_pt: 0.25 });
        self.y += 1.0;
    }

    fn facts(&mut self, facts: &[(String, String)]) {
        self.y += 4.0;
        let half = (PAGE_SIZE_PT[0] - 2.0 * MARGIN_PT) / 2.0;
        let (name, value) = (0.33 * half, 0.67 * half);
        for pair in facts.chunks(2) {
            let cells: Vec<(f32, f32, [u8; 3], &str)> = pair
                .iter()
                .enumerate()
                .flat_map(|(index, (named, text))| {
                    let x = MARGIN_PT + index as f32 * half;
                    [(x, name, GREY, named.as_str()), (x + name, value, BLACK, text.as_str())]
                })
                .collect();
            self.row(&cells, (TEXT_PT, false));
        }
    }

    fn table(&mut self, block: &Block) {
        // A heading stays on the same page as its first row.
        self.ensure_height(HEADING_PT * LINE_HEIGHT_FACTOR + 4.0 * TEXT_PT * LINE_HEIGHT_FACTOR);
        self.y += 3.0;
        self.text(&block.heading, (HEADING_PT, true), BLACK);
        let width = PAGE_SIZE_PT[0] - 2.0 * MARGIN_PT;
        let mut columns = Vec::new();
        let mut x = MARGIN_PT;
        for (head, share) in &block.columns {
            columns.push((x, share * width, *head));
            x += share * width;
        }
        let heads: Vec<(f32, f32, [u8; 3], &str)> =
            columns.iter().map(|(x, width, head)| (*x, *width, GREY, *head)).collect();
        self.row(&heads, (TEXT_PT, false));
        for row in &block.rows {
            let cells: Vec<(f32, f32, [u8; 3], &str)> =
                columns.iter().zip(row).map(|((x, width, _), text)| (*x, *width, BLACK, text.as_str())).collect();
            self.row(&cells, (TEXT_PT, false));
        }
    }

    fn map(&mut self, map: &GridMap) {
        let most = map.columns.max(map.rows.len()).max(1) as f32;
        let side = MAX_CELL_SIDE_PT.min(MAX_MAP_SIDE_PT / most);
        let height = (map.rows.len() as f32 * side).max(4.0 * 13.0);
        self.ensure_height(height + 8.0);
        self.y += 5.0;
        let top = self.y;
        for (row, states) in map.rows.iter().enumerate() {
            for (column, state) in states.iter().enumerate() {
                self.cell([MARGIN_PT + column as f32 * side, top + row as f32 * side], side, *state);
            }
        }
        let x = MARGIN_PT + map.columns as f32 * side + 18.0;
        for (index, state) in GridState::ALL.into_iter().enumerate() {
            let y = top + 13.0 * index as f32;
            self.cell([x, y], 11.0, state);
            let count = map.rows.iter().flatten().filter(|one| **one == state).count();
            let text = format!("{}: {count}", state.describe());
            let at = [x + 16.0, y + 8.0];
            self.add_element(PageElement::Text { at, size_pt: TEXT_PT, bold: false, colour: BLACK, text });
        }
        self.y = top + height + 3.0;
    }

    fn cell(&mut self, at: [f32; 2], side_pt: f32, state: GridState) {
        self.add_element(PageElement::Cell { at, side_pt, colour: state.state_color() });
        let ([x, y], [down, up]) = (at, state.hatch_directions());
        if down {
            self.add_element(PageElement::Line { from: [x, y], to: [x + side_pt, y + side_pt], width_pt: 0.4 });
        }
        if up {
            self.add_element(PageElement::Line { from: [x, y + side_pt], to: [x + side_pt, y], width_pt: 0.4 });
        }
        let size_pt = (0.6 * side_pt).min(8.0);
        if size_pt >= 3.0 {
            let text = state.state_letter().to_owned();
            let at = [
                x + (side_pt - self.faces.width(&text, (size_pt, true))) / 2.0,
                y + side_pt / 2.0 + 0.36 * size_pt,
            ];
            self.add_element(PageElement::Text { at, size_pt, bold: true, colour: BLACK, text });
        }
    }

    fn picture(&mut self, number: usize, shown: &AnnexPicture<'_>) {
        let room = [PAGE_SIZE_PT[0] - 2.0 * MARGIN_PT, 330.0];
        let [width, height] = shown.size_px.map(|px| px.max(1) as f32);
        let scale = (room[0] / width).min(room[1] / height);
        let size = [width * scale, height * scale];
        self.ensure_height(size[1] + 3.0 * TEXT_PT * LINE_HEIGHT_FACTOR);
        self.y += 6.0;
        self.add_element(PageElement::Picture { at: [MARGIN_PT, self.y], size, number });
        self.y += size[1];
        self.text(shown.caption, (TEXT_PT, false), GREY);
    }

    /// Adds a footer to each page.
    fn add_page_footers(&mut self, title: &str) {
        let all = self.pages.len();
        for (index, page) in self.pages.iter_mut().enumerate() {
            let text = self.faces.printable(&format!("{title} · page {} of {all}", index + 1));
            let at = [MARGIN_PT, PAGE_SIZE_PT[1] - 0.55 * MARGIN_PT];
            page.push(PageElement::Text { at, size_pt: 6.0, bold: false, colour: GREY, text });
        }
    }
}
