//! The nearest point of a triangle mesh, and on which side of it a place lies.
//!
//! Boxes around triangles are searched from the root, nearer ones first, and left out when they are farther than what is
//! known. The side is that of the pseudonormal of the nearest point: of the face, of the two faces of an edge, or of all faces of
//! a vertex weighted by their angles, which is right for every closed mesh (Baerentzen and Aanaes, "Signed distance
//! computation using the angle weighted pseudonormal", 2005).

use std::collections::HashMap;

use crate::geometry::Vector3;

/// Triangles of a leaf.
const LEAF: usize = 4;

/// A triangle with what tells its two sides apart.
struct Triangle {
    corner: [Vector3; 3],
    face: Vector3,
    /// Of the edges from corner 0, 1 and 2 to the next.
    edge: [Vector3; 3],
    vertex: [Vector3; 3],
}

/// A box around the triangles of a range.
struct Node {
    min: Vector3,
    max: Vector3,
    /// Of the triangles.
    range: std::ops::Range<usize>,
    /// The second of its two halves; the first comes right after it. `None` for a leaf.
    second: Option<usize>,
}

/// A closed triangle mesh, to be asked for distances.
pub(crate) struct ClosestTriangle {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
}

impl ClosestTriangle {
    /// - `triangles`: at least one, each with an area, counter-clockwise seen from outside.
    pub(crate) fn new(positions: &[Vector3], triangles: &[[u32; 3]]) -> Self {
        let corner = |t: &[u32; 3]| t.map(|vertex| positions[vertex as usize]);
        let face = |t: &[u32; 3]| {
            let [a, b, c] = corner(t);
            (b - a).cross(&(c - a)).normalize()
        };
        let mut of_edge = HashMap::<[u32; 2], Vector3>::new();
        let mut of_vertex = vec![Vector3::zeros(); positions.len()];
        let key = |a: u32, b: u32| [a.min(b), a.max(b)];
        for t in triangles {
            let (normal, corner) = (face(t), corner(t));
            for i in 0..3 {
                let (next, last) = ((i + 1) % 3, (i + 2) % 3);
                *of_edge.entry(key(t[i], t[next])).or_default() += normal;
                let angle = (corner[next] - corner[i]).angle(&(corner[last] - corner[i]));
                of_vertex[t[i] as usize] += normal * angle;
            }
        }
        let mut list: Vec<Triangle> = triangles
            .iter()
            .map(|t| Triangle {
                corner: corner(t),
                face: face(t),
                edge: [0, 1, 2].map(|i| of_edge[&key(t[i], t[(i + 1) % 3])]),
                vertex: t.map(|vertex| of_vertex[vertex as usize]),
            })
            .collect();
        let mut nodes = Vec::with_capacity(list.len());
        let all = 0..list.len();
        build(&mut list, &mut nodes, all);
        Self { triangles: list, nodes }
    }

    /// Signed distance of a place, negative inside.
    ///
    /// - `at_most`: the distance is known not to be larger.
    pub(crate) fn signed_distance(&self, place: Vector3, at_most: f64) -> f64 {
        // A little more, so that rounding leaves something to find.
        let mut best = (at_most * 1.001).powi(2) + f64::MIN_POSITIVE;
        let mut side = 1.0;
        let mut waiting = vec![0];
        while let Some(number) = waiting.pop() {
            let node = &self.nodes[number];
            if node.distance_squared(place) >= best {
                continue;
            }
            match node.second {
                Some(second) => {
                    let first = number + 1;
                    let [near, far] =
                        if self.nodes[first].distance_squared(place) <= self.nodes[second].distance_squared(place) {
                            [first, second]
                        } else {
                            [second, first]
                        };
                    waiting.extend([far, near]);
                }
                None => {
                    for triangle in &self.triangles[node.range.clone()] {
                        let (nearest, normal) = triangle.nearest(place);
                        let squared = (place - nearest).norm_squared();
                        if squared < best {
                            best = squared;
                            side = if (place - nearest).dot(&normal) < 0.0 { -1.0 } else { 1.0 };
                        }
                    }
                }
            }
        }
        side * best.sqrt()
    }
}

