//! Keeps new places clear of all other vertices, so that importers which weld by place join nothing.

use super::halves::NONE;
use crate::geometry::{CellMap, Vector3};

/// Vertices by the cell of a grid they lie in, two clearances wide.
#[derive(Debug)]
pub(super) struct Clearance {
    clearance: f64,
    first: CellMap<[i64; 3], u32>,
    next: Vec<u32>,
}

impl Clearance {
    pub(super) fn new(clearance: f64, places: &[Vector3], used: impl Fn(u32) -> bool) -> Self {
        let mut grid = Self { clearance, first: CellMap::default(), next: vec![NONE; places.len()] };
        grid.first.reserve(places.len());
        for vertex in (0..places.len() as u32).filter(|&vertex| used(vertex)) {
            grid.insert(vertex, places[vertex as usize]);
        }
        grid
    }

    fn cell(&self, place: Vector3) -> [i64; 3] {
        [0, 1, 2].map(|axis| (place[axis] / (2.0 * self.clearance)).floor() as i64)
    }

    fn insert(&mut self, vertex: u32, place: Vector3) {
        let cell = self.cell(place);
        self.next[vertex as usize] = self.first.insert(cell, vertex).unwrap_or(NONE);
    }

    pub(super) fn remove(&mut self, vertex: u32, place: Vector3) {
        let cell = self.cell(place);
        let after = self.next[vertex as usize];
        let Some(&first) = self.first.get(&cell) else { return };
        if first == vertex {
            if after == NONE {
                self.first.remove(&cell)
            } else {
                self.first.insert(cell, after)
            };
            return;
        }
        let mut at = first;
        while at != NONE {
            let following = self.next[at as usize];
            if following == vertex {
                self.next[at as usize] = after;
                return;
            }
            at = following;
        }
    }

    pub(super) fn shift(&mut self, vertex: u32, from: Vector3, to: Vector3) {
        self.remove(vertex, from);
        self.insert(vertex, to);
    }

    /// Whether no vertex but the two given lies within the clearance of a place.
    pub(super) fn is_clear(&self, place: Vector3, places: &[Vector3], but: [u32; 2]) -> bool {
        // The cells of the corners of a box around the place: those are all it can reach.
        let [low, high] = [-self.clearance, self.clearance].map(|by| self.cell(place.add_scalar(by)));
        (0..8_usize).all(|corner| {
            let upper = [corner & 1, corner >> 1 & 1, corner >> 2];
            if (0..3).any(|axis| upper[axis] == 1 && low[axis] == high[axis]) {
                return true;
            }
            let cell = [0, 1, 2].map(|axis| if upper[axis] == 1 { high[axis] } else { low[axis] });
            let mut at = self.first.get(&cell).copied().unwrap_or(NONE);
            while at != NONE {
                let near = (places[at as usize] - place).norm_squared() < self.clearance * self.clearance;
                if near && !but.contains(&at) {
                    return false;
                }
                at = self.next[at as usize];
            }
            true
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_vertices_are_seen_across_cells_until_they_are_gone() {
        let places = [[0.0, 0.0, 0.0], [1.999, 0.0, 0.0], [0.1, 0.1, 0.1], [9.0, 9.0, 9.0]].map(Vector3::from);
        let mut grid = Clearance::new(1.0, &places, |vertex| vertex != 3);
        let at = Vector3::new(2.5, 0.0, 0.0);
        assert!(!grid.is_clear(at, &places, [NONE; 2]) && grid.is_clear(at, &places, [1, NONE]));
        assert!(!grid.is_clear(Vector3::repeat(-0.2), &places, [0, 1]));
        assert!(grid.is_clear(Vector3::repeat(-0.2), &places, [0, 2]));
        assert!(grid.is_clear(places[3], &places, [NONE; 2]));
        grid.remove(0, places[0]);
        grid.remove(2, places[2]);
        assert!(grid.is_clear(Vector3::repeat(-0.2), &places, [NONE; 2]));
        assert!(!grid.is_clear(at, &places, [NONE; 2]));
    }
}
