//! The scale of a colour map beside a picture.

use super::canvas::{Align, Canvas, Color, Place, srgb};
use super::ticks::{self, Label};
use crate::look::colormap::Colormap;

/// A colour map with its range.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorBar {
    /// The map.
    pub colormap: Colormap,
    /// Values of its two ends, in the unit that the title names; the second is the larger.
    pub range: [f32; 2],
    /// Quantity and unit, such as `displacement [mm]`.
    pub title: String,
}

impl ColorBar {
    /// Linear RGB in 0..=1 of a value.
    pub fn rgb(&self, value: f32) -> [f32; 3] {
        let [low, high] = self.range;
        self.colormap.rgb((value - low) / (high - low))
    }

    /// Draws it upright with ticks at its right and its title above, `size` wide and high [px].
    pub(crate) fn draw(&self, canvas: &mut Canvas, [left, top]: Place, size: [f64; 2], text: f64, ink: [Color; 2]) {
        let [low, high] = self.range.map(f64::from);
        let [ink, shade] = ink;
        canvas.fill([left - 1.0, top - 1.0], [left + size[0] + 1.0, top + size[1] + 1.0], ink, 1.0);
        let rows = size[1].round() as usize;
        for row in 0..rows {
            let share = 1.0 - (row as f64 + 0.5) / rows as f64;
            let y = top + row as f64;
            canvas.fill([left, y], [left + size[0], y + 1.0], srgb(self.colormap.rgb(share as f32)), 1.0);
        }
        let wanted = (size[1] / (1.6 * text)).max(2.0) as usize;
        let ticks = ticks::linear(low, high, wanted, false);
        let right = left + size[0];
        for (value, label) in &ticks.major {
            let Label::Number(label) = label else { continue };
            let y = top + size[1] * (1.0 - (value - low) / (high - low));
            canvas.fill([right, y - 0.5], [right + 0.3 * text, y + 0.5], ink, 1.0);
            canvas.outlined(label, [right + 0.5 * text, y], text, Align::Left, [ink, shade]);
        }
        let title = match ticks.exponent {
            0 => self.title.clone(),
            power => format!("{} x 10^{power}", self.title),
        };
        canvas.outlined(&title, [left, top - 0.9 * text], text, Align::Left, [ink, shade]);
    }
}
