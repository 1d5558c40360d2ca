//! Files: one format per module. Nothing here simulates.

pub mod atomic;
pub mod label_names;
pub mod nifti;
