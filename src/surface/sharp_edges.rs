//! Two vertices, each with a normal of its own, where one has to serve both sides of a sharp edge.
//!
//! A surface keeps one vertex on the rim of a cut, so that it stays closed by index, and the vertex has the normal of the skin. A
//! viewer then turns the light over the first row of triangles behind the rim, which shows as teeth. With a second vertex at the same
//! place the edge is crisp; the mesh is closed by place, no longer by index.

use rayon::prelude::*;

use super::mesh::TriangleMesh;
use super::normals::{cross, sub, unit};

/// A corner whose normal turns from its triangle by more than this (cosine; 47 degrees) lies on a sharp edge, where another surface
/// gave it that normal.
pub(crate) const SHARP_EDGE: f32 = 0.682;

/// The same on the faces of cuts, whose rims have the normal of the skin (5 degrees).
const FACE_EDGE: f32 = 0.996;

/// A vertex where more surfaces meet than this keeps the last ones together.
const MOST_SURFACES: usize = 4;

/// No vertex.
const NONE: u32 = u32::MAX;

/// Doubles the vertices on the rims of cuts and on other sharp edges. The new ones follow after the others, with the same attributes and
/// the normal of their triangles, weighted by area.
///
/// An edge is sharp where triangles turn from the normal of a vertex by more than 47 degrees, 5 on the rim of a cut. Triangles stay in
/// their order. A mesh without normals stays as it is.
///
/// - `on_cut`: whether each vertex lies on a face of a cut, its rim included; empty when there is none.
pub fn split_sharp_edges(mesh: &mut TriangleMesh, on_cut: &[bool]) {
    if mesh.normals.len() != mesh.positions.len() {
        return;
    }
    if on_cut.len() == mesh.positions.len() {
        split_rims(mesh, on_cut);
    }
    for _ in 0..MOST_SURFACES {
        if !split_once(mesh) {
            return;
        }
    }
}

/// Parts the faces of cuts from the skin.
fn split_rims(mesh: &mut TriangleMesh, on_cut: &[bool]) {
    let faces = mesh.triangles.iter().enumerate();
    let faces = faces.filter(|(_, triangle)| triangle.iter().all(|&vertex| on_cut[vertex as usize]));
    let faces: Vec<(usize, [f32; 3])> = faces.map(|(number, triangle)| (number, area_normal(mesh, triangle))).collect();
    let mut sums = vec![[0.0_f32; 3]; on_cut.len()];
    for &(number, face) in &faces {
        for vertex in mesh.triangles[number] {
            let sum = &mut sums[vertex as usize];
            *sum = [0, 1, 2].map(|axis| sum[axis] + face[axis]);
        }
    }
    let corners = faces
        .iter()
        .flat_map(|&(number, face)| [0, 1, 2].map(|corner| (number, corner, mesh.triangles[number][corner], face)));
    let turns = |&(_, _, vertex, face): &(usize, usize, u32, [f32; 3])| {
        let normal = mesh.normals[vertex as usize];
        let turns_from = |other: [f32; 3]| dot(normal, other) < FACE_EDGE * dot(other, other).sqrt();
        // Where the face itself bends, behind its rim, it is smooth.
        turns_from(face) && turns_from(sums[vertex as usize])
    };
    let corners = corners.filter(turns).map(|(number, corner, vertex, _)| (number, corner, vertex));
    let corners: Vec<_> = corners.collect();
    double_corners(mesh, &corners);
}

/// Parts one surface from each vertex that serves several; false when there is no such vertex.
fn split_once(mesh: &mut TriangleMesh) -> bool {
    let faces: Vec<[f32; 3]> = mesh.triangles.par_iter().map(|triangle| area_normal(mesh, triangle)).collect();
    let is_sharp = |normal: [f32; 3], face: [f32; 3]| dot(normal, face) < SHARP_EDGE * dot(face, face).sqrt();
    let mut agrees = vec![false; mesh.positions.len()];
    let mut sharp = Vec::new();
    for (number, (triangle, &face)) in mesh.triangles.iter().zip(&faces).enumerate() {
        for (corner, &vertex) in triangle.iter().enumerate() {
            if is_sharp(mesh.normals[vertex as usize], face) {
                sharp.push((number, corner, vertex));
            } else {
                agrees[vertex as usize] = true;
            }
        }
    }
    if sharp.is_empty() {
        return false;
    }
    // Of the triangles that turn away the largest decides which surface is parted: slivers look anywhere.
    let mut largest = vec![NONE; mesh.positions.len()];
    for &(number, _, vertex) in &sharp {
        let known = &mut largest[vertex as usize];
        let area = |number: usize| dot(faces[number], faces[number]);
        if *known == NONE || area(number) > area(*known as usize) {
            *known = number as u32;
        }
    }
    let mut parted = Vec::new();
    for (number, corner, vertex) in sharp {
        let at = vertex as usize;
        let seed = unit(faces[largest[at] as usize]);
        if !agrees[at] {
            // Nobody has this normal: the vertex itself takes that of the surface.
            mesh.normals[at] = seed;
        } else if !is_sharp(seed, faces[number]) {
            parted.push((number, corner, vertex));
        }
    }
    double_corners(mesh, &parted);
    true
}

