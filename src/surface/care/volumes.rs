//! The volume of each part of the surface, and what changes so far owe it. All volumes here are six times themselves.

use super::halves::{Halves, NONE};
use super::shape;
use crate::geometry::Vector3;

/// No change may take the volume of a part further than this from what it was, as a share.
const TOLERANCE: f64 = 0.004;

/// Volumes by part, and debts by vertex.
#[derive(Debug)]
pub(super) struct Volumes {
    part: Vec<u32>,
    given: Vec<f64>,
    now: Vec<f64>,
    /// What changes around a vertex have lost: a later change there makes up for it.
    owed: Vec<f64>,
}

/// Volume between triangles and a point.
pub(super) fn behind(triangles: impl IntoIterator<Item = [Vector3; 3]>, point: Vector3) -> f64 {
    triangles.into_iter().map(|corners| shape::normal(corners).dot(&(corners[0] - point))).sum()
}

impl Volumes {
    pub(super) fn new(halves: &Halves, places: &[Vector3], middle: Vector3) -> Self {
        let mut part = vec![NONE; places.len()];
        let (mut parts, mut ahead) = (0, Vec::new());
        for start in 0..places.len() as u32 {
            if !halves.used(start) || part[start as usize] != NONE {
                continue;
            }
            part[start as usize] = parts;
            ahead.push(start);
            while let Some(vertex) = ahead.pop() {
                for half in halves.ring(vertex) {
                    let other = halves.to(half);
                    if part[other as usize] == NONE {
                        part[other as usize] = parts;
                        ahead.push(other);
                    }
                }
            }
            parts += 1;
        }
        let mut given = vec![0.0; parts as usize];
        for corners in (0..halves.len() / 3).map(|triangle| halves.corners(triangle)) {
            let triangle = corners.map(|vertex| places[vertex as usize]);
            given[part[corners[0] as usize] as usize] += behind([triangle], middle);
        }
        Self { part, now: given.clone(), given, owed: vec![0.0; places.len()] }
    }

    /// Whether the part of a vertex may grow by so much: not too far from what it was, or nearer to it.
    pub(super) fn allow(&self, vertex: u32, growth: f64) -> bool {
        let part = self.part[vertex as usize] as usize;
        let (given, now) = (self.given[part], self.now[part]);
        let off = (now + growth - given).abs();
        off <= TOLERANCE * given.abs() || off <= (now - given).abs()
    }

    /// Enters a growth, which is owed at a vertex from then on.
    pub(super) fn grow(&mut self, vertex: u32, growth: f64) {
        self.now[self.part[vertex as usize] as usize] += growth;
        self.owed[vertex as usize] -= growth;
    }

    /// Moves a debt from one vertex to another.
    pub(super) fn pass_on(&mut self, from: u32, to: u32) {
        let owed = std::mem::take(&mut self.owed[from as usize]);
        self.owed[to as usize] += owed;
    }

    pub(super) fn owed(&self, vertices: [u32; 2]) -> f64 {
        self.owed[vertices[0] as usize] + self.owed[vertices[1] as usize]
    }
}
