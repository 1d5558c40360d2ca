//! Smooth lines and text on an RGB picture: what plots and slices share.
//!
//! Coordinates are pixels, (0, 0) the upper left *corner* of the picture, so (0.5, 0.5) is the middle of its first pixel.
//! Colours are sRGB and blended as they are. What falls outside the picture is clipped.

use embedded_graphics::mono_font::{MonoFont, MonoTextStyle, iso_8859_1};
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Pixel, Point, Size};
use embedded_graphics::text::{Baseline, Text};
use image::{Rgb, RgbImage};

use crate::look::colormap::linear_to_srgb8;

/// An sRGB colour.
pub(crate) type Color = [u8; 3];
/// A place on the canvas [px].
pub(crate) type Place = [f64; 2];

/// Covers the printable characters of ISO 8859-1; needs no font on the machine and gives the same pixels everywhere.
const FONT: MonoFont<'static> = iso_8859_1::FONT_10X20;
const GLYPH: [usize; 2] = [10, 20];
/// The font is smoothed at four times its size.
const FINE: usize = 4;

/// Where a text lies relative to its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Align {
    /// The place is at its left.
    Left,
    /// The place is in its middle.
    Center,
    /// The place is at its right.
    Right,
}

/// A picture being drawn.
pub(crate) struct Canvas {
    pub(crate) picture: RgbImage,
}

impl Canvas {
    pub(crate) fn new(width: u32, height: u32, background: Color) -> Self {
        Self { picture: RgbImage::from_pixel(width, height, Rgb(background)) }
    }

    /// Width and height [px].
    pub(crate) fn size(&self) -> [f64; 2] {
        [f64::from(self.picture.width()), f64::from(self.picture.height())]
    }

    fn blend(&mut self, x: i64, y: i64, color: Color, alpha: f64) {
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { return };
        if let Some(Rgb(pixel)) = self.picture.get_pixel_mut_checked(x, y) {
            *pixel = mix(*pixel, color, alpha);
        }
    }

    /// Fills a rectangle given by two corners, with the share of each border pixel it covers.
    pub(crate) fn fill(&mut self, [x0, y0]: Place, [x1, y1]: Place, color: Color, alpha: f64) {
        if ![x0, y0, x1, y1].iter().all(|x| x.is_finite()) {
            return;
        }
        let [width, height] = self.size();
        let overlap = |at: i64, low: f64, high: f64| (high.min(at as f64 + 1.0) - low.max(at as f64)).clamp(0.0, 1.0);
        for y in y0.max(0.0).floor() as i64..y1.min(height).ceil() as i64 {
            for x in x0.max(0.0).floor() as i64..x1.min(width).ceil() as i64 {
                self.blend(x, y, color, alpha * overlap(x, x0, x1) * overlap(y, y0, y1));
            }
        }
    }

    /// Draws line segments of one width with round ends, as one shape: where they overlap they do not add up.
    pub(crate) fn lines(&mut self, segments: &[[Place; 2]], width: f64, color: Color, alpha: f64) {
        let [columns, rows] = self.size().map(|s| s as usize);
        let mut coverage = vec![0.0f32; columns * rows];
        let reach = width / 2.0 + 0.5;
        for &[from, to] in segments {
            if !from.iter().chain(&to).all(|x| x.is_finite()) {
                continue;
            }
            // Short pieces keep the box around each piece narrow, whatever the slope.
            let length = (to[0] - from[0]).hypot(to[1] - from[1]).min(4e5);
            let pieces = (length / 16.0).ceil().max(1.0) as usize;
            let at = |share: f64| [from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share];
            for piece in 0..pieces {
                let (a, b) = (at(piece as f64 / pieces as f64), at((piece + 1) as f64 / pieces as f64));
                let range = |axis: usize, limit: usize| {
                    let low = (a[axis].min(b[axis]) - reach).floor().max(0.0) as usize;
                    let high = (a[axis].max(b[axis]) + reach).ceil().clamp(0.0, limit as f64) as usize;
                    low..high
                };
                for y in range(1, rows) {
                    for x in range(0, columns) {
                        let distance = distance([x as f64 + 0.5, y as f64 + 0.5], a, b);
                        let covered = (reach - distance).clamp(0.0, width.min(1.0)) as f32;
                        let place = &mut coverage[y * columns + x];
                        *place = place.max(covered);
                    }
                }
            }
        }
        for (at, &covered) in coverage.iter().enumerate().filter(|(_, covered)| **covered > 0.0) {
            self.blend((at % columns) as i64, (at / columns) as i64, color, alpha * f64::from(covered));
        }
    }

