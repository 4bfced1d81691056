//! Pictures from and to bytes: PNG, JPEG and TIFF read, PNG and JPEG written.
//!
//! Allowed formats for each picture:
//!
//! | The picture | Read | Why |
//! |---|---|---|
//! | shows the position of something: a corner of the panel, a board or a point for a camera's mount, a verification | PNG | every part of a PNG has a checksum, so damage is found; in JPEG and TIFF a changed byte gives other pixels and no error, and JPEG also moves edges |
//! | a clip of the wet panel, live from a recorded scanner or as files | PNG, JPEG, TIFF | a verdict on a place needs many pictures that agree, and no pose comes from them |
//! | a board for a lens (`calibrate intrinsics`) | PNG, JPEG, TIFF | the residual of each picture is compared with those of all the others |
//!
//! [`read_measured`] enforces the first row. 8 bits per channel are read, grey or RGB; grey becomes colour by
//! repeating it, colour becomes grey by BT.601 ([`ColorPicture::to_gray`]). An alpha channel is allowed if it hides
//! nothing. 16 bits per channel are refused: only the camera knows how to scale them. A picture's own rotation tag
//! (EXIF) is not used, since a calibration applies to the pixels as they were taken.
//!
//! Size and kind of the pixels are in a picture's first bytes and are checked there, before memory is allocated for
//! pixels: a small file may unpack to a thousand times its length.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, Limits};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use panelprep_base::geometry::{ColorPicture, GrayPicture, PinholeCamera};
use std::io::Cursor;

const JPEG_QUALITY: u8 = 95;
/// The largest picture that is unpacked if no calibration states its size: more pixels than any camera of such a cell
/// has.
const MAX_PIXELS: u64 = 32 << 20;
/// Memory limit for a decoder in addition to the pixels that it returns.
const MAX_DECODER_BYTES: u64 = 128 << 20;

/// The reason why bytes are not a picture, or why a picture cannot be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// The file is of another kind.
    #[error("the file is not a readable picture: {found}; valid: PNG, JPEG and TIFF")]
    Format {
        /// The kind of file that the first bytes indicate.
        found: String,
    },
    /// A picture that is truncated or damaged.
    #[error("the {format} picture of {bytes} bytes is damaged or truncated: {problem}")]
    Damaged {
        /// PNG, JPEG or TIFF.
        format: &'static str,
        /// Bytes given.
        bytes: usize,
        /// The problem that the decoder reports.
        problem: String,
    },
    /// Damage in the file would not be detected, and a measurement depends on the picture.
    #[error(
        "positions are measured in this picture, but its format is {format}: a {format} file has no checksum, so \
         damaged pixels would shift the measurement unnoticed. Take the picture again, and save it as PNG in the \
         camera's program (converting a JPEG file does not restore its lost details)"
    )]
    Unchecked {
        /// JPEG or TIFF.
        format: &'static str,
    },
    /// The picture has more pixels than this program unpacks.
    #[error("the picture is {width}×{height}, {pixels} pixels (limit {allowed} pixels)")]
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Number of pixels.
        pixels: u64,
        /// Largest allowed number of pixels.
        allowed: u64,
    },
    /// Channels that cannot be used without a conversion.
    #[error("the picture's pixels are {found}; valid: 8 bits per channel, grey or RGB, opaque")]
    Pixels {
        /// The format of the picture's channels.
        found: String,
    },
    /// The picture is not from the calibrated camera.
    #[error("the picture is {width}×{height} px, but the camera's calibration is for {width_px}×{height_px} px")]
    Size {
        /// Columns found.
        width: usize,
        /// Rows found.
        height: usize,
        /// Columns of the calibrated camera.
        width_px: usize,
        /// Rows of the calibrated camera.
        height_px: usize,
    },
    /// Width, height and number of pixels are not consistent.
    #[error("a {format} picture of {width}×{height} cannot be written from {pixels} pixels: {problem}")]
    Unwritable {
        /// PNG or JPEG.
        format: &'static str,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Pixels there are.
        pixels: usize,
        /// The problem.
        problem: String,
    },
}

/// Reads a colour picture of any size; a grey one becomes grey colours.
///
/// # Errors
/// If the bytes are not a complete PNG, JPEG or TIFF with 8 bits per channel, or it is larger than any camera's.
pub fn read_color(bytes: &[u8]) -> Result<ColorPicture, PictureError> {
    Ok(color(decode(PictureKind::detect(bytes)?, bytes, None)?))
}

