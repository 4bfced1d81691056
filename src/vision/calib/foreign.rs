//! OpenCV's solvers and detectors with our own types. No other file of this module calls OpenCV.

use super::error::CalibError;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use opencv::core::{
    Mat, MatTraitConst, MatTraitConstManual, Point2d, Point2f, Point3d, Point3f, Size, TermCriteria,
    TermCriteria_COUNT, TermCriteria_EPS, Vector,
};
use opencv::prelude::{DetectorParametersTrait, DictionaryTraitConst};
use opencv::{aruco, calib3d, imgproc};
use panelprep_base::geometry::{Board, GrayPicture, PinholeCamera, Pixel, Point};
use panelprep_cell::imaging::{ImagingError, with_operation};

fn camera_matrix(camera: &PinholeCamera) -> opencv::Result<Mat> {
    let rows = [[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]];
    Mat::from_slice_2d(&rows)
}

fn isometry_from_vectors(turn: &[f64], shift: &[f64]) -> Isometry3<f64> {
    Isometry3::new(Vector3::from_column_slice(shift), Vector3::from_column_slice(turn))
}

/// Solves perspective-n-point: Levenberg–Marquardt on the reprojection error, from a homography.
pub(super) fn solve_pnp(
    camera: &PinholeCamera,
    corners: &[(Point<Board>, Pixel)],
) -> Result<Isometry3<f64>, CalibError> {
    if corners.len() < 4 {
        return Err(CalibError::Points(format!(
            "{} corners were seen; at least 4 are needed, show more of the board",
            corners.len()
        )));
    }
    const OPERATION: &str = "the board's pose";
    let objects: Vector<Point3d> = corners.iter().map(|(q, _)| Point3d::new(q.mm.x, q.mm.y, q.mm.z)).collect();
    let pixels: Vector<Point2d> = corners.iter().map(|(_, pixel)| Point2d::new(pixel.u, pixel.v)).collect();
    let distortion: Vector<f64> = [camera.k1, camera.k2, camera.p1, camera.p2, camera.k3].into_iter().collect();
    let (mut turn, mut shift): (Vector<f64>, Vector<f64>) = (Vector::new(), Vector::new());
    let matrix = with_operation(OPERATION, camera_matrix(camera))?;
    let solved = calib3d::solve_pnp(
        &objects,
        &pixels,
        &matrix,
        &distortion,
        &mut turn,
        &mut shift,
        false,
        calib3d::SOLVEPNP_ITERATIVE,
    );
    if with_operation(OPERATION, solved)? && turn.len() == 3 && shift.len() == 3 {
        Ok(isometry_from_vectors(turn.as_slice(), shift.as_slice()))
    } else {
        Err(CalibError::NotSettled { what: "the computation of the board's pose" })
    }
}

/// Computes the camera mount from the moving factor of the chain and the board pose of each station (Park & Martin,
/// IEEE T-RA 10, 1994); `None` if the rotations do not determine it.
pub(super) fn solve_hand_eye_park(
    holder_from_to: &[Isometry3<f64>],
    camera_from_board: &[Isometry3<f64>],
) -> Option<Isometry3<f64>> {
    let turns = |poses: &[Isometry3<f64>]| -> opencv::Result<Vector<Mat>> {
        let turn = |pose: &Isometry3<f64>| {
            let m = pose.rotation.to_rotation_matrix();
            Mat::from_slice_2d(&[0, 1, 2].map(|row| [m[(row, 0)], m[(row, 1)], m[(row, 2)]]))
        };
        poses.iter().map(turn).collect()
    };
    let shifts = |poses: &[Isometry3<f64>]| -> opencv::Result<Vector<Mat>> {
        let shift =
            |pose: &Isometry3<f64>| Mat::from_slice_2d(&[0, 1, 2].map(|row| [pose.translation.vector[row]]));
        poses.iter().map(shift).collect()
    };
    let (mut turn, mut shift) = (Mat::default(), Mat::default());
    let method = calib3d::HandEyeCalibrationMethod::CALIB_HAND_EYE_PARK;
    calib3d::calibrate_hand_eye(
        &turns(holder_from_to).ok()?,
        &shifts(holder_from_to).ok()?,
        &turns(camera_from_board).ok()?,
        &shifts(camera_from_board).ok()?,
        &mut turn,
        &mut shift,
        method,
    )
    .ok()?;
    let rotation = Matrix3::from_row_slice(turn.data_typed::<f64>().ok()?.get(..9)?);
    let place = Vector3::from_column_slice(shift.data_typed::<f64>().ok()?.get(..3)?);
    let sound = rotation.iter().chain(place.iter()).all(|number| number.is_finite())
        && (rotation * rotation.transpose() - Matrix3::identity()).norm() < 1e-6;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    sound.then(|| Isometry3::from_parts(Translation3::from(place), rotation))
}

fn to_pixels(points: &Vector<Point2f>) -> Vec<Pixel> {
    points.iter().map(|point| Pixel::at(point.x.into(), point.y.into())).collect()
}

