//! Files: one format per module. Nothing here simulates.

pub mod apng;
pub mod atomic;
mod encode;
pub mod gltf;
pub mod label_names;
pub mod mesh_error;
pub mod mesh_format;
pub mod nifti;
pub mod obj;
pub mod ply;
pub mod png;
pub mod stl;
pub mod syncing_file;
pub mod vtk;
