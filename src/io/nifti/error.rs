//! Why a NIfTI file cannot become a volume.

use std::io;
use std::path::PathBuf;

use super::info::{AffineSource, Datatype};
use crate::geometry::{AffineError, GridShape};

/// Why a NIfTI file cannot be read; every message names the file, what was found, what was expected and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadVolumeError {
    /// The operating system refused.
    #[error("{}: could not read the volume: {source}", path.display())]
    Io {
        /// The file asked for.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A folder, a pipe or a device.
    #[error(
        "{}: is {found}, expected a regular file; give a NIfTI file (.nii, .nii.gz, or .hdr with its .img)",
        path.display()
    )]
    NotAFile {
        /// The path asked for.
        path: PathBuf,
        /// What lies there.
        found: &'static str,
    },
    /// The content is something else.
    #[error(
        "{}: not a NIfTI file: found {found}, expected a NIfTI-1 or NIfTI-2 header; convert the data to .nii.gz first",
        path.display()
    )]
    NotNifti {
        /// The file.
        path: PathBuf,
        /// What the first bytes look like.
        found: String,
    },
    /// The file ends within the header.
    #[error(
        "{}: the header ends after {found} bytes, expected {expected}; the file is truncated, copy it again",
        path.display()
    )]
    ShortHeader {
        /// The file.
        path: PathBuf,
        /// Bytes present (after decompression).
        found: u64,
        /// Bytes a header of this version has.
        expected: u64,
    },
    /// One half of an .hdr/.img pair is missing.
    #[error(
        "{}: its other half {} (or the same with .gz) was not found; a .hdr/.img pair needs both files in one folder",
        path.display(),
        missing.display()
    )]
    MissingPart {
        /// The half that was given.
        path: PathBuf,
        /// The half that was looked for.
        missing: PathBuf,
    },
    /// The gzip stream is broken: truncated, wrong checksum, damaged.
    #[error(
        "{}: the gzip stream breaks after {after} uncompressed bytes ({source}), expected it whole; the file is \
         damaged or truncated, copy it again",
        path.display()
    )]
    Gzip {
        /// The file.
        path: PathBuf,
        /// Uncompressed bytes that came out before.
        after: u64,
        /// What the decompressor said.
        source: io::Error,
    },
    /// A size in the header cannot be a size.
    #[error("{}: {field} = {found} cannot be used, expected {expected}; the header is damaged, export the volume again",
        path.display())]
    Dimension {
        /// The file.
        path: PathBuf,
        /// Header field, such as `dim[1]`.
        field: &'static str,
        /// Its value.
        found: i64,
        /// What it may be.
        expected: &'static str,
    },
    /// More than three dimensions hold data.
    #[error(
        "{}: {field} = {found} (dimensions {dims:?}), expected 1: this is a series or has several values per voxel, \
         not one 3-D volume; extract one 3-D volume from it first",
        path.display()
    )]
    NotThreeD {
        /// The file.
        path: PathBuf,
        /// Header field, such as `dim[4]`.
        field: &'static str,
        /// Its value.
        found: i64,
        /// All dimensions in use.
        dims: Vec<i64>,
    },
    /// The voxels cannot fit in memory.
    #[error(
        "{}: dim gives {shape} voxels, which need {bytes} bytes, expected what this machine can hold; \
         crop or resample the volume first",
        path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Voxels along each axis.
        shape: GridShape,
        /// Memory needed (saturating).
        bytes: u64,
    },
    /// A data type code the standard does not know.
    #[error(
        "{}: datatype = {found} is not a NIfTI data type, expected an integer or float type (2, 4, 8, 16, 64, 256, \
         512, 768, 1024, 1280); the header is damaged, export the volume again",
        path.display()
    )]
    UnknownDatatype {
        /// The file.
        path: PathBuf,
        /// The code found.
        found: i16,
    },
    /// A known data type that holds no plain number per voxel.
    #[error(
        "{}: datatype = {code} ({name}) holds no single integer or float per voxel, expected a type from uint8 to \
         float64; convert the volume to int16 or float32 first",
        path.display()
    )]
    UnsupportedDatatype {
        /// The file.
        path: PathBuf,
        /// The code found.
        code: i16,
        /// Its name in the standard.
        name: &'static str,
    },
    /// Two header fields contradict each other about the size of a voxel.
    #[error(
        "{}: bitpix = {found} contradicts datatype {datatype}, expected {expected}; the header is damaged, export \
         the volume again",
        path.display()
    )]
    Bitpix {
        /// The file.
        path: PathBuf,
        /// Bits per voxel by `bitpix`.
        found: i16,
        /// Bits per voxel by `datatype`.
        expected: i16,
        /// The data type.
        datatype: Datatype,
    },
    /// The place of the first voxel is impossible.
    #[error(
        "{}: vox_offset = {found} cannot be used, expected a whole number from {minimum} up to the size of the file \
         ({available} bytes); the header is damaged, export the volume again",
        path.display()
    )]
    VoxOffset {
        /// The file that holds the voxels.
        path: PathBuf,
        /// Byte offset found.
        found: f64,
        /// Smallest offset possible.
        minimum: u64,
        /// Bytes in the file that holds the voxels (the most a gzip file of this size can unpack to).
        available: u64,
    },
    /// Fewer bytes than the header promises.
    #[error(
        "{}: holds at most {found} bytes, expected {expected} ({shape} voxels of {datatype} from byte {offset}); the \
         file is truncated or its dim is damaged, copy it again",
        path.display()
    )]
    Truncated {
        /// The file that holds the voxels.
        path: PathBuf,
        /// Bytes present (for gzip: unpacked, or the most that a gzip file of this size can unpack to).
        found: u64,
        /// Bytes the header promises.
        expected: u64,
        /// Voxels along each axis.
        shape: GridShape,
        /// Data type of a voxel.
        datatype: Datatype,
        /// Byte offset of the first voxel.
        offset: u64,
    },
    /// The voxel spacing is not a length.
    #[error(
        "{}: pixdim[{axis}] = {found} is not a usable voxel spacing, expected a finite number, not 0, of {shortest} \
         to {longest} mm; fix the header",
        path.display()
    )]
    Spacing {
        /// The file.
        path: PathBuf,
        /// Voxel axis: 1, 2 or 3.
        axis: usize,
        /// The value found, in the unit of the file.
        found: f64,
        /// Shortest spacing accepted [mm].
        shortest: f64,
        /// Longest spacing accepted [mm].
        longest: f64,
    },
    /// The voxel-to-patient map is not invertible or not finite.
    #[error(
        "{}: the {affine_source} cannot be used: {source}; expected three independent voxel axes, fix the header \
         (or set sform_code and qform_code to 0 if only the spacing is known)",
        path.display()
    )]
    Affine {
        /// The file.
        path: PathBuf,
        /// Which part of the header the map was taken from.
        affine_source: AffineSource,
        /// What is wrong with it.
        source: AffineError,
    },
    /// The rotation of the qform is no rotation.
    #[error(
        "{}: quatern_b, c, d = {found:?} is no rotation (b^2 + c^2 + d^2 = {norm}), expected at most 1; fix the \
         header or give it an sform",
        path.display()
    )]
    Quaternion {
        /// The file.
        path: PathBuf,
        /// The three components.
        found: [f64; 3],
        /// b^2 + c^2 + d^2.
        norm: f64,
    },
    /// The handedness of the qform is not a number: left and right cannot be told apart.
    #[error("{}: pixdim[0] = {found} does not say the handedness of the qform, expected 1 or -1; fix the header",
        path.display())]
    Handedness {
        /// The file.
        path: PathBuf,
        /// The value found.
        found: f64,
    },
    /// A slope without a usable intercept.
    #[error(
        "{}: scl_inter = {found} with scl_slope = {slope}, expected a finite intercept; set it to 0 in the header if \
         there is none",
        path.display()
    )]
    Scaling {
        /// The file.
        path: PathBuf,
        /// The intercept found.
        found: f64,
        /// The slope beside it.
        slope: f64,
    },
    /// A unit code the standard does not know.
    #[error(
        "{}: xyzt_units has spatial unit {found}, expected 0 (unknown, taken as mm), 1 (m), 2 (mm) or 3 (micron); \
         fix the header",
        path.display()
    )]
    Units {
        /// The file.
        path: PathBuf,
        /// The three low bits of `xyzt_units`.
        found: i32,
    },
    /// A voxel that is no label.
    #[error(
        "{}: voxel ({}, {}, {}) is {found}, expected a label: a whole number from 0 to 65535; is this a CT or a \
         probability map? threshold it or give the label file",
        path.display(), voxel[0], voxel[1], voxel[2]
    )]
    NotALabel {
        /// The file.
        path: PathBuf,
        /// Voxel index (i, j, k), from 0.
        voxel: [usize; 3],
        /// The value found, after scaling.
        found: f64,
    },
}