fn to_mat(picture: &GrayPicture) -> Result<impl MatTraitConst + opencv::core::ToInputArray, ImagingError> {
    with_operation(
        "a picture",
        Mat::new_rows_cols_with_data(picture.height as i32, picture.width as i32, &picture.gray),
    )
}

/// Runs `findChessboardCornersSB`: returns the inner corners of a board, row by row, to about a pixel; `None` if the
/// picture shows no matching board.
pub(super) fn chessboard(
    picture: &GrayPicture,
    (columns, rows): (usize, usize),
) -> Result<Option<Vec<Pixel>>, ImagingError> {
    const OPERATION: &str = "chessboard corners";
    let source = to_mat(picture)?;
    let mut found: Vector<Point2f> = Vector::new();
    let size = Size::new(columns as i32, rows as i32);
    let flags = calib3d::CALIB_CB_NORMALIZE_IMAGE;
    let seen = with_operation(OPERATION, calib3d::find_chessboard_corners_sb(&source, size, &mut found, flags))?;
    Ok((seen && found.len() == columns * rows).then(|| to_pixels(&found)))
}

/// Returns the picture reduced by this factor; each pixel is the mean of the pixels that it replaces.
pub(super) fn reduce_picture(picture: &GrayPicture, times: usize) -> Result<GrayPicture, ImagingError> {
    const OPERATION: &str = "a smaller picture";
    let source = to_mat(picture)?;
    let (width, height) = (picture.width / times, picture.height / times);
    let (mut small, size) = (Mat::default(), Size::new(width as i32, height as i32));
    with_operation(OPERATION, imgproc::resize(&source, &mut small, size, 0.0, 0.0, imgproc::INTER_AREA))?;
    Ok(GrayPicture { width, height, gray: with_operation(OPERATION, small.data_bytes())?.to_vec() })
}

/// Runs `cornerSubPix` with a window of ± `half_window_px`: at most 30 iterations, until the change is below 1e-3 px.
pub(super) fn refine_corners(
    picture: &GrayPicture,
    corners: &[Pixel],
    half_window_px: usize,
) -> Result<Vec<Pixel>, ImagingError> {
    const OPERATION: &str = "the corners' sub-pixel positions";
    let source = to_mat(picture)?;
    let mut points: Vector<Point2f> = corners.iter().map(|p| Point2f::new(p.u as f32, p.v as f32)).collect();
    let window = Size::new(half_window_px as i32, half_window_px as i32);
    let until = with_operation(OPERATION, TermCriteria::new(TermCriteria_COUNT + TermCriteria_EPS, 30, 1e-3))?;
    with_operation(OPERATION, imgproc::corner_sub_pix(&source, &mut points, window, Size::new(-1, -1), until))?;
    Ok(to_pixels(&points))
}

/// Returns the number of OpenCV's dictionary with this name.
pub(super) fn dictionary_number(name: &str) -> Option<i32> {
    const FAMILIES: [(&str, i32); 4] = [("4X4", 0), ("5X5", 4), ("6X6", 8), ("7X7", 12)];
    const SIZES: [&str; 4] = ["50", "100", "250", "1000"];
    const OTHERS: [&str; 5] =
        ["ARUCO_ORIGINAL", "APRILTAG_16H5", "APRILTAG_25H9", "APRILTAG_36H10", "APRILTAG_36H11"];
    if let Some(at) = OTHERS.iter().position(|other| *other == name) {
        return Some(16 + at as i32);
    }
    let (family, size) = name.split_once('_')?;
    let (_, first) = FAMILIES.iter().find(|(word, _)| *word == family)?;
    Some(first + SIZES.iter().position(|word| *word == size)? as i32)
}

/// Minimum side of a marker that is read, px.
const MIN_MARKER_PX: f64 = 14.0;

/// Returns the markers of a dictionary in a picture, with their numbers and corners, clockwise from the top left.
pub(super) fn detect_markers(
    picture: &GrayPicture,
    dictionary: i32,
) -> Result<Vec<(usize, [Pixel; 4])>, ImagingError> {
    const OPERATION: &str = "markers";
    let source = to_mat(picture)?;
    let dictionary = with_operation(OPERATION, aruco::get_predefined_dictionary_i32(dictionary))?;
    let (mut corners, mut numbers): (Vector<Vector<Point2f>>, Vector<i32>) = (Vector::new(), Vector::new());
    let mut parameters = with_operation(OPERATION, aruco::DetectorParameters::create())?;
    // Only two window sizes and no marker below 14 px: every candidate is compared with every other, and a fine texture
    // has thousands of candidates.
    parameters.set_adaptive_thresh_win_size_min(5);
    parameters.set_adaptive_thresh_win_size_max(21);
    parameters.set_adaptive_thresh_win_size_step(16);
    parameters.set_min_marker_perimeter_rate(MIN_MARKER_PX * 4.0 / picture.width.max(picture.height).max(1) as f64);
    let mut rejected: Vector<Vector<Point2f>> = Vector::new();
    let found = aruco::detect_markers(&source, &dictionary, &mut corners, &mut numbers, &parameters, &mut rejected);
    with_operation(OPERATION, found)?;
    let found = corners.iter().zip(numbers.iter()).filter_map(|(corners, number)| {
        let corners: [Pixel; 4] = to_pixels(&corners).try_into().ok()?;
        Some((usize::try_from(number).ok()?, corners))
    });
    Ok(found.collect())
}