/// Reads a grey picture of any size; a colour picture is converted as [`ColorPicture::to_gray`] does.
///
/// # Errors
/// As [`read_color`].
pub fn read_gray(bytes: &[u8]) -> Result<GrayPicture, PictureError> {
    Ok(to_gray(decode(PictureKind::detect(bytes)?, bytes, None)?))
}

/// Reads a colour picture of the camera with this calibration.
///
/// # Errors
/// As [`read_color`], and if its size is not the camera's.
pub fn read_color_of(bytes: &[u8], camera: &PinholeCamera) -> Result<ColorPicture, PictureError> {
    Ok(color(decode(PictureKind::detect(bytes)?, bytes, Some(camera))?))
}

/// Reads a picture for a measurement, taken by the camera with this calibration.
///
/// # Errors
/// As [`read_color_of`], and if it is not a PNG.
pub fn read_measured(bytes: &[u8], camera: &PinholeCamera) -> Result<ColorPicture, PictureError> {
    Ok(color(decode(PictureKind::detect(bytes)?.with_checksum()?, bytes, Some(camera))?))
}

/// Reads a picture for a measurement as [`read_measured`] does, and converts it to grey as [`read_gray`] does.
///
/// # Errors
/// As [`read_measured`].
pub fn read_measured_gray(bytes: &[u8], camera: &PinholeCamera) -> Result<GrayPicture, PictureError> {
    Ok(to_gray(decode(PictureKind::detect(bytes)?.with_checksum()?, bytes, Some(camera))?))
}

fn color(picture: DynamicImage) -> ColorPicture {
    let picture = picture.into_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    ColorPicture { width, height, rgb: picture.into_raw().as_chunks().0.to_vec() }
}

fn to_gray(picture: DynamicImage) -> GrayPicture {
    match picture {
        DynamicImage::ImageLuma8(picture) => {
            let (width, height) = (picture.width() as usize, picture.height() as usize);
            GrayPicture { width, height, gray: picture.into_raw() }
        }
        other => color(other).to_gray(),
    }
}

/// Returns a colour picture as PNG, compressed for speed.
///
/// # Errors
/// If the picture is empty or its pixels are not `width`·`height`.
pub fn write_color_png(picture: &ColorPicture) -> Result<Vec<u8>, PictureError> {
    encode_png(picture.width, picture.height, picture.rgb.as_flattened(), ExtendedColorType::Rgb8)
}

/// Writes a grey picture as PNG, compressed for speed.
///
/// # Errors
/// As [`write_color_png`].
pub fn write_gray_png(picture: &GrayPicture) -> Result<Vec<u8>, PictureError> {
    encode_png(picture.width, picture.height, &picture.gray, ExtendedColorType::L8)
}

/// Writes a colour picture as JPEG of quality 95.
///
/// # Errors
/// As [`write_color_png`], and above 65535 px, JPEG's largest side.
pub fn write_color_jpeg(picture: &ColorPicture) -> Result<Vec<u8>, PictureError> {
    let (width, height, pixels) = (picture.width, picture.height, picture.rgb.len());
    check_pixel_count(width, height, pixels, "JPEG")?;
    let unwritable = |problem| unwritable_error("JPEG", width, height, pixels, problem);
    let (Ok(columns), Ok(rows)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(unwritable(format!("a side is longer than {} px", u16::MAX)));
    };
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, JPEG_QUALITY);
    // Colour at full resolution, because the film is judged by its colour, too.
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    let written = encoder.encode(picture.rgb.as_flattened(), columns, rows, ColorType::Rgb);
    written.map(|()| file).map_err(|error| unwritable(error.to_string()))
}

/// One of the formats that are read.
#[derive(Clone, Copy)]
struct PictureKind {
    format: ImageFormat,
    name: &'static str,
}

impl PictureKind {
    fn detect(bytes: &[u8]) -> Result<Self, PictureError> {
        let found = match image::guess_format(bytes) {
            Ok(format @ ImageFormat::Png) => return Ok(PictureKind { format, name: "PNG" }),
            Ok(format @ ImageFormat::Jpeg) => return Ok(PictureKind { format, name: "JPEG" }),
            Ok(format @ ImageFormat::Tiff) => return Ok(PictureKind { format, name: "TIFF" }),
            Ok(other) => format!("it looks like {}", other.extensions_str().first().unwrap_or(&"another format")),
            Err(_) => describe_first_bytes(bytes),
        };
        Err(PictureError::Format { found })
    }

    fn with_checksum(self) -> Result<Self, PictureError> {
        match self.format {
            ImageFormat::Png => Ok(self),
            _ => Err(PictureError::Unchecked { format: self.name }),
        }
    }
}

