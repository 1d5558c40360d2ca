//! NIfTI-1 and NIfTI-2 volumes: `.nii`, `.nii.gz`, and `.hdr`/`.img` pairs (packed or not, either name given).
//!
//! Read: every integer and float type, both byte orders, slope and intercept, header extensions (skipped), gzip of one or
//! several members, recognised by content. Geometry comes out in RAS+ mm, from the sform, else the qform, else the
//! spacing alone ([`AffineSource`] tells which); files in metres or microns are converted.
//!
//! Refused with a typed error: more than one value per voxel or more than one volume in a file, complex and colour types,
//! headers that contradict themselves or the file, truncated or damaged data. A gzip checksum is checked whenever the
//! voxels are read. Sizes are compared with the file before memory is reserved.
//!
//! Written: NIfTI-1 in one file, `.nii` or `.nii.gz`, whole or not at all.
//!
//! Not guaranteed: values beyond 2^24 in 32- and 64-bit integers are rounded to f32 in a CT; extensions and intent codes
//! are not interpreted.

mod error;
mod header;
mod info;
mod layout;
mod orientation;
mod read;
mod source;
mod write;

pub use error::ReadVolumeError;
pub use info::{AffineSource, ByteOrder, Datatype, NiftiVersion, Scaling, SpatialUnit, VolumeInfo};
pub use read::{read_ct, read_info, read_labels};
pub use write::{CtEncoding, WriteVolumeError, write_ct, write_labels};

/// The lowest CT number a 12-bit scanner stores [HU], darker than air (-1000): stands in for NaN and infinite voxels of a CT.
pub const AIR_HU: f32 = -1024.0;
