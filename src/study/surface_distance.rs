//! How far two surfaces lie apart.

use rayon::prelude::*;

use crate::dynamics::effects::contact::closest_triangle::ClosestTriangle;
use crate::geometry::Vector3;
use crate::surface::mesh::TriangleMesh;

/// Distance of two surfaces, the larger of both ways \[mm\].
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SurfaceDistance {
    /// Hausdorff distance: no point of either is farther from the other.
    pub hausdorff_mm: f64,
    /// Mean over the area.
    pub mean_mm: f64,
}

/// A surface to be compared with others.
pub struct Measured {
    /// Corners and middles of the triangles, and how much area each stands for \[mm, mm2\].
    samples: Vec<(Vector3, f64)>,
    tree: ClosestTriangle,
}

impl Measured {
    /// The surfaces of all meshes together; `None` when they have no triangle with an area.
    pub fn new<'a>(meshes: impl IntoIterator<Item = &'a TriangleMesh>) -> Option<Self> {
        let (mut places, mut triangles) = (Vec::new(), Vec::new());
        for mesh in meshes {
            let first = places.len() as u32;
            places.extend(mesh.positions.iter().map(|p| Vector3::from(p.map(f64::from))));
            let area = |t: &[u32; 3]| area(&t.map(|v| places[v as usize]));
            triangles
                .extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)).filter(|t| area(t) > f64::MIN_POSITIVE));
        }
        if triangles.is_empty() {
            return None;
        }
        let tree = ClosestTriangle::new(&places, &triangles);
        let mut corners = vec![0.0; places.len()];
        let mut samples = Vec::with_capacity(triangles.len() + places.len());
        for t in &triangles {
            let corner = t.map(|v| places[v as usize]);
            let area = area(&corner);
            // Exact for what is linear over a triangle, and 9/12 of the weight for what is quadratic.
            samples.push((corner.iter().sum::<Vector3>() / 3.0, 0.75 * area));
            t.iter().for_each(|&v| corners[v as usize] += area / 12.0);
        }
        samples.extend(places.into_iter().zip(corners).filter(|(_, weight)| *weight > 0.0));
        Some(Self { samples, tree })
    }

    /// Its distance from another surface.
    ///
    /// # Accuracy
    /// Distances are taken at corners and middles of triangles: what lies between two of them is seen to a fraction of a
    /// triangle's edge, so the Hausdorff distance is a lower bound that close.
    pub fn distance(&self, other: &Self) -> SurfaceDistance {
        let [there, back] = [one_way(self, other), one_way(other, self)];
        SurfaceDistance { hausdorff_mm: there[0].max(back[0]), mean_mm: there[1].max(back[1]) }
    }
}

/// Largest and mean distance of the points of one surface from the other.
fn one_way(from: &Measured, to: &Measured) -> [f64; 2] {
    let distance = |(place, _): &(Vector3, f64)| to.tree.signed_distance(*place, f64::INFINITY).abs();
    let distances: Vec<f64> = from.samples.par_iter().map(distance).collect();
    let weight: f64 = from.samples.iter().map(|sample| sample.1).sum();
    let sum: f64 = distances.iter().zip(&from.samples).map(|(distance, sample)| distance * sample.1).sum();
    [distances.into_iter().fold(0.0, f64::max), sum / weight]
}

fn area([a, b, c]: &[Vector3; 3]) -> f64 {
    0.5 * (b - a).cross(&(c - a)).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::check::check;

    /// A ball of triangles, by halving those of an octahedron.
    fn ball(radius: f64, halvings: u32) -> TriangleMesh {
        let axis = |n: usize, sign: f64| Vector3::from_fn(|i, _| if i == n { sign } else { 0.0 });
        let mut list = Vec::new();
        for (x, y, z) in (0..8).map(|n| (n & 1, n >> 1 & 1, n >> 2)) {
            let sign = |bit: i32| if bit == 0 { 1.0 } else { -1.0 };
            let mut corners = [axis(0, sign(x)), axis(1, sign(y)), axis(2, sign(z))];
            if (x + y + z) % 2 == 1 {
                corners.swap(1, 2);
            }
            list.push(corners);
        }
        for _ in 0..halvings {
            list = list
                .iter()
                .flat_map(|&[a, b, c]| {
                    let [ab, bc, ca] = [a + b, b + c, c + a].map(|p: Vector3| p.normalize());
                    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
                })
                .collect();
        }
        let soup: Vec<[[f32; 3]; 3]> =
            list.iter().map(|t| t.map(|p| [0, 1, 2].map(|i| (radius * p[i]) as f32))).collect();
        crate::surface::weld::weld(&soup, 1e-4)
    }

    #[test]
    fn a_ball_that_grows() {
        let (small, large) = (ball(10.0, 4), ball(11.0, 4));
        let distance = Measured::new([&small]).unwrap().distance(&Measured::new([&large]).unwrap());
        // Flat triangles lie inside the ball by up to the square of half an edge (0.05 radii) over two radii.
        assert!((distance.hausdorff_mm - 1.0).abs() < 0.02, "{distance:?}");
        assert!((distance.mean_mm - 1.0).abs() < 0.02, "{distance:?}");
        let ratio = check(&large).volume_mm3 / check(&small).volume_mm3;
        assert!((ratio - 1.1_f64.powi(3)).abs() < 1e-5, "{ratio}");
        let same = Measured::new([&small]).unwrap();
        assert!(same.distance(&Measured::new([&small]).unwrap()).hausdorff_mm < 1e-6);
    }

    #[test]
    fn both_ways_are_looked_at() {
        let (one, other) = (ball(5.0, 3), ball(5.0, 3));
        let far = TriangleMesh {
            positions: other.positions.iter().map(|p| [p[0] + 40.0, p[1], p[2]]).collect(),
            triangles: other.triangles.clone(),
            ..TriangleMesh::default()
        };
        let [alone, pair] = [Measured::new([&one]).unwrap(), Measured::new([&one, &far]).unwrap()];
        for distance in [alone.distance(&pair), pair.distance(&alone)] {
            assert!((distance.hausdorff_mm - 40.0).abs() < 0.1, "{distance:?}");
        }
        assert!(Measured::new([&TriangleMesh::default()]).is_none());
    }
}
