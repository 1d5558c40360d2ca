//! What can go wrong with mesh files, and the checks every mesh writer makes before it opens one.

use std::io;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::surface::mesh::OrganMesh;

/// Vectors looked at by one task when values are checked.
const FINITE_STRIDE: usize = 4096;

/// Why a mesh was not written. Nothing is left at the path, or what was there before.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteMeshError {
    /// No organ has a triangle.
    #[error(
        "{}: nothing to write: none of the {organs} organ meshes has a triangle; check that the scene's organs select voxels",
        path.display()
    )]
    Empty {
        /// The file asked for.
        path: PathBuf,
        /// How many organ meshes were given.
        organs: usize,
    },
    /// An attribute is neither empty nor as long as the vertices.
    #[error(
        "{}: organ '{organ}' has {found} {attribute} for {expected} vertices; give one per vertex or none",
        path.display()
    )]
    AttributeLength {
        /// The file asked for.
        path: PathBuf,
        /// The organ.
        organ: String,
        /// Which attribute.
        attribute: &'static str,
        /// Entries found.
        found: usize,
        /// Vertices of the organ.
        expected: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "{}: organ '{organ}': triangle {triangle} uses vertex {found}, but the organ has {vertices} vertices",
        path.display()
    )]
    VertexIndex {
        /// The file asked for.
        path: PathBuf,
        /// The organ.
        organ: String,
        /// Which triangle, from 0.
        triangle: usize,
        /// The index found.
        found: u32,
        /// Vertices of the organ.
        vertices: usize,
    },
    /// A coordinate or colour is NaN or infinite.
    #[error(
        "{}: organ '{organ}': {what} {at} is {found:?}, not finite; the state that gave it diverged (a smaller dt helps)",
        path.display()
    )]
    NotFinite {
        /// The file asked for.
        path: PathBuf,
        /// The organ.
        organ: String,
        /// Which array.
        what: &'static str,
        /// Which entry, from 0.
        at: usize,
        /// What it holds.
        found: Vec<f32>,
    },
    /// More than the format can count.
    #[error("{}: {found} {what} are more than {format} can hold ({limit}); {advice}", path.display())]
    TooLarge {
        /// The file asked for.
        path: PathBuf,
        /// The format.
        format: &'static str,
        /// What there is too much of.
        what: &'static str,
        /// How many there are.
        found: u64,
        /// The most the format can hold.
        limit: u64,
        /// What to do instead.
        advice: &'static str,
    },
    /// Times of an animation do not grow.
    #[error(
        "{}: frame {frame} is at {time} s, after a frame at {previous} s; frames need finite times, 0 or later, that grow by \
         more than single precision resolves",
        path.display()
    )]
    FrameTime {
        /// The file asked for.
        path: PathBuf,
        /// The frame, from 0.
        frame: usize,
        /// Its time [s].
        time: f64,
        /// Time of the frame before [s]; minus infinity for the first.
        previous: f64,
    },
    /// An earlier frame could not be written whole, so the animation cannot be finished.
    #[error("{}: not written, because one of its frames failed earlier; start the animation again", path.display())]
    Unfinished {
        /// The file asked for.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("{}: could not write the mesh: {source}", path.display())]
    Io {
        /// The file asked for.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
}

impl WriteMeshError {
    pub(crate) fn io(path: &Path) -> impl Fn(io::Error) -> Self {
        move |source| Self::Io { path: path.to_path_buf(), source }
    }
}

/// Why a mesh file could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadMeshError {
    /// The file breaks its format's rules, or ends early.
    #[error("{}: not a usable {format} file: {what}; write it again from its source", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The format.
        format: &'static str,
        /// What was found and what was expected.
        what: String,
    },
    /// The file may be right, but says something this reader does not handle.
    #[error("{}: {what} is not read here; {advice}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature found.
        what: String,
        /// What to do instead.
        advice: &'static str,
    },
    /// The operating system refused.
    #[error("{}: could not read the mesh: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
}

impl ReadMeshError {
    pub(crate) fn io(path: &Path) -> impl Fn(io::Error) -> Self {
        move |source| Self::Io { path: path.to_path_buf(), source }
    }

    pub(crate) fn malformed(path: &Path, format: &'static str, what: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_path_buf(), format, what: what.into() }
    }
}

/// Checks what every writer relies on: at least one triangle, arrays of matching lengths, indices in range, finite values.
pub(crate) fn check_organs(path: &Path, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
    if organs.iter().all(|organ| organ.mesh.triangles.is_empty()) {
        return Err(WriteMeshError::Empty { path: path.to_path_buf(), organs: organs.len() });
    }
    organs.iter().try_for_each(|organ| check_organ(path, organ))
}

