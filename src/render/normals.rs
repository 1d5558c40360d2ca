//! Normals for meshes that bring none, as STL does.

use crate::surface::mesh::TriangleMesh;

/// Triangles that meet at less than this are one smooth surface [degrees].
pub const CREASE_DEGREES: f32 = 40.0;

/// The same mesh with normals: smooth where triangles meet at less than `crease_degrees`, sharp at the other edges.
///
/// Around each vertex a triangle sums the area-weighted normals of those that turn from it by less than the angle. Vertices
/// on sharp edges are doubled, so a closed mesh stays closed by place, not by index. Vertices without area around them get
/// (0, 0, 0). Triangles that name missing vertices are left for the caller to find.
pub fn creased(mesh: &TriangleMesh, crease_degrees: f32) -> TriangleMesh {
    let vertices = mesh.positions.len();
    if mesh.triangles.iter().flatten().any(|&vertex| vertex as usize >= vertices) {
        return mesh.clone();
    }
    let least = crease_degrees.to_radians().cos();
    let faces: Vec<[f64; 3]> = mesh.triangles.iter().map(|triangle| area_normal(mesh, triangle)).collect();
    let lengths: Vec<f64> = faces.iter().map(|face| dot(*face, *face).sqrt()).collect();
    // Triangles around each vertex, in their order.
    let mut starts = vec![0_usize; vertices + 1];
    mesh.triangles.iter().flatten().for_each(|&vertex| starts[vertex as usize + 1] += 1);
    (0..vertices).for_each(|vertex| starts[vertex + 1] += starts[vertex]);
    let mut next = starts.clone();
    let mut around = vec![0_usize; 3 * mesh.triangles.len()];
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        for &vertex in corners {
            around[next[vertex as usize]] = triangle;
            next[vertex as usize] += 1;
        }
    }
    let mut result = TriangleMesh { triangles: mesh.triangles.clone(), ..TriangleMesh::default() };
    for vertex in 0..vertices {
        let ring = &around[starts[vertex]..starts[vertex + 1]];
        let first = result.positions.len();
        for &triangle in ring {
            let smooth = |other: &&usize| {
                let bound = f64::from(least) * lengths[triangle] * lengths[**other];
                **other == triangle || dot(faces[triangle], faces[**other]) > bound
            };
            let sum = ring
                .iter()
                .filter(smooth)
                .fold([0.0; 3], |sum, &other| [0, 1, 2].map(|axis| sum[axis] + faces[other][axis]));
            let length = dot(sum, sum).sqrt();
            let normal = if length > 0.0 { sum.map(|x| (x / length) as f32) } else { [0.0; 3] };
            // Equal sums are equal bit for bit: their terms come in the same order.
            let known = (first..result.positions.len()).find(|&at| result.normals[at] == normal);
            let at = known.unwrap_or_else(|| {
                result.positions.push(mesh.positions[vertex]);
                result.normals.push(normal);
                if let Some(&color) = mesh.colors.get(vertex) {
                    result.colors.push(color);
                }
                result.positions.len() - 1
            });
            for corner in 0..3 {
                if mesh.triangles[triangle][corner] as usize == vertex {
                    result.triangles[triangle][corner] = at as u32;
                }
            }
        }
    }
    result
}

/// Normal of a triangle, twice its area long. In f64: places far from the origin are large.
fn area_normal(mesh: &TriangleMesh, triangle: &[u32; 3]) -> [f64; 3] {
    let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize].map(f64::from));
    let (u, v) = ([0, 1, 2].map(|axis| b[axis] - a[axis]), [0, 1, 2].map(|axis| c[axis] - a[axis]));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A roof of two faces that meet at (0, y, 0), each going down by `slope`.
    fn roof(slope: f32) -> TriangleMesh {
        let positions = vec![
            [0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, 0.0, -slope],
            [1.0, 1.0, -slope],
            [-1.0, 0.0, -slope],
            [-1.0, 1.0, -slope],
        ];
        let triangles = vec![[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]];
        TriangleMesh { positions, triangles, ..TriangleMesh::default() }
    }

    #[test]
    fn gentle_edges_are_smooth_and_sharp_ones_are_not() {
        let smooth = creased(&roof(0.2), CREASE_DEGREES);
        assert_eq!(smooth.positions.len(), 6);
        assert_eq!(smooth.normals[smooth.triangles[0][0] as usize], [0.0, 0.0, 1.0]);
        let sharp = creased(&roof(1.0), CREASE_DEGREES);
        assert_eq!(sharp.positions.len(), 8, "both ends of the ridge are doubled");
        let half = 0.5_f32.sqrt();
        for (triangle, x) in [(0, half), (1, half), (2, -half), (3, -half)] {
            for corner in sharp.triangles[triangle] {
                let normal = sharp.normals[corner as usize];
                assert!((normal[0] - x).abs() < 1e-6 && (normal[2] - half).abs() < 1e-6, "{normal:?}");
            }
        }
    }
}
