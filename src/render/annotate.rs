//! Letters of the sides and a scale bar over a drawn picture.

use image::{DynamicImage, RgbaImage};

use super::Background;
use super::camera::Camera;
use crate::geometry::Vector3;
use crate::plot::canvas::Canvas;
use crate::plot::legend::Legend;

/// On light backgrounds, and the other way round on dark ones.
const DARK: [u8; 3] = [58, 64, 74];
const LIGHT: [u8; 3] = [244, 246, 248];
/// Backgrounds darker than this, linear luminance, take light letters.
const MIDDLE: f32 = 0.18;
/// An axis is named when it makes this share of a direction: within 22.5 degrees of another, that one alone.
const LEAST_SHARE: f64 = 0.382_683;

/// Draws which side of the patient is where, and a bar of a round number of millimetres, which is true at the depth of the
/// middle of the picture (everywhere with parallel rays). Directions between axes get several letters, the nearest first, as
/// in DICOM's Patient Orientation (PS3.3 C.7.6.1.1.1).
///
/// Not for transparent pictures: the letters would be the only opaque thing on an unknown ground.
pub fn annotate(picture: RgbaImage, camera: &Camera, background: Background) -> RgbaImage {
    let dark_ground = match background {
        Background::Plain([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b < MIDDLE,
        _ => false,
    };
    let (ink, shade) = if dark_ground { (LIGHT, DARK) } else { (DARK, LIGHT) };
    let [right, up, _] = camera.axes();
    let letters = [-right, right, up, -up].map(|direction| letters(&direction));
    let mut canvas = Canvas { picture: DynamicImage::from(picture).to_rgb8() };
    let legend = Legend {
        letters: letters.each_ref().map(String::as_str),
        caption: "",
        pixel_mm: camera.pixel_mm(),
        ink,
        shade,
    };
    legend.draw(&mut canvas);
    DynamicImage::from(canvas.picture).to_rgba8()
}

/// The sides of the patient that a direction points to.
fn letters(direction: &Vector3) -> String {
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| direction[b].abs().total_cmp(&direction[a].abs()));
    axes.into_iter()
        .filter(|&axis| direction[axis].abs() > LEAST_SHARE)
        .map(|axis| [['L', 'R'], ['P', 'A'], ['I', 'S']][axis][usize::from(direction[axis] > 0.0)])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_the_letters_of_their_axes() {
        assert_eq!(letters(&Vector3::new(-1.0, 0.0, 0.0)), "L");
        assert_eq!(letters(&Vector3::new(0.1, 0.2, -0.9)), "I");
        assert_eq!(letters(&Vector3::new(0.6, 0.8, 0.0)), "AR");
    }
}
