//! NIfTI-1 in one file.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use flate2::{Compression, GzBuilder};

use super::header::NIFTI1_SIZE;
use super::info::Datatype;
use crate::geometry::{Affine, Grid, Matrix3};
use crate::io::atomic::write_file;
use crate::volume::{CtVolume, LabelVolume};

/// Header and empty extension flag.
const OFFSET: usize = NIFTI1_SIZE + 4;
/// zlib's default is 6; 4 packs CT a few percent worse in half the time.
const LEVEL: u32 = 4;
/// Voxels turned into bytes at a time.
const CHUNK: usize = 1 << 16;
/// Largest |entry of R^T R - 1| of axes that still count as a rotation; a qform cannot hold a shear.
const ROTATION_TOLERANCE: f64 = 1e-4;
/// `NIFTI_XFORM_SCANNER_ANAT`: patient coordinates of the scanner.
const SCANNER: i16 = 1;
/// `NIFTI_UNITS_MM`.
const MILLIMETRES: u8 = 2;

/// How the CT numbers are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CtEncoding {
    /// As they are, float32.
    Float32,
    /// Rounded to whole HU, int16: half the size, error at most 0.5 HU; values outside -32 768 to 32 767 are refused.
    Int16,
}

/// Why a volume cannot be written as NIfTI-1.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteVolumeError {
    /// The operating system refused.
    #[error("{}: could not write the volume: {source}", path.display())]
    Io {
        /// The file asked for.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The name does not say NIfTI.
    #[error("{}: found the name \"{found}\", expected one that ends in .nii or .nii.gz; rename the output", path.display())]
    Name {
        /// The file asked for.
        path: PathBuf,
        /// Its last part.
        found: String,
    },
    /// An axis too long for NIfTI-1, or of no length.
    #[error(
        "{}: {found} voxels along axis {axis}, expected 1 to 32767, all that NIfTI-1 can say; crop the volume",
        path.display()
    )]
    Shape {
        /// The file asked for.
        path: PathBuf,
        /// Voxel axis: 1, 2 or 3.
        axis: usize,
        /// Voxels along it.
        found: usize,
    },
    /// A voxel that int16 cannot hold.
    #[error(
        "{}: voxel ({}, {}, {}) is {found}, expected -32768 to 32767 for int16; write float32 instead",
        path.display(), voxel[0], voxel[1], voxel[2]
    )]
    NotInt16 {
        /// The file asked for.
        path: PathBuf,
        /// Voxel index (i, j, k), from 0.
        voxel: [usize; 3],
        /// The value found.
        found: f32,
    },
}

/// Only to carry errors through the atomic writer; the path is added outside.
impl From<io::Error> for WriteVolumeError {
    fn from(source: io::Error) -> Self {
        Self::Io { path: PathBuf::new(), source }
    }
}

/// Writes a CT as `.nii` or `.nii.gz` (by name), with sform, qform and mm.
///
/// The affine is stored in f32. A sheared grid gets no qform (its code is 0), because a qform cannot hold it.
/// The same volume gives the same bytes.
///
/// # Errors
/// [`WriteVolumeError`]; the file at `path`, if any, stays as it was.
pub fn write_ct(path: &Path, volume: &CtVolume, encoding: CtEncoding) -> Result<(), WriteVolumeError> {
    let values = volume.as_slice();
    match encoding {
        CtEncoding::Float32 => {
            write(path, volume.grid(), Datatype::F32, values, |value, bytes| bytes.extend(value.to_le_bytes()))
        }
        CtEncoding::Int16 => {
            let range = f32::from(i16::MIN)..=f32::from(i16::MAX);
            // NaN lies in no range.
            if let Some(bad) = values.iter().position(|value| !range.contains(&value.round())) {
                let (voxel, found) = (volume.shape().ijk(bad), values[bad]);
                return Err(WriteVolumeError::NotInt16 { path: path.into(), voxel, found });
            }
            write(path, volume.grid(), Datatype::I16, values, |value, bytes| {
                bytes.extend((value.round() as i16).to_le_bytes());
            })
        }
    }
}

/// Writes a label map as `.nii` or `.nii.gz` (by name): uint8 when every label is at most 255, else uint16.
///
/// Geometry as in [`write_ct`].
///
/// # Errors
/// [`WriteVolumeError`]; the file at `path`, if any, stays as it was.
pub fn write_labels(path: &Path, volume: &LabelVolume) -> Result<(), WriteVolumeError> {
    let values = volume.as_slice();
    if values.iter().all(|label| u8::try_from(*label).is_ok()) {
        write(path, volume.grid(), Datatype::U8, values, |label, bytes| bytes.push(label as u8))
    } else {
        write(path, volume.grid(), Datatype::U16, values, |label, bytes| bytes.extend(label.to_le_bytes()))
    }
}

