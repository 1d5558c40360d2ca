//! Which mesh format a path asks for, and the names of numbered sequences.
//!
//! A sequence is asked for by `{frame}` in the file name: `liver_{frame}.stl` becomes `liver_000.stl`, `liver_001.stl`, ...
//! The number is padded with zeros to the width of the run's last frame, so that names sort in time. `{frame}` is the
//! only placeholder, may stand once, and not in a folder's name; any other brace in the file name is refused.

use std::fmt;
use std::path::{Path, PathBuf};

use super::gltf::{GltfReader, Precision, write_gltf};
use super::mesh_error::{ReadMeshError, WriteMeshError};
use super::{ply, stl};
use crate::surface::mesh::{Finish, OrganMesh};

/// The placeholder of a frame's number.
const FRAME: &str = "{frame}";

/// A mesh file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum MeshFormat {
    /// Binary STL: `.stl`.
    Stl,
    /// ASCII STL: `.stl`, on request.
    StlAscii,
    /// Binary PLY: `.ply`.
    Ply,
    /// Binary glTF 2.0: `.glb`.
    Glb,
    /// glTF 2.0 as JSON with its buffer beside it: `.gltf` and `.bin`.
    Gltf,
}

/// Why a path cannot name mesh files.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshPathError {
    /// The extension names no format.
    #[error("{}: the extension is {found}; meshes are written as .stl, .ply or .glb", path.display())]
    UnknownExtension {
        /// The path.
        path: PathBuf,
        /// Its extension, quoted, or the word "missing".
        found: String,
    },
    /// ASCII was asked of a format that has none.
    #[error("ASCII was asked for, but {format} is binary here; only STL can be written as ASCII")]
    NoAscii {
        /// The format.
        format: MeshFormat,
    },
    /// Several frames, one name.
    #[error(
        "{}: {frames} frames need {frames} names: put {{frame}} into the file name ({}), or write one animated .glb",
        path.display(),
        example.display()
    )]
    SequenceWithoutPattern {
        /// The path.
        path: PathBuf,
        /// How many frames.
        frames: usize,
        /// The same name with a placeholder.
        example: PathBuf,
    },
    /// A placeholder that does not exist.
    #[error("{}: {found} is not a placeholder; the only one is {{frame}}, the number of the frame", path.display())]
    UnknownPlaceholder {
        /// The path.
        path: PathBuf,
        /// The placeholder with its braces, or the lone brace.
        found: String,
    },
    /// `{frame}` where it cannot be.
    #[error("{}: {{frame}} may stand once, in the file name; {problem}", path.display())]
    MisplacedPlaceholder {
        /// The path.
        path: PathBuf,
        /// What is wrong.
        problem: &'static str,
    },
}

impl MeshFormat {
    /// The format of a path's extension, upper or lower case.
    ///
    /// # Errors
    /// If the extension is missing or names no mesh format.
    pub fn from_path(path: &Path) -> Result<Self, MeshPathError> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            Some("stl") => Ok(Self::Stl),
            Some("ply") => Ok(Self::Ply),
            Some("glb") => Ok(Self::Glb),
            Some("gltf") => Ok(Self::Gltf),
            other => {
                let found = other.map_or("missing".to_string(), |extension| format!("'.{extension}'"));
                Err(MeshPathError::UnknownExtension { path: path.to_path_buf(), found })
            }
        }
    }

    /// The ASCII variant of this format.
    ///
    /// # Errors
    /// If it has none.
    pub fn ascii(self) -> Result<Self, MeshPathError> {
        match self {
            Self::Stl | Self::StlAscii => Ok(Self::StlAscii),
            format => Err(MeshPathError::NoAscii { format }),
        }
    }

    /// Writes organ meshes to one file of this format.
    ///
    /// # Errors
    /// As the format's own writer.
    pub fn write(self, path: &Path, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
        match self {
            Self::Stl => stl::write_stl(path, organs),
            Self::StlAscii => stl::write_stl_ascii(path, organs),
            Self::Ply => ply::write_ply(path, organs),
            Self::Glb | Self::Gltf => write_gltf(path, organs, Precision::Float),
        }
    }

    /// Reads a mesh file of this format: one mesh for STL and PLY, named after the file, and the organs of the first frame
    /// for GLB ([`GltfReader`] gives every frame).
    ///
    /// # Errors
    /// As the format's own reader.
    pub fn read(self, path: &Path) -> Result<Vec<OrganMesh>, ReadMeshError> {
        let mesh = match self {
            Self::Stl | Self::StlAscii => stl::read_stl(path)?,
            Self::Ply => ply::read_ply(path)?,
            Self::Glb | Self::Gltf => return GltfReader::open(path)?.read_frame(0),
        };
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(vec![OrganMesh { name, color: [0.8; 3], finish: Finish::default(), mesh }])
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stl => "binary STL",
            Self::StlAscii => "ASCII STL",
            Self::Ply => "PLY",
            Self::Glb => "GLB",
            Self::Gltf => "glTF (JSON)",
        })
    }
}

/// The names of a numbered sequence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FramePattern {
    folder: PathBuf,
    before: String,
    after: String,
}

