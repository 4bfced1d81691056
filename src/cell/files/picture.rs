//! Decodes and encodes pictures: PNG, JPEG and TIFF are read, PNG and JPEG are written.
//!
//! The valid formats depend on the use of the picture:
//!
//! | Use of the picture | Valid formats | Reason |
//! |---|---|---|
//! | A position is measured: a corner of the panel, a board or a point for a camera's mount, a verification | PNG | All
//! parts of a PNG file have checksums, so damage is detected. In JPEG and TIFF, a changed byte gives other pixels
//! without an error, and JPEG also shifts edges. |
//! | A clip of the wet panel, live from a recorded scanner or as files | PNG, JPEG, TIFF | The result for a place needs
//! many pictures that agree, and no pose is measured. |
//! | A board for the calibration of a lens (`calibrate intrinsics`) | PNG, JPEG, TIFF | The residual of each picture is
//! compared with those of all other pictures. |
//!
//! [`read_measured`] enforces the first row. Pictures must have 8 bits per channel, grey or RGB. Grey is converted to
//! colour by copying the channel, colour to grey by BT.601 ([`ColorPicture::to_gray`]). An alpha channel must be
//! opaque. 16 bits per channel are refused, because only the camera knows the scale. The rotation tag (EXIF) is
//! ignored, because a calibration refers to the pixels as captured.
//!
//! The size and the pixel format are checked in the first bytes of the file, before memory is allocated: a small file
//! may decompress to a thousand times its size.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, Limits};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use panelprep_base::geometry::{ColorPicture, GrayPicture, PinholeCamera};
use std::io::Cursor;

const JPEG_QUALITY: u8 = 95;
/// Maximum number of pixels if no calibration states the size: more than any camera of a cell has.
const MAX_PIXELS: u64 = 32 << 20;
/// Maximum memory of a decoder in addition to the pixels, bytes.
const MAX_DECODER_BYTES: u64 = 128 << 20;

/// The reason why a picture cannot be decoded or encoded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// The file is not a picture in a supported format.
    #[error("the file is not a readable picture: {found}; valid: PNG, JPEG and TIFF")]
    Format {
        /// The kind of the file, recognised by its first bytes.
        found: String,
    },
    /// The file is truncated or damaged.
    #[error("the {format} picture of {bytes} bytes is damaged or truncated: {problem}")]
    Damaged {
        /// The format: PNG, JPEG or TIFF.
        format: &'static str,
        /// Size of the file, bytes.
        bytes: usize,
        /// The problem that the decoder reports.
        problem: String,
    },
    /// A position is measured in the picture, but the format has no checksum, so damage would not be detected.
    #[error(
        "positions are measured in this picture, but its format is {format}: a {format} file has no checksum, so \
         damaged pixels would shift the measurement unnoticed. Take the picture again, and save it as PNG in the \
         camera's program (converting a JPEG file does not restore its lost details)"
    )]
    Unchecked {
        /// The format: JPEG or TIFF.
        format: &'static str,
    },
    /// The picture has too many pixels.
    #[error("the picture is {width}×{height}, {pixels} pixels (limit {allowed} pixels)")]
    TooLarge {
        /// Width of the picture, px.
        width: u32,
        /// Height of the picture, px.
        height: u32,
        /// Number of pixels.
        pixels: u64,
        /// Maximum number of pixels.
        allowed: u64,
    },
    /// The pixel format is not supported.
    #[error("the picture's pixels are {found}; valid: 8 bits per channel, grey or RGB, opaque")]
    Pixels {
        /// The pixel format of the picture.
        found: String,
    },
    /// The size of the picture is not that of the calibrated camera.
    #[error("the picture is {width}×{height} px, but the camera's calibration is for {width_px}×{height_px} px")]
    Size {
        /// Width of the picture, px.
        width: usize,
        /// Height of the picture, px.
        height: usize,
        /// Width of the calibrated camera's pictures, px.
        width_px: usize,
        /// Height of the calibrated camera's pictures, px.
        height_px: usize,
    },
    /// The number of pixels is not width times height, or the picture is too large for its format.
    #[error("a {format} picture of {width}×{height} cannot be written from {pixels} pixels: {problem}")]
    Unwritable {
        /// The format: PNG or JPEG.
        format: &'static str,
        /// Width of the picture, px.
        width: usize,
        /// Height of the picture, px.
        height: usize,
        /// Number of pixels in memory.
        pixels: usize,
        /// The problem of the size.
        problem: String,
    },
}

/// Decodes a colour picture of any size; a grey picture is converted to colour.
///
/// # Errors
/// If the file is not a complete PNG, JPEG or TIFF picture with 8 bits per channel, or has too many pixels.
pub fn read_color(bytes: &[u8]) -> Result<ColorPicture, PictureError> {
    Ok(color(decode(PictureKind::detect(bytes)?, bytes, None)?))
}

