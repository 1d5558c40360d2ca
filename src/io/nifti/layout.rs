//! Checks what a header says about sizes, types and scaling, before a byte of memory depends on it.

use std::path::Path;

use super::error::ReadVolumeError;
use super::header::{Header, NIFTI1_SIZE, NIFTI2_SIZE};
use super::info::{Datatype, NiftiVersion, Scaling, SpatialUnit};
use crate::geometry::GridShape;

/// Names of the header fields in messages.
const DIM_NAMES: [&str; 8] = ["dim[0]", "dim[1]", "dim[2]", "dim[3]", "dim[4]", "dim[5]", "dim[6]", "dim[7]"];

/// Voxels along each axis; dimensions beyond `dim[0]` are 1, and only the first three may be more.
pub(super) fn shape(header: &Header, path: &Path) -> Result<GridShape, ReadVolumeError> {
    let rank = match usize::try_from(header.dim[0]) {
        Ok(rank @ 1..=7) => rank,
        _ => {
            return Err(ReadVolumeError::Dimension {
                path: path.into(),
                field: DIM_NAMES[0],
                found: header.dim[0],
                expected: "1 to 7 dimensions",
            });
        }
    };
    let dims = &header.dim[1..=rank];
    for (axis, &found) in (1..).zip(dims) {
        if found < 1 {
            let (field, expected) = (DIM_NAMES[axis], "at least 1 voxel");
            return Err(ReadVolumeError::Dimension { path: path.into(), field, found, expected });
        }
    }
    for (axis, &found) in (1..).zip(dims).skip(3) {
        if found > 1 {
            let (field, dims) = (DIM_NAMES[axis], dims.to_vec());
            return Err(ReadVolumeError::NotThreeD { path: path.into(), field, found, dims });
        }
    }
    let along = |axis: usize| usize::try_from(dims.get(axis).copied().unwrap_or(1)).unwrap_or(usize::MAX);
    Ok(GridShape::new(along(0), along(1), along(2)))
}

/// Bytes of all voxels, or `TooLarge` when this machine cannot even count them (in file or as f32).
pub(super) fn byte_count(shape: GridShape, datatype: Datatype, path: &Path) -> Result<u64, ReadVolumeError> {
    let too_large = || ReadVolumeError::TooLarge { path: path.into(), shape, bytes: u64::MAX };
    let voxels = shape.nx.checked_mul(shape.ny).and_then(|n| n.checked_mul(shape.nz)).ok_or_else(too_large)?;
    let bytes = voxels.checked_mul(datatype.size().max(size_of::<f32>())).filter(|n| isize::try_from(*n).is_ok());
    bytes.ok_or_else(too_large)?;
    Ok(voxels as u64 * datatype.size() as u64)
}

/// The type of a voxel, with `bitpix` in agreement.
pub(super) fn datatype(header: &Header, path: &Path) -> Result<Datatype, ReadVolumeError> {
    let code = header.datatype;
    let Some(datatype) = Datatype::ALL.into_iter().find(|datatype| datatype.code() == code) else {
        let name = match code {
            1 => "binary, 1 bit",
            32 => "complex64",
            128 => "RGB24",
            1536 => "float128",
            1792 => "complex128",
            2048 => "complex256",
            2304 => "RGBA32",
            found => return Err(ReadVolumeError::UnknownDatatype { path: path.into(), found }),
        };
        return Err(ReadVolumeError::UnsupportedDatatype { path: path.into(), code, name });
    };
    let expected = 8 * datatype.size() as i16;
    if header.bitpix != expected {
        return Err(ReadVolumeError::Bitpix { path: path.into(), found: header.bitpix, expected, datatype });
    }
    Ok(datatype)
}

/// Byte offset of the first voxel in a file that can hold at most `available` bytes.
///
/// 0 in a single file counts as "not set" and means the first byte after header and extension flag, as in the
/// reference library.
pub(super) fn vox_offset(header: &Header, path: &Path, available: u64) -> Result<u64, ReadVolumeError> {
    const EXTENSION_FLAG: u64 = 4;
    let found = header.vox_offset;
    let minimum = match (header.single_file, header.version) {
        (false, _) => 0,
        (true, NiftiVersion::One) => NIFTI1_SIZE as u64 + EXTENSION_FLAG,
        (true, NiftiVersion::Two) => NIFTI2_SIZE as u64 + EXTENSION_FLAG,
    };
    if found == 0.0 {
        return Ok(minimum);
    }
    // NaN fails the comparison; beyond 2^53 no file reaches, so the cast is exact.
    let usable = found >= minimum as f64 && found <= available as f64 && found.fract() == 0.0;
    if usable {
        Ok(found as u64)
    } else {
        Err(ReadVolumeError::VoxOffset { path: path.into(), found, minimum, available })
    }
}

/// Slope and intercept. A slope of 0, NaN or infinity means "none", and then the intercept means nothing either.
pub(super) fn scaling(header: &Header, path: &Path) -> Result<Option<Scaling>, ReadVolumeError> {
    let (slope, intercept) = (header.slope, header.intercept);
    if slope == 0.0 || !slope.is_finite() {
        return Ok(None);
    }
    if !intercept.is_finite() {
        return Err(ReadVolumeError::Scaling { path: path.into(), found: intercept, slope });
    }
    Ok((slope != 1.0 || intercept != 0.0).then_some(Scaling { slope, intercept }))
}

/// The spatial unit: the three low bits of `xyzt_units`.
pub(super) fn unit(header: &Header, path: &Path) -> Result<SpatialUnit, ReadVolumeError> {
    match header.xyzt_units & 7 {
        0 => Ok(SpatialUnit::Unknown),
        1 => Ok(SpatialUnit::Metre),
        2 => Ok(SpatialUnit::Millimetre),
        3 => Ok(SpatialUnit::Micron),
        found => Err(ReadVolumeError::Units { path: path.into(), found }),
    }
}
