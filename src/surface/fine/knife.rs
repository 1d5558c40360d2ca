//! A cut sheet as something to ask: does this segment pass through it?

use rayon::prelude::*;

use crate::cut::CutSheet;
use crate::geometry::{Affine, CellMap, Point3, Vector3};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
use crate::lattice::{Lattice, NO_PARTICLE, SeveredSpring};

/// The sheet is moved aside by this much [cells], in a direction that is in no plane of simple numbers: grid points exactly in
/// the plane of a cut then have a side.
const ASIDE: f64 = 1e-4;
const DIRECTION: Vector3 = Vector3::new(0.61, 0.493, 0.62);
/// Triangles reach this much over their edges, so that no segment slips through between two of them.
const OVERLAP: f64 = 1e-7;

/// The triangles of a cut sheet in the index coordinates of a lattice, found by its cells.
pub(super) struct Knife {
    triangles: Vec<[Vector3; 3]>,
    times: Vec<f64>,
    /// Triangles that may reach into each cell, by its lowest corner.
    cells: CellMap<[i32; 3], Vec<u32>>,
}

impl Knife {
    pub(super) fn new(sheet: &CutSheet, affine: &Affine) -> Self {
        let aside = DIRECTION * ASIDE;
        let places: Vec<Vector3> = sheet
            .vertices
            .par_iter()
            .map(|vertex| affine.index_of(Point3::from(vertex.map(f64::from))).coords + aside)
            .collect();
        let corners = |quad: &[u32; 4]| quad.map(|vertex| places[vertex as usize]);
        let triangles: Vec<[Vector3; 3]> =
            sheet.quads.iter().map(corners).flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let times = sheet.times.iter().flat_map(|&time| [time; 2]).collect();
        let mut cells = CellMap::<[i32; 3], Vec<u32>>::default();
        for (number, triangle) in (0..).zip(&triangles) {
            each_cell(triangle, |cell| cells.entry(cell).or_default().push(number));
        }
        Self { triangles, times, cells }
    }

    /// Cells the sheet may reach into.
    pub(super) fn cells(&self) -> impl Iterator<Item = [i32; 3]> + '_ {
        self.cells.keys().copied()
    }

    /// Cells that triangles from a number on may reach into; some of them more than once.
    pub(super) fn cells_of(&self, first: usize) -> impl Iterator<Item = [i32; 3]> + '_ {
        self.triangles[first..].iter().flat_map(|triangle| {
            let mut cells = Vec::new();
            each_cell(triangle, |cell| cells.push(cell));
            cells
        })
    }

    /// Whether the segment between two points of a cell passes through the sheet.
    pub(super) fn parts(&self, cell: [i32; 3], a: Vector3, b: Vector3) -> bool {
        let near = self.cells.get(&cell);
        near.is_some_and(|near| near.iter().any(|&n| crossing(&self.triangles[n as usize], a, b).is_some()))
    }

    /// Every spring of a lattice that passes through the sheet, in order of particle and direction; once each.
    ///
    /// - `first`: triangles before this one are left out (two to a quad).
    /// - `index_in`: from the index coordinates of the sheet to those of the lattice.
    pub(super) fn severed(
        &self,
        lattice: &Lattice,
        first: usize,
        index_in: impl Fn(Vector3) -> Vector3 + Sync,
    ) -> Vec<SeveredSpring> {
        let dims = lattice.grid.shape.dims();
        let mut found: Vec<SeveredSpring> = self.triangles[first..]
            .par_iter()
            .zip(&self.times[first..])
            .flat_map_iter(|(triangle, &time)| {
                let triangle = triangle.map(&index_in);
                let [low, high] = bounds(&triangle);
                let mut found = Vec::new();
                each_point(low.map(|x| x.floor() - 1.0), high.map(|x| x.ceil() + 1.0), |point| {
                    if (0..3).any(|axis| point[axis] < 0 || point[axis] >= dims[axis] as i32) {
                        return;
                    }
                    let particle = lattice.particle_at[lattice.grid.shape.linear(point.map(|i| i as usize))];
                    if particle == NO_PARTICLE {
                        return;
                    }
                    let a = Vector3::from(point.map(f64::from));
                    for direction in FIRST_FORWARD..NEIGHBOURS {
                        if lattice.springs[particle as usize] >> direction & 1 == 1 {
                            let b = a + Vector3::from(OFFSETS[direction].map(f64::from));
                            if let Some(at) = crossing(&triangle, a, b) {
                                let (direction, at) = (direction as u8, at as f32);
                                found.push(SeveredSpring { particle, direction, at, time });
                            }
                        }
                    }
                });
                found
            })
            .collect();
        let key = |spring: &SeveredSpring| (spring.particle, spring.direction);
        found.par_sort_unstable_by(|a, b| key(a).cmp(&key(b)).then(a.at.total_cmp(&b.at)));
        found.dedup_by_key(|spring| key(spring));
        found
    }
}

