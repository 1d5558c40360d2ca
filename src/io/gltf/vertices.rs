//! Vertex attributes of a mesh as accessors: plain floats, or quantised.
//!
//! Quantised (KHR_mesh_quantization): positions are 16-bit shares of the mesh's largest extent, which the node scales and
//! shifts into place; normals are three signed bytes. Everything else stays as it is.
//!
//! Colours are 16-bit in both: they are linear, and 8 linear bits step by up to 13 of sRGB's 255 in the dark.

use std::collections::BTreeMap;
use std::io;

use gltf_json::accessor::{ComponentType, Type};
use gltf_json::buffer::Target;
use gltf_json::mesh::Semantic;
use gltf_json::validation::Checked::{self, Valid};
use gltf_json::{Accessor, Index};
use rayon::prelude::*;

use super::document::{Buffer, DocumentWriter, accessor};
use super::to_gltf;
use crate::io::encode::push_f32;
use crate::surface::mesh::{OrganMesh, TriangleMesh};

/// How exactly vertices are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Precision {
    /// Single precision.
    #[default]
    Float,
    /// 16-bit positions and 8-bit normals, see [`quantization_error_mm`].
    Quantized,
}

/// Steps along the largest extent.
const STEPS: f32 = u16::MAX as f32;

/// Attributes of a primitive.
pub(super) type Attributes = BTreeMap<Checked<Semantic>, Index<Accessor>>;

/// What a node does to quantised positions in 0..=1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Placing {
    pub(super) translation: [f32; 3],
    pub(super) scale: f32,
}

/// How far quantised positions lie from the true ones, at most and along each axis [mm]: half a step of the largest extent
/// of the largest mesh. (Normals turn by at most 0.4 degrees.)
pub fn quantization_error_mm(organs: &[OrganMesh]) -> f64 {
    let extent = |organ: &OrganMesh| {
        let positions = &organ.mesh.positions;
        bounds(positions.len(), |vertex| positions[vertex]).map_or(0.0, |bounds| f64::from(largest_extent(bounds)))
    };
    organs.iter().map(extent).fold(0.0, f64::max) / f64::from(STEPS) / 2.0
}

impl<B: Buffer> DocumentWriter<B> {
    /// Adds the attributes a mesh has; positions relative to `origin`, glTF axes [m].
    pub(super) fn push_vertices(
        &mut self,
        mesh: &TriangleMesh,
        origin: [f32; 3],
        precision: Precision,
    ) -> io::Result<(Attributes, Option<Placing>)> {
        let mut attributes = Attributes::new();
        let count = mesh.positions.len();
        let position = |vertex: usize| place(mesh.positions[vertex], origin);
        let bounds = bounds(count, position);
        let mut placing = None;
        let positions = match (precision, bounds) {
            (Precision::Quantized, Some(bounds)) => {
                let extent = largest_extent(bounds);
                let there = Placing { translation: bounds[0], scale: if extent > 0.0 { extent } else { 1.0 } };
                placing = Some(there);
                self.quantized_positions(count, bounds, there, position)?
            }
            _ => self.vectors(count, bounds, position)?,
        };
        attributes.insert(Valid(Semantic::Positions), positions);
        if !mesh.normals.is_empty() {
            let normal = |vertex: usize| unit_normal(mesh.normals[vertex]);
            let normals = match precision {
                Precision::Float => self.vectors(count, None, normal)?,
                Precision::Quantized => self.quantized_normals(count, normal)?,
            };
            attributes.insert(Valid(Semantic::Normals), normals);
        }
        if !mesh.displacements.is_empty() {
            let displacements = self.vectors(count, None, |vertex| place(mesh.displacements[vertex], [0.0; 3]))?;
            attributes.insert(custom("DISPLACEMENT"), displacements);
        }
        if !mesh.labels.is_empty() && one_label(mesh).is_none() {
            // Vertex attributes start at multiples of four bytes, so a 16-bit label takes four.
            let view = self.view(count, Some(Target::ArrayBuffer), Some(4), |range, bytes| {
                mesh.labels[range].iter().for_each(|&label| bytes.extend_from_slice(&u32::from(label).to_le_bytes()));
            })?;
            let labels = self.root().push(accessor(view, ComponentType::U16, Type::Scalar, count));
            attributes.insert(custom("LABEL"), labels);
        }
        let numbers = [("HU", &mesh.hu, 1.0), ("STRAIN", &mesh.strains, 1.0), ("SPEED", &mesh.speeds, 1e-3)];
        for (name, values, factor) in numbers.into_iter().filter(|(_, values, _)| !values.is_empty()) {
            let view = self.view(count, Some(Target::ArrayBuffer), None, |range, bytes| {
                values[range].iter().for_each(|&value| push_f32(bytes, [(f64::from(value) * factor) as f32]));
            })?;
            let numbers = self.root().push(accessor(view, ComponentType::F32, Type::Scalar, count));
            attributes.insert(custom(name), numbers);
        }
        if !mesh.colors.is_empty() {
            attributes.insert(Valid(Semantic::Colors(0)), self.colors(&mesh.colors)?);
        }
        Ok((attributes, placing))
    }