fn write<V: Copy>(
    path: &Path,
    grid: &Grid,
    datatype: Datatype,
    values: &[V],
    encode: impl Fn(V, &mut Vec<u8>),
) -> Result<(), WriteVolumeError> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let lower = name.to_ascii_lowercase();
    let gzip = lower.ends_with(".nii.gz");
    if !gzip && !lower.ends_with(".nii") {
        return Err(WriteVolumeError::Name { path: path.into(), found: name });
    }
    let header = header(path, grid, datatype)?;
    let body = |out: &mut dyn Write| -> io::Result<()> {
        out.write_all(&header)?;
        let mut bytes = Vec::with_capacity(CHUNK * datatype.size());
        for chunk in values.chunks(CHUNK) {
            bytes.clear();
            chunk.iter().for_each(|value| encode(*value, &mut bytes));
            out.write_all(&bytes)?;
        }
        Ok(())
    };
    let written = write_file(path, |file| {
        if gzip {
            // No name and no time in the gzip header: the same volume, the same bytes.
            let mut packed = GzBuilder::new().write(file, Compression::new(LEVEL));
            body(&mut packed)?;
            packed.finish().map(|_| ())
        } else {
            body(file)
        }
    });
    written.map_err(|source: io::Error| WriteVolumeError::Io { path: path.into(), source })
}

/// The 348 bytes of the header and four zeros: no extensions.
fn header(path: &Path, grid: &Grid, datatype: Datatype) -> Result<[u8; OFFSET], WriteVolumeError> {
    let mut bytes = [0; OFFSET];
    let mut put = |at: usize, raw: &[u8]| bytes[at..at + raw.len()].copy_from_slice(raw);
    put(0, &(NIFTI1_SIZE as i32).to_le_bytes());
    put(38, b"r");
    put(40, &3i16.to_le_bytes());
    for (axis, found) in (1..).zip(grid.shape.dims()) {
        match i16::try_from(found) {
            Ok(count) if count > 0 => put(40 + 2 * axis, &count.to_le_bytes()),
            _ => return Err(WriteVolumeError::Shape { path: path.into(), axis, found }),
        }
    }
    for unused in 4..8 {
        put(40 + 2 * unused, &1i16.to_le_bytes());
    }
    put(70, &datatype.code().to_le_bytes());
    put(72, &(8 * datatype.size() as i16).to_le_bytes());
    for (axis, length) in (1..).zip(grid.affine.spacing()) {
        put(76 + 4 * axis, &(length as f32).to_le_bytes());
    }
    put(108, &(OFFSET as f32).to_le_bytes());
    put(112, &1f32.to_le_bytes());
    put(123, &[MILLIMETRES]);
    put(148, b"yawara");
    let matrix = grid.affine.matrix();
    if let Some((quaternion, qfac)) = quaternion(&grid.affine) {
        put(76, &qfac.to_le_bytes());
        put(252, &SCANNER.to_le_bytes());
        for axis in 0..3 {
            put(256 + 4 * axis, &quaternion[axis].to_le_bytes());
            put(268 + 4 * axis, &(matrix[(axis, 3)] as f32).to_le_bytes());
        }
    } else {
        put(76, &1f32.to_le_bytes());
    }
    put(254, &SCANNER.to_le_bytes());
    for row in 0..3 {
        for column in 0..4 {
            put(280 + 16 * row + 4 * column, &(matrix[(row, column)] as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    Ok(bytes)
}

/// The (b, c, d) of the unit quaternion with a >= 0, and -1 for left-handed axes; `None` for sheared axes.
fn quaternion(affine: &Affine) -> Option<([f32; 3], f32)> {
    let spacing = affine.spacing();
    let qfac = if affine.determinant() < 0.0 { -1.0 } else { 1.0 };
    let signed = [spacing[0], spacing[1], qfac * spacing[2]];
    let linear = affine.linear();
    let axes = Matrix3::from_fn(|row, column| linear[(row, column)] / signed[column]);
    if (axes.transpose() * axes - Matrix3::identity()).amax() > ROTATION_TOLERANCE {
        return None;
    }
    // Unchecked, because checked just above.
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(axes);
    let q = nalgebra::UnitQuaternion::from_rotation_matrix(&rotation);
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    Some(([q.i, q.j, q.k].map(|part| (sign * part) as f32), qfac as f32))
}