fn decode(kind: PictureKind, bytes: &[u8], camera: Option<&PinholeCamera>) -> Result<DynamicImage, PictureError> {
    let damaged = |problem: String| PictureError::Damaged { format: kind.name, bytes: bytes.len(), problem };
    if kind.format == ImageFormat::Jpeg && !has_jpeg_end(bytes) {
        return Err(damaged("its end marker FF D9 is missing".to_owned()));
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), kind.format);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| damaged(error.to_string()))?;
    check_size(decoder.dimensions(), camera)?;
    let channels = decoder.color_type();
    if channels.bytes_per_pixel() > channels.channel_count() {
        let (count, bits) =
            (channels.channel_count(), channels.bits_per_pixel() / u16::from(channels.channel_count()));
        return Err(PictureError::Pixels { found: format!("{count} channels of {bits} bits") });
    }
    let picture = DynamicImage::from_decoder(decoder).map_err(|error| damaged(error.to_string()))?;
    let opaque = match &picture {
        DynamicImage::ImageLuma8(_) | DynamicImage::ImageRgb8(_) => true,
        DynamicImage::ImageLumaA8(pixels) => pixels.pixels().all(|pixel| pixel.0[1] == 255),
        DynamicImage::ImageRgba8(pixels) => pixels.pixels().all(|pixel| pixel.0[3] == 255),
        other => {
            let color = other.color();
            let (channels, bits) =
                (color.channel_count(), color.bits_per_pixel() / u16::from(color.channel_count()));
            return Err(PictureError::Pixels { found: format!("{channels} channels of {bits} bits") });
        }
    };
    match opaque {
        true => Ok(picture),
        false => Err(PictureError::Pixels { found: "partly transparent".to_owned() }),
    }
}

/// Refuses a picture that is not from the calibrated camera; without a camera, refuses a size that no camera
/// delivers.
fn check_size((width, height): (u32, u32), camera: Option<&PinholeCamera>) -> Result<(), PictureError> {
    let found = (width as usize, height as usize);
    match camera {
        Some(&PinholeCamera { width_px, height_px, .. }) if found != (width_px, height_px) => {
            Err(PictureError::Size { width: found.0, height: found.1, width_px, height_px })
        }
        Some(_) => Ok(()),
        None => match u64::from(width) * u64::from(height) {
            pixels if pixels > MAX_PIXELS => {
                Err(PictureError::TooLarge { width, height, pixels, allowed: MAX_PIXELS })
            }
            _ => Ok(()),
        },
    }
}

/// Returns whether a JPEG file has its end marker. The decoder fills missing data with grey and reports nothing. So the
/// end is searched here: an end marker after the start of the last scan (one before it belongs to the thumbnail).
fn has_jpeg_end(bytes: &[u8]) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|pair| pair == marker);
    matches!((last([0xff, 0xda]), last([0xff, 0xd9])), (Some(scan), Some(end)) if end > scan)
}

fn describe_first_bytes(bytes: &[u8]) -> String {
    match bytes {
        [] => "it is empty".to_owned(),
        _ => format!("it begins with '{}'", bytes[..bytes.len().min(8)].escape_ascii()),
    }
}

fn encode_png(
    width: usize,
    height: usize,
    bytes: &[u8],
    color: ExtendedColorType,
) -> Result<Vec<u8>, PictureError> {
    let channels = usize::from(color.channel_count());
    check_pixel_count(width, height, bytes.len() / channels, "PNG")?;
    let unwritable = |problem| unwritable_error("PNG", width, height, bytes.len() / channels, problem);
    let (Ok(columns), Ok(rows)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(unwritable("a side is too long".to_owned()));
    };
    let mut file = Vec::new();
    let written = PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Adaptive)
        .write_image(bytes, columns, rows, color);
    written.map(|()| file).map_err(|error| unwritable(error.to_string()))
}

/// Checks that the pixels fill the picture: otherwise the encoders would panic or write an unreadable picture.
fn check_pixel_count(width: usize, height: usize, pixels: usize, format: &'static str) -> Result<(), PictureError> {
    match pixels != 0 && width.checked_mul(height) == Some(pixels) {
        true => Ok(()),
        false => {
            Err(unwritable_error(format, width, height, pixels, format!("{pixels} pixels do not match this size")))
        }
    }
}

fn unwritable_error(
    format: &'static str,
    width: usize,
    height: usize,
    pixels: usize,
    problem: String,
) -> PictureError {
    PictureError::Unwritable { format, width, height, pixels, problem }
}

#[cfg(test)]
mod tests;