impl FramePattern {
    /// The pattern in a path, or `None` when the file name has no placeholder.
    ///
    /// # Errors
    /// If the file name has another placeholder, a lone brace or `{frame}` twice, or a folder's name has `{frame}`.
    pub fn parse(path: &Path) -> Result<Option<Self>, MeshPathError> {
        let misplaced = |problem| Err(MeshPathError::MisplacedPlaceholder { path: path.to_path_buf(), problem });
        let folder = path.parent().unwrap_or(Path::new(""));
        if folder.to_string_lossy().contains(FRAME) {
            return misplaced("here it stands in a folder's name");
        }
        // A name that is not Unicode holds no placeholder: braces are ASCII, but the parts could not be kept exactly.
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { return Ok(None) };
        let (before, after) = match name.split_once(FRAME) {
            Some((before, after)) => (before, Some(after)),
            None => (name, None),
        };
        if after.is_some_and(|after| after.contains(FRAME)) {
            return misplaced("here it stands twice");
        }
        for part in [Some(before), after].into_iter().flatten() {
            if let Some(at) = part.find(['{', '}']) {
                let rest = &part[at..];
                let end = if rest.starts_with('{') { rest.find('}').unwrap_or(0) } else { 0 };
                let (path, found) = (path.to_path_buf(), rest[..=end].to_string());
                return Err(MeshPathError::UnknownPlaceholder { path, found });
            }
        }
        let pattern = |after: &str| Self { folder: folder.into(), before: before.into(), after: after.into() };
        Ok(after.map(pattern))
    }

    /// Path of a frame in a run whose last frame is `last`.
    pub fn path(&self, frame: usize, last: usize) -> PathBuf {
        let width = last.to_string().len();
        self.folder.join(format!("{}{frame:0width$}{}", self.before, self.after))
    }
}

/// Where meshes go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MeshOutput {
    /// One frame into one file.
    File(PathBuf),
    /// All frames into one animated GLB.
    Animation(PathBuf),
    /// Each frame into a file of its own.
    Sequence(FramePattern),
}

impl MeshOutput {
    /// What a path and a number of frames ask for.
    ///
    /// A path with `{frame}` is a sequence, even of one; without it, one frame goes into one file, and several into an
    /// animation if the format has one.
    ///
    /// # Errors
    /// If several frames are asked of one STL or PLY file, or the path's placeholders are wrong.
    pub fn new(path: &Path, format: MeshFormat, frames: usize) -> Result<Self, MeshPathError> {
        match (FramePattern::parse(path)?, format) {
            (Some(pattern), _) => Ok(Self::Sequence(pattern)),
            (None, _) if frames <= 1 => Ok(Self::File(path.to_path_buf())),
            (None, MeshFormat::Glb | MeshFormat::Gltf) => Ok(Self::Animation(path.to_path_buf())),
            (None, _) => {
                let mut name = path.file_stem().unwrap_or_default().to_os_string();
                name.push("_{frame}");
                if let Some(extension) = path.extension() {
                    name.push(".");
                    name.push(extension);
                }
                let (path, example) = (path.to_path_buf(), path.with_file_name(name));
                Err(MeshPathError::SequenceWithoutPattern { path, frames, example })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_name_formats() {
        let format = |path: &str| MeshFormat::from_path(Path::new(path));
        assert_eq!(format("a/b.stl"), Ok(MeshFormat::Stl));
        assert_eq!(format("b.PLY"), Ok(MeshFormat::Ply));
        assert_eq!(format("liver_{frame}.glb"), Ok(MeshFormat::Glb));
        for (path, found) in [("mesh.obj", "'.obj'"), ("mesh", "missing")] {
            let message = format(path).unwrap_err().to_string();
            assert!(
                message.contains(path) && message.contains(found) && message.contains(".stl, .ply or .glb"),
                "{message}"
            );
        }
        assert_eq!(MeshFormat::Stl.ascii(), Ok(MeshFormat::StlAscii));
        assert!(MeshFormat::Glb.ascii().unwrap_err().to_string().contains("GLB is binary"));
    }

    #[test]
    fn numbers_are_padded_to_the_last_frame() {
        let pattern = FramePattern::parse(Path::new("out/liver_{frame}.stl")).unwrap().unwrap();
        assert_eq!(pattern.path(7, 9), Path::new("out/liver_7.stl"));
        assert_eq!(pattern.path(7, 40), Path::new("out/liver_07.stl"));
        assert_eq!(pattern.path(100, 100), Path::new("out/liver_100.stl"));
        assert_eq!(FramePattern::parse(Path::new("out/{odd}/liver.stl")), Ok(None));
    }

    #[test]
    fn wrong_patterns_are_refused_with_the_placeholder() {
        let message = |path: &str| FramePattern::parse(Path::new(path)).unwrap_err().to_string();
        for (path, part) in [
            ("liver_{step}.stl", "{step} is not a placeholder"),
            ("liver_{frame}_{organ}.stl", "{organ} is not"),
            ("liver_{frame.stl", "{ is not"),
            ("liver_frame}.stl", "} is not"),
            ("{frame}/{frame}.stl", "folder"),
            ("{frame}_{frame}.stl", "twice"),
        ] {
            let message = message(path);
            assert!(message.starts_with(path) && message.contains(part) && message.contains("{frame}"), "{message}");
        }
    }

    #[test]
    fn frames_and_path_decide_what_is_written() {
        let output = |path: &str, frames| {
            let path = Path::new(path);
            MeshOutput::new(path, MeshFormat::from_path(path).unwrap(), frames)
        };
        assert_eq!(output("a.stl", 1), Ok(MeshOutput::File("a.stl".into())));
        assert_eq!(output("a.glb", 41), Ok(MeshOutput::Animation("a.glb".into())));
        assert!(matches!(output("a_{frame}.glb", 41), Ok(MeshOutput::Sequence(_))));
        let message = output("out/a.ply", 41).unwrap_err().to_string();
        assert!(
            message.contains("out/a.ply: 41 frames") && message.contains("a_{frame}.ply") && message.contains(".glb"),
            "{message}"
        );
    }
}