/// Builds the node of a range of triangles and all below it.
fn build(triangles: &mut [Triangle], nodes: &mut Vec<Node>, range: std::ops::Range<usize>) {
    let own = &mut triangles[range.clone()];
    let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let corners = own.iter().flat_map(|triangle| triangle.corner);
    let (min, max) = corners.fold(start, |(min, max), corner| (min.inf(&corner), max.sup(&corner)));
    let number = nodes.len();
    nodes.push(Node { min, max, range: range.clone(), second: None });
    if own.len() <= LEAF {
        return;
    }
    let axis = (max - min).imax();
    let middle = own.len() / 2;
    let center = |triangle: &Triangle| triangle.corner.iter().map(|corner| corner[axis]).sum::<f64>();
    own.select_nth_unstable_by(middle, |a, b| center(a).total_cmp(&center(b)));
    build(triangles, nodes, range.start..range.start + middle);
    nodes[number].second = Some(nodes.len());
    build(triangles, nodes, range.start + middle..range.end);
}

impl Node {
    fn distance_squared(&self, place: Vector3) -> f64 {
        (self.min - place).sup(&(place - self.max)).sup(&Vector3::zeros()).norm_squared()
    }
}

impl Triangle {
    /// The nearest point, and the pseudonormal there. The regions of a triangle as in Ericson, "Real-Time Collision
    /// Detection", 2005, section 5.1.5.
    fn nearest(&self, place: Vector3) -> (Vector3, Vector3) {
        let [a, b, c] = self.corner;
        let (ab, ac) = (b - a, c - a);
        let (from_a, from_b, from_c) = (place - a, place - b, place - c);
        let (d1, d2) = (ab.dot(&from_a), ac.dot(&from_a));
        if d1 <= 0.0 && d2 <= 0.0 {
            return (a, self.vertex[0]);
        }
        let (d3, d4) = (ab.dot(&from_b), ac.dot(&from_b));
        if d3 >= 0.0 && d4 <= d3 {
            return (b, self.vertex[1]);
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return (a + ab * (d1 / (d1 - d3)), self.edge[0]);
        }
        let (d5, d6) = (ab.dot(&from_c), ac.dot(&from_c));
        if d6 >= 0.0 && d5 <= d6 {
            return (c, self.vertex[2]);
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return (a + ac * (d2 / (d2 - d6)), self.edge[2]);
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            let share = (d4 - d3) / ((d4 - d3) + (d5 - d6));
            return (b + (c - b) * share, self.edge[1]);
        }
        let sum = va + vb + vc;
        (a + ab * (vb / sum) + ac * (vc / sum), self.face)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splitmix::{GOLDEN, mix, unit};

    /// The nearest point by trying every place of a fine grid on every triangle.
    #[test]
    fn the_nearest_point_of_a_triangle_is_the_nearest_of_many() {
        let number = |n: u64| 2.0 * unit(mix(GOLDEN.wrapping_mul(n + 1))) - 1.0;
        let vector = |n: u64| Vector3::from_fn(|axis, _| number(3 * n + axis as u64));
        for trial in 0..200 {
            let corner = [0, 1, 2].map(|i| vector(4 * trial + i));
            let none = [Vector3::zeros(); 3];
            let triangle = Triangle { corner, face: Vector3::zeros(), edge: none, vertex: none };
            let place = vector(4 * trial + 3) * 2.0;
            let mut least = f64::INFINITY;
            for i in 0..=100 {
                for j in 0..=100 - i {
                    let [u, v] = [i, j].map(|n| f64::from(n) / 100.0);
                    let point = corner[0] + (corner[1] - corner[0]) * u + (corner[2] - corner[0]) * v;
                    least = least.min((place - point).norm());
                }
            }
            let found = (place - triangle.nearest(place).0).norm();
            assert!(found <= least + 1e-12 && found > least - 0.03, "{trial}: {found} {least}");
        }
    }
}