/// Gives corners of triangles (triangle, corner, vertex) a second vertex; those at one vertex share it.
fn double_corners(mesh: &mut TriangleMesh, corners: &[(usize, usize, u32)]) {
    let mut doubles = vec![NONE; mesh.positions.len()];
    let mut sources = Vec::new();
    let mut sums: Vec<[f32; 3]> = Vec::new();
    let faces: Vec<[f32; 3]> = corners.iter().map(|&(number, ..)| area_normal(mesh, &mesh.triangles[number])).collect();
    for (&(number, corner, vertex), face) in corners.iter().zip(faces) {
        let double = &mut doubles[vertex as usize];
        if *double == NONE {
            *double = (mesh.positions.len() + sources.len()) as u32;
            sources.push(vertex);
            sums.push([0.0; 3]);
        }
        let sum = &mut sums[*double as usize - mesh.positions.len()];
        (0..3).for_each(|axis| sum[axis] += face[axis]);
        mesh.triangles[number][corner] = *double;
    }
    let TriangleMesh { positions, triangles: _, normals, labels, displacements, hu, strains, speeds, colors } = mesh;
    double(positions, &sources);
    double(labels, &sources);
    double(displacements, &sources);
    double(hu, &sources);
    double(strains, &sources);
    double(speeds, &sources);
    double(colors, &sources);
    normals.extend(sums.into_iter().map(unit));
}

/// Repeats the values of some vertices behind the others, where there are any.
fn double<T: Copy>(values: &mut Vec<T>, sources: &[u32]) {
    if !values.is_empty() {
        values.reserve_exact(sources.len());
        sources.iter().for_each(|&vertex| values.push(values[vertex as usize]));
    }
}

/// Normal with twice the area for its length; zero for a triangle without one.
fn area_normal(mesh: &TriangleMesh, triangle: &[u32; 3]) -> [f32; 3] {
    let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
    cross(sub(b, a), sub(c, a))
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::check::check;
    use crate::surface::weld::{soup, weld};

    /// A box by its corners, whose normals point away from its middle.
    fn cuboid(sides: [f32; 3]) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for corner in 0..8_usize {
            let away = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { 1.0_f32 } else { -1.0 });
            mesh.positions.push([0, 1, 2].map(|axis| 0.5 * sides[axis] * away[axis]));
            mesh.normals.push(away.map(|c| c / 3.0_f32.sqrt()));
            mesh.labels.push(corner as u16);
        }
        for [a, b, c, d] in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
        mesh
    }

    #[test]
    fn a_box_gets_the_normals_of_its_faces() {
        let mut mesh = cuboid([1.0, 2.0, 3.0]);
        assert!(check(&mesh).passes());
        let before = mesh.clone();
        split_sharp_edges(&mut mesh, &[]);
        assert_eq!(mesh.positions.len(), 24);
        for triangle in &mesh.triangles {
            let face = area_normal(&mesh, triangle);
            let length = dot(face, face).sqrt();
            for &vertex in triangle {
                assert!((dot(mesh.normals[vertex as usize], face) / length - 1.0).abs() < 1e-6);
            }
        }
        // Every corner is where it was, with what it had.
        for (now, then) in mesh.triangles.as_flattened().iter().zip(before.triangles.as_flattened()) {
            assert_eq!(mesh.positions[*now as usize], before.positions[*then as usize]);
            assert_eq!(mesh.labels[*now as usize], before.labels[*then as usize]);
        }
        assert_eq!(mesh.positions[..8], before.positions);
        assert!(check(&weld(&soup(&mesh), 0.0)).passes(), "closed by place");
    }

    #[test]
    fn what_is_smooth_or_without_normals_stays() {
        let mut mesh = cuboid([1.0; 3]);
        mesh.normals.clear();
        let before = mesh.clone();
        split_sharp_edges(&mut mesh, &[]);
        assert_eq!(mesh, before);
        // A flat pyramid under one normal, and a triangle without area.
        let mut roof = TriangleMesh {
            positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.5, 0.5, 0.3], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 4, 2]],
            normals: vec![[0.0, 0.0, 1.0]; 5],
            ..TriangleMesh::default()
        };
        let before = roof.clone();
        split_sharp_edges(&mut roof, &[]);
        assert_eq!(roof, before);
        // Were its first triangle the face of a cut, that would have corners of its own, however flat the edge.
        split_sharp_edges(&mut roof, &[true, true, false, true, false]);
        assert_eq!(roof.triangles, [[5, 6, 7], [1, 2, 3], [2, 0, 3], [0, 4, 2]]);
        let face = area_normal(&roof, &roof.triangles[0]);
        assert_eq!(roof.normals[5..], [unit(face); 3]);
    }

    #[test]
    fn a_face_that_bends_is_smooth_behind_its_rim() {
        let face = TriangleMesh {
            positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.5, 0.5, 0.3]],
            triangles: vec![[0, 1, 3], [1, 2, 3], [2, 0, 3]],
            // That of the top is the mean of the triangles round it, each of which turns from it by more than 20 degrees.
            normals: vec![[0.0, 0.0, 1.0]; 4],
            ..TriangleMesh::default()
        };
        let tops = |normal: [f32; 3]| {
            let mut mesh = face.clone();
            mesh.normals[3] = unit(normal);
            split_sharp_edges(&mut mesh, &[true; 4]);
            mesh.triangles.iter().map(|triangle| triangle[2]).collect::<Vec<_>>()
        };
        assert_eq!(tops([0.0, 0.0, 1.0]), [3, 3, 3]);
        // A normal that is not its own is that of the skin.
        assert!(tops([0.3, 0.0, 1.0]).iter().all(|&top| top > 3));
    }
}