    fn quantized_positions(
        &mut self,
        count: usize,
        bounds: [[f32; 3]; 2],
        Placing { translation, scale }: Placing,
        position: impl Fn(usize) -> [f32; 3] + Sync,
    ) -> io::Result<Index<Accessor>> {
        let steps = |place: [f32; 3]| {
            let share = |axis: usize| f64::from(place[axis] - translation[axis]) / f64::from(scale);
            [0, 1, 2].map(|axis| (share(axis) * f64::from(STEPS)).round() as u16)
        };
        // Three times two bytes, and two to the next multiple of four.
        let view = self.view(count, Some(Target::ArrayBuffer), Some(8), |range, bytes| {
            for vertex in range {
                let [x, y, z] = steps(position(vertex));
                bytes.extend_from_slice([x, y, z, 0].map(u16::to_le_bytes).as_flattened());
            }
        })?;
        let mut positions = accessor(view, ComponentType::U16, Type::Vec3, count);
        positions.normalized = true;
        let [low, high] = bounds.map(steps);
        positions.min = Some(low.to_vec().into());
        positions.max = Some(high.to_vec().into());
        Ok(self.root().push(positions))
    }

    fn quantized_normals(
        &mut self,
        count: usize,
        normal: impl Fn(usize) -> [f32; 3] + Sync,
    ) -> io::Result<Index<Accessor>> {
        let view = self.view(count, Some(Target::ArrayBuffer), Some(4), |range, bytes| {
            for vertex in range {
                let [x, y, z] = normal(vertex).map(|part| (127.0 * part).round() as i8 as u8);
                bytes.extend_from_slice(&[x, y, z, 0]);
            }
        })?;
        let mut normals = accessor(view, ComponentType::I8, Type::Vec3, count);
        normals.normalized = true;
        Ok(self.root().push(normals))
    }

    /// With an opaque alpha, which fills eight bytes.
    fn colors(&mut self, colors: &[[f32; 3]]) -> io::Result<Index<Accessor>> {
        let view = self.view(colors.len(), Some(Target::ArrayBuffer), None, |range, bytes| {
            for [r, g, b] in &colors[range] {
                let word = [*r, *g, *b, 1.0].map(|part| (65_535.0 * part.clamp(0.0, 1.0)).round() as u16);
                bytes.extend_from_slice(word.map(u16::to_le_bytes).as_flattened());
            }
        })?;
        let mut accessor = accessor(view, ComponentType::U16, Type::Vec4, colors.len());
        accessor.normalized = true;
        Ok(self.root().push(accessor))
    }
}

/// The label that all vertices have: it is written once, beside the mesh.
pub(super) fn one_label(mesh: &TriangleMesh) -> Option<u16> {
    let first = *mesh.labels.first()?;
    mesh.labels.par_iter().with_min_len(16_384).all(|&label| label == first).then_some(first)
}

fn custom(name: &str) -> Checked<Semantic> {
    Valid(Semantic::Extras(name.to_string()))
}

/// Patient millimetres as metres in glTF axes, relative to an origin there.
pub(super) fn place(mm: [f32; 3], origin: [f32; 3]) -> [f32; 3] {
    let place = to_gltf(mm.map(|x| f64::from(x) / 1000.0));
    [0, 1, 2].map(|axis| (place[axis] - f64::from(origin[axis])) as f32)
}

/// The normal in glTF axes at unit length, which the standard demands; one without length points up.
pub(super) fn unit_normal(normal: [f32; 3]) -> [f32; 3] {
    let turned = nalgebra::Vector3::from(to_gltf(normal.map(f64::from)));
    let length = turned.norm();
    if length > 0.0 { (turned / length).map(|x| x as f32).into() } else { [0.0, 1.0, 0.0] }
}

/// Lowest and highest coordinates of vectors; `None` without a vector.
pub(super) fn bounds(count: usize, vector: impl Fn(usize) -> [f32; 3] + Sync) -> Option<[[f32; 3]; 2]> {
    let join = |a: [[f32; 3]; 2], b: [[f32; 3]; 2]| {
        [[0, 1, 2].map(|axis| a[0][axis].min(b[0][axis])), [0, 1, 2].map(|axis| a[1][axis].max(b[1][axis]))]
    };
    (0..count).into_par_iter().with_min_len(16_384).map(|n| [vector(n); 2]).reduce_with(join)
}

fn largest_extent([low, high]: [[f32; 3]; 2]) -> f32 {
    (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f32::max)
}

/// The most bytes a mesh can take in the buffer.
pub(super) fn largest_size(mesh: &TriangleMesh) -> u64 {
    let vectors = mesh.positions.len() + mesh.normals.len() + mesh.displacements.len() + mesh.triangles.len();
    let numbers = mesh.labels.len() + mesh.hu.len() + mesh.strains.len() + mesh.speeds.len() + 2 * mesh.colors.len();
    12 * vectors as u64 + 4 * numbers as u64
}
