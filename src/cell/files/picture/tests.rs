//! Tests of pictures: valid and invalid files, and damaged ones.

use super::*;
use proptest::prelude::*;

/// Returns a picture with smooth gradients, so that JPEG changes it only slightly.
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

/// JPEG with quality 95 changes a smooth picture by a few grey values of 255.
#[test]
fn jpeg_keeps_a_smooth_picture_nearly() {
    let color = picture(64, 48);
    let back = read_color(&write_color_jpeg(&color).expect("written")).expect("read");
    let steps = color.rgb.as_flattened().iter().zip(back.rgb.as_flattened()).map(|(a, b)| a.abs_diff(*b));
    assert!(steps.max().expect("pixels") <= 6);
}

/// A truncated file must be refused in all three formats, although the JPEG decoder does not detect it.
#[test]
fn a_truncated_picture_is_refused_at_any_cut() {
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
fn other_files_are_refused_with_their_kind() {
    let refusal = |bytes: &[u8]| read_color(bytes).expect_err("no picture").to_string();
    assert!(refusal(b"").contains("the file is empty"));
    assert!(refusal(b"VERSION .7\n").contains("the content begins with 'VERSION '"));
    assert!(refusal(b"GIF89a,,,").contains("the content looks like gif; valid: PNG, JPEG and TIFF"));
}

#[test]
fn deep_and_transparent_pixels_are_refused_and_opaque_alpha_is_dropped() {
    let deep = as_file(DynamicImage::new_rgb16(3, 2), ImageFormat::Png);
    assert!(read_color(&deep).expect_err("deep").to_string().contains("3 channels of 16 bits; valid: 8 bits"));
    let rgba = |alpha| {
        let pixels = image::RgbaImage::from_pixel(3, 2, image::Rgba([10, 20, 30, alpha]));
        read_color(&as_file(pixels.into(), ImageFormat::Png))
    };
    assert_eq!(rgba(255), Ok(ColorPicture::uniform(3, 2, [10, 20, 30])));
    assert!(rgba(254).expect_err("transparent").to_string().contains("partly transparent"));
}

#[test]
fn sizes_that_do_not_fit_are_refused() {
    let broken = ColorPicture { width: 3, height: 3, rgb: vec![[0; 3]; 8] };
    let error = write_color_png(&broken).expect_err("8 pixels").to_string();
    assert!(error.contains("3×3 cannot be written from 8 pixels"), "{error}");
    assert!(write_color_jpeg(&ColorPicture::uniform(0, 0, [0; 3])).is_err());
    assert!(write_color_jpeg(&ColorPicture::uniform(65_536, 1, [0; 3])).is_err());
}

proptest! {
    #[test]
    fn damaged_pictures_cause_no_panic(
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

fn camera(width_px: usize, height_px: usize) -> PinholeCamera {
    let (fx_px, fy_px, cx_px, cy_px) = (2.0, 2.0, 1.0, 1.0);
    let (k1, k2, p1, p2, k3) = (0.0, 0.0, 0.0, 0.0, 0.0);
    PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 }
}

/// Each bit of a PNG file is changed once. Either the pixels are unchanged, or the file is refused.
#[test]
fn no_changed_bit_changes_a_measured_picture() {
    let (color, camera) = (picture(24, 16), camera(24, 16));
    let file = write_color_png(&color).expect("written");
    assert_eq!(read_measured(&file, &camera), Ok(color.clone()));
    let (mut refused, mut same) = (0, 0);
    for bit in 0..8 * file.len() {
        let mut damaged = file.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        match read_measured(&damaged, &camera) {
            Err(_) => refused += 1,
            Ok(read) => {
                assert_eq!(read, color, "bit {bit}");
                same += 1;
            }
        }
    }
    // The last part of the file only marks the end and is not checked.
    assert!(refused > 10 * same, "{refused} refused, {same} the same");
}

/// In JPEG and TIFF files a changed byte gives other pixels without an error. Therefore these formats are refused for
/// measurements.
#[test]
fn jpeg_and_tiff_are_refused_for_measurements() {
    let (color, camera) = (picture(24, 16), camera(24, 16));
    let pixels = image::RgbImage::from_raw(24, 16, color.rgb.as_flattened().to_vec()).expect("counts agree");
    let tiff = as_file(pixels.into(), ImageFormat::Tiff);
    for (file, format) in [(write_color_jpeg(&color).expect("written"), "JPEG"), (tiff, "TIFF")] {
        let whole = read_color_of(&file, &camera).expect("a clip may hold it");
        let silent = (0..file.len()).any(|place| {
            let mut damaged = file.clone();
            damaged[place] ^= 1;
            read_color_of(&damaged, &camera).is_ok_and(|read| read != whole)
        });
        assert!(silent, "{format} notices every changed byte; the rule is no longer needed");
        for error in [read_measured(&file, &camera).map(drop), read_measured_gray(&file, &camera).map(drop)] {
            assert_eq!(error, Err(PictureError::Unchecked { format }));
        }
    }
}

/// A picture of a single grey value compresses a thousandfold. Its size must be checked in its first bytes.
#[test]
fn a_size_is_judged_before_pixels_are_unpacked() {
    let large = |width: u32, height: u32| {
        let mut file = write_gray_png(&GrayPicture { width: 8, height: 8, gray: vec![7; 64] }).expect("written");
        // The header states a large width and height, with a valid checksum. No pixels follow, so that decoding would
        // cause a different error.
        file[16..20].copy_from_slice(&width.to_be_bytes());
        file[20..24].copy_from_slice(&height.to_be_bytes());
        let sum = crc32fast::hash(&file[12..29]);
        file[29..33].copy_from_slice(&sum.to_be_bytes());
        file
    };
    let words = |result: Result<(), PictureError>| result.expect_err("refused").to_string();
    let file = large(20_000, 20_000);
    let of_camera = words(read_measured(&file, &camera(1_944, 1_200)).map(drop));
    assert_eq!(of_camera, "the picture is 20000×20000 px, but the camera's calibration is for 1944×1200 px");
    assert_eq!(words(read_color_of(&file, &camera(1_944, 1_200)).map(drop)), of_camera);
    let of_any = "the picture is 20000×20000, 400000000 pixels (limit 33554432 pixels)";
    assert_eq!(words(read_color(&file).map(drop)), of_any);
    assert_eq!(words(read_gray(&file).map(drop)), of_any);
    // With a valid size, the decoder refuses the same file.
    assert!(words(read_color(&large(4_000, 4_000)).map(drop)).contains("damaged or truncated"));
}
