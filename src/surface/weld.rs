//! Joins the vertices of triangle soups, such as STL files, back into an indexed mesh.

use super::mesh::TriangleMesh;
use crate::geometry::CellMap;

/// Joins vertices that lie within `tolerance` [mm] of each other; with 0 only those that are equal.
///
/// A vertex joins the nearest earlier one that stands for others, so the answer depends on the order of the triangles
/// but not on anything else. Triangles that collapse are kept, for [`super::check`] to count.
pub fn weld(soup: &[[[f32; 3]; 3]], tolerance: f32) -> TriangleMesh {
    let mut welder = Welder { tolerance, cells: CellMap::default(), next: Vec::new(), positions: Vec::new() };
    let triangles = soup.iter().map(|triangle| triangle.map(|place| welder.vertex(place))).collect();
    TriangleMesh { positions: welder.positions, triangles, ..TriangleMesh::default() }
}

/// The triangles of a mesh as a soup: what is left of it in an STL file.
///
/// # Panics
/// If a triangle names a vertex the mesh does not have.
pub fn soup(mesh: &TriangleMesh) -> Vec<[[f32; 3]; 3]> {
    mesh.triangles.iter().map(|triangle| triangle.map(|vertex| mesh.positions[vertex as usize])).collect()
}

/// End of the list of a cell.
const END: u32 = u32::MAX;

struct Welder {
    tolerance: f32,
    /// First vertex of each cell of a grid as wide as the tolerance (of each place, when the tolerance is 0).
    cells: CellMap<[i64; 3], u32>,
    /// Next vertex in the same cell.
    next: Vec<u32>,
    positions: Vec<[f32; 3]>,
}

impl Welder {
    fn vertex(&mut self, place: [f32; 3]) -> u32 {
        if !(self.tolerance > 0.0 && place.iter().all(|c| c.is_finite())) {
            // Adding 0 turns -0 into 0, which is the same place.
            let key = place.map(|c| i64::from((c + 0.0).to_bits()));
            return match self.cells.get(&key) {
                Some(&found) => found,
                None => self.add(key, place),
            };
        }
        let cell = place.map(|c| (f64::from(c) / f64::from(self.tolerance)).floor() as i64);
        let mut best = (f64::from(self.tolerance).powi(2), END);
        for step in 0..27 {
            let around = [0, 1, 2].map(|axis| cell[axis].saturating_add(step / [1, 3, 9][axis] % 3 - 1));
            let mut at = self.cells.get(&around).copied().unwrap_or(END);
            while at != END {
                let there = self.positions[at as usize];
                let squared = (0..3).map(|axis| (f64::from(there[axis]) - f64::from(place[axis])).powi(2)).sum::<f64>();
                if (squared, at) <= best {
                    best = (squared, at);
                }
                at = self.next[at as usize];
            }
        }
        if best.1 == END { self.add(cell, place) } else { best.1 }
    }

    fn add(&mut self, cell: [i64; 3], place: [f32; 3]) -> u32 {
        let vertex = self.positions.len() as u32;
        self.positions.push(place);
        self.next.push(self.cells.insert(cell, vertex).unwrap_or(END));
        vertex
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_places_join_and_near_ones_only_within_the_tolerance() {
        let soup = [
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[1.0, 0.0, 0.0], [-0.0, 0.0, -0.0], [0.0, 1.0, 1e-3]],
        ];
        let exact = weld(&soup, 0.0);
        assert_eq!(exact.triangles, [[0, 1, 2], [1, 0, 3]]);
        assert_eq!(weld(&soup, 2e-3).triangles, [[0, 1, 2], [1, 0, 2]]);
        assert_eq!(weld(&soup, 5e-4).triangles, exact.triangles);
        assert_eq!(weld(&super::soup(&exact), 0.0).positions, exact.positions);
    }

    #[test]
    fn places_across_a_cell_border_join() {
        let soup = [[[0.9999, 0.0, 0.0], [1.0001, 0.0, 0.0], [5.0, 0.0, 0.0]]];
        assert_eq!(weld(&soup, 1e-3).triangles, [[0, 0, 1]]);
    }
}
