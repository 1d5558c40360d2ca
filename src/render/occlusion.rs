//! Ambient obscurance in screen space: creases, and what lies close behind something else, get less light.
//!
//! McGuire, Mara and Luebke, *Scalable Ambient Obscurance*, High Performance Graphics 2012: the estimator of section 2.3,
//! on one level of depths. Neighbouring pixels look in different directions, sixteen in all; a mean over 4 x 4 pixels of
//! similar depth takes the grain away.

use rayon::prelude::*;

use super::camera::Camera;
use super::raster::Pixel;

/// How far around a point is looked [half extents of what is framed].
const RADIUS: f32 = 0.16;
/// Longest way on the picture, as a share of its shorter side: close-ups need not look at all of it.
const MOST_OF_PICTURE: f32 = 0.12;
/// Places that a pixel looks at, on a spiral of this many turns.
const LOOKS: usize = 12;
const TURNS: f32 = 5.0;
const PATTERNS: usize = 16;
/// Height above the tangent plane that does not count [radii]: facets of a smooth surface stay clean.
const BIAS: f32 = 0.04;
/// Darkness of a crease.
const STRENGTH: f32 = 1.0;
/// Least light that is left.
const LEAST: f32 = 0.25;

/// Darkens a drawn picture. Sections stay as they are.
pub(super) fn darken(pixels: &mut [Pixel], camera: &Camera) {
    let [width, height] = camera.size().map(|side| side as usize);
    let directions = directions();
    let mut open = vec![1.0_f32; pixels.len()];
    open.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, open) in row.iter_mut().enumerate() {
            *open = openness(pixels, camera, [x, y], &directions[4 * (y % 4) + x % 4]);
        }
    });
    let smooth: Vec<f32> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| (0..width).map(move |x| [x, y]))
        .map(|place| mean(pixels, &open, camera, place))
        .collect();
    pixels.par_chunks_mut(width).zip(smooth.par_chunks(width)).for_each(|(row, smooth)| {
        for (pixel, open) in row.iter_mut().zip(smooth) {
            pixel.color = pixel.color.map(|c| c * open);
        }
    });
}

/// Unit spirals, one for each pixel of a 4 x 4 block: from the middle outwards, in radii.
fn directions() -> [[[f32; 2]; LOOKS]; PATTERNS] {
    std::array::from_fn(|pattern| {
        std::array::from_fn(|look| {
            let share = (look as f32 + 0.5) / LOOKS as f32;
            // Odd multiples of 1/16 of a turn: neighbours in a block lie far apart.
            let angle = std::f32::consts::TAU * (share * TURNS + (pattern * 7 % PATTERNS) as f32 / PATTERNS as f32);
            [share * angle.cos(), share * angle.sin()]
        })
    })
}

/// Light that reaches a pixel's point, from [`LEAST`] to 1.
fn openness(pixels: &[Pixel], camera: &Camera, [x, y]: [usize; 2], directions: &[[f32; 2]; LOOKS]) -> f32 {
    let [width, height] = camera.size().map(|side| side as usize);
    let pixel = &pixels[y * width + x];
    if pixel.coverage == 0.0 || pixel.section != 0 {
        return 1.0;
    }
    let most = MOST_OF_PICTURE * width.min(height) as f32;
    let scale = camera.scale(f64::from(pixel.nearness)) as f32;
    let reach = (RADIUS * scale).min(most);
    let radius = reach / scale;
    if reach < 2.0 {
        return 1.0;
    }
    let place = |x: usize, y: usize, nearness: f32| camera.unproject(x as f32 + 0.5, y as f32 + 0.5, nearness);
    let own = place(x, y, pixel.nearness);
    let mut sum = 0.0;
    for direction in directions {
        let [x, y] = [x as f32 + 0.5 + reach * direction[0], y as f32 + 0.5 + reach * direction[1]];
        if x < 0.0 || y < 0.0 || x >= width as f32 || y >= height as f32 {
            continue;
        }
        let (x, y) = (x as usize, y as usize);
        let other = &pixels[y * width + x];
        if other.coverage == 0.0 {
            continue;
        }
        let there = place(x, y, other.nearness);
        let way = [0, 1, 2].map(|axis| (there[axis] - own[axis]) / radius);
        let squared: f32 = way.iter().map(|w| w * w).sum();
        let above: f32 = (0..3).map(|axis| way[axis] * pixel.normal[axis]).sum();
        let near = (1.0 - squared).max(0.0);
        sum += near * near * near * (above - BIAS).max(0.0) / (squared + 0.01);
    }
    (1.0 - STRENGTH * 5.0 / LOOKS as f32 * sum).max(LEAST)
}

/// Mean openness of the 4 x 4 pixels around one that lie about as deep.
fn mean(pixels: &[Pixel], open: &[f32], camera: &Camera, [x, y]: [usize; 2]) -> f32 {
    let [width, height] = camera.size().map(|side| side as usize);
    let pixel = &pixels[y * width + x];
    if pixel.coverage == 0.0 || pixel.section != 0 {
        return 1.0;
    }
    let depth = |pixel: &Pixel| if camera.is_orthographic() { -pixel.nearness } else { 1.0 / pixel.nearness };
    let own = depth(pixel);
    let (mut sum, mut count) = (0.0, 0.0_f32);
    for other_y in y.saturating_sub(2)..(y + 2).min(height) {
        for other_x in x.saturating_sub(2)..(x + 2).min(width) {
            let place = other_y * width + other_x;
            let other = &pixels[place];
            let alike = other.coverage > 0.0 && other.section == 0 && (depth(other) - own).abs() < 0.3 * RADIUS;
            if alike {
                sum += open[place];
                count += 1.0;
            }
        }
    }
    if count > 0.0 { sum / count } else { 1.0 }
}