/// The checks of [`check_organs`] that concern one organ, which may be empty.
pub(crate) fn check_organ(path: &Path, organ: &OrganMesh) -> Result<(), WriteMeshError> {
    let mesh = &organ.mesh;
    let vertices = mesh.positions.len();
    let lengths = [
        ("normals", mesh.normals.len()),
        ("labels", mesh.labels.len()),
        ("displacements", mesh.displacements.len()),
        ("HU", mesh.hu.len()),
        ("strains", mesh.strains.len()),
        ("speeds", mesh.speeds.len()),
        ("colors", mesh.colors.len()),
    ];
    for (attribute, found) in lengths {
        if found != 0 && found != vertices {
            let (path, organ) = (path.to_path_buf(), organ.name.clone());
            return Err(WriteMeshError::AttributeLength { path, organ, attribute, found, expected: vertices });
        }
    }
    let outside = |corners: &[u32; 3]| corners.iter().copied().find(|&corner| corner as usize >= vertices);
    if let Some(triangle) = mesh.triangles.par_iter().position_first(|corners| outside(corners).is_some()) {
        let (path, organ) = (path.to_path_buf(), organ.name.clone());
        let found = outside(&mesh.triangles[triangle]).unwrap_or_default();
        return Err(WriteMeshError::VertexIndex { path, organ, triangle, found, vertices });
    }
    let vectors: [(&'static str, &[[f32; 3]]); 5] = [
        ("vertex", &mesh.positions),
        ("normal", &mesh.normals),
        ("displacement", &mesh.displacements),
        ("vertex colour", &mesh.colors),
        ("colour", std::slice::from_ref(&organ.color)),
    ];
    let numbers: [(&'static str, &[f32]); 3] = [("HU", &mesh.hu), ("strain", &mesh.strains), ("speed", &mesh.speeds)];
    let wrong = |values: &[f32]| !values.iter().all(|x| x.is_finite());
    let vectors = vectors.into_iter().map(|(what, array)| (what, 3, array.as_flattened()));
    for (what, parts, array) in vectors.chain(numbers.map(|(what, array)| (what, 1, array))) {
        // Found first in large strides, which compile to wide instructions, then exactly.
        let Some(stride) = array.par_chunks(3 * FINITE_STRIDE).position_first(wrong) else { continue };
        let array = &array[3 * FINITE_STRIDE * stride..];
        if let Some(at) = array.chunks(parts).position(wrong) {
            let (path, organ, found) = (path.to_path_buf(), organ.name.clone(), array[at * parts..][..parts].to_vec());
            let at = at + 3 * FINITE_STRIDE * stride / parts;
            return Err(WriteMeshError::NotFinite { path, organ, what, at, found });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::{Finish, TriangleMesh};

    fn triangle() -> OrganMesh {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mesh = TriangleMesh { positions, triangles: vec![[0, 1, 2]], ..TriangleMesh::default() };
        OrganMesh { name: "liver".into(), color: [0.5, 0.1, 0.1], finish: Finish::Wet, mesh }
    }

    fn message(change: impl FnOnce(&mut OrganMesh)) -> String {
        let mut organ = triangle();
        change(&mut organ);
        check_organs(Path::new("out.stl"), &[organ]).unwrap_err().to_string()
    }

    #[test]
    fn refusals_name_the_organ_and_the_value() {
        check_organs(Path::new("out.stl"), &[triangle()]).unwrap();
        let cases = [
            (message(|o| o.mesh.triangles.clear()), vec!["out.stl", "none of the 1"]),
            (message(|o| o.mesh.labels = vec![1; 2]), vec!["out.stl", "liver", "2 labels for 3"]),
            (message(|o| o.mesh.triangles.push([0, 1, 7])), vec!["liver", "triangle 1", "vertex 7", "3 vertices"]),
            (message(|o| o.mesh.positions[2][1] = f32::NAN), vec!["liver", "vertex 2", "NaN", "dt"]),
            (message(|o| o.color[0] = f32::INFINITY), vec!["colour", "inf"]),
            (message(|o| o.mesh.speeds = vec![0.0, 1.0, f32::NAN]), vec!["speed 2", "[NaN]"]),
            (message(|o| o.mesh.hu = vec![0.0]), vec!["1 HU for 3"]),
        ];
        for (message, parts) in cases {
            for part in parts {
                assert!(message.contains(part), "'{message}' lacks '{part}'");
            }
        }
    }

    #[test]
    fn every_other_message_holds_its_values() {
        let path = PathBuf::from("run.glb");
        let source = || io::Error::other("disk full");
        let written = [
            WriteMeshError::TooLarge {
                path: path.clone(),
                format: "GLB",
                what: "bytes",
                found: 5_000_000_000,
                limit: 4_294_967_295,
                advice: "write a sequence",
            }
            .to_string(),
            WriteMeshError::FrameTime { path: path.clone(), frame: 3, time: 0.25, previous: 0.5 }.to_string(),
            WriteMeshError::Unfinished { path: path.clone() }.to_string(),
            WriteMeshError::Io { path: path.clone(), source: source() }.to_string(),
            ReadMeshError::malformed(&path, "GLB", "ends after 3 bytes").to_string(),
            ReadMeshError::Unsupported { path: path.clone(), what: "mode LINES".into(), advice: "use triangles" }
                .to_string(),
            ReadMeshError::Io { path, source: source() }.to_string(),
        ];
        let parts = [
            "5000000000 bytes are more than GLB can hold (4294967295); write a sequence",
            "frame 3 is at 0.25 s, after a frame at 0.5 s",
            "start the animation again",
            "disk full",
            "GLB file: ends after 3 bytes",
            "mode LINES is not read here; use triangles",
            "could not read the mesh: disk full",
        ];
        for (message, part) in written.iter().zip(parts) {
            assert!(message.starts_with("run.glb: ") && message.contains(part), "{message}");
        }
    }
}
