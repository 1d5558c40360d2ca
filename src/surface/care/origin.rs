//! The mesh as it was given, and how far the changed one may stray from it.
//!
//! Samples of the original (its vertices and the centres of its triangles) are each attached to a triangle of the changed mesh that they
//! are near. A change is allowed when all that are attached to the old triangles find a new one near enough, and when the
//! places of the new triangles that were not on the surface before are near enough to an original triangle. What lies
//! between the samples may stray further: the bound asked of them is a share ([`SHARE`]) of what the caller allows.

use super::RestMesh;
use super::halves::NONE;
use crate::geometry::Vector3;

/// Share of the allowed distance that samples may use.
const SHARE: f64 = 0.8;

/// Original places and triangles.
#[derive(Debug)]
pub(super) struct Origin<'a> {
    mesh: RestMesh<'a>,
    /// First of the triangles at each vertex.
    starts: Vec<u32>,
    at_vertex: Vec<u32>,
}

impl<'a> Origin<'a> {
    pub(super) fn new(mesh: RestMesh<'a>) -> Self {
        let mut starts = vec![0_u32; mesh.positions.len() + 1];
        for &vertex in mesh.triangles.as_flattened() {
            starts[vertex as usize + 1] += 1;
        }
        for vertex in 1..starts.len() {
            starts[vertex] += starts[vertex - 1];
        }
        let (mut next, mut at_vertex) = (starts.clone(), vec![0; 3 * mesh.triangles.len()]);
        for (triangle, corners) in (0_u32..).zip(mesh.triangles) {
            for &vertex in corners {
                at_vertex[next[vertex as usize] as usize] = triangle;
                next[vertex as usize] += 1;
            }
        }
        Self { mesh, starts, at_vertex }
    }

    pub(super) fn place(&self, vertex: u32) -> Vector3 {
        Vector3::from(self.mesh.positions[vertex as usize])
    }

    /// Place of a sample: the vertices come first, then the centres of the triangles.
    fn sample(&self, sample: u32) -> Vector3 {
        match (sample as usize).checked_sub(self.mesh.positions.len()) {
            Some(triangle) => self.mesh.triangles[triangle].iter().map(|&v| self.place(v)).sum::<Vector3>() / 3.0,
            None => self.place(sample),
        }
    }

    /// Squared distance to the original triangles round a sample: at the vertex it is, or at the nearest corner.
    fn squared_near_sample(&self, sample: u32, place: Vector3) -> f64 {
        let Some(triangle) = (sample as usize).checked_sub(self.mesh.positions.len()) else {
            return self.squared_near(sample, place);
        };
        let squared = |vertex: u32| (self.place(vertex) - place).norm_squared();
        let [a, b, c] = self.mesh.triangles[triangle];
        let nearest = [b, c].into_iter().fold(a, |best, v| if squared(v) < squared(best) { v } else { best });
        self.squared_near(nearest, place)
    }

    fn triangles_at(&self, vertex: u32) -> &[u32] {
        &self.at_vertex[self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize]
    }

    /// Squared distance to the original triangles at a vertex.
    fn squared_near(&self, vertex: u32, place: Vector3) -> f64 {
        let to = |&t: &u32| squared_to_triangle(place, self.mesh.triangles[t as usize].map(|v| self.place(v)));
        self.triangles_at(vertex).iter().map(to).fold(f64::INFINITY, f64::min)
    }

    /// The original vertex nearest to a place, downhill from `start` over edges between vertices of its sheet and organ: it never leaves the
    /// lip of a cut for the other one.
    pub(super) fn nearest(&self, start: u32, place: Vector3) -> u32 {
        let (sheet, organ) = (self.mesh.sheet(start), self.mesh.organ(start));
        let (mut best, mut squared) = (start, (self.place(start) - place).norm_squared());
        loop {
            let before = best;
            for &triangle in self.triangles_at(before) {
                for vertex in self.mesh.triangles[triangle as usize] {
                    let theirs = (self.place(vertex) - place).norm_squared();
                    let same = self.mesh.sheet(vertex) == sheet && self.mesh.organ(vertex) == organ;
                    if same && (theirs < squared || (theirs == squared && vertex < best)) {
                        (best, squared) = (vertex, theirs);
                    }
                }
            }
            if best == before {
                return best;
            }
        }
    }
}

/// Which samples of the original are attached to which triangle, as lists.
#[derive(Debug)]
pub(super) struct Bound {
    squared: f64,
    first: Vec<u32>,
    next: Vec<u32>,
}

/// New homes of samples: each with the number of a new triangle in the change.
pub(super) type Homes = Vec<(u32, usize)>;