    /// Writes one line of text whose capital letters are about 0.65 `height` tall; `place` is at mid-height.
    pub(crate) fn text(&mut self, text: &str, place: Place, height: f64, align: Align, color: Color) {
        let block = TextBlock::new(text);
        let scale = height / GLYPH[1] as f64;
        let width = text_width(text, height);
        let left = place[0] - shift(align, width);
        let top = place[1] - height / 2.0;
        block.paint(scale, |x, y, alpha| self.blend_offset(left, top, x, y, color, alpha), (left.fract(), top.fract()));
    }

    /// Writes one line of text with a seam of another colour, `[ink, shade]`, so that it can be read on anything.
    pub(crate) fn outlined(&mut self, text: &str, place: Place, height: f64, align: Align, [ink, shade]: [Color; 2]) {
        for [x, y] in [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]] {
            self.text(text, [place[0] + x, place[1] + y], height, align, shade);
        }
        self.text(text, place, height, align, ink);
    }

    /// Writes one line of text that runs upward; `place` is at its middle.
    pub(crate) fn text_upward(&mut self, text: &str, place: Place, height: f64, color: Color) {
        let block = TextBlock::new(text);
        let scale = height / GLYPH[1] as f64;
        let (left, bottom) = (place[0] - height / 2.0, place[1] + text_width(text, height) / 2.0);
        block.paint(
            scale,
            |x, y, alpha| self.blend(left.floor() as i64 + y, bottom.floor() as i64 - x, color, alpha),
            (0.0, 0.0),
        );
    }

    fn blend_offset(&mut self, left: f64, top: f64, x: i64, y: i64, color: Color, alpha: f64) {
        self.blend(left.floor() as i64 + x, top.floor() as i64 + y, color, alpha);
    }
}

/// Width of a text [px].
pub(crate) fn text_width(text: &str, height: f64) -> f64 {
    text.chars().count() as f64 * height * GLYPH[0] as f64 / GLYPH[1] as f64
}

/// How far left of its place a text of this width begins.
pub(crate) fn shift(align: Align, width: f64) -> f64 {
    match align {
        Align::Left => 0.0,
        Align::Center => width / 2.0,
        Align::Right => width,
    }
}

/// A colour between two.
pub(crate) fn mix(from: Color, to: Color, share: f64) -> Color {
    let share = share.clamp(0.0, 1.0);
    std::array::from_fn(|c| (f64::from(from[c]) * (1.0 - share) + f64::from(to[c]) * share).round() as u8)
}

/// The sRGB colour of a linear one (IEC 61966-2-1).
pub(crate) fn srgb(linear: [f32; 3]) -> Color {
    linear.map(linear_to_srgb8)
}

