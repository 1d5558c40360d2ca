//! From a mesh of the document to an organ.

use gltf_json::accessor::Type;
use gltf_json::mesh::{Mode, Semantic};
use gltf_json::validation::Checked;
use gltf_json::{Extras, Index, Node, mesh};

use super::GltfReader;
use crate::geometry::{Matrix3, Matrix4, Point3, Vector3};
use crate::io::gltf::{from_gltf, material};
use crate::io::mesh_error::ReadMeshError;
use crate::surface::mesh::{Finish, OrganMesh, TriangleMesh};

/// An attribute of vertices, so that all are treated alike.
trait Column {
    fn len(&self) -> usize;
    fn clear(&mut self);
}

impl<T> Column for Vec<T> {
    fn len(&self) -> usize {
        self.len()
    }

    fn clear(&mut self) {
        self.clear();
    }
}

fn columns(mesh: &mut TriangleMesh) -> [(&'static str, &mut dyn Column); 7] {
    [
        ("NORMAL", &mut mesh.normals),
        ("_LABEL", &mut mesh.labels),
        ("_DISPLACEMENT", &mut mesh.displacements),
        ("_HU", &mut mesh.hu),
        ("_STRAIN", &mut mesh.strains),
        ("_SPEED", &mut mesh.speeds),
        ("COLOR_0", &mut mesh.colors),
    ]
}

/// The label of all vertices of a mesh. Other programs may keep anything there.
fn label_of(extras: &Extras) -> Option<u16> {
    let extras: serde_json::Value = serde_json::from_str(extras.as_ref()?.get()).ok()?;
    extras.get("label")?.as_u64()?.try_into().ok()
}

impl GltfReader {
    /// - `weights`: of the morph targets; missing ones are 0.
    pub(super) fn organ(
        &mut self,
        index: Index<gltf_json::Mesh>,
        node: &Node,
        world: &Matrix4,
        weights: Option<Vec<f32>>,
    ) -> Result<OrganMesh, ReadMeshError> {
        let Some(found) = self.root.get(index).cloned() else {
            return Err(self.source.malformed(format!("mesh {} does not exist", index.value())));
        };
        let weights = weights.or(found.weights).unwrap_or_default();
        let name = found.name.or_else(|| node.name.clone()).unwrap_or_else(|| format!("mesh {}", index.value()));
        let mut organ = OrganMesh { name, color: [1.0; 3], finish: Finish::default(), mesh: TriangleMesh::default() };
        for primitive in &found.primitives {
            if let Some(material) = primitive.material.and_then(|material| self.root.get(material)) {
                let [color @ .., _] = material.pbr_metallic_roughness.base_color_factor.0;
                organ.color = color;
                organ.finish = material::finish(material);
            }
            let part = self.primitive(primitive, world, &weights)?;
            let first = organ.mesh.positions.len() as u64;
            if first + part.positions.len() as u64 > self.source.bytes() / SMALLEST_VERTEX {
                return Err(self
                    .source
                    .unsupported("vertices shared by several primitives", "write vertices for each primitive"));
            }
            let whole = &mut organ.mesh;
            whole.positions.extend(part.positions);
            whole.normals.extend(part.normals);
            whole.labels.extend(part.labels);
            whole.displacements.extend(part.displacements);
            whole.hu.extend(part.hu);
            whole.strains.extend(part.strains);
            whole.speeds.extend(part.speeds);
            whole.colors.extend(part.colors);
            // Below 2^32: the buffer is, at some bytes each.
            whole.triangles.extend(part.triangles.iter().map(|corners| corners.map(|corner| corner + first as u32)));
        }
        // An attribute that one primitive lacks cannot be kept for the others.
        let vertices = organ.mesh.positions.len();
        columns(&mut organ.mesh)
            .into_iter()
            .filter(|(_, column)| column.len() != vertices)
            .for_each(|(_, c)| c.clear());
        if let Some(label) = label_of(&found.extras).filter(|_| organ.mesh.labels.is_empty()) {
            organ.mesh.labels = vec![label; vertices];
        }
        Ok(organ)
    }

    fn primitive(
        &mut self,
        primitive: &mesh::Primitive,
        world: &Matrix4,
        weights: &[f32],
    ) -> Result<TriangleMesh, ReadMeshError> {
        if !matches!(primitive.mode, Checked::Valid(Mode::Triangles)) {
            return Err(self.source.unsupported(format!("primitive mode {:?}", primitive.mode), "export triangles"));
        }
        let attribute = |semantic: Semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let custom = |name: &str| attribute(Semantic::Extras(name.to_string()));
        let linear: Matrix3 = world.fixed_view::<3, 3>(0, 0).into_owned();
        let mirrored = linear.determinant() < 0.0;
        let to_mm = |v: Vector3| from_gltf((v * 1000.0).into()).map(|x| x as f32);

        let Some(positions) = attribute(Semantic::Positions) else {
            return Err(self.source.malformed("a primitive has no POSITION"));
        };
        let place = |p: [f32; 3]| to_mm(world.transform_point(&Point3::from(p.map(f64::from))).coords);
        let positions: Vec<_> =
            self.morphed(positions, primitive, |target| target.positions, weights)?.into_iter().map(place).collect();
        if let Some((at, found)) = positions.iter().enumerate().find(|(_, p)| !p.iter().all(|x| x.is_finite())) {
            return Err(self.source.malformed(format!("vertex {at} is at {found:?} mm, which is not finite")));
        }
        let corners: Vec<u32> = match primitive.indices {
            Some(indices) => self.source.integers(&self.root, indices)?,
            None => (0..positions.len() as u32).collect(),
        };
        if let Some(&found) = corners.iter().find(|&&corner| corner as usize >= positions.len()) {
            return Err(self.source.malformed(format!("a triangle uses vertex {found} of {}", positions.len())));
        }
        if !corners.len().is_multiple_of(3) {
            return Err(self.source.malformed(format!("{} corners do not make whole triangles", corners.len())));
        }
        let turn = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        let triangles = corners.as_chunks::<3>().0.iter().map(turn).collect();

        let mut mesh = TriangleMesh { positions, triangles, ..TriangleMesh::default() };
        if let Some(normals) = attribute(Semantic::Normals) {
            let cofactor = linear.try_inverse().unwrap_or_else(Matrix3::identity).transpose();
            let turned = |n: [f32; 3]| {
                let normal = (cofactor * Vector3::from(n.map(f64::from))).try_normalize(0.0).unwrap_or_default();
                from_gltf(normal.into()).map(|x| x as f32)
            };
            mesh.normals =
                self.morphed(normals, primitive, |target| target.normals, weights)?.into_iter().map(turned).collect();
        }
        if let Some(displacements) = custom("DISPLACEMENT") {
            // Metres whatever the node does: turned with it, not stretched.
            let size = linear.determinant().abs().cbrt();
            let turn = if size > 0.0 { linear / size } else { linear };
            let moved = |d: [f32; 3]| to_mm(turn * Vector3::from(d.map(f64::from)));
            mesh.displacements =
                self.source.numbers::<3>(&self.root, displacements, Type::Vec3)?.into_iter().map(moved).collect();
        }
        if let Some(labels) = custom("LABEL") {
            let labels =
                self.source.integers(&self.root, labels)?.into_iter().map(u16::try_from).collect::<Result<_, _>>();
            mesh.labels = labels.map_err(|_| self.source.malformed("a _LABEL is above 65535"))?;
        }
        if let Some(hu) = custom("HU") {
            mesh.hu = self.scalars(hu, 1.0)?;
        }
        if let Some(strains) = custom("STRAIN") {
            mesh.strains = self.scalars(strains, 1.0)?;
        }
        if let Some(speeds) = custom("SPEED") {
            mesh.speeds = self.scalars(speeds, 1e3)?;
        }
        if let Some(colors) = attribute(Semantic::Colors(0)) {
            let transparent = self.root.get(colors).is_some_and(|found| found.type_ == Checked::Valid(Type::Vec4));
            mesh.colors = if transparent {
                let colors = self.source.numbers::<4>(&self.root, colors, Type::Vec4)?;
                colors.into_iter().map(|[r, g, b, _]| [r, g, b]).collect()
            } else {
                self.source.numbers::<3>(&self.root, colors, Type::Vec3)?
            };
        }
        let expected = mesh.positions.len();
        for (what, column) in columns(&mut mesh) {
            let found = column.len();
            if found != 0 && found != expected {
                return Err(self.source.malformed(format!("{found} {what} for {expected} vertices")));
            }
        }
        Ok(mesh)
    }

    /// Vectors of vertices, and what the weighted targets add to them.
    fn morphed(
        &mut self,
        base: Index<gltf_json::Accessor>,
        primitive: &mesh::Primitive,
        of: impl Fn(&mesh::MorphTarget) -> Option<Index<gltf_json::Accessor>>,
        weights: &[f32],
    ) -> Result<Vec<[f32; 3]>, ReadMeshError> {
        let mut vectors = self.source.numbers::<3>(&self.root, base, Type::Vec3)?;
        let targets = primitive.targets.iter().flatten().zip(weights).filter(|(_, weight)| **weight != 0.0);
        for (target, weight) in targets {
            let Some(target) = of(target) else { continue };
            let added = self.source.numbers::<3>(&self.root, target, Type::Vec3)?;
            if added.len() != vectors.len() {
                let (found, expected) = (added.len(), vectors.len());
                return Err(self.source.malformed(format!("a morph target of {found} vertices for {expected}")));
            }
            for (vector, added) in vectors.iter_mut().zip(added) {
                *vector = [0, 1, 2].map(|axis| vector[axis] + weight * added[axis]);
            }
        }
        Ok(vectors)
    }

    fn scalars(&mut self, index: Index<gltf_json::Accessor>, factor: f64) -> Result<Vec<f32>, ReadMeshError> {
        let values = self.source.numbers::<1>(&self.root, index, Type::Scalar)?;
        Ok(values.into_iter().map(|[value]| (f64::from(value) * factor) as f32).collect())
    }
}

/// Bytes of a vertex at least: three quantised coordinates.
pub(super) const SMALLEST_VERTEX: u64 = 3;