/// Decodes a grey picture of any size; a colour picture is converted by [`ColorPicture::to_gray`].
///
/// # Errors
/// The errors of [`read_color`].
pub fn read_gray(bytes: &[u8]) -> Result<GrayPicture, PictureError> {
    Ok(to_gray(decode(PictureKind::detect(bytes)?, bytes, None)?))
}

/// Decodes a colour picture from the camera with this calibration.
///
/// # Errors
/// The errors of [`read_color`], or if the size is not that of the camera.
pub fn read_color_of(bytes: &[u8], camera: &PinholeCamera) -> Result<ColorPicture, PictureError> {
    Ok(color(decode(PictureKind::detect(bytes)?, bytes, Some(camera))?))
}

/// Decodes a picture in which a position is measured, from the camera with this calibration.
///
/// # Errors
/// The errors of [`read_color_of`], or if the format is not PNG.
pub fn read_measured(bytes: &[u8], camera: &PinholeCamera) -> Result<ColorPicture, PictureError> {
    Ok(color(decode(PictureKind::detect(bytes)?.with_checksum()?, bytes, Some(camera))?))
}

/// Decodes a picture as [`read_measured`] does, and converts it to grey as [`read_gray`] does.
///
/// # Errors
/// The errors of [`read_measured`].
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

/// Encodes a colour picture as PNG, with fast compression.
///
/// # Errors
/// If the picture is empty, or the number of its pixels is not width times height.
pub fn write_color_png(picture: &ColorPicture) -> Result<Vec<u8>, PictureError> {
    encode_png(picture.width, picture.height, picture.rgb.as_flattened(), ExtendedColorType::Rgb8)
}

/// Encodes a grey picture as PNG, with fast compression.
///
/// # Errors
/// The errors of [`write_color_png`].
pub fn write_gray_png(picture: &GrayPicture) -> Result<Vec<u8>, PictureError> {
    encode_png(picture.width, picture.height, &picture.gray, ExtendedColorType::L8)
}

/// Encodes a colour picture as JPEG with quality 95.
///
/// # Errors
/// The errors of [`write_color_png`], or if a side is longer than 65535 px, the limit of JPEG.
pub fn write_color_jpeg(picture: &ColorPicture) -> Result<Vec<u8>, PictureError> {
    let (width, height, pixels) = (picture.width, picture.height, picture.rgb.len());
    check_pixel_count(width, height, pixels, "JPEG")?;
    let unwritable = |problem| picture_encoding_error("JPEG", width, height, pixels, problem);
    let (Ok(columns), Ok(rows)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(unwritable(format!("a side is longer than {} px", u16::MAX)));
    };
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, JPEG_QUALITY);
    // The colours are stored at full resolution, because the evaluation of the film uses them.
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    let written = encoder.encode(picture.rgb.as_flattened(), columns, rows, ColorType::Rgb);
    written.map(|()| file).map_err(|error| unwritable(error.to_string()))
}

/// A supported picture format.
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
            Ok(other) => {
                format!("the content looks like {}", other.extensions_str().first().unwrap_or(&"another format"))
            }
            Err(_) => describe_file_kind(bytes),
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
        return Err(damaged("the end marker FF D9 is missing".to_owned()));
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

/// Checks that the size is that of the calibrated camera or, without a calibration, that the number of pixels is below
/// the limit.
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

/// Returns whether a JPEG file has its end marker after the start of the last scan (an earlier end marker belongs to
/// the thumbnail). The decoder does not check this: it fills missing data with grey.
fn has_jpeg_end(bytes: &[u8]) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|pair| pair == marker);
    matches!((last([0xff, 0xda]), last([0xff, 0xd9])), (Some(scan), Some(end)) if end > scan)
}

fn describe_file_kind(bytes: &[u8]) -> String {
    match bytes {
        [] => "the file is empty".to_owned(),
        _ => format!("the content begins with '{}'", bytes[..bytes.len().min(8)].escape_ascii()),
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
    let unwritable = |problem| picture_encoding_error("PNG", width, height, bytes.len() / channels, problem);
    let (Ok(columns), Ok(rows)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(unwritable("a side is too long".to_owned()));
    };
    let mut file = Vec::new();
    let written = PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Adaptive)
        .write_image(bytes, columns, rows, color);
    written.map(|()| file).map_err(|error| unwritable(error.to_string()))
}

/// Checks that the number of pixels is width times height. Otherwise the encoders would panic or write an invalid file.
fn check_pixel_count(width: usize, height: usize, pixels: usize, format: &'static str) -> Result<(), PictureError> {
    match pixels != 0 && width.checked_mul(height) == Some(pixels) {
        true => Ok(()),
        false => Err(picture_encoding_error(
            format,
            width,
            height,
            pixels,
            format!("{pixels} pixels do not match this size"),
        )),
    }
}

fn picture_encoding_error(
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
