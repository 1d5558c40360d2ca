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
        let text = (width.min(height) / 24.0).clamp(12.0, 40.0);
        if width < 8.0 * text || height < 8.0 * text {
            return;
        }
        let mut write = |letters: &str, place: [f64; 2], align: Align| {
            for shift in [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]] {
                canvas.text(letters, [place[0] + shift[0], place[1] + shift[1]], text, align, self.shade);
            }
            canvas.text(letters, place, text, align, self.ink);
        };
        let margin = 0.4 * text;
        let [left, right, top, bottom] = self.letters;
        write(left, [margin, height / 2.0], Align::Left);
        write(right, [width - margin, height / 2.0], Align::Right);
        write(top, [width / 2.0, margin + 0.5 * text], Align::Center);
        write(bottom, [width / 2.0, height - margin - 0.5 * text], Align::Center);
        write(self.caption, [margin, margin + 0.5 * text], Align::Left);

        let bar_mm = bar_length(0.3 * width * self.pixel_mm);
        let bar = bar_mm / self.pixel_mm;
        let (start, middle) =
            ([width - 2.0 * margin - bar, height - 2.0 * margin], [width - 2.0 * margin - bar / 2.0, 0.0]);
        write(&format!("{bar_mm} mm"), [middle[0], start[1] - 0.8 * text], Align::Center);
        let thick = (text / 7.0).max(2.0);
        let around = ([start[0] - 1.0, start[1] - thick - 1.0], [start[0] + bar + 1.0, start[1] + 1.0]);
        canvas.fill(around.0, around.1, self.shade, 1.0);
        canvas.fill([start[0], start[1] - thick], [start[0] + bar, start[1]], self.ink, 1.0);
    }
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
