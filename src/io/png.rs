//! PNG pictures, 8-bit RGB or RGBA in sRGB, with the true size of a pixel where it has one.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder, RgbImage, RgbaImage};

use super::atomic;

/// Signature and IHDR chunk: what stands before the chunk we insert.
const HEAD: usize = 8 + 25;

/// Why a picture was not written. Nothing is left at the path, or what was there before.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WritePngError {
    /// The pixel size cannot be stored.
    #[error(
        "{}: a pixel of {pixel_mm} mm cannot be written into a PNG; take one between 1e-6 and 1000 mm",
        path.display()
    )]
    PixelSize {
        /// The file asked for.
        path: PathBuf,
        /// Edge of a pixel [mm].
        pixel_mm: f64,
    },
    /// The picture cannot be encoded.
    #[error("{}: {width} x {height} pixels could not be encoded: {source}", path.display())]
    Encode {
        /// The file asked for.
        path: PathBuf,
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
        /// What the encoder said.
        source: image::ImageError,
    },
    /// The frames do not make an animation.
    #[error("{}: the frames could not be encoded as one animation: {source}", path.display())]
    Animation {
        /// The file asked for.
        path: PathBuf,
        /// What the encoder said.
        source: png::EncodingError,
    },
    /// The operating system refused.
    #[error("{}: could not write the picture: {source}", path.display())]
    Io {
        /// The file asked for.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
}

/// Writes a picture; with `pixel_mm` its pHYs chunk tells the edge of a pixel [mm], to the nearest whole pixel per metre.
///
/// # Errors
/// If the picture has no pixel, the pixel size is not within 1e-6 to 1000 mm, or the file cannot be written.
pub fn write_png(path: &Path, picture: &RgbImage, pixel_mm: Option<f64>) -> Result<(), WritePngError> {
    let bytes = encode(path, picture.as_raw(), picture.dimensions(), ExtendedColorType::Rgb8, pixel_mm)?;
    write_bytes(path, &bytes)
}

/// Writes a picture with an alpha channel, or without one when all of it is opaque.
///
/// # Errors
/// If the picture has no pixel or the file cannot be written.
pub fn write_png_rgba(path: &Path, picture: RgbaImage) -> Result<(), WritePngError> {
    if picture.pixels().all(|pixel| pixel[3] == u8::MAX) {
        return write_png(path, &DynamicImage::from(picture).to_rgb8(), None);
    }
    let bytes = encode(path, picture.as_raw(), picture.dimensions(), ExtendedColorType::Rgba8, None)?;
    write_bytes(path, &bytes)
}

fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), WritePngError> {
    atomic::write_file(path, |writer| writer.write_all(bytes))
        .map_err(|source| WritePngError::Io { path: path.to_path_buf(), source })
}

fn encode(
    path: &Path,
    picture: &[u8],
    (width, height): (u32, u32),
    kind: ExtendedColorType,
    pixel_mm: Option<f64>,
) -> Result<Vec<u8>, WritePngError> {
    let mut bytes = Vec::new();
    // The encoder's own default, fast, makes slices several times larger.
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive)
        .write_image(picture, width, height, kind)
        .map_err(|source| WritePngError::Encode { path: path.to_path_buf(), width, height, source })?;
    if let Some(pixel_mm) = pixel_mm {
        if !(1e-6..=1000.0).contains(&pixel_mm) {
            return Err(WritePngError::PixelSize { path: path.to_path_buf(), pixel_mm });
        }
        bytes.splice(HEAD..HEAD, physical_size(pixel_mm));
    }
    Ok(bytes)
}

/// The pHYs chunk (PNG third edition, 11.3.4.3), which the encoder has no setting for.
fn physical_size(pixel_mm: f64) -> [u8; 21] {
    let per_metre = ((1000.0 / pixel_mm).round() as u32).to_be_bytes();
    let mut chunk = [0; 21];
    chunk[..4].copy_from_slice(&9u32.to_be_bytes());
    chunk[4..8].copy_from_slice(b"pHYs");
    chunk[8..12].copy_from_slice(&per_metre);
    chunk[12..16].copy_from_slice(&per_metre);
    chunk[16] = 1;
    let mut crc = flate2::Crc::new();
    crc.update(&chunk[4..17]);
    chunk[17..].copy_from_slice(&crc.sum().to_be_bytes());
    chunk
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_come_back_and_tell_their_pixel_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("slice.png");
        let picture = RgbImage::from_fn(31, 17, |x, y| image::Rgb([x as u8, y as u8, (x * y) as u8]));
        write_png(&path, &picture, Some(0.5)).unwrap();
        assert_eq!(image::open(&path).unwrap().to_rgb8(), picture);
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(&bytes[HEAD + 4..HEAD + 8], b"pHYs");
        assert_eq!(bytes[HEAD + 8..HEAD + 12], 2000u32.to_be_bytes());
        // Check value of CRC-32 over this chunk, computed with zlib.
        assert_eq!(bytes[HEAD + 17..HEAD + 21], PHYS_2000_CRC.to_be_bytes());
    }

    #[test]
    fn alpha_is_kept_where_there_is_some() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("organ.png");
        let mut picture = RgbaImage::from_fn(5, 4, |x, y| image::Rgba([x as u8, y as u8, 7, 255]));
        write_png_rgba(&path, picture.clone()).unwrap();
        assert!(matches!(image::open(&path).unwrap(), DynamicImage::ImageRgb8(_)));
        picture.put_pixel(2, 2, image::Rgba([1, 2, 3, 128]));
        write_png_rgba(&path, picture.clone()).unwrap();
        assert_eq!(image::open(&path).unwrap().to_rgba8(), picture);
    }

    const PHYS_2000_CRC: u32 = 0xb98b_e79f;

    #[test]
    fn refusals_name_the_value() {
        let picture = RgbImage::new(2, 2);
        let message = write_png(Path::new("s.png"), &picture, Some(f64::NAN)).unwrap_err().to_string();
        assert!(message.contains("s.png") && message.contains("NaN mm"), "{message}");
        let folder = tempfile::tempdir().unwrap();
        let message = write_png(folder.path(), &picture, None).unwrap_err().to_string();
        assert!(message.contains("could not write the picture"), "{message}");
        let message = write_png(Path::new("s.png"), &RgbImage::new(0, 4), None).unwrap_err().to_string();
        assert!(message.contains("0 x 4"), "{message}");
    }
}
