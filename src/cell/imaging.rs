//! OpenCV's filters and contours for the program's own pictures.
//!
//! OpenCV's matrices stay inside this module. OpenCV only computes; other modules read and write the pictures. The
//! results of its filters do not depend on the number of threads.

use opencv::core::{
    BORDER_DEFAULT, CV_8UC1, CV_32S, Mat, MatTraitConst, MatTraitConstManual, Point2f, Point2i, Vector,
};
use opencv::imgproc;
use panelprep_base::geometry::{GrayPicture, Mask, Pixel};

/// OpenCV refused its input: the operation, and OpenCV's message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("OpenCV could not compute {operation}: {words}")]
pub struct ImagingError {
    /// The name of the operation that failed.
    pub operation: &'static str,
    /// The message of OpenCV.
    pub words: String,
}

/// Adds the name of the operation to OpenCV's error.
pub fn with_operation<T>(operation: &'static str, result: opencv::Result<T>) -> Result<T, ImagingError> {
    result.map_err(|error| ImagingError { operation, words: error.message })
}

/// Reduces noise and keeps edges (thesis Fig. 3.18). Pixels within `diameter_px` are averaged with weights that depend
/// on their distance and, with the standard deviation `sigma_gray`, on the difference of their grey values.
///
/// # Errors
/// If OpenCV refuses the picture, for example because it is empty.
pub fn bilateral_filter(
    picture: &GrayPicture,
    diameter_px: usize,
    sigma_gray: f64,
) -> Result<GrayPicture, ImagingError> {
    const OPERATION: &str = "the bilateral filter";
    let mut filtered = Mat::default();
    let source = with_operation(OPERATION, view(picture.height, picture.width, &picture.gray))?;
    let border = BORDER_DEFAULT;
    let space = diameter_px as f64 / 2.0;
    with_operation(
        OPERATION,
        imgproc::bilateral_filter(&source, &mut filtered, diameter_px as i32, sigma_gray, space, border),
    )?;
    let gray = with_operation(OPERATION, filtered.data_bytes())?.to_vec();
    Ok(GrayPicture { width: picture.width, height: picture.height, gray })
}

/// Returns all pixels of each outer contour of a mask, the contour with the largest area first.
///
/// # Errors
/// If OpenCV refuses the mask, for example because it is empty.
pub fn outer_contours(mask: &Mask) -> Result<Vec<Vec<Pixel>>, ImagingError> {
    const OPERATION: &str = "contours";
    let bytes = mask.to_gray().gray;
    let source = with_operation(OPERATION, view(mask.height, mask.width, &bytes))?;
    let mut found: Vector<Vector<Point2i>> = Vector::new();
    let (mode, method) = (imgproc::RETR_EXTERNAL, imgproc::CHAIN_APPROX_NONE);
    with_operation(OPERATION, imgproc::find_contours(&source, &mut found, mode, method, Point2i::new(0, 0)))?;
    let mut contours: Vec<(f64, Vec<Pixel>)> = Vec::with_capacity(found.len());
    for contour in &found {
        let area = with_operation(OPERATION, imgproc::contour_area(&contour, false))?;
        let pixels = contour.iter().map(|point| Pixel::at(point.x.into(), point.y.into())).collect();
        contours.push((area, pixels));
    }
    contours.sort_by(|a, b| b.0.total_cmp(&a.0));
    Ok(contours.into_iter().map(|(_, pixels)| pixels).collect())
}

/// Returns the pixels of each connected component of a mask, row by row. With `by_corners`, pixels with a common corner
/// are connected as well.
///
/// # Errors
/// If OpenCV refuses the mask, for example because it is empty.
pub fn connected_components(mask: &Mask, by_corners: bool) -> Result<Vec<Vec<usize>>, ImagingError> {
    const OPERATION: &str = "connected pieces";
    let bytes = mask.to_gray().gray;
    let source = with_operation(OPERATION, view(mask.height, mask.width, &bytes))?;
    let mut labels = Mat::default();
    let neighbours = if by_corners { 8 } else { 4 };
    let count = with_operation(OPERATION, imgproc::connected_components(&source, &mut labels, neighbours, CV_32S))?;
    // The label 0 is the area outside of the mask.
    let mut pieces = vec![Vec::new(); usize::try_from(count).unwrap_or_default().saturating_sub(1)];
    for (index, &label) in with_operation(OPERATION, labels.data_typed::<i32>())?.iter().enumerate() {
        let piece = usize::try_from(label).ok().and_then(|label| pieces.get_mut(label.checked_sub(1)?));
        if let Some(piece) = piece {
            piece.push(index);
        }
    }
    Ok(pieces)
}

/// Returns the corners of the smallest rectangle around these pixels, in any orientation (thesis Fig. 3.20).
///
/// # Errors
/// If OpenCV refuses the pixels, for example because there are none.
pub fn min_area_box(pixels: &[Pixel]) -> Result<[Pixel; 4], ImagingError> {
    const OPERATION: &str = "the smallest box";
    let points: Vector<Point2f> = pixels.iter().map(|p| Point2f::new(p.u as f32, p.v as f32)).collect();
    let rect = with_operation(OPERATION, imgproc::min_area_rect(&points))?;
    let mut corners = [Point2f::default(); 4];
    with_operation(OPERATION, rect.points(&mut corners))?;
    Ok(corners.map(|corner| Pixel::at(corner.x.into(), corner.y.into())))
}

fn view(
    height: usize,
    width: usize,
    bytes: &[u8],
) -> opencv::Result<impl MatTraitConst + opencv::core::ToInputArray> {
    debug_assert_eq!(bytes.len(), height * width, "one byte a pixel, {CV_8UC1}");
    Mat::new_rows_cols_with_data(height as i32, width as i32, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(width: usize, height: usize, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> Mask {
        let mut mask = Mask::all_outside(width, height);
        for row in rows {
            for column in columns.clone() {
                mask.inside[row * width + column] = true;
            }
        }
        mask
    }

    /// Expected value, calculated by hand: the contour of a block of 5 × 3 pixels has 2·(5 + 3) − 4 = 12 pixels.
    #[test]
    fn a_block_has_its_border_as_contour() {
        let contours = outer_contours(&block(20, 10, 4..9, 2..5)).expect("a picture");
        assert_eq!(contours.len(), 1);
        assert_eq!(contours[0].len(), 12);
        let corners = min_area_box(&contours[0]).expect("pixels");
        assert!(corners.iter().any(|corner| corner.distance_px(Pixel::at(8.0, 2.0)) < 1e-3), "{corners:?}");
    }

    #[test]
    fn the_bilateral_filter_keeps_an_edge_and_removes_noise() {
        let gray = (0..40 * 40).map(|i| if i % 40 < 20 { 50 + (i / 40 % 2) as u8 * 4 } else { 200 }).collect();
        let filtered = bilateral_filter(&GrayPicture { width: 40, height: 40, gray }, 9, 40.0).expect("a picture");
        let at = |column: usize, row: usize| i32::from(filtered.gray[row * 40 + column]);
        assert!((at(10, 20) - at(10, 21)).abs() <= 1, "stripes of 4 are averaged");
        assert!(at(21, 20) - at(18, 20) > 140, "the edge stays");
    }

    #[test]
    fn an_empty_input_is_an_error_with_a_text() {
        assert!(min_area_box(&[]).is_err() || outer_contours(&Mask::all_outside(0, 0)).is_err());
    }
}
