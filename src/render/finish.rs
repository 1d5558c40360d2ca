//! From drawn pixels to the picture: outlines of sections, background, tone, sRGB.

use image::RgbaImage;
use rayon::prelude::*;

use super::Background;
use super::raster::{Pixel, SAMPLES};
use crate::plot::canvas::srgb;

/// Top and bottom of the gradient, linear RGB: about #f1f3f5 and #ccd1d8 in sRGB.
const TOP: [f32; 3] = [0.879, 0.896, 0.913];
const BOTTOM: [f32; 3] = [0.604, 0.638, 0.687];
/// From here on brightness is compressed, so that highlights keep their colour.
const SHOULDER: f32 = 0.75;
/// How dark the outline of a section is, and its width for a picture 1000 px high [px].
const OUTLINE: f32 = 0.85;
const OUTLINE_WIDTH: f32 = 2.8;
/// Steps of the table from linear to sRGB: fine enough that every byte has its own.
const TONES: usize = 4096;

/// Draws a dark line along the inner side of every section's border.
pub(super) fn outline(pixels: &mut [Pixel], size: [u32; 2]) {
    let [width, height] = size.map(|side| side as usize);
    let radius = (OUTLINE_WIDTH * width.min(height) as f32 / 1000.0).max(2.0);
    let reach = radius.ceil() as usize;
    let line = |x: usize, y: usize| {
        let own = &pixels[y * width + x];
        if own.section == 0 {
            return 0.0;
        }
        let (mut outside, mut all) = (0.0, 0.0_f32);
        for other_y in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            for other_x in x.saturating_sub(reach)..(x + reach + 1).min(width) {
                let distance = (other_x.abs_diff(x) as f32).hypot(other_y.abs_diff(y) as f32);
                let weight = (radius + 0.5 - distance).clamp(0.0, 1.0);
                let other = &pixels[other_y * width + other_x];
                let same = if other.section == own.section { f32::from(other.section_samples) } else { 0.0 };
                outside += weight * (1.0 - same / SAMPLES as f32);
                all += weight;
            }
        }
        let share = f32::from(own.section_samples) / SAMPLES as f32;
        // Half of the disc lies outside at the border itself, nothing from a radius away on.
        share * (4.0 * outside / all).min(1.0)
    };
    let lines: Vec<f32> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| line(x, y))
        .collect();
    pixels.par_iter_mut().zip(&lines).for_each(|(pixel, line)| {
        pixel.color = pixel.color.map(|c| c * (1.0 - OUTLINE * line));
    });
}

/// Lays the picture over its background and encodes it.
pub(super) fn develop(pixels: &[Pixel], [width, height]: [u32; 2], background: Background) -> RgbaImage {
    let tones: Vec<u8> = (0..TONES).map(|step| srgb([(step as f32 / (TONES - 1) as f32).powi(2); 3])[0]).collect();
    // The table is even in the square root of the value, as sRGB nearly is.
    let encode = |linear: f32| tones[(linear.clamp(0.0, 1.0).sqrt() * (TONES - 1) as f32 + 0.5) as usize];
    let mut picture = RgbaImage::new(width, height);
    let row_bytes = 4 * width as usize;
    picture.par_chunks_mut(row_bytes).zip(pixels.par_chunks(width as usize)).enumerate().for_each(
        |(y, (row, pixels))| {
            let share = (y as f32 + 0.5) / height as f32;
            let behind = match background {
                Background::Gradient => [0, 1, 2].map(|c| TOP[c] + share * (BOTTOM[c] - TOP[c])),
                Background::Plain(color) => color,
                Background::Transparent => [0.0; 3],
            };
            for (bytes, pixel) in row.as_chunks_mut::<4>().0.iter_mut().zip(pixels) {
                let coverage = pixel.coverage;
                let color = match background {
                    _ if coverage == 0.0 => behind,
                    Background::Transparent => pixel.color.map(|c| toned(c / coverage)),
                    // What is behind keeps its own colour, whatever the tone of what is in front.
                    _ => [0, 1, 2].map(|c| coverage * toned(pixel.color[c] / coverage) + (1.0 - coverage) * behind[c]),
                };
                let alpha = if background == Background::Transparent { (255.0 * coverage).round() as u8 } else { 255 };
                *bytes = [encode(color[0]), encode(color[1]), encode(color[2]), alpha];
            }
        },
    );
    picture
}

/// A straight line up to [`SHOULDER`], then a bend that never reaches 1.
fn toned(linear: f32) -> f32 {
    let room = 1.0 - SHOULDER;
    if linear <= SHOULDER { linear } else { SHOULDER + room * (linear - SHOULDER) / (linear - SHOULDER + room) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_come_back_as_they_were_given() {
        let colors = [[0.0, 0.215_860_5, 0.5], [1.0, 0.003, 0.7]];
        for color in colors {
            let picture = develop(&[Pixel::default()], [1, 1], Background::Plain(color));
            assert_eq!(picture.get_pixel(0, 0).0[..3], srgb(color), "{color:?}");
        }
        let half = Pixel { color: [0.25, 0.1, 0.05], coverage: 0.5, ..Pixel::default() };
        let picture = develop(&[half], [1, 1], Background::Transparent);
        let [red, green, blue] = srgb([0.5, 0.2, 0.1]);
        assert_eq!(picture.get_pixel(0, 0).0, [red, green, blue, 128]);
    }

    #[test]
    fn tones_grow_and_stay_below_white() {
        let tones: Vec<f32> = (0..1000).map(|step| toned(step as f32 * 0.01)).collect();
        assert!(tones.windows(2).all(|pair| pair[0] < pair[1]) && tones[999] < 1.0);
        assert_eq!(toned(0.5), 0.5);
    }
}
