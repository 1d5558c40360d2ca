//! The voxel-to-patient map of a header: sform, else qform, else spacing alone.
//!
//! Source: "3D image (volume) orientation and location in space" in nifti1.h. The sform is taken as it is: a sheared one
//! (gantry tilt) is not made orthogonal. Without sform and qform the standard gives no direction at all; its method 1
//! (x = pixdim[1] i, ...) is used and [`AffineSource::Spacing`] says so.

use std::path::Path;

use super::error::ReadVolumeError;
use super::header::Header;
use super::info::{AffineSource, SpatialUnit};
use crate::geometry::{Affine, GridShape, Matrix3, Matrix4, Vector3};

/// Shortest and longest voxel spacing [mm]: a nanometre and 100 m bracket every scanner and every microscope, and catch a
/// header read in the wrong byte order.
const SPACING_RANGE: [f64; 2] = [1e-6, 1e5];
/// How far b^2 + c^2 + d^2 may exceed 1: f32 components, some of them written as text with five digits.
const QUATERNION_EXCESS: f64 = 1e-4;
/// Below this, 1 - b^2 - c^2 - d^2 is rounding of an exact half turn (the value of the reference library).
const HALF_TURN: f64 = 1e-7;

/// The map [mm] and where it comes from.
///
/// `pixdim` must be sound even where the sform makes it superfluous: a header that is broken there is broken.
/// A negative spacing counts as its absolute value, as in the reference library.
pub(super) fn affine(
    header: &Header,
    shape: GridShape,
    unit: SpatialUnit,
    path: &Path,
) -> Result<(Affine, AffineSource), ReadVolumeError> {
    let mut spacing = [1.0; 3];
    for (axis, spacing) in spacing.iter_mut().enumerate() {
        let found = header.pixdim[axis + 1];
        match spacing_mm(found, unit) {
            Some(usable) => *spacing = usable,
            // A flat axis has no spacing to speak of; 2-D files often leave it 0.
            None if shape.dims()[axis] == 1 && found == 0.0 => {}
            None => return Err(bad_spacing(path, axis + 1, found)),
        }
    }
    let (affine_source, matrix) = if header.sform_code > 0 {
        (AffineSource::Sform, sform(header) * unit.in_mm())
    } else if header.qform_code > 0 {
        (AffineSource::Qform, qform(header, spacing, unit, path)?)
    } else {
        (AffineSource::Spacing, Matrix4::new_nonuniform_scaling(&Vector3::from(spacing)))
    };
    let affine =
        Affine::new(&matrix).map_err(|source| ReadVolumeError::Affine { path: path.into(), affine_source, source })?;
    for (axis, length) in (1..).zip(affine.spacing()) {
        spacing_mm(length, SpatialUnit::Millimetre).ok_or_else(|| bad_spacing(path, axis, length))?;
    }
    Ok((affine, affine_source))
}

fn spacing_mm(found: f64, unit: SpatialUnit) -> Option<f64> {
    let length = found.abs() * unit.in_mm();
    (SPACING_RANGE[0]..=SPACING_RANGE[1]).contains(&length).then_some(length)
}

fn bad_spacing(path: &Path, axis: usize, found: f64) -> ReadVolumeError {
    let [shortest, longest] = SPACING_RANGE;
    ReadVolumeError::Spacing { path: path.into(), axis, found, shortest, longest }
}

/// Upper three rows in the unit of the file; the last row is not used.
fn sform(header: &Header) -> Matrix4 {
    Matrix4::from_fn(|row, column| if row < 3 { header.srow[row][column] } else { 0.0 })
}

fn qform(header: &Header, spacing: [f64; 3], unit: SpatialUnit, path: &Path) -> Result<Matrix4, ReadVolumeError> {
    let found = header.quaternion;
    let norm: f64 = found.iter().map(|x| x * x).sum();
    if norm.is_nan() || norm > 1.0 + QUATERNION_EXCESS {
        return Err(ReadVolumeError::Quaternion { path: path.into(), found, norm });
    }
    let qfac = match header.pixdim[0] {
        found if found.is_nan() => return Err(ReadVolumeError::Handedness { path: path.into(), found }),
        negative if negative < 0.0 => -1.0,
        _ => 1.0,
    };
    // Unit quaternion (a, b, c, d) with a >= 0; only b, c, d are stored.
    let ([b, c, d], a) =
        if 1.0 - norm < HALF_TURN { (found.map(|x| x / norm.sqrt()), 0.0) } else { (found, (1.0 - norm).sqrt()) };
    let rotation = Matrix3::new(
        a * a + b * b - c * c - d * d,
        2.0 * (b * c - a * d),
        2.0 * (b * d + a * c),
        2.0 * (b * c + a * d),
        a * a + c * c - b * b - d * d,
        2.0 * (c * d - a * b),
        2.0 * (b * d - a * c),
        2.0 * (c * d + a * b),
        a * a + d * d - b * b - c * c,
    );
    let axes = rotation * Matrix3::from_diagonal(&Vector3::new(spacing[0], spacing[1], qfac * spacing[2]));
    let mut matrix = axes.to_homogeneous();
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&(Vector3::from(header.qoffset) * unit.in_mm()));
    Ok(matrix)
}
