//! What leaves the program: mesh files written and read back, and slices.

mod animation;
mod broken;
mod meshes;
mod slices;

use yawara::surface::mesh::{Finish, OrganMesh, TriangleMesh};

/// A closed, outward, lumpy ball without any symmetry, with every attribute: `rings` x `2 rings` facets of latitude and longitude.
pub(crate) fn blob(name: &str, center: [f32; 3], rings: u32) -> OrganMesh {
    let columns = 2 * rings;
    let mut mesh = TriangleMesh::default();
    let mut vertex = |latitude: f32, longitude: f32| {
        let up = latitude.cos();
        let (front, right) = (latitude.sin() * longitude.sin(), latitude.sin() * longitude.cos());
        let radius = 30.0 + 6.0 * right + 4.0 * (3.0 * longitude).sin() * latitude.sin() - 3.0 * up;
        mesh.positions.push([center[0] + radius * right, center[1] + radius * front, center[2] + radius * up]);
        // Not the true normals: any unit vector shows whether it arrives.
        mesh.normals.push([right, front, up]);
        mesh.labels.push(5 + (latitude * 3.0) as u16);
        mesh.displacements.push([0.1 * longitude, -0.2 * latitude, 0.25]);
        mesh.hu.push(40.0 + 20.0 * up);
        mesh.strains.push(0.05 * latitude);
        mesh.speeds.push(3.0 * longitude);
        mesh.colors.push([0.5 + 0.5 * right, 0.001 + 0.3 * latitude, 0.5 - 0.5 * up]);
    };
    let pi = std::f32::consts::PI;
    vertex(0.0, 0.0);
    for ring in 1..rings {
        for column in 0..columns {
            vertex(pi * ring as f32 / rings as f32, 2.0 * pi * column as f32 / columns as f32);
        }
    }
    vertex(pi, 0.0);
    let last = (rings - 1) * columns + 1;
    let at = |ring: u32, column: u32| 1 + (ring - 1) * columns + column % columns;
    for column in 0..columns {
        mesh.triangles.push([0, at(1, column), at(1, column + 1)]);
        for ring in 1..rings - 1 {
            let (a, b) = (at(ring, column), at(ring, column + 1));
            let (c, d) = (at(ring + 1, column), at(ring + 1, column + 1));
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
        mesh.triangles.push([at(rings - 1, column), last, at(rings - 1, column + 1)]);
    }
    OrganMesh { name: name.into(), color: [0.6, 0.1, 0.05], finish: Finish::Wet, mesh }
}

/// Enclosed volume in the cubed unit of the positions; positive when triangles face outward in a right-handed space.
pub(crate) fn signed_volume(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> f64 {
    let corner = |vertex: u32| nalgebra::Vector3::from(positions[vertex as usize].map(f64::from));
    triangles.iter().map(|t| corner(t[0]).cross(&corner(t[1])).dot(&corner(t[2])) / 6.0).sum()
}

/// Names in a folder, sorted.
pub(crate) fn entries(folder: &std::path::Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_test_blob_is_closed_and_faces_outward() {
    let organ = blob("liver", [10.0, -20.0, 700.0], 12);
    let mut edges = std::collections::HashMap::new();
    for t in &organ.mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *edges.entry((a, b)).or_insert(0) += 1;
        }
    }
    assert!(edges.iter().all(|(&(a, b), &count)| count == 1 && edges.get(&(b, a)) == Some(&1)));
    let volume = signed_volume(&organ.mesh.positions, &organ.mesh.triangles);
    assert!((8e4..1.5e5).contains(&volume), "{volume}");
}
