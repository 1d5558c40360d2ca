//! Organ meshes checked, put into one list and projected.

use rayon::prelude::*;

use super::RenderError;
use super::camera::{Camera, ViewPlane};
use crate::surface::mesh::{Finish, OrganMesh, TriangleMesh};

/// Steps of the grid that corners are snapped to, per pixel: edges then are whole numbers, and exact.
pub(super) const SUBPIXELS: i32 = 256;
/// Farthest place of a corner [px]: products of two differences stay below 2^60.
const FARTHEST: f64 = (1 << 20) as f64;
/// Most triangles: their numbers share 32 bits with those of sections.
const MOST_TRIANGLES: usize = 1 << 30;
/// Most meshes: sections are numbered in 16 bits.
pub(super) const MOST_ORGANS: usize = 1 << 12;

/// A corner of triangles as the picture sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    /// Place on the picture [1/256 px]; [`Corner::OUTSIDE`] marks one that cannot be drawn.
    pub(super) x: i32,
    pub(super) y: i32,
    /// See [`super::camera::Projected::nearness`].
    pub(super) nearness: f32,
    /// Signed distance from the clip plane, scaled so that it is linear on the picture; above zero is taken away.
    pub(super) beyond: f32,
}

impl Corner {
    pub(super) const OUTSIDE: i32 = i32::MIN;
}

/// One organ's part of the lists.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    /// Its first triangle; they end where the next part begins.
    pub(super) first: usize,
    pub(super) color: [f32; 3],
    pub(super) finish: Finish,
}

/// What is drawn.
pub(super) struct Drawing {
    pub(super) corners: Vec<Corner>,
    /// Along right, up and back [units of the camera].
    pub(super) places: Vec<[f32; 3]>,
    /// Along right, up and back; zero where there is none.
    pub(super) normals: Vec<[f32; 3]>,
    /// Linear RGB.
    pub(super) colors: Vec<[f32; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) parts: Vec<Part>,
}

impl Drawing {
    pub(super) fn new(organs: &[OrganMesh], camera: &Camera, plane: Option<&ViewPlane>) -> Result<Self, RenderError> {
        let vertices = organs.iter().map(|organ| organ.mesh.positions.len()).sum();
        let triangles = organs.iter().map(|organ| organ.mesh.triangles.len()).sum();
        for (what, found, limit) in [
            ("triangles", triangles, MOST_TRIANGLES),
            ("vertices", vertices, MOST_TRIANGLES),
            ("meshes", organs.len(), MOST_ORGANS),
        ] {
            if found > limit {
                return Err(RenderError::TooMany { what, found, limit });
            }
        }
        if triangles == 0 {
            return Err(RenderError::Empty);
        }
        let mut drawing = Self {
            corners: Vec::with_capacity(vertices),
            places: Vec::with_capacity(vertices),
            normals: Vec::with_capacity(vertices),
            colors: Vec::with_capacity(vertices),
            triangles: Vec::with_capacity(triangles),
            parts: Vec::with_capacity(organs.len()),
        };
        for organ in organs {
            check(organ)?;
            drawing.add(organ, camera, plane);
        }
        Ok(drawing)
    }

    fn add(&mut self, organ: &OrganMesh, camera: &Camera, plane: Option<&ViewPlane>) {
        let mesh = &organ.mesh;
        let base = self.corners.len() as u32;
        self.parts.push(Part { first: self.triangles.len(), color: organ.color, finish: organ.finish });
        let seen = mesh.positions.par_iter().map(|&position| {
            let place = camera.view_place(position);
            (corner(place, camera, plane), place.map(|x| x as f32))
        });
        let (corners, places): (Vec<_>, Vec<_>) = seen.unzip();
        self.corners.extend(corners);
        self.places.extend(places);
        if mesh.normals.is_empty() {
            self.normals.resize(self.corners.len(), [0.0; 3]);
        } else {
            self.normals.par_extend(mesh.normals.par_iter().map(|&normal| camera.view_direction(normal)));
        }
        if mesh.colors.is_empty() {
            self.colors.resize(self.corners.len(), organ.color);
        } else {
            self.colors.extend(&mesh.colors);
        }
        self.triangles.par_extend(mesh.triangles.par_iter().map(|triangle| triangle.map(|vertex| vertex + base)));
    }

    /// Which part a triangle belongs to.
    pub(super) fn part_of(&self, triangle: usize) -> usize {
        self.parts.partition_point(|part| part.first <= triangle) - 1
    }
}

fn corner(place: [f64; 3], camera: &Camera, plane: Option<&ViewPlane>) -> Corner {
    let seen = camera.project(place).filter(|seen| seen.x.abs() < FARTHEST && seen.y.abs() < FARTHEST);
    let Some(seen) = seen else { return Corner { x: Corner::OUTSIDE, y: 0, nearness: 0.0, beyond: 0.0 } };
    let snapped = |at: f64| (at * f64::from(SUBPIXELS)).round() as i32;
    let scale = camera.scale(seen.nearness) / camera.scale(1.0);
    let beyond = plane.map_or(0.0, |plane| plane.distance(place) * scale);
    Corner { x: snapped(seen.x), y: snapped(seen.y), nearness: seen.nearness as f32, beyond: beyond as f32 }
}

/// Refuses a mesh that is not whole.
fn check(organ: &OrganMesh) -> Result<(), RenderError> {
    let TriangleMesh { positions, triangles, normals, colors, .. } = &organ.mesh;
    let vertices = positions.len();
    for (what, found) in [("normals", normals.len()), ("colours", colors.len())] {
        if found != 0 && found != vertices {
            return Err(RenderError::Mismatch { organ: organ.name.clone(), what, found, expected: vertices });
        }
    }
    let wrong = |corners: &&[u32; 3]| corners.iter().any(|&corner| corner as usize >= vertices);
    if let Some(triangle) = triangles.iter().position(|corners| wrong(&corners)) {
        let found = triangles[triangle].into_iter().max().unwrap_or(0);
        return Err(RenderError::VertexIndex { organ: organ.name.clone(), triangle, found, vertices });
    }
    for (what, values) in [("vertex", positions), ("colour", colors), ("colour of the organ", &vec![organ.color])] {
        if let Some(at) = values.iter().position(|value| value.iter().any(|x| !x.is_finite())) {
            return Err(RenderError::NotFinite { organ: organ.name.clone(), what, at, found: values[at] });
        }
    }
    Ok(())
}
