//! Simple bodies, and pictures of them.

use image::RgbaImage;
use yawara::render::camera::{Camera, Direction, Framing, Lens};
use yawara::render::{Background, Look, render};
use yawara::surface::mesh::{Finish, OrganMesh, TriangleMesh};

pub(crate) const RED: [f32; 3] = [0.6, 0.03, 0.03];
pub(crate) const GREEN: [f32; 3] = [0.03, 0.6, 0.03];

pub(crate) fn organ(color: [f32; 3], mesh: TriangleMesh) -> OrganMesh {
    OrganMesh { name: "body".to_owned(), color, finish: Finish::Dry, mesh }
}

/// A ball with exact normals, of rings from pole to pole.
pub(crate) fn ball(center: [f32; 3], radius: f32, rings: u32) -> TriangleMesh {
    let columns = 2 * rings;
    let mut mesh = TriangleMesh::default();
    for ring in 0..=rings {
        for column in 0..columns {
            let (polar, around) = (
                std::f32::consts::PI * ring as f32 / rings as f32,
                std::f32::consts::TAU * column as f32 / columns as f32,
            );
            // The poles are points, exactly, whatever the column.
            let across = if ring == 0 || ring == rings { 0.0 } else { polar.sin() };
            let normal = [across * around.cos(), across * around.sin(), polar.cos()];
            mesh.normals.push(normal);
            mesh.positions.push([0, 1, 2].map(|axis| center[axis] + radius * normal[axis]));
        }
    }
    for ring in 0..rings {
        for column in 0..columns {
            let at = |ring: u32, column: u32| ring * columns + column % columns;
            let (a, b) = (at(ring, column), at(ring, column + 1));
            let (c, d) = (at(ring + 1, column), at(ring + 1, column + 1));
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    mesh
}

/// A square in a coronal plane that faces the front, without normals.
pub(crate) fn plate(y: f32, half: f32) -> TriangleMesh {
    let positions = vec![[half, y, -half], [-half, y, -half], [-half, y, half], [half, y, half]];
    TriangleMesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..TriangleMesh::default() }
}

/// No background, no darkened creases: every pixel tells coverage and light.
pub(crate) fn bare() -> Look {
    Look { background: Background::Transparent, occlusion: false, ..Look::default() }
}

pub(crate) fn camera(organs: &[OrganMesh], direction: Direction, lens: &Lens, size: [u32; 2]) -> Camera {
    let mut framing = Framing::new(direction, size).unwrap();
    framing.include(organs);
    framing.camera(lens).unwrap()
}

/// A picture with a side of 240 pixels from a direction, without background.
pub(crate) fn picture(organs: &[OrganMesh], direction: Direction) -> RgbaImage {
    render(organs, &camera(organs, direction, &Lens::default(), [240, 240]), &bare()).unwrap()
}

/// Mean place of the pixels in which one channel outweighs another [px], and how many there are.
pub(crate) fn middle_of(picture: &RgbaImage, channel: usize, other: usize) -> ([f64; 2], usize) {
    let (mut sum, mut count) = ([0.0; 2], 0);
    for (x, y, pixel) in picture.enumerate_pixels() {
        if pixel[3] > 0 && pixel[channel] > pixel[other] {
            sum = [sum[0] + f64::from(x) + 0.5, sum[1] + f64::from(y) + 0.5];
            count += 1;
        }
    }
    (sum.map(|s| s / count.max(1) as f64), count)
}

/// Coverage of all pixels, in pixels.
pub(crate) fn coverage(picture: &RgbaImage) -> f64 {
    picture.pixels().map(|pixel| f64::from(pixel[3]) / 255.0).sum()
}
