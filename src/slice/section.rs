//! Which organ holds each pixel of a slice, by the closed surfaces of the organs: so that slices and surfaces agree.

use rayon::prelude::*;

use super::Raster;
use super::contour::contour;
use crate::surface::mesh::TriangleMesh;

/// No organ.
const NONE: u8 = u8::MAX;

/// The organs of the pixels of one slice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    organs: Vec<u8>,
}

impl Section {
    /// Fills the contours of closed meshes. A pixel belongs to the first mesh its middle is inside: around it the contour winds
    /// other than zero times, so tissue pushed into itself is filled. O(triangles + pixels), the same at any number of threads.
    ///
    /// # Panics
    /// If there are more than 255 meshes.
    pub fn new(meshes: &[&TriangleMesh], raster: &Raster) -> Self {
        assert!(meshes.len() <= usize::from(NONE), "at most 255 organs");
        let width = raster.width as usize;
        let mut organs = vec![NONE; raster.len()];
        for (organ, mesh) in meshes.iter().enumerate() {
            let mut rows: Vec<Vec<(f64, i32)>> = vec![Vec::new(); raster.height as usize];
            for ends in contour(mesh, &raster.plane) {
                add_crossings(ends.map(|end| raster.pixel_of(end)), &mut rows);
            }
            organs
                .par_chunks_mut(width)
                .zip(&mut rows)
                .for_each(|(pixels, crossings)| fill(pixels, crossings, organ as u8));
        }
        Self { organs }
    }

    /// The mesh that holds a pixel (row by row from the upper left), by its place in the list.
    pub fn organ(&self, pixel: usize) -> Option<usize> {
        self.organs.get(pixel).filter(|&&organ| organ != NONE).map(|&organ| usize::from(organ))
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.organs.len()
    }

    /// True when there is no pixel.
    pub fn is_empty(&self) -> bool {
        self.organs.is_empty()
    }
}

/// Adds where a segment crosses the middle lines of rows: column, and 1 downwards or -1 upwards.
fn add_crossings([from, to]: [[f64; 2]; 2], rows: &mut [Vec<(f64, i32)>]) {
    let (top, bottom, winding) = if from[1] <= to[1] { (from, to, 1) } else { (to, from, -1) };
    if !top.iter().chain(&bottom).all(|x| x.is_finite()) {
        return;
    }
    // Rows in [top, bottom): segments that meet count once where they do.
    let first = top[1].ceil().max(0.0) as usize;
    let last = bottom[1].ceil().clamp(0.0, rows.len() as f64) as usize;
    for (row, crossings) in rows.iter_mut().enumerate().take(last).skip(first) {
        let share = (row as f64 - top[1]) / (bottom[1] - top[1]);
        crossings.push((top[0] + share * (bottom[0] - top[0]), winding));
    }
}

fn fill(pixels: &mut [u8], crossings: &mut [(f64, i32)], organ: u8) {
    crossings.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let column = |at: f64| at.ceil().clamp(0.0, pixels.len() as f64) as usize;
    let mut winding = 0;
    let mut spans = Vec::new();
    for pair in crossings.windows(2) {
        winding += pair[0].1;
        if winding != 0 {
            spans.push(column(pair[0].0)..column(pair[1].0));
        }
    }
    for pixel in spans.into_iter().flat_map(|span| span.into_iter()) {
        if pixels[pixel] == NONE {
            pixels[pixel] = organ;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::slice::{SliceAxis, SlicePlane};

    /// A box turned outwards.
    fn cuboid(low: [f32; 3], high: [f32; 3]) -> TriangleMesh {
        let corner = |c: usize| [0, 1, 2].map(|axis| if c >> axis & 1 == 1 { high[axis] } else { low[axis] });
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        TriangleMesh { positions: (0..8).map(corner).collect(), triangles, ..TriangleMesh::default() }
    }

    #[test]
    fn boxes_are_filled_where_they_are_and_the_first_counts() {
        let grid =
            Grid { shape: GridShape::new(20, 20, 20), affine: Affine::from_spacing([1.0; 3], [0.5; 3]).unwrap() };
        let boxes = [cuboid([2.0, 3.0, 1.0], [9.0, 8.0, 9.0]), cuboid([5.0, 5.0, 1.0], [15.0, 12.0, 7.0])];
        // The same box again, pushed into the first, as one mesh: the winding is 2 where both are.
        let mut twice = boxes[0].clone();
        twice.positions.extend(&boxes[1].positions);
        twice.triangles.extend(boxes[1].triangles.iter().map(|t| t.map(|v| v + 8)));
        for axis in [SliceAxis::X, SliceAxis::Y, SliceAxis::Z] {
            let raster = SlicePlane { axis, at_mm: 6.0, pixel_mm: 0.25 }.raster(&grid).unwrap();
            let section = Section::new(&[&boxes[0], &boxes[1]], &raster);
            let both = Section::new(&[&twice], &raster);
            let mut seen = [0; 3];
            for pixel in 0..section.len() {
                let place = raster.place(pixel as u32 % raster.width, pixel as u32 / raster.width);
                let within = |mesh: &TriangleMesh| {
                    (0..3).all(|a| {
                        (f64::from(mesh.positions[0][a])..=f64::from(mesh.positions[7][a])).contains(&place[a])
                    })
                };
                let expected = boxes.iter().position(within);
                assert_eq!(section.organ(pixel), expected, "{axis}: {place}");
                assert_eq!(both.organ(pixel), expected.map(|_| 0), "{axis}: {place}");
                seen[expected.unwrap_or(2)] += 1;
            }
            assert!(seen.iter().all(|&count| count > 100), "{seen:?}");
        }
    }
}