/// Lowest and highest coordinates.
fn bounds(triangle: &[Vector3; 3]) -> [Vector3; 2] {
    [triangle[0].inf(&triangle[1]).inf(&triangle[2]), triangle[0].sup(&triangle[1]).sup(&triangle[2])]
}

/// Cells that a triangle may reach into.
fn each_cell(triangle: &[Vector3; 3], take: impl FnMut([i32; 3])) {
    let [low, high] = bounds(triangle);
    each_point(low.map(f64::floor), high.map(f64::floor), take);
}

fn each_point(low: Vector3, high: Vector3, mut take: impl FnMut([i32; 3])) {
    let [low, high] = [low, high].map(|corner| [0, 1, 2].map(|axis| corner[axis] as i32));
    for k in low[2]..=high[2] {
        for j in low[1]..=high[1] {
            for i in low[0]..=high[0] {
                take([i, j, k]);
            }
        }
    }
}

/// Where a segment passes through a triangle: 0 at `a`, 1 at `b`.
///
/// # Source
/// Möller and Trumbore, Fast, minimum storage ray-triangle intersection, 1997.
fn crossing(triangle: &[Vector3; 3], a: Vector3, b: Vector3) -> Option<f64> {
    let (way, first, second) = (b - a, triangle[1] - triangle[0], triangle[2] - triangle[0]);
    let across = way.cross(&second);
    let determinant = first.dot(&across);
    // Parallel, or a triangle without area.
    if determinant.abs() <= 1e-12 * first.norm() * second.norm() {
        return None;
    }
    let from = a - triangle[0];
    let u = from.dot(&across) / determinant;
    let other = from.cross(&first);
    let v = way.dot(&other) / determinant;
    let at = second.dot(&other) / determinant;
    (u >= -OVERLAP && v >= -OVERLAP && u + v <= 1.0 + OVERLAP && (0.0..=1.0).contains(&at)).then_some(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat() -> CutSheet {
        // z = 0.5 over 0..3 x 0..3, in four quads.
        let vertices = (0..9).map(|n| [1.5 * (n % 3) as f32, 1.5 * (n / 3) as f32, 0.5]).collect();
        let quads = vec![[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]];
        CutSheet { vertices, quads, times: vec![1.0; 4] }
    }

    #[test]
    fn segments_through_the_sheet_and_its_seams_are_parted() {
        let knife = Knife::new(&flat(), &Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap());
        let up = |x: f64, y: f64| {
            let cell = [x.floor() as i32, y.floor() as i32, 0];
            knife.parts(cell, Vector3::new(x, y, 0.0), Vector3::new(x, y, 1.0))
        };
        for (x, y) in [(0.2, 0.3), (1.5, 1.5), (1.5, 0.4), (0.75, 0.75), (2.9, 2.9)] {
            assert!(up(x, y), "({x}, {y})");
        }
        assert!(!up(3.2, 1.0), "beside the sheet");
        assert!(!knife.parts([1, 1, 0], Vector3::new(1.0, 1.0, 0.6), Vector3::new(1.5, 1.5, 1.0)), "above it");
    }
}
