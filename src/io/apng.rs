//! Animated PNG: pictures one after the other in one file, with how long each is shown.
//!
//! ```text
//! for each frame: draw -> compress -> write          one picture in memory at a time, the file under a temporary name
//! ```
//! Every frame is a whole picture, as the numbered files of [`super::png`] would be; viewers without animation show the first.

use std::io;
use std::path::Path;

use image::DynamicImage;

use super::atomic;
use super::png::WritePngError;

/// Parts of a second that delays are counted in, the finest first: a delay has 16 bits.
const PARTS: [u16; 4] = [10_000, 1_000, 100, 1];

/// How long each frame is shown, in whole parts of a second.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Delays {
    counts: Vec<u16>,
    parts: u16,
}

impl Delays {
    /// From the time of each frame [s], ascending: a frame is shown until the next one's time, the last as long as the one before it.
    /// Rounded to 0.1 ms (coarser where a delay is longer than 6.5 s) so that frames do not drift from their times.
    ///
    /// - `slow`: how many times slower than life.
    ///
    /// `None` if the times do not ascend, or a delay is longer than 65535 s.
    pub fn between(times: &[f64], slow: f64) -> Option<Self> {
        let last = times.len().checked_sub(1)?;
        let mut ends: Vec<f64> = times.iter().map(|time| (time - times[0]) * slow).collect();
        ends.push(if last == 0 { 1.0 } else { 2.0 * ends[last] - ends[last - 1] });
        let longest = ends.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        let ascend = ends.windows(2).all(|pair| pair[1] > pair[0]);
        let parts = PARTS.into_iter().find(|&parts| longest * f64::from(parts) + 1.0 < f64::from(u16::MAX))?;
        let place = |end: f64| (end * f64::from(parts)).round();
        let counts = ends.windows(2).map(|pair| (place(pair[1]) - place(pair[0])).max(1.0) as u16).collect();
        ascend.then_some(Self { counts, parts })
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.counts.len()
    }

    /// Never: there is no animation without a frame.
    pub fn is_empty(&self) -> bool {
        self.counts.is_empty()
    }
}

/// Writes an animation that goes on for ever. `picture` draws each frame when its turn comes, all of one size and kind (RGB or RGBA, 8 bits).
///
/// - `pixel_mm`: edge of a pixel [mm], where it has a true size.
///
/// # Errors
/// Whatever `picture` returns; or if the first picture has no pixel, a later one another size or kind, the pixel size is not within 1e-6 to
/// 1000 mm, or the file cannot be written. Then nothing is left at the path, or what was there before.
pub fn write_apng<E: From<WritePngError>>(
    path: &Path,
    delays: &Delays,
    pixel_mm: Option<f64>,
    mut picture: impl FnMut(usize) -> Result<DynamicImage, E>,
) -> Result<(), E> {
    if let Some(pixel_mm) = pixel_mm.filter(|pixel_mm| !(1e-6..=1000.0).contains(pixel_mm)) {
        return Err(WritePngError::PixelSize { path: path.to_path_buf(), pixel_mm }.into());
    }
    let written = atomic::write_file(path, |writer| {
        let first = picture(0).map_err(Stop::Picture)?;
        let mut encoder = png::Encoder::new(writer, first.width(), first.height());
        encoder.set_color(if first.color().has_alpha() { png::ColorType::Rgba } else { png::ColorType::Rgb });
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Balanced);
        encoder.set_filter(png::Filter::Adaptive);
        encoder.set_animated(delays.len() as u32, 0)?;
        encoder.set_pixel_dims(pixel_mm.map(|pixel_mm| {
            let per_metre = (1000.0 / pixel_mm).round() as u32;
            png::PixelDimensions { xppu: per_metre, yppu: per_metre, unit: png::Unit::Meter }
        }));
        encoder.validate_sequence(true);
        let mut encoder = encoder.write_header()?;
        let mut next = Some(first);
        for (number, &count) in delays.counts.iter().enumerate() {
            let frame = next.take().map_or_else(|| picture(number).map_err(Stop::Picture), Ok)?;
            encoder.set_frame_delay(count, delays.parts)?;
            encoder.write_image_data(frame.as_bytes())?;
        }
        encoder.finish()?;
        Ok(())
    });
    written.map_err(|stop| match stop {
        Stop::Picture(error) => error,
        Stop::Encode(png::EncodingError::IoError(source)) | Stop::Io(source) => {
            WritePngError::Io { path: path.to_path_buf(), source }.into()
        }
        Stop::Encode(source) => WritePngError::Animation { path: path.to_path_buf(), source }.into(),
    })
}

/// What ended the writing.
enum Stop<E> {
    Picture(E),
    Encode(png::EncodingError),
    Io(io::Error),
}

impl<E> From<io::Error> for Stop<E> {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl<E> From<png::EncodingError> for Stop<E> {
    fn from(error: png::EncodingError) -> Self {
        Self::Encode(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    #[test]
    fn delays_follow_the_times_without_drift() {
        let times: Vec<f64> = (0..=30).map(|frame| f64::from(frame) / 30.0).collect();
        let delays = Delays::between(&times, 1.0).unwrap();
        assert_eq!((delays.len(), delays.parts), (31, 10_000));
        let sum: u32 = delays.counts[..30].iter().map(|&count| u32::from(count)).sum();
        assert_eq!(sum, 10_000, "a second is a second");
        assert!(delays.counts.iter().all(|count| (333..=334).contains(count)), "{:?}", delays.counts);
        assert_eq!(
            Delays::between(&[0.0, 1.0, 3.0], 10.0).unwrap(),
            Delays { counts: vec![10_000, 20_000, 20_000], parts: 1_000 }
        );
        assert_eq!(Delays::between(&[2.0], 1.0).unwrap().counts, [10_000]);
        for times in [[].as_slice(), &[0.0, 0.0], &[1.0, 0.5], &[0.0, f64::NAN], &[0.0, 1e6]] {
            assert_eq!(Delays::between(times, 1.0), None, "{times:?}");
        }
    }

    #[test]
    fn what_stops_an_animation_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cut.apng");
        let delays = Delays::between(&[0.0, 0.1, 0.2], 1.0).unwrap();
        let sized = |frame: usize| RgbImage::from_pixel(4 + frame as u32 / 2, 3, Rgb([frame as u8; 3]));
        let message =
            write_apng(&path, &delays, None, |frame| Ok::<_, WritePngError>(sized(frame).into())).unwrap_err();
        assert!(message.to_string().contains("cut.apng"), "{message}");
        let drawn = |frame: usize| match frame {
            2 => Err(WritePngError::Io { path: "drawing".into(), source: io::Error::other("no light") }),
            _ => Ok(sized(0).into()),
        };
        assert!(write_apng(&path, &delays, None, drawn).unwrap_err().to_string().contains("no light"));
        let message = write_apng(&path, &delays, Some(0.0), drawn).unwrap_err().to_string();
        assert!(message.contains("0 mm"), "{message}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
