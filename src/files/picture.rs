//! Pictures from and to bytes: PNG, JPEG and TIFF read, PNG and JPEG written.
//!
//! Read are 8 bits a channel, grey or RGB; grey becomes colour by repeating it, colour becomes grey by BT.601
//! ([`ColorPicture::to_gray`]). An alpha channel is allowed where it hides nothing. 16 bits a channel are refused:
//! how to scale them is the camera's business. What a picture says about its own turn (EXIF) is not used, since a
//! calibration holds for the pixels as they were taken.

use crate::geometry::{ColorPicture, GrayPicture, PinholeCamera};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageFormat, ImageReader};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use std::io::Cursor;

const JPEG_QUALITY: u8 = 95;

/// Why bytes are not a picture, or a picture not bytes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// Another kind of file.
    #[error("this is no picture that can be read: {found}; allowed are PNG, JPEG and TIFF")]
    Format {
        /// What the first bytes look like.
        found: String,
    },
    /// A picture that breaks off or is damaged.
    #[error("the {format} picture of {bytes} bytes is damaged or truncated: {problem}")]
    Damaged {
        /// PNG, JPEG or TIFF.
        format: &'static str,
        /// Bytes given.
        bytes: usize,
        /// What the decoder met.
        problem: String,
    },
    /// Channels that cannot be taken over as they are.
    #[error("the pixels are {found}; allowed are 8 bits a channel, grey or RGB, opaque")]
    Pixels {
        /// What the picture holds.
        found: String,
    },
    /// The picture is not from the calibrated camera.
    #[error("the picture is {width}×{height}, the camera's calibration says {width_px}×{height_px}")]
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
    /// Width, height and number of pixels do not fit.
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
        /// What is wrong.
        problem: String,
    },
}

/// Reads a colour picture; a grey one becomes grey colours.
///
/// # Errors
/// Where the bytes are not a whole PNG, JPEG or TIFF with 8 bits a channel.
pub fn read_color(bytes: &[u8]) -> Result<ColorPicture, PictureError> {
    let picture = decode(bytes)?.into_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Ok(ColorPicture { width, height, rgb: picture.into_raw().as_chunks().0.to_vec() })
}

/// Reads a grey picture; a colour one is weighed as [`ColorPicture::to_gray`] does.
///
/// # Errors
/// As [`read_color`].
pub fn read_gray(bytes: &[u8]) -> Result<GrayPicture, PictureError> {
    match decode(bytes)? {
        DynamicImage::ImageLuma8(picture) => {
            let (width, height) = (picture.width() as usize, picture.height() as usize);
            Ok(GrayPicture { width, height, gray: picture.into_raw() })
        }
        _ => read_color(bytes).map(|picture| picture.to_gray()),
    }
}

/// A colour picture as PNG, packed for speed.
///
/// # Errors
/// Where the picture is empty or its pixels are not `width`·`height`.
pub fn write_color_png(picture: &ColorPicture) -> Result<Vec<u8>, PictureError> {
    encode_png(picture.width, picture.height, picture.rgb.as_flattened(), ExtendedColorType::Rgb8)
}

/// A grey picture as PNG, packed for speed.
///
/// # Errors
/// As [`write_color_png`].
pub fn write_gray_png(picture: &GrayPicture) -> Result<Vec<u8>, PictureError> {
    encode_png(picture.width, picture.height, &picture.gray, ExtendedColorType::L8)
}

/// A colour picture as JPEG of quality 95.
///
/// # Errors
/// As [`write_color_png`], and above 65535 px, JPEG's largest side.
pub fn write_color_jpeg(picture: &ColorPicture) -> Result<Vec<u8>, PictureError> {
    let (width, height, pixels) = (picture.width, picture.height, picture.rgb.len());
    fills(width, height, pixels, "JPEG")?;
    let unwritable = |problem| unwritable("JPEG", width, height, pixels, problem);
    let (Ok(columns), Ok(rows)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(unwritable(format!("a side is longer than {} px", u16::MAX)));
    };
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, JPEG_QUALITY);
    // Colour at full resolution: the film is judged by its colour, too.
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    let written = encoder.encode(picture.rgb.as_flattened(), columns, rows, ColorType::Rgb);
    written.map(|()| file).map_err(|error| unwritable(error.to_string()))
}