fn distance(p: Place, a: Place, b: Place) -> f64 {
    let (ab, ap) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let squared = ab[0] * ab[0] + ab[1] * ab[1];
    let share = if squared > 0.0 { ((ap[0] * ab[0] + ap[1] * ab[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (ap[0] - share * ab[0]).hypot(ap[1] - share * ab[1])
}

/// A text as a bitmap at [`FINE`] times the font's size, with the font's steps smoothed away.
struct TextBlock {
    width: usize,
    height: usize,
    dots: Vec<bool>,
}

impl TextBlock {
    fn new(text: &str) -> Self {
        let width = GLYPH[0] * text.chars().count();
        let mut coarse = Self { width, height: GLYPH[1], dots: vec![false; width * GLYPH[1]] };
        let style = MonoTextStyle::new(&FONT, BinaryColor::On);
        let Ok(_) = Text::with_baseline(text, Point::zero(), style, Baseline::Top).draw(&mut coarse);
        coarse.doubled().doubled()
    }

    fn at(&self, x: i64, y: i64) -> bool {
        let inside = x >= 0 && y >= 0 && x < self.width as i64 && y < self.height as i64;
        inside && self.dots[y as usize * self.width + x as usize]
    }

    /// The bitmap at twice its size with slanted strokes smoothed: Scale2x (Andrea Mazzoleni, 2001).
    fn doubled(&self) -> Self {
        let (width, height) = (2 * self.width, 2 * self.height);
        let mut dots = vec![false; width * height];
        for y in 0..self.height as i64 {
            for x in 0..self.width as i64 {
                let own = self.at(x, y);
                let (up, down, left, right) =
                    (self.at(x, y - 1), self.at(x, y + 1), self.at(x - 1, y), self.at(x + 1, y));
                let corner = |a: bool, b: bool, c: bool, d: bool| if a == b && a != c && b != d { a } else { own };
                let start = 2 * y as usize * width + 2 * x as usize;
                dots[start] = corner(left, up, down, right);
                dots[start + 1] = corner(up, right, left, down);
                dots[start + width] = corner(down, left, right, up);
                dots[start + width + 1] = corner(right, down, up, left);
            }
        }
        Self { width, height, dots }
    }

    /// Calls `dot` with each pixel and its coverage at `scale` times the font's size, begun at a fraction of a pixel.
    fn paint(&self, scale: f64, mut dot: impl FnMut(i64, i64, f64), (left, top): (f64, f64)) {
        let fine = FINE as f64 / scale;
        let columns = (self.width as f64 / fine + left).ceil() as i64;
        let rows = (self.height as f64 / fine + top).ceil() as i64;
        // Each pixel takes the mean of SAMPLES x SAMPLES points.
        const SAMPLES: usize = 6;
        for y in 0..rows {
            for x in 0..columns {
                let mut hits = 0;
                for sample in 0..SAMPLES * SAMPLES {
                    let part = |s: usize| (s as f64 + 0.5) / SAMPLES as f64;
                    let u = (x as f64 + part(sample % SAMPLES) - left) * fine;
                    let v = (y as f64 + part(sample / SAMPLES) - top) * fine;
                    hits += usize::from(self.at(u.floor() as i64, v.floor() as i64));
                }
                if hits > 0 {
                    dot(x, y, hits as f64 / (SAMPLES * SAMPLES) as f64);
                }
            }
        }
    }
}

impl OriginDimensions for TextBlock {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for TextBlock {
    type Color = BinaryColor;
    type Error = std::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<BinaryColor>>>(&mut self, pixels: I) -> Result<(), Self::Error> {
        for Pixel(Point { x, y }, color) in pixels {
            if x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height {
                self.dots[y as usize * self.width + x as usize] = color.is_on();
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLACK: Color = [0; 3];
    const WHITE: Color = [255; 3];

    fn ink(canvas: &Canvas) -> f64 {
        canvas.picture.pixels().map(|pixel| f64::from(255 - pixel.0[0]) / 255.0).sum()
    }

    #[test]
    fn a_line_covers_its_length_times_its_width() {
        for to in [[110.0, 60.0], [60.0, 110.0], [110.0, 110.0]] {
            let mut canvas = Canvas::new(120, 120, WHITE);
            canvas.lines(&[[[10.0, 10.0], to]], 3.0, BLACK, 1.0);
            let length = (to[0] - 10.0f64).hypot(to[1] - 10.0);
            let expected = 3.0 * length + std::f64::consts::PI * 2.25;
            // Coverage by distance alone is a little off on slanted borders.
            assert!((ink(&canvas) / expected - 1.0).abs() < 0.02, "{} {expected}", ink(&canvas));
        }
    }

    #[test]
    fn segments_of_one_call_do_not_add_up() {
        let mut once = Canvas::new(40, 40, WHITE);
        once.lines(&[[[5.0, 5.0], [35.0, 20.0]]], 2.0, BLACK, 0.5);
        let mut twice = Canvas::new(40, 40, WHITE);
        twice.lines(&[[[5.0, 5.0], [35.0, 20.0]], [[35.0, 20.0], [5.0, 5.0]]], 2.0, BLACK, 0.5);
        assert_eq!(once.picture, twice.picture);
    }

    #[test]
    fn nothing_is_drawn_outside_and_nothing_panics() {
        let mut canvas = Canvas::new(10, 10, WHITE);
        canvas.lines(&[[[-100.0, -50.0], [-5.0, -7.0]], [[f64::NAN, 0.0], [1.0, 1.0]]], 2.0, BLACK, 1.0);
        canvas.fill([-5.0, -5.0], [-1.0, 30.0], BLACK, 1.0);
        canvas.text("far away", [500.0, -20.0], 16.0, Align::Center, BLACK);
        assert_eq!(ink(&canvas), 0.0);
    }

    #[test]
    fn upward_text_is_the_text_turned() {
        let mut along = Canvas::new(60, 60, WHITE);
        along.text("R5", [30.0, 30.0], 20.0, Align::Center, BLACK);
        let mut upward = Canvas::new(60, 60, WHITE);
        upward.text_upward("R5", [30.0, 30.0], 20.0, BLACK);
        assert!((ink(&along) - ink(&upward)).abs() < 1e-9 && ink(&along) > 20.0);
        // The top of the text, its upper half, is at the left.
        let turned = image::imageops::rotate270(&along.picture);
        let differing = turned.pixels().zip(upward.picture.pixels()).filter(|(a, b)| a != b).count();
        let shifted = RgbImage::from_fn(60, 60, |x, y| *turned.get_pixel(x, y.saturating_sub(1).min(59)));
        let differing_shifted = shifted.pixels().zip(upward.picture.pixels()).filter(|(a, b)| a != b).count();
        assert!(differing == 0 || differing_shifted == 0, "{differing} {differing_shifted}");
    }

    #[test]
    fn linear_colours_are_encoded() {
        assert_eq!(srgb([-1.0, 0.215_86, 1.0]), [0, 128, 255]);
    }
}
