//! The page and its annex as PDF/A-3, with the signed record inside: this one file contains everything that was
//! signed.

use super::content::RecordSheet;
use super::layout::{AnnexPicture, FontFaces, PAGE_PT, PageElement, pages};
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

/// A file attached to the PDF.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttachedFile {
    /// Its name.
    pub name: String,
    /// The content of the file, as text.
    pub description: String,
    /// The type of the file, such as `application/json`.
    pub mime_type: &'static str,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// The reason why there is no PDF.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the record cannot be written as PDF/A-3: {problem}")]
pub struct PdfError {
    /// The problem that was found.
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
            _ => PdfError::new("two of its parts have the same name"),
        }
    }

    fn new(problem: &str) -> Self {
        PdfError { problem: problem.to_owned() }
    }
}

/// Returns the PDF. `unix_s` is when the record was made, s since 1970: the same record gives the same bytes.
///
/// # Errors
/// If a picture is not a JPEG, or the file would not be PDF/A-3.
pub fn pdf(
    sheet: &RecordSheet,
    figures: &[Figure],
    attached: &[AttachedFile],
    unix_s: i64,
) -> Result<Vec<u8>, PdfError> {
    let faces = FontFaces::new().map_err(|error| PdfError::new(&error.to_string()))?;
    let fonts = [dejavu::sans_condensed::regular(), dejavu::sans_condensed::bold()];
    let [regular, bold] = fonts.map(|bytes| Font::new(bytes.into(), 0));
    let fonts = regular.zip(bold).ok_or_else(|| PdfError::new("a font cannot be read"))?;
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
    let size =
        PageSettings::from_wh(PAGE_PT[0], PAGE_PT[1]).ok_or_else(|| PdfError::new("the page size is not valid"))?;
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

/// Converts a time to the date format of a PDF; the date is taken from the text that people read.
fn date(unix_s: i64) -> Option<DateTime> {
    let words = utc_text(unix_s);
    let numbers: Vec<u16> =
        words.split(|sign: char| !sign.is_ascii_digit()).filter_map(|part| part.parse().ok()).collect();
    let [year, month, day, hour, minute, second] = numbers.try_into().ok()?;
    let byte = |number: u16| u8::try_from(number).ok();
    let date = DateTime::new(year).month(byte(month)?).day(byte(day)?).hour(byte(hour)?).minute(byte(minute)?);
    Some(date.second(byte(second)?).utc_offset_hour(0).utc_offset_minute(0))
}
