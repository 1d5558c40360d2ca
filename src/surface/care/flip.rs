//! Edges that turn within the two triangles at them, to open the smallest angle.

use super::collapse::Worker;
use super::origin::{Homes, samples};
use super::shape;
use super::volumes::behind;
use crate::geometry::Vector3;

/// Passes over all edges; each finds less to do, and the last few next to nothing.
const PASSES: usize = 8;

/// The smallest angle must open by more than this, as a difference of cosines: rounding turns nothing back and forth.
const GAIN: f64 = 1e-3;

/// The two triangles must be this flat, as the cosine between their normals (25 degrees) ...
const FLAT: f64 = 0.906;

/// ... or the surface move by no more than this share of the spacing.
const DEPTH: f64 = 0.02;

impl Worker<'_> {
    /// Turns edges as long as that opens smallest angles.
    pub(super) fn flip(&mut self, spacing: f64) {
        for _ in 0..PASSES {
            let mut turned = 0;
            for half in 0..self.halves.len() {
                let first = self.halves.lives(half) && half < self.halves.twin(half);
                if first && self.may_turn(half) && self.halves.may_flip(half) {
                    turned += usize::from(self.turn(half, spacing));
                }
            }
            if turned == 0 {
                return;
            }
        }
    }

    fn turn(&mut self, half: u32, spacing: f64) -> bool {
        let other = self.halves.twin(half);
        let triangles = [half / 3, other / 3];
        let place = |vertex: u32| self.places[vertex as usize];
        let [a, b] = [self.halves.from(half), self.halves.to(half)].map(place);
        let [c, d] = [self.halves.apex(half), self.halves.apex(other)].map(place);
        let (old, new) = ([[a, b, c], [b, a, d]], [[d, c, a], [c, d, b]]);
        let sharpest = |pair: [[Vector3; 3]; 2]| shape::sharpest(pair[0]).max(shape::sharpest(pair[1]));
        // False for NaN too, from a triangle without area.
        let opens = sharpest(new) < sharpest(old) - GAIN;
        let worst = shape::quality(old[0]).min(shape::quality(old[1]));
        if !opens || !new.iter().all(|&corners| shape::fair(shape::quality(corners), worst)) {
            return false;
        }
        let (from, to) = (old.map(shape::normal), new.map(shape::normal));
        let sum = from[0] + from[1];
        if !to.iter().all(|&normal| shape::same_way(sum, normal)) {
            return false;
        }
        let cosine = from[0].dot(&from[1]) / (from[0].norm() * from[1].norm());
        let across = (b - a).cross(&(d - c));
        let depth = if across.norm() > 0.0 { (c - a).dot(&across).abs() / across.norm() } else { 0.0 };
        if cosine < FLAT && depth > DEPTH * spacing {
            return false;
        }
        let growth = behind(new, a) - behind(old, a);
        let vertex = self.halves.from(half);
        if !self.volumes.allow(vertex, growth) {
            return false;
        }
        let homes = match &self.bound {
            Some(bound) => {
                let samples: Vec<Vector3> = new.into_iter().flat_map(samples).map(|(_, sample)| sample).collect();
                match bound.allows(&self.origin, &triangles, &new, &samples) {
                    Some(homes) => homes,
                    None => return false,
                }
            }
            None => Homes::new(),
        };
        self.volumes.grow(vertex, growth);
        self.halves.flip(half);
        if let Some(bound) = &mut self.bound {
            bound.replace(&triangles, &triangles, &homes);
        }
        true
    }
}
