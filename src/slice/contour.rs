//! Where a plane cuts a triangle mesh.

use super::Plane;
use crate::geometry::Point3;
use crate::surface::mesh::TriangleMesh;

/// The segments in which a plane cuts a mesh, RAS+ [mm], in the order of its triangles. Seen by the viewer, the inside of a
/// mesh lies always on the same side of its segments.
///
/// Vertices that lie exactly in the plane count as just above it. So each triangle gives one segment or none, and a closed mesh
/// gives closed lines, whatever touches the plane; segments may have no length. Both triangles at an edge compute its
/// crossing from the same numbers in the same order, so that segments meet exactly.
pub fn contour(mesh: &TriangleMesh, plane: &Plane) -> Vec<[Point3; 2]> {
    let place = |vertex: u32| Point3::from(mesh.positions[vertex as usize].map(f64::from));
    let height = |vertex: u32| plane.height(place(vertex));
    let crossing = |a: u32, b: u32| {
        let (low, high) = (a.min(b), a.max(b));
        let (below, above) = (height(low), height(high));
        plane.onto(place(low) + (place(high) - place(low)) * (below / (below - above)))
    };
    let segment = |&[a, b, c]: &[u32; 3]| {
        let above = [a, b, c].map(|vertex| height(vertex) >= 0.0);
        // The vertex alone on its side, then the other two in order.
        let ([alone, next, last], is_above) = match above {
            [p, q, r] if p == q && q == r => return None,
            [p, q, r] if q == r && p != q => ([a, b, c], p),
            [p, q, r] if p == r => ([b, c, a], q),
            [_, _, r] => ([c, a, b], r),
        };
        let ends = [crossing(alone, next), crossing(alone, last)];
        Some(if is_above { ends } else { [ends[1], ends[0]] })
    };
    mesh.triangles.iter().filter_map(segment).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slice::SliceAxis;
    use std::collections::HashMap;

    /// An octahedron with vertices in the planes at 0.
    fn octahedron() -> TriangleMesh {
        let positions = vec![
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
        ];
        let triangles = vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        TriangleMesh { positions, triangles, ..TriangleMesh::default() }
    }

    fn ends(segments: &[[Point3; 2]]) -> HashMap<[u64; 3], usize> {
        let mut ends = HashMap::new();
        for end in segments.iter().flatten() {
            let key: [f64; 3] = (*end).into();
            *ends.entry(key.map(|x| (x + 0.0).to_bits())).or_insert(0) += 1;
        }
        ends
    }

    #[test]
    fn lines_are_closed_even_through_vertices_and_edges() {
        for axis in [SliceAxis::X, SliceAxis::Y, SliceAxis::Z] {
            for at in [-0.5, 0.0, 0.3, 0.999] {
                let segments = contour(&octahedron(), &Plane::across(axis, at));
                assert!(!segments.is_empty());
                assert!(ends(&segments).values().all(|count| count % 2 == 0), "{axis} {at}");
                assert!(segments.iter().flatten().all(|end| end[axis.index()] == at));
            }
        }
        // The equator: four edges of length sqrt 2.
        let length: f64 =
            contour(&octahedron(), &Plane::across(SliceAxis::Z, 0.0)).iter().map(|[a, b]| (a - b).norm()).sum();
        assert!((length - 4.0 * 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn planes_that_touch_or_miss_give_no_length() {
        let length = |at| {
            contour(&octahedron(), &Plane::across(SliceAxis::Z, at)).iter().map(|[a, b]| (a - b).norm()).sum::<f64>()
        };
        assert_eq!([length(1.0), length(-1.0), length(1.1), length(-1.1)], [0.0; 4]);
    }
}