impl Bound {
    /// Attaches every centre to its triangle and every vertex to one at it.
    pub(super) fn new(origin: &Origin<'_>, max_error_mm: f64) -> Self {
        let mut bound = Self {
            squared: (SHARE * max_error_mm).powi(2),
            first: vec![NONE; origin.mesh.triangles.len()],
            next: vec![NONE; origin.mesh.positions.len() + origin.mesh.triangles.len()],
        };
        for vertex in 0..origin.mesh.positions.len() as u32 {
            if let Some(&triangle) = origin.triangles_at(vertex).first() {
                bound.attach(vertex, triangle);
            }
        }
        let vertices = origin.mesh.positions.len() as u32;
        (0..origin.mesh.triangles.len() as u32).for_each(|triangle| bound.attach(vertices + triangle, triangle));
        bound
    }

    fn attach(&mut self, sample: u32, triangle: u32) {
        self.next[sample as usize] = std::mem::replace(&mut self.first[triangle as usize], sample);
    }

    fn attached(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        let some = |sample: u32| (sample != NONE).then_some(sample);
        std::iter::successors(some(self.first[triangle as usize]), move |&sample| some(self.next[sample as usize]))
    }

    /// Whether triangles may be replaced by others; where the attached samples go then. `samples` are the places of the new ones that
    /// were not on the surface before.
    pub(super) fn allows(
        &self,
        origin: &Origin<'_>,
        old: &[u32],
        new: &[[Vector3; 3]],
        samples: &[Vector3],
    ) -> Option<Homes> {
        let mut homes = Homes::new();
        for sample in old.iter().flat_map(|&triangle| self.attached(triangle)) {
            let place = origin.sample(sample);
            let mut best = (f64::INFINITY, 0);
            for (at, &corners) in new.iter().enumerate() {
                let squared = squared_to_triangle(place, corners);
                if squared < best.0 {
                    best = (squared, at);
                }
            }
            if best.0 > self.squared {
                return None;
            }
            homes.push((sample, best.1));
        }
        let near = |place: Vector3| {
            let nearest = homes.iter().map(|&(sample, _)| ((origin.sample(sample) - place).norm_squared(), sample));
            let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0));
            nearest.is_none_or(|(squared, sample)| {
                squared <= self.squared || origin.squared_near_sample(sample, place) <= self.squared
            })
        };
        samples.iter().copied().all(near).then_some(homes)
    }

    /// Carries out what [`Bound::allows`] found: `new` are the numbers of the new triangles.
    pub(super) fn replace(&mut self, old: &[u32], new: &[u32], homes: &Homes) {
        old.iter().for_each(|&triangle| self.first[triangle as usize] = NONE);
        for &(sample, at) in homes {
            self.attach(sample, new[at]);
        }
    }
}

/// Samples of a new triangle lie this many to a side: few of its sides are longer than so many spacings.
const PER_SIDE: usize = 4;

/// Places spread over a triangle, its corners among them, with their weights (which add up to [`PER_SIDE`]).
pub(super) fn samples([a, b, c]: [Vector3; 3]) -> impl Iterator<Item = ([usize; 3], Vector3)> {
    (0..=PER_SIDE).flat_map(move |i| {
        (0..=PER_SIDE - i).map(move |j| {
            let weights = [i, j, PER_SIDE - i - j];
            let [u, v, w] = weights.map(|weight| weight as f64 / PER_SIDE as f64);
            (weights, a * u + b * v + c * w)
        })
    })
}

/// Squared distance from a point to a triangle.
///
/// # Source
/// Ericson, Real-time collision detection, 2004, section 5.1.5: the region of the triangle the point lies over.
pub(super) fn squared_to_triangle(p: Vector3, [a, b, c]: [Vector3; 3]) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.norm_squared();
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.norm_squared();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - ab * (d1 / (d1 - d3))).norm_squared();
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.norm_squared();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - ac * (d2 / (d2 - d6))).norm_squared();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (bp - (c - b) * w).norm_squared();
    }
    let total = va + vb + vc;
    (ap - ab * (vb / total) - ac * (vc / total)).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_to_a_triangle_in_all_its_regions() {
        let triangle = [Vector3::zeros(), Vector3::new(2.0, 0.0, 0.0), Vector3::new(0.0, 2.0, 0.0)];
        for (point, squared) in [
            ([0.5, 0.5, 3.0], 9.0),
            ([-1.0, -1.0, 0.0], 2.0),
            ([1.0, -2.0, 0.0], 4.0),
            ([-3.0, 1.0, 0.0], 9.0),
            ([4.0, -1.0, 0.0], 5.0),
            ([-1.0, 4.0, 0.0], 5.0),
            ([2.0, 2.0, 1.0], 3.0),
        ] {
            assert!((squared_to_triangle(Vector3::from(point), triangle) - squared).abs() < 1e-12, "{point:?}");
        }
    }
}
