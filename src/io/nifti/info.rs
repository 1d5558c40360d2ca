//! What a NIfTI header says about its volume.

use std::fmt;
use std::path::PathBuf;

use crate::geometry::{Affine, Grid, GridShape};

/// The version of a NIfTI header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NiftiVersion {
    /// NIfTI-1: 348 bytes, sizes of at most 32 767.
    One,
    /// NIfTI-2: 540 bytes, sizes of 64 bits.
    Two,
}

impl fmt::Display for NiftiVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::One => "NIfTI-1",
            Self::Two => "NIfTI-2",
        })
    }
}

/// The order of the bytes of a number in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ByteOrder {
    /// Least significant byte first.
    Little,
    /// Most significant byte first.
    Big,
}

impl fmt::Display for ByteOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Little => "little-endian",
            Self::Big => "big-endian",
        })
    }
}

/// The type of a stored voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Datatype {
    /// Unsigned 8 bit.
    U8,
    /// Signed 8 bit.
    I8,
    /// Unsigned 16 bit.
    U16,
    /// Signed 16 bit.
    I16,
    /// Unsigned 32 bit.
    U32,
    /// Signed 32 bit.
    I32,
    /// Unsigned 64 bit.
    U64,
    /// Signed 64 bit.
    I64,
    /// IEEE 32 bit.
    F32,
    /// IEEE 64 bit.
    F64,
}

impl Datatype {
    /// Every type that can be read.
    pub const ALL: [Self; 10] =
        [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::U64, Self::I64, Self::F32, Self::F64];

    /// The code in the header.
    pub const fn code(self) -> i16 {
        match self {
            Self::U8 => 2,
            Self::I16 => 4,
            Self::I32 => 8,
            Self::F32 => 16,
            Self::F64 => 64,
            Self::I8 => 256,
            Self::U16 => 512,
            Self::U32 => 768,
            Self::I64 => 1024,
            Self::U64 => 1280,
        }
    }

    /// Bytes per voxel.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

impl fmt::Display for Datatype {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::U64 => "uint64",
            Self::I64 => "int64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        })
    }
}

/// Which part of the header the voxel-to-patient map was taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AffineSource {
    /// The full affine of `srow_x`, `srow_y`, `srow_z` (sform_code > 0).
    Sform,
    /// Rotation, spacing and offset of the qform (qform_code > 0, no sform).
    Qform,
    /// Only the voxel spacing is known: axes i, j, k are *taken* as R, A, S and voxel (0, 0, 0) as the origin.
    /// Left and right may be wrong, and a user should be told.
    Spacing,
}

impl fmt::Display for AffineSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sform => "sform",
            Self::Qform => "qform",
            Self::Spacing => "voxel spacing (pixdim)",
        })
    }
}

/// The spatial unit of a file; everything is converted to mm on reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpatialUnit {
    /// Not stated; taken as mm, as every reader does.
    Unknown,
    /// Metre.
    Metre,
    /// Millimetre.
    Millimetre,
    /// Micrometre.
    Micron,
}

impl SpatialUnit {
    /// Millimetres in one unit.
    pub const fn in_mm(self) -> f64 {
        match self {
            Self::Unknown | Self::Millimetre => 1.0,
            Self::Metre => 1e3,
            Self::Micron => 1e-3,
        }
    }
}

impl fmt::Display for SpatialUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "unknown (taken as mm)",
            Self::Metre => "m",
            Self::Millimetre => "mm",
            Self::Micron => "micron",
        })
    }
}

/// value = slope * stored + intercept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scaling {
    /// `scl_slope`.
    pub slope: f64,
    /// `scl_inter`.
    pub intercept: f64,
}

/// What a NIfTI header says, checked and in mm.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct VolumeInfo {
    /// The file that holds the header.
    pub header_path: PathBuf,
    /// The file that holds the voxels: the same, or the `.img` of a pair.
    pub data_path: PathBuf,
    /// Header version.
    pub version: NiftiVersion,
    /// Order of bytes in both files.
    pub byte_order: ByteOrder,
    /// True when the voxels are gzip-compressed (by content, whatever the name says).
    pub gzip: bool,
    /// Type of a stored voxel.
    pub datatype: Datatype,
    /// Number of voxels and the map to patient space, RAS+ [mm].
    pub grid: Grid,
    /// Where the map comes from.
    pub affine_source: AffineSource,
    /// Slope and intercept, when the file has them and they change anything.
    pub scaling: Option<Scaling>,
    /// The unit the file is written in.
    pub unit: SpatialUnit,
    /// Byte offset of the first voxel in [`VolumeInfo::data_path`].
    pub offset: u64,
    /// The free text of the header (`descrip`), without control characters.
    pub description: String,
    /// NaN and infinite voxels that [`read_ct`](super::read_ct) replaced by [`AIR_HU`](super::AIR_HU); 0 when only the
    /// header was read.
    pub replaced_voxels: u64,
}

impl VolumeInfo {
    /// Voxels along each axis.
    pub fn shape(&self) -> GridShape {
        self.grid.shape
    }

    /// Voxel-to-patient map, RAS+ [mm].
    pub fn affine(&self) -> &Affine {
        &self.grid.affine
    }

    /// Length of each voxel axis [mm].
    pub fn spacing(&self) -> [f64; 3] {
        self.grid.affine.spacing()
    }

    /// The directions in which i, j and k increase, as letters: `RAS`, `LPS`, ...
    pub fn axis_codes(&self) -> String {
        self.grid.affine.axis_codes()
    }
}