/// Refuses a picture that is not from the calibrated camera.
///
/// # Errors
/// Where width or height differ from the calibration's.
pub fn check_picture_size(picture: &ColorPicture, camera: &PinholeCamera) -> Result<(), PictureError> {
    let (width, height) = (picture.width, picture.height);
    match (width, height) == (camera.width_px, camera.height_px) {
        true => Ok(()),
        false => Err(PictureError::Size { width, height, width_px: camera.width_px, height_px: camera.height_px }),
    }
}

fn decode(bytes: &[u8]) -> Result<DynamicImage, PictureError> {
    let (format, name) = match image::guess_format(bytes) {
        Ok(ImageFormat::Png) => (ImageFormat::Png, "PNG"),
        Ok(ImageFormat::Jpeg) => (ImageFormat::Jpeg, "JPEG"),
        Ok(ImageFormat::Tiff) => (ImageFormat::Tiff, "TIFF"),
        Ok(other) => {
            return Err(PictureError::Format {
                found: format!("it looks like {}", other.extensions_str().first().unwrap_or(&"another format")),
            });
        }
        Err(_) => return Err(PictureError::Format { found: first_bytes(bytes) }),
    };
    let damaged = |problem: String| PictureError::Damaged { format: name, bytes: bytes.len(), problem };
    if format == ImageFormat::Jpeg && !jpeg_has_its_end(bytes) {
        return Err(damaged("its end marker FF D9 is missing".to_owned()));
    }
    let reader = ImageReader::with_format(Cursor::new(bytes), format);
    let picture = reader.decode().map_err(|error| damaged(error.to_string()))?;
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

/// The decoder fills what is missing with grey and says nothing, so the end is looked for here: an end marker
/// after the start of the last scan (one before it belongs to the thumbnail).
fn jpeg_has_its_end(bytes: &[u8]) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|pair| pair == marker);
    matches!((last([0xff, 0xda]), last([0xff, 0xd9])), (Some(scan), Some(end)) if end > scan)
}

fn first_bytes(bytes: &[u8]) -> String {
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
    fills(width, height, bytes.len() / channels, "PNG")?;
    let unwritable = |problem| unwritable("PNG", width, height, bytes.len() / channels, problem);
    let (Ok(columns), Ok(rows)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(unwritable("a side is too long".to_owned()));
    };
    let mut file = Vec::new();
    let written = PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Adaptive)
        .write_image(bytes, columns, rows, color);
    written.map(|()| file).map_err(|error| unwritable(error.to_string()))
}

/// The encoders would assert this, or write a picture that nobody can read.
fn fills(width: usize, height: usize, pixels: usize, format: &'static str) -> Result<(), PictureError> {
    match pixels != 0 && width.checked_mul(height) == Some(pixels) {
        true => Ok(()),
        false => Err(unwritable(format, width, height, pixels, format!("{pixels} pixels do not fill it"))),
    }
}