/// Returns the cells of a marker with its black rim, row by row; true is white. The side in cells is the square root of
/// their number.
pub(super) fn marker_cells(dictionary: i32, number: usize) -> Result<Vec<bool>, ImagingError> {
    const OPERATION: &str = "a marker";
    let dictionary = with_operation(OPERATION, aruco::get_predefined_dictionary_i32(dictionary))?;
    let side = dictionary.marker_size() + 2;
    let mut picture = Mat::default();
    with_operation(OPERATION, aruco::draw_marker(&dictionary, number as i32, side, &mut picture, 1))?;
    Ok(with_operation(OPERATION, picture.data_bytes())?.iter().map(|&gray| gray > 127).collect())
}

/// Computes the homography from points of a plane to pixels, by least squares; `None` if they determine none.
pub(super) fn homography(places: &[[f64; 2]], pixels: &[Pixel]) -> Option<Matrix3<f64>> {
    let places: Vector<Point2d> = places.iter().map(|&[x, y]| Point2d::new(x, y)).collect();
    let pixels: Vector<Point2d> = pixels.iter().map(|pixel| Point2d::new(pixel.u, pixel.v)).collect();
    let found = calib3d::find_homography_ext_def(&places, &pixels).ok()?;
    Some(Matrix3::from_row_slice(found.data_typed::<f64>().ok()?.get(..9)?))
}

/// Result of `calibrateCamera`.
pub(super) struct CameraFound {
    pub camera: PinholeCamera,
    pub camera_from_board: Vec<Isometry3<f64>>,
}

/// Runs `calibrateCamera` with k1 as the only distortion coefficient, for a start value.
pub(super) fn calibrate_camera(
    (width_px, height_px): (usize, usize),
    views: &[&[(Point<Board>, Pixel)]],
) -> Result<CameraFound, ImagingError> {
    const OPERATION: &str = "the intrinsics";
    let objects: Vector<Vector<Point3f>> = views
        .iter()
        .map(|view| view.iter().map(|(q, _)| Point3f::new(q.mm.x as f32, q.mm.y as f32, q.mm.z as f32)).collect())
        .collect();
    let pixels: Vector<Vector<Point2f>> = views
        .iter()
        .map(|view| view.iter().map(|(_, pixel)| Point2f::new(pixel.u as f32, pixel.v as f32)).collect())
        .collect();
    let (mut matrix, mut distortion) = (Mat::default(), Vector::<f64>::new());
    let (mut turns, mut shifts): (Vector<Mat>, Vector<Mat>) = (Vector::new(), Vector::new());
    let until = TermCriteria::new(TermCriteria_COUNT + TermCriteria_EPS, 30, f64::EPSILON);
    let solved = calib3d::calibrate_camera(
        &objects,
        &pixels,
        Size::new(width_px as i32, height_px as i32),
        &mut matrix,
        &mut distortion,
        &mut turns,
        &mut shifts,
        calib3d::CALIB_FIX_K2 | calib3d::CALIB_FIX_K3 | calib3d::CALIB_ZERO_TANGENT_DIST,
        with_operation(OPERATION, until)?,
    );
    with_operation(OPERATION, solved)?;
    let unusual = || ImagingError {
        operation: OPERATION,
        words: "OpenCV returned intrinsics of an unexpected size".to_owned(),
    };
    let m = with_operation(OPERATION, matrix.data_typed::<f64>())?;
    let [k1, k2, p1, p2, k3]: [f64; 5] =
        distortion.as_slice().get(..5).and_then(|numbers| numbers.try_into().ok()).ok_or_else(unusual)?;
    let mut camera_from_board = Vec::with_capacity(views.len());
    for (turn, shift) in turns.iter().zip(shifts.iter()) {
        let turn = with_operation(OPERATION, turn.data_typed::<f64>())?.to_vec();
        camera_from_board.push(isometry_from_vectors(&turn, with_operation(OPERATION, shift.data_typed::<f64>())?));
    }
    if m.len() != 9 || camera_from_board.len() != views.len() {
        return Err(unusual());
    }
    let camera = PinholeCamera {
        width_px,
        height_px,
        fx_px: m[0],
        fy_px: m[4],
        cx_px: m[2],
        cy_px: m[5],
        k1,
        k2,
        p1,
        p2,
        k3,
    };
    Ok(CameraFound { camera, camera_from_board })
}
