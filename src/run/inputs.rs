//! The volumes a scene names, read and checked against each other.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use crate::dynamics::effects::contact::ToolMesh;
use crate::io::mesh_error::ReadMeshError;
use crate::io::nifti::{ReadVolumeError, read_ct, read_labels};
use crate::io::stl::read_stl;
use crate::phantom::{self, PhantomError};
use crate::scene::resolved::{Action, Property, PropertyKind, Scene, ToolShape, VolumeSource};
use crate::store::InputFile;
use crate::volume::{CtVolume, GridMismatch, LabelVolume, Overlay, check_same_grid};

/// What a scene is simulated from. At least one of the two volumes is there; if both are, they share a grid.
#[derive(Debug, Clone)]
pub struct Inputs {
    /// CT image [HU].
    pub image: Option<CtVolume>,
    /// Label map.
    pub labels: Option<LabelVolume>,
    /// Volumes of Young's modulus [Pa] or density [kg/m^3] by the path the scene names, on the same grid.
    pub properties: BTreeMap<PathBuf, CtVolume>,
    /// Meshes of tools by the path the scene names [mm, RAS+].
    pub tools: BTreeMap<PathBuf, ToolMesh>,
    /// Voxels of the image that were NaN or infinite and have been read as air.
    pub replaced_voxels: u64,
    /// The files that were read.
    pub files: Vec<InputFile>,
}

/// Why the volumes of a scene cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A file is missing, damaged or of another kind.
    #[error(transparent)]
    Read(#[from] ReadVolumeError),
    /// The mesh of a tool is missing or damaged.
    #[error("the mesh of tool `{tool}`: {source}")]
    Tool {
        /// Name of the tool.
        tool: String,
        /// Why.
        source: ReadMeshError,
    },
    /// The phantom cannot be made.
    #[error(transparent)]
    Phantom(#[from] PhantomError),
    /// A volume of moduli or densities does not lie on the grid of the scene's volume.
    #[error("{}: {source}", path.display())]
    PropertyGrid {
        /// The volume of moduli or densities.
        path: PathBuf,
        /// How they differ.
        source: Box<GridMismatch>,
    },
    /// Image and labels do not lie on the same grid.
    #[error("{} and {} do not belong together: {source}", image.display(), labels.display())]
    Grid {
        /// The image.
        image: PathBuf,
        /// The label map.
        labels: PathBuf,
        /// How they differ.
        source: Box<GridMismatch>,
    },
    /// A file that was just read cannot be read again for its checksum.
    #[error("{}: could not compute its checksum", path.display())]
    Checksum {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Reads or makes the volumes of a scene.
///
/// # Errors
/// See [`InputError`].
pub fn load(scene: &Scene) -> Result<Inputs, InputError> {
    let mut inputs = load_volume(&scene.volume)?;
    let grid = inputs.labels.as_ref().map(LabelVolume::grid).or(inputs.image.as_ref().map(CtVolume::grid)).copied();
    for (organ, kind) in scene.organs.iter().flat_map(|organ| PropertyKind::ALL.map(|kind| (organ, kind))) {
        let Some(Property::FromFile(path)) = organ.body.property(kind) else { continue };
        if inputs.properties.contains_key(path) {
            continue;
        }
        let (values, info) = read_ct(path)?;
        let overlay = match kind {
            PropertyKind::YoungsModulus => Overlay::Moduli,
            PropertyKind::Density => Overlay::Densities,
        };
        if let Some(grid) = &grid {
            check_same_grid(grid, values.grid(), overlay)
                .map_err(|source| InputError::PropertyGrid { path: path.clone(), source: Box::new(source) })?;
        }
        record(&mut inputs.files, &info.header_path, &info.data_path)?;
        inputs.properties.insert(path.clone(), values);
    }
    for operation in &scene.operations {
        let Action::Tool { shape: ToolShape::Mesh { file }, .. } = &operation.action else { continue };
        if inputs.tools.contains_key(file) {
            continue;
        }
        let mesh = read_stl(file).map_err(|source| InputError::Tool { tool: operation.name.clone(), source })?;
        record(&mut inputs.files, file, file)?;
        inputs.tools.insert(file.clone(), ToolMesh { positions: mesh.positions, triangles: mesh.triangles });
    }
    Ok(inputs)
}

/// Reads or makes the image and the labels of a scene.
///
/// # Errors
/// See [`InputError`].
pub fn load_volume(source: &VolumeSource) -> Result<Inputs, InputError> {
    match source {
        VolumeSource::Phantom { kind, spacing, seed } => {
            let phantom = phantom::make(*kind, *spacing, *seed)?;
            Ok(Inputs {
                image: Some(phantom.image),
                labels: Some(phantom.labels),
                properties: BTreeMap::new(),
                tools: BTreeMap::new(),
                replaced_voxels: 0,
                files: Vec::new(),
            })
        }
        VolumeSource::Files { image: image_path, labels: labels_path } => {
            let mut files = Vec::new();
            let mut replaced_voxels = 0;
            let image = match image_path {
                Some(path) => {
                    let (image, info) = read_ct(path)?;
                    replaced_voxels = info.replaced_voxels;
                    record(&mut files, &info.header_path, &info.data_path)?;
                    Some(image)
                }
                None => None,
            };
            let labels = match labels_path {
                Some(path) => {
                    let (labels, info) = read_labels(path)?;
                    record(&mut files, &info.header_path, &info.data_path)?;
                    Some(labels)
                }
                None => None,
            };
            if let (Some(image), Some(labels)) = (&image, &labels) {
                check_same_grid(image.grid(), labels.grid(), Overlay::Labels).map_err(|source| InputError::Grid {
                    image: image_path.clone().unwrap_or_default(),
                    labels: labels_path.clone().unwrap_or_default(),
                    source: Box::new(source),
                })?;
            }
            let (properties, tools) = (BTreeMap::new(), BTreeMap::new());
            Ok(Inputs { image, labels, properties, tools, replaced_voxels, files })
        }
    }
}

fn record(files: &mut Vec<InputFile>, header: &Path, data: &Path) -> Result<(), InputError> {
    for path in if header == data { vec![header] } else { vec![header, data] } {
        files.push(InputFile::of(path).map_err(|source| InputError::Checksum { path: path.to_owned(), source })?);
    }
    Ok(())
}
