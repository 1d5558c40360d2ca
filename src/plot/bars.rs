//! Bars beside names, for things that have no order.

use std::path::Path;

use super::canvas::{Align, Canvas, Color, text_width};
use crate::io::png::{WritePngError, write_png};

const INK: Color = [38, 40, 44];
const PAPER: Color = [255; 3];
const BAR: Color = [0, 114, 178];
/// Height of a line of text [px].
const TEXT: f64 = 20.0;
/// From one bar to the next [px].
const STEP: f64 = 32.0;
const WIDTH: u32 = 1200;

/// A bar.
pub struct Bar {
    /// What it stands for.
    pub name: String,
    /// How long it is; 0 or more.
    pub value: f64,
    /// What is written at its end.
    pub label: String,
}

/// Draws bars from the top down, as long as their values, and writes them as PNG.
///
/// # Errors
/// If the file cannot be written.
pub fn write_bars(title: &str, bars: &[Bar], path: &Path) -> Result<(), WritePngError> {
    let height = (STEP * (bars.len() as f64 + 2.0)).ceil() as u32;
    let mut canvas = Canvas::new(WIDTH, height, PAPER);
    canvas.text(title, [f64::from(WIDTH) / 2.0, STEP], TEXT, Align::Center, INK);
    let widest =
        |texts: &mut dyn Iterator<Item = &String>| texts.map(|text| text_width(text, TEXT)).fold(0.0, f64::max);
    let left = widest(&mut bars.iter().map(|bar| &bar.name)) + 1.5 * TEXT;
    let right = f64::from(WIDTH) - widest(&mut bars.iter().map(|bar| &bar.label)) - 1.5 * TEXT;
    let longest = bars.iter().map(|bar| bar.value).fold(f64::MIN_POSITIVE, f64::max);
    for (bar, line) in bars.iter().zip(0..) {
        let middle = STEP * (f64::from(line) + 2.0);
        let end = left + (right - left) * bar.value / longest;
        canvas.text(&bar.name, [left - 0.5 * TEXT, middle], TEXT, Align::Right, INK);
        canvas.fill([left, middle - 0.35 * STEP], [end, middle + 0.35 * STEP], BAR, 1.0);
        canvas.text(&bar.label, [end + 0.5 * TEXT, middle], TEXT, Align::Left, INK);
    }
    write_png(path, &canvas.picture, None)
}