fn unwritable(format: &'static str, width: usize, height: usize, pixels: usize, problem: String) -> PictureError {
    PictureError::Unwritable { format, width, height, pixels, problem }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Smooth in two directions, so that JPEG may be compared.
    fn picture(width: usize, height: usize) -> ColorPicture {
        let rgb = (0..width * height).map(|i| [(i % width * 3) as u8, (i / width * 5) as u8, 90]).collect();
        ColorPicture { width, height, rgb }
    }

    fn as_file(picture: DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        picture.write_to(&mut file, format).expect("written");
        file.into_inner()
    }

    #[test]
    fn png_keeps_every_pixel() {
        let color = picture(40, 30);
        assert_eq!(read_color(&write_color_png(&color).expect("written")), Ok(color.clone()));
        let gray = color.to_gray();
        assert_eq!(read_gray(&write_gray_png(&gray).expect("written")), Ok(gray.clone()));
        assert_eq!(read_gray(&write_color_png(&color).expect("written")), Ok(gray));
    }

    #[test]
    fn tiff_is_read() {
        let color = picture(40, 30);
        let pixels = image::RgbImage::from_raw(40, 30, color.rgb.as_flattened().to_vec()).expect("counts agree");
        assert_eq!(read_color(&as_file(pixels.into(), ImageFormat::Tiff)), Ok(color));
    }

    /// Quality 95 moves a smooth picture by a few grey values of 255.
    #[test]
    fn jpeg_keeps_a_smooth_picture_nearly() {
        let color = picture(64, 48);
        let back = read_color(&write_color_jpeg(&color).expect("written")).expect("read");
        let steps = color.rgb.as_flattened().iter().zip(back.rgb.as_flattened()).map(|(a, b)| a.abs_diff(*b));
        assert!(steps.max().expect("pixels") <= 6);
    }

    /// All three decoders must notice; JPEG's would not.
    #[test]
    fn a_truncated_picture_is_refused_wherever_it_is_cut() {
        let color = picture(64, 48);
        let pixels = image::RgbImage::from_raw(64, 48, color.rgb.as_flattened().to_vec()).expect("counts agree");
        let tiff = as_file(pixels.into(), ImageFormat::Tiff);
        let files = [write_color_png(&color).expect("written"), write_color_jpeg(&color).expect("written"), tiff];
        for file in files {
            for tenth in 1..10 {
                let error = read_color(&file[..file.len() * tenth / 10]).expect_err("truncated").to_string();
                assert!(error.contains("is damaged or truncated"), "{error}");
            }
        }
    }

    #[test]
    fn what_is_not_a_picture_says_what_it_is() {
        let refusal = |bytes: &[u8]| read_color(bytes).expect_err("no picture").to_string();
        assert!(refusal(b"").contains("it is empty"));
        assert!(refusal(b"VERSION .7\n").contains("it begins with 'VERSION '"));
        assert!(refusal(b"GIF89a,,,").contains("it looks like gif; allowed are PNG, JPEG and TIFF"));
    }

    #[test]
    fn deep_and_transparent_pixels_are_refused_and_opaque_alpha_is_dropped() {
        let deep = as_file(DynamicImage::new_rgb16(3, 2), ImageFormat::Png);
        assert!(
            read_color(&deep).expect_err("deep").to_string().contains("3 channels of 16 bits; allowed are 8 bits")
        );
        let rgba = |alpha| {
            let pixels = image::RgbaImage::from_pixel(3, 2, image::Rgba([10, 20, 30, alpha]));
            read_color(&as_file(pixels.into(), ImageFormat::Png))
        };
        assert_eq!(rgba(255), Ok(ColorPicture::filled(3, 2, [10, 20, 30])));
        assert!(rgba(254).expect_err("transparent").to_string().contains("partly transparent"));
    }

    #[test]
    fn sizes_that_do_not_fit_are_refused() {
        let broken = ColorPicture { width: 3, height: 3, rgb: vec![[0; 3]; 8] };
        let error = write_color_png(&broken).expect_err("8 pixels").to_string();
        assert!(error.contains("3×3 cannot be written from 8 pixels"), "{error}");
        assert!(write_color_jpeg(&ColorPicture::filled(0, 0, [0; 3])).is_err());
        assert!(write_color_jpeg(&ColorPicture::filled(65_536, 1, [0; 3])).is_err());
    }

    proptest! {
        #[test]
        fn spoilt_pictures_never_panic(
            which in 0_usize..2, cut in 0.0..1.2_f64, spoilt in prop::collection::vec((any::<u16>(), any::<u8>()), 0..4),
        ) {
            let color = picture(24, 16);
            let mut file = [write_color_png(&color), write_color_jpeg(&color)][which].clone().expect("written");
            file.truncate((cut * file.len() as f64) as usize);
            for (place, byte) in spoilt {
                if !file.is_empty() {
                    let place = usize::from(place) % file.len();
                    file[place] = byte;
                }
            }
            if let Ok(read) = read_color(&file) {
                prop_assert_eq!(read.rgb.len(), read.width * read.height);
            }
        }
    }
}
