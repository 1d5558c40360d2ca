//! What makes a picture of the patient readable: letters of the sides and a scale bar.

use super::canvas::{Align, Canvas, Color};

/// Letters and bar of a picture.
pub(crate) struct Legend<'a> {
    /// Which side of the patient is on the left, right, top and bottom of the picture.
    pub(crate) letters: [&'a str; 4],
    /// Stands in the upper left corner; may be empty.
    pub(crate) caption: &'a str,
    /// Edge of a pixel [mm].
    pub(crate) pixel_mm: f64,
    pub(crate) ink: Color,
    /// Drawn round the ink, so that it can be read on anything.
    pub(crate) shade: Color,
}

impl Legend<'_> {
    /// Draws them, unless the picture is so small that they would cover it.
    pub(crate) fn draw(&self, canvas: &mut Canvas) {
        let [width, height] = canvas.size();
        let Some(text) = text_height(canvas) else { return };
        let mut write = |letters: &str, place: [f64; 2], text: f64, align: Align| {
            canvas.outlined(letters, place, text, align, [self.ink, self.shade]);
        };
        let margin = 0.4 * text;
        let [left, right, top, bottom] = self.letters;
        write(left, [margin, height / 2.0], text, Align::Left);
        write(right, [width - margin, height / 2.0], text, Align::Right);
        write(top, [width / 2.0, margin + 0.5 * text], text, Align::Center);
        write(bottom, [width / 2.0, height - margin - 0.5 * text], text, Align::Center);
        // As large as fits beside the letters in the middle: a character is half as wide as high.
        let room = 2.0 * (0.5 * width - 3.0 * text) / self.caption.chars().count().max(1) as f64;
        write(self.caption, [margin, margin + 0.5 * text], text.min(room), Align::Left);

        let bar_mm = bar_length(0.3 * width * self.pixel_mm);
        let bar = bar_mm / self.pixel_mm;
        let (start, middle) =
            ([width - 2.0 * margin - bar, height - 2.0 * margin], [width - 2.0 * margin - bar / 2.0, 0.0]);
        write(&format!("{bar_mm} mm"), [middle[0], start[1] - 0.8 * text], text, Align::Center);
        let thick = (text / 7.0).max(2.0);
        let around = ([start[0] - 1.0, start[1] - thick - 1.0], [start[0] + bar + 1.0, start[1] + 1.0]);
        canvas.fill(around.0, around.1, self.shade, 1.0);
        canvas.fill([start[0], start[1] - thick], [start[0] + bar, start[1]], self.ink, 1.0);
    }
}

/// Height of the letters on a picture [px]; `None` where they would cover it.
pub(crate) fn text_height(canvas: &Canvas) -> Option<f64> {
    let [width, height] = canvas.size();
    let text = (width.min(height) / 24.0).clamp(12.0, 40.0);
    (width >= 8.0 * text && height >= 8.0 * text).then_some(text)
}

/// The largest of 1, 2 and 5 times a power of ten that is not above `most` [mm].
fn bar_length(most: f64) -> f64 {
    let power = 10f64.powi(most.log10().floor() as i32);
    power * [5.0, 2.0].into_iter().find(|m| m * power <= most).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_round() {
        assert_eq!([99.0, 100.0, 19.9, 7.0, 0.3].map(bar_length), [50.0, 100.0, 10.0, 5.0, 0.2]);
    }
}
